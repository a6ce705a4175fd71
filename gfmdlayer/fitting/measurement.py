"""Measured curves, and the response of a Maxwell branch at the measured frequencies or times.

A master curve is the storage and loss modulus G' + i G'' = G(omega) over angular frequency, a relaxation
curve G(t) the stress after a unit step of strain, over two. A branch of unit modulus and relaxation time tau
adds, Eqs. (4) and (5) of Petrenko et al., Materials Physics and Mechanics 52 (2024) 60-68,

    i omega tau/(1 + i omega tau)     to the one, and     exp(-t/tau)     to the other.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Self, TypedDict

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.materials import Law
from gfmdlayer.files.tables import TableError, is_number, read_columns, read_lines

FEWEST_ROWS = 8  # enough to choose between one branch and two


class FitError(ValueError):
    """A fit is not possible; the message gives the reason and the allowed values."""


@dataclass(frozen=True)
class Measurement(ABC):
    """A measured curve; responses are flat, one modulus after the other."""

    source: str  # name of the file
    abscissa: FloatArray  # shape (rows,): angular frequencies or times, positive
    moduli: FloatArray  # shape (moduli, rows), positive
    units: tuple[str, str] = ("", "")  # of abscissa and moduli, where the file names them

    name: ClassVar[str]
    columns: ClassVar[tuple[str, ...]]
    slower: ClassVar[str]
    spring: ClassVar[tuple[float, ...]]  # the moduli of a spring of unit modulus
    power: ClassVar[int]  # of the relaxation times to which the abscissa is proportional

    @property
    def reach(self) -> tuple[float, float]:
        """The shortest and the longest relaxation time within the measured range."""
        shortest, longest = sorted((self.abscissa[[0, -1]] ** float(self.power)).tolist())
        return shortest, longest

    def constant(self) -> FloatArray:
        """Response of a spring of unit modulus, shape (moduli * rows,)."""
        return np.repeat(self.spring, self.abscissa.size)

    @abstractmethod
    def response(self, times: FloatArray) -> FloatArray:
        """Response of branches of unit modulus, shape (moduli * rows, times)."""

    @abstractmethod
    def sensitivity(self, times: FloatArray) -> FloatArray:
        """Derivative of the response to the logarithm of the relaxation time, in the response's shape."""

    @abstractmethod
    def predicted(self, material: Law, abscissa: FloatArray) -> FloatArray:
        """The moduli of a material, shape (moduli, abscissae)."""

    def slowed(self, factor: float) -> Self:
        """The curve of a material with all relaxation times longer by a factor."""
        return replace(self, abscissa=self.abscissa * factor**self.power)

    def in_units_of(self, modulus: float) -> Self:
        """The same curve with its moduli divided by one."""
        return replace(self, moduli=self.moduli / modulus, units=(self.units[0], ""))


class MasterCurve(Measurement):
    """Storage and loss modulus over angular frequency."""

    name = "master curve"
    columns = ("omega", "G'", "G''")
    slower = "lower frequencies"
    spring = (1.0, 0.0)
    power = -1

    def response(self, times: FloatArray) -> FloatArray:
        """Real and imaginary part of i omega tau/(1 + i omega tau)."""
        cycles = 1j * np.multiply.outer(self.abscissa, times)
        return _parts(cycles / (1 + cycles))

    def sensitivity(self, times: FloatArray) -> FloatArray:
        """Real and imaginary part of i omega tau/(1 + i omega tau)^2."""
        cycles = 1j * np.multiply.outer(self.abscissa, times)
        return _parts(cycles / (1 + cycles) ** 2)

    def predicted(self, material: Law, abscissa: FloatArray) -> FloatArray:
        """Storage and loss modulus of a material."""
        modulus = material.complex_modulus(abscissa)
        return np.stack([modulus.real, modulus.imag])


class RelaxationCurve(Measurement):
    """Relaxation modulus over time."""

    name = "relaxation curve"
    columns = ("t", "G")
    slower = "longer times"
    spring = (1.0,)
    power = 1

    def response(self, times: FloatArray) -> FloatArray:
        """exp(-t/tau)."""
        return np.asarray(np.exp(-np.divide.outer(self.abscissa, times)))

    def sensitivity(self, times: FloatArray) -> FloatArray:
        """(t/tau) exp(-t/tau)."""
        elapsed = np.divide.outer(self.abscissa, times)
        return np.asarray(elapsed * np.exp(-elapsed))

    def predicted(self, material: Law, abscissa: FloatArray) -> FloatArray:
        """Relaxation modulus of a material, in a first dimension of one."""
        return material.relaxation_modulus(abscissa)[np.newaxis]


class Reading(TypedDict, total=False):
    """How a file is read, see `read`."""

    poisson: float
    names: str | None


