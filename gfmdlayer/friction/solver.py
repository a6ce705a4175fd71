"""The solver of `FrictionProblem`: Newton's method from a guess or from nothing, by coarser grids.

Without friction the pressure is that of `contact.problem`, and shear follows from it: the problem goes to a
solver of that one.

Where the interface attracts, that solver follows the path of the surface under the last shear traction. With
its attraction kept, pressure of the wall and shear traction are those of a frictional contact under a hard
wall, in which the attraction is a load on the body. Both are repeated until the attraction at the gap stays
the same: at once where shear does not move the surface up and down, else in some rounds. Where an edge jumps
to and fro by grid points in the rounds, Newton's method finds the attraction that is that of its gap: the
map from one to the other is continuous and bounded, so that there is one (Brouwer).

A hardness is met in the same rounds: the height that surfaces lose under the last shear traction is part of
the punch, until pressures at the hardness stay there.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact import problem as frictionless
from gfmdlayer.contact.loss_stiffness import Mixing
from gfmdlayer.contact.solvers import AUTO, SOLVERS, choose
from gfmdlayer.friction.newton import INNER, FrictionNewton
from gfmdlayer.friction.problem import FrictionProblem, FrictionSolution, FrictionState
from gfmdlayer.friction.response import (
    AnyResponse,
    CroppedResponse,
    Operator,
    Response,
    Rolling,
    RollingResponse,
    SharedTransforms,
    Spent,
)
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.friction import ShearBound
from gfmdlayer.interface.law import HARD_WALL
from gfmdlayer.resumable import State as SavedState

_COARSEST = 16  # points of an axis
_COARSE_TOLERANCE = 1e-4
LIMIT = 60  # Newton steps
NOT_POSITIVE = (
    "without images the response is negative in some waves, for which attraction or a hardness beside "
    "friction has no solver; must be without friction, or have a softer film or grid.boundary: periodic"
)
_FIRST_PART, _LEAST_PART = 0.25, 1 / 64  # of the friction that is raised, where Newton's method fails
# Coarser grids improve a guess on a line down to these points, and to these points in contact an edge.
_FEWEST, _APART = 64, 64
_FEWEST_ROLLING = 10  # points along the contact on the coarsest grid of steady rolling
_UNSETTLED = "pressures at the hardness and shear traction do not settle; residual {:.2e}"
_ROUNDS = 40  # of normal and frictional contact, where the interface attracts or the surfaces yield
_STALLED = 6  # rounds without a smaller change of the attraction, before Newton's method
# Of that: steps, difference of the attraction in parts of the largest stress.
_NEWTON, _DIFFERENCE = 15, 1e-4
MIXED = 5  # rounds that the next one is mixed of
# Residual of a round in parts of the change of the attraction in the last one, and of the tolerance: errors
# of tractions move the gap, and with it the attraction, by up to a hundred times as much. And the least one.
_OF_A_ROUND, _FINER, _LEAST_TOLERANCE = 0.01, 0.1, 1e-9


class FrictionSolver:
    """Frictional contact of the steps of a run on a grid of one or two axes."""

    starts_from: ClassVar[Literal["pressure"]] = "pressure"

    def __init__(
        self,
        grid: Grid,
        transforms: Transforms,
        *,
        rough: bool = False,
        attracts: bool = False,
        yields: bool = False,
    ) -> None:
        # `rough`: the punch is rough, for the choice of the solver without friction. `attracts`, `yields`:
        # problems may have an interface that attracts, or a hardness.
        self._spent, self._transforms, self._ranks = Spent(), transforms, grid.ranks
        shared = rough or grid.ranks.count > 1  # the solver of smooth punches is one of a single process
        self._choice = choose(AUTO, axes=len(grid.points), rough=shared, attracts=attracts, yields=yields)
        self._mark = ""  # digest of the last response before the run was resumed
        self._levels = [FrictionLevel(grid, transforms, self._spent, 1.0)]
        while (coarser := self._levels[-1].coarser()) is not None:
            self._levels.append(coarser)

    def solve(
        self,
        problem: FrictionProblem,
        start: FloatArray | None = None,
        *,
        gap: FloatArray | None = None,
        tolerance: float = 1e-7,
        limit: int = LIMIT,
    ) -> FrictionSolution:
        """Solve from a guess of the tractions (p, t_x[, t_y]), or from nothing."""
        # Where the interface attracts, the path of the surface begins at the `gap` of the last step.
        self._spent.pairs = 0.0
        if not problem.is_finite:
            raise ValueError("heights, loads or displacements of the frictional contact are not finite")
        if start is not None and self._any(~np.isfinite(start)):
            start = None
        if reason := problem.why_not_solvable():
            raise ValueError(reason)
        if self._mark and self._mark != problem.response.digest:
            for level in self._levels:  # the kernels of windows of a resumed run count anew
                level.counted.clear()
        self._mark = ""
        if problem.way is not None:
            return self._rolled(problem, problem.way, tolerance, limit)
        if problem.is_frictionless and problem.response.is_positive:
            return self._smooth(
                problem, *self._pressed(problem, None, start, gap, tolerance, limit), tolerance
            )
        if problem.interface.attracts or problem.yields:
            if not problem.response.is_positive:
                raise ValueError(NOT_POSITIVE)
            return self._in_rounds(problem, start, gap, tolerance, limit)
        if problem.is_frictionless:  # no force acts on the punch, and its path is none
            problem = replace(problem, force=None)
        at, steps = self._under_a_wall(problem, start, tolerance, limit)
        return _solution(problem, at, steps, self._spent.pairs, tolerance)

    def respond(self, problem: FrictionProblem, loads: FloatArray) -> tuple[FloatArray, float]:
        """Return the displacements W, u_x[, u_y] under tractions, and the FFT pairs."""
        before = self._spent.pairs
        found = self._levels[0].newton(problem.response).displacements(loads)
        return found, self._spent.pairs - before

    def _rolled(self, problem: FrictionProblem, way: float, tolerance: float, limit: int) -> FrictionSolution:
        """Solve for the state that repeats itself after a way along x; no displacements along the surface."""
        grid, of = self._levels[0].grid, problem.response
        assert not isinstance(of, RollingResponse)
        plain = of.plain if isinstance(of, CroppedResponse) else of
        parts = (np.abs(part) for part in (plain.normal, plain.coupling, plain.along, plain.across))
        still = Response(*parts, ranks=plain.ranks)
        smooth = replace(problem, response=still, law=ShearBound(0.0), force=None)
        _, pressed = self._pressed(smooth, None, None, None, _COARSE_TOLERANCE, limit)
        start = np.zeros((1 + len(grid.points), problem.heights.size))
        start[0] = pressed.pressure
        touching = (start[0] > 0).reshape(grid.shape)
        along = self._ranks.total(int(np.count_nonzero(touching.any(axis=tuple(range(1, touching.ndim))))))
        rolling = Rolling.over(way, of, grid, along)
        unit = rolling.length / abs(way)
        scaled = replace(
            problem,
            way=None,
            response=RollingResponse(of, rolling),
            path=None if problem.path is None else problem.path * unit,
            before=None if problem.before is None else problem.before * unit,
        )
        deepest = 0
        while deepest + 1 < len(self._levels) and along >> deepest + 1 >= _FEWEST_ROLLING:
            deepest += 1
        at, steps = self._solve(scaled, start, 0, deepest, tolerance, limit)
        if not at.residual < tolerance and not (problem.law.sticks or problem.is_frictionless):
            at, steps = self._gradually(scaled, at, tolerance, limit)
        found = _solution(scaled, at, steps, self._spent.pairs, tolerance)
        return replace(found, slip=found.slip / unit, path=found.path / unit)

    def _under_a_wall(
        self,
        problem: FrictionProblem,
        start: FloatArray | None,
        tolerance: float,
        limit: int,
        *,
        near: bool = False,
    ) -> tuple[FrictionState, int]:
        """Solve without attraction; a guess that is `near` needs no coarser grids."""
        last = len(self._levels) - 1
        if start is not None:
            deepest = 0 if near else _levels_of(start, self._levels[0].grid)
            at, steps = self._solve(problem, start, 0, deepest, tolerance, limit)
        if start is None or not at.residual < tolerance:
            at, steps = self._solve(problem, None, 0, last, tolerance, limit)
        gradual = not (problem.law.sticks or problem.is_frictionless)
        if not at.residual < tolerance and gradual:
            at, steps = self._gradually(problem, at, tolerance, limit)
        return at, steps

    def displacements(self, response: AnyResponse, tractions: FloatArray) -> FloatArray:
        """Return the displacements W, u_x[, u_y] under tractions p, t_x[, t_y]."""
        return self._levels[0].newton(response).displacements(tractions)

    def compile(self) -> None:
        """Compile the kernels of the solver without friction, where the interface attracts."""
        # Else only a failed solve calls them.
        if SOLVERS[self._choice.method].adhesive:
            self._frictionless.compile()

    def state(self) -> SavedState:
        """Return the windows whose kernels are known, and the state of the solver without friction."""
        every = [(i, *window) for i, level in enumerate(self._levels) for window in level.windows]
        last, smooth = self._levels[0].response, {}
        if "_frictionless" in vars(self):
            smooth = {f"frictionless.{name}": value for name, value in self._frictionless.state().items()}
        windows = {} if last is None else {"mark": last.digest, "windows": np.array(every).reshape(-1, 3)}
        return windows | smooth

    def restore(self, state: SavedState) -> None:
        """Continue from a state."""
        smooth = {
            name.removeprefix("frictionless."): value
            for name, value in state.items()
            if name.startswith("frictionless.")
        }
        if smooth:
            self._frictionless.restore(smooth)
        if "mark" in state:
            self._mark = str(state["mark"])
            for level, *window in state["windows"].tolist():
                self._levels[level].counted.add(tuple(window))

    @cached_property
    def _frictionless(self) -> frictionless.Solver:
        """The solver without friction."""
        declared = SOLVERS[self._choice.method]
        options = {"grid": self._levels[0].grid} if declared.distributed else {}
        solver: frictionless.Solver = declared.load()(self._transforms, **options)
        return solver

    def _pressed(
        self,
        problem: FrictionProblem,
        shear: FloatArray | None,
        start: FloatArray | None,
        gap: FloatArray | None,
        tolerance: float,
        limit: int,
    ) -> tuple[frictionless.Problem, frictionless.Solution]:
        """Solve for the pressure under a given shear traction, or none."""
        compliance, h = np.ravel(problem.response.normal), problem.gap_at_rest
        stiffness = np.divide(1, compliance, out=np.zeros(compliance.size), where=compliance > 0)
        if problem.load is not None:
            self._ranks.set_mean_wave(stiffness, 0.0)  # the mean displacement is part of the depth
        if shear is not None and problem.response.couples and self._any(shear):
            lifted = np.vstack((np.zeros((1, h.size)), shear))
            h = h + self._levels[0].newton(problem.response).displacements(lifted)[0]
        normal_problem = frictionless.Problem(
            stiffness,
            np.zeros(stiffness.size, dtype=np.complex128),
            h - (problem.depth if problem.load is None else 0.0),
            problem.load,
            height=self._ranks.maximum(float(problem.heights.max()))
            - self._ranks.minimum(float(problem.heights.min())),
            interface=problem.interface,
            ranks=self._ranks,
            hardness=problem.hardness,
        )
        if SOLVERS[self._choice.method].starts_from == "gap":
            guess = np.full(h.size, np.inf) if gap is None else gap.copy()
        else:
            guess = np.zeros(h.size) if start is None else start[0].copy()
        normal = self._frictionless.solve(normal_problem, guess, tolerance, limit * INNER)
        self._spent.pairs += normal.transforms
        return normal_problem, normal

    def _smooth(
        self,
        problem: FrictionProblem,
        normal_problem: frictionless.Problem,
        normal: frictionless.Solution,
        tolerance: float,
    ) -> FrictionSolution:
        """Return a contact without shear; the displacement of a punch on which no force acts is none."""
        p, depth, attraction = normal.pressure, problem.depth, None
        if problem.load is not None:
            compliance = float(self._ranks.mean_wave(np.ravel(problem.response.normal)))
            depth = self._ranks.mean(normal.displacement) + compliance * problem.load
        if problem.interface.attracts:
            attraction = problem.interface.traction(normal.gap)
            p = _of_the_wall(p, attraction, normal.gap)
        C, _ = self._levels[0].newton(problem.response).operators
        u = C.shear_of(-normal_problem.stiffness * normal.spectrum)
        path, why = np.zeros(len(u)) if problem.path is None else problem.path, ""
        if not normal.converged:
            why = frictionless.why_not_converged(normal_problem, normal, self._choice.method, tolerance)
        displacement = np.vstack((normal.gap + depth - _raised(problem.heights, normal.flow), u))
        if problem.offset is not None:
            displacement[1:] += problem.offset[1:]
        return FrictionSolution(
            pressure=p,
            traction=np.zeros(u.shape),
            displacement=displacement,
            gap=normal.gap,
            slip=problem.slip_at_rest + u - path[:, np.newaxis],
            depth=depth,
            path=path,
            stick=np.zeros(p.shape, dtype=bool),
            residual=normal.residual,
            pairs=self._spent.pairs,
            iterations=normal.iterations,
            converged=normal.converged,
            reason=why,
            attraction=attraction,
            released_energy=normal.released_energy,
            margin=normal.margin,
            flow=normal.flow,
        )

    def _in_rounds(
        self,
        problem: FrictionProblem,
        start: FloatArray | None,
        gap: FloatArray | None,
        tolerance: float,
        limit: int,
    ) -> FrictionSolution:
        """Solve for pressure and flow under the last shear, and for both under its attraction, in turns."""
        axes, law = problem.response.normal.ndim, problem.interface
        shear = np.zeros((axes, problem.heights.size)) if start is None else start[1:]
        released, steps, off = 0.0, 0, 1.0 if problem.response.couples else 0.0
        mixing = Mixing(MIXED, ranks=self._ranks)
        least = max(_FINER * tolerance, min(tolerance, _LEAST_TOLERANCE))
        best, stalled = math.inf, 0
        for turn in range(_ROUNDS):
            enough = max(least, min(_OF_A_ROUND * off, _COARSE_TOLERANCE))
            normal_problem, normal = self._pressed(problem, shear, start, gap, enough, limit)
            released, steps, gap = released + normal.released_energy, steps + normal.iterations, normal.gap
            attraction = law.traction(gap)
            p = _of_the_wall(normal.pressure, attraction, gap) if law.attracts else normal.pressure
            touches = self._any(p)
            if normal.converged and not touches and (self._any(shear) or normal.residual > tolerance):
                shear, mixing, off = np.zeros_like(shear), Mixing(MIXED, ranks=self._ranks), 0.0
                continue
            if not normal.converged or not touches:
                apart = self._smooth(problem, normal_problem, normal, tolerance)
                return replace(apart, released_energy=released, iterations=steps)
            raised = replace(problem, heights=_raised(problem.heights, normal.flow), hardness=math.inf)
            under = self._pulled(raised, attraction) if law.attracts else raised
            if reason := under.why_not_solvable():
                apart = self._smooth(problem, normal_problem, normal, tolerance)
                return replace(apart, iterations=steps, converged=False, reason=reason)
            start = np.vstack((p[np.newaxis], shear))
            at, more = self._under_a_wall(under, start, enough, limit, near=turn > 0)
            steps += more
            solution = _solution(under, at, steps, self._spent.pairs, enough)
            change = np.abs(law.traction(np.maximum(solution.gap, 0.0)) - attraction)
            if problem.yields:
                solution, beyond = _up_to(problem.hardness, solution, normal.flow)
                change = np.maximum(change, beyond)
            most, *units = self._largest(change, p, attraction)
            off = most / max(units)
            solution = replace(
                solution,
                gap=np.where(solution.contact, 0.0, np.maximum(solution.gap, 0.0)),
                residual=max(solution.residual, off),
                attraction=attraction if law.attracts else None,
                released_energy=released,
                margin=normal.margin,
            )
            if not solution.converged or solution.residual < tolerance:
                return solution
            if math.isinf(best):
                jumped = released  # in the step; in later rounds an edge may jump to and fro
            stalled = 0 if off < best or math.isinf(best) else stalled + 1
            if stalled == 0:
                best, nearest = off, solution
            if stalled == _STALLED:
                break
            shear = mixing.next(shear, solution.traction)
        if problem.yields:
            return replace(
                nearest,
                iterations=steps,
                pairs=self._spent.pairs,
                converged=False,
                reason=_UNSETTLED.format(best),
            )
        found = self._at_once(problem, nearest, tolerance, limit)
        return replace(
            found, iterations=found.iterations + steps, released_energy=jumped, margin=normal.margin
        )

    def _pulled(self, problem: FrictionProblem, attraction: FloatArray) -> FrictionProblem:
        """Return the contact under a hard wall in which an attraction is a load on the body."""
        shear = np.zeros((problem.response.normal.ndim, attraction.size))
        newton = self._levels[0].newton(problem.response)
        pulled = newton.displacements(np.vstack((-attraction[np.newaxis], shear)))
        return replace(
            problem,
            load=None if problem.load is None else problem.load + self._ranks.mean(attraction),
            offset=pulled if problem.offset is None else problem.offset + pulled,
            interface=HARD_WALL,
        )

    def _at_once(
        self, problem: FrictionProblem, begun: FrictionSolution, tolerance: float, limit: int
    ) -> FrictionSolution:
        """Solve for the attraction that is that of its gap, by Newton's method from the best round."""
        from scipy.optimize import NoConvergence, newton_krylov

        assert begun.attraction is not None
        unit = max(self._largest(begun.pressure, begun.attraction))
        found, steps, grid = begun, 0, self._levels[0].grid

        def off(everywhere: FloatArray) -> FloatArray:
            nonlocal found, steps
            attraction = everywhere[grid.rows].ravel()
            under = self._pulled(problem, unit * attraction)
            if reason := under.why_not_solvable():
                raise ValueError(reason)
            at, more = self._under_a_wall(under, found.tractions, _LEAST_TOLERANCE, limit, near=True)
            steps += more
            solution = _solution(under, at, steps, self._spent.pairs, _LEAST_TOLERANCE)
            change = problem.interface.traction(solution.closed_gap) / unit - attraction
            found = replace(
                solution,
                gap=solution.closed_gap,
                residual=max(solution.residual, *self._largest(np.abs(change))),
                attraction=unit * attraction,
            )
            return grid.everywhere(change)  # all processes know all unknowns, and take the same steps

        try:
            attraction = newton_krylov(
                off,
                grid.everywhere(begun.attraction / unit),
                method="gmres",
                inner_maxiter=INNER,
                maxiter=_NEWTON,
                f_tol=tolerance,
                rdiff=_DIFFERENCE,
                tol_norm=lambda change: float(np.abs(change).max()),
            )
            off(attraction)  # whose last call may be a difference
        except (NoConvergence, ValueError):
            found = begun
        if found.residual < tolerance:
            return replace(found, converged=True, reason="")
        law, point = problem.interface, self._levels[0].newton(problem.response).operators[0].point[0]
        jump = point * float(np.abs(law.curvature(np.linspace(0.0, 4 * law.range, 1001))).max())
        reason = (
            f"attraction and shear traction do not settle; residual {found.residual:.2e}: the attraction "
            f"falls {jump:.3g} times as fast with the gap as one point of the grid recoils, and edges of the "
            f"contact jump by points from 1 on. Take {jump:.3g} times as many "
            "grid.points, or a wider attraction"
        )
        return replace(found, converged=False, reason=reason, pairs=self._spent.pairs)

    def _any(self, field: NDArray[Any]) -> bool:
        """Whether a value of all processes is not zero, or true."""
        return bool(self._ranks.maximum(int(field.any())))

    def _largest(self, *fields: FloatArray) -> list[float]:
        """Return the largest value of each of some fields."""
        most: list[float] = self._ranks.maximum(np.array([field.max() for field in fields])).tolist()
        return most

    def _gradually(
        self, problem: FrictionProblem, failed: FrictionState, tolerance: float, limit: int
    ) -> tuple[FrictionState, int]:
        """Raise friction and force from the frictionless contact, by steps that are halved on failure."""
        smooth = replace(problem, law=ShearBound(0.0), force=None)
        if problem.response.is_positive:
            pressed = self._pressed(smooth, None, None, None, tolerance, limit)
            begun = self._smooth(smooth, *pressed, tolerance)
            x, steps = begun.tractions, begun.iterations
        else:
            at, steps = self._solve(smooth, None, 0, len(self._levels) - 1, tolerance, limit)
            x = at.x
        part, step = 0.0, _FIRST_PART
        while part < 1:
            aim = min(1.0, part + step)
            force = None if problem.force is None else aim * problem.force
            some = replace(problem, law=problem.law.scaled(aim), force=force)
            enough = tolerance if aim == 1 else _COARSE_TOLERANCE
            at, more = self._solve(some, x, 0, 0, enough, limit)
            steps += more
            if at.residual < enough:
                x, part, step = at.x, aim, 2 * step
            elif step <= _LEAST_PART:
                return failed, steps
            else:
                step /= 2
        return at, steps

    def _solve(
        self,
        problem: FrictionProblem,
        start: FloatArray | None,
        number: int,
        deepest: int,
        tolerance: float,
        limit: int,
    ) -> tuple[FrictionState, int]:
        """Solve on a grid, with a guess from the next coarser one down to the `deepest`."""
        level = self._levels[number]
        newton = level.newton(problem.response)
        coarse = None if number == deepest else self._below(problem, number)
        if coarse is None:
            guess = _rough_guess(problem, level.grid) if start is None else start
        else:
            grids = level.grid, self._levels[number + 1].grid
            below, _ = self._solve(
                coarse,
                None if start is None else _halved(start, *grids),
                number + 1,
                deepest,
                _COARSE_TOLERANCE,
                limit,
            )
            guess = _finer(below.x, *grids[::-1])
        return newton.solve(problem, guess, tolerance, limit)

    def _below(self, problem: FrictionProblem, number: int) -> FrictionProblem | None:
        """Return the problem on the next coarser grid; None where no point of it touches."""
        coarse = _coarser(problem, self._levels[number], self._levels[number + 1])
        apart = coarse.load is None and not coarse.interface.attracts
        apart = apart and coarse.depth <= coarse.lowest
        return None if apart else coarse


