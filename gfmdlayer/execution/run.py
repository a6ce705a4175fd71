"""Running the cases of a configuration that are not complete yet.

Cases are independent: each writes its own file, and one that fails is recorded while the others go on. The
results do not depend on the process that ran a case: all processes compute with the same FFTW wisdom.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path

from gfmdlayer.config import Config, ConfigError, digest
from gfmdlayer.config.sweeps import is_listed, sampling, swept_keys
from gfmdlayer.execution import CHECKPOINT_EVERY, growth, interrupts, preflight
from gfmdlayer.execution.case_run import Wisdom, record_failure, run_case, warm_up
from gfmdlayer.execution.cost import CostModel, estimate
from gfmdlayer.execution.folder import WAYS_OUT, Folder, FolderError
from gfmdlayer.execution.groups.pool import refuse_other_ranks, run_case_together
from gfmdlayer.execution.growth import claimed, refuse_open_files, set_damaged_aside
from gfmdlayer.execution.progress import Display, Log, Reporter
from gfmdlayer.execution.schedule import Outcome, Schedule
from gfmdlayer.execution.sweep import Case, Cases, Shard, own_cases
from gfmdlayer.execution.workers import WorkerPool
from gfmdlayer.files.locks import exclusive, read_json
from gfmdlayer.notes import notes


@dataclass(frozen=True)
class RunOptions:
    """How cases are run.

    Attributes
    ----------
    restart : bool
        Remove earlier results first.
    only_failed : bool
        Run the cases that are recorded as failed, and leave the others that are not complete.
    shard : Shard, optional
        Run these cases alone, while other runs may compute others; the last to end writes the sweep file.
    threads : int
        Threads that the transforms of a case may use.
    checkpoint_every : float
        Seconds between two checkpoints of a case.
    ranks_per_case : int
        Ranks that compute a case together.
    """

    restart: bool = False
    only_failed: bool = False
    shard: Shard | None = None
    threads: int = 1
    checkpoint_every: float = CHECKPOINT_EVERY
    ranks_per_case: int = 1


@dataclass(frozen=True)
class Summary:
    """Outcomes of a run.

    Attributes
    ----------
    outcomes : tuple of Outcome
        Of all cases of the run or of its shard, in their order, those complete before included.
    collected : bool
        Whether the sweep file was written: no case waits any more, in any shard.
    notes : tuple of str
        Lines on the sweep file: columns that some cases lack, cases of different versions.
    """

    outcomes: tuple[Outcome, ...]
    collected: bool
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

    own: Sequence[Case]
    undone: Sequence[Case]
    todo: Sequence[Case]


def run_sweep(
    config: Config,
    directory: str | Path,
    pool: WorkerPool,
    options: RunOptions | None = None,
    display: Callable[[], Display] | None = None,
) -> Summary:
    """Run the cases of a configuration that are not complete yet, and collect all of them.

    Parameters
    ----------
    config : Config
        The configuration.
    directory : path
        Results folder; made where there is none.
    pool : WorkerPool
        The processes that compute.
    options : RunOptions, optional
        Which cases are run, and how.
    display : callable, optional
        Makes the display of progress; called once the folder is claimed. By default nothing is shown.

    Returns
    -------
    Summary
        Outcome of each case.

    Raises
    ------
    ConfigError
        Where a combination of swept values is not possible.
    FolderError
        Where the folder cannot be used for these results, or a file that would be replaced is open elsewhere.
    ResultsError
        Where the sweep file cannot be written.
    """
    options = options or RunOptions()
    alone = options.ranks_per_case == 1
    folder = Folder(Path(directory), options.shard)
    made = Cases(config)
    own: Sequence[Case] = own_cases(made, options.shard)
    with claimed(folder, config, options.restart, [case.index for case in own]) as found:
        every = found.numbered(made)  # of a shard only its own are kept
        own = growth.with_inputs(folder, found.numbered(own), found.changed)
        own = growth.with_earlier(folder, own) if alone else own
        work = _find_work(folder, own, options.only_failed)
        refuse_open_files(folder, [case.index for case in work.todo])
        _refuse_too_large(work.todo, pool, options)
        refuse_other_ranks(folder, work.todo, options.ranks_per_case)
        outcomes = {case.index: Outcome(case.index, "complete") for case in own}
        outcomes |= {case.index: Outcome(case.index, "waiting") for case in work.undone}
        indices = frozenset(outcomes)
        seconds = _expected_seconds(work, folder)
        complete = len(own) - len(work.undone)
        with Reporter(folder, indices, complete, display or _nothing, seconds, pool.size) as reporter:
            for line in (_opening(work, pool, options), *_warnings(work, pool, folder)):
                reporter.note(line)
            if found.changed:
                for line in growth.lines(folder, found, own):
                    reporter.note(line)
            for line in set_damaged_aside(folder, [case.index for case in work.todo]):
                reporter.note(line)
            wisdom = _prepare(work.todo, options, folder, reporter)
            run, threads = run_case if alone else run_case_together, options.threads
            interval = options.checkpoint_every
            task = partial(run, folder=folder, wisdom=wisdom, threads=threads, checkpoint_every=interval)
            for outcome in Schedule(pool, task, folder, reporter.ended).run(
                _ordered(work.todo, seconds, pool)
            ):
                outcomes[outcome.index] = outcome
                if outcome.state == "failed":
                    case = next(case for case in own if case.index == outcome.index)
                    record_failure(folder, case, outcome.reason)
        ended = all(outcome.state not in {"stopped", "waiting"} for outcome in outcomes.values())
        collected = _collect(config, folder, every, outcomes) if ended else None
        notes, lost = collected or ([], [])
        outcomes |= {outcome.index: outcome for outcome in lost}
    return Summary(tuple(outcomes.values()), collected is not None, tuple(notes))


def _prepare(todo: Sequence[Case], options: RunOptions, folder: Folder, reporter: Reporter) -> Wisdom:
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


def _nothing() -> Display:
    return Log(StringIO())


def _find_work(folder: Folder, own: Sequence[Case], only_failed: bool) -> _Work:
    found = folder.numbers()
    undone = [case for case in own if case.index not in found["h5"] or not _is_done(case, folder)]
    todo = [case for case in undone if not only_failed or case.index in found["failed"]]
    return _Work(own, undone, todo)


def _done(work: _Work) -> list[Case]:
    undone = {case.index for case in work.undone}
    return [case for case in work.own if case.index not in undone]


def _is_done(case: Case, folder: Folder) -> bool:
    from gfmdlayer.results.reader import attributes, is_complete

    path = folder.case(case.index)
    if not is_complete(path):
        return False
    if attributes(path).get("digest") != digest(case.config):
        raise FolderError(f"{path}: was computed from other input (has a file changed?); {WAYS_OUT}")
    return True


def _refuse_too_large(todo: Sequence[Case], pool: WorkerPool, options: RunOptions) -> None:
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
    """Return the expected seconds of the cases to be run, by those of finished ones."""
    model = CostModel.of_files({folder.case(case.index): case.config for case in _done(work)})
    return {case.index: model.seconds(case.config) for case in work.todo}


def _ordered(todo: Sequence[Case], seconds: Mapping[int, float], pool: WorkerPool) -> Sequence[Case]:
    """Put the longest cases first; a single process keeps their order."""
    if pool.alone:
        return todo
    return sorted(todo, key=lambda case: (-seconds[case.index], case.index))


def _collect(
    config: Config, folder: Folder, every: Sequence[Case], outcomes: dict[int, Outcome]
) -> tuple[list[str], list[Outcome]] | None:
    """Write the sweep file; return None where cases of other shards are not complete.

    Else the notes in it, and the cases that ended well, but could not be read any more.
    """
    from gfmdlayer.results.gathering import CaseRecord
    from gfmdlayer.results.reader import attributes
    from gfmdlayer.results.schema import ResultsError
    from gfmdlayer.results.sweep_file import collect

    try:
        with exclusive(folder.cases / ".collection"):
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
            path = collect(folder.path, records, keys, drawn, is_listed(config.sweep), config.unit)
            found = attributes(path)
            named = (line.partition(": ") for line in str(found["failed"]).splitlines())
            failed = {int(number): reason for number, _, reason in named if number.isdecimal()}
            lost = [Outcome(i, "failed", reason) for i, reason in failed.items() if reasons.get(i) == ""]
            return str(found["notes"]).splitlines(), lost
    except PermissionError as error:  # lost during the run
        raise ResultsError(f"{folder.sweep}: cannot be written: {error.strerror}") from error


def _failure_reason(folder: Folder, case: Case) -> str | None:
    """Return why another shard's case failed; empty where it is complete, None where it has not ended."""
    if folder.case(case.index).exists():
        return ""
    record = read_json(folder.case(case.index, "failed"))
    return None if record is None else str(record.get("reason"))