def read(path: Path, poisson: float = 0.5, names: str | None = None) -> Measurement:
    """Read a measured curve: a master curve from three columns, a relaxation curve from two columns.

    Commas, semicolons or white space separate columns, `#` starts a comment, and the first line may name the
    columns; without names they are omega, G' and G'', or t and G. `names` replaces the names in the file;
    `poisson` converts moduli in tension. Frequencies or times must increase.
    """
    quantities, units = _quantities(path, names)
    symbols = symbols_of(quantities)

    def row_error(row: Sequence[float]) -> str | None:
        wrong = (f"{name} = {value:g}" for name, value in zip(symbols, row, strict=True) if value <= 0)
        found = ", ".join(wrong)
        return found and f"{found}; must be > 0"

    increasing = quantities[0] in {"omega", "frequency", "time"}
    rows = read_columns(path, symbols, increasing=increasing, at_least=FEWEST_ROWS, row_error=row_error)
    abscissa, *moduli = converted(quantities, rows, poisson).T
    if not (np.diff(abscissa) > 0).all():
        raise TableError(f"{path}: frequencies or times must increase from row to row")
    kind = MasterCurve if len(moduli) == 2 else RelaxationCurve
    return kind(path.name, abscissa, np.array(moduli), units)


def _quantities(path: Path, names: str | None) -> tuple[tuple[str, ...], tuple[str, str]]:
    """Find the quantities of the columns, by their names or their number, and the units in their names."""
    by_width = {len(each): each for each in (MASTER, RELAXATION)}
    expected = " or ".join(f"{len(kind.columns)} ({', '.join(kind.columns)})" for kind in KINDS)
    lines = read_lines(path)
    if not lines:
        raise TableError(f"{path}:1: no numbers; must be {FEWEST_ROWS} rows or more of {expected}")
    for number, text, _ in lines:
        # 0,5;1,2 would pass for three numbers or more.
        if re.search(r"\d,\d", text) and re.search(r"\d\s*;|\d\s+[-+.\d]", text):
            raise TableError(f"{path}:{number}: {text!r} has decimal commas; use decimal points")
    number, text, words = next((line for line in lines if any(map(is_number, line[2]))), lines[-1])
    header = names if names is not None else lines[0][1] if number > lines[0][0] else None
    place = "--columns" if names is not None else f"{path}:{lines[0][0]}"
    if header is not None and (quantities := recognised(header)) is not None:
        if not names_one_curve(quantities):
            raise TableError(f"{place}: {header!r} does not name the columns of a curve; must be {WAYS}")
        if len(quantities) != len(words):
            raise TableError(
                f"{path}:{number}: {text!r} is {len(words)} words; {header!r} names {len(quantities)}"
            )
        return quantities, _units(header, quantities)
    if names is not None or len(words) not in by_width:
        if names is not None:
            raise TableError(f"{place}: {names!r} is not known; must be {WAYS}")
        raise TableError(f"{path}:{number}: {text!r} is {len(words)} words; must be numbers, {expected}")
    if header is not None:
        _check_name(place, header, len(words))
    return by_width[len(words)], ("", "")


def _units(header: str, quantities: Sequence[str]) -> tuple[str, str]:
    """Return the units of the abscissa and of the moduli, "" where they have none or several."""
    matches = [_UNIT.search(name.strip().strip('"')) for name in separated(header)]
    written = [match[1].strip("[]()/ ") if match else "" for match in matches]
    units = {quantity.removeprefix("E "): unit for quantity, unit in zip(quantities, written, strict=True)}
    first = next(units[quantity] for quantity in ("omega", "frequency", "time") if quantity in units)
    first = "rad/s" if "frequency" in units and first == "Hz" else first
    moduli = {units[quantity] for quantity in ("storage", "loss", "relaxation") if quantity in units}
    return first, moduli.pop() if len(moduli) == 1 else ""


def _check_name(place: str, header: str, width: int) -> None:
    """Reject relaxation times, and a first column that does not fit the number of columns."""
    names = re.split(r"[,;\t]", header) if re.search(r"[,;\t]", header) else header.split()
    if any(map(is_relaxation_time, names)):
        raise TableError(
            f"{place}: {header!r} names the relaxation times of a Prony series, not a curve; write it "
            "as material: {model: prony, G0: ..., branches: [{G: ..., tau: ...}, ...]}"
        )
    name = names[0]
    kind = MasterCurve if width == 3 else RelaxationCurve
    quantity = quantity_named(name)
    if quantity == "frequency":
        raise TableError(f"{place}: {header!r} is not known with a frequency; must be {WAYS}")
    if quantity in {"time", "omega"} and (quantity == "omega") is not (kind is MasterCurve):
        raise TableError(
            f"{place}: the first column is {name.strip()!r}, but {width} columns make a {kind.name}; "
            f"must be {', '.join(kind.columns)}"
        )


