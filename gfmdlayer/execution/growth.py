"""Results folders that grow: which cases of a changed configuration they hold already, and in which files.

A case is known by the digest of its own configuration. One that a folder holds keeps its number, wherever it
stands in the changed sweep; a new one gets a number that no file has. So no file is renamed or replaced, and
a run that is killed at any moment leaves the folder as sound as before. Cases that the sweep no longer has
stay in place, and are found again when it has them once more.

A configuration may differ from the folder's in its sweep, its end, its snapshots, its output times and
`output.keep_state`, or in anything that leaves some case unchanged. Any other one is refused.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from gfmdlayer.config import Config, digest, sweeps
from gfmdlayer.config.model import stem
from gfmdlayer.execution.folder import ASIDE, FOREIGN, WAYS_OUT, Folder, FolderError, Numbers
from gfmdlayer.execution.status import running
from gfmdlayer.execution.sweep import Cases, Change, Earlier, SweepCase, with_files
from gfmdlayer.files.locks import exclusive, no_link, open_for_writing, try_lock
from gfmdlayer.files.whole import cannot_be_written, is_intact, is_unfinished, unfinished_path
from gfmdlayer.results.names import ResultsError, numbered
from gfmdlayer.results.stored import must_agree
from gfmdlayer.validation.sections import files_named

_MAY_GROW = ("sweep.", "time.end", "output.snapshots", "output.times", "output.keep_state")


@dataclass(frozen=True)
class Growth:
    """The cases of a configuration in a results folder."""

    numbers: Sequence[int]  # numbers of their files, in the order of the sweep
    changed: bool = False  # whether the configuration is not the folder's
    # number -> why a case of the same swept values, which the folder holds, is not this case
    reasons: Mapping[int, str] = field(default_factory=dict)

    def numbered(self, cases: Sequence[SweepCase]) -> Sequence[SweepCase]:
        """Return cases, numbered by their places in the sweep, with the numbers of their files."""
        if isinstance(self.numbers, range):
            return cases
        return [replace(case, index=self.numbers[case.index]) for case in cases]


def compare(folder: Folder, config: Config) -> Growth:
    """Find the cases of a configuration in a results folder."""
    try:
        stored = folder.stored_config()
        numbers = folder.case_numbers()
        must_agree(folder.config, numbers, len(Cases(stored)))
    except (FolderError, ResultsError) as error:
        raise FolderError(f"{error}; {WAYS_OUT}") from None
    if not (changed := changed_keys(stored, config)):
        return Growth(numbers)
    files = folder.numbers()
    before, after = Cases(stored), Cases(config)
    had = dict(zip((digest(case.config) for case in before), numbers, strict=True))
    digests = [digest(case.config) for case in after]
    if had.keys().isdisjoint(digests) and not all(key.startswith(_MAY_GROW) for key in changed):
        other = f"another configuration ({'; '.join(changed)})"
        raise FolderError(f"{folder.path}: holds results of {other}; {WAYS_OUT}")
    from gfmdlayer.results.reader import attributes

    known = {}  # digest -> number
    for number in files["h5"].difference(numbers):  # of cases that the sweep has lost before
        with suppress(ResultsError):
            known[str(attributes(folder.case(number)).get("digest"))] = number
    known |= had
    taken = set().union(*files.values(), (known[each] for each in digests if each in known))
    following, found = max(taken, default=-1) + 1, []
    for each in digests:
        found.append(known.pop(each, following))  # a case that the sweep has twice is computed twice
        following += found[-1] == following
    written = partial(json.dumps, sort_keys=True, default=str)
    same = {written(before.values(place)): place for place, n in enumerate(numbers) if n in files["h5"]}
    reasons = {}
    for place, (number, each) in enumerate(zip(found, digests, strict=True)):
        if each not in had and number not in files["h5"]:
            earlier = same.get(written(after.values(place)))
            if earlier is not None:
                different = changed_keys(before[earlier].config, after[place].config)
                reasons[number] = sys.intern("; ".join(different))
    return Growth(found, True, reasons)


def with_inputs(folder: Folder, changed: bool) -> Change:
    """Let a case read the folder's copies of its input files, made when the first case names them."""
    kept: dict[Path, Path] = {}

    def copied(case: SweepCase) -> SweepCase:
        named = set(files_named(case.config).values())
        for path in sorted(named - kept.keys()):
            kept[path] = folder.keep_input(path, changed).absolute()
        if not named:
            return case
        return replace(case, config=with_files(case.config, kept), given=case.config)

    return copied


