"""The state of a whole sweep from the names of the files in its folder, and the contents of few."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gfmdlayer.files.locks import read_json
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import attributes
from gfmdlayer.study.claims import Running, running
from gfmdlayer.study.folder import Folder

RECORDS_READ = 1000  # of failures, and of early ends, that an overview reads
FILES_READ = 20  # of complete cases, for their warnings


@dataclass(frozen=True)
class Record:
    """A case on record as failed or ended early: its number, why, and its swept values."""

    index: int
    reason: str
    values: Mapping[str, object]


@dataclass(frozen=True)
class Overview:
    """Numbers of cases of a sweep by their state."""

    total: int  # numbers of cases; running ones count only in `total`
    complete: int
    failed: int
    waiting: int
    running: list[Running]  # the running cases
    failures: list[Record]  # the first `RECORDS_READ` failed cases, and complete ones that ended early
    ended: list[Record]
    warnings: list[str]  # of the sweep file, or of the files of the first `FILES_READ` complete cases

    @property
    def over(self) -> bool:
        """Whether no case runs or waits."""
        return not self.running and not self.waiting


def overview(folder: Folder) -> Overview:
    """Count the cases of a results folder by state; opens the sweep file or those of a few cases."""
    numbers, by_kind = folder.case_numbers(), folder.numbers()
    total, own = len(numbers), numbers if isinstance(numbers, range) else set(numbers)
    at_work = running(folder, by_kind["running"])
    busy = {case.index for case in at_work}
    complete = {number for number in by_kind["h5"] - busy if number in own}
    failed = {number for number in by_kind["failed"] - busy - complete if number in own}
    records = [_records(folder, failed, "failed"), _records(folder, by_kind["ended"] & complete, "ended")]
    waiting = max(0, total - len(complete | failed | busy))
    files = [folder.sweep] if folder.sweep.exists() else map(folder.case, sorted(complete)[:FILES_READ])
    failures, ended = records
    said = _warnings(files)
    return Overview(total, len(complete), len(failed), waiting, at_work, failures, ended, said)


def _warnings(files: Iterable[Path]) -> list[str]:
    """Return the warnings in result files, each once."""
    said: list[str] = []
    for file in files:
        with suppress(ResultsError):  # removed or damaged in the meantime
            said += str(attributes(file).get("warnings", "")).splitlines()
    return list(dict.fromkeys(said))


def _records(folder: Folder, numbers: set[int], kind: str) -> list[Record]:
    records = []
    for index in sorted(numbers)[:RECORDS_READ]:
        record = read_json(folder.case(index, kind)) or {}
        values = record.get("values")
        records.append(Record(index, str(record.get("reason")), values if isinstance(values, dict) else {}))
    return records


def group_by_reason(records: list[Record]) -> list[list[Record]]:
    """Group records whose reasons differ only in numbers, the largest group first."""
    groups: defaultdict[str, list[Record]] = defaultdict(list)
    for record in records:
        groups[re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", record.reason)].append(record)
    return sorted(groups.values(), key=len, reverse=True)


def duration(seconds: float) -> str:
    """Write a duration for people: 0.4 s, 12 s, 3 min 20 s, 5 h 10 min, 3 d 4 h."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    for unit, name, part, part_name in ((86400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s")):
        if whole >= unit:
            return f"{whole // unit} {name} {whole % unit // part} {part_name}"
    return f"{whole} s"
