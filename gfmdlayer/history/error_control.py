"""The exponential integrator for steps of varying length: its history corrected, and its error known.

The exponential scheme of `modes` takes u for linear over the step. The curvature that it leaves out,
c = dt^2 u''/2, is seen as soon as the step is solved, as the divided difference of the last three accepted
displacements. It is used twice:

* The history is carried on with it (`Modes.advance`), to third order, so that errors do not add up.
* What remains is the step's own error: at its end the stress lacks delta f = sum_j w_j bend_j c.

A small delta f moves the mean pressure at given depth by -<v, delta f>, where v is how the surface follows
the punch: a displacement that is -1 all over the contact, free of force outside it and zero in the mean.
While the punch moves, that is the displacement of the step but for a factor. While it rests, the contact
outgrows what the last such step knew; the displacement u itself, in place of v, then errs to the other side.
(Not where it is all but withdrawn: the dent that it left does not follow it.) Divided by <v, f>, which is
proportional to the mean pressure, either gives a relative error, and the larger one counts. At given load it
is the depth that moves, in one step by less; but it creeps for longer than the pressure relaxes, and what is
left of earlier errors makes up for that: the same number serves (measured: half of it is reached). What of
delta f does not go into pressure or depth moves the free surface: with r the quotient, by
(delta f - r f)/kappa.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.history import mode_kernels as modes_loop
from gfmdlayer.history.mode_kernels import exponential
from gfmdlayer.history.modes import Modes
from gfmdlayer.resumable import State

# Of the change over a step after a kink, where no earlier displacement tells, the part that may be curvature:
# measured, it is 0.1 where contact begins and less elsewhere.
_UNKNOWN = 0.25

# A force this small beside the stresses whose difference it is comes from rounding: nothing is in contact.
_NOTHING = 1e-10

# Part of the unrelaxed stiffness from which on a mode's time is one that the first step must resolve.
_MATTERS = 1e-3


class ErrorControlledModes(Modes):
    """The relaxing modes of a surface for steps of varying length.

    Parameters
    ----------
    spectrum : Spectrum
        Of the wavenumbers of the grid's modes.
    measure : ndarray
        Weight of each wavenumber in the mean over the surface.

    Attributes
    ----------
    fastest : float
        Shortest relaxation time that matters; infinite for an elastic body.
    """

    def __init__(self, spectrum: Spectrum, measure: FloatArray, **motion: Any) -> None:
        super().__init__(spectrum, exponential, measure, **motion)
        matter = spectrum.weights > _MATTERS * spectrum.glassy
        self.fastest = float(spectrum.times[matter].min(initial=math.inf))
        self._measure = np.ravel(measure)
        self._twice = np.repeat(self._measure, 2)  # for real and imaginary parts
        self._follows: ComplexArray | None = None
        self._velocity: ComplexArray | None = None
        self._bent: tuple[ComplexArray, ComplexArray] | None = None  # a displacement and its curvature
        self._last_step = 0.0

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b at the end of a step of this length."""
        self._bent = None
        self._kappa, self._b = super().terms(step)
        return self._kappa, self._b

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Carry the history on over the step of the last `terms`, with the curvature that is now known."""
        velocity = (spectrum - self.u) * (1 / self.step) if self.step > 0 else None
        super().advance(spectrum, self._curvature(spectrum) if curvature is None else curvature)
        self._bent = None
        if velocity is not None:
            self._velocity, self._last_step = velocity, self.step

    def turn(self) -> None:
        """Forget how the displacement changed: after a kink it says nothing about what follows."""
        self._velocity = None

    def force(self, spectrum: ComplexArray) -> ComplexArray:
        """Return -sigma at the end of the step of the last `terms` with this displacement."""
        b = self._b.view(np.float64)
        return modes_loop.force(self._kappa, spectrum.view(np.float64), b).view(np.complex128)

    def lack(self, spectrum: ComplexArray) -> ComplexArray:
        """Return what that force lacks for the curvature of the displacement over the step."""
        curvature = self._curvature(spectrum)
        return self.missing(_UNKNOWN * (spectrum - self.u) if curvature is None else curvature)

    def error(self, spectrum: ComplexArray, *, moving: bool, deep: bool) -> tuple[float, float]:
        """Error that the step of the last `terms` makes with this displacement at its end.

        Parameters
        ----------
        spectrum : ndarray
            The displacement.
        moving : bool
            Whether the punch moves over the step.
        deep : bool
            Whether the depth of the punch is still of the size of the largest that it had.

        Returns
        -------
        Relative error of the mean pressure (at given load, of the depth), and root mean square error of the
        displacement, a length.
        """
        lack, force = self.lack(spectrum).view(np.float64), self.force(spectrum).view(np.float64)
        if moving:  # that of a step which is then rejected does as well
            self._follows = spectrum - self.u
        relative, found = 0.0, spectrum.view(np.float64)
        loudness = modes_loop.loudness(self._measure, self._kappa, found)
        for v in (spectrum if deep else None, self._follows):
            if v is None:
                continue
            work, lacking, squares = modes_loop.means(self._twice, v.view(np.float64), force, lack)
            if work**2 > _NOTHING**2 * squares * loudness:
                relative = max(relative, lacking / work, key=abs)
        free = modes_loop.yielding(self._measure, self._kappa, lack, relative, force)
        return abs(relative), math.sqrt(free)

    def state(self) -> State:
        """Return the history, and how the surface moved last."""
        moved = {"follows": self._follows, "velocity": self._velocity}
        known = {name: value for name, value in moved.items() if value is not None}
        return {**super().state(), **known, "last_step": self._last_step}

    def restore(self, state: State) -> None:
        """Go on from there."""
        super().restore(state)
        self._follows, self._velocity = state.get("follows"), state.get("velocity")
        self._last_step = float(state["last_step"])

    def _curvature(self, spectrum: ComplexArray) -> ComplexArray | None:
        """dt^2 u''/2 by the divided difference of the last three displacements, this one among them."""
        if self._velocity is None:
            return None
        if self._bent is None or self._bent[0] is not spectrum:
            share = self.step / (self.step + self._last_step)
            known = (each.view(np.float64) for each in (spectrum, self.u, self._velocity))
            self._bent = spectrum, modes_loop.curvature(share, self.step, *known).view(np.complex128)
        return self._bent[1]

    def _mean(self, f: ComplexArray, g: ComplexArray) -> float:
        """Mean of f g over the surface."""
        return float(modes_loop.means(self._twice, *(x.view(np.float64) for x in (f, g, g)))[0])
