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
the best of them, so that the bound holds. Where sin delta is close to 1, `Pivoting` starts from the last
contact. It knows neither attraction, hardness nor ranks; these need the mixing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gfmdlayer.arrays import BoolArray, ComplexArray, FloatArray
from gfmdlayer.contact.problem import Problem, Solution, Solver, make_solution, project, surface_at
from gfmdlayer.contact.residual import scales_over
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.grid.transforms import Plans, Transforms, backward, forward
from gfmdlayer.kernels import kernel, product, quotient

# Contact with a large loss stiffness, by guesses of the contact set
#
# With the compliance C = 1/(kappa + i mu) of each mode, the gap of a pressure p is g = h - u_free + C p,
# less a rise of the surface where the mean pressure is given. In contact g = 0: linear equations for p
# there. GMRES solves them after a product with the stiffness, restricted to the contact as they are, so
# that their residual is a pressure. Then the points that contradict the guess change sides: those under
# tension, and those that overlap. If that does not make them fewer for a while, only one of them does,
# which must end as C is positive definite (J. J. Judice, F. M. Pires, Comput. Oper. Res. 21 (1994)
# 587-596).
#
# Where GMRES fails, as under a stiff film on a soft base, and the contact is small, the equations are solved
# by elimination. Without contact there is nothing to solve. Where guesses do not end, the contact of a small
# grid is followed from first touch while the punch is pressed in, one point after the other (C. E. Lemke,
# Manage. Sci. 11 (1965) 681, with the depth of the punch as his parameter). This ends, as C is positive
# definite.

Spectral = npt.NDArray[np.complexfloating[Any, Any]]

_MOST_ROUNDS, _PATIENCE = 200, 8
_LINEAR = 1e-5  # of the tolerance: how well the linear equations are solved
_KRYLOV, _RESTARTS = 60, 10
_DENSE = 1500  # points in contact up to which elimination takes less than some tenths of a second
_MOST_FOLLOWED = 512  # points of a grid whose contact is followed from first touch
_ROUNDING = 1e-15  # of the deepest point: gaps below it are rounding


class PivotedState(NamedTuple):
    """Displacement, its spectrum, the pressure that follows from it, and where there is contact."""

    displacement: FloatArray
    spectrum: ComplexArray
    pressure: FloatArray
    contact: BoolArray


