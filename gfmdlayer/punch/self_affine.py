"""The self-affine rough punch: its keys, and the order of its wavelengths."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from gfmdlayer.punch.shape import Cell, Shape
from gfmdlayer.validation.fields import MustBe, Optional, Positive, Seed, strict
from gfmdlayer.validation.problems import Problem

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.grid.grid import Grid

Hurst = Annotated[float, strict, Field(gt=0, le=1), MustBe("a number > 0 and <= 1")]


class SelfAffine(Shape):
    """Rough surface by random phases; cut-offs and roll-off are wavelengths.

    Attributes
    ----------
    roll_off, long_cutoff
        None where there is no plateau in the spectrum, or none but that of the period.
    rms_slope, rms_height
        One of them is given: <|grad h|^2>^(1/2) or <(h - <h>)^2>^(1/2).
    """

    rough: ClassVar[bool] = True

    shape: Literal["self_affine"] = "self_affine"
    """a rough surface of random phases"""
    hurst: Hurst
    """Hurst exponent H: the power falls as q^(-2 (H + 1))"""
    short_cutoff: Positive
    """shortest wavelength: length; longer than two grid spacings"""
    seed: Seed
    """of the phases: the same surface on any grid"""
    roll_off: Optional = None
    """wavelength above which the spectrum is flat: length; none without it"""
    long_cutoff: Optional = None
    """longest wavelength: length; the longest that fits without it"""
    rms_slope: Optional = None
    """root-mean-square slope; this or rms_height"""
    rms_height: Optional = None
    """root-mean-square height: length; this or rms_slope"""

    def heights(self, grid: Grid) -> FloatArray:
        """Heights of the surface above its lowest point, of the grid's shape."""
        from gfmdlayer.punch.random_surface import random_surface

        return random_surface(grid, **self.model_dump(exclude={"shape"}))

    def problems(self) -> Iterator[Problem]:
        """Refuse a surface of no size, or of two."""
        one_rms = "one of rms_slope and rms_height must be given"
        if self.rms_slope is None and self.rms_height is None:
            yield Problem(("rms_slope",), f"missing; {one_rms}", ("shape",))
        if self.rms_slope is not None and self.rms_height is not None:
            yield Problem(("rms_height",), f"given beside rms_slope; {one_rms}", ("rms_slope",))

    def misfits(self, cell: Cell) -> Iterator[Problem]:
        """Refuse waves that the grid does not resolve, that the cell does not hold, or in another order."""
        spacing = max(length / n for length, n in zip(cell.period, cell.points, strict=False))
        if self.short_cutoff <= 2 * spacing:
            message = f"got {self.short_cutoff!r}; must be > {2 * spacing!r}, two spacings of the grid"
            yield Problem(("short_cutoff",), message)
        below, shortest = "short_cutoff", self.short_cutoff
        for key, value in (("roll_off", self.roll_off), ("long_cutoff", self.long_cutoff)):
            if value is not None:
                if value < shortest:
                    message = f"got {value!r}, below {below} = {shortest!r}; must be a longer wave"
                    yield Problem((key,), message, (below,))
                below, shortest = key, value
        if shortest > max(cell.period):
            message = f"got {shortest!r}; must be <= the period, {max(cell.period)!r}"
            yield Problem((below,), message)
