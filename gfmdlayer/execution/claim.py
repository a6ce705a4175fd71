"""Claiming a results folder for a run, and removing the files that killed runs left.

One run of all cases may write into a folder, or one run of each shard. Locks keep others out:

    cases/.lock            exclusive for a run of all cases, shared by the runs of shards; it holds the number
                           of shards
    cases/.lock-3-of-16    exclusive for the run of this shard
    cases/.admission       held while a run claims the folder, cases/.collection while sweep.h5 is written

Killed runs leave unfinished files, the status of cases, requests to stop, locks of shards, and checkpoints of
cases that have been completed since. Results, records of failures, files set aside for the user and other
programs' files are never removed.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import IO

from gfmdlayer.config import Config, sweeps
from gfmdlayer.execution import growth
from gfmdlayer.execution.folder import ASIDE, FOREIGN, Folder, FolderError
from gfmdlayer.execution.growth import Growth
from gfmdlayer.execution.status import running
from gfmdlayer.execution.sweep import Shard
from gfmdlayer.files.locks import exclusive, open_for_writing, try_lock
from gfmdlayer.files.shared_folders import no_link
from gfmdlayer.files.whole import cannot_be_written, is_unfinished, unfinished_path

_PROBE = 1 << 16  # bytes; a full disk still accepts empty files
_RESULT = re.compile(r"(\d{4,})\.(h5|xdmf|failed|ended|checkpoint(\d+[ab])?|journal\d+|state)(\.aside)?")
_INPUT = re.compile(r".+-[0-9a-f]{16}-[0-9a-f]{16}(\.\w+)?")
_WISDOM = re.compile(r"fftw-.+-and-parts\.wisdom")
# Files of dead runs; those of version 0.1 had a simpler unfinished name.
_PART = r"(\.(.+-)?\d+-[0-9a-f]+)?\.part"
_IN_FOLDER = re.compile(rf"(config\.yaml|sweep\.h5){_PART}")
_OF_A_CASE = re.compile(
    rf"(\d{{4,}})\.(running|(h5|xdmf|failed|ended|running|checkpoint(\d+[ab])?|state){_PART})"
)
_STATE = re.compile(r"(\d{4,})\.(checkpoint(\d+[ab])?|journal\d+)")
_OF_A_RUN = re.compile(rf"stop(-\d+-of-\d+)?|probe{_PART}")
_FOLDERS = ("cases", "arrays", "inputs", "wisdom")  # those of a run that was killed in its first instant
_LOCK = re.compile(r"\.lock-\d+-of-\d+|\.admission|\.collection")


@contextmanager
def claimed(
    folder: Folder, config: Config, restart: bool = False, own: Collection[int] | None = None
) -> Iterator[Growth]:
    """Hold the folder, or a shard's part of it, for a run of `config`.

    Parameters
    ----------
    folder : Folder
        The folder; made where there is none.
    config : Config
        The configuration of the run.
    restart : bool
        Remove earlier results of gfmdlayer in this folder first; nothing else is touched.
    own : collection of int, optional
        The places of the shard's cases in the sweep.

    Yields
    ------
    Growth
        How the folder's cases compare with those of the configuration.

    Raises
    ------
    FolderError
        Where the folder holds something else or results of another configuration, is in use, or cannot be
        written.
    """
    with _as_folder_error(folder):
        refuse_foreign_folder(folder)
    if folder.is_results() and not restart:
        growth.compare(folder, config)  # refuses another one before anything is made
    with ExitStack() as claim:
        with _as_folder_error(folder):
            folder.cases.mkdir(parents=True, exist_ok=True)
            with exclusive(folder.cases / ".admission"):
                alone = claim.enter_context(held(folder))
                _probe(folder)
                found = _prepare(folder, config, restart, None if alone else own)
        try:
            yield found
        finally:
            with suppress(OSError):
                folder.stop.unlink(missing_ok=True)


@contextmanager
def held(folder: Folder) -> Iterator[bool]:
    """Lock the folder, or the part of its shard.

    Yields
    ------
    bool
        Whether no other run uses the folder.

    Raises
    ------
    FolderError
        Where another run holds a lock that excludes this one.
    """
    shard = folder.shard
    with ExitStack() as stack:
        common = stack.enter_context(open(folder.cases / ".lock", "a+", opener=no_link))
        granted = try_lock(common)
        if shard is None:
            if granted is False:
                raise _in_use(folder, "another run is writing here")
            yield True
            return
        if granted is False and try_lock(common, shared=True) is False:
            raise _in_use(folder, "another run is writing here, of all the cases")
        if granted:
            common.truncate(0)
            common.write(str(shard.count))
            common.flush()
            try_lock(common, shared=True)
        else:
            _refuse_other_division(folder, common, shard)
        lock = folder.cases / f".lock-{shard.number}-of-{shard.count}"
        own = stack.enter_context(open(lock, "a+", opener=no_link))
        if try_lock(own) is False:
            raise _in_use(folder, f"another run of shard {shard} is writing here")
        yield granted is True


@contextmanager
def leftovers(folder: Folder) -> Iterator[list[Path]]:
    """Find the files that killed runs left; no run begins in the folder until the block ends.

    Raises
    ------
    FolderError
        Where this is not a results folder, a run uses it, or it cannot be written.
    """
    folder.must_hold_results()
    if at_work := running(folder):  # also where a file system has no locks
        raise _in_use(folder, f"another run is writing here, on {at_work[0].host}")
    with held(folder) if folder.cases.is_dir() else nullcontext():
        below = _files(folder.cases)
        locks = {path for path in below if _LOCK.fullmatch(path.name)}
        others = {path for path in (*_files(folder.path), *below) if is_unfinished(path.name)}  # of figures
        yield sorted({*_leftovers(folder), *locks, *others})


def _leftovers(folder: Folder) -> list[Path]:
    complete = folder.numbers()["h5"]

    def is_left(name: str) -> bool:
        if _OF_A_RUN.fullmatch(name):
            return True
        state = _matched(_STATE, name)
        return _matched(_OF_A_CASE, name) is not None or (state is not None and int(state[1]) in complete)

    return [
        *(path for path in _files(folder.path) if _IN_FOLDER.fullmatch(path.name)),
        *(path for path in _files(folder.cases) if is_left(path.name)),
    ]


def _matched(pattern: re.Pattern[str], name: str) -> re.Match[str] | None:
    """Match a name that begins with the number of a case, written as ours are."""
    match = pattern.fullmatch(name)
    return match if match is not None and match[1] == f"{int(match[1]):04d}" else None


def _files(folder: Path) -> list[Path]:
    with suppress(FileNotFoundError), os.scandir(folder) as entries:
        return sorted(Path(entry.path) for entry in entries if entry.is_file(follow_symlinks=False))
    return []


def _prepare(folder: Folder, config: Config, restart: bool, own: Collection[int] | None) -> Growth:
    """Remove files of dead runs, of all cases or only `own` beside other runs; store the configuration."""
    if restart:
        remove_results(folder)
    is_new = not folder.is_results()
    found = Growth(range(sweeps.count(config.sweep))) if is_new else growth.compare(folder, config)
    if found.changed and own is not None:
        raise _in_use(folder, "other runs are writing here, of another configuration")
    left = _leftovers(folder)
    if own is not None:
        mine = {found.numbers[place] for place in own}
        left = [path for path in left if _case_number(path) in mine] + [folder.stop]
    for path in left:
        path.unlink(missing_ok=True)
    if is_new or found.changed:
        folder.store(config, found.numbers)
    return found


def remove_results(folder: Folder) -> None:
    """Remove the results in a claimed folder, known by their exact names, and nothing else."""
    results = (path for path in _files(folder.cases) if _matched(_RESULT, path.name))
    inputs = (path for path in _files(folder.path / "inputs") if _INPUT.fullmatch(path.name))
    wisdom = (path for path in _files(folder.wisdom) if _WISDOM.fullmatch(path.name))
    for path in (folder.sweep, *results, *inputs, *wisdom, folder.config):
        path.unlink(missing_ok=True)


def refuse_open_files(folder: Folder, todo: Iterable[int]) -> None:
    """Refuse to run cases whose files, or the sweep file, would be replaced while they are open elsewhere.

    Raises
    ------
    FolderError
        Where one is.
    """
    for path in (folder.sweep, *map(folder.case, todo)):
        if path.exists() and open_for_writing(path):
            raise FolderError(f"{path}: is open for writing in another program; close it there first")


def refuse_unreadable(path: Path) -> None:
    """Refuse a file that is there and that this user may not read; it is neither missing nor damaged."""
    if path.exists() and not os.access(path, os.R_OK):
        raise FolderError(f"{path}: cannot be read; this user must be allowed to")


def set_damaged_aside(folder: Folder, todo: Iterable[int]) -> list[str]:
    """Rename files of complete cases that cannot be read, among those to be run; return a line on each."""
    damaged = [index for index in todo if folder.case(index).exists()]
    for index in damaged:
        refuse_unreadable(folder.case(index))
        folder.set_aside(folder.case(index))
    return [
        f"case {index:04d} is damaged: set aside as {index:04d}.h5{ASIDE}, computed again"
        for index in damaged
    ]


def _case_number(path: Path) -> int | None:
    number = path.name.partition(".")[0]
    return int(number) if number.isdigit() else None


def _probe(folder: Folder) -> None:
    """Write some bytes, to find a full disk before any work."""
    path = unfinished_path(folder.cases / "probe")
    try:
        with open(path, "xb", opener=no_link) as file:
            file.write(bytes(_PROBE))
            file.flush()
            os.fsync(file.fileno())
    finally:
        path.unlink(missing_ok=True)


@contextmanager
def _as_folder_error(folder: Folder) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FolderError(f"{folder.path}: {cannot_be_written(error)}; choose another with --out") from None


def _in_use(folder: Folder, reason: str) -> FolderError:
    return FolderError(f"{folder.path}: {reason}; wait for it to end")


def _refuse_other_division(folder: Folder, common: IO[str], shard: Shard) -> None:
    common.seek(0)
    count = common.read()
    if count not in {"", str(shard.count)}:
        raise _in_use(
            folder, f"other runs are writing here, of a sweep split in {count} and not in {shard.count}"
        )


def refuse_foreign_folder(folder: Folder) -> None:
    """Refuse a folder that holds something else than results.

    Raises
    ------
    FolderError
        Where it does.
    """
    if folder.path.exists() and not folder.path.is_dir():
        raise FolderError(f"{folder.path}: is a file, not a folder; choose another with --out")
    found = {entry.name for entry in folder.path.iterdir()} if folder.path.is_dir() else set()
    # A run killed in its first instant leaves folders and an unfinished configuration.
    foreign = [name for name in found if name not in _FOLDERS and not _IN_FOLDER.fullmatch(name)]
    if foreign and not folder.is_results():
        raise FolderError(f"{folder.path}: {FOREIGN}")
