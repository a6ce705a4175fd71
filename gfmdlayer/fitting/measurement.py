"""Measured curves, and the response of a Maxwell branch at the measured frequencies or times.

A master curve is the storage and loss modulus G' + i G'' = G(omega) over angular frequency, a relaxation
curve G(t) the stress after a unit step of strain, over two. A branch of unit modulus and relaxation time tau
adds, Eqs. (4) and (5) of Petrenko et al., Materials Physics and Mechanics 52 (2024) 60-68,

    i omega tau/(1 + i omega tau)     to the one, and     exp(-t/tau)     to the other.
"""

from __future__ import annotations

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
from gfmdlayer.fitting import columns

FEWEST_ROWS = 8  # enough to choose between one branch and two with numbers left over


class FitError(ValueError):
    """A fit is not possible; the message says why, and what is allowed."""


@dataclass(frozen=True)
class Measurement(ABC):
    """A measured curve; responses are flat, one modulus after the other.

    Parameters
    ----------
    source : str
        Name of the file.
    abscissa : ndarray, shape (rows,)
        Angular frequencies or times, positive.
    moduli : ndarray, shape (moduli, rows)
        Measured moduli, positive.
    """

    source: str
    abscissa: FloatArray
    moduli: FloatArray

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
        """The curve of a material whose relaxation times are all longer by a factor."""
        return replace(self, abscissa=self.abscissa * factor**self.power)

    def in_units_of(self, modulus: float) -> Self:
        """The same curve with its moduli divided by one."""
        return replace(self, moduli=self.moduli / modulus)


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
    """Read a measured curve: a master curve from three columns, a relaxation curve from two.

    Columns are separated by commas, semicolons or white space, `#` begins a comment, and the first line may
    name the columns; without names they are omega, G' and G'', or t and G.

    Parameters
    ----------
    path : Path
        A file in increasing order of the frequency or time, with columns as `columns` names them.
    poisson : float
        Poisson's ratio, where moduli are those of tension.
    names : str, optional
        Names of the columns, in place of those in the file.

    Returns
    -------
    MasterCurve or RelaxationCurve

    Raises
    ------
    TableError
        Names file and line: another number of columns, or names of other quantities; fewer than
        `FEWEST_ROWS` rows; a number that is not finite or not positive; frequencies or times that do not
        increase.
    """
    quantities = _quantities(path, names)
    symbols = columns.symbols(quantities)

    def row_error(row: Sequence[float]) -> str | None:
        wrong = (f"{name} = {value:g}" for name, value in zip(symbols, row, strict=True) if value <= 0)
        found = ", ".join(wrong)
        return found and f"{found}; must be > 0"

    increasing = quantities[0] in {"omega", "frequency", "time"}
    rows = read_columns(path, symbols, increasing=increasing, at_least=FEWEST_ROWS, row_error=row_error)
    abscissa, *moduli = columns.converted(quantities, rows, poisson).T
    if not (np.diff(abscissa) > 0).all():
        raise TableError(f"{path}: frequencies or times do not increase from row to row; they must")
    kind = MasterCurve if len(moduli) == 2 else RelaxationCurve
    return kind(path.name, abscissa, np.array(moduli))


def _quantities(path: Path, names: str | None) -> tuple[str, ...]:
    """Find the quantities of the columns, by their names or their number."""
    by_width = {len(each): each for each in (columns.MASTER, columns.RELAXATION)}
    expected = " or ".join(f"{len(kind.columns)} ({', '.join(kind.columns)})" for kind in KINDS)
    lines = read_lines(path)
    if not lines:
        raise TableError(f"{path}:1: holds no numbers; must be {FEWEST_ROWS} rows or more of {expected}")
    for number, text, _ in lines:
        # 0,5;1,2 would pass for three numbers or more.
        if re.search(r"\d,\d", text) and re.search(r"\d\s*;|\d\s+[-+.\d]", text):
            raise TableError(f"{path}:{number}: {text!r} has decimal commas; must be decimal points")
    number, text, words = next((line for line in lines if any(map(is_number, line[2]))), lines[-1])
    header = names if names is not None else lines[0][1] if number > lines[0][0] else None
    place = "--columns" if names is not None else f"{path}:{lines[0][0]}"
    if header is not None and (found := columns.recognised(header)) is not None:
        if not columns.names_one_curve(found):
            raise TableError(f"{place}: {header!r} is no curve; must be {columns.WAYS}")
        if len(found) != len(words):
            raise TableError(
                f"{path}:{number}: {text!r} is {len(words)} words; {header!r} names {len(found)}"
            )
        return found
    if names is not None or len(words) not in by_width:
        if names is not None:
            raise TableError(f"{place}: {names!r} is not understood; must be {columns.WAYS}")
        raise TableError(f"{path}:{number}: {text!r} is {len(words)} words; must be numbers, {expected}")
    if header is not None:
        _check_name(place, header, len(words))
    return by_width[len(words)]


def _check_name(place: str, header: str, width: int) -> None:
    """Refuse relaxation times, and a first column of another quantity than the number of columns says."""
    names = re.split(r"[,;\t]", header) if re.search(r"[,;\t]", header) else header.split()
    if any(map(columns.is_relaxation_time, names)):
        raise TableError(
            f"{place}: {header!r} names the relaxation times of a Prony series, which is no curve; write it "
            "as material: {model: prony, G0: ..., branches: [{G: ..., tau: ...}, ...]}"
        )
    name = names[0]
    kind = MasterCurve if width == 3 else RelaxationCurve
    quantity = columns.quantity(name)
    if quantity == "frequency":
        raise TableError(f"{place}: {header!r} is not understood beside a frequency; must be {columns.WAYS}")
    if quantity in {"time", "omega"} and (quantity == "omega") is not (kind is MasterCurve):
        raise TableError(
            f"{place}: the first column is {name.strip()!r}, but {width} columns make a {kind.name}; "
            f"must be {', '.join(kind.columns)}"
        )


KINDS: tuple[type[Measurement], ...] = (MasterCurve, RelaxationCurve)


def _parts(values: NDArray[np.complex128]) -> FloatArray:
    return np.concatenate([values.real, values.imag])
