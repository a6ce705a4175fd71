"""What runs leave that were killed, and may be removed.

That is unfinished files, the status of cases that nobody is at, requests to stop, locks of shards, and states
of cases that have been completed since.  Results, records of failures, what was set aside for the user, and
everything that is not gfmdlayer's are not among it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from gfmdlayer.execution import locks
from gfmdlayer.execution.folder import PARTIAL, Folder, FolderError
from gfmdlayer.execution.listing import numbers
from gfmdlayer.execution.status_file import running

# What only a run makes.
_PART = re.escape(PARTIAL)
_OF_THE_FOLDER = re.compile(rf"config\.yaml{_PART}|sweep\.h5\..+{_PART}")
_OF_A_RUN = re.compile(rf"stop(-\d+-of-\d+)?|\.lock-\d+-of-\d+|\.admission|\.collection|probe{_PART}")
_OF_A_CASE = re.compile(rf"\d{{4,}}\.(running|(h5|xdmf|failed|running|checkpoint)(\..+)?{_PART})")
_STATE = re.compile(r"(\d{4,})\.(checkpoint|journal\d)")


@contextmanager
def remains(folder: Folder) -> Iterator[list[Path]]:
    """Find what dead runs left in a folder; no run begins there until the block ends.

    Raises
    ------
    FolderError
        Where this is not a results folder, a run is at work in it, or it cannot be written.
    """
    folder.must_hold_results()
    found = numbers(folder)
    if at_work := running(folder, found["running"]):
        raise FolderError(f"{folder.path}: a run is at work here, on {at_work[0].host}; wait for it to end")
    try:
        with locks.held(folder.cases, None) if folder.cases.is_dir() else nullcontext():
            yield [
                *(path for path in _files(folder.path) if _OF_THE_FOLDER.fullmatch(path.name)),
                *(path for path in _files(folder.cases) if _is_left(path.name, found["h5"])),
            ]
    except locks.HeldError:
        raise FolderError(f"{folder.path}: a run is at work here; wait for it to end") from None


def _is_left(name: str, complete: set[int]) -> bool:
    state = _STATE.fullmatch(name)
    orphan = state is not None and int(state[1]) in complete
    return orphan or bool(_OF_A_RUN.fullmatch(name) or _OF_A_CASE.fullmatch(name))


def _files(folder: Path) -> list[Path]:
    with suppress(FileNotFoundError), os.scandir(folder) as entries:
        return sorted(Path(entry.path) for entry in entries if entry.is_file(follow_symlinks=False))
    return []
