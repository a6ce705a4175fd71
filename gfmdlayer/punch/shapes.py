"""The shapes of the punch that a configuration may name, and copies of one side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BeforeValidator

from gfmdlayer.punch.shape import Analytic, Cell, Shape
from gfmdlayer.validation.fields import Count, sequence
from gfmdlayer.validation.problems import Mistake
from gfmdlayer.validation.sections import OneOf, load_table

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.grid.grid import Grid

# Functions of the coordinates (`Analytic`) of which an array may hold copies. The first is the default.
ELEMENTS: Mapping[str, type[Analytic]] = load_table(
    "gfmdlayer.punch.simple_shapes:Parabola",
    "gfmdlayer.punch.simple_shapes:Sphere",
    "gfmdlayer.punch.simple_shapes:Cylinder",
    "gfmdlayer.punch.simple_shapes:Cone",
    "gfmdlayer.punch.simple_shapes:Wedge",
    "gfmdlayer.punch.simple_shapes:Pyramid",
    "gfmdlayer.punch.simple_shapes:Flat",
    "gfmdlayer.punch.simple_shapes:BluntedCone",
)


class Array(Shape):
    """`counts` copies of a shape along each direction, as many as fill the period."""

    shape: Literal["array"] = "array"
    """copies of another shape side by side"""
    element: Annotated[Analytic, OneOf(ELEMENTS)]
    """a mapping with the keys of a shape"""
    counts: Annotated[tuple[Count, ...], BeforeValidator(sequence)]
    """number of copies, or [nx, ny]"""

    def heights(self, grid: Grid) -> FloatArray:
        """Heights of the copies, of the grid's shape."""
        return self.element.heights(grid, self.counts)

    def misfits(self, cell: Cell) -> Iterator[Mistake]:
        """Yield why one copy does not fit into its part of the cell."""
        axes = len(cell.points)
        if len(self.counts) in {1, axes}:
            counts = self.counts * (axes // len(self.counts))
            yield from (mistake.within(("element",)) for mistake in self.element.misfits(cell, counts))
        else:
            wanted = f"one number, or one for each of the {axes} directions" if axes > 1 else "one number"
            yield Mistake(("counts",), f"got {len(self.counts)} numbers; must be {wanted}")


SHAPES: Mapping[str, type[Shape]] = {
    **ELEMENTS,
    "array": Array,
    **load_table(
        "gfmdlayer.punch.simple_shapes:Sinusoid",
        "gfmdlayer.punch.self_affine:SelfAffine",
        "gfmdlayer.punch.measured:Profile",
        "gfmdlayer.punch.measured:Topography",
        "gfmdlayer.punch.simple_shapes:FlatPunch",
        "gfmdlayer.punch.simple_shapes:RadialProfile",
    ),
}