class Pivoting:
    """The linear algebra of one problem; counts FFT pairs (`transforms`) and contact sets (`rounds`)."""

    def __init__(self, problem: Problem, transforms: Transforms, tolerance: float) -> None:
        self._problem, self._plans, self._tolerance = problem, transforms, tolerance
        self.transforms = self.rounds = 0
        assert problem.loss_stiffness is not None
        self._stiffness = problem.stiffness + 1j * problem.loss_stiffness
        self._stiffest = float(np.abs(self._stiffness).max())
        stiff = problem.stiffness > 0
        self._compliance = (stiff / np.where(stiff, self._stiffness, 1)).astype(np.complex128)
        self._free_gap = problem.obstacle - self._field(self._compliance * problem.intercept)
        # Gap at each point of a pressure at the first one, for elimination.
        self._influence: FloatArray | None = None

    def solve(self, contact: BoolArray) -> tuple[PivotedState, PivotedState]:
        """Return the state of the contact set without contradiction, or of the last tried, in two forms."""
        # One has the pressure of its displacement, the other that of the linear equations, which is the
        # better where the stiffness of the modes spans so many decades that rounding of u shows in the force.
        fewest, patience = contact.size + 1, _PATIENCE
        for _ in range(_MOST_ROUNDS):
            self.rounds += 1
            if self._problem.mean_pressure == 0.0:
                contact = np.zeros_like(contact)
            pressure, gap = self._balanced(contact)
            # A gap weighs as much as the pressure that the stiffest wave would make of it.
            slack = _LINEAR * self._tolerance * pressure.max() / self._stiffest
            deepest = np.abs(self._problem.obstacle - gap).max()
            wrong = np.where(contact, pressure < 0, gap < -max(slack, _ROUNDING * deepest))
            count = int(wrong.sum())
            if count == 0:
                break
            patience = patience - 1 if count >= fewest else _PATIENCE
            fewest = min(fewest, count)
            if patience < 0:
                wrong[: np.flatnonzero(wrong)[-1]] = False
            contact = contact ^ wrong
        recomputed = self._state(gap, pressure, contact)
        if not -gap.min() <= _LINEAR * self._tolerance * deepest:
            return recomputed, recomputed
        u = np.minimum(self._problem.obstacle, self._problem.obstacle - gap)
        return recomputed, PivotedState(u, self._plans.forward(u), pressure, contact)

    def pressed_in(self) -> BoolArray:
        """Contact set at the given depth or load, followed from first touch."""
        # With the punch lowered by z its pressure is linear in z until a point joins or leaves.
        load, size = self._problem.mean_pressure, self._free_gap.size
        self._influence = self._field(self._compliance.copy())
        lowered, last = float(self._free_gap.min()), int(self._free_gap.argmin())
        contact = np.arange(size) == last
        for _ in range(20 * size):
            self.rounds += 1
            fixed, rate = np.zeros(size), np.zeros(size)
            fixed[contact] = self._eliminated(contact, -self._free_gap[contact])
            rate[contact] = self._eliminated(contact, np.ones(int(contact.sum())))
            gap, opening = self._free_gap + self._response(fixed), self._response(rate) - 1.0
            end, rise = 0.0, float(rate.sum())
            if load is not None:
                end = (load * size - float(fixed.sum())) / rise if rise > 0 else np.inf
            # Where a pressure or a gap vanishes; of the point that has changed sides both still do.
            zero, slope = np.where(contact, fixed, gap), np.where(contact, rate, opening)
            falls = slope < 0
            falls[last] = False
            at = np.full(size, np.inf)
            at[falls] = np.maximum(-zero[falls] / slope[falls], lowered)
            last = int(at.argmin())
            if at[last] >= end:
                break
            lowered, contact = float(at[last]), contact ^ (np.arange(size) == last)
            if not contact.any():
                break
        return np.asarray(contact)

    def _balanced(self, contact: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Pressure on a contact set, and the gap everywhere."""
        load, rise = self._problem.mean_pressure, 0.0
        if not contact.any():
            rise = 0.0 if load is None else float(self._free_gap.min())
            return np.zeros(contact.size), self._free_gap - rise
        if load is not None and contact.all():  # a shift of the punch alone takes no pressure
            pressure = load + self._field(self._stiffness * self._plans.forward(-self._free_gap))
            gap = self._free_gap + self._response(pressure)
            return pressure, gap - float(gap.mean())
        pressure = self._closing(contact, -self._free_gap[contact])
        if load is not None:
            lifted = self._closing(contact, np.ones(int(contact.sum())))
            rise = (load - float(pressure.mean())) / float(lifted.mean())
            pressure += rise * lifted
        return pressure, self._free_gap + self._response(pressure) - rise

    def _closing(self, contact: BoolArray, gap: FloatArray) -> FloatArray:
        """Pressure on the contact that opens it by a gap; zero elsewhere."""
        from scipy.sparse.linalg import LinearOperator, gmres  # a long import for what few runs need

        pressure = np.zeros(contact.size)
        if self._influence is not None and gap.size <= _DENSE:
            pressure[contact] = self._eliminated(contact, gap)
            return pressure

        def restricted(spectral: Spectral, values: FloatArray) -> FloatArray:
            field = np.zeros(contact.size)
            field[contact] = values
            return self._field(spectral * self._plans.forward(field))[contact]

        operator = LinearOperator(
            (gap.size, gap.size),
            matvec=lambda p: restricted(self._stiffness, restricted(self._compliance, np.ravel(p))),
            dtype=np.float64,
        )
        right = restricted(self._stiffness, gap)
        rtol = _LINEAR * self._tolerance
        solution, failed = gmres(operator, right, rtol=rtol, restart=_KRYLOV, maxiter=_RESTARTS)
        if failed and gap.size <= _DENSE:
            self._influence = self._field(self._compliance.copy())
            return self._closing(contact, gap)
        pressure[contact] = solution
        return pressure

    def _eliminated(self, contact: BoolArray, gap: FloatArray) -> FloatArray:
        """Pressure on the points of the contact that opens them by a gap."""
        assert self._influence is not None
        shape = self._plans.shape
        places = np.array(np.unravel_index(np.flatnonzero(contact), shape))
        apart = (places[:, :, None] - places[:, None, :]) % np.reshape(shape, (-1, 1, 1))
        matrix = self._influence.reshape(shape)[tuple(apart)]
        # Far below the tolerance, and enough for a matrix that is singular to rounding.
        matrix[np.diag_indices(gap.size)] *= 1.0 + 1e-13
        try:
            return np.linalg.solve(matrix, gap)
        except np.linalg.LinAlgError:
            return np.asarray(np.linalg.lstsq(matrix, gap, rcond=None)[0])

    def _response(self, pressure: FloatArray) -> FloatArray:
        return self._field(self._compliance * self._plans.forward(pressure))

    def _field(self, spectrum: ComplexArray) -> FloatArray:
        self.transforms += 1
        return self._plans.backward(spectrum) / self._problem.obstacle.size

    def _state(self, gap: FloatArray, pressure: FloatArray, contact: BoolArray) -> PivotedState:
        """Displacement that satisfies the constraints, and its own pressure."""
        problem = self._problem
        u = np.where(contact, problem.obstacle, problem.obstacle - gap)
        project(u, problem.obstacle, problem.mean_is_fixed)
        spectrum = self._plans.forward(u)
        force = self._field(problem.intercept - self._stiffness * spectrum)
        multiplier = problem.applied_pressure
        if problem.mean_is_fixed and contact.any():
            multiplier = float(np.mean((pressure - force)[contact]))
        return PivotedState(u, spectrum, force + multiplier, contact)


SHARE = 0.3  # of the tolerance is left to a problem without loss, so that the iteration's error shows
_MOST_PROBLEMS = 12
_MOST_ALONE = 100  # where no other method takes over
_MIXED = 6  # surfaces at most


class LossArrays(NamedTuple):
    """Work arrays of `LossStiffnessSolver`, one value a mode, and a field."""

    difference: ComplexArray  # s - kappa - i mu
    intercept: ComplexArray  # of the problem without loss
    first: ComplexArray  # guess of the displacement
    left: ComplexArray
    field: FloatArray


class LossStiffnessSolver:
    """Solves problems with a loss stiffness by a solver for problems without, to `SHARE` of the tolerance."""

    def __init__(self, solver: Solver, transforms: Transforms, weights: FloatArray) -> None:
        # `weights` are those of each mode in the mean over the surface.
        self.starts_from = solver.starts_from
        self.compile, self.state, self.restore = solver.compile, solver.state, solver.restore
        self.inner, self._transforms = solver, transforms
        self._weights = np.ravel(weights)
        spectrum, field = transforms.empty_spectrum, transforms.empty_field
        self.arrays = LossArrays(spectrum(), spectrum(), spectrum(), spectrum(), field())

    def solve(
        self, problem: Problem, start: FloatArray, tolerance: float = 1e-6, limit: int = 20_000
    ) -> Solution:
        """Solve from a first guess of the field that the solver starts from."""
        if problem.loss_stiffness is None:
            return self.inner.solve(problem, start, SHARE * tolerance, limit)
        arrays, plans, symmetric = self.arrays, self._transforms.plans, np.empty_like(problem.stiffness)
        set_symmetric(problem.stiffness, problem.loss_stiffness, symmetric, arrays.difference)
        mixture = Mixing(_MIXED, symmetric * self._weights, problem.ranks)
        last = self._guess(problem, start)
        transforms, iterations, released = 1, 0, 0.0
        # Pivoting knows neither attraction nor hardness nor ranks.
        alone = problem.interface.attracts or problem.hardness < np.inf or problem.ranks.count > 1
        for _ in range(_MOST_ALONE if alone else _MOST_PROBLEMS):
            set_intercept(problem.intercept, arrays.difference, last, arrays.intercept)
            solution = self.inner.solve(
                replace(problem, stiffness=symmetric, intercept=arrays.intercept, loss_stiffness=None),
                start,
                SHARE * tolerance,
                limit,
            )
            pressure, size = np.empty_like(solution.pressure), float(self._transforms.size)
            add_loss(plans, arrays, solution.spectrum, last, solution.pressure, size, pressure)
            transforms += solution.transforms + 1
            iterations += solution.iterations
            released += solution.released_energy
            state = _with_loss(problem, solution, pressure, (transforms, iterations), tolerance)
            if state.converged or not solution.converged:
                break
            last = mixture.next(last, solution.spectrum)
            start = getattr(solution, self.starts_from)
        if problem.hardness < np.inf:
            yields = problem.at_hardness(solution.pressure, solution.gap)
            state = replace(state, pressure=problem.capped(state.pressure, yields))
        if problem.interface.attracts:
            return replace(state, released_energy=released, margin=solution.margin)
        contact = solution.pressure > 0
        if not state.converged and not alone:
            state, contact = self._by_pivoting(problem, state, contact, tolerance)
        # Out of contact, stress within the tolerance is set to zero.
        set_free(contact, state.pressure)
        return state

    def _by_pivoting(
        self, problem: Problem, so_far: Solution, contact: BoolArray, tolerance: float
    ) -> tuple[Solution, BoolArray]:
        """Solve from the last contact set, then from one that is followed from first touch."""
        state = so_far
        for followed in (False, True):
            pivoting = Pivoting(problem, self._transforms, tolerance)
            if followed:
                small = state.pressure.size <= _MOST_FOLLOWED
                contact = pivoting.pressed_in() if small else state.pressure > 0
            forms = pivoting.solve(contact)
            spent = state.transforms + pivoting.transforms, state.iterations + pivoting.rounds
            for u, spectrum, pressure, contact in forms:
                state = make_solution(problem, u, pressure, spectrum, spent=spent, within=tolerance)
                if state.converged:
                    return state, contact
        return state, contact

    def _guess(self, problem: Problem, start: FloatArray) -> ComplexArray:
        """Spectrum of the displacement that belongs to a first guess, but for the mean."""
        if self.starts_from == "gap":
            return self._transforms.forward(surface_at(problem, start))
        if self.starts_from == "displacement":
            return self._transforms.forward(start)
        assert problem.loss_stiffness is not None
        set_first(
            self._transforms.plans, problem.stiffness, problem.loss_stiffness, problem.intercept, start,
            self.arrays,
        )  # fmt: skip
        return self.arrays.first


def _with_loss(
    problem: Problem, solution: Solution, pressure: FloatArray, spent: tuple[int, int], tolerance: float
) -> Solution:
    """Return the solution of a problem without loss with the pressure of `add_loss`."""
    flow, gap, under = solution.flow, None, problem
    if flow is not None:
        gap, under = solution.gap, replace(problem, obstacle=problem.obstacle + flow)
    u, spectrum = solution.displacement, solution.spectrum
    state = make_solution(under, u, pressure, spectrum, spent=spent, within=tolerance, gap=gap, flow=flow)
    if flow is None:
        return state
    wall = state.wall_pressure
    over, scale = wall - problem.hardness, scales_over(problem.ranks, wall, u, problem.residual_floor)[0]
    over = np.where(problem.at_hardness(solution.pressure, solution.gap), abs(over), over)
    residual = max(state.residual, problem.ranks.maximum(float(over.max())) / scale)
    return replace(state, residual=residual, converged=residual <= tolerance)


@kernel(borrows=True)
def set_symmetric(
    stiffness: FloatArray, loss_stiffness: FloatArray, symmetric: FloatArray, difference: ComplexArray
) -> None:
    """Write s = (kappa^2 + mu^2)/kappa and s - kappa - i mu."""
    for k in range(stiffness.size):
        extra = loss_stiffness[k] * loss_stiffness[k] / stiffness[k] if stiffness[k] > 0.0 else 0.0
        symmetric[k], difference[k] = stiffness[k] + extra, complex(extra, -loss_stiffness[k])


@kernel(borrows=True)
def set_first(
    plans: Plans,
    stiffness: FloatArray,
    loss_stiffness: FloatArray,
    b: ComplexArray,
    start: FloatArray,
    arrays: LossArrays,
) -> None:
    """Write the displacement under a first guess of the pressure, but for the mean."""
    first, field = arrays.first, arrays.field
    for i in range(field.size):
        field[i] = start[i]
    forward(plans, field, first)
    for k in range(first.size):
        stiff = stiffness[k] > 0.0
        first[k] = quotient(b[k] - first[k], complex(stiffness[k], loss_stiffness[k])) if stiff else 0.0


@kernel(borrows=True)
def set_intercept(
    b: ComplexArray, difference: ComplexArray, last: ComplexArray, intercept: ComplexArray
) -> None:
    """Write b + (s - kappa - i mu) u_last."""
    for k in range(b.size):
        intercept[k] = b[k] + product(difference[k], last[k])


@kernel(borrows=True)
def add_loss(
    plans: Plans,
    arrays: LossArrays,
    u: ComplexArray,
    last: ComplexArray,
    without: FloatArray,
    size: float,
    pressure: FloatArray,
) -> None:
    """Add the loss that a problem without loss has left to its pressure; one transform."""
    left, field = arrays.left, arrays.field
    for k in range(left.size):
        left[k] = product(arrays.difference[k], u[k] - last[k])
    backward(plans, left, field)
    for i in range(pressure.size):
        pressure[i] = without[i] + field[i] / size


@kernel(borrows=True)
def set_free(contact: BoolArray, pressure: FloatArray) -> None:
    """Set tension to zero, and any pressure out of contact."""
    for i in range(pressure.size):
        if not contact[i] or pressure[i] < 0.0:
            pressure[i] = 0.0


class Mixing:
    """Anderson mixing of a fixed-point iteration: the next guess from the last ones and their results."""

    def __init__(self, most: int, weight: float | FloatArray = 1.0, ranks: Ranks = ALONE) -> None:
        # `most` results are mixed. `weight` of each value in the square of a step.
        self._most, self._weight, self._ranks = most, weight, ranks
        self._results: list[Spectral] = []
        self._steps: list[Spectral] = []
        self._best = np.inf

    def next(self, tried: Any, result: Any) -> Any:
        """Add a guess and its result; return the next guess."""
        step = result - tried
        size = self._ranks.total(self._part(step, step))
        if size == 0:
            return result
        if size > self._best:
            last = self._results[-1]
            self._results, self._steps = [], []
            self._best = np.inf
            return last
        self._best = size
        self._results = [*self._results[1 - self._most :], result]
        self._steps = [*self._steps[1 - self._most :], step]
        if len(self._steps) == 1:
            return result
        products = np.array([[self._part(f, g) for f in self._steps] for g in self._steps])
        gram = self._ranks.total(products) / size
        shares = np.linalg.pinv(gram, rcond=1e-12, hermitian=True).sum(axis=0)
        if not abs(shares.sum()) > 0:
            return result
        return np.asarray(np.tensordot(shares / shares.sum(), np.array(self._results), axes=1))

    def _part(self, f: Spectral, g: Spectral) -> float:
        """Mean of f g, of the values of this process."""
        return float(np.sum(self._weight * (f.real * g.real + f.imag * g.imag)))
