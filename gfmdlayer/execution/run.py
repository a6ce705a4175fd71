"""Running the cases of a configuration that are not complete yet.

The run claims the folder and finds the complete cases (`growth`). It compiles kernels and plans transforms
once; a pool of processes computes the other cases (`schedule`), each into its own file (`case_run`). At the
end sweep.h5 collects all of them. A case that fails is recorded while the others go on. The results do not
depend on the process that ran a case: all processes compute with the same FFTW wisdom.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gfmdlayer.config import Config, ConfigError, digest
from gfmdlayer.config.sweeps import is_listed, sampling, swept_keys
from gfmdlayer.execution import CHECKPOINT_EVERY, growth, interrupts, preflight
from gfmdlayer.execution.case_run import Wisdom, record_failure, run_case, warm_up
from gfmdlayer.execution.cost import CostModel, estimate
from gfmdlayer.execution.folder import WAYS_OUT, Folder, FolderError
from gfmdlayer.execution.groups import refuse_other_ranks, run_case_together
from gfmdlayer.execution.growth import claimed, refuse_open_files, set_damaged_aside
from gfmdlayer.execution.progress import Display, Reporter
from gfmdlayer.execution.schedule import Outcome, Schedule
from gfmdlayer.execution.sweep import Cases, Shard, SweepCase, own_cases
from gfmdlayer.execution.workers import WorkerPool
from gfmdlayer.files.locks import exclusive, read_json
from gfmdlayer.notes import notes


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

    # of all cases of the run or of its shard, in their order, those complete before included
    outcomes: tuple[Outcome, ...]
    collected: bool  # whether the sweep file was written: no case waits any more, in any shard
    # lines on the sweep file: columns that some cases lack, cases of different versions
    notes: tuple[str, ...] = ()

    def count(self, state: str) -> int:
        """Return the number of cases in a state."""
        return sum(outcome.state == state for outcome in self.outcomes)

    @property
    def failures(self) -> list[Outcome]:
        """The cases that failed."""
        return [outcome for outcome in self.outcomes if outcome.state == "failed"]


@dataclass(frozen=True)
class _Work:
    """The cases of a run: `own` by its shard, `undone` of these, `todo` of these now."""

    own: Sequence[SweepCase]
    undone: Sequence[SweepCase]
    todo: Sequence[SweepCase]


def run_sweep(
    config: Config,
    directory: str | Path,
    pool: WorkerPool,
    options: RunOptions | None = None,
    display: Callable[[], Display] | None = None,
) -> Summary:
    """Run the cases of a configuration that are not complete yet, and collect all of them.

    `display` makes the display of progress once the folder is claimed; by default nothing is shown. Raises
    ConfigError for impossible values, FolderError where the folder or a file in it cannot be used, and
    ResultsError where the sweep file cannot be written.
    """
    options = options or RunOptions()
    folder = Folder(Path(directory), options.shard)
    made = Cases(config)
    own: Sequence[SweepCase] = own_cases(made, options.shard)
    with claimed(folder, config, options.restart, [case.index for case in own]) as found:
        every = found.numbered(made)  # of a shard only its own are kept
        own = growth.with_inputs(folder, found.numbered(own), found.changed)
        if options.ranks_per_case == 1:
            own = growth.with_earlier(folder, own)
        work = _find_work(folder, own, options.only_failed)
        refuse_open_files(folder, [case.index for case in work.todo])
        _refuse_too_large(work.todo, pool, options)
        refuse_other_ranks(folder, work.todo, options.ranks_per_case)

        outcomes = {case.index: Outcome(case.index, "complete") for case in own}
        outcomes |= {case.index: Outcome(case.index, "waiting") for case in work.undone}
        lines = growth.lines(folder, found, own) if found.changed else []
        for outcome in _computed(work, folder, pool, options, display, lines):
            outcomes[outcome.index] = outcome

        collected = None
        if all(outcome.state not in {"stopped", "waiting"} for outcome in outcomes.values()):
            collected = _collect(config, folder, every, outcomes)
        notes, lost = collected or ([], [])
        outcomes |= {outcome.index: outcome for outcome in lost}
    return Summary(tuple(outcomes.values()), collected is not None, tuple(notes))


def _computed(
    work: _Work,
    folder: Folder,
    pool: WorkerPool,
    options: RunOptions,
    display: Callable[[], Display] | None,
    lines: Sequence[str],
) -> Iterator[Outcome]:
    """Compute the cases that are to be run; yield the outcome of each, which the display shows too."""
    seconds, indices = _expected_seconds(work, folder), frozenset(case.index for case in work.own)
    complete = len(work.own) - len(work.undone)
    with Reporter(folder, indices, complete, display, seconds, pool.size) as reporter:
        aside = set_damaged_aside(folder, [case.index for case in work.todo])
        for line in (_opening(work, pool, options), *_warnings(work, pool, folder), *lines, *aside):
            reporter.note(line)
        task = partial(
            run_case if options.ranks_per_case == 1 else run_case_together,
            folder=folder,
            wisdom=_prepare(work.todo, options, folder, reporter),
            threads=options.threads,
            checkpoint_every=options.checkpoint_every,
        )
        schedule = Schedule(pool, task, folder, reporter.ended)
        for outcome in schedule.run(_ordered(work.todo, seconds, pool)):
            if outcome.state == "failed":
                case = next(case for case in work.own if case.index == outcome.index)
                record_failure(folder, case, outcome.reason)
            yield outcome


def _prepare(todo: Sequence[SweepCase], options: RunOptions, folder: Folder, reporter: Reporter) -> Wisdom:
    """Compile and plan; a request to stop ends it at once, and then the cases before their first step."""
    configs = (case.config for case in todo)
    chosen = dict.fromkeys(each.contact_solver.method for each in configs if each.geometry.on_grid)
    solvers = f": contact solver {', '.join(chosen)}" if chosen else ""
    work = f"compiling kernels, planning transforms, once per machine (about 20 s){solvers}"
    wisdom: Wisdom = {}
    said: list[str] = []
    with suppress(KeyboardInterrupt), reporter.preparing(work), interrupts.at_once():
        wisdom, said = warm_up(todo, options.threads, folder.wisdom, plan=options.ranks_per_case == 1)
    for line in said if not interrupts.stop_requested() else ():
        reporter.note(f"warning: {line}")
    return wisdom


def _find_work(folder: Folder, own: Sequence[SweepCase], only_failed: bool) -> _Work:
    found = folder.numbers()
    undone = [case for case in own if case.index not in found["h5"] or not _is_done(case, folder)]
    todo = [case for case in undone if not only_failed or case.index in found["failed"]]
    return _Work(own, undone, todo)


def _is_done(case: SweepCase, folder: Folder) -> bool:
    from gfmdlayer.results.reader import attributes, is_complete

    path = folder.case(case.index)
    if not is_complete(path):
        return False
    if attributes(path).get("digest") != digest(case.config):
        raise FolderError(f"{path}: was computed from other input (has a file changed?); {WAYS_OUT}")
    return True


def _refuse_too_large(todo: Sequence[SweepCase], pool: WorkerPool, options: RunOptions) -> None:
    """Refuse cases that need more memory than this job may have."""
    largest = max((estimate(case.config).memory for case in todo), default=0.0) / options.ranks_per_case
    number = min(pool.size, len(todo)) if pool.kind == "processes" else 1
    if refused := preflight.memory_refusal(largest, number):
        raise ConfigError(refused)


def _opening(work: _Work, pool: WorkerPool, options: RunOptions) -> str:
    number, complete = len(work.own), len(work.own) - len(work.undone)
    cases = "1 case" if number == 1 else f"{number} cases"
    part = "" if options.shard is None else f" in shard {options.shard}"
    before = f", {complete} complete already" if complete else ""
    before += f", {len(work.todo)} to be run" if len(work.todo) < len(work.undone) else ""
    each = "one thread" if options.threads == 1 else f"{options.threads} threads"
    return f"{cases}{part}{before}; {pool.size} {pool.kind}, {each} each"


def _warnings(work: _Work, pool: WorkerPool, folder: Folder) -> list[str]:
    space = preflight.disk_warnings(folder.path, sum(estimate(case.config).storage for case in work.todo))
    found = (*notes(case.config for case in work.own), *pool.warnings, *space)
    return [f"warning: {warning}" for warning in found]


def _expected_seconds(work: _Work, folder: Folder) -> dict[int, float]:
    """Return the expected seconds of the cases to be run, from finished ones."""
    undone = {case.index for case in work.undone}
    done = {folder.case(case.index): case.config for case in work.own if case.index not in undone}
    model = CostModel.of_files(done)
    return {case.index: model.seconds(case.config) for case in work.todo}


def _ordered(
    todo: Sequence[SweepCase], seconds: Mapping[int, float], pool: WorkerPool
) -> Sequence[SweepCase]:
    """Put the longest cases first; a single process keeps their order."""
    if pool.alone:
        return todo
    return sorted(todo, key=lambda case: (-seconds[case.index], case.index))


def _collect(
    config: Config, folder: Folder, every: Sequence[SweepCase], outcomes: dict[int, Outcome]
) -> tuple[list[str], list[Outcome]] | None:
    """Write the sweep file; return notes, and cases that cannot be read; None while shards are at work."""
    from gfmdlayer.results.gathering import CaseRecord, collect
    from gfmdlayer.results.reader import attributes
    from gfmdlayer.results.schema import ResultsError

    try:
        with exclusive(folder.turn):
            reasons = {outcome.index: outcome.reason for outcome in outcomes.values()} | {
                case.index: _failure_reason(folder, case) for case in every if case.index not in outcomes
            }
            if None in reasons.values():
                return None
            records = [
                CaseRecord(case.index, folder.case(case.index), case.values, reasons[case.index] or None)
                for case in every
            ]
            keys, drawn = swept_keys(config.sweep), sampling(config.sweep)
            times = None if "output.times" in keys else config.output.times
            path = collect(folder.path, records, keys, drawn, is_listed(config.sweep), config.unit, times)
            found = attributes(path)
            named = (line.partition(": ") for line in str(found["failed"]).splitlines())
            failed = {int(number): reason for number, _, reason in named if number.isdecimal()}
            lost = [Outcome(i, "failed", reason) for i, reason in failed.items() if reasons.get(i) == ""]
            return str(found["notes"]).splitlines(), lost
    except PermissionError as error:  # lost during the run
        raise ResultsError(f"{folder.sweep}: cannot be written: {error.strerror}") from error


def _failure_reason(folder: Folder, case: SweepCase) -> str | None:
    """Return why another shard's case failed; empty where it is complete, None where it has not ended."""
    if folder.case(case.index).exists():
        return ""
    record = read_json(folder.case(case.index, "failed"))
    return None if record is None else str(record.get("reason"))
