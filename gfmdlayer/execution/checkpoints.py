"""Checkpoints of an unfinished case, and resuming from them.

    DIR/cases/NNNN.checkpoint      the last state
    DIR/cases/NNNN.journal0        the rows and snapshots up to it
    DIR/cases/NNNN.state           the state of a case before its end, where `output.keep_state` asks for it
    DIR/cases/NNNN.*.aside         files that could not be used: a checkpoint and its journal, a damaged case

A case with a later end than a complete one goes on from the state that this one kept, and gets its rows and
snapshots up to there.

A checkpoint is written at an interval and when the run is asked to stop. A case that fails leaves its last
checkpoint, from which the next run resumes; where a step does not converge, that is the state before it.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.groups.share import Share
from gfmdlayer.execution.interrupts import Stopped
from gfmdlayer.execution.progress import Log
from gfmdlayer.execution.sweep import Earlier

if TYPE_CHECKING:
    from pathlib import Path

    from gfmdlayer.execution.groups.share import PartWriter
    from gfmdlayer.grid.ranks import Ranks
    from gfmdlayer.results.checkpoint import Checkpoint
    from gfmdlayer.results.journal import Journal
    from gfmdlayer.results.writer import CaseWriter
    from gfmdlayer.resumable import CompositeState

_PART = 0.02  # of the time that checkpoints take, at most, unless one is asked for after every step


class Checkpoints:
    """Writes the checkpoints of a case, and resumes from the last one.

    Parameters
    ----------
    folder : Folder
        A claimed results folder.
    index : int
        The case.
    digest : str
        Digest of its configuration.
    interval : float
        Seconds between two checkpoints, more where writing one takes long; 0 for every step.
    report_time : callable
        Called with the simulated time after each attempt at a step; raises `Stopped` to stop the run.
    stem : str
        Stem of the configuration, where the state before the end is to be kept.
    earlier : Earlier, optional
        A complete case from whose state this one goes on.
    ranks : Ranks, optional
        The processes that compute the case, each with a checkpoint of its own (`groups.share`).

    Attributes
    ----------
    started : str
        Time of the first start of the case.
    elapsed : float
        Seconds of computation up to the checkpoint found.
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

        self._folder, self._index, self._path = folder, index, folder.case(index, "checkpoint")
        self._ranks, self._share = ranks or ALONE, Share(folder, index, ranks or ALONE)
        self._interval, self._report_time = interval, report_time
        self._made_by = made_by(digest) | self._share.made_by
        self._stem, self._earlier = stem, earlier
        self._begin()
        self._found: Checkpoint | None = None
        self._journal: Journal | None = None
        self._memory: CompositeState | None = None
        self._warned = ""

    def find(self) -> None:
        """Read the checkpoint, if there is one, or the state that an earlier case kept.

        Raises
        ------
        CheckpointError
            Where it cannot be used.
        """
        from gfmdlayer.results.checkpoint import CheckpointError

        with self._ranks.agreeing(CheckpointError):
            if self._share.first:
                self._find()
        path = self._share.found(None if self._found is None else self._found.about)
        with self._ranks.agreeing(CheckpointError):
            if path is not None and not self._share.first:
                self._read(path, self._made_by)

    def _find(self) -> None:
        from gfmdlayer.results.checkpoint import CheckpointError

        path, made_by = self._path, self._made_by
        if path.exists():
            self._earlier = None
        elif self._earlier is not None:
            path, made_by = self._folder.case(self._earlier.index, "state"), dict(self._earlier.made_by)
            if {**made_by, "digest": ""} != {**self._made_by, "digest": ""}:
                raise CheckpointError("it would not give the same bits")
        if path.exists():
            self._read(path, made_by)

    def _read(self, path: Path, made_by: Mapping[str, str]) -> None:
        from gfmdlayer.results.checkpoint import read_checkpoint

        self._found = read_checkpoint(path, made_by)
        self.started, self.elapsed = self._found.about["started"], self._found.about["elapsed"]
        self._time = self._found.about["time"]

    def _begin(self) -> None:
        from gfmdlayer.results.provenance import now

        self.started, self.elapsed = now(), 0.0
        self._time, self._unsaved = 0.0, False

    def recorder(self, writer: CaseWriter | PartWriter) -> Journal:
        """Return a recorder that passes on to the writer, which first gets the rows up to the checkpoint.

        Raises
        ------
        CheckpointError
            Where the journal of the checkpoint is lost, or its rows have other columns.
        """
        from gfmdlayer.results.checkpoint import CheckpointError
        from gfmdlayer.results.journal import Journal, Position

        self._writer = writer
        self._journal = Journal(self._share.journal, writer)
        if self._earlier is not None:
            self._replay(self._folder.case(self._earlier.index), self._earlier)
        elif self._found is not None:
            position = Position(*self._found.about["journal"])
            with self._ranks.agreeing(CheckpointError):
                if position.columns and (changed := writer.declared ^ set(position.columns)):
                    raise CheckpointError(f"its rows have other columns, see {', '.join(sorted(changed))}")
                try:
                    self._journal.accept(position)
                except ValueError as error:
                    raise CheckpointError(str(error)) from None
            self._journal.replay(position)
        return self._journal

    def _replay(self, path: Path, earlier: Earlier) -> None:
        from gfmdlayer.results.checkpoint import CheckpointError
        from gfmdlayer.results.reader import is_complete, replay
        from gfmdlayer.results.schema import ResultsError

        assert self._journal is not None
        if not is_complete(path, earlier.made_by["digest"]):
            raise CheckpointError(f"{path.name}, which belongs to it, is not complete any more")
        try:
            replay(path, earlier.time, self._journal)
        except ResultsError:
            raise  # in writing
        except (OSError, KeyError, ValueError) as error:
            raise CheckpointError(f"{path.name}, which belongs to it, is damaged ({error})") from None

    def resume(self, memory: CompositeState) -> None:
        """Restore the checkpoint found; called by the simulation before its first step.

        Raises
        ------
        CheckpointError
            Where it does not fit the simulation.
        """
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
        else:
            self._folder.case(self._index, "state").unlink(missing_ok=True)  # of another run of this case
        self._memory = memory
        self._due = time.monotonic() + self._interval if self._share.first else math.inf

    def advance(self, simulated_time: float) -> None:
        """Write a checkpoint where one is due or the run is to stop; called after each attempt at a step.

        Raises
        ------
        Stopped
            Where the run is to stop.
        """
        self._time, self._unsaved = simulated_time, True
        if self._stem:
            self._keep()
        try:
            self._report_time(simulated_time)
            stopped = False
        except Stopped:
            stopped = True
        stop, due = self._share.any_of(stopped, time.monotonic() >= self._due)
        if stop or due:
            self._write()
        if stop:
            raise Stopped

    def kept(self) -> float | None:
        """Write the state before a step that failed; return its simulated time, None where there is none."""
        if self._unsaved:
            self._write()
        return self._time if self._path.exists() and not self._unsaved else None

    def remove(self) -> None:
        """Remove checkpoint and journal of a complete case."""
        self.close()
        with suppress(OSError):
            self._share.remove()

    def set_aside(self, reason: str) -> None:
        """Rename an unusable checkpoint and its journal, which are left to the user."""
        self.close()
        self._begin()
        self._found = self._journal = None
        self._share.set_aside()
        if self._earlier is None:
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
        if self._share.first:
            Log(sys.stderr).note(f"case {self._index:04d} {line}")

    def _keep(self) -> None:
        """Keep the state where the next step may depend on the end."""
        assert self._memory is not None
        if (course := self._memory["steps"].course()) is None:
            return
        path = self._folder.case(self._index, "state")
        try:
            self._save(path, {"time": course.time, "stem": self._stem, "course": asdict(course)})
        except OSError as error:
            self._warn(f"continues, but its state cannot be kept: {error.strerror or error}")

    def _save(self, path: Path, about: dict[str, Any]) -> None:
        from gfmdlayer.results.checkpoint import Checkpoint

        assert self._memory is not None
        known = {"started": self.started, "elapsed": self._writer.elapsed, **about}
        Checkpoint(self._made_by, known, self._memory.state()).write(path)

    def _write(self) -> None:
        begun = time.monotonic()
        if failure := self._share.write(self._save_share):
            self._warn(f"continues, but its checkpoint cannot be written: {failure}")
        else:
            self._unsaved = False
        ended = time.monotonic()
        pause = (ended - begun) / _PART if self._interval > 0 else 0.0
        self._due = ended + max(self._interval, pause) if self._share.first else math.inf

    def _save_share(self, path: Path) -> None:
        assert self._journal is not None
        self._save(path, {"time": self._time, "journal": self._journal.kept(), **self._share.about})

    def _warn(self, line: str) -> None:
        if line != self._warned:
            self._warned = line
            self.log(line)
