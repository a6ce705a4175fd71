"""Running the cases of a configuration that are not complete yet.

Cases are independent: each writes its own file, and one that fails is recorded while the others go on.  The
results do not depend on who ran a case: every member of a pool computes with the same FFTW wisdom.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gfmdlayer.config import Config, digest
from gfmdlayer.config.sweeps import is_listed, sampling, swept_keys
from gfmdlayer.execution import CHECKPOINT_EVERY, guards, locks
from gfmdlayer.execution.case_run import record_failure, run_case, warm_up
from gfmdlayer.execution.cost import estimate
from gfmdlayer.execution.cost_model import CostModel, finished
from gfmdlayer.execution.folder import ASIDE, WAYS_OUT, Folder, FolderError, read_json
from gfmdlayer.execution.listing import numbers
from gfmdlayer.execution.progress import Report, Reporter
from gfmdlayer.execution.schedule import Outcome, Schedule
from gfmdlayer.execution.shards import Shard
from gfmdlayer.execution.sweep import Case, cases, notes
from gfmdlayer.execution.workers import WorkerPool


@dataclass(frozen=True)
class Summary:
    """How a run ended.

    Attributes
    ----------
    outcomes : tuple of Outcome
        Of all cases of the run or of its shard, in their order, those included that it left as they were.
    collected : bool
        Whether the sweep file was written: no case waits any more, in any shard.
    """

    outcomes: tuple[Outcome, ...]
    collected: bool

    def count(self, state: str) -> int:
        """Return the number of cases in a state."""
        return sum(outcome.state == state for outcome in self.outcomes)

    @property
    def failures(self) -> list[Outcome]:
        """The cases that failed."""
        return [outcome for outcome in self.outcomes if outcome.state == "failed"]


def run_sweep(
    config: Config,
    directory: str | Path,
    pool: WorkerPool,
    restart: bool = False,
    report: Callable[[], Report] | None = None,
    threads: int = 1,
    shard: Shard | None = None,
    checkpoint_every: float = CHECKPOINT_EVERY,
    only_failed: bool = False,
) -> Summary:
    """Run the cases of a configuration that are not complete yet, and collect all of them.

    Parameters
    ----------
    config : Config
        What to run.
    directory : path
        Results folder; made where there is none.
    pool : WorkerPool
        Who runs the cases.
    restart : bool
        Remove earlier results first.
    report : callable, optional
        Makes the report to which progress is told, once the run really begins.
    threads : int
        Threads that the transforms of a case may use.
    shard : Shard, optional
        Run these cases alone, while other runs may be at others; whoever ends last collects.
    checkpoint_every : float
        Seconds after which the state of a case is kept, from which a killed run goes on.
    only_failed : bool
        Run the cases that are on record as failed, and leave the others that are not complete.

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
    folder = Folder(Path(directory), shard)
    every = cases(config)
    own = every if shard is None else shard.share(every)
    mine = frozenset(case.index for case in own)
    with folder.claimed(config, restart, mine):
        found = numbers(folder)
        undone = [case for case in own if case.index not in found["h5"] or not _is_done(case, folder)]
        todo = [case for case in undone if not only_failed or case.index in found["failed"]]
        _refuse_open_files(folder, todo)
        damaged = _set_damaged_aside(folder, todo)
        outcomes = {case.index: Outcome(case.index, "complete") for case in own}
        outcomes |= {case.index: Outcome(case.index, "waiting") for case in undone}
        complete = len(own) - len(undone)
        with Reporter(folder, mine, complete, report) as reporter:
            reporter.note(_opening(len(own), complete, len(todo), pool, threads, shard))
            for line in (*_warnings(own, todo, pool, folder), *damaged):
                reporter.note(line)
            task = partial(
                run_case,
                folder=folder,
                wisdom=warm_up(todo, threads),
                threads=threads,
                checkpoint_every=checkpoint_every,
            )
            schedule = Schedule(pool, task, folder, reporter.ended)
            for outcome in schedule.run(_ordered(todo, undone, own, folder, pool)):
                outcomes[outcome.index] = outcome
                if outcome.state == "failed":
                    record_failure(folder, every[outcome.index], outcome.reason)
        collected = False
        if all(outcome.state not in {"stopped", "waiting"} for outcome in outcomes.values()):
            collected = _collect(config, folder, every, outcomes)
    return Summary(tuple(outcomes.values()), collected)


