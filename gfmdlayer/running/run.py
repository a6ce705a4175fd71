"""Running the cases of a configuration that are not complete yet.

Cases are independent: each writes its own file, and one that fails is recorded while the others go on.  The
results do not depend on who ran a case: every member of a team computes with the same FFTW wisdom.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gfmdlayer.config import Config, digest
from gfmdlayer.config.sweeps import is_listed, sampling, swept_keys
from gfmdlayer.running.cases import record_failure, run_case, warm_up
from gfmdlayer.running.executors import Team
from gfmdlayer.running.folder import WAYS_OUT, Folder, FolderError
from gfmdlayer.running.listing import numbers
from gfmdlayer.running.reports import Report, Reporter
from gfmdlayer.running.schedule import Outcome, Schedule
from gfmdlayer.sweep import Case, cases, remarks


@dataclass(frozen=True)
class Summary:
    """How a run ended: outcomes of all cases, in their order, those that were not its own included."""

    outcomes: tuple[Outcome, ...]

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
    team: Team,
    restart: bool = False,
    report: Callable[[], Report] | None = None,
    threads: int = 1,
    only_failed: bool = False,
) -> Summary:
    """Run the cases of a configuration that are not complete yet, and collect all of them.

    Parameters
    ----------
    config : Config
        What to run.
    directory : path
        Results folder; made where there is none.
    team : Team
        Who runs the cases.
    restart : bool
        Remove earlier results first.
    report : callable, optional
        Makes the report to which progress is told, once the run really begins.
    threads : int
        Threads that the transforms of a case may use.
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
        Where the folder cannot be used for these results.
    ResultsError
        Where the sweep file cannot be written.
    """
    folder = Folder(Path(directory))
    every = cases(config)
    with folder.claimed(config, restart):
        found = numbers(folder)
        undone = [case for case in every if case.index not in found["h5"] or not _is_done(case, folder)]
        todo = [case for case in undone if not only_failed or case.index in found["failed"]]
        outcomes = {case.index: Outcome(case.index, "complete") for case in every}
        outcomes |= {case.index: Outcome(case.index, "waiting") for case in undone}
        with Reporter(folder, len(every), len(every) - len(undone), report) as reporter:
            reporter.note(_opening(len(every), len(every) - len(undone), len(todo), team, threads))
            for remark in remarks(case.config for case in every):
                reporter.note(f"warning: {remark}")
            task = partial(run_case, folder=folder, wisdom=warm_up(todo, threads), threads=threads)
            for outcome in Schedule(team, task, folder, reporter.ended).run(todo):
                outcomes[outcome.index] = outcome
                if outcome.state == "failed":
                    record_failure(folder, every[outcome.index], outcome.reason)
        if all(outcome.state not in {"stopped", "waiting"} for outcome in outcomes.values()):
            _collect(config, folder, every, outcomes)
    return Summary(tuple(outcomes.values()))


def _is_done(case: Case, folder: Folder) -> bool:
    from gfmdlayer.results.reader import is_complete

    path = folder.case(case.index)
    if not is_complete(path):
        return False
    if not is_complete(path, digest(case.config)):
        raise FolderError(f"{path}: was computed from other input (has a file changed?); {WAYS_OUT}")
    return True


def _opening(total: int, complete: int, todo: int, team: Team, threads: int) -> str:
    cases = "1 case" if total == 1 else f"{total} cases"
    before = f", {complete} complete already" if complete else ""
    before += f", {todo} to be run" if complete + todo < total else ""
    each = "one thread" if threads == 1 else f"{threads} threads"
    return f"{cases}{before}; {team.size} {team.kind}, {each} each"


def _collect(config: Config, folder: Folder, every: Sequence[Case], outcomes: dict[int, Outcome]) -> None:
    from gfmdlayer.results.sweep_file import CaseRecord, collect

    records = [
        CaseRecord(case.index, folder.case(case.index), case.values, outcomes[case.index].reason or None)
        for case in every
    ]
    keys, drawn = swept_keys(config.sweep), sampling(config.sweep)
    collect(folder.path, records, keys, attributes=drawn, listed=is_listed(config.sweep))
