"""Results folders that grow: which cases of a changed configuration they hold already, and in which files.

A case is known by the digest of its own configuration. One that a folder holds keeps its number, wherever it
stands in the changed sweep; a new one gets a number that no file has. So no file is renamed or replaced, and
a run that is killed at any moment leaves the folder as sound as before. Cases that the sweep no longer has
stay in place, and are found again when it has them once more.

A configuration may differ from that of the folder in its sweep, its end, its snapshots, its output times and
`output.keep_state`, or in anything that leaves some case as it is. Any other one is refused.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from gfmdlayer.config import Config, digest
from gfmdlayer.config.model import stem
from gfmdlayer.config.stops import stops
from gfmdlayer.execution.folder import WAYS_OUT, Folder, FolderError
from gfmdlayer.execution.sweep import Case, Earlier, cases, with_files
from gfmdlayer.validation.named_files import files_named

_MAY_GROW = ("sweep.", "time.end", "output.snapshots", "output.times", "output.keep_state")
_LISTED = 8  # numbers of cases in a line


@dataclass(frozen=True)
class Growth:
    """The cases of a configuration in a results folder.

    Attributes
    ----------
    numbers : sequence of int
        Numbers of their files, in the order of the sweep.
    changed : bool
        Whether the configuration differs from that of the folder.
    reasons : mapping
        Number -> why a case of the same swept values, which the folder holds, is not this case.
    left : list of int
        Complete cases of the folder that the sweep does not have.
    """

    numbers: Sequence[int]
    changed: bool = False
    reasons: Mapping[int, str] = field(default_factory=dict)
    left: Sequence[int] = ()

    def numbered(self, cases: Sequence[Case]) -> Sequence[Case]:
        """Return cases, numbered by their places in the sweep, with the numbers of their files."""
        if isinstance(self.numbers, range):
            return cases
        return [replace(case, index=self.numbers[case.index]) for case in cases]


def compare(folder: Folder, config: Config) -> Growth:
    """Find the cases of a configuration in a results folder.

    Raises
    ------
    FolderError
        Where the folder holds results of another configuration, or its own cannot be read.
    """
    try:
        stored = folder.stored_config()
        numbers = folder.case_numbers()
        must_agree(folder, numbers, len(cases(stored)))
    except FolderError as error:
        raise FolderError(f"{error}; {WAYS_OUT}") from None
    files = folder.numbers()
    if not (changed := changed_keys(stored, config)):
        own = set(numbers) if isinstance(numbers, list) else numbers
        return Growth(numbers, left=sorted(number for number in files["h5"] if number not in own))
    before, after = cases(stored), cases(config)
    had = dict(zip((digest(case.config) for case in before), numbers, strict=True))
    digests = [digest(case.config) for case in after]
    if had.keys().isdisjoint(digests) and not all(key.startswith(_MAY_GROW) for key in changed):
        raise FolderError(
            f"{folder.path}: holds results of another configuration ({'; '.join(changed)}); {WAYS_OUT}"
        )
    known = _digests_of_files(folder, files["h5"].difference(numbers)) | had
    taken = set().union(*files.values(), (known[each] for each in digests if each in known))
    following, found = max(taken, default=-1) + 1, []
    for each in digests:
        found.append(known.pop(each, following))  # a case that the sweep has twice is computed twice
        following += found[-1] == following
    same = {_values(case): case for case, n in zip(before, numbers, strict=True) if n in files["h5"]}
    reasons = {
        number: "; ".join(changed_keys(same[_values(case)].config, case.config))
        for number, case, each in zip(found, after, digests, strict=True)
        if each not in had and number not in files["h5"] and _values(case) in same
    }
    return Growth(found, True, reasons, sorted(files["h5"].difference(found)))


def must_agree(folder: Folder, numbers: Sequence[int], count: int) -> None:
    """Refuse a configuration of results that was changed: it names other cases than its sweep has.

    Raises
    ------
    FolderError
        Where there are not as many.
    """
    if len(numbers) != count:
        raise FolderError(
            f"{folder.config}: names {len(numbers)} cases, and its sweep has {count}; "
            "must be as the run wrote it"
        )


def _digests_of_files(folder: Folder, numbers: Iterable[int]) -> dict[str, int]:
    """Return digest -> number of complete cases that the folder's own configuration does not have."""
    from gfmdlayer.results.reader import attributes
    from gfmdlayer.results.schema import ResultsError

    found = {}
    for number in numbers:
        with suppress(ResultsError):
            found[str(attributes(folder.case(number)).get("digest"))] = number
    return found


def _values(case: Case) -> str:
    return json.dumps(case.values, sort_keys=True, default=str)


