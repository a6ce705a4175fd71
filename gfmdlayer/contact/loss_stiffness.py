"""Contact under a moving punch, where the stiffness of a mode has an imaginary part.

With the loss stiffness mu of a mode the force f = IFFT(-(kappa + i mu) FFT(u) + b) has no energy: the
pressure of a travelling wave leads the displacement by an angle delta, tan delta = |mu|/kappa. The problem is
a variational inequality with a monotone operator. It is solved by a sequence of problems that have an energy,
with a stiffness s of a mode in place of kappa + i mu, and the difference taken from the last u,

    f = IFFT(-s FFT(u) + b + (s - kappa - i mu) FFT(u_last)),        s = (kappa^2 + mu^2)/kappa

In the norm of s the solution of each problem is a contraction of its right-hand side, and the difference is
sin delta of s, the least that a real s gives. So the distance to the solution falls by a factor sin delta at
least, which is of the order of dt/tau for short steps. For longer ones the surfaces are mixed (D. G.
Anderson, J. ACM 12 (1965) 547-560). Whenever that brings them no nearer, the plain iteration continues from
the best of them, so that the bound holds. Where sin delta is close to 1, `pivoting` starts from the contact
found so far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray
from gfmdlayer.contact.pivoting import Pivoting
from gfmdlayer.contact.problem import Problem, Solution, Solver, make_solution, surface_at
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.resumable import State

SHARE = 0.3  # of the tolerance is left to a problem without loss, so that the iteration's error shows
_MOST_PROBLEMS = 12
_MOST_ATTRACTED = 100  # where no other method takes over
_SHARES = (1.0, 0.02, 0.04, 0.08, 0.16, 0.32, 0.5, 0.7, 0.85, 1.0)
_MIXED = 6  # surfaces at most


def with_loss(
    made: Callable[[float, int], Solver],
    transforms: Transforms,
    weights: FloatArray,
    tolerance: float,
    iterations: int,
) -> LossStiffnessSolver:
    """Return the solver around one that `made` makes for a tolerance and a maximum of iterations."""
    return LossStiffnessSolver(made(SHARE * tolerance, iterations), transforms, tolerance, weights)


class LossStiffnessSolver:
    """Solves problems with a loss stiffness by a solver for problems without.

    Parameters
    ----------
    solver : Solver
        To `SHARE` of the tolerance.
    transforms : Transforms
        Of the grid.
    tolerance : float
        On the residual, with the loss stiffness in the force.
    weights : ndarray, one value a mode
        Weight of each mode in the mean over the surface.
    """

    def __init__(self, solver: Solver, transforms: Transforms, tolerance: float, weights: FloatArray) -> None:
        self.starts_from = solver.starts_from
        self._solver, self._transforms = solver, transforms
        self._tolerance, self._weights = tolerance, np.ravel(weights)

    def solve(self, problem: Problem, start: FloatArray) -> Solution:
        """Solve from a first guess of the field that the solver starts from."""
        if problem.loss_stiffness is None:
            return self._solver.solve(problem, start)
        stiff = problem.stiffness > 0
        extra = np.divide(problem.loss_stiffness**2, problem.stiffness, where=stiff, out=np.zeros(stiff.size))
        symmetric = problem.stiffness + extra
        difference = extra - 1j * problem.loss_stiffness
        mixture = _Mixture(symmetric * self._weights)
        last = self._guess(problem, start)
        transforms, iterations, released = 1, 0, 0.0
        for _ in range(_MOST_ATTRACTED if problem.interface.attracts else _MOST_PROBLEMS):
            intercept = problem.intercept + difference * last
            solution = self._solver.solve(
                replace(problem, stiffness=symmetric, intercept=intercept, loss_stiffness=None), start
            )
            change = self._transforms.backward(difference * (solution.spectrum - last)) / start.size
            transforms += solution.transforms + 1
            iterations += solution.iterations
            released += solution.released_energy
            state = make_solution(
                problem,
                solution.displacement,
                solution.pressure + change,
                solution.spectrum,
                spent=(transforms, iterations),
                within=self._tolerance,
            )
            if state.converged or not solution.converged:
                break
            last = mixture.next(last, solution.spectrum)
            start = getattr(solution, self.starts_from)
        if problem.interface.attracts:
            return replace(state, released_energy=released, margin=solution.margin)
        contact = solution.pressure > 0
        if not state.converged:
            state, contact = self._by_pivoting(problem, state, contact)
        # Out of contact, stress within the tolerance is set to zero.
        return replace(state, pressure=np.where(contact, np.maximum(state.pressure, 0), 0.0))

    def compile(self) -> None:
        """Compile the solver's own kernels."""
        if hasattr(self._solver, "compile"):
            self._solver.compile()

    def state(self) -> State:
        """Return the state of the solver."""
        return self._solver.state()

    def restore(self, state: State) -> None:
        """Continue from a state."""
        self._solver.restore(state)

    def _by_pivoting(
        self, problem: Problem, so_far: Solution, contact: BoolArray
    ) -> tuple[Solution, BoolArray]:
        state = so_far
        for share in _SHARES:  # at once, or by way of the contacts with a part of the loss
            part = replace(
                problem,
                loss_stiffness=None if problem.loss_stiffness is None else share * problem.loss_stiffness,
            )
            state, contact = self._attempt(problem, part, state, contact)
            if share == 1 and state.converged:
                return state, contact
        return self._attempt(problem, problem, state, None)

    def _attempt(
        self, problem: Problem, part: Problem, so_far: Solution, contact: BoolArray | None
    ) -> tuple[Solution, BoolArray]:
        """State of a problem with a part of the loss, from a contact, or followed from first touch."""
        pivoting = Pivoting(part, self._transforms, self._tolerance)
        if contact is None:
            contact = pivoting.pressed_in() if pivoting.follows else so_far.pressure > 0
        found = pivoting.solve(contact)
        spent = so_far.transforms + pivoting.transforms, so_far.iterations + pivoting.rounds
        for u, spectrum, pressure, contact in found:  # noqa: B007
            state = make_solution(problem, u, pressure, spectrum, spent=spent, within=self._tolerance)
            if state.converged:
                break
        return state, contact

    def _guess(self, problem: Problem, start: FloatArray) -> ComplexArray:
        """Spectrum of the displacement that belongs to a first guess, but for the mean."""
        if self.starts_from == "gap":
            return self._transforms.forward(surface_at(problem, start))
        spectrum = self._transforms.forward(start)
        if self.starts_from == "displacement":
            return spectrum
        stiffness = problem.stiffness + 1j * (
            problem.loss_stiffness if problem.loss_stiffness is not None else 0.0
        )
        stiff = problem.stiffness > 0
        return np.asarray(np.where(stiff, problem.intercept - spectrum, 0) / np.where(stiff, stiffness, 1))


class _Mixture:
    """Anderson mixing: the displacement to try next, from those tried and those found with them."""

    def __init__(self, weight: FloatArray) -> None:
        self._weight = weight
        self._found: list[ComplexArray] = []
        self._steps: list[ComplexArray] = []
        self._best = np.inf

    def next(self, tried: ComplexArray, found: ComplexArray) -> ComplexArray:
        """Add a displacement tried and the one found with it; return the next to try."""
        step = found - tried
        size = self._mean(step, step)
        if size > self._best:
            last = self._found[-1]
            self._found, self._steps = [], []
            self._best = np.inf
            return last
        self._best = size
        self._found = [*self._found[1 - _MIXED :], found]
        self._steps = [*self._steps[1 - _MIXED :], step]
        gram = np.array([[self._mean(f, g) for f in self._steps] for g in self._steps]) / size
        shares = np.linalg.pinv(gram, rcond=1e-12, hermitian=True).sum(axis=0)
        if not abs(shares.sum()) > 0:
            return found
        return np.asarray(np.tensordot(shares / shares.sum(), np.array(self._found), axes=1))

    def _mean(self, f: ComplexArray, g: ComplexArray) -> float:
        return float(np.sum(self._weight * (f.real * g.real + f.imag * g.imag)))
