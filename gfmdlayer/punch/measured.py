"""Punches whose heights come from a file: one for each grid point, or a measured surface."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, PrivateAttr, Tag

from gfmdlayer.punch.shape import Cell, Shape
from gfmdlayer.validation.fields import (
    File,
    Fraction,
    MustBe,
    Positive,
    Switch,
    Word,
    given,
    sequence,
    strict,
)
from gfmdlayer.validation.problems import Mistake
from gfmdlayer.validation.reading import Reading, answers
from gfmdlayer.validation.units import LENGTHS, UnitOf

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.grid.grid import Grid
    from gfmdlayer.punch.scan import Keys

Name = Annotated[str, Field(strict=True, min_length=1), MustBe("the name of a dataset")]


_examples = "m, mm, um, nm or in"
_number_or_word = Discriminator(lambda value: "word" if isinstance(value, str) else "number")
_unit = MustBe(f"a number > 0, or a unit of length, such as {_examples}")
_hole = MustBe("a number, or none", any_size=True)
_UnitOfFile = Annotated[
    Annotated[float, strict, Field(gt=0), _unit, Tag("number")]
    | Annotated[str, UnitOf("length", LENGTHS, _examples), Tag("word")],
    _number_or_word,
]
_Hole = Annotated[
    Annotated[float, strict, _hole, Tag("number")] | Annotated[Literal["none"], _hole, Tag("word")],
    _number_or_word,
]


class FromFile(Shape):
    """A shape whose heights come from a file, in the unit of length of the configuration."""

    file: File
    """file of heights"""
    reading: Annotated[Reading | None, given] = None
    """how a text is read, where it does not say so"""
    hole: Annotated[_Hole | None, given] = None
    """number that stands for a point without a height, or none"""

    _length: str | None = PrivateAttr(default=None)  # unit of length of the configuration, where it has units

    def with_length(self, length: str | None) -> Shape:
        """Return the shape that converts lengths of its file into a unit."""
        shape = self.model_copy()
        shape._length = length
        return shape

    @property
    def _keys(self) -> Keys:
        from gfmdlayer.punch.scan import Keys

        return Keys(answers=answers(self.reading), hole=self.hole)


class Profile(FromFile):
    """Heights read from a file, one for each grid point."""

    shape: Literal["profile"] = "profile"
    """heights from a file, one for each grid point"""
    file: File
    """.npy, or text with columns x and height"""
    touches_first: Annotated[Annotated[str, Word("lowest", "highest")] | None, given] = None
    """lowest (default): heights count upward; highest: outward, as arrays in Python"""

    def heights(self, grid: Grid) -> FloatArray:
        """Heights above the lowest; TableError unless the file holds a finite one for each grid point."""
        return self._read(grid)[0]

    def account(self, cell: Cell) -> str:
        """Say how the file was read; TableError if it cannot be used."""
        from gfmdlayer.grid.grid import Grid

        return self._read(Grid(*cell))[1]

    def _read(self, grid: Grid) -> tuple[FloatArray, str]:
        from gfmdlayer.punch.topography import read_profile

        outward = self.touches_first == "highest"
        return read_profile(self.file, grid, self._keys, self._length, outward=outward)

    @property
    def whole_only(self) -> str:
        """A file in text."""
        return "" if self.file.suffix == ".npy" else f"file: got {self.file.suffix or 'no ending'}, not .npy"


class Topography(FromFile):
    """A measured surface, whose summits touch first, and the steps that make it periodic.

    Examples
    --------
    >>> np.save("surface.npy", np.random.default_rng(1).normal(size=(32, 32)))
    >>> rough = gfmdlayer.Topography(file="surface.npy", size=10.0, taper=0.1, detrend="plane")
    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), rough, mean_pressure=[0.01, 0.02])
    >>> dict(found.contact_area.sizes), float(found.x[1] - found.x[0])
    ({'mean_pressure': 2}, 0.3125)
    """

    rough: ClassVar[bool] = True

    shape: Literal["topography"] = "topography"
    """a measured surface; its summits touch first"""
    file: File
    """.npy, HDF5, netCDF, text, or an instrument's format"""
    dataset: Annotated[Name | None, given] = None
    """where the file holds several"""
    unit: Annotated[_UnitOfFile | None, given] = None
    """unit, where the file says none, of heights and of lengths in the file: a name, or a number: length"""
    size: Annotated[Annotated[tuple[Positive, ...], BeforeValidator(sequence)] | None, given] = None
    """lengths [Lx, Ly] of the scan, if the file does not say them: length"""
    transpose: Switch = False
    """exchange x and y of the file"""
    fill: Annotated[str, Word("none", "membrane")] = "none"
    """membrane: points without a height are filled in from around them"""
    detrend: Annotated[str, Word("none", "plane", "paraboloid")] = "none"
    """plane or paraboloid: of least squares, subtracted"""
    taper: Fraction = 0.0
    """part of the period over which heights fade out to their mean"""
    resample: Annotated[str, Word("none", "fourier")] = "none"
    """fourier: to the points of the grid"""

    def misfits(self, cell: Cell) -> Iterator[Mistake]:
        """Yield keys that a line does not have, and as many lengths as there are no directions."""
        axes = len(cell.points)
        if self.size is not None and len(self.size) not in {1, axes}:
            wanted = f"one number, or one for each of the {axes} directions" if axes > 1 else "one number"
            yield Mistake(("size",), f"got {len(self.size)} numbers; must be {wanted}")
        if self.transpose and axes == 1:
            yield Mistake(("transpose",), "got true, but a line has one direction; must be false")

    def heights(self, grid: Grid) -> FloatArray:
        """Depths below the highest summit, of the grid's shape; TableError if the file cannot be used."""
        return self._made_periodic(grid)[0]

    def notes(self, cell: Cell) -> list[str]:
        """Describe each change made to the measured heights; TableError if the file cannot be used."""
        from gfmdlayer.grid.grid import Grid

        return self._made_periodic(Grid(*cell))[1]

    def account(self, cell: Cell) -> str:
        """Say how the file was read; TableError if it cannot be used."""
        from gfmdlayer.grid.grid import Grid

        return self._made_periodic(Grid(*cell))[2]

    @property
    def whole_only(self) -> str:
        """A step that concerns distant points, or a file that is not read in parts."""
        from gfmdlayer.punch.scan_files import IN_PARTS

        if self.file.suffix.lower() not in IN_PARTS:
            return f"file: got {self.file.suffix or 'no ending'}, not {', '.join(IN_PARTS)}"
        if self.transpose:
            return "transpose: true"
        steps = {"fill": self.fill, "resample": self.resample}
        return next((f"{key}: {word}" for key, word in steps.items() if word != "none"), "")

    @property
    def _keys(self) -> Keys:
        keys = {name: getattr(self, name) for name in ("unit", "size", "transpose", "dataset")}
        return super()._keys._replace(**keys)

    def _made_periodic(self, grid: Grid) -> tuple[FloatArray, list[str], str]:
        from gfmdlayer.grid.grid import Grid as Whole
        from gfmdlayer.punch import topography
        from gfmdlayer.punch.scan import on_grid
        from gfmdlayer.punch.scan_files import read_scan

        scan = read_scan(self.file, len(grid.shape), self._keys, grid)
        measured = on_grid(scan, self._keys, grid, self._length, gaps=self.fill != "none")
        heights, filled = topography.filled(self.file, measured.heights, self.fill)
        surface = grid if heights.shape == grid.shape else Whole(heights.shape, grid.period)
        heights, detrended = topography.detrended(heights, self.detrend, surface)
        heights, tapered = topography.tapered(heights, self.taper, surface)
        seams = []
        if grid.is_whole:
            seams = [topography.seam(heights, axis, bool(self.taper)) for axis in range(heights.ndim)]
        heights, resampled = topography.resampled(self.file, heights, grid.shape, self.resample)
        notes = (filled, detrended, tapered, *seams, resampled)
        highest = grid.ranks.maximum(float(heights.max()))
        return highest - heights, [f"{self.file}: {note}" for note in notes if note], measured.account
