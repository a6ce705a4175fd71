"""Running one case into its file, with checkpoints; an error becomes the outcome of the case."""

from __future__ import annotations

import json
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfmdlayer.case.accuracy import accuracy
from gfmdlayer.case.model import ConvergenceError, Model, model_of
from gfmdlayer.case.notes import accounts, notes
from gfmdlayer.config import digest
from gfmdlayer.config.model import stem
from gfmdlayer.errors import GfmdlayerError
from gfmdlayer.files.whole import write_text
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.results import checkpoint, provenance
from gfmdlayer.results.case_file import case_contents, write_case
from gfmdlayer.results.checkpoint import Checkpoint, CheckpointError, read_checkpoint
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import is_complete, replay
from gfmdlayer.results.recording import Recording
from gfmdlayer.study import CHECKPOINT_EVERY
from gfmdlayer.study.cases import Earlier, SweepCase, label
from gfmdlayer.study.claims import Claim, Taken
from gfmdlayer.study.cost import kind
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.interrupts import Listener, Stopped
from gfmdlayer.study.progress import Log
from gfmdlayer.study.schedule import Outcome

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.grid.grid import Grid
    from gfmdlayer.resumable import CompositeState


# Seconds of a case from which on its file is on the disk before it has its name. Others are brought there
# together, before sweep.h5 is written: waiting takes longer than some of them do.
AWAITED = 1.0
_PART = 0.02  # of the time that checkpoints take, at most, unless one is asked for after every step


