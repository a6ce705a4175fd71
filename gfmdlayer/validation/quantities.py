"""Numbers with a unit, "0.5 mm" or "120 rpm": converted into the units of the configuration around them.

The value is a `Written`, a number that also has the text: results and their digests depend on the number, and
a configuration that is stored or combined with other units keeps the text. What a text means depends on other
keys of the configuration: `measured` gives their `Measures` to all fields that are validated within.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction
from typing import Protocol

from pydantic_core import PydanticCustomError

from gfmdlayer.files.units import Unit, alike, unit_of
from gfmdlayer.validation.problems import shown


class Written(float):
    """A number that the user wrote as a text: with a unit, or as a word for a time."""

    text: str

    def __new__(cls, value: float, text: str) -> Written:
        """Make the number of a text."""
        number = super().__new__(cls, value)
        number.text = text
        return number

    def __getnewargs__(self) -> tuple[float, str]:  # type: ignore[override]
        """Keep the text in copies, and between processes."""
        return float(self), self.text


class Measures(Protocol):
    """What texts mean in a configuration."""

    def unit(self, dimension: str) -> tuple[Unit, str, str] | None:
        """Return the unit of a dimension in words, its label, and the words here; None without `units`."""
        ...

    def moment(self, word: str) -> float:
        """Return the time that a word stands for; PydanticCustomError where it has none."""
        ...


_around: ContextVar[Measures | None] = ContextVar("around", default=None)


@contextmanager
def measured(measures: Measures) -> Iterator[None]:
    """Let texts that are validated within the block have the meaning of a configuration."""
    before = _around.set(measures)
    try:
        yield
    finally:
        _around.reset(before)


def around() -> Measures | None:
    """Return the measures of the configuration that is validated; None for a section alone."""
    return _around.get()


def refused(text: str, message: str) -> PydanticCustomError:
    """Return the error for a number with a unit."""
    return PydanticCustomError("quantity", f"got {shown(text)}; {message}")


# Digits are limited, so that no text makes a number of a million digits.
_QUANTITY = re.compile(
    r"\s*([-+]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][-+]?\d{1,3})?)(?:\s+(\S.*)|([^\s\d.,].*))"
)
_COMMA = re.compile(r"\s*[-+]?[\d.' ]*,\d")
_NAMES = {
    "V": "voltage", "degrees": "angle", "degrees Celsius": "temperature", "kelvin": "temperature difference",
    "ohm length": "resistivity", "J/mol": "energy per mole", "1 / time": "frequency",
    "1/length": "angle over length",
}  # fmt: skip
_EXAMPLES = {"degrees Celsius": "degC", "degrees": "deg", "kelvin": "K", "1 / time": "Hz"}
_TURN = unit_of("rev")
_ANGLE = 5  # place of the angle among the powers of a dimension


def parts(text: str) -> tuple[str, str] | None:
    """Return the number and the unit in a text, or None where it does not begin with a number."""
    match = _QUANTITY.fullmatch(text)
    return (match[1], (match[2] or match[3]).strip()) if match else None


def is_quantity(text: str) -> bool:
    """Whether a text is a number with a known unit; no file is meant then."""
    found = parts(text)
    return found is not None and unit_of(found[1]) is not None


def number(text: str, dimension: str, allowed: str) -> float | None:
    """Return the number in a text with a unit, in the unit of a dimension; None for other texts.

    Raises
    ------
    PydanticCustomError
        The unit is unknown, of another dimension or ambiguous, or the configuration has no units.
    """
    if _COMMA.match(text):
        raise refused(text, f"a comma may be a decimal mark or part thousands; must be {allowed}, with a "
                      "decimal point")  # fmt: skip
    if (found := parts(text)) is None:
        return None
    measures = around()
    if measures is None:
        message = "a section by itself has no units; give it as a mapping in a configuration with units"
        raise refused(text, f"{message}, or a number")
    if (known := measures.unit(dimension)) is None:
        needed = "the configuration has no units; give units: {length: mm, stress: MPa, time: s}"
        raise refused(text, f"{needed}, or {allowed}")
    target, label, words = known
    digits, symbol = found
    unit, wrong = _into(symbol, target, _NAMES.get(words, words))
    if unit is None:
        example = f"'1 {_EXAMPLES.get(dimension, label)}'"
        raise refused(text, f"{wrong}; must be {allowed}, in {label}, or with a unit, such as {example}")
    value = (Fraction(digits) * unit.size + unit.offset - target.offset) / target.size
    try:
        result = float(value)
    except OverflowError:
        result = 0.0
    if value and not result:
        raise refused(text, f"which is outside of the range of numbers; must be {allowed}, in {label}")
    return result


def in_the_run(word: str) -> float:
    """Return the time that a word stands for in the configuration around."""
    measures = around()
    if measures is None:
        message = f"got {word!r}; a section by itself has no run; give it as a mapping in a configuration"
        raise PydanticCustomError("moment", message)
    return measures.moment(word)


def _into(symbol: str, target: Unit, name: str) -> tuple[Unit | None, str]:
    """Return a unit by its symbol for conversion into another one, or why it cannot be converted."""
    unit = unit_of(symbol)
    if unit is None:
        several = alike(symbol)
        meant = f", and may be {' or '.join(several)}" if several else ""
        return None, f"{symbol!r} is no known unit{meant}"
    if name == "frequency":  # in cycles: a turn is one
        assert _TURN is not None
        if unit.dimension == _with_angle(target):
            return Unit(unit.size / _TURN.size, target.dimension), ""
        if unit.dimension == target.dimension and "z" not in symbol.lower():
            return None, f"{symbol!r} may be cycles or radians over time: write Hz, rpm or rad/s"
    elif name == "angle over length" and unit.dimension == _with_angle(target):
        return unit, ""
    if unit.dimension != target.dimension:
        return None, f"{symbol!r} is no unit of {name}"
    if unit.offset and not target.offset:
        return None, f"{symbol!r} may be a temperature or a difference; write a difference in K"
    return unit, ""


def _with_angle(unit: Unit) -> tuple[int, ...]:
    """Return the dimension of radians times a unit."""
    return tuple(power + (place == _ANGLE) for place, power in enumerate(unit.dimension))
