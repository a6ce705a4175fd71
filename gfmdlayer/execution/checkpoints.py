"""When an unfinished case writes checkpoints, and how it goes on from one.

    DIR/cases/NNNN.checkpoint      the last state (`results.checkpoint`)
    DIR/cases/NNNN.journal         the rows and snapshots up to it, and later ones (`results.journal`)
    DIR/cases/NNNN.state           the state of a case before its end, where `output.keep_state` asks for it
    DIR/cases/NNNN.*.aside         files that could not be used: a checkpoint and its journal, a damaged case

A checkpoint is written at an interval and when the run is asked to stop. A case that fails leaves its last
one, from which the next run goes on; where a step does not converge, that is the state before this step.
A case with a later end than a complete one goes on from the state that this one kept.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import Stopped
from gfmdlayer.execution.progress import Log
from gfmdlayer.execution.sweep import Earlier

if TYPE_CHECKING:
    from pathlib import Path

    from gfmdlayer.grid.grid import Grid
    from gfmdlayer.grid.ranks import Ranks
    from gfmdlayer.results.checkpoint import Checkpoint
    from gfmdlayer.results.journal import Journal
    from gfmdlayer.resumable import CompositeState

_PART = 0.02  # of the time that checkpoints take, at most, unless one is asked for after every step


class Checkpoints:
    """Writes the checkpoints of a case, and lets it go on from the last one; each rank calls every method.

    Parameters
    ----------
    interval : float
        Seconds between two checkpoints, more where writing one takes long; 0 for every step.
    report_time : callable
        Called with the simulated time after each attempt at a step; raises `Stopped` to stop the run.
    stem : str
        Stem of the configuration, where the state before the end is to be kept.
    earlier : Earlier, optional
        A complete case from whose state this one goes on.
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
        ranks: Ranks | None = None,
    ) -> None:
        from gfmdlayer.grid.ranks import ALONE
        from gfmdlayer.results.provenance import made_by

        self._folder, self._index, self._ranks = folder, index, ranks or ALONE
        self._checkpoint, self._journal_file, self._state = (
            folder.case(index, kind) for kind in ("checkpoint", "journal", "state")
        )
        self._interval, self._report_time = interval, report_time
        several = {"ranks": str(self._ranks.count)} if self._ranks.count > 1 else {}
        self._made_by = made_by(digest) | several
        self._stem, self._earlier = stem, earlier
        self._found: Checkpoint | None = None
        self._journal: Journal | None = None
        self._memory: CompositeState | None = None
        self._warned = ""
        self._begin()

    def _begin(self) -> None:
        from gfmdlayer.results.provenance import now

        self._begun = time.monotonic()
        self.started, self._before = now(), 0.0  # of the first start; seconds up to the checkpoint
        self._time, self._unsaved = 0.0, False

    @property
    def elapsed(self) -> float:
        """Seconds of computation so far, those before the checkpoint included."""
        return self._before + time.monotonic() - self._begun

    def journal(self, columns: Iterable[str], grid: Grid | None = None) -> Journal:
        """Return the journal of the case, which holds the rows and snapshots up to its checkpoint."""
        from gfmdlayer.results.checkpoint import CheckpointError
        from gfmdlayer.results.journal import Journal, Position

        self._found = self._find()
        self._journal = journal = Journal(self._journal_file, grid)
        if self._found is not None:
            about = self._found.about
            self.started, self._before, self._time = about["started"], about["elapsed"], about["time"]
            with self._ranks.agreeing(CheckpointError):
                if self._earlier is not None:
                    self._repeat(self._earlier, journal)
                elif self._ranks.first:
                    position = Position(*about["journal"])
                    if position.columns and (changed := set(columns) ^ set(position.columns)):
                        raise CheckpointError(
                            f"its rows have other columns, see {', '.join(sorted(changed))}"
                        )
                    try:
                        journal.go_on(position)
                    except ValueError as error:
                        raise CheckpointError(str(error)) from None
        return journal

    def _find(self) -> Checkpoint | None:
        """Read the checkpoint, or else the state that an earlier case kept."""
        from gfmdlayer.results.checkpoint import CheckpointError, read_checkpoint

        if self._ranks.shared(self._checkpoint.exists()):
            self._earlier = None
            return read_checkpoint(self._checkpoint, self._made_by, self._ranks)
        if self._earlier is None:
            return None
        if {**self._earlier.made_by, "digest": ""} != {**self._made_by, "digest": ""}:
            raise CheckpointError("it would not give the same bits")
        return read_checkpoint(self._folder.case(self._earlier.index, "state"), self._earlier.made_by)

    def _repeat(self, earlier: Earlier, journal: Journal) -> None:
        """Record the rows and snapshots of an earlier case up to its kept state."""
        from gfmdlayer.results.checkpoint import CheckpointError
        from gfmdlayer.results.reader import is_complete, replay
        from gfmdlayer.results.schema import ResultsError

        path = self._folder.case(earlier.index)
        if not is_complete(path, earlier.made_by["digest"]):
            raise CheckpointError(f"{path.name}, which belongs to it, is not complete any more")
        try:
            replay(path, earlier.time, journal)
        except ResultsError:
            raise  # in writing
        except (OSError, KeyError, ValueError) as error:
            raise CheckpointError(f"{path.name}, which belongs to it, is damaged ({error})") from None

    def resume(self, memory: CompositeState) -> None:
        """Restore the checkpoint found; called by the simulation before its first step."""
        from gfmdlayer.results.checkpoint import CheckpointError

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
        stopped = False
        try:
            self._report_time(simulated_time)
        except Stopped:
            stopped = True
        due = self._ranks.first and time.monotonic() >= self._due
        stop, due = map(any, zip(*self._ranks.all_of((stopped, due)), strict=True))
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
        """Remove checkpoint and journal of a complete case."""
        self.close()
        if self._ranks.first:
            with suppress(OSError):
                for path in (self._checkpoint, self._journal_file):
                    path.unlink(missing_ok=True)

    def set_aside(self, reason: str) -> None:
        """Rename a checkpoint that cannot be used, and its journal; they are left to the user."""
        self.close()
        self._begin()
        self._found = None
        if self._earlier is None:
            if self._ranks.first:
                for path in (self._checkpoint, self._journal_file):
                    self._folder.set_aside(path)
            self._ranks.all_of(None)  # no rank looks for it before it is gone
            self.log(f"begins anew, its checkpoint is set aside: {reason}")
        else:
            self.log(f"begins anew, not from the state of case {self._earlier.index:04d}: {reason}")
            self._earlier = None

    def close(self) -> None:
        """Close the journal."""
        if self._journal is not None:
            self._journal.close()

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
                self._save(self._state, about)
            except OSError as error:
                self._warn(f"continues, but its state cannot be kept: {error.strerror or error}")

    def _save(self, path: Path, about: dict[str, Any], ranks: Ranks | None = None) -> None:
        from gfmdlayer.grid.ranks import ALONE
        from gfmdlayer.results.checkpoint import write_checkpoint

        assert self._memory is not None
        known = {"started": self.started, "elapsed": self.elapsed, **about}
        write_checkpoint(path, self._made_by, known, self._memory.state(), ranks or ALONE)

    def _write(self) -> None:
        """Write the journal, then the checkpoint that names the place in it."""
        assert self._journal is not None
        begun, failure = time.monotonic(), ""
        try:
            position = self._journal.kept()
        except OSError as error:
            failure = error.strerror or str(error)
        if not (failure := self._ranks.shared(failure)):
            try:
                self._save(self._checkpoint, {"time": self._time, "journal": position}, self._ranks)
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
        if line != self._warned:
            self._warned = line
            self.log(line)
