"""Labels of the figures: symbols of variables and swept keys, and values.

Symbols of swept keys come from the attribute `symbol` of the results, those of other variables from there or
from the paper.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

from gfmdlayer.observables import INDENTATION, known_columns
from gfmdlayer.results.schema import OVER_TIME, PARAMETERS

if TYPE_CHECKING:
    from xarray import DataArray

PAPER_SYMBOLS = {
    **{name: column.symbol for name, column in known_columns().items() if column.symbol},
    **{column.name: column.symbol for column in INDENTATION if column.symbol},
    "mean_stress": r"\bar{p}",
    "mean_gap": r"\bar{g}",
    "pull_off_force": r"F_\mathrm{pull}",
    "pull_off_stress": r"\bar{p}_\mathrm{pull}",
    "work_of_separation": r"W_\mathrm{sep}",
    "loop_area": r"\oint\bar{p}\,\mathrm{d}\delta",
    "traction": r"\tau",
    "displacement": "u",
    "pressure": "p",
    "gap": "g",
    "x": "x",
    "y": "y",
    "time": "t",
    "snapshot": "t",
}
# Symbols of keys inside of a section that is swept as a whole; values of keys that name its kind stand alone.
SYMBOLS_OF_KEYS = {key.rpartition(".")[2]: f"${PARAMETERS[key].mathtext}$" for key in reversed(PARAMETERS)}
KINDS = ("shape", "model", "kind", "law", "method")
MOST_LETTERS = 24

_ENTRIES = re.compile(r", (?![^\[]*\])")  # between entries, not inside of a list


def symbol(array: DataArray) -> str:
    """Return the symbol of a variable or swept key as mathtext, or its name in words if it has no symbol."""
    if "symbol" in array.attrs:
        return f"${mathtext(array.attrs['symbol'])}$"
    name = str(array.name).removesuffix(OVER_TIME)
    return f"${PAPER_SYMBOLS[name]}$" if name in PAPER_SYMBOLS else name.replace("_", " ")


def mathtext(plain: str) -> str:
    r"""Write a symbol of plain text, such as G_inf, nu_bulk or dt, as mathtext."""
    letter, _, index = plain.partition("_")
    if letter == "dt":
        letter = r"\Delta t"
    elif len(letter) > 1 and letter.isalpha():
        letter = f"\\{letter}"
    if len(index) > 1:
        parts = (r"\infty" if part == "inf" else rf"\mathrm{{{part}}}" for part in index.split(","))
        joined = ",".join(parts)
        index = f"{{{joined}}}" if "," in index else joined
    return f"{letter}_{index}" if index else letter


def value_labels(values: Sequence[object]) -> list[str]:
    """Write values for a legend, all in the same way.

    If all values are whole numbers or plain fractions they are written as 1/32, or 1/3 where the value has
    all digits of it. Infinity is written as its sign, large numbers with powers of ten. Text stays as it is;
    a mapping, such as "shape=parabola, radius=0.25", is shortened.
    """
    if any(isinstance(value, str) for value in values):
        return _short([str(value) for value in values])
    numbers = [float(str(value)) for value in values]
    fractions = [_fraction(number) for number in numbers if math.isfinite(number)]
    is_fractional = None not in fractions and any(
        fraction is not None and fraction.denominator not in (1, 2, 4) for fraction in fractions
    )
    return [_number_label(number, is_fractional) for number in numbers]


def _short(texts: Sequence[str]) -> list[str]:
    """Write mappings as "parabola $R$ = 0.25", without entries that are the same in all of them."""
    mappings = [dict(entry.partition("=")[::2] for entry in _ENTRIES.split(text)) for text in texts]
    in_all = set.intersection(*(set(mapping.items()) for mapping in mappings)) if len(texts) > 1 else set()
    return [
        " ".join(_short_entries(mapping, in_all)) if "=" in text else text
        for text, mapping in zip(texts, mappings, strict=True)
    ]


def _short_entries(mapping: dict[str, str], in_all: set[tuple[str, str]]) -> Iterator[str]:
    yield from (value for key, value in mapping.items() if key in KINDS)
    entries = [(key, value) for key, value in mapping.items() if key not in KINDS]
    kept = [entry for entry in entries if entry not in in_all] or entries
    yield ", ".join(f"{SYMBOLS_OF_KEYS.get(key, key)} = {_short_value(value)}" for key, value in kept)


def _short_value(value: str) -> str:
    """Write a number as `value_labels` does, and the first letters of a long list."""
    try:
        return value_labels([float(value)])[0]
    except ValueError:
        return value if len(value) <= MOST_LETTERS else f"{value[: MOST_LETTERS - 1]}…"


def _fraction(number: float) -> Fraction | None:
    """Return the plain fraction that a number stands for, or None."""
    fraction = Fraction(number).limit_denominator(1024)
    is_binary = fraction.denominator & (fraction.denominator - 1) == 0
    has_many_digits = len(repr(abs(number)).strip("0.")) > 10
    return fraction if float(fraction) == number and (is_binary or has_many_digits) else None


def _number_label(number: float, is_fractional: bool) -> str:
    if math.isinf(number):
        return r"$\infty$" if number > 0 else r"$-\infty$"
    if is_fractional:
        return str(_fraction(number))
    mantissa, _, exponent = f"{number:.6g}".partition("e")
    if not exponent and (abs(number) < 1e4 or number % 1000):
        return mantissa
    mantissa, _, exponent = f"{number:.5e}".partition("e")
    mantissa = mantissa.rstrip("0").rstrip(".")
    power = f"10^{{{int(exponent)}}}"
    return f"${power}$" if mantissa == "1" else rf"${mantissa}\times {power}$"
