"""Running the cases of a configuration that are not complete yet: a study is a folder of cases.

The life of a case: it is *missing* from the folder (`folder`, `growth`), and made from its place in the sweep
(`cases`). A process of the pool (`schedule`, `workers`) *claims* it (`claims`), and *computes* it with
checkpoints into its own file, *written* whole under its number (`case_run`). Several runs may share the
folder: each computes the cases that no other has claimed. A case that fails is recorded while the others go
on. The run that sees all cases complete or failed collects them in sweep.h5. The results do not depend on the
process that ran a case.

A sweep of up to `BLOCK` cases is made before its first case runs, and its complete files are read then. Of a
longer one blocks are made in turn; complete files are read after the others have run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

from gfmdlayer.case.notes import accounts, notes
from gfmdlayer.config import Config, ConfigError, digest
from gfmdlayer.config.sweeps import swept_keys
from gfmdlayer.files.locks import read_json
from gfmdlayer.files.whole import synchronise, write_text
from gfmdlayer.results.accuracy import worst_accuracy
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import attributes, is_complete
from gfmdlayer.study import CHECKPOINT_EVERY, growth, interrupts, preflight
from gfmdlayer.study.case_run import record_failure, run_case, warm_up
from gfmdlayer.study.cases import WHOLE, Cases, Shard, SweepCase
from gfmdlayer.study.claims import running
from gfmdlayer.study.cost import CostModel, expected_seconds
from gfmdlayer.study.folder import WAYS_OUT, Folder, FolderError, name_of_run
from gfmdlayer.study.groups import refuse_other_ranks, run_case_together
from gfmdlayer.study.progress import Display, Reporter
from gfmdlayer.study.schedule import Outcome, Schedule, State
from gfmdlayer.study.workers import WorkerPool


@dataclass(frozen=True)
class RunOptions:
    """How cases are run."""

    restart: bool = False  # remove earlier results first
    # run the cases that are recorded as failed, and leave the others that are not complete
    only_failed: bool = False
    shard: Shard | None = None  # where the run starts, so that it seldom meets others
    threads: int | None = 1  # threads that the transforms of a case may use; None: by its size
    checkpoint_every: float = CHECKPOINT_EVERY  # seconds between two checkpoints of a case
    ranks_per_case: int = 1  # ranks that compute a case together


@dataclass(frozen=True)
class Summary:
    """Outcomes of a run."""

    states: Mapping[State, int]  # number of cases in each state, those complete before included
    failures: Sequence[Outcome]  # the cases that failed, by their numbers
    collected: bool  # whether the sweep file was written: no case waits any more
    # lines on the sweep file: columns that some cases lack, cases of different versions
    notes: tuple[str, ...] = ()

    def count(self, state: State) -> int:
        """Return the number of cases in a state."""
        return self.states.get(state, 0)

    @property
    def total(self) -> int:
        """Number of cases."""
        return sum(self.states.values())


def run_study(
    config: Config | Cases,
    directory: str | Path,
    pool: WorkerPool,
    options: RunOptions | None = None,
    display: Callable[[], Display] | None = None,
) -> Summary:
    """Run the cases of a configuration that are not complete yet, and collect all of them.

    ConfigError for impossible values, FolderError where the folder or a file in it cannot be used, and
    ResultsError where the sweep file cannot be written.
    """
    folder = Folder(Path(directory), name_of_run())
    options = options or RunOptions()
    cases = config if isinstance(config, Cases) else Cases(config)
    with interrupts.at_once():
        cases.sample()
    with growth.opened(folder, cases, options.restart) as grown:
        return Study(folder, cases, grown, pool, options).run(display)


class Study:
    """A run of the cases that are missing in an opened folder."""

    def __init__(
        self, folder: Folder, cases: Cases, grown: growth.Growth, pool: WorkerPool, options: RunOptions
    ) -> None:
        self._folder, self._cases, self._growth, self._pool = folder, cases, grown, pool
        self._options, self._numbers, self._shard = options, grown.numbers, options.shard or WHOLE
        self._files = folder.numbers()
        self._changes = [grown.numbered, growth.with_inputs(folder, grown.changed)]
        if options.ranks_per_case == 1:
            self._changes.append(growth.with_earlier(folder, self._files, self._of_no_use()))
        self._sample = [self._changed(case) for case in cases.sample()]
        self._damaged: set[int] = set()  # numbers of cases whose files are damaged
        self._expected: dict[int, float] = {}  # seconds of the cases to be run, by number
        self._ended: dict[int, Outcome] = {}  # of cases that have failed or are at work elsewhere
        self._counts: Counter[State] = Counter()

    def run(self, display: Callable[[], Display] | None) -> Summary:
        """Run the missing cases, and write the sweep file where none is missing any more."""
        folder, options, sample = self._folder, self._options, self._sample
        present = [case for case in sample if case.index in self._files["h5"]]
        done = present if self._cases.are_many else [case for case in present if self._is_done(case)]
        some = [case for case in sample if self._is_missing(case.index)]
        folder.refuse_open_files(self._damaged)
        if refused := self._too_large(some):
            raise ConfigError(refused)
        begun = [number for number in self._files["checkpoint"] if self._is_missing(number)]
        refuse_other_ranks(folder, begun, options.ranks_per_case)
        complete = sum(number in self._files["h5"] for number in self._numbers) - len(self._damaged)
        missing = sum(map(self._is_missing, self._numbers))
        self._counts["complete"] = complete
        self._counts["waiting"] = len(self._numbers) - complete - missing

        self._model = CostModel.of_files({folder.case(case.index): case.config for case in done})
        self._expected.update((case.index, self._seconds(case)) for case in some)
        whole = fmean(self._expected.values()) * missing if some else 0.0
        own = self._numbers if isinstance(self._numbers, range) else frozenset(self._numbers)
        aside = folder.set_damaged_aside(sorted(self._damaged))
        with Reporter(folder, own, complete, display, self._expected, self._pool.size, whole) as reporter:
            for line in (*self._opening(complete, missing), *self._warnings(some, missing), *aside):
                reporter.note(line)
            self._prepare(some, reporter)
            task = partial(
                run_case if options.ranks_per_case == 1 else run_case_together,
                folder=folder,
                threads=options.threads,
                checkpoint_every=options.checkpoint_every,
            )
            schedule = Schedule(self._pool, task, folder, reporter.ended)
            reporter.at_work = schedule.at_work
            self._compute(schedule, self._missing())
            later = self._cases.are_many and complete and not options.only_failed
            if later and not interrupts.stop_requested():
                reporter.note(f"reading the {complete} cases that were complete before the run")
                self._compute(schedule, self._damaged_in_time(reporter))
            while again := self._given_back():
                self._compute(schedule, again)
        return self._concluded()

    # The missing cases.

    def _changed(self, case: SweepCase) -> SweepCase:
        for change in self._changes:
            case = change(case)
        return case

    def _place(self, number: int) -> int:
        return number if isinstance(self._numbers, range) else self._numbers.index(number)

    def _of_no_use(self) -> Collection[int]:
        """Return the numbers of the sweep, if none of its cases can go on from the state of another."""
        beyond = [key.partition(".")[0] for key in swept_keys(self._cases.config.sweep)]
        if not {"time", "output"}.isdisjoint(beyond):
            return ()
        return self._numbers if isinstance(self._numbers, range) else frozenset(self._numbers)

    def _is_missing(self, number: int) -> bool:
        """Whether a case is to be run."""
        undone = number not in self._files["h5"] or number in self._damaged
        return undone and (number in self._files["failed"] or not self._options.only_failed)

    def _is_done(self, case: SweepCase) -> bool:
        path = self._folder.case(case.index)
        if not is_complete(path):
            self._damaged.add(case.index)
            return False
        if attributes(path).get("digest") != digest(case.config):
            raise FolderError(f"{path}: was computed from other input (has a file changed?); {WAYS_OUT}")
        return True

    def _missing(self) -> Iterator[SweepCase | Outcome]:
        """Yield the cases to be run, or the outcomes of those that are impossible or complete by now."""
        for block in self._shard.blocks(len(self._cases)):
            todo = []
            for place in block:
                if interrupts.stop_requested():
                    return
                number = self._numbers[place]
                if not self._is_missing(number):
                    continue
                if (known := self._elsewhere(number)) is not None:
                    yield known
                    continue
                try:
                    case = self._made(place)
                except Exception as error:
                    yield Outcome(number, "failed", f"{type(error).__name__}: {error}")
                else:
                    todo.append(case)
            yield from self._ordered(todo)

    def _made(self, place: int) -> SweepCase:
        case = self._changed(self._cases[place])
        if self._cases.are_many and (refused := self._too_large([case])):
            raise ConfigError(refused)
        if case.index not in self._expected:
            self._expected[case.index] = self._seconds(case)
        return case

    def _seconds(self, case: SweepCase) -> float:
        return expected_seconds(case.config, cost=case.cost) * self._model.factor(case.config)

    def _ordered(self, todo: list[SweepCase]) -> Sequence[SweepCase]:
        """Put the longest cases first; a single process keeps their order."""
        if not self._pool.alone:
            todo = sorted(todo, key=lambda case: (-self._expected[case.index], case.index))
        return self._shard.order(todo)

    def _damaged_in_time(self, reporter: Reporter) -> Iterator[SweepCase]:
        """Read the files of complete cases; yield the cases of damaged ones."""
        for place, number in enumerate(self._numbers):
            if interrupts.stop_requested():
                return
            if number in self._files["h5"]:
                case = self._changed(self._cases[place])
                if not self._is_done(case):
                    for line in self._folder.set_damaged_aside([number]):
                        reporter.note(line)
                    self._counts["complete"] -= 1
                    reporter.complete_no_more(1)
                    yield case

    # Other runs in the folder.

    def _elsewhere(self, number: int) -> Outcome | None:
        """Return the outcome of a case that another run has ended since this one began, or None."""
        if self._folder.case(number).exists():
            return Outcome(number, "complete", here=False)
        if number not in self._files["failed"]:
            record = read_json(self._folder.case(number, "failed"))
            if record is not None:
                return Outcome(number, "failed", str(record.get("reason")), here=False)
        return None

    def _given_back(self) -> list[SweepCase | Outcome]:
        """Return the cases that other runs had claimed and have not any more."""
        taken = [number for number, each in self._ended.items() if each.state == "elsewhere"]
        if not taken or interrupts.stop_requested():
            return []
        busy = {claim.index for claim in running(self._folder, taken)}
        back: list[SweepCase | Outcome] = []
        for number in taken:
            known = self._elsewhere(number)
            if known is not None or number not in busy:
                del self._ended[number]
                back.append(known or self._changed(self._cases[self._place(number)]))
        return back

    # The work, and words on it.

    def _compute(self, schedule: Schedule, items: Iterable[SweepCase | Outcome]) -> None:
        for outcome in schedule.run(items):
            self._expected.pop(outcome.index, None)
            if outcome.state == "complete":
                self._counts["complete"] += 1
            elif outcome.state != "stopped":
                self._ended[outcome.index] = outcome
                if outcome.state == "failed":  # also where its process could not record it
                    values = self._cases.values(self._place(outcome.index))
                    record_failure(self._folder, outcome.index, values, outcome.reason)

    def _too_large(self, cases: Iterable[SweepCase]) -> list[str]:
        """Return why cases cannot have the memory that they need beside each other."""
        memory = max((case.cost.memory for case in cases), default=0.0) / self._options.ranks_per_case
        number = min(self._pool.size, len(self._numbers)) if self._pool.kind == "processes" else 1
        return preflight.memory_refusal(memory, number)

    def _prepare(self, todo: Sequence[SweepCase], reporter: Reporter) -> None:
        """Compile; a request to stop ends it at once, and then the cases before their first step."""
        configs = (case.config for case in todo)
        chosen = dict.fromkeys(config.contact_solver.method for config in configs if config.geometry.on_grid)
        solvers = f": contact solver {', '.join(chosen)}" if chosen else ""
        work = f"compiling kernels, once per machine (about 20 s){solvers}"
        said: list[str] = []
        stepwise = self._options.checkpoint_every == 0 or self._options.ranks_per_case > 1
        with suppress(KeyboardInterrupt), reporter.preparing(work), interrupts.at_once():
            said = warm_up(todo, stepwise=stepwise)
        for line in said if not interrupts.stop_requested() else ():
            reporter.note(f"warning: {line}")

    def _opening(self, complete: int, missing: int) -> Iterator[str]:
        number, threads = len(self._numbers), self._options.threads
        if threads is None:
            from gfmdlayer.grid.fftw import threads_for

            grids = (case.config.grid for case in self._sample if case.config.geometry.on_grid)
            threads = max((threads_for(grid.points, None) for grid in grids), default=1)
        cases = "1 case" if number == 1 else f"{number} cases"
        before = f", {complete} complete already" if complete else ""
        before += f", {missing} to be run" if self._counts["waiting"] else ""
        before += f", starting as {self._shard}" if self._shard != WHOLE else ""
        own = "one thread" if threads == 1 else f"{threads} threads"
        yield f"{cases}{before}; {self._pool.size} {self._pool.kind}, {own} each"
        if self._growth.changed:
            yield from growth.lines(self._files, self._growth, self._sample)

    def _warnings(self, some: Sequence[SweepCase], missing: int) -> Iterator[str]:
        storage = sum(case.cost.storage for case in some) * missing / max(len(some), 1)
        space = preflight.disk_warnings(self._folder.path, storage)
        yield from (f"read {line}" for line in accounts(case.config for case in self._sample))
        said = notes(case.config for case in self._sample)
        yield from (f"warning: {warning}" for warning in (*said, *self._pool.warnings, *space))

    def _concluded(self) -> Summary:
        """Write the sweep file, if no case is missing any more."""
        if not self._folder.is_there:
            raise ResultsError(
                f"{self._folder.path}: was removed during the run; the same command starts over"
            )
        if not self._folder.config.exists():
            self._folder.store(self._cases.config, self._numbers)
        counts = self._counts + Counter(outcome.state for outcome in self._ended.values())
        counts["stopped"] = len(self._numbers) - counts.total()
        said: list[str] | None = None
        if not (counts["stopped"] or counts["waiting"] or counts["elsewhere"]):
            said, lost = self._collect()
            for outcome in lost:
                counts["complete"] -= 1
                counts["failed"] += 1
                self._ended[outcome.index] = outcome
        failures = [outcome for _, outcome in sorted(self._ended.items()) if outcome.state == "failed"]
        return Summary(counts, failures, said is not None, tuple(said or ()))

    def _collect(self) -> tuple[list[str], list[Outcome]]:
        """Write the sweep file; return notes, and cases that cannot be read."""
        reasons = {number: outcome.reason for number, outcome in self._ended.items()}
        records = _Records(self._folder, self._cases, self._numbers, reasons)
        config = self._cases.config
        self._bring_to_the_disk()
        try:
            path = collect(
                self._folder.path, records, Swept.of(config.sweep, config.unit, config.output.row_times)
            )
            collected = attributes(path)
            if said := str(collected.get("warnings", "")):
                write_text(self._folder.warnings, f"{said}\n", durable=False)
            else:
                self._folder.warnings.unlink(missing_ok=True)
            write_text(self._folder.accuracy, f"{', '.join(worst_accuracy(path))}\n", durable=False)
        except PermissionError as error:  # lost during the run
            raise ResultsError(f"{self._folder.sweep}: cannot be written: {error.strerror}") from error
        named = (line.partition(": ") for line in str(collected["failed"]).splitlines())
        unusable = {int(number): reason for number, _, reason in named if number.isdecimal()}
        lost = [Outcome(i, "failed", reason) for i, reason in unusable.items() if i not in reasons]
        return str(collected["notes"]).splitlines(), lost

    def _bring_to_the_disk(self) -> None:
        """Wait until the files of short cases are on the disk, which their processes did not."""
        for path in (*map(self._folder.case, self._numbers), self._folder.cases):
            with suppress(OSError):  # a case has failed, or the file system refuses
                synchronise(path)


class _Records(Sequence[CaseRecord]):
    """The cases for the sweep file, each made when it is asked for: very many differ in little."""

    def __init__(
        self, folder: Folder, cases: Cases, numbers: Sequence[int], reasons: Mapping[int, str]
    ) -> None:
        self._folder, self._cases, self._numbers, self._reasons = folder, cases, numbers, reasons

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, place: Any) -> Any:
        number = self._numbers[place]
        values, reason = self._cases.values(place), self._reasons.get(number)
        return CaseRecord(number, self._folder.case(number), values, reason)
