"""Running one case into its file; an error becomes the outcome of the case."""

from __future__ import annotations

import json
import time
import traceback
import warnings
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.config import digest
from gfmdlayer.config.model import stem
from gfmdlayer.execution import CHECKPOINT_EVERY
from gfmdlayer.execution.checkpoints import Checkpoints
from gfmdlayer.execution.cost import estimate, kind
from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.groups.share import ending_together
from gfmdlayer.execution.interrupts import Listener, Stopped
from gfmdlayer.execution.schedule import Labelled, Outcome
from gfmdlayer.execution.status import StatusFile
from gfmdlayer.execution.sweep import Case, label
from gfmdlayer.files.whole import write_text
from gfmdlayer.notes import notes

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.execution.groups.share import PartWriter
    from gfmdlayer.grid.ranks import Ranks
    from gfmdlayer.model import Model
    from gfmdlayer.results.writer import CaseWriter

Wisdom = dict[tuple[int, ...], str]


def prepare() -> None:
    """Import the modules that a case needs; compiles nothing."""


def run_case(
    case: Case,
    folder: Folder,
    wisdom: Wisdom | None = None,
    threads: int = 1,
    checkpoint_every: float = CHECKPOINT_EVERY,
    ranks: Ranks | None = None,
) -> Outcome:
    """Run one case into its file; an error becomes its outcome.

    Of several ranks that compute the case each calls this; the first one writes.

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
    ranks : Ranks, optional
        The processes that compute the case together.

    Returns
    -------
    Outcome
        A failure is also recorded in cases/NNNN.failed, for the next run and for `gfmdlayer status`, and why
        a complete case ended early in cases/NNNN.ended.
    """
    from gfmdlayer.grid.ranks import ALONE

    begun, ranks = time.monotonic(), ranks or ALONE
    try:
        with ending_together(ranks):
            run = _Run(case, folder, (wisdom or {}).get(case.config.grid.points), threads, ranks)
            note = run.simulate(checkpoint_every)
    except Stopped:
        return Outcome(case.index, "stopped")
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        if ranks.first:
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
    if trace or not folder.case(case.index, "failed").exists():
        _record(folder, case, "failed", reason, traceback=trace)
        with suppress(OSError):
            folder.case(case.index, "running").unlink(missing_ok=True)


def _record(folder: Folder, case: Labelled, kind: str, reason: str, **more: str) -> None:
    """Write a record of a case."""
    from gfmdlayer.results.provenance import now

    record = {"reason": reason, **more, "time": now(), "values": case.values}
    with suppress(OSError):  # on a full disk the outcome alone must do
        write_text(folder.case(case.index, kind), json.dumps(record, default=str))