KINDS: tuple[type[Measurement], ...] = (MasterCurve, RelaxationCurve)


def _parts(values: NDArray[np.complex128]) -> FloatArray:
    return np.concatenate([values.real, values.imag])


# Columns of measured data by their names: frequency in Hz, moduli in tension, tan delta.
#
#     omega = 2 pi f,      G = E/(2 (1 + nu)),      G'' = G' tan delta
#
# with a constant Poisson's ratio nu.

# Patterns of a name without its unit, in small letters.
_NAMES = {
    "omega": r"omega|w|ω|angular[ _]frequency",
    "frequency": r"f|nu|freq|frequency|hz",
    "time": r"t|time",
    "storage": r"([ge])('|′|_?prime|_?storage)|storage([ _]modulus)?",
    "loss": r"([ge])(''|\"|″|′′|_?(double|dbl)_?prime|_?loss)|loss([ _]modulus)?",
    "tan": r"tan[ _]?\(?(d|delta|δ)\)?|tand|loss[ _](factor|tangent)",
    "relaxation": r"([ge])(\(t\))?|modulus",
}
_UNIT = re.compile(r"\s*(\[[^\]]*\]|\((?!t\)|d\)|delta\)|δ\))[^)]*\)|/\s*(?!tan).*)\s*$")

MASTER, RELAXATION = ("omega", "storage", "loss"), ("time", "relaxation")
WAYS = "omega or f with two of G', G'', tan delta; or t, G; E for G in tension"


def recognised(header: str) -> tuple[str, ...] | None:
    """Return the quantities of the columns in a line of names, E before moduli in tension, or None."""
    quantities = [quantity_named(name) for name in separated(header)]
    return None if None in quantities else tuple(map(str, quantities))


def separated(header: str) -> list[str]:
    """Return the names in a line: commas, semicolons, tabs or several spaces separate them, or one space."""
    apart = re.search(r"[,;\t]|\S\s{2,}\S", header)
    return re.split(r"[,;\t]|\s{2,}", header) if apart else header.split()


def quantity_named(name: str) -> str | None:
    """Return the quantity of a column by its name, with E before a modulus in tension; None if not known."""
    plain = name.strip().strip('"') if name.strip().startswith('"') else name.strip()
    in_hertz = re.search(r"\bhz\b", plain.lower()) is not None
    plain = _UNIT.sub("", plain.lower()).strip()
    for found, pattern in _NAMES.items():
        if match := re.fullmatch(pattern, plain):
            tension = "E " if match.re.groups and match[1] == "e" else ""
            return tension + ("frequency" if in_hertz and found == "omega" else found)
    return None


def is_relaxation_time(name: str) -> bool:
    """Whether a column is named like the relaxation times of a series: tau, tau_k [s], τ."""
    plain = _UNIT.sub("", name.strip().strip('"').lower()).strip()
    return re.fullmatch(r"(tau|τ)([ _]?[ikn]|_relax)?|relaxation[ _]times?", plain) is not None


def symbols_of(quantities: Sequence[str]) -> tuple[str, ...]:
    """Return the symbols of the quantities for messages: omega, E', tan delta."""
    plain = {
        "frequency": "f",
        "time": "t",
        "storage": "G'",
        "loss": "G''",
        "tan": "tan delta",
        "relaxation": "G",
    }
    written = (plain.get(each.removeprefix("E "), each) for each in quantities)
    tension = (each.startswith("E ") for each in quantities)
    return tuple(
        text.replace("G", "E") if is_E else text for text, is_E in zip(written, tension, strict=True)
    )


def names_one_curve(quantities: Sequence[str]) -> bool:
    """Whether the columns make one master curve or relaxation curve."""
    plain = {each.removeprefix("E ") for each in quantities}
    master = len(plain & {"omega", "frequency"}) == 1 and len(plain & {"storage", "loss", "tan"}) == 2
    return len(quantities) == len(plain) and ((master and len(plain) == 3) or plain == {*RELAXATION})


def converted(quantities: Sequence[str], rows: FloatArray, poisson: float) -> FloatArray:
    """Return omega, G' and G'', shape (rows, 3), or t and G, shape (rows, 2), in shear."""
    known = {}
    for quantity, values in zip(quantities, rows.T, strict=True):
        tension = quantity.startswith("E ")
        known[quantity.removeprefix("E ")] = values / (2 * (1 + poisson)) if tension else values
    if "time" in known:
        return np.column_stack([known["time"], known["relaxation"]])
    if "frequency" in known:
        known["omega"] = 2 * math.pi * known["frequency"]
    if "storage" not in known:
        known["storage"] = known["loss"] / known["tan"]
    if "loss" not in known:
        known["loss"] = known["storage"] * known["tan"]
    return np.column_stack([known[quantity] for quantity in MASTER])
