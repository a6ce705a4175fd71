"""Running one case into its file; an error becomes the outcome of the case."""

from __future__ import annotations

import json
import time
import traceback
import warnings
from collections.abc import Sequence
from contextlib import closing, suppress
from functools import partial
from pathlib import Path

from gfmdlayer.config import Config, digest
from gfmdlayer.config.model import stem
from gfmdlayer.execution import CHECKPOINT_EVERY
from gfmdlayer.execution.checkpoints import Checkpoints
from gfmdlayer.execution.cost import estimate, kind
from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import Stopped, at_once, stop_requested
from gfmdlayer.execution.progress import Reporter
from gfmdlayer.execution.schedule import Labelled, Outcome
from gfmdlayer.execution.status import StatusFile
from gfmdlayer.execution.sweep import Case, label
from gfmdlayer.files.whole import write_text
from gfmdlayer.notes import notes

Wisdom = dict[tuple[int, ...], str]


def prepare() -> None:
    """Import the modules that a case needs; compiles nothing."""
    import gfmdlayer.results.checkpoint
    import gfmdlayer.results.journal
    import gfmdlayer.results.writer
    import gfmdlayer.simulation  # noqa: F401


def run_case(
    case: Case,
    folder: Folder,
    wisdom: Wisdom | None = None,
    threads: int = 1,
    checkpoint_every: float = CHECKPOINT_EVERY,
) -> Outcome:
    """Run one case into its file; an error becomes its outcome.

    Parameters
    ----------
    case : Case
        The case.
    folder : Folder
        A claimed results folder.
    wisdom : dict, optional
        FFTW wisdom for each shape of the grid, the same in all processes.
    threads : int
        Threads that the transforms may use.
    checkpoint_every : float
        Seconds between two checkpoints.

    Returns
    -------
    Outcome
        A failure is also recorded in cases/NNNN.failed, for the next run and for `gfmdlayer status`.
    """
    begun = time.monotonic()
    try:
        shape = case.config.grid.points
        note = _simulate(case, folder, (wisdom or {}).get(shape), threads, checkpoint_every)
    except Stopped:
        return Outcome(case.index, "stopped")
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        record_failure(folder, case, reason, traceback.format_exc())
        return Outcome(case.index, "failed", reason, time.monotonic() - begun)
    return Outcome(case.index, "complete", seconds=time.monotonic() - begun, note=note)


def record_failure(folder: Folder, case: Labelled, reason: str, trace: str = "") -> None:
    """Record why a case failed, in cases/NNNN.failed.

    Parameters
    ----------
    folder : Folder
        A claimed results folder.
    case : Labelled
        The case.
    reason : str
        One line.
    trace : str
        Traceback; a record without one does not replace another record.
    """
    from gfmdlayer.results.provenance import now

    path = folder.case(case.index, "failed")
    record = {"reason": reason, "traceback": trace, "time": now(), "values": case.values}
    with suppress(OSError):  # on a full disk the outcome alone must do
        if trace or not path.exists():
            write_text(path, json.dumps(record, default=str))
            folder.case(case.index, "running").unlink(missing_ok=True)


def _simulate(case: Case, folder: Folder, wisdom: str | None, threads: int, checkpoint_every: float) -> str:
    """Run the case; return the warnings of its observables."""
    from gfmdlayer.results.checkpoint import CheckpointError
    from gfmdlayer.simulation import ConvergenceError

    config, hashed = case.config, digest(case.config)
    described = attributes(config) | {"digest": hashed, "config": (case.given or config).dump()}
    compute = partial(_compute, config, described, folder.case(case.index), wisdom, threads)
    with (
        StatusFile(folder, case.index, config.time.end, label(case.values), estimate(config).steps) as status,
        closing(
            Checkpoints(
                folder, case.index, hashed, checkpoint_every, status.advance, _stem(config), case.earlier
            )
        ) as checkpoints,
    ):
        folder.case(case.index, "failed").unlink(missing_ok=True)
        try:
            try:
                checkpoints.find()
                note = compute(checkpoints)
            except CheckpointError as error:
                checkpoints.set_aside(str(error))
                note = compute(checkpoints)
        except ConvergenceError as error:
            if (kept := checkpoints.kept()) is None:
                raise
            message = f"{error}; state kept at t = {kept:.6g}"
            raise ConvergenceError(message, error.problem, error.solution, error.time) from error
        checkpoints.remove()
    return note


