"""The state of a whole sweep from the names of the files in its folder, and the contents of few."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from gfmdlayer.files.locks import read_json
from gfmdlayer.files.whole import is_intact
from gfmdlayer.study.claims import Running, running
from gfmdlayer.study.folder import Folder

RECORDS_READ = 1000  # of failures, and of early ends, that an overview reads
FILES_VERIFIED, BYTES_VERIFIED = 1000, 1 << 28  # of complete cases, the first of them


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
    warnings: list[str]  # of complete cases
    damaged: list[int]  # cases, of those whose files were verified: neither complete nor waiting
    accuracy: str  # the worst of each number on the accuracy of the cases in the sweep file

    @property
    def over(self) -> bool:
        """Whether no case runs or waits."""
        return not self.running and not self.waiting


def overview(folder: Folder, *, verify: bool = False) -> Overview:
    """Count the cases of a results folder by state; opens no result file.

    `verify` also reads the files of complete cases, as many as a second reads.
    """
    numbers, by_kind = folder.case_numbers(), folder.numbers()
    total, own = len(numbers), numbers if isinstance(numbers, range) else set(numbers)
    at_work = running(folder, by_kind["running"])
    busy = {case.index for case in at_work}
    complete = {number for number in by_kind["h5"] - busy if number in own}
    failed = {number for number in by_kind["failed"] - busy - complete if number in own}
    failures, ended = (
        _records(folder, failed, "failed"),
        _records(folder, by_kind["ended"] & complete, "ended"),
    )
    waiting = max(0, total - len(complete | failed | busy))
    damaged = list(_damaged(folder, sorted(complete))) if verify else []
    complete.difference_update(damaged)
    said, worst = list[str](), ""
    with suppress(OSError):  # there are none
        said = [*dict.fromkeys(folder.warnings.read_text(encoding="utf-8", errors="replace").splitlines())]
    if folder.sweep.exists():
        with suppress(OSError):
            worst = folder.accuracy.read_text(encoding="utf-8", errors="replace").strip()
    return Overview(
        total, len(complete), len(failed), waiting, at_work, failures, ended, said, damaged, worst
    )


def _damaged(folder: Folder, complete: list[int]) -> Iterator[int]:
    """Yield the cases whose files hold other bytes than were written, of as many as a second reads."""
    left = BYTES_VERIFIED
    for index in complete[:FILES_VERIFIED]:
        path = folder.case(index)
        with suppress(OSError):  # removed, or not readable for this user
            state = path.stat()
            if (left := left - state.st_size) < 0:
                return
            if not _is_sound(path, state.st_mtime_ns, state.st_size):
                yield index


@lru_cache(maxsize=4 * FILES_VERIFIED)
def _is_sound(path: Path, _changed: int, _size: int) -> bool:
    return is_intact(path) is not False


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
