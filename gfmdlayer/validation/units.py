"""Units of a configuration: labels of files and plots; numbers with units are converted into them.

Quantities are declared in words, such as "length", "pressure length" or "force"; with units the words become
labels, which netCDF's udunits reads too: a force of Pa over m^2 is in N, one of MPa over mm^2 likewise.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from functools import cached_property
from typing import Annotated, Any

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from gfmdlayer.files.units import PREFIXES, Unit, unit_of
from gfmdlayer.validation.fields import MustBe, Word
from gfmdlayer.validation.sections import Section

LENGTHS = "fm", "pm", "nm", "um", "µm", "μm", "mm", "m", "km", "cm", "angstrom", "in", "ft"
_STRESSES = (
    "uPa", "µPa", "μPa", "mPa", "Pa", "kPa", "MPa", "GPa", "TPa", "hPa", "N/m^2", "N/mm^2", "bar", "atm",
    "psi", "ksi"
)  # fmt: skip
_TIMES = "fs", "ps", "ns", "us", "µs", "μs", "ms", "s", "ks", "min", "h", "d", "yr"
_PERMITTIVITY = Fraction("8.8541878128e-12")  # of vacuum in F/m, CODATA 2018


class UnitOf(Word):
    """Annotation of a field that takes the name of a unit."""

    def __init__(self, quantity: str, names: tuple[str, ...], examples: str) -> None:
        MustBe.__init__(self, f"a unit of {quantity}, such as {examples}", names)


class Units(Section):
    """Units of length, stress and time in which the numbers of a configuration are."""

    length: Annotated[str, UnitOf("length", LENGTHS, "m, mm, um, nm or in")]
    """of lengths: m, mm, um, ..."""
    stress: Annotated[str, UnitOf("stress", _STRESSES, "Pa, kPa, MPa, N/mm^2 or psi")]
    """of moduli and pressures: Pa, MPa, ..."""
    time: Annotated[str, UnitOf("time", _TIMES, "s, ms, min or h")]
    """of times: s, ms, ..."""

    def label(self, words: str) -> str:
        """Write the unit of a quantity whose dimension is declared in words: "pressure", "length / time"."""
        names = self._names
        words = words.replace("pressure length^2", "force")
        # Stress times length squared is newtons with a prefix, where one has its size.
        sizes = ((prefix, Fraction(10) ** power) for prefix, power in PREFIXES.items() if power % 3 == 0)
        if newtons := next((f"{prefix}N" for prefix, size in sizes if size == self._force), ""):
            words = words.replace("pressure length", "force / length").replace("force", newtons)
        else:
            words = words.replace("force / length", "pressure length").replace("force", "pressure length^2")
        return re.sub("length|pressure|time", lambda word: names[word[0]], words).replace(" / ", "/")

    def unit(self, words: str) -> Unit:
        """Return the unit of a quantity whose dimension is declared in words."""
        words = words.replace("force", "pressure length^2").replace(" / ", "/").replace(" ", ".")
        found = unit_of(re.sub("length|pressure|time", lambda word: f"({self._names[word[0]]})", words))
        assert found is not None, words
        return found

    @property
    def _names(self) -> dict[str, str]:
        return {"length": self.length, "pressure": self.stress, "time": self.time}

    def __str__(self) -> str:
        return f"length: {self.length}, stress: {self.stress}, time: {self.time}"

    @property
    def _force(self) -> Fraction:
        """Stress times length squared, in newtons."""
        length, stress = unit_of(self.length), unit_of(self.stress)
        assert length is not None and stress is not None  # noqa: PT018
        return stress.size * length.size**2

    @property
    def permittivity_of_vacuum(self) -> float:
        """Permittivity of vacuum, stress length^2/V^2."""
        return float(_PERMITTIVITY / self._force)


def label_of(units: Units | None, words: str) -> str | None:
    """Return the label of a unit from its dimension in words; None where the configuration has no units."""
    return None if units is None else units.label(words)


_OF_UNITS = re.compile("length|pressure|time|force")


class OwnUnits:
    """What numbers with units mean beside the key `units`, in plain data."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        self._data = data

    @cached_property
    def _units(self) -> Units | None:
        try:
            return Units.model_validate(self._data.get("units"))
        except ValidationError:  # reported at its own place, and the numbers with units are not
            return None

    def unit(self, dimension: str) -> tuple[Unit, str, str] | None:
        """Return the unit, the label and the words of a dimension; voltages, angles, ... need no `units`."""
        if not _OF_UNITS.search(dimension):
            found = unit_of(dimension)
            return None if found is None else (found, dimension, dimension)
        own = self._units
        return None if own is None else (own.unit(dimension), own.label(dimension), dimension)

    def moment(self, word: str) -> float:
        """Refuse a word: there is no run."""
        raise PydanticCustomError("moment", f"got {word!r}; must be a number")