def with_inputs(folder: Folder, every: Sequence[Case], changed: bool) -> Sequence[Case]:
    """Let cases read the folder's copies of their input files, which no one changes while they run.

    Parameters
    ----------
    folder : Folder
        The results folder, claimed.
    every : sequence of Case
        The cases.
    changed : bool
        Whether the configuration has changed, and files may have too.

    Returns
    -------
    sequence of Case

    Raises
    ------
    FolderError
        Where a file has changed since the results were begun, or cannot be copied.
    """
    files = {path for case in every for path in files_named(case.config).values()}
    if not files:
        return every
    kept = {path: folder.keep_input(path, changed).absolute() for path in sorted(files)}
    return [replace(case, config=with_files(case.config, kept), given=case.config) for case in every]


def with_earlier(folder: Folder, every: Sequence[Case]) -> Sequence[Case]:
    """Give cases that have not begun the complete ones from whose kept states they go on, if there are any.

    Parameters
    ----------
    folder : Folder
        The results folder.
    every : sequence of Case
        The cases, numbered.

    Returns
    -------
    sequence of Case
    """
    files = folder.numbers()
    if not (states := files["state"] & files["h5"]):
        return every
    begun = files["checkpoint"] | files["h5"]
    from gfmdlayer import inputs
    from gfmdlayer.history.time_points import Course
    from gfmdlayer.results.checkpoint import read_about
    from gfmdlayer.results.provenance import made_by

    kept: defaultdict[str, list[tuple[Course, Earlier]]] = defaultdict(list)
    for number in states:
        if (about := read_about(folder.case(number, "state"))) is None:
            continue
        if about["made_by"] == made_by(about["made_by"].get("digest")):
            with suppress(KeyError, TypeError):  # forged
                course = Course(**about["course"])
                kept[about["stem"]].append((course, Earlier(number, course.time, about["made_by"])))
    found = []
    for case in every:
        if case.index not in begun and (candidates := kept.get(stem(case.config))):
            parts = inputs.make_trajectory, inputs.make_velocity, inputs.make_interface
            kinks = inputs.kinks(inputs.make_clocks(case.config), *(part(case.config) for part in parts))
            planned = stops(case.config, kinks)
            fit = [earlier for course, earlier in candidates if course.begins(planned)]
            case = replace(case, earlier=max(fit, key=lambda each: each.time, default=None))
        found.append(case)
    return found


def lines(folder: Folder, growth: Growth, every: Sequence[Case]) -> list[str]:
    """Describe what a run of the cases finds in the folder and what it computes.

    Parameters
    ----------
    folder : Folder
        The results folder.
    growth : Growth
        How its cases compare with those of the configuration.
    every : sequence of Case
        The cases, numbered, with the earlier ones from which they go on.

    Returns
    -------
    list of str
        A line on all cases, one on each reason for which cases are computed again, and one on the cases that
        the sweep does not have.
    """
    files = folder.numbers()
    undone = [case for case in every if case.index not in files["h5"]]
    begun = sum(case.index in files["checkpoint"] for case in undone)
    times = Counter(case.earlier.time for case in undone if case.earlier is not None)
    again = defaultdict(list)
    for case in undone:
        if case.index in growth.reasons and case.earlier is None:
            again[growth.reasons[case.index]].append(case.index)
    new = len(undone) - begun - times.total() - sum(map(len, again.values()))
    parts = (
        f"{len(every) - len(undone)} complete",
        f"{begun} at a checkpoint" if begun else "",
        *(f"{_go(number)} on from t = {time:g}" for time, number in sorted(times.items())),
        f"{new} new" if new else "",
    )
    found = [", ".join(filter(None, parts))]
    found += [f"computed again: {_listed(numbers)}: {reason}" for reason, numbers in again.items()]
    if growth.left:
        found.append(f"not in the sweep, left in place: {_listed(growth.left)}")
    return found


def _go(number: int) -> str:
    return f"{number} goes" if number == 1 else f"{number} go"


def _listed(numbers: Sequence[int]) -> str:
    names = [f"{number:04d}" for number in numbers[:_LISTED]]
    more = len(numbers) - len(names)
    return f"case{'s' * (len(numbers) > 1)} {', '.join(names)}{f' and {more} more' * (more > 0)}"


def changed_keys(before: Config, after: Config) -> list[str]:
    """Compare two configurations.

    Parameters
    ----------
    before, after : Config
        The configurations.

    Returns
    -------
    list of str
        The keys that differ, but the name, as ``key: before -> after``.
    """
    old, new = _flat(before.model_dump()), _flat(after.model_dump())
    absent = "(absent)"
    return [
        f"{key}: {old.get(key, absent)} -> {new.get(key, absent)}"
        for key in dict.fromkeys((*old, *new))
        if key != "name" and old.get(key, absent) != new.get(key, absent)
    ]


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat
