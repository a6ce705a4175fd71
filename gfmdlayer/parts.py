"""What the time loop asks of the time integration of the history, and of the time points."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.history.instabilities import Change
from gfmdlayer.history.time_points import Course, Instant
from gfmdlayer.observables.observable import Energy
from gfmdlayer.resumable import Resumable


class Integrator(Energy, Resumable, Protocol):
    """Time integration of the history: slopes and intercepts of the stress at the end of a step."""

    @property
    def loss_stiffness(self) -> FloatArray | None:
        """Imaginary part of the slopes at the end of the last step; None where the punch does not move."""
        ...

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b at the end of a step of this length."""
        ...

    def advance(self, spectrum: ComplexArray) -> None:
        """Carry the history on with the accepted displacement."""
        ...


class Steps(Resumable, Protocol):
    """The time points of a run."""

    def __iter__(self) -> Iterator[Instant]:
        """Return the time points in order; a rejected one is followed by an earlier one."""
        ...

    def accepts(
        self, spectrum: ComplexArray, found: float, depth: float, change: Change | None = None
    ) -> bool:
        """Return whether the last step is accurate enough.

        Parameters
        ----------
        spectrum : ndarray of complex
            Displacement at its end.
        found : float
            Mean pressure at a prescribed depth, depth under a prescribed load.
        depth : float
            Depth of the punch.
        change : Change, optional
            Over the step, where the interface attracts.
        """
        ...

    def course(self) -> Course | None:
        """Return the course so far where the next step is the first that may depend on the end of the run."""
        ...
