"""Results folders that grow: which cases of a changed configuration they hold already, and in which files.

A case is known by the digest of its own configuration. One that a folder holds keeps its number, wherever it
stands in the changed sweep; a new one gets a number that no file has. So no file is renamed or replaced, and
a run that is killed at any moment leaves the folder as sound as before. Cases that the sweep no longer has
stay in place, and are found again when it has them once more.

A configuration may differ from the folder's in its sweep, its end, its snapshots, its output times and
`output.keep_state`, or in anything that leaves some case unchanged. Any other one is refused.

Runs of one configuration share a folder. A run that begins alone first removes files of dead runs; only this
run may change the configuration.
"""

from __future__ import annotations

import json
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from gfmdlayer.config import Config, digest
from gfmdlayer.config.model import stem
from gfmdlayer.files.locks import no_link
from gfmdlayer.files.whole import cannot_be_written, is_intact, unfinished_path
from gfmdlayer.results.names import ResultsError, numbered
from gfmdlayer.results.stored import must_agree
from gfmdlayer.study.cases import Cases, Earlier, SweepCase, with_files
from gfmdlayer.study.claims import PATIENCE, Lock, in_use, locked
from gfmdlayer.study.folder import WAYS_OUT, Folder, FolderError, Numbers
from gfmdlayer.validation.sections import files_named

Change = Callable[[SweepCase], SweepCase]

_PROBE = 1 << 16  # bytes; a full disk still accepts empty files
_MAY_GROW = ("sweep.", "time.end", "output.snapshots", "output.times", "output.keep_state")


@dataclass(frozen=True)
class Growth:
    """The cases of a configuration in a results folder."""

    numbers: Sequence[int]  # numbers of their files, in the order of the sweep
    changed: bool = False  # whether the configuration is not the folder's
    # number -> why a case of the same swept values, which the folder holds, is not this case
    reasons: Mapping[int, str] = field(default_factory=dict)

    def numbered(self, case: SweepCase) -> SweepCase:
        """Return a case, numbered by its place in the sweep, with the number of its file."""
        number = self.numbers[case.index]
        return case if number == case.index else replace(case, index=number)


@contextmanager
def opened(folder: Folder, cases: Cases, restart: bool = False) -> Iterator[Growth]:
    """Hold the folder for a run, beside others of the same configuration; make it if there is none.

    `restart` removes earlier results.
    """
    with ExitStack() as held:
        try:
            folder.refuse_foreign()
            folder.cases.mkdir(parents=True, exist_ok=True)
            lock = held.enter_context(locked(folder))
            probe = unfinished_path(folder.cases / "probe")
            try:
                with open(probe, "xb", opener=no_link) as file:  # finds a full disk before any work
                    file.write(bytes(_PROBE))
                    file.flush()
                    os.fsync(file.fileno())
            finally:
                probe.unlink(missing_ok=True)
            growth = _prepare(folder, cases, restart, lock)
            before = folder.config.stat()
            lock.share()
            if not os.path.samestat(before, folder.config.stat()):
                raise in_use(folder, "another run has begun here at the same instant")
        except OSError as error:
            reason = cannot_be_written(error)
            raise FolderError(f"{folder.path}: {reason}; choose another with --out") from None
        try:
            yield growth
        finally:
            folder.end_run()


def _prepare(folder: Folder, cases: Cases, restart: bool, lock: Lock) -> Growth:
    """Find the cases; if no other run is at work, remove files of dead ones and store the configuration."""
    if restart:
        if not lock.is_alone(PATIENCE):
            raise in_use(folder, "another run is writing here")
        folder.remove_results()
    is_new = not folder.is_results()
    growth = Growth(range(len(cases))) if is_new else compare(folder, cases)
    changes = is_new or growth.changed
    alone = lock.is_alone(PATIENCE if changes else 0.0)
    if changes and not alone:
        raise in_use(folder, "another run is writing here, of another configuration")
    if alone:
        for path in folder.leftovers():
            path.unlink(missing_ok=True)
    if changes:
        folder.store(cases.config, growth.numbers)
    return growth


def compare(folder: Folder, after: Cases) -> Growth:
    """Find the cases of a configuration in a results folder."""
    config = after.config
    try:
        stored = folder.stored_config()
        numbers = folder.case_numbers()
        must_agree(folder.config, numbers, len(Cases(stored)))
    except (FolderError, ResultsError) as error:
        raise FolderError(f"{error}; {WAYS_OUT}") from None
    if not (changed := changed_keys(stored, config)):
        return Growth(numbers)
    files = folder.numbers()
    before = Cases(stored)
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
    taken = set().union(*files.values(), (known[key] for key in digests if key in known))
    following, assigned = max(taken, default=-1) + 1, []
    for key in digests:
        assigned.append(known.pop(key, following))  # a case that the sweep has twice is computed twice
        following += assigned[-1] == following
    written = partial(json.dumps, sort_keys=True, default=str)
    same = {written(before.values(place)): place for place, n in enumerate(numbers) if n in files["h5"]}
    reasons = {}
    for place, (number, key) in enumerate(zip(assigned, digests, strict=True)):
        if key not in had and number not in files["h5"]:
            earlier = same.get(written(after.values(place)))
            if earlier is not None:
                different = changed_keys(before[earlier].config, after[place].config)
                reasons[number] = sys.intern("; ".join(different))
    return Growth(assigned, True, reasons)


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
            planned = case.drives.landings
            fit = [earlier for course, earlier in candidates if course.begins(planned)]
            case = replace(case, earlier=max(fit, key=lambda each: each.time, default=None))
        return case

    return continued


def lines(files: Numbers, growth: Growth, made: Iterable[SweepCase]) -> list[str]:
    """List the cases by state, why cases are computed again, and cases that the sweep has lost."""
    undone = [number for number in growth.numbers if number not in files["h5"]]
    begun = sum(number in files["checkpoint"] for number in undone)
    earlier = {case.index: case.earlier.time for case in made if case.earlier is not None}
    times = Counter(earlier[number] for number in undone if number in earlier)
    again = defaultdict(list)
    for number in undone:
        if number in growth.reasons and number not in earlier:
            again[growth.reasons[number]].append(number)
    new = len(undone) - begun - times.total() - sum(map(len, again.values()))
    parts = (
        f"{len(growth.numbers) - len(undone)} complete",
        f"{begun} at a checkpoint" if begun else "",
        *(f"{n} go{'es' * (n == 1)} on from t = {time:g}" for time, n in sorted(times.items())),
        f"{new} new" if new else "",
    )
    listed = [", ".join(filter(None, parts))]
    listed += [f"computed again: {numbered(numbers)}: {reason}" for reason, numbers in again.items()]
    if left := sorted(files["h5"].difference(growth.numbers)):
        listed.append(f"not in the sweep, left in place: {numbered(left)}")
    return listed


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
