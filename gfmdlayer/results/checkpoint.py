"""The checkpoint of an unfinished case: one file, renamed once, when the states of all ranks are in it.

    a line of JSON    what the bits depend on; simulated time; columns and fields; names of the arrays
    arrays            of the first rank, then of the next ones, each as in a .npy file
    seal              checksum of the whole file (`files.whole`)

Under its name there is always one whole state: the last one, or the one before. The first rank alone reads
and writes; the others send it their arrays, one at a time, so that no process needs the memory of two ranks.
It contains the rows so far, and where the snapshots so far are in their file, which only grows
(`results.recording`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from gfmdlayer.files.locks import no_link, regular
from gfmdlayer.files.whole import is_intact, seal, unfinished
from gfmdlayer.grid.ranks import ALONE, Ranks

_LONGEST = 1 << 22  # bytes of the line of JSON
_ZIP = b"PK"  # begins a checkpoint of version 0.2


class CheckpointError(Exception):
    """A case cannot go on from its checkpoint; the message says why."""


@dataclass(frozen=True)
class Checkpoint:
    """The state of one rank, and `about`: plain data on the run so far."""

    about: Mapping[str, Any]
    state: Mapping[str, NDArray[Any]]


def write_checkpoint(
    path: Path,
    made_by: Mapping[str, str],
    about: Mapping[str, Any],
    state: Mapping[str, Any],
    ranks: Ranks = ALONE,
) -> None:
    """Write the states of all ranks; each rank calls this with its own.

    `made_by` has all else on which the bits of later results depend: input, versions, processor.
    An OSError on the first rank leaves the checkpoint before in place.
    """
    arrays = {name: np.asarray(values) for name, values in state.items()}
    names = ranks.all_of(list(arrays))
    every = ranks.brought(list(arrays.values()))
    try:
        if ranks.first:
            with unfinished(path) as part, open(part, "x+b", opener=no_link) as file:
                file.write(json.dumps({"made_by": dict(made_by), **about, "arrays": names}).encode() + b"\n")
                for values in every:
                    npy.write_array(file, values, allow_pickle=False)
                seal(file)
    finally:
        for _ in every:  # also after a failure the other ranks must get rid of theirs
            pass


def read_checkpoint(path: Path, made_by: Mapping[str, str], ranks: Ranks = ALONE) -> Checkpoint:
    """Read a checkpoint; each rank calls this and gets its own state.

    CheckpointError on all ranks, if the file is damaged, or if other input, versions, ranks or another
    processor made it.
    """
    with ExitStack() as stack:
        file: BinaryIO | None = None
        about: dict[str, Any] = {}
        with ranks.agreeing(CheckpointError):
            if ranks.first:
                file, about = _opened(path, stack)
                versions, keys = about["made_by"], sorted({*about["made_by"], *made_by})
                pairs = ((key, versions.get(key, "(none)"), made_by.get(key, "(none)")) for key in keys)
                if changed := [f"{key} {old} -> {new}" for key, old, new in pairs if old != new]:
                    raise CheckpointError(f"it would not give the same bits: {'; '.join(changed)}")
        about = ranks.shared(about)
        names: list[list[str]] = about.pop("arrays")
        own = ranks.handed_out(_arrays(file, path), [len(each) for each in names])
        del about["made_by"]
        return Checkpoint(about, dict(zip(names[ranks.number], own, strict=True)))


def read_about(path: Path) -> dict[str, Any] | None:
    """Return the plain data of a checkpoint and `made_by`, unverified; None where there are none."""
    try:
        with open(path, "rb", opener=regular) as file:
            return _parsed(file.readline(_LONGEST))
    except OSError:
        return None


def _parsed(line: bytes) -> dict[str, Any] | None:
    try:
        about: dict[str, Any] = json.loads(line)
        return about if isinstance(about["made_by"], dict) else None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _opened(path: Path, stack: ExitStack) -> tuple[BinaryIO, dict[str, Any]]:
    """Open a checkpoint of this form whose bytes are those that were written, behind its line of JSON."""
    try:
        intact = is_intact(path)
        file = stack.enter_context(open(path, "rb", opener=regular))  # noqa: SIM115 - the stack closes it
        line = file.readline(_LONGEST)
    except OSError as error:
        raise CheckpointError(f"it cannot be read: {error.strerror or error}") from None
    if intact is None and line.startswith(_ZIP):
        raise CheckpointError("an earlier version of gfmdlayer wrote it")
    about = _parsed(line)
    if not intact or about is None or not isinstance(about.get("arrays"), list):
        raise CheckpointError("it is damaged")
    return file, about


def _arrays(file: BinaryIO | None, path: Path) -> Iterator[NDArray[Any]]:
    """Yield the arrays of an open checkpoint; none on the ranks that have not opened it."""
    while file is not None:
        try:
            yield npy.read_array(file, allow_pickle=False)
        except (OSError, ValueError) as error:
            raise CheckpointError(f"{path.name} cannot be read: {error}") from None
