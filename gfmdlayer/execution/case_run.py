"""Running one case into its file; an error becomes the outcome of the case."""

from __future__ import annotations

import json
import sys
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfmdlayer.config import digest
from gfmdlayer.config.model import stem
from gfmdlayer.execution import CHECKPOINT_EVERY
from gfmdlayer.execution.checkpoints import Checkpoints
from gfmdlayer.execution.cost import estimate, kind
from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import Listener, Stopped
from gfmdlayer.execution.schedule import Labelled, Outcome
from gfmdlayer.execution.status import StatusFile
from gfmdlayer.execution.sweep import SweepCase, label
from gfmdlayer.files.whole import write_text
from gfmdlayer.notes import notes

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.grid.ranks import Ranks
    from gfmdlayer.model import Model
    from gfmdlayer.results.journal import Journal

Wisdom = dict[tuple[int, ...], str]


def prepare() -> None:
    """Import the modules that a case needs; compiles nothing."""


def run_case(
    case: SweepCase,
    folder: Folder,
    wisdom: Wisdom | None = None,
    threads: int = 1,
    checkpoint_every: float = CHECKPOINT_EVERY,
    ranks: Ranks | None = None,
) -> Outcome:
    """Run one case into its file; an error becomes its outcome.

    Of several ranks that compute the case each calls this; the first one writes.
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
    """Record why a case failed, in cases/NNNN.failed; a record without a traceback replaces no other."""
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

    case: SweepCase
    folder: Folder
    wisdom: str | None
    threads: int
    ranks: Ranks

    def simulate(self, checkpoint_every: float) -> str:
        """Run the case into its file; return the warnings of its observables."""
        from gfmdlayer.model import ConvergenceError
        from gfmdlayer.results.checkpoint import CheckpointError

        case, folder, config = self.case, self.folder, self.case.config
        kept = stem(config) if config.output.keep_state else ""
        with (
            self._status() as status,
            closing(
                Checkpoints(
                    folder,
                    case.index,
                    self._digest,
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
                    note = self._compute(checkpoints)
                except CheckpointError as error:
                    checkpoints.set_aside(str(error))
                    note = self._compute(checkpoints)
            except ConvergenceError as error:
                if (kept_at := checkpoints.kept()) is None:
                    raise
                message = f"{error}; state kept at t = {kept_at:.6g}"
                raise ConvergenceError(message, error.problem, error.solution, error.time) from error
            checkpoints.remove()
        return note

    @cached_property
    def _digest(self) -> str:
        return digest(self.case.config)

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

    def _compute(self, checkpoints: Checkpoints) -> str:
        from gfmdlayer.grid.wisdom import RankWisdom
        from gfmdlayer.model import model_of
        from gfmdlayer.results.schema import ResultsError

        config, ranks = self.case.config, self.ranks
        plans = RankWisdom(ranks, config.grid.points, self.folder.wisdom, self.threads)
        model = model_of(config, plans.read() or self.wisdom, self.threads, ranks)
        journal = checkpoints.journal((column.name for column in model.columns), model.grid)
        warnings = model.run(journal, checkpoints.advance, checkpoints.resume)
        with ranks.agreeing(ResultsError):
            if ranks.first:
                self._write(model, journal, checkpoints)
        plans.keep(model.wisdom)
        return "; ".join(warnings)

    def _write(self, model: Model, journal: Journal, checkpoints: Checkpoints) -> None:
        """Write the file of the case from its journal."""
        from gfmdlayer.results.writer import CaseWriter

        case = self.case
        described = attributes(model, case.given, surfaces=self.ranks.count == 1)
        with CaseWriter(
            self.folder.case(case.index),
            model.coordinates,
            described | {"digest": self._digest, "started": checkpoints.started},
            model.columns,
            elapsed=checkpoints.elapsed,
            unit=case.config.unit,
        ) as writer:
            journal.replay(writer)
            if ended := str(journal.noted.get("ended", "")):
                _record(self.folder, case, "ended", ended)


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
    todo: Sequence[SweepCase], threads: int = 1, results: Path | None = None, *, plan: bool = True
) -> tuple[Wisdom, list[str]]:
    """Compile kernels and plan transforms before the workers start, once for each kind of case.

    Returns FFTW's wisdom for each shape of grid, and warnings where plans or kernels are not those of other
    runs. No process plans transforms of whole grids (`plan`) where several ranks share them.
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


# Ranks of a case fail together: an error of one of them ends the case on all.

PATIENCE = 8.0  # seconds in which the other ranks come to the same error, or to the end
_POLL = 0.002  # seconds between two looks at the other ranks


class RankError(RuntimeError):
    """Another rank of the case failed; the message says how."""


@contextmanager
def ending_together(ranks: Ranks) -> Iterator[None]:
    """End a block on all ranks, or raise on all of them.

    Most errors are found by all ranks alike. One that a single rank meets, such as a lack of memory, leaves
    the others waiting for it: then the job is aborted, and the next run resumes from the last checkpoint.
    """
    error: Exception | None = None
    try:
        yield
    except Exception as caught:
        error = caught
    if ranks.count > 1:
        said = "" if error is None else f"{type(error).__name__}: {error}"
        other = _first_error(ranks, said, error)
        if error is None and other:
            error = RankError(f"another rank of the case failed: {other}")
    if error is not None:
        raise error


def _first_error(ranks: Any, said: str, error: Exception | None) -> str:
    """Return what the first rank with an error says, when all have come here."""
    request, begun = ranks.control.Ibarrier(), time.monotonic()
    while not request.Test():
        if error is not None and time.monotonic() - begun > PATIENCE:
            if isinstance(error, OSError | MemoryError):
                sys.stderr.write(f"gfmdlayer: {type(error).__name__}: {error}; all ranks end\n")
            else:
                traceback.print_exception(error)
            sys.stderr.flush()
            ranks.control.Abort(1)
        time.sleep(_POLL)
    return next(filter(None, ranks.control.allgather(said)), "")