class Checkpoints:
    """Writes the checkpoints of a case, and lets it go on from the last one; each rank calls every method.

    The case writes one every `interval` seconds (0: after every step; later where writing takes long), and
    when the run is asked to stop. A case that fails leaves its last one, from which the next run goes on.
    `stem` is given where this case keeps a state for a later end; `earlier` is a case that has kept one.
    `report_time` takes the simulated time after each attempt at a step and may raise `Stopped` or `Taken`.
    """

    def __init__(
        self,
        folder: Folder,
        index: int,
        digest: str,
        interval: float,
        report_time: Callable[[float], None],
        stem: str = "",
        earlier: Earlier | None = None,
        ranks: Ranks = ALONE,
    ) -> None:
        self._folder, self._index, self._ranks = folder, index, ranks
        self._checkpoint, self._snapshots, self._state = (
            folder.case(index, kind) for kind in ("checkpoint", "snapshots", "state")
        )
        self._interval, self._report_time = interval, report_time
        several = {"ranks": str(self._ranks.count)} if self._ranks.count > 1 else {}
        self._made_by = provenance.made_by(digest) | several
        self._stem, self._earlier = stem, earlier
        self._found: Checkpoint | None = None
        self._recording: Recording | None = None
        self._memory: CompositeState | None = None
        self._warned = ""
        self._time, self._unsaved = 0.0, False

    @property
    def stepwise(self) -> bool:
        """Whether it looks at each step."""
        return self._interval == 0 or bool(self._stem)

    def recording(self, columns: Iterable[str], grid: Grid | None = None) -> Recording:
        """Return the recording of the case, which holds the rows and snapshots up to its checkpoint."""
        self._found = self._find()
        self._recording = recording = Recording(self._snapshots, grid)
        if self._found is not None:
            about = self._found.about
            recording.started, recording.spent = about["started"], about["elapsed"]
            self._time = about["time"]
            with self._ranks.agreeing(CheckpointError):
                if self._earlier is not None:
                    self._repeat(self._earlier, recording)
                elif self._ranks.first:
                    kept = about["recording"]
                    if kept["widths"] and (changed := set(columns) ^ set(kept["widths"])):
                        names = ", ".join(sorted(changed))
                        raise CheckpointError(f"its rows have other columns, see {names}")
                    try:
                        recording.go_on(kept, self._found.state)
                    except ValueError as error:
                        raise CheckpointError(str(error)) from None
        return recording

    def _find(self) -> Checkpoint | None:
        """Read the checkpoint, or else the state that an earlier case kept."""
        if self._ranks.shared(self._checkpoint.exists()):
            self._earlier = None
            return read_checkpoint(self._checkpoint, self._made_by, self._ranks)
        if self._earlier is None:
            return None
        if {**self._earlier.made_by, "digest": ""} != {**self._made_by, "digest": ""}:
            raise CheckpointError("it would not give the same bits")
        return read_checkpoint(self._folder.case(self._earlier.index, "state"), self._earlier.made_by)

    def _repeat(self, earlier: Earlier, recording: Recording) -> None:
        """Record the rows and snapshots of an earlier case up to its kept state."""
        path = self._folder.case(earlier.index)
        if not is_complete(path, earlier.made_by["digest"]):
            raise CheckpointError(f"{path.name}, which belongs to it, is not complete any more")
        try:
            replay(path, earlier.time, recording)
        except ResultsError:
            raise  # in writing
        except (OSError, KeyError, ValueError) as error:
            raise CheckpointError(f"{path.name}, which belongs to it, is damaged ({error})") from None

    def resume(self, memory: CompositeState) -> None:
        """Restore the checkpoint found; called by the simulation before its first step."""
        if self._found is not None:
            with self._ranks.agreeing(CheckpointError):
                try:
                    memory.restore(self._found.state)
                except (KeyError, ValueError) as error:
                    raise CheckpointError(f"it would not give the same bits: {error}") from None
            of = "" if self._earlier is None else f" of case {self._earlier.index:04d}"
            self.log(f"goes on from time {self._found.about['time']:g}{of}")
            self._found = None
        elif self._ranks.first:
            self._state.unlink(missing_ok=True)  # of another run of this case
        self._memory = memory
        self._due = time.monotonic() + self._interval

    def advance(self, simulated_time: float) -> None:
        """Write a checkpoint where one is due or the run is to stop; called after each attempt at a step."""
        self._time, self._unsaved = simulated_time, True
        if self._stem:
            self._keep()
        stopped, taken = False, ""
        try:
            self._report_time(simulated_time)
        except Stopped:
            stopped = True
        except Taken as error:
            taken = str(error)
        due = self._ranks.first and time.monotonic() >= self._due
        of_ranks = self._ranks.all_of((stopped, due, taken))
        stop, due, taken = (next(filter(None, values), values[0]) for values in zip(*of_ranks, strict=True))
        if taken:
            raise Taken(taken)
        if stop or due:
            self._write()
        if stop:
            raise Stopped

    def kept(self) -> float | None:
        """Write the state before a step that failed; return its simulated time, None where there is none."""
        if self._unsaved:
            self._write()
        return self._time if self._checkpoint.exists() and not self._unsaved else None

    def remove(self) -> None:
        """Remove checkpoint and snapshots of a complete case."""
        self.close()
        if self._ranks.first:
            with suppress(OSError):
                for path in (self._checkpoint, self._snapshots):
                    path.unlink(missing_ok=True)

    def set_aside(self, reason: str) -> None:
        """Rename a checkpoint that cannot be used, and its snapshots; they are left to the user."""
        self.close()
        self._time, self._unsaved, self._found = 0.0, False, None
        if self._earlier is None:
            if self._ranks.first:
                journal = self._folder.case(self._index, "journal")  # of a checkpoint until version 0.2
                for path in (self._checkpoint, self._snapshots, journal):
                    self._folder.set_aside(path)
            self._ranks.all_of(None)  # no rank looks for it before it is gone
            self.log(f"begins anew, its checkpoint is set aside: {reason}")
        else:
            self.log(f"begins anew, not from the state of case {self._earlier.index:04d}: {reason}")
            self._earlier = None

    def close(self) -> None:
        """Close the file of the snapshots."""
        if self._recording is not None:
            self._recording.close()

    def log(self, line: str) -> None:
        """Write a line on the case to standard error, which all processes of a run share."""
        if self._ranks.first:
            Log(sys.stderr).note(f"case {self._index:04d} {line}")

    def _keep(self) -> None:
        """Keep the state where the next step may depend on the end."""
        assert self._memory is not None
        if (course := self._memory["steps"].course()) is not None:
            about = {"time": course.time, "stem": self._stem, "course": asdict(course)}
            try:
                self._save(self._state, about, {})
            except OSError as error:
                self._warn(f"continues, but its state cannot be kept: {error.strerror or error}")

    def _save(
        self, path: Path, about: Mapping[str, Any], rows: Mapping[str, Any], ranks: Ranks = ALONE
    ) -> None:
        assert self._memory is not None
        assert self._recording is not None
        known = {"started": self._recording.started, "elapsed": self._recording.elapsed, **about}
        checkpoint.write_checkpoint(path, self._made_by, known, {**self._memory.state(), **rows}, ranks)

    def _write(self) -> None:
        """Write the snapshots, then the checkpoint that has the rows and knows where the snapshots are."""
        assert self._recording is not None
        begun, failure = time.monotonic(), ""
        try:
            kept, rows = self._recording.kept()
        except OSError as error:
            failure = error.strerror or str(error)
        if not (failure := self._ranks.shared(failure)):
            try:
                self._save(self._checkpoint, {"time": self._time, "recording": kept}, rows, self._ranks)
            except OSError as error:
                failure = error.strerror or str(error)
            failure = self._ranks.shared(failure)
        if failure:
            self._warn(f"continues, but its checkpoint cannot be written: {failure}")
        else:
            self._unsaved = False
        ended = time.monotonic()
        pause = (ended - begun) / _PART if self._interval > 0 else 0.0
        self._due = ended + max(self._interval, pause)

    def _warn(self, line: str) -> None:
        if line != self._warned and self._folder.is_there:
            self._warned = line
            self.log(line)


