"""Running the cases of a configuration that are not complete yet.

The run claims the folder and finds the complete cases (`growth`). It compiles kernels
once; a pool of processes computes the other cases (`schedule`), each into its own file (`case_run`). At the
end sweep.h5 collects all of them. A case that fails is recorded while the others go on. The results do not
depend on the process that ran a case.

Up to `EXAMINED` cases are made and examined before the first one runs. A longer sweep is known from the
places of its cases, one listing of the folder, and a sample of cases; each case is made in its turn.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean

from gfmdlayer.case.notes import notes
from gfmdlayer.config import Config, ConfigError, digest
from gfmdlayer.config.sweeps import swept_keys
from gfmdlayer.execution import CHECKPOINT_EVERY, growth, interrupts, preflight
from gfmdlayer.execution.case_run import record_failure, run_case, warm_up
from gfmdlayer.execution.cost import SAMPLE, CostModel, estimate
from gfmdlayer.execution.folder import WAYS_OUT, Folder, FolderError, Numbers
from gfmdlayer.execution.groups import refuse_other_ranks, run_case_together
from gfmdlayer.execution.growth import claimed, refuse_open_files, set_damaged_aside
from gfmdlayer.execution.progress import Display, Reporter
from gfmdlayer.execution.schedule import Outcome, Schedule, State
from gfmdlayer.execution.sweep import Cases, InTurn, OwnCases, Shard, SweepCase, examined
from gfmdlayer.execution.workers import WorkerPool
from gfmdlayer.files.locks import exclusive, read_json
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import attributes, is_complete


@dataclass(frozen=True)
class RunOptions:
    """How cases are run."""

    restart: bool = False  # remove earlier results first
    # run the cases that are recorded as failed, and leave the others that are not complete
    only_failed: bool = False
    # run these cases alone, while other runs may compute others; the last to end writes the sweep file
    shard: Shard | None = None
    threads: int = 1  # threads that the transforms of a case may use
    checkpoint_every: float = CHECKPOINT_EVERY  # seconds between two checkpoints of a case
    ranks_per_case: int = 1  # ranks that compute a case together


@dataclass(frozen=True)
class Summary:
    """Outcomes of a run."""

    # number of cases of the run or of its shard in each state, those complete before included
    states: Mapping[State, int]
    failures: Sequence[Outcome]  # the cases that failed, by their numbers
    collected: bool  # whether the sweep file was written: no case waits any more, in any shard
    # lines on the sweep file: columns that some cases lack, cases of different versions
    notes: tuple[str, ...] = ()

    def count(self, state: State) -> int:
        """Return the number of cases in a state."""
        return self.states.get(state, 0)

    @property
    def total(self) -> int:
        """Number of cases."""
        return sum(self.states.values())


class _Work:
    """The cases of a run by their state, from one listing of the folder.

    In a very long sweep, only a sample of the complete files is read before the run, and the others after it.
    """

    def __init__(self, folder: Folder, files: Numbers, own: OwnCases, only_failed: bool) -> None:
        self.own, self._folder, self._only_failed, self._found = own, folder, only_failed, files
        present = array("q", (at for at, i in enumerate(own.indices) if i in self._found["h5"]))
        self._read = frozenset(examined(present, SAMPLE) if own.many else present)
        self._damaged = frozenset(at for at in sorted(self._read) if not _is_done(own[at], folder))
        self.complete = len(present) - len(self._damaged)  # number of cases
        # Of these, those that are taken to be so until the others have run.
        self.unread = 0 if only_failed else len(present) - len(self._read)
        places = array("q", self.places())
        self.todo = len(places)  # number of cases to be run
        self.waiting = len(own) - self.complete - self.todo  # number of cases that are not to be run
        self.some = [own[at] for at in examined(places)]  # cases to be run, or some of very many
        numbers = (own.indices[at] for at in places)
        self.begun = [number for number in numbers if number in self._found["checkpoint"]]

    def places(self) -> Iterator[int]:
        """Yield the places in `own` of the cases to be run."""
        complete, failed = self._found["h5"], self._found["failed"]
        for at, number in enumerate(self.own.indices):
            undone = number not in complete or at in self._damaged
            if undone and (number in failed or not self._only_failed):
                yield at

    @property
    def done(self) -> list[SweepCase]:
        """The complete cases, or some of very many."""
        return [self.own[at] for at in sorted(self._read - self._damaged)]

    @property
    def damaged(self) -> list[int]:
        """Numbers of cases to be run whose files are damaged."""
        return [self.own.indices[at] for at in sorted(self._damaged)]

    def damaged_later(self) -> Iterator[SweepCase]:
        """Read the files of complete cases that were not read before; yield the cases of damaged ones."""
        for at, number in enumerate(self.own.indices):
            if interrupts.stop_requested():
                return
            if number in self._found["h5"] and at not in self._read:
                case = self.own[at]
                if not _is_done(case, self._folder):
                    yield case


def run_sweep(
    config: Config,
    directory: str | Path,
    pool: WorkerPool,
    options: RunOptions | None = None,
    display: Callable[[], Display] | None = None,
) -> Summary:
    """Run the cases of a configuration that are not complete yet, and collect all of them.

    ConfigError for impossible values, FolderError where the folder or a file in it cannot be used, and
    ResultsError where the sweep file cannot be written.
    """
    options = options or RunOptions()
    folder = Folder(Path(directory), options.shard)
    every = Cases(config)
    with interrupts.at_once():
        own = OwnCases(every, options.shard)
    with claimed(folder, config, options.restart, own.indices) as found:
        files = folder.numbers()
        own = own.numbered(found.numbers)
        own = own.each(growth.with_inputs(folder, found.changed))
        if options.ranks_per_case == 1:
            own = own.each(growth.with_earlier(folder, files, _of_no_use(config, own, found.numbers)))
        work = _Work(folder, files, own, options.only_failed)
        refuse_open_files(folder, work.damaged)
        _refuse_too_large(work, work.some, pool, options)
        refuse_other_ranks(folder, work.begun, options.ranks_per_case)

        ended: Counter[State] = Counter()
        failed: dict[int, Outcome] = {}
        lines = growth.lines(files, found, own.indices, own.examined) if found.changed else []
        for outcome in _computed(work, folder, pool, options, display, lines):
            ended[outcome.state] += 1
            if outcome.state == "failed":
                failed[outcome.index] = outcome
        ended["stopped"] = work.todo - ended["complete"] - ended["failed"]
        ended["complete"] += work.complete
        ended["waiting"] = work.waiting

        collected = None
        if not ended["stopped"] and not ended["waiting"]:
            collected = _collect(config, folder, every, found.numbers, own, failed)
        said, lost = collected or ([], [])
        ended["complete"] -= sum(outcome.index in own.numbers for outcome in lost)
        ended["failed"] += len(lost)
        failed |= {outcome.index: outcome for outcome in lost}
    failures = [failed[number] for number in sorted(failed)]
    return Summary(ended, failures, collected is not None, tuple(said))


def _of_no_use(config: Config, own: OwnCases, numbers: Sequence[int]) -> Collection[int]:
    """Return the cases of a very long sweep, if none of them can go on from the state of another of them."""
    beyond = [key for key in swept_keys(config.sweep) if key.partition(".")[0] in {"time", "output"}]
    if beyond or not own.many:
        return ()
    return numbers if isinstance(numbers, range) else frozenset(numbers)


def _computed(
    work: _Work,
    folder: Folder,
    pool: WorkerPool,
    options: RunOptions,
    display: Callable[[], Display] | None,
    lines: Sequence[str],
) -> Iterator[Outcome]:
    """Compute the cases that are to be run; yield the outcome of each, which the display shows too."""
    model = CostModel.of_files({folder.case(case.index): case.config for case in work.done})
    expected = {case.index: model.seconds(case.config) for case in work.some}
    whole = fmean(expected.values()) * work.todo if expected else 0.0
    values: dict[int, Mapping[str, object]] = {case.index: case.values for case in work.some}
    with Reporter(folder, work.own.numbers, work.complete, display, expected, pool.size, whole) as reporter:
        aside = set_damaged_aside(folder, work.damaged)
        for line in (_opening(work, pool, options), *_warnings(work, pool, folder), *lines, *aside):
            reporter.note(line)
        _prepare(work.some, reporter)
        task = partial(
            run_case if options.ranks_per_case == 1 else run_case_together,
            folder=folder,
            threads=options.threads,
            checkpoint_every=options.checkpoint_every,
        )
        schedule = Schedule(pool, task, folder, reporter.ended)
        reporter.at_work = schedule.at_work

        def ended(items: Iterable[SweepCase | Outcome]) -> Iterator[Outcome]:
            for outcome in schedule.run(items):
                expected.pop(outcome.index, None)
                own = values.pop(outcome.index, None)
                if own is not None and outcome.state == "failed":
                    record_failure(folder, outcome.index, own, outcome.reason)
                yield outcome

        def in_turn() -> Iterator[SweepCase | Outcome]:
            """Yield the cases to be run, each made in its turn, or the outcome of an impossible one."""
            largest = 0.0
            for at in work.places():
                if interrupts.stop_requested():
                    return
                number = work.own.indices[at]
                values[number] = work.own.values(at)
                try:
                    case = work.own[at]
                    if (memory := estimate(case.config).memory) > largest:
                        _refuse_too_large(work, [case], pool, options)
                        largest = memory
                    expected[number] = model.seconds(case.config)
                except Exception as error:
                    yield Outcome(number, "failed", f"{type(error).__name__}: {error}")
                else:
                    yield case

        yield from ended(in_turn() if work.own.many else _ordered(work.some, expected, pool))
        if work.unread and not interrupts.stop_requested():
            reporter.note(f"reading the {work.unread} complete cases that were not read before the run")
            later = {case.index: case for case in work.damaged_later()}
            values |= {case.index: case.values for case in later.values()}
            work.complete, work.todo = work.complete - len(later), work.todo + len(later)
            reporter.complete_no_more(len(later))
            for line in set_damaged_aside(folder, later):
                reporter.note(line)
            yield from ended(later.values())


def _prepare(todo: Sequence[SweepCase], reporter: Reporter) -> None:
    """Compile; a request to stop ends it at once, and then the cases before their first step."""
    configs = (case.config for case in todo)
    chosen = dict.fromkeys(each.contact_solver.method for each in configs if each.geometry.on_grid)
    solvers = f": contact solver {', '.join(chosen)}" if chosen else ""
    work = f"compiling kernels, once per machine (about 20 s){solvers}"
    said: list[str] = []
    with suppress(KeyboardInterrupt), reporter.preparing(work), interrupts.at_once():
        said = warm_up(todo)
    for line in said if not interrupts.stop_requested() else ():
        reporter.note(f"warning: {line}")


def _is_done(case: SweepCase, folder: Folder) -> bool:
    path = folder.case(case.index)
    if not is_complete(path):
        return False
    if attributes(path).get("digest") != digest(case.config):
        raise FolderError(f"{path}: was computed from other input (has a file changed?); {WAYS_OUT}")
    return True


def _refuse_too_large(work: _Work, cases: Iterable[SweepCase], pool: WorkerPool, options: RunOptions) -> None:
    """Refuse cases that need more memory than this job may have, of which there is other `work` too."""
    largest = max((estimate(case.config).memory for case in cases), default=0.0) / options.ranks_per_case
    number = min(pool.size, work.todo) if pool.kind == "processes" else 1
    if refused := preflight.memory_refusal(largest, number):
        raise ConfigError(refused)


def _opening(work: _Work, pool: WorkerPool, options: RunOptions) -> str:
    number = len(work.own)
    cases = "1 case" if number == 1 else f"{number} cases"
    part = "" if options.shard is None else f" in shard {options.shard}"
    before = f", {work.complete} complete already" if work.complete else ""
    before += f", {work.todo} to be run" if work.waiting else ""
    each = "one thread" if options.threads == 1 else f"{options.threads} threads"
    return f"{cases}{part}{before}; {pool.size} {pool.kind}, {each} each"


def _warnings(work: _Work, pool: WorkerPool, folder: Folder) -> list[str]:
    storage = sum(estimate(case.config).storage for case in work.some)
    space = preflight.disk_warnings(folder.path, storage * work.todo / max(len(work.some), 1))
    found = (*notes(case.config for case in work.own.examined), *pool.warnings, *space)
    return [f"warning: {warning}" for warning in found]


def _ordered(
    todo: Sequence[SweepCase], seconds: Mapping[int, float], pool: WorkerPool
) -> Sequence[SweepCase]:
    """Put the longest cases first; a single process keeps their order."""
    if pool.alone:
        return todo
    return sorted(todo, key=lambda case: (-seconds[case.index], case.index))


class _Records(InTurn[CaseRecord]):
    """The cases for the sweep file, each made when it is asked for: very many differ in little."""

    def __init__(
        self, folder: Folder, every: Cases, numbers: Sequence[int], reasons: Mapping[int, str]
    ) -> None:
        self._folder, self._every, self._numbers, self._reasons = folder, every, numbers, reasons

    def __len__(self) -> int:
        return len(self._numbers)

    def _at(self, place: int) -> CaseRecord:
        number = self._numbers[place]
        values, reason = self._every.values(place), self._reasons.get(number)
        return CaseRecord(number, self._folder.case(number), values, reason)


def _collect(
    config: Config,
    folder: Folder,
    every: Cases,
    numbers: Sequence[int],
    own: OwnCases,
    failed: Mapping[int, Outcome],
) -> tuple[list[str], list[Outcome]] | None:
    """Write the sweep file; return notes, and cases that cannot be read; None while shards are at work."""
    try:
        with exclusive(folder.turn):
            reasons = {number: outcome.reason for number, outcome in failed.items()}
            complete = folder.numbers()["h5"]
            for number in numbers:
                if number not in complete and number not in own.numbers:
                    record = read_json(folder.case(number, "failed"))
                    if record is None:
                        return None
                    reasons[number] = str(record.get("reason"))
            records = _Records(folder, every, numbers, reasons)
            swept = Swept.of(config.sweep, config.unit, config.output.times)
            path = collect(folder.path, records, swept)
            found = attributes(path)
            named = (line.partition(": ") for line in str(found["failed"]).splitlines())
            unusable = {int(number): reason for number, _, reason in named if number.isdecimal()}
            lost = [Outcome(i, "failed", reason) for i, reason in unusable.items() if i not in reasons]
            return str(found["notes"]).splitlines(), lost
    except PermissionError as error:  # lost during the run
        raise ResultsError(f"{folder.sweep}: cannot be written: {error.strerror}") from error
