"""Punches whose heights come from a file: one for each grid point, or a measured surface."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from gfmdlayer.punch.shape import Cell, Shape
from gfmdlayer.validation.fields import File, Fraction, MustBe, Positive, Word, given

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.grid.grid import Grid

Name = Annotated[str, Field(strict=True, min_length=1), MustBe("the name of a dataset")]


class Profile(Shape):
    """Heights read from a file, one for each grid point."""

    shape: Literal["profile"] = "profile"
    """heights from a file, one for each grid point"""
    file: File
    """.npy, or text with columns x and height"""
    touches_first: Annotated[Annotated[str, Word("lowest", "highest")] | None, given] = None
    """lowest (default): heights count upward; highest: outward, as arrays in Python"""

    def heights(self, grid: Grid) -> FloatArray:
        """Heights above the lowest; TableError unless the file holds a finite one for each grid point."""
        from gfmdlayer.punch.topography import read_profile

        return read_profile(self.file, grid, outward=self.touches_first == "highest")

    @property
    def whole_only(self) -> str:
        """A file in text."""
        return "" if self.file.suffix == ".npy" else f"file: got {self.file.suffix or 'no ending'}, not .npy"


class Topography(Shape):
    """A measured surface, whose summits touch first, and the steps that make it periodic."""

    rough: ClassVar[bool] = True

    shape: Literal["topography"] = "topography"
    """a measured surface; its summits touch first"""
    file: File
    """.npy; .txt, .dat, .csv; .h5, .hdf5, .nc; or an instrument's format"""
    dataset: Annotated[Name | None, given] = None
    """where the file holds several"""
    unit: Positive = 1.0
    """the file's unit of length: length"""
    fill: Annotated[str, Word("none", "membrane")] = "none"
    """membrane: points without a height are filled in from around them"""
    detrend: Annotated[str, Word("none", "plane", "paraboloid")] = "none"
    """plane or paraboloid: of least squares, subtracted"""
    taper: Fraction = 0.0
    """part of the period over which heights fade out to their mean"""
    resample: Annotated[str, Word("none", "fourier")] = "none"
    """fourier: to the points of the grid"""

    def heights(self, grid: Grid) -> FloatArray:
        """Depths below the highest summit, of the grid's shape; TableError if the file cannot be used."""
        return self._made_periodic(grid)[0]

    def notes(self, cell: Cell) -> list[str]:
        """Describe each change made to the measured heights; TableError if the file cannot be used."""
        from gfmdlayer.grid.grid import Grid

        return self._made_periodic(Grid(*cell))[1]

    @property
    def whole_only(self) -> str:
        """A step that concerns distant points, or a file that is not read in parts."""
        from gfmdlayer.punch.topography import IN_PARTS

        if self.file.suffix.lower() not in IN_PARTS:
            return f"file: got {self.file.suffix or 'no ending'}, not {', '.join(IN_PARTS)}"
        steps = {"fill": self.fill, "resample": self.resample}
        return next((f"{key}: {word}" for key, word in steps.items() if word != "none"), "")

    def _made_periodic(self, grid: Grid) -> tuple[FloatArray, list[str]]:
        from gfmdlayer.grid.grid import Grid as Whole
        from gfmdlayer.punch import topography
        from gfmdlayer.punch.topography import read_heights

        measured = read_heights(self.file, len(grid.shape), self.dataset, grid)
        topography.check_lengths(self.file, measured.lengths, self.unit, grid.period)
        heights, filled = topography.filled(self.file, self.unit * measured.values, self.fill)
        surface = grid if heights.shape == grid.shape else Whole(heights.shape, grid.period)
        heights, detrended = topography.detrended(heights, self.detrend, surface)
        heights, tapered = topography.tapered(heights, self.taper, surface)
        seams = []
        if grid.is_whole:
            seams = [topography.seam(heights, axis, bool(self.taper)) for axis in range(heights.ndim)]
        heights, resampled = topography.resampled(self.file, heights, grid.shape, self.resample)
        notes = (filled, detrended, tapered, *seams, resampled)
        highest = grid.ranks.maximum(float(heights.max()))
        return highest - heights, [f"{self.file}: {note}" for note in notes if note]