def run_case(
    case: SweepCase,
    folder: Folder,
    threads: int | None = 1,
    checkpoint_every: float = CHECKPOINT_EVERY,
    ranks: Ranks = ALONE,
) -> Outcome:
    """Run one case into its file, on each rank that computes it; an error becomes its outcome."""
    begun = time.monotonic()
    try:
        with ending_together(ranks):
            note = CaseRun(case, folder, threads, ranks).simulate(checkpoint_every)
    except Stopped:
        return Outcome(case.index, "stopped")
    except Taken:
        return Outcome(case.index, "elsewhere")
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        if ranks.first:
            record_failure(folder, case.index, case.values, reason, traceback.format_exc())
        return Outcome(case.index, "failed", reason, time.monotonic() - begun)
    return Outcome(case.index, "complete", seconds=time.monotonic() - begun, note=note)


def record_failure(
    folder: Folder, index: int, values: Mapping[str, object], reason: str, trace: str = ""
) -> None:
    """Record why a case failed, in cases/NNNN.failed; a record without a traceback replaces no other."""
    if trace or not folder.case(index, "failed").exists():
        _record(folder.case(index, "failed"), values, reason, traceback=trace)
        with suppress(OSError):
            folder.case(index, "running").unlink(missing_ok=True)


def _record(path: Path, values: Mapping[str, object], reason: str, **more: str) -> None:
    record = {"reason": reason, **more, "time": provenance.now(), "values": values}
    with suppress(OSError):  # on a full disk the outcome must do
        write_text(path, json.dumps(record, default=str))