def with_earlier(folder: Folder, files: Numbers, omitted: Collection[int] = ()) -> Change:
    """Give a case that has not begun the complete case from whose kept state it goes on, if any.

    States of the `omitted` cases are not read. `files` are the numbers of `Folder.numbers`.
    """
    states = [number for number in files["state"] & files["h5"] if number not in omitted]
    if not states:
        return lambda case: case
    begun = files["checkpoint"] | files["h5"]
    from gfmdlayer.history.time_points import Course
    from gfmdlayer.programme import Programme
    from gfmdlayer.results.checkpoint import read_about
    from gfmdlayer.results.provenance import made_by

    kept: defaultdict[str, list[tuple[Course, Earlier]]] = defaultdict(list)
    for number in states:
        path = folder.case(number, "state")
        with suppress(OSError, KeyError, TypeError):  # unreadable, forged
            about = read_about(path) if is_intact(path) else None
            if about is not None and about["made_by"] == made_by(about["made_by"].get("digest")):
                course = Course(**about["course"])
                kept[about["stem"]].append((course, Earlier(number, course.time, about["made_by"])))

    def continued(case: SweepCase) -> SweepCase:
        if case.index not in begun and (candidates := kept.get(stem(case.config))):
            planned = Programme(case.config).landings
            fit = [earlier for course, earlier in candidates if course.begins(planned)]
            case = replace(case, earlier=max(fit, key=lambda each: each.time, default=None))
        return case

    return continued


def lines(files: Numbers, growth: Growth, numbers: Sequence[int], made: Iterable[SweepCase]) -> list[str]:
    """List the cases by state, why cases are computed again, and cases that the sweep has lost."""
    undone = [number for number in numbers if number not in files["h5"]]
    begun = sum(number in files["checkpoint"] for number in undone)
    earlier = {case.index: case.earlier.time for case in made if case.earlier is not None}
    times = Counter(earlier[number] for number in undone if number in earlier)
    again = defaultdict(list)
    for number in undone:
        if number in growth.reasons and number not in earlier:
            again[growth.reasons[number]].append(number)
    new = len(undone) - begun - times.total() - sum(map(len, again.values()))
    parts = (
        f"{len(numbers) - len(undone)} complete",
        f"{begun} at a checkpoint" if begun else "",
        *(f"{n} go{'es' * (n == 1)} on from t = {time:g}" for time, n in sorted(times.items())),
        f"{new} new" if new else "",
    )
    found = [", ".join(filter(None, parts))]
    found += [f"computed again: {numbered(numbers)}: {reason}" for reason, numbers in again.items()]
    if left := sorted(files["h5"].difference(growth.numbers)):
        found.append(f"not in the sweep, left in place: {numbered(left)}")
    return found


def changed_keys(before: Config, after: Config) -> list[str]:
    """Return the keys that differ, other than the name, as ``key: before -> after``."""
    old, new = _flat(before.model_dump()), _flat(after.model_dump())
    keys, absent = dict.fromkeys((*old, *new)), "(absent)"
    every = ((key, old.get(key, absent), new.get(key, absent)) for key in keys if key != "name")
    return [f"{key}: {earlier} -> {later}" for key, earlier, later in every if earlier != later]


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat


# Claiming a results folder for a run, and removing the files that killed runs left.
#
# One run of all cases may write into a folder, or one run of each shard. Locks keep others out:
#
#     cases/.lock            exclusive for a run of all cases, shared by runs of shards; holds their number
#     cases/.lock-3-of-16    exclusive for the run of this shard
#     cases/.turn            held while a run claims the folder or writes sweep.h5
#
# Killed runs leave unfinished files, the status of cases, requests to stop, locks of shards, and
# checkpoints of cases that have been completed since. Results, records of failures, files set aside for the
# user and other programs' files are never removed.

