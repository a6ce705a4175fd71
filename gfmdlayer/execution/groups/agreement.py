"""Ranks of a case fail together: an error of one of them ends the case on all."""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gfmdlayer.grid.ranks import Ranks

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