@dataclass(frozen=True)
class CaseRun:
    """The run of a case on this process, alone or as one of its ranks."""

    case: SweepCase
    folder: Folder
    threads: int | None
    ranks: Ranks

    def simulate(self, checkpoint_every: float) -> str:
        """Run the case into its file; return the warnings of its observables."""
        case, folder, config, ranks = self.case, self.folder, self.case.config, self.ranks
        claim: Claim | Listener = Listener()
        if ranks.first:
            together = ranks.count > 1
            claim = Claim(folder, case.index, config.time.end, label(case.values), case.cost.steps, together)
        kept = stem(config) if config.output.keep_state else ""
        arguments = (
            folder,
            case.index,
            self._digest,
            checkpoint_every,
            claim.advance,
            kept,
            case.earlier,
            ranks,
        )
        with ExitStack() as held:
            self._stop_without_folder()
            with ranks.agreeing(Taken):
                held.enter_context(claim)
            if ranks.shared(folder.case(case.index).exists()):
                raise Taken("another run has computed it")
            checkpoints = held.enter_context(closing(Checkpoints(*arguments)))
            if ranks.first:
                for kind in ("failed", "ended"):
                    folder.case(case.index, kind).unlink(missing_ok=True)
            try:
                try:
                    note = self._compute(checkpoints, claim)
                except CheckpointError as error:
                    checkpoints.set_aside(str(error))
                    note = self._compute(checkpoints, claim)
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

    def _compute(self, checkpoints: Checkpoints, claim: Claim | Listener) -> str:
        config, ranks = self.case.config, self.ranks
        model = model_of(config, self.threads, ranks, self.case.drives)
        recording = checkpoints.recording((column.name for column in model.columns), model.grid)
        # Checkpoints after every step, or at the last that does not depend on the end, need each of them.
        model.stepwise = checkpoints.stepwise
        warnings = model.run(recording, checkpoints.advance, checkpoints.resume)
        with ranks.agreeing(Taken):
            claim.confirm()
        self._stop_without_folder()
        with ranks.agreeing(ResultsError):
            if ranks.first:
                self._write(model, recording)
        return "; ".join(warnings)

    def _stop_without_folder(self) -> None:
        """Stop where somebody has removed the folder: another one would lack the cases before."""
        if not self.ranks.shared(self.folder.is_there):
            raise Stopped

    def _write(self, model: Model, recording: Recording) -> None:
        """Write the file of the case."""
        case = self.case
        described = attributes(model, case.given, surfaces=self.ranks.count == 1) | {"digest": self._digest}
        described |= accuracy(model, recording)
        about = described, model.columns, case.config.unit, case.values, model.places
        contents = case_contents(recording, model.coordinates, *about)
        write_case(self.folder.case(case.index), contents, durable=recording.elapsed >= AWAITED)
        said = [str(held["warnings"]) for held in (described, recording.noted) if held.get("warnings")]
        self.folder.add_warnings(case.index, "\n".join(said).splitlines())
        if ended := str(recording.noted.get("ended", "")):
            _record(self.folder.case(case.index, "ended"), case.values, ended)


def attributes(
    model: Model, stored: Config | None = None, *, surfaces: bool = True
) -> dict[str, str | float]:
    """Return the attributes of a case and notes; `stored` is the configuration to be stored."""
    config = model.config
    attributes: dict[str, str | float] = {"name": config.name, "config": (stored or config).dump()}
    if (tau := config.solid.characteristic_time) is not None:
        attributes["tau"] = tau
    attributes["G0"] = config.solid.unit
    attributes["control"] = config.trajectory.control
    attributes |= model.attributes
    if config.units is not None:
        attributes["units"] = str(config.units)
    if said := notes([config], surfaces=surfaces):
        attributes["warnings"] = "\n".join(said)
    if read := accounts([config], surfaces=surfaces):
        attributes["read"] = "\n".join(read)
    return attributes


def warm_up(todo: Sequence[SweepCase], *, stepwise: bool = False) -> list[str]:
    """Compile the kernels of each kind of case, with `stepwise` those of Python's loop; return warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        for config in {_kind(case.config): case.config for case in todo}.values():
            with suppress(Exception):  # the case will meet it again, and be recorded as failed
                model = model_of(config)
                model.stepwise = stepwise or config.output.keep_state
                model.warm_up()
    said = [str(warning.message) for warning in caught if warning.category is UserWarning]
    return list(dict.fromkeys(said))


def _kind(config: Config) -> Hashable:
    """Return the kind of a case, and what else decides whether the compiled loop takes it."""
    return kind(config), config.output.keep_state


# Ranks of a case fail together: an error of one of them ends the case on all.

PATIENCE = 8.0  # seconds in which the other ranks reach the same error, or the end
_POLL = 0.002  # seconds between two looks at the other ranks


class RankError(GfmdlayerError, RuntimeError):
    """Another rank of the case failed; the message says how."""


@contextmanager
def ending_together(ranks: Ranks) -> Iterator[None]:
    """End a block on all ranks, or raise on all of them.

    If a single rank fails, the others wait for it: the job is aborted, and the next run resumes.
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
    """Return the error of the first rank that has one, when all have arrived here."""
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
