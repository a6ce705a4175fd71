"""The recorder of a rank that does not write the case: it hands its rows of the snapshots to the first."""

from __future__ import annotations

from collections.abc import Iterable
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import Attribute
from gfmdlayer.grid.grid import Grid
from gfmdlayer.observables import Column
from gfmdlayer.results.case_template import rows_of_block


class PartWriter:
    """Stands in for `results.writer.CaseWriter`.

    Parameters
    ----------
    grid : Grid
        The grid over ranks.
    columns : iterable of Column
        Columns that rows may have.
    """

    elapsed = 0.0  # which the first rank counts

    def __init__(self, grid: Grid, columns: Iterable[Column]) -> None:
        self._grid, self.declared = grid, frozenset(column.name for column in columns)
        self.noted: dict[str, Attribute] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Do nothing."""

    def row(self, **values: float | NDArray[np.float64]) -> None:
        """Do nothing: the first rank has the same row."""

    def snapshot(self, _time: float, *fields: NDArray[np.float64] | None) -> None:
        """Hand on the fields."""
        for field in (each for each in fields if each is not None):
            for _ in self._grid.blocks(field, rows_of_block(self._grid.points)):
                pass

    def note(self, **attributes: Attribute) -> None:
        """Do nothing."""
