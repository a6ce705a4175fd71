"""Units of a configuration: labels of files and plots; no number is converted.

Quantities are declared in words, such as "length", "pressure length" or "force"; with units the words become
labels, which netCDF's udunits reads too: a force of Pa over m^2 is in N, one of MPa over mm^2 likewise.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Annotated

from gfmdlayer.validation.fields import MustBe, Word
from gfmdlayer.validation.sections import Section

_PREFIXES = {"a": -18, "f": -15, "p": -12, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "": 0, "k": 3, "M": 6,
             "G": 9, "T": 12}  # fmt: skip


def _metric(unit: str, prefixes: Iterable[str] = _PREFIXES) -> dict[str, int]:
    return {prefix + unit: _PREFIXES[prefix] for prefix in prefixes}


# Names and sizes as powers of ten of the SI unit; None where the size is no power of ten.
_LENGTHS: dict[str, int | None] = {
    **_metric("m", ("f", "p", "n", "u", "µ", "μ", "m", "", "k")),
    "cm": -2, "angstrom": -10, "in": None, "ft": None,
}  # fmt: skip
_STRESSES: dict[str, int | None] = {
    **_metric("Pa", ("u", "µ", "μ", "m", "", "k", "M", "G", "T")),
    "hPa": 2, "N/m^2": 0, "N/mm^2": 6, "bar": 5, "atm": None, "psi": None, "ksi": None,
}  # fmt: skip
_PERMITTIVITY = 8.8541878128  # of vacuum in 1e-12 F/m, CODATA 2018
_TIMES: dict[str, int | None] = {
    **_metric("s", ("f", "p", "n", "u", "µ", "μ", "m", "", "k")),
    "min": None, "h": None, "d": None, "yr": None,
}  # fmt: skip


class _UnitOf(Word):
    """Annotation of a field that takes the name of a unit."""

    def __init__(self, quantity: str, names: Mapping[str, int | None], examples: str) -> None:
        MustBe.__init__(self, f"a unit of {quantity}, such as {examples}", tuple(names))


class Units(Section):
    """Units of length, stress and time in which the numbers of a configuration are."""

    length: Annotated[str, _UnitOf("length", _LENGTHS, "m, mm, um, nm or in")]
    """of lengths: m, mm, um, ..."""
    stress: Annotated[str, _UnitOf("stress", _STRESSES, "Pa, kPa, MPa, N/mm^2 or psi")]
    """of moduli and pressures: Pa, MPa, ..."""
    time: Annotated[str, _UnitOf("time", _TIMES, "s, ms, min or h")]
    """of times: s, ms, ..."""

    def label(self, words: str) -> str:
        """Write the unit of a quantity whose dimension is declared in words: "pressure", "length / time"."""
        names = {"length": self.length, "pressure": self.stress, "time": self.time}
        stress, length = _STRESSES[self.stress], _LENGTHS[self.length]
        # Stress times length squared is newtons with a prefix, where one has its size.
        power = None if stress is None or length is None else stress + 2 * length
        if newtons := next((f"{prefix}N" for prefix, size in _PREFIXES.items() if size == power), ""):
            words = words.replace("pressure length", "force / length").replace("force", newtons)
        else:
            words = words.replace("force / length", "pressure length").replace("force", "pressure length^2")
        return re.sub("length|pressure|time", lambda word: names[word[0]], words).replace(" / ", "/")

    def __str__(self) -> str:
        return f"length: {self.length}, stress: {self.stress}, time: {self.time}"

    @property
    def permittivity_of_vacuum(self) -> float | None:
        """Permittivity of vacuum, stress length^2/V^2; None where a unit is no power of ten of SI."""
        stress, length = _STRESSES[self.stress], _LENGTHS[self.length]
        if stress is None or length is None:
            return None
        return float(f"{_PERMITTIVITY}e{-12 - stress - 2 * length}")
