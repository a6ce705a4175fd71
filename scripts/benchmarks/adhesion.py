"""Adhesive contact: FFT pairs per step of Newton's method and of FIRE, time over bare pairs, ablations.

A parabola on a line, a sphere and a rough surface on an elastic halfspace are pressed in and pulled off in
equal steps, E* = 4, work 1e-3 and radius 1/4 in cells of period 1; the rough surface also on films, to
several depths, where the work is that on a halfspace which is as stiff to the shortest wave. Two numbers
characterise a case: the ratio of the stiffness of interface and body, work/(range^2 kappa_1), and the number
of points in the cohesive zone of length (pi/4) E* range^2/work. On surfaces of more than 256 points per side
only the first few steps of the retraction are computed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any, NamedTuple
from unittest.mock import patch

import numba as nb
import numpy as np
from benchmarks.ablation import with_globals
from benchmarks.common import Cell, Effort, Table, cpu_of_a_pair
from benchmarks.rough import bodies

from gfmdlayer import halfspace
from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.contact.cycle import Cycle, no_cycle
from gfmdlayer.contact.fire import Fire
from gfmdlayer.contact.newton import solver
from gfmdlayer.contact.newton.passes import begin
from gfmdlayer.contact.newton.solver import Newton
from gfmdlayer.contact.problem import Problem, Solution, Solver
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.adhesion import Exponential, LennardJones
from gfmdlayer.interface.forms import EXPONENTIAL
from gfmdlayer.interface.law import Interaction
from gfmdlayer.punch.self_affine import SelfAffine

EFFORT = Effort(points=(1 << 10, 1 << 12, 1 << 14, 1 << 16), steps=60, repetitions=3)
QUICK = Effort(points=(1 << 10,), steps=30, repetitions=1)

_WORK, _HALF_E_STAR, _CURVATURE = 1e-3, 2.0, 2.0
_RANGES = {1 << 10: (4e-3, 2e-3, 1e-3), 1 << 12: (1e-3,), 1 << 14: (5e-4,), 1 << 16: (2.5e-4,)}
_SIDES = (256, 512, 1024)
_LATE = 4  # steps of the larger of them
_RESIDUAL = 1e-6
_BODIES = (
    "halfspace",
    *(f"{shear:g} on 1, d 0.02" for shear in (0.2, 5, 20, 100)),
    *(f"{kind}, d 0.02" for kind in ("on a rigid base, nu 0.5", "free")),
)
_DEEPEST = (0.3, 0.6, 0.9)  # of the mean height


class _Course(NamedTuple):
    """A contact and its sequence of depths."""

    name: str
    grid: Grid
    height: FloatArray
    law: Interaction
    depths: FloatArray
    body: Body = halfspace(2 * _HALF_E_STAR / 4)  # incompressible: E* = 4 G

    def problems(self) -> Iterator[Problem]:
        """Yield the contact problems."""
        q = np.ravel(self.grid.wavenumbers)
        kappa = np.zeros(q.size)
        kappa[1:] = self.body.stiffness(q[1:], 0.0)
        nothing = np.zeros(kappa.size, dtype=np.complex128)
        for depth in self.depths:
            yield Problem(kappa, nothing, self.height - depth, interface=self.law)


class _Outcome(NamedTuple):
    pairs: list[int]
    jumps: list[bool]
    seconds: float
    iterations: int
    deepest: Solution


def measure(effort: Effort) -> Iterator[Table]:
    """Solve each sequence with both solvers; then remove ingredients of Newton's method."""
    courses = [_line(n, reach, effort.steps) for n in effort.points for reach in _RANGES.get(n, (1e-3,))]
    large = max(effort.points) >= 1 << 14
    sides = _SIDES if large else (64,)
    courses += [shape(side, effort.steps // 3) for shape in (_sphere, _rough) for side in sides]
    steep = LennardJones(work=_WORK, separation=2e-3).interaction()
    courses.append(courses[0]._replace(law=steep))
    if large:
        courses.append(_rough(sides[0], effort.steps // 3)._replace(law=steep))
    rows = [_row(course, effort.repetitions) for course in courses]
    note = (
        "Jumps are steps with an energy release, without the first step from rest. Pairs in single precision "
        "count half."
    )
    title = (
        f"Adhesive contact on a halfspace, {effort.steps} depths (surfaces: a third), residual {_RESIDUAL:g}"
    )
    yield Table("adhesion", title, rows, note)
    small = [course for course in courses if course.grid.size <= 1 << 12]
    yield _ablations([*small, _rough(128, effort.steps // 3)] if large else small)
    rough = [_rough(side, effort.steps // 3) for side in ((64, 128, *sides) if large else sides)]
    yield _cycles([*rough, *(course._replace(law=steep) for course in rough[:2])], effort.repetitions)
    yield _films(128 if large else 64, effort)


def _cycles(courses: list[_Course], repetitions: int) -> Table:
    """Each course with the cycle and without it, in turns."""
    rows: list[dict[str, Cell]] = []
    for course in courses:
        found: tuple[list[_Outcome], list[_Outcome]] = [], []
        for _ in range(1 + repetitions):
            found[0].append(_follow(Newton(Transforms(course.grid.shape)), course))
            with patch.object(solver, "cycle_of", _by_transform):
                found[1].append(_follow(Newton(Transforms(course.grid.shape)), course))
        pairs, seconds = zip(
            *((sum(each[-1].pairs), min(one.seconds for one in each[1:])) for each in found), strict=True
        )
        rows.append(
            {
                "contact": course.name,
                "law": "exponential" if course.law.terms.form[0] == EXPONENTIAL else "Lennard-Jones",
                "FFT pairs": pairs[0],
                "pairs by transforms": pairs[1],
                "pairs": pairs[0] / pairs[1],
                "CPU time": seconds[0] / seconds[1],
            }
        )
    title = "The cycle over the preconditioner by transforms: FFT pairs and CPU time, in turns in one process"
    return Table("adhesion-cycle", title, rows)


def _films(side: int, effort: Effort) -> Table:
    """Press the rough surface onto each body, to several depths, and pull it off."""
    rows: list[dict[str, Cell]] = []
    known = dict(bodies())
    for name in _BODIES:
        for deepest in _DEEPEST:
            course = _rough(side, effort.steps // 3, known[name], deepest)
            found = _follow(Newton(Transforms(course.grid.shape)), course)
            again = (
                _follow(Newton(Transforms(course.grid.shape)), course).seconds
                for _ in range(effort.repetitions - 1)
            )
            rows.append(
                {
                    "body": name,
                    "depth / mean height": deepest,
                    "mean pressure": float(found.deepest.pressure.mean()),
                    "contact area": f"{found.deepest.contact_area:.4f}",
                    "jumps": sum(found.jumps),
                    "iterations": found.iterations,
                    "FFT pairs": sum(found.pairs),
                    "CPU time [s]": min([found.seconds, *again]),
                }
            )
    title = f"Adhesive contact of a rough surface, {side} x {side} points, {effort.steps // 3} depths"
    note = (
        "Sums over all steps but the first, from rest; pressure and area at the largest depth. The work is "
        "that on a halfspace as stiff to the shortest wave."
    )
    return Table("adhesion-films", title, rows, note)


def _line(n: int, reach: float, steps: int) -> _Course:
    grid = Grid((n,), (1.0,))
    return _Course(
        f"line {n}", grid, _CURVATURE * grid.coordinates[0] ** 2, _law(reach), _depths(4e-3, -8e-3, steps)
    )


def _sphere(side: int, steps: int) -> _Course:
    grid, reach = Grid((side, side), (1.0, 1.0)), 0.5 * math.sqrt(256 / side) * 5e-3
    x, y = grid.coordinates
    height = np.ravel(_CURVATURE * (x[:, np.newaxis] ** 2 + y**2))
    return _Course(f"sphere {side}²", grid, height, _law(reach), _late(side, _depths(8e-3, -4e-3, steps)))


def _rough(side: int, steps: int, body: Body | None = None, deepest: float = 0.6) -> _Course:
    grid = Grid((side, side), (1.0, 1.0))
    shape = SelfAffine(hurst=0.8, roll_off=0.25, short_cutoff=16 / side, rms_slope=0.1, seed=1)
    height = np.ravel(shape.heights(grid))
    top = float(height.mean())
    depths = _late(side, _depths(deepest * top, 0.2 * top, steps))
    course = _Course(f"rough {side}²", grid, height, _law(2.5e-3), depths)
    if body is None:
        return course
    shortest = float(np.max(grid.wavenumbers))
    stiff = float(body.stiffness(np.array([shortest]), 0.0)[0]) / (_HALF_E_STAR * shortest)
    return course._replace(law=Exponential(work=stiff * _WORK, range=2.5e-3).interaction(), body=body)


def _late(side: int, depths: FloatArray) -> FloatArray:
    """Keep the beginning of the retraction for the largest surfaces."""
    turn = int(np.argmax(depths))
    return depths[turn : turn + 1 + _LATE] if side > _SIDES[0] else depths


def _law(reach: float) -> Interaction:
    return Exponential(work=_WORK, range=reach).interaction()


def _depths(deepest: float, last: float, steps: int) -> FloatArray:
    approach = np.linspace(0.0, deepest, steps // 3)
    return np.concatenate([approach, np.linspace(deepest, last, steps - approach.size + 1)[1:]])


def _row(course: _Course, repetitions: int) -> dict[str, Cell]:
    transforms = Transforms(course.grid.shape)
    newton = Newton(transforms)
    found = _follow(newton, course)
    law, exponential = course.law, course.law.terms.form[0] == EXPONENTIAL
    fire = _follow(Fire(transforms, starts_from="gap"), course) if exponential else None
    taken = min(found.seconds, *(_follow(newton, course).seconds for _ in range(repetitions)))
    smooth = [pairs for pairs, jumps in zip(found.pairs, found.jumps, strict=True) if not jumps]
    rough = [pairs for pairs, jumps in zip(found.pairs, found.jumps, strict=True) if jumps]
    return {
        "contact": course.name,
        "law": "exponential" if exponential else "Lennard-Jones",
        "stiffness ratio": law.strength / law.range / (2 * math.pi * _HALF_E_STAR),
        "points in the zone": math.pi * _HALF_E_STAR / 2 * law.range / law.strength * course.grid.shape[0],
        "pairs a step": float(np.mean(smooth)) if smooth else None,
        "most": max(smooth, default=None),
        "jumps": len(rough),
        "pairs of a jump": float(np.mean(rough)) if rough else None,
        "FIRE: pairs a step": float(np.mean(fire.pairs)) if fire else None,
        "CPU time / bare pairs": taken / (sum(found.pairs) * cpu_of_a_pair(transforms)),
    }


def _follow(method: Solver, course: _Course) -> _Outcome:
    """Solve a sequence; the counts omit the first step, from rest."""
    start, seconds = np.full(course.grid.size, np.inf), 0.0
    pairs: list[int] = []
    jumps: list[bool] = []
    iterations, largest = 0, int(np.argmax(course.depths))
    for step, problem in enumerate(course.problems()):
        begun = time.process_time()
        found = method.solve(problem, start, _RESIDUAL, 20_000)
        seconds += time.process_time() - begun if pairs else 0.0  # without compilation
        if not found.converged:
            raise RuntimeError(f"{course.name}: a residual of {found.residual:g}")
        iterations += found.iterations if pairs else 0
        if step == largest:
            deepest = found
        pairs.append(found.transforms)
        jumps.append(found.released_energy > 0)
        start = found.gap
    return _Outcome(pairs[1:], jumps[1:], seconds, iterations, deepest)


class _LastDisplacement(Newton):
    """Start from the last displacement; points in contact stay in contact."""

    _last: FloatArray

    def solve(
        self, problem: Problem, start: FloatArray, tolerance: float = 1e-6, limit: int = 20_000
    ) -> Solution:
        """Solve from the gap of the last step."""
        if np.isfinite(start).all():
            start = np.where(start > 0, np.maximum(problem.obstacle - self._last, 0.0), 0.0)
        found = super().solve(problem, start, tolerance, limit)
        self._last = found.displacement
        return found


@nb.njit(nogil=True)
def _no_preconditioner(single, system, curvature, step, damping, lack, unit):  # type: ignore[no-untyped-def]
    """Take the place of the beginning of a step."""
    pairs = begin(single, system, curvature, step, damping, lack, unit)
    step.softening[:], step.share[:] = 1.0 / step.d.size, 1.0
    return pairs


@nb.njit(nogil=True)
def _one_stiffness(single, system, curvature, step, damping, lack, unit):  # type: ignore[no-untyped-def]
    """Take the place of the beginning of a step."""
    pairs = begin(single, system, curvature, step, damping, lack, unit)
    step.share[:] = 1.0
    return pairs


def _by_transform(*_: object) -> Cycle:
    """Take the place of the cycle."""
    return no_cycle()


@nb.njit(nogil=True)
def _in_double(step):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Take the place of the choice of single precision."""
    return False


@nb.njit(nogil=True)
def _no_search(single, system, at, step, lowest):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Take the place of the search for the lowest mode."""
    return 1.0, 1.0, 0.0, 0


class _Ablation(NamedTuple):
    name: str
    solver: type[Newton] = Newton
    loop: Callable[[], dict[str, Any]] = dict
    others: tuple[tuple[str, object], ...] = ()


_ABLATIONS = (
    _Ablation("nothing: FFT pairs"),
    _Ablation("start from the last gap: displacement", _LastDisplacement),
    _Ablation("cycle on surfaces: the preconditioner by transforms", others=(("cycle_of", _by_transform),)),
    _Ablation("states on the way in single precision", loop=lambda: {"_in_single": _in_double}),
    _Ablation(
        "preconditioner", loop=lambda: {"begin": _no_preconditioner}, others=(("cycle_of", _by_transform),)
    ),
    _Ablation("its scale where the interface is stiff", loop=lambda: {"begin": _one_stiffness}),
    _Ablation("inexact steps: to 1e-3", loop=lambda: {"_INEXACT": 1e-3}),
    _Ablation("bound on the error of a tangent", loop=lambda: {"_CHANGE": 1e300}),
    _Ablation("search for the lowest mode", others=(("find_margin", _no_search),)),
)


def _ablations(courses: list[_Course]) -> Table:
    rows: list[dict[str, Cell]] = []
    for ablation in _ABLATIONS:
        row: dict[str, Cell] = {"taken out": ablation.name}
        replaced = ablation.loop()
        patches = [
            *ablation.others,
            *([("iterate", with_globals(solver.iterate, replaced))] if replaced else []),
        ]
        with ExitStack() as stack:
            for attribute, value in patches:
                stack.enter_context(patch.object(solver, attribute, value))
            for course in courses:
                key = f"{course.name}, {course.law.range:g}"
                try:
                    count = sum(_follow(ablation.solver(Transforms(course.grid.shape)), course).pairs)
                except RuntimeError:
                    row[key] = "fails"
                else:
                    whole = rows[0][key] if rows else None
                    row[key] = count / whole if isinstance(whole, int) else count
        rows.append(row)
    title = "Newton's method for adhesive contact: FFT pairs / FFT pairs of the full method"
    return Table("adhesion-ablation", title, rows)
