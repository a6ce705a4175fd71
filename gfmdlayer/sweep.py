"""One configuration, many cases: what they are, and running those that are not complete yet.

A sweep is the product of the values of its keys, the last key running fastest; without one there is a single
case.  Cases are independent: each writes its own file, and one that fails is recorded while the others go on.
The results do not depend on who ran a case: every member of a team computes with the same FFTW wisdom.
"""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.config import Config, digest
from gfmdlayer.config.checks import plainly_possible
from gfmdlayer.folder import WAYS_OUT, Folder, FolderError, write_whole
from gfmdlayer.interrupts import Stopped
from gfmdlayer.progress import Report, Reporter, StatusFile
from gfmdlayer.schedule import Outcome, Schedule

if TYPE_CHECKING:
    from gfmdlayer.executors import Team

Wisdom = dict[tuple[int, ...], str]


_ROWS = 200  # of adaptive steps in a sweep, where no output times are asked for


@dataclass(frozen=True)
class Case:
    """One simulation of a sweep.

    Attributes
    ----------
    index : int
        Its number, that of its file.
    config : Config
        What is simulated; its sweep is empty.
    values : dict
        The swept keys, dotted, and their values in this case.
    """

    index: int
    config: Config
    values: dict[str, object]


@dataclass(frozen=True)
class Summary:
    """How a run ended: outcomes of all cases, in their order, those complete before included."""

    outcomes: tuple[Outcome, ...]

    def count(self, state: str) -> int:
        """Return the number of cases in a state."""
        return sum(outcome.state == state for outcome in self.outcomes)

    @property
    def failures(self) -> list[Outcome]:
        """The cases that failed."""
        return [outcome for outcome in self.outcomes if outcome.state == "failed"]


def combinations(sweep: Mapping[str, Sequence[object]]) -> list[dict[str, object]]:
    """Return the swept keys and their values in each case, in the order of the cases."""
    return [dict(zip(sweep, values, strict=True)) for values in product(*sweep.values())]


def cases(config: Config) -> list[Case]:
    """Return the cases of a configuration: the product of the swept values, the last key fastest.

    Where steps are adaptive and no output times are asked for, the cases of a sweep land on a spacing of
    end/200, so that their curves share a time axis.

    Raises
    ------
    ConfigError
        Where a combination of values is not possible.
    """
    found = []
    for index, values in enumerate(combinations(config.sweep)):
        case = config.with_values(values)
        if config.sweep and case.time.step == "adaptive" and case.output.times is None:
            case = case.with_values({"output.times": case.time.end / _ROWS})
        found.append(Case(index, case, values))
    return found


def objections(config: Config) -> Iterable[tuple[str, str]]:
    """Look at the numbers and files of the cases, for `config.load`; light where there are none."""
    doubtful = [case.config for case in cases(config) if not plainly_possible(case.config)]
    if not doubtful:
        return ()
    from gfmdlayer import inputs

    return inputs.objections(doubtful)


def label(values: dict[str, object]) -> str:
    """Write swept values for people: ``thickness = 0.1, Ginf = 10``."""
    short = [key.rpartition(".")[2] for key in values]
    names = [last if short.count(last) == 1 else key for key, last in zip(values, short, strict=True)]
    return ", ".join(f"{name} = {value}" for name, value in zip(names, values.values(), strict=True))