class FrictionLevel:
    """One of the nested grids; keeps the operators of the last response."""

    def __init__(self, grid: Grid, transforms: Transforms, spent: Spent, share: float) -> None:
        self.grid, self.transforms = grid, transforms
        self._spent, self._share = spent, share
        self._work = SharedTransforms(transforms, spent, share)
        self._finer: AnyResponse | None = None
        self.response: AnyResponse | None = None
        self.counted: set[tuple[int, ...]] = set()  # windows as below, of a run that is resumed
        self._newton: FrictionNewton | None = None

    @property
    def windows(self) -> list[tuple[int, int]]:
        """Operator and part of windows whose kernels have been made."""
        made = () if self._newton is None else self._newton.operators
        return [(number, part) for number, operator in enumerate(made) for part in operator.windows]

    def newton(self, response: AnyResponse) -> FrictionNewton:
        """Return Newton's method for a response."""
        if self._newton is None or self.response is None or not response.equals(self.response):
            if self._newton is not None:
                self.counted.clear()
            C, K = (
                Operator(self.grid, kind, self._work, {part for i, part in self.counted if i == number})
                for number, kind in enumerate((response, response.inverse(self.grid)))
            )
            self.response, self._newton = response, FrictionNewton(C, K)
        return self._newton

    def restricted(self, response: AnyResponse, finer: FrictionLevel) -> AnyResponse:
        """Return the response of the next finer grid at the modes of this one."""
        if self.response is None or response is not self._finer:
            self._finer, coarse = response, response.on(finer.transforms, self.transforms)
            self.newton(coarse)
            return coarse
        return self.response

    def coarser(self) -> FrictionLevel | None:
        """Return the level with half of the points of each long axis."""
        points = tuple(n // 2 if n > _COARSEST and n % 2 == 0 else n for n in self.grid.points)
        if points == self.grid.points or (grid := self.grid.of_points(points)) is None:
            return None
        share = self._share * grid.size / self.grid.size
        return FrictionLevel(grid, self.transforms.of_shape(points), self._spent, share)


def _of_the_wall(stress: FloatArray, attraction: FloatArray, gap: FloatArray) -> FloatArray:
    """Return the pressure of the wall where there is no gap."""
    return np.where(gap <= 0, np.maximum(stress + attraction, 0.0), 0.0)


def _raised(heights: FloatArray, flow: FloatArray | None) -> FloatArray:
    """Return the heights of the punch and surface that have lost more."""
    return heights if flow is None else heights + flow


def _up_to(
    hardness: float, solution: FrictionSolution, flow: FloatArray | None
) -> tuple[FrictionSolution, FloatArray]:
    """Return a solution whose pressure is the hardness where it flows, and nowhere more; and the changes."""
    p = np.minimum(solution.pressure, hardness)
    if flow is not None:
        p = np.where(flow > 0, hardness, p)
    return replace(solution, pressure=p, flow=flow), np.abs(p - solution.pressure)


def _levels_of(start: FloatArray, grid: Grid) -> int:
    """Return the number of coarser grids that improve a guess: edges far apart move by many points a step."""
    if len(grid.points) > 1:
        return 0
    pressed = start[0] > 0
    edges = max(int(np.count_nonzero(pressed[1:] != pressed[:-1])), 1)
    points, levels = grid.points[0], 0
    while points % 2 == 0 and points > _FEWEST and np.count_nonzero(pressed) > _APART * edges * 2**levels:
        points, levels = points // 2, levels + 1
    return levels


def _rough_guess(problem: FrictionProblem, grid: Grid) -> FloatArray:
    """Return a pressure in proportion to the overlap with the lowest third, and shear in proportion to it."""
    h, every = problem.gap_at_rest, grid.everywhere(problem.gap_at_rest)
    p = np.maximum(np.quantile(every, 0.3) - h, 0.0) + 1e-12 * (np.ptp(every) + 1e-300)
    axes = problem.response.normal.ndim
    softest = problem.response.softest
    mean = problem.load
    if mean is None:
        mean = 1e-3 * max(problem.depth - problem.lowest, 0) / softest
    p *= mean / problem.ranks.mean(p)
    x = np.zeros((1 + axes, h.size))
    x[0] = p
    if problem.force is not None and problem.load:
        x[1:] = (problem.force / problem.load)[:, np.newaxis] * p
    return x


def _halved(field: FloatArray, fine: Grid, coarse: Grid) -> FloatArray:
    """Return a field on a coarser grid, with weights 1/4, 1/2, 1/4 along each axis that is halved."""
    result = field.reshape(-1, *fine.shape)
    for axis in _different(fine, coarse):
        first, count = _held(coarse, axis)
        lines = _lines(result, axis, fine, 2 * first - 1, 2 * count + 1)
        lines = 0.5 * lines[1::2] + 0.25 * (lines[:-1:2] + lines[2::2])
        result = np.moveaxis(lines, 0, 1 + axis)
    return np.ascontiguousarray(result).reshape(*field.shape[:-1], -1)


def _finer(field: FloatArray, coarse: Grid, fine: Grid) -> FloatArray:
    """Return a field on a finer grid, interpolated linearly along each axis that is doubled."""
    result = field.reshape(-1, *coarse.shape)
    for axis in _different(fine, coarse):
        first, count = _held(fine, axis)
        there = first // 2
        lines = _lines(result, axis, coarse, there, (first + count - 1) // 2 - there + 2)
        doubled = np.repeat(lines[:-1], 2, axis=0)
        doubled[1::2] = 0.5 * (lines[:-1] + lines[1:])
        result = np.moveaxis(doubled[first - 2 * there :][:count], 0, 1 + axis)
    return np.ascontiguousarray(result).reshape(*field.shape[:-1], -1)


def _different(one: Grid, other: Grid) -> list[int]:
    """Return the axes of which two grids have different numbers of points."""
    every = zip(one.points, other.points, strict=True)
    return [axis for axis, (points, others) in enumerate(every) if points != others]


def _held(grid: Grid, axis: int) -> tuple[int, int]:
    """Return the first point along an axis that this process holds, and the number of them."""
    return (grid.first_row, grid.shape[0]) if axis == 0 else (0, grid.points[axis])


def _lines(fields: FloatArray, axis: int, grid: Grid, first: int, count: int) -> FloatArray:
    """Return so many rows or columns of periodic fields from one on, (count, fields, points)."""
    if axis == 0:
        return np.stack([grid.rows_from(each, first, count) for each in fields], axis=1)
    return np.moveaxis(fields[..., np.arange(first, first + count) % grid.points[axis]], 1 + axis, 0)


def _coarser(problem: FrictionProblem, fine: FrictionLevel, coarse: FrictionLevel) -> FrictionProblem:
    """Return the problem on a coarser grid."""

    def on(field: NDArray[Any] | None) -> FloatArray | None:
        return None if field is None else _halved(field, fine.grid, coarse.grid)

    law = problem.law
    if np.ndim(law.coefficient):
        law = ShearBound(on(law.coefficient), law.strength)  # type: ignore[arg-type]
    return replace(
        problem,
        response=coarse.restricted(problem.response, fine),
        heights=on(problem.heights),  # type: ignore[arg-type]
        law=law,
        offset=on(problem.offset),
        before=on(problem.before),
    )


def _solution(
    problem: FrictionProblem, at: FrictionState, steps: int, pairs: float, tolerance: float
) -> FrictionSolution:
    """Return a state as a solution."""
    Cx = at.Cx if problem.offset is None else at.Cx + problem.offset
    slip = problem.slip_at_rest + at.Cx[1:] - at.path[:, np.newaxis]
    traction = at.x[1:]
    stick = np.zeros(at.x.shape[1], dtype=bool)
    stick[at.near] = at.sticks(problem)
    converged = at.residual < tolerance
    reason = ""
    if not converged:
        reason = f"residual {at.residual:.2e} after {steps} steps; the tolerance is {tolerance:.2e}"
        if np.max(problem.law.coefficient) > (critical := problem.response.critical_coefficient):
            reason += (
                f"; a step need not have a solution with a coefficient of friction above {critical:.3g}, "
                "where shear moves the surface up and down by more than pressure does"
            )
    return FrictionSolution(
        pressure=at.x[0],
        traction=traction,
        displacement=Cx,
        gap=problem.gap_at_rest + at.Cx[0] - at.depth,
        slip=slip,
        depth=at.depth,
        path=at.path,
        stick=stick,
        residual=at.residual,
        pairs=pairs,
        iterations=steps,
        converged=converged,
        reason=reason,
    )