def _set_damaged_aside(folder: Folder, todo: Sequence[Case]) -> list[str]:
    """Give files of complete cases that cannot be read another name; return what to say of them."""
    damaged = [case.index for case in todo if folder.case(case.index).exists()]
    for index in damaged:
        folder.set_aside(folder.case(index))
    return [
        f"case {index:04d} is damaged: set aside as {index:04d}.h5{ASIDE}, computed again"
        for index in damaged
    ]


def _warnings(own: Sequence[Case], todo: Sequence[Case], pool: WorkerPool, folder: Folder) -> list[str]:
    """What should be known of the cases, of those who run them and of the disk."""
    space = guards.lack_of_space(folder.path, sum(estimate(case.config).storage for case in todo))
    found = (*notes(case.config for case in own), *pool.warnings, *space)
    return [f"warning: {warning}" for warning in found]


def _ordered(
    todo: list[Case], undone: Sequence[Case], own: Sequence[Case], folder: Folder, pool: WorkerPool
) -> list[Case]:
    """Put the longest cases first, by what the finished ones took; one process alone keeps their order."""
    if pool.alone:
        return todo
    waiting = {case.index for case in undone}
    done = [case for case in own if case.index not in waiting]
    return CostModel(finished(folder, done)).longest_first(todo)


def _refuse_open_files(folder: Folder, todo: Sequence[Case]) -> None:
    replaced = [folder.sweep, *(folder.case(case.index) for case in todo)]
    if found := guards.open_elsewhere(path for path in replaced if path.exists()):
        raise FolderError(f"{found[0]}: is open for writing in another program; close it there first")


def _is_done(case: Case, folder: Folder) -> bool:
    from gfmdlayer.results.reader import is_complete

    path = folder.case(case.index)
    if not is_complete(path):
        return False
    if not is_complete(path, digest(case.config)):
        raise FolderError(f"{path}: was computed from other input (has a file changed?); {WAYS_OUT}")
    return True


def _opening(
    total: int, complete: int, todo: int, pool: WorkerPool, threads: int, shard: Shard | None
) -> str:
    cases = "1 case" if total == 1 else f"{total} cases"
    part = "" if shard is None else f" in shard {shard}"
    before = f", {complete} complete already" if complete else ""
    before += f", {todo} to be run" if complete + todo < total else ""
    each = "one thread" if threads == 1 else f"{threads} threads"
    return f"{cases}{part}{before}; {pool.size} {pool.kind}, {each} each"


def _collect(config: Config, folder: Folder, every: Sequence[Case], outcomes: dict[int, Outcome]) -> bool:
    """Write the sweep file, unless cases of other shards are still to come; return whether it was."""
    from gfmdlayer.results.case_metadata import CaseRecord
    from gfmdlayer.results.schema import ResultsError
    from gfmdlayer.results.sweep_file import collect

    try:
        with locks.turn(folder.cases / ".collection"):
            reasons = {outcome.index: outcome.reason for outcome in outcomes.values()} | {
                case.index: _reason(folder, case) for case in every if case.index not in outcomes
            }
            if None in reasons.values():
                return False
            records = [
                CaseRecord(case.index, folder.case(case.index), case.values, reasons[case.index] or None)
                for case in every
            ]
            keys, drawn = swept_keys(config.sweep), sampling(config.sweep)
            collect(folder.path, records, keys, attributes=drawn, listed=is_listed(config.sweep))
    except PermissionError as error:  # lost on the way
        raise ResultsError(f"{folder.sweep}: cannot be written: {error.strerror}") from error
    return True


def _reason(folder: Folder, case: Case) -> str | None:
    """Tell why another shard's case failed: nothing where it is complete, None where it is still to come."""
    if folder.case(case.index).exists():
        return ""
    record = read_json(folder.case(case.index, "failed"))
    return None if record is None else str(record.get("reason"))