def run_sweep(
    config: Config,
    directory: str | Path,
    team: Team,
    restart: bool = False,
    report: Callable[[], Report] | None = None,
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
        todo = [case for case in every if not _is_done(case, folder)]
        outcomes = {case.index: Outcome(case.index, "complete") for case in every}
        with Reporter(folder, len(every), len(every) - len(todo), report) as reporter:
            reporter.note(_opening(len(every), len(todo), team))
            task = partial(run_case, folder=folder, wisdom=_warm_up(todo))
            for outcome in Schedule(team, task, folder, reporter.ended).run(todo):
                outcomes[outcome.index] = outcome
                if outcome.state == "failed":
                    _record_failure(folder, every[outcome.index], outcome.reason)
        if all(outcome.state != "stopped" for outcome in outcomes.values()):
            _collect(config, folder, every, outcomes)
    return Summary(tuple(outcomes.values()))


def _attributes(config: Config) -> dict[str, str | float]:
    found: dict[str, str | float] = {"name": config.name, "config": config.dump(), "digest": digest(config)}
    if config.layer.material.model == "zener":  # a spectrum has no one relaxation time
        found["tau"] = config.layer.material.tau
    return found


def _is_done(case: Case, folder: Folder) -> bool:
    from gfmdlayer.results.reader import is_complete

    path = folder.case(case.index)
    if not is_complete(path):
        return False
    if not is_complete(path, digest(case.config)):
        raise FolderError(f"{path}: was computed from other input (has a file changed?); {WAYS_OUT}")
    return True


def _opening(total: int, todo: int, team: Team) -> str:
    cases = "1 case" if total == 1 else f"{total} cases"
    before = f", {total - todo} complete already" if todo < total else ""
    return f"{cases}{before}; {team.size} {team.kind}, one thread each"


def prepare() -> None:
    """Import what a case needs; compiles nothing."""
    import gfmdlayer.results.writer
    import gfmdlayer.simulation  # noqa: F401


def run_case(case: Case, folder: Folder, wisdom: Wisdom | None = None) -> Outcome:
    """Run one case into its file; whatever goes wrong with it becomes its outcome.

    Parameters
    ----------
    case : Case
        The case.
    folder : Folder
        A claimed results folder.
    wisdom : dict, optional
        FFTW wisdom for each shape of the grid, the same for all who compute.

    Returns
    -------
    Outcome
        A failure is also recorded in cases/NNNN.failed, for the next run and for `gfmdlayer status`.
    """
    begun = time.monotonic()
    try:
        _simulate(case, folder, (wisdom or {}).get(case.config.grid.points))
    except Stopped:
        return Outcome(case.index, "stopped")
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        _record_failure(folder, case, reason, traceback.format_exc())
        return Outcome(case.index, "failed", reason, time.monotonic() - begun)
    return Outcome(case.index, "complete", seconds=time.monotonic() - begun)


def _record_failure(folder: Folder, case: Case, reason: str, trace: str = "") -> None:
    """Leave a record of the failure, unless whoever ran the case has left one that says more."""
    from gfmdlayer.results.provenance import now

    path = folder.case(case.index, "failed")
    if trace or not path.exists():
        record = {"reason": reason, "traceback": trace, "time": now(), "values": case.values}
        with suppress(OSError):  # a full disk; the outcome still tells
            write_whole(path, json.dumps(record, default=str))
            folder.case(case.index, "running").unlink(missing_ok=True)


def _simulate(case: Case, folder: Folder, wisdom: str | None) -> None:
    from gfmdlayer.contact.grid import Grid
    from gfmdlayer.results.writer import CaseWriter
    from gfmdlayer.simulation import simulate

    config = case.config
    with StatusFile(folder, case.index, config.time.end) as status:
        folder.case(case.index, "failed").unlink(missing_ok=True)
        axes = Grid(config.grid.points, config.grid.period).coordinates
        coordinates = dict(zip("xy", axes, strict=False))
        with CaseWriter(folder.case(case.index), coordinates, _attributes(config)) as recorder:
            simulate(config, recorder, status.advance, wisdom)


def _warm_up(todo: Sequence[Case]) -> Wisdom:
    """Compile and plan in this process before the others start, once for each kind of case."""
    from gfmdlayer.simulation import warm_up

    wisdom: Wisdom = {}
    for config in {_kind(case.config): case.config for case in todo}.values():
        with suppress(Exception):  # the case will meet it again, and be recorded as failed
            wisdom[config.grid.points] = warm_up(config)
    return wisdom


def _kind(config: Config) -> tuple[object, ...]:
    """What decides which kernels are compiled and which transforms are planned."""
    return config.grid.points, config.solver, config.time.integrator, config.layer.material.model


def _collect(config: Config, folder: Folder, every: Sequence[Case], outcomes: dict[int, Outcome]) -> None:
    from gfmdlayer.results.sweep_file import CaseRecord, collect

    records = [
        CaseRecord(case.index, folder.case(case.index), case.values, outcomes[case.index].reason or None)
        for case in every
    ]
    collect(folder.path, records, list(config.sweep))