def _stem(config: Config) -> str:
    return stem(config) if config.output.keep_state else ""


def _compute(
    config: Config,
    described: dict[str, str | float],
    path: Path,
    wisdom: str | None,
    threads: int,
    checkpoints: Checkpoints,
) -> str:
    from gfmdlayer.case import Case as Simulation
    from gfmdlayer.observables import columns
    from gfmdlayer.results.writer import CaseWriter
    from gfmdlayer.simulation import simulate

    simulation = Simulation(config, wisdom, threads)
    described = described | {"started": checkpoints.started}
    elapsed = checkpoints.elapsed
    with CaseWriter(
        path, simulation.coordinates, described, columns(config), elapsed=elapsed, unit=config.unit
    ) as writer:
        recorder = checkpoints.recorder(writer)
        warnings = simulate(simulation, recorder, checkpoints.advance, resume=checkpoints.resume)
    return "; ".join(warnings)


def attributes(config: Config) -> dict[str, str | float]:
    """Return the attributes of a case that its configuration gives."""
    found: dict[str, str | float] = {"name": config.name, "config": config.dump()}
    if (tau := config.surface.material.characteristic_time) is not None:
        found["tau"] = tau
    found["G0"] = config.surface.material.unit
    found["control"] = config.trajectory.control
    if not config.grid.axisymmetric:
        found["L"] = config.grid.period[0]
    elif config.grid.extent is None:
        found["axes"] = "x of each case is its own, up to twice its contact radius; grid.extent sets it"
    if config.units is not None:
        found["units"] = str(config.units)
    if said := notes([config]):
        found["warnings"] = "\n".join(said)
    if config.trajectory.moves:
        found["frame"] = "of the punch: x is the distance from its middle, which is at position(time)"
    return found


def warm_up(todo: Sequence[Case], threads: int = 1, results: Path | None = None) -> tuple[Wisdom, list[str]]:
    """Compile kernels and plan transforms before the workers start, once for each kind of case.

    Parameters
    ----------
    todo : sequence of Case
        The cases.
    threads : int
        Threads that the transforms may use.
    results : Path, optional
        Where the wisdom of the results is kept.

    Returns
    -------
    wisdom : dict
        FFTW wisdom for each shape of the grid.
    said : list of str
        Where plans or kernels are not those of other runs.
    """
    from gfmdlayer.preparation import warm_up

    wisdom: Wisdom = {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        for config in {kind(case.config): case.config for case in todo}.values():
            with suppress(Exception):  # the case will meet it again, and be recorded as failed
                wisdom[config.grid.points] = warm_up(config, threads=threads, results=results)
    said = [str(each.message) for each in caught if each.category is UserWarning]
    return wisdom, list(dict.fromkeys(said))


def compile_and_plan(todo: Sequence[Case], threads: int, folder: Folder, reporter: Reporter) -> Wisdom:
    """Warm up; a request to stop ends this at once, and then the cases before their first step.

    Parameters
    ----------
    todo : sequence of Case
        The cases.
    threads : int
        Threads that the transforms may use.
    folder : Folder
        A claimed results folder.
    reporter : Reporter
        Shows that it goes on.

    Returns
    -------
    dict
        FFTW wisdom for each shape of the grid; empty after a request to stop.
    """
    methods = (
        "axisymmetric" if case.config.grid.axisymmetric else case.config.solver.method for case in todo
    )
    solvers = ", ".join(dict.fromkeys(methods))
    work = f"compiling kernels, planning transforms, once per machine (about 20 s): contact solver {solvers}"
    wisdom: Wisdom = {}
    said: list[str] = []
    with suppress(KeyboardInterrupt), reporter.preparing(work), at_once():
        wisdom, said = warm_up(todo, threads, folder.wisdom)
    for line in said if not stop_requested() else ():
        reporter.note(f"warning: {line}")
    return wisdom
