"""Who may write into a results folder: one run of everything, or one run of each shard.

The kernel lets a lock go when its holder dies, so that nothing has to be cleaned up after a crash.

    cases/.lock            held alone by a run of everything, shared by the runs of shards, who agree in it on
                           their number
    cases/.lock-3-of-16    held by the run of this shard
    cases/.admission       held while a run comes in, cases/.collection while sweep.h5 is written
"""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from gfmdlayer.execution.shards import Shard


class HeldError(Exception):
    """Somebody else is at work in the folder; the message says who."""


@contextmanager
def turn(path: Path) -> Iterator[None]:
    """Wait for one's turn at what everybody does briefly, one after the other; leaves no file behind."""
    while True:
        with path.open("a+") as file:
            with suppress(OSError):  # a file system without locks: the user's care has to do
                fcntl.flock(file, fcntl.LOCK_EX)
            if _is_still(path, file):  # who had it before may have removed it
                try:
                    yield
                finally:
                    path.unlink(missing_ok=True)
                return


@contextmanager
def held(cases: Path, shard: Shard | None) -> Iterator[bool]:
    """Hold the folder, or a shard's part of it; to be entered in one's turn at `.admission`.

    Yields
    ------
    bool
        Whether no other run is at work in the folder.

    Raises
    ------
    HeldError
        Where another run is in the way.
    """
    with ExitStack() as stack:
        common = stack.enter_context((cases / ".lock").open("a+"))
        got = _take(common, fcntl.LOCK_EX)
        if shard is None:
            if got is False:
                raise HeldError("another run is writing here")
            yield True
            return
        if got is False and _take(common, fcntl.LOCK_SH) is False:
            raise HeldError("another run is writing here, of all the cases")
        _agree(common, shard, alone=got is True)
        own = stack.enter_context((cases / f".lock-{shard.number}-of-{shard.count}").open("a+"))
        if _take(own, fcntl.LOCK_EX) is False:
            raise HeldError(f"another run of shard {shard} is writing here")
        yield got is True


def _agree(common: IO[str], shard: Shard, alone: bool) -> None:
    """Settle into how many shards the sweep is split, for as long as any of them is at work."""
    if alone:
        common.truncate(0)
        common.write(str(shard.count))
        common.flush()
        _take(common, fcntl.LOCK_SH)
        return
    common.seek(0)
    count = common.read()
    if count not in {"", str(shard.count)}:
        raise HeldError(f"other runs are writing here, of a sweep split in {count} and not in {shard.count}")


def _take(file: IO[str], kind: int) -> bool | None:
    """Take a lock without waiting; None on a file system without locks: the user's care has to do."""
    try:
        fcntl.flock(file, kind | fcntl.LOCK_NB)
    except OSError as error:
        return False if error.errno in (errno.EAGAIN, errno.EACCES) else None
    return True


def _is_still(path: Path, file: IO[str]) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
