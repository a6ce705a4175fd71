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
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.materials import Material
from gfmdlayer.files.tables import TableError, is_number, read_columns, read_lines

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
    def predicted(self, material: Material, abscissa: FloatArray) -> FloatArray:
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

    def predicted(self, material: Material, abscissa: FloatArray) -> FloatArray:
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

    def predicted(self, material: Material, abscissa: FloatArray) -> FloatArray:
        """Relaxation modulus of a material, in a first dimension of one."""
        return material.relaxation_modulus(abscissa)[np.newaxis]


def read(path: Path) -> Measurement:
    """Read a measured curve: a master curve from three columns, a relaxation curve from two.

    Columns are separated by commas, semicolons or white space, `#` begins a comment, and the first line may
    name the columns.

    Parameters
    ----------
    path : Path
        A file with omega, G' and G'', or with t and G, in increasing order of the first.

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
    kind = _kind(path)

    def row_error(row: Sequence[float]) -> str | None:
        wrong = (f"{name} = {value:g}" for name, value in zip(kind.columns, row, strict=True) if value <= 0)
        found = ", ".join(wrong)
        return found and f"{found}; must be > 0"

    rows = read_columns(path, kind.columns, increasing=True, at_least=FEWEST_ROWS, row_error=row_error)
    abscissa, *moduli = rows.T
    return kind(path.name, abscissa, np.array(moduli))


def _kind(path: Path) -> type[Measurement]:
    """Find the kind of curve from the number of columns; their names, if given, must agree."""
    by_width: dict[int, type[Measurement]] = {
        len(kind.columns): kind for kind in (MasterCurve, RelaxationCurve)
    }
    expected = " or ".join(f"{width} ({', '.join(kind.columns)})" for width, kind in by_width.items())
    lines = read_lines(path)
    if not lines:
        raise TableError(f"{path}:1: holds no numbers; must be {FEWEST_ROWS} rows or more of {expected}")
    for number, text, _ in lines:
        # 0,5;1,2 would pass for three numbers or more.
        if re.search(r"\d,\d", text) and re.search(r"\d\s*;|\d\s+[-+.\d]", text):
            raise TableError(f"{path}:{number}: {text!r} has decimal commas; must be decimal points")
    number, text, words = next((line for line in lines if any(map(is_number, line[2]))), lines[-1])
    if len(words) not in by_width:
        raise TableError(f"{path}:{number}: {text!r} is {len(words)} words; must be numbers, {expected}")
    kind = by_width[len(words)]
    if number > lines[0][0]:
        _check_name(f"{path}:{lines[0][0]}", lines[0][1], kind)
    return kind


def _check_name(place: str, header: str, kind: type[Measurement]) -> None:
    """Refuse a first column whose name is that of another quantity."""
    name = re.split(r"[,;\t]", header)[0] if re.search(r"[,;\t]", header) else header.split()[0]
    symbol = re.split(r"[\s(\[/]", name.strip())[0].lower().strip("\"'")
    if symbol in {"f", "nu", "freq", "frequency"} or re.search(r"\bHz\b", name):
        raise TableError(
            f"{place}: the first column is {name.strip()!r}; must be the angular frequency omega = 2 pi f"
        )
    named = {"t": RelaxationCurve, "time": RelaxationCurve, "omega": MasterCurve, "w": MasterCurve}
    if named.get(symbol, kind) is not kind:
        raise TableError(
            f"{place}: the first column is {name.strip()!r}, but {len(kind.columns)} columns make a "
            f"{kind.name}; must be {', '.join(kind.columns)}"
        )


def _parts(values: NDArray[np.complex128]) -> FloatArray:
    return np.concatenate([values.real, values.imag])