_PROBE = 1 << 16  # bytes; a full disk still accepts empty files
# Earlier versions had a journal in place of the snapshots, or a journal0, and a checkpoint1a or b and a
# journal1 of a second rank.
_RESULT = re.compile(
    r"(\d{4,})\.(h5|xdmf|failed|ended|checkpoint(\d+[ab])?|snapshots|journal\d*|state)(\.aside)?"
)
_INPUT = re.compile(r".+-[0-9a-f]{16}-[0-9a-f]{16}(\.\w+)?")
# Files of dead runs; those of version 0.1 had a simpler unfinished name.
_PART = r"(\.(.+-)?\d+-[0-9a-f]+)?\.part"
_IN_FOLDER = re.compile(rf"(config\.yaml|sweep\.h5){_PART}")
_OF_A_CASE = re.compile(
    rf"(\d{{4,}})\.(running|(h5|xdmf|failed|ended|running|checkpoint(\d+[ab])?|state){_PART})"
)
_STATE = re.compile(r"(\d{4,})\.(checkpoint(\d+[ab])?|snapshots|journal\d*)")
_OF_A_RUN = re.compile(rf"stop(-\d+-of-\d+)?|probe{_PART}")
_FOLDERS = ("cases", "arrays", "inputs")  # left by a run that was killed in its first instant
_LOCK = re.compile(r"\.lock-\d+-of-\d+|\.turn|\.admission|\.collection")  # the last two of version 0.2


@contextmanager
def claimed(
    folder: Folder, config: Config, restart: bool = False, own: Iterable[int] | None = None
) -> Iterator[Growth]:
    """Hold the folder, or a shard's part of it, for a run of `config`; make the folder if there is none.

    `restart` removes earlier results. `own` are the places of the shard's cases in the sweep.
    """
    with _as_folder_error(folder):
        refuse_foreign_folder(folder)
    if folder.is_results() and not restart:
        compare(folder, config)  # refuses another one before anything is made
    with ExitStack() as claim:
        with _as_folder_error(folder):
            folder.cases.mkdir(parents=True, exist_ok=True)
            with exclusive(folder.turn):
                alone = claim.enter_context(held(folder))
                probe = unfinished_path(folder.cases / "probe")
                try:
                    with open(probe, "xb", opener=no_link) as file:  # finds a full disk before any work
                        file.write(bytes(_PROBE))
                        file.flush()
                        os.fsync(file.fileno())
                finally:
                    probe.unlink(missing_ok=True)
                found = _prepare(folder, config, restart, None if alone else own)
        try:
            yield found
        finally:
            with suppress(OSError):
                folder.stop.unlink(missing_ok=True)


@contextmanager
def held(folder: Folder) -> Iterator[bool]:
    """Lock the folder, or the part of its shard; yields whether no other run uses the folder."""
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
            raise _in_use(folder, "another run of all the cases is writing here")
        if granted:
            common.truncate(0)
            common.write(str(shard.count))
            common.flush()
            try_lock(common, shared=True)
        else:
            common.seek(0)
            if (count := common.read()) not in {"", str(shard.count)}:
                other = f"of a sweep split in {count} and not in {shard.count}"
                raise _in_use(folder, f"other runs are writing here, {other}")
        lock = folder.cases / f".lock-{shard.number}-of-{shard.count}"
        own = stack.enter_context(open(lock, "a+", opener=no_link))
        if try_lock(own) is False:
            raise _in_use(folder, f"another run of shard {shard} is writing here")
        yield granted is True


@contextmanager
def leftovers(folder: Folder) -> Iterator[list[Path]]:
    """Find the files that killed runs left; no run begins in the folder until the block ends."""
    folder.must_hold_results()
    if at_work := running(folder):  # also where a file system has no locks
        raise _in_use(folder, f"another run is writing here, on {at_work[0].host}")
    with held(folder) if folder.cases.is_dir() else nullcontext():
        locks = _files(folder.cases, _LOCK.fullmatch)
        others = (path for place in (folder.path, folder.cases) for path in _files(place, is_unfinished))
        yield sorted({*_leftovers(folder), *locks, *others})  # the others are of figures


