"""A case that is not complete: when its state is kept, where, and how it is taken up again.

    DIR/cases/NNNN.checkpoint      the last state
    DIR/cases/NNNN.journal0 or 1   the rows and snapshots up to it
    DIR/cases/NNNN.*.aside         what could not be used: a checkpoint and its journal, a damaged case

The state is kept at an interval and when the run is asked to stop. Whoever takes a case up writes the journal
that the checkpoint does not name, so that the way back is open until there is a new checkpoint. A case that
fails leaves its last checkpoint, and tried again goes on from there: what failed for want of a disk goes
through, and what cannot work fails again soon. Where a step does not converge, the steps since the last
checkpoint are repeated up to the one before it, whose state is kept.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import Stopped
from gfmdlayer.execution.progress import Log

if TYPE_CHECKING:
    from gfmdlayer.results.checkpoint import Checkpoint
    from gfmdlayer.results.journal import Journal
    from gfmdlayer.results.writer import CaseWriter
    from gfmdlayer.resumable import Resumable

_SHARE = 0.02  # of the time goes into keeping states, at most, unless every step is asked for
_FORMAT = "2"  # of checkpoint and journal
_JOURNALS = ("journal0", "journal1")
_VERSIONS = ("gfmdlayer", "numpy", "numba", "pyfftw")


class Checkpoints:
    """Keeps the state of a case, and finds the one that was kept.

    Parameters
    ----------
    folder : Folder
        A claimed results folder.
    index : int
        The case.
    digest : str
        Of its configuration.
    interval : float
        Seconds from one state to the next, more where keeping one takes long; 0 for every step.
    told : callable
        Told the simulated time after each attempt at a step; raises `Stopped` where the run is to stop.

    Attributes
    ----------
    started : str
        When the case was begun for the first time.
    elapsed : float
        Seconds that went into the state that was found.
    attempts : int
        Attempts at a step since the last state was kept.
    time : float
        Simulated time of the last attempt, or of the state that was found.
    """

    def __init__(
        self, folder: Folder, index: int, digest: str, interval: float, told: Callable[[float], None]
    ) -> None:
        self._folder, self._index, self._interval, self._tell_time = folder, index, interval, told
        self._path = folder.case(index, "checkpoint")
        self._made_by = made_by(digest)
        self._begin()
        self._found: Checkpoint | None = None
        self._journal: Journal | None = None
        self._memory: Resumable | None = None
        self._told = ""

    def find(self) -> None:
        """Look for a state to go on from.

        Raises
        ------
        CheckpointError
            Where there is one that cannot be used.
        """
        from gfmdlayer.results.checkpoint import read_checkpoint

        if self._path.exists():
            self._found = read_checkpoint(self._path, self._made_by)
            self.started, self.elapsed = self._found.about["started"], self._found.about["elapsed"]
            self.time = self._found.about["time"]

    def _begin(self) -> None:
        from gfmdlayer.results.provenance import now

        self.started, self.elapsed = now(), 0.0
        self.attempts, self.time = 0, 0.0

    def recorder(self, writer: CaseWriter) -> Journal:
        """Return what records for the writer; what was recorded before is in it already.

        Raises
        ------
        CheckpointError
            Where that is lost.
        """
        from gfmdlayer.results.checkpoint import CheckpointError
        from gfmdlayer.results.journal import Journal, Position

        self._writer = writer
        before = None if self._found is None else Position.of(self._found.about["journal"])
        own, self._done_with = (self._folder.case(self._index, kind) for kind in _JOURNALS)
        if before is not None and before.file == own.name:
            own, self._done_with = self._done_with, own
        self._journal = Journal(own, writer)
        if before is not None:
            try:
                self._journal.replay(before)
            except ValueError as error:
                raise CheckpointError(str(error)) from None
        return self._journal

    def resume(self, memory: Resumable) -> None:
        """Put the state that was found back; to be called by the simulation.

        Raises
        ------
        CheckpointError
            Where it does not fit.
        """
        from gfmdlayer.results.checkpoint import CheckpointError

        if self._found is not None:
            try:
                memory.restore(self._found.state)
            except (KeyError, ValueError) as error:
                raise CheckpointError(f"it would not give the same bits: {error}") from None
            self.tell(f"goes on from time {self._found.about['time']:g}")
            self._found = None
        self._memory = memory
        self._due = time.monotonic() + self._interval

    def advance(self, simulated_time: float) -> None:
        """Keep the state where it is due or the run is to stop; to be called after each attempt at a step.

        Raises
        ------
        Stopped
            Where the run is to stop.
        """
        self.attempts, self.time = self.attempts + 1, simulated_time
        try:
            self._tell_time(simulated_time)
        except Stopped:
            self._keep(simulated_time)
            raise
        if time.monotonic() >= self._due:
            self._keep(simulated_time)

    def remove(self) -> None:
        """Remove everything: the case is complete."""
        self.close()
        with suppress(OSError):
            for kind in ("checkpoint", *_JOURNALS):
                self._folder.case(self._index, kind).unlink(missing_ok=True)

    def set_aside(self, reason: str) -> None:
        """Leave what was found to the user, under another name."""
        self.close()
        self._begin()
        self._found = self._journal = None
        for kind in ("checkpoint", *_JOURNALS):
            self._folder.set_aside(self._folder.case(self._index, kind))
        self.tell(f"begins anew, its checkpoint is set aside: {reason}")

    def close(self) -> None:
        """Close the journal."""
        if self._journal is not None:
            self._journal.close()

    def tell(self, line: str) -> None:
        """Tell the user; whoever computes the case, its standard error is the run's."""
        Log(sys.stderr).note(f"case {self._index:04d} {line}")

    def _keep(self, simulated_time: float) -> None:
        from gfmdlayer.results.checkpoint import Checkpoint

        assert self._journal is not None  # asked for, as the memory, before the first step
        assert self._memory is not None
        begun = time.monotonic()
        try:
            about = {
                "time": simulated_time,
                "started": self.started,
                "elapsed": self._writer.elapsed,
                "journal": self._journal.kept().plain(),
            }
            Checkpoint(self._made_by, about, self._memory.state()).write(self._path)
            self.attempts = 0
            self._done_with.unlink(missing_ok=True)
        except OSError as error:
            self._warn(f"goes on, but its state cannot be kept: {error.strerror or error}")
        ended = time.monotonic()
        pause = (ended - begun) / _SHARE if self._interval > 0 else 0.0
        self._due = ended + max(self._interval, pause)

    def _warn(self, line: str) -> None:
        if line != self._told:
            self._told = line
            self.tell(line)


def made_by(digest: str) -> dict[str, str]:
    """Return all that the bits of a case depend on, but for the plans of FFTW, which are in its state."""
    from llvmlite.binding import get_host_cpu_name

    from gfmdlayer.results.provenance import provenance

    known = provenance()
    versions = {f"{name}_version": known[f"{name}_version"] for name in _VERSIONS}
    return {
        "format": _FORMAT,
        "digest": digest,
        # Two trees with changes of their own cannot be told apart; that a file was touched says too little.
        "git_commit": known["git_commit"].removesuffix("-dirty"),
        "processor": get_host_cpu_name(),
        **versions,
    }
