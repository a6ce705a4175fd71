"""The files in which each rank keeps its share of an unfinished case.

    NNNN.checkpoint        the share of the first rank, or of the only one
    NNNN.checkpoint3a      that of rank 3; the next one is 3b, then 3a again
    NNNN.journal3          the snapshots of rank 3

A checkpoint counts when that of the first rank has its name: it says whether those of the others are `a` or
`b`. Up to then those of the checkpoint before are left alone.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import Attribute
from gfmdlayer.execution.folder import Folder
from gfmdlayer.grid.grid import Grid
from gfmdlayer.observables import Column
from gfmdlayer.results.writer import rows_of_block

if TYPE_CHECKING:
    from gfmdlayer.grid.ranks import Ranks


class Share:
    """Files of a rank.

    Parameters
    ----------
    folder : Folder
        A claimed results folder.
    index : int
        The case.
    ranks : Ranks
        The processes that compute it.
    """

    def __init__(self, folder: Folder, index: int, ranks: Ranks) -> None:
        self._folder, self._index, self._ranks, self._slot = folder, index, ranks, "b"

    @property
    def first(self) -> bool:
        """Whether this is the rank that writes the case."""
        return self._ranks.first

    @property
    def made_by(self) -> dict[str, str]:
        """Return what the bits of the share depend on: the rank, where there are several."""
        number, count = self._ranks.number, self._ranks.count
        return {} if count == 1 else {"rank": str(number), "ranks": str(count)}

    @property
    def about(self) -> dict[str, str]:
        """Plain data of the first rank's next checkpoint."""
        return {} if self._ranks.count == 1 else {"slot": self._next}

    @property
    def journal(self) -> Path:
        """The journal of this rank."""
        return self._folder.case(self._index, f"journal{self._ranks.number}")

    def remove(self) -> None:
        """Remove all files of this rank."""
        for path in self._files:
            path.unlink(missing_ok=True)

    def set_aside(self) -> None:
        """Rename all files of this rank, which are left to the user."""
        for path in self._files:
            self._folder.set_aside(path)

    @property
    def _files(self) -> list[Path]:
        return [self._checkpoint("a"), self._checkpoint("b"), self.journal]

    def found(self, about: Mapping[str, Any] | None) -> Path | None:
        """Return the checkpoint of this rank that belongs to the one that the first rank has found."""
        slot = self._ranks.shared(about and about.get("slot", "a"))
        self._slot = slot or "b"
        return None if slot is None else self._checkpoint(slot)

    def write(self, save: Callable[[Path], None]) -> str:
        """Write the checkpoints of all ranks, that of the first last, which makes those of the others count.

        Parameters
        ----------
        save : callable
            Writes that of this rank into a file.

        Returns
        -------
        str
            Why a rank could not write its own; empty where all are written.
        """
        failure = self._attempt(save, not self.first) or self._attempt(save, self.first)
        self._slot = self._slot if failure else self._next
        return failure

    def _attempt(self, save: Callable[[Path], None], own_turn: bool) -> str:
        failure = ""
        try:
            if own_turn:
                save(self._checkpoint(self._next))
        except OSError as error:
            failure = error.strerror or str(error)
        return self.agreed(failure)

    def any_of(self, *decisions: bool) -> tuple[bool, ...]:
        """Return for each decision whether any rank takes it."""
        return tuple(map(any, zip(*self._ranks.all_of(decisions), strict=True)))

    def agreed(self, failure: str) -> str:
        """Return the first failure of a rank; empty where there is none."""
        return next(filter(None, self._ranks.all_of(failure)), "")

    @property
    def _next(self) -> str:
        return "a" if self._slot == "b" else "b"

    def _checkpoint(self, slot: str) -> Path:
        own = "" if self.first else f"{self._ranks.number}{slot}"
        return self._folder.case(self._index, f"checkpoint{own}")


# Ranks of a case fail together: an error of one of them ends the case on all.

PATIENCE = 8.0  # seconds in which the other ranks come to the same error, or to the end
_POLL = 0.002  # seconds between two looks


class RankError(RuntimeError):
    """Another rank of the case failed; the message says how."""


@contextmanager
def ending_together(ranks: Ranks) -> Iterator[None]:
    """End a block on all ranks, or raise on all of them.

    Most errors are found by all ranks alike. One that a single rank meets, such as a lack of memory, leaves
    the others waiting for it: then the job is aborted, and the next run resumes from the last checkpoint.
    """
    error: Exception | None = None
    try:
        yield
    except Exception as caught:
        error = caught
    if ranks.count > 1:
        said = "" if error is None else f"{type(error).__name__}: {error}"
        other = _first(ranks, said, error)
        if error is None and other:
            error = RankError(f"another rank of the case failed: {other}")
    if error is not None:
        raise error


def _first(ranks: Any, said: str, error: Exception | None) -> str:
    """Return what the first rank with an error says, when all have come here."""
    request, begun = ranks.control.Ibarrier(), time.monotonic()
    while not request.Test():
        if error is not None and time.monotonic() - begun > PATIENCE:
            if isinstance(error, OSError | MemoryError):
                sys.stderr.write(f"gfmdlayer: {type(error).__name__}: {error}; all ranks end\n")
            else:
                traceback.print_exception(error)
            sys.stderr.flush()
            ranks.control.Abort(1)
        time.sleep(_POLL)
    return next(filter(None, ranks.control.allgather(said)), "")


# The recorder of a rank that does not write the case: it hands its rows of the snapshots to the first.


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

    def __init__(self, grid: Grid | None, columns: Iterable[Column]) -> None:
        assert grid is not None  # ranks share periodic grids only
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