def _leftovers(folder: Folder) -> list[Path]:
    def is_left(name: str) -> bool:
        if name.endswith(".h5"):  # there may be a million
            return False
        if _OF_A_RUN.fullmatch(name):
            return True
        state = _matched(_STATE, name)
        ended = state is not None and folder.case(int(state[1])).exists()
        return ended or _matched(_OF_A_CASE, name) is not None

    return [*_files(folder.path, _IN_FOLDER.fullmatch), *_files(folder.cases, is_left)]


def _matched(pattern: re.Pattern[str], name: str) -> re.Match[str] | None:
    """Match a name that begins with the number of a case, written as ours are."""
    match = pattern.fullmatch(name)
    return match if match is not None and match[1] == f"{int(match[1]):04d}" else None


def _files(folder: Path, meant: Callable[[str], object] = bool) -> list[Path]:
    """Return the files of a folder whose names are `meant`; other ones cost no memory."""
    with suppress(FileNotFoundError), os.scandir(folder) as entries:
        named = (entry for entry in entries if meant(entry.name))
        return sorted(Path(entry.path) for entry in named if entry.is_file(follow_symlinks=False))
    return []


def _prepare(folder: Folder, config: Config, restart: bool, own: Iterable[int] | None) -> Growth:
    """Remove files of dead runs, of all cases or only `own` beside other runs; store the configuration."""
    if restart:
        remove_results(folder)
    is_new = not folder.is_results()
    found = Growth(range(sweeps.count(config.sweep))) if is_new else compare(folder, config)
    if found.changed and own is not None:
        raise _in_use(folder, "other runs are writing here, of another configuration")
    left = _leftovers(folder)
    if own is not None:
        mine = {f"{found.numbers[place]:04d}" for place in own}
        left = [path for path in left if path.name.partition(".")[0] in mine] + [folder.stop]
    for path in left:
        path.unlink(missing_ok=True)
    if is_new or found.changed:
        folder.store(config, found.numbers)
    return found


def remove_results(folder: Folder) -> None:
    """Remove the results in a claimed folder, known by their exact names, and nothing else."""
    results = _files(folder.cases, lambda name: _matched(_RESULT, name))
    inputs = _files(folder.path / "inputs", _INPUT.fullmatch)
    for path in (folder.sweep, *results, *inputs, folder.config):
        path.unlink(missing_ok=True)


def refuse_open_files(folder: Folder, todo: Iterable[int]) -> None:
    """Refuse to run cases whose files, or the sweep file, would be replaced while they are open elsewhere."""
    for path in (folder.sweep, *map(folder.case, todo)):
        if path.exists() and open_for_writing(path):
            raise FolderError(f"{path}: is open for writing in another program; close it there first")


def refuse_unreadable(path: Path) -> None:
    """Refuse a file that is there and that this user may not read; it is neither missing nor damaged."""
    if path.exists() and not os.access(path, os.R_OK):
        raise FolderError(f"{path}: cannot be read; this user must be allowed to")


def set_damaged_aside(folder: Folder, todo: Iterable[int]) -> list[str]:
    """Rename files of complete cases that cannot be read, among those to be run; return a line on each."""
    found = []
    for index in todo:
        if (path := folder.case(index)).exists():
            refuse_unreadable(path)
            folder.set_aside(path)
            found.append(f"case {index:04d} is damaged: set aside as {path.name}{ASIDE}, computed again")
    return found


@contextmanager
def _as_folder_error(folder: Folder) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FolderError(f"{folder.path}: {cannot_be_written(error)}; choose another with --out") from None


def _in_use(folder: Folder, reason: str) -> FolderError:
    return FolderError(f"{folder.path}: {reason}; wait for it to end")


def refuse_foreign_folder(folder: Folder) -> None:
    """Refuse a folder that holds something else than results."""
    if folder.path.exists() and not folder.path.is_dir():
        raise FolderError(f"{folder.path}: is a file, not a folder; choose another with --out")
    found = {entry.name for entry in folder.path.iterdir()} if folder.path.is_dir() else set()
    # A run killed in its first instant leaves folders and an unfinished configuration.
    foreign = [name for name in found if name not in _FOLDERS and not _IN_FOLDER.fullmatch(name)]
    if foreign and not folder.is_results():
        raise FolderError(f"{folder.path}: {FOREIGN}")
