"""How far a sweep is, found in one look at the names in its folder."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

from gfmdlayer.config.sweeps import count
from gfmdlayer.execution.folder import Folder, read_json
from gfmdlayer.execution.listing import numbers
from gfmdlayer.execution.status_file import Running, running

LOOKED_AT = 1000  # records of failures that are read to tell why
_NUMBER = re.compile(r"# Cases: (\d+)\n")  # in the head of the configuration: a long sweep takes long to read


@dataclass(frozen=True)
class Failure:
    """A case on record as failed: its number, why, and its swept values."""

    index: int
    reason: str
    values: Mapping[str, object]


@dataclass(frozen=True)
class Overview:
    """How far a sweep is.

    Attributes
    ----------
    total, complete, failed, waiting : int
        Numbers of cases; those at work are in none but `total`.
    running : list of Running
        The cases at work.
    failures : list of Failure
        The first `LOOKED_AT` of the failed cases.
    """

    total: int
    complete: int
    failed: int
    waiting: int
    running: list[Running]
    failures: list[Failure]

    @property
    def over(self) -> bool:
        """Whether there is nothing to wait for."""
        return not self.running and not self.waiting


def overview(folder: Folder) -> Overview:
    """Look at a results folder; reads the status of cases at work and the records of failed ones, no results.

    Raises
    ------
    FolderError
        Where this is not a results folder.
    """
    total = _number_of_cases(folder)
    found = numbers(folder)
    at_work = running(folder, found["running"])
    busy = {case.index for case in at_work}
    complete = found["h5"] - busy
    failed = found["failed"] - busy - complete
    failures = [_failure(folder, index) for index in sorted(failed)[:LOOKED_AT]]
    waiting = max(0, total - len(complete | failed | busy))
    return Overview(total, len(complete), len(failed), waiting, at_work, failures)


def _number_of_cases(folder: Folder) -> int:
    folder.must_hold_results()
    with folder.config.open(encoding="utf-8") as file:
        file.readline()
        told = _NUMBER.fullmatch(file.readline())
    return int(told[1]) if told else count(folder.stored_sweep())


def _failure(folder: Folder, index: int) -> Failure:
    record = read_json(folder.case(index, "failed")) or {}
    values = record.get("values")
    return Failure(index, str(record.get("reason")), values if isinstance(values, dict) else {})


def alike(failures: list[Failure]) -> list[list[Failure]]:
    """Group failures whose reasons differ in numbers alone, the largest group first."""
    groups: defaultdict[str, list[Failure]] = defaultdict(list)
    for failure in failures:
        groups[re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", failure.reason)].append(failure)
    return sorted(groups.values(), key=len, reverse=True)