@dataclass(frozen=True)
class _Run:
    """The run of a case on this process, alone or as one of its ranks."""

    case: Case
    folder: Folder
    wisdom: str | None
    threads: int
    ranks: Ranks

    def simulate(self, checkpoint_every: float) -> str:
        """Run the case; return the warnings of its observables."""
        from gfmdlayer.model import ConvergenceError
        from gfmdlayer.results.checkpoint import CheckpointError

        case, folder, config = self.case, self.folder, self.case.config
        hashed, kept = digest(config), stem(config) if config.output.keep_state else ""
        with (
            self._status() as status,
            closing(
                Checkpoints(
                    folder,
                    case.index,
                    hashed,
                    checkpoint_every,
                    status.advance,
                    kept,
                    case.earlier,
                    self.ranks,
                )
            ) as checkpoints,
        ):
            if self.ranks.first:
                for kind in ("failed", "ended"):
                    folder.case(case.index, kind).unlink(missing_ok=True)
            try:
                try:
                    checkpoints.find()
                    note = self._compute(checkpoints, hashed)
                except CheckpointError as error:
                    checkpoints.set_aside(str(error))
                    note = self._compute(checkpoints, hashed)
            except ConvergenceError as error:
                if (kept_at := checkpoints.kept()) is None:
                    raise
                message = f"{error}; state kept at t = {kept_at:.6g}"
                raise ConvergenceError(message, error.problem, error.solution, error.time) from error
            self.ranks.all_of(None)  # the case is complete
            checkpoints.remove()
        return note

    def _status(self) -> StatusFile | Listener:
        if not self.ranks.first:
            return Listener()
        case, config = self.case, self.case.config
        return StatusFile(
            self.folder,
            case.index,
            config.time.end,
            label(case.values),
            estimate(config).steps,
            together=self.ranks.count > 1,
        )

    def _compute(self, checkpoints: Checkpoints, hashed: str) -> str:
        from gfmdlayer.grid.wisdom import RankWisdom
        from gfmdlayer.model import model_of

        plans = RankWisdom(self.ranks, self.case.config.grid.points, self.folder.wisdom, self.threads)
        model = model_of(self.case.config, plans.read() or self.wisdom, self.threads, self.ranks)
        with self._writer(model, checkpoints, hashed) as writer:
            recorder = checkpoints.recorder(writer)
            warnings = model.run(recorder, checkpoints.advance, checkpoints.resume)
            if ended := str(writer.noted.get("ended", "")):
                _record(self.folder, self.case, "ended", ended)
        plans.keep(model.wisdom)
        return "; ".join(warnings)

    def _writer(self, model: Model, checkpoints: Checkpoints, hashed: str) -> CaseWriter | PartWriter:
        from gfmdlayer.execution.groups.share import PartWriter
        from gfmdlayer.results.writer import CaseWriter

        case, config = self.case, self.case.config
        if not self.ranks.first:
            return PartWriter(model.grid, model.columns)
        described = attributes(model, case.given, surfaces=self.ranks.count == 1) | {"digest": hashed}
        return CaseWriter(
            self.folder.case(case.index),
            model.coordinates,
            described | {"started": checkpoints.started},
            model.columns,
            elapsed=checkpoints.elapsed,
            unit=config.unit,
            grid=None if self.ranks.count == 1 else model.grid,
        )


def attributes(model: Model, given: Config | None = None, *, surfaces: bool = True) -> dict[str, str | float]:
    """Return the attributes of a case that its configuration gives, and notes, on measured surfaces too.

    The configuration is stored as it was `given`, where it differs.
    """
    config = model.config
    found: dict[str, str | float] = {"name": config.name, "config": (given or config).dump()}
    if (tau := config.solid.characteristic_time) is not None:
        found["tau"] = tau
    found["G0"] = config.solid.unit
    found["control"] = config.trajectory.control
    found |= model.attributes
    if config.units is not None:
        found["units"] = str(config.units)
    if said := notes([config], surfaces=surfaces):
        found["warnings"] = "\n".join(said)
    return found


def warm_up(
    todo: Sequence[Case], threads: int = 1, results: Path | None = None, *, plan: bool = True
) -> tuple[Wisdom, list[str]]:
    """Compile kernels and plan transforms before the workers start, once for each kind of case.

    Parameters
    ----------
    todo : sequence of Case
        The cases.
    threads : int
        Threads that the transforms may use.
    results : Path, optional
        Where the wisdom of the results is kept.
    plan : bool
        Whether to plan transforms of whole grids, which no process has that shares them.

    Returns
    -------
    wisdom : dict
        FFTW wisdom for each shape of the grid.
    said : list of str
        Where plans or kernels are not those of other runs.
    """
    from gfmdlayer.model import model_of

    wisdom: Wisdom = {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        for config in {kind(case.config): case.config for case in todo}.values():
            with suppress(Exception):  # the case will meet it again, and be recorded as failed
                model = model_of(config, threads=threads)
                wisdom[config.grid.points] = model.warm_up(results=results, plan=plan)
    said = [str(each.message) for each in caught if each.category is UserWarning]
    return wisdom, list(dict.fromkeys(said))
