"""Conjugate gradients for pressures bounded from below, p >= 0, with a preconditioner or without.

The pressure minimises the energy p.A p/2 + gap0.p, whose gradient is the gap; A = 1/kappa mode by mode (see
`pressure_form`). Under a given load the mean of p is kept, and the gap counts from its mean over the contact.
After Polonsky and Keer, Wear 231 (1999) 206, directions are the negative gaps of the points that press or
overlap, made conjugate to the last step; a point that joins is a reason to start afresh.

The original cuts the pressure off at zero after each step, which costs two applications of A: one for the
length of the step and one for the gap that the cut leaves. Here a step of the last length is tried and cut
off first, and A is applied to the remaining step. All pressures along it are admissible and their energy is a
parabola, so that one FFT pair an iteration is enough, the energy never rises, and the gap follows without
another. A step that was not cut goes to the lowest point, as conjugate gradients do, or to where the first
pressure vanishes; any other goes all the way if that lowers the energy.

The preconditioner is kappa restricted to the contact, nearly the inverse of A there, for a second FFT pair.
A cut may turn its direction uphill. The next one is then not cut and goes to where the first pressure
vanishes, which lowers the energy. Points join where they violate the conditions by more than those in
contact do, or a contact with many scales would never settle (Z. Dostal, Optimal Quadratic Programming
Algorithms, 2009, ch. 5).

Without the preconditioner it is the method `conjugate_gradient`, the field's baseline. With it, it is the
safeguard of the active set, where changes of the whole set at once return to where they began, as under a
stiff film that bends on a soft base. Steps that each lower the energy cannot cycle.
"""

from __future__ import annotations

from typing import ClassVar, Literal, NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.contact.pressure_form import (
    AIM,
    CLOSE,
    Iterate,
    System,
    apply_to,
    compile_failure,
    feasible_solution,
    in_pressures,
    satisfies_kkt,
    set_pressure,
    trivial_solution,
    unconverged,
)
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.contact.residual import residual_scales
from gfmdlayer.grid.transforms import Plans, Transforms
from gfmdlayer.kernels import LANES, compiling, filled, kernel, maximum
from gfmdlayer.resumable import Stateless

_ROUNDING = 1e-14  # part of a pressure that is left where it was to vanish
_SHORTEST = 1e-12  # part of the first trial length at which only rounding is left to descend
_PORTION = 200  # iterations of the safeguard between two looks at signals


class Descent(NamedTuple):
    """Work arrays."""

    step: FloatArray  # the last step
    change: FloatArray  # A step
    z: FloatArray  # the preconditioned direction
    work: ComplexArray


class ConjugateGradient(Stateless):
    """Polonsky's and Keer's solver for the steps of one run."""

    starts_from: ClassVar[Literal["displacement", "pressure"]] = "pressure"

    def __init__(self, transforms: Transforms) -> None:
        self._transforms = transforms
        field, spectrum = transforms.empty_field, transforms.empty_spectrum
        self._at, self._descent = Iterate(field(), field(), spectrum()), make_descent(transforms)

    def solve(
        self, problem: Problem, start: FloatArray, tolerance: float = 1e-6, limit: int = 20_000
    ) -> Solution:
        """Solve from a first guess of the pressure."""
        at, plans = self._at, self._transforms.plans
        if trivial := trivial_solution(problem, self._transforms):
            return trivial
        system, free = in_pressures(problem, self._transforms)
        set_pressure(at, system, problem, start)
        transforms, iterations, shift = 1, 0, 0.0
        for within in (CLOSE * tolerance, AIM * tolerance):
            left = limit - iterations
            _, more, done = descend(plans, system, at, self._descent, shift, within, left, False)
            transforms, iterations = transforms + more, iterations + done
            solution = feasible_solution(
                problem, system, free, at, tolerance, transforms=(transforms + 1) // 2, iterations=iterations
            )
            if solution.converged:
                return solution
            depth = residual_scales(solution.pressure, solution.displacement, system.floor)[1]
            shift = AIM * tolerance * depth
        return unconverged(problem, system, at, self._transforms, solution)

    def compile(self) -> None:
        """Compile the kernels that only a failed solve calls; an ordinary solve compiles the others."""
        compile_failure(self._at, self._transforms)


def make_descent(transforms: Transforms) -> Descent:
    """Make the work arrays."""
    step, change, z = (transforms.empty_field() for _ in range(3))
    return Descent(step, change, z, transforms.empty_spectrum())


def safeguard(
    transforms: Transforms,
    system: System,
    problem: Problem,
    at: Iterate,
    shift: float,
    tolerance: float,
    limit: int,
) -> tuple[bool, int, int]:
    """Bring the gap in the contact to `shift` [length], with the preconditioner."""
    # Returns whether all points satisfy the conditions within the tolerance, the transforms and the
    # iterations.
    solved, taken, done, descent = False, 0, 0, make_descent(transforms)
    if not descend.signatures:  # type: ignore[attr-defined]
        with compiling():  # rarely needed, and thus not compiled beforehand
            descend(transforms.plans, system, at, descent, shift, tolerance, 0, True)
    set_pressure(at, system, problem, at.p)
    while not solved and done < limit:
        portion = min(_PORTION, limit - done)
        solved, more, ended = descend(transforms.plans, system, at, descent, shift, tolerance, portion, True)
        taken, done = taken + more, done + ended
        if ended < portion:
            break
    return solved, taken, done


@kernel(reorder=True)
def descend(
    plans: Plans,
    system: System,
    at: Iterate,
    descent: Descent,
    shift: float,
    tolerance: float,
    limit: int,
    preconditioned: bool,
) -> tuple[bool, int, int]:
    """Bring the gap in the contact to ``shift``; return whether it is, the transforms and the iterations."""
    # Begins with an admissible pressure. Gap and pressure are an exact pair on return.
    p, gap, (step, change, _, work) = at.p, at.gap, descent
    # No eigenvalue of A exceeds the inverse of the smallest stiffness.
    longest = 1.0 if preconditioned else 1.0 / (system.compliance.max() * p.size)
    load = p.sum()
    transforms, iteration, exact, trial, curvature, uphill = 2, 0, True, longest, 0.0, False
    evaluate(plans, system, at, work)
    solved, step[:] = False, 0.0
    while iteration < limit and trial > _SHORTEST * longest:
        if system.load_given:
            _set_depth(p, gap, shift)
        if satisfies_kkt(system, p, gap, shift, tolerance):
            if exact:
                solved = True
                break
            restore_load(system, p, load)
            evaluate(plans, system, at, work)
            transforms, exact = transforms + 2, True
            continue
        joins = True
        if preconditioned:
            joins = not uphill and _overlap_is_worse(p, gap, shift)
            _precondition(plans, system, at, descent, shift, joins)
            transforms += 2
        cut = _try_step(system, at, descent, shift, trial, curvature, joins, uphill, preconditioned)
        iteration += 1
        apply_to(plans, system.compliance, step, work, work, change)
        transforms += 2
        slope, curvature = 0.0, 0.0
        for i in range(p.size):
            slope += (shift - gap[i]) * step[i]
            curvature += step[i] * change[i]
        if slope > 0.0 and curvature > 0.0:
            lowest = slope / curvature
            way = (1.0 if lowest > 0.5 else lowest) if cut else min(lowest, _reach(p, step))
            for i in range(p.size):
                moved = p[i] + way * step[i]
                p[i] = moved if moved > _ROUNDING * p[i] else 0.0
                gap[i] += way * change[i]
            trial, exact, uphill = trial * lowest, False, False
        else:
            # The cut or the rescaling has turned the step uphill.
            trial = trial if preconditioned and not uphill else 0.1 * trial
            curvature, uphill = 0.0, preconditioned
    if not exact:
        restore_load(system, p, load)
        evaluate(plans, system, at, work)
        transforms += 2
    if system.load_given:
        _set_depth(p, gap, shift)
    return solved, transforms, iteration


@kernel(inner=True)
def restore_load(system: System, p: FloatArray, load: float) -> None:
    """Scale the pressure to a given load, which rounding has changed over the steps."""
    if system.load_given:
        p *= load / p.sum()


@kernel(reorder=True, inner=True)
def evaluate(plans: Plans, system: System, at: Iterate, work: ComplexArray) -> None:
    """Gap of the pressure."""
    apply_to(plans, system.compliance, at.p, at.spectrum, work, at.gap)
    for i in range(at.gap.size):
        at.gap[i] += system.gap0[i]


@kernel(reorder=True, inner=True)
def _set_depth(p: FloatArray, gap: FloatArray, shift: float) -> None:
    """Shift the punch so that the gap is right in the mean over the contact, or at its lowest point."""
    total, count = 0.0, 0.0
    for i in range(p.size):
        pressed = 1.0 if p[i] > 0.0 else 0.0
        total += pressed * gap[i]
        count += pressed
    excess = (total / count if count > 0.0 else gap.min()) - shift
    for i in range(p.size):
        gap[i] -= excess


@kernel(reorder=True, inner=True)
def _overlap_is_worse(p: FloatArray, gap: FloatArray, shift: float) -> bool:
    """Whether the largest overlap out of contact exceeds the largest error of the gap in contact."""
    opened, overlap = 0.0, 0.0
    for i in range(p.size):
        off = gap[i] - shift
        if p[i] > 0.0:
            opened = max(opened, abs(off))
        else:
            overlap = max(overlap, -off)
    return overlap > opened


@kernel(reorder=True, inner=True)
def _precondition(
    plans: Plans, system: System, at: Iterate, descent: Descent, shift: float, joins: bool
) -> None:
    """Write z = kappa r restricted to the contact and points that join, without mean under a given load."""
    p, gap, (_, _, z, work) = at.p, at.gap, descent
    for i in range(gap.size):
        pull = shift - gap[i]
        z[i] = pull if p[i] > 0.0 or (joins and pull > 0.0) else 0.0
    apply_to(plans, system.stiffness, z, work, work, z)
    excess, count = 0.0, 0.0
    for i in range(gap.size):
        member = 1.0 if p[i] > 0.0 or (joins and shift - gap[i] > 0.0) else 0.0
        excess += member * z[i]
        count += member
    excess = excess / count if system.load_given and count > 0.0 else 0.0
    for i in range(gap.size):
        member = 1.0 if p[i] > 0.0 or (joins and shift - gap[i] > 0.0) else 0.0
        z[i] = member * (z[i] - excess)


@kernel(reorder=True, inner=True)
def _try_step(
    system: System,
    at: Iterate,
    descent: Descent,
    shift: float,
    trial: float,
    curvature: float,
    joins: bool,
    whole: bool,
    preconditioned: bool,
) -> bool:
    """Write a step, cut to admissible pressures unless it is to stay whole; return whether it was cut."""
    p, gap, (step, change, z, _) = at.p, at.gap, descent
    # Without branches, as the vector units want it.
    across, joining, load = 0.0, 1.0 if curvature <= 0.0 else 0.0, 0.0
    for i in range(p.size):
        pull = shift - gap[i]
        towards = z[i] if preconditioned else pull
        across += towards * change[i] if p[i] > 0.0 else 0.0
        joining += 1.0 if p[i] <= 0.0 and pull > 0.0 and joins else 0.0
        load += p[i]
    memory = 0.0 if joining > 0.0 or across >= 0.0 else -trial * across / curvature
    cut, total = 0.0, 0.0
    for i in range(p.size):
        pull = shift - gap[i]
        now = p[i] + trial * (z[i] if preconditioned else pull) + memory * step[i]
        now = now if p[i] > 0.0 or (pull > 0.0 and joins) else 0.0
        negative = now < 0.0 and not whole
        cut += 1.0 if negative else 0.0
        now = 0.0 if negative else now
        step[i] = now
        total += now
    # Keep the present load, not the given one: steps many times as long would multiply their difference,
    # which is rounding.
    scale = load / total if system.load_given and total > 0.0 else 1.0
    for i in range(p.size):
        step[i] = scale * step[i] - p[i]
    return cut > 0.0


@kernel(reorder=True, inner=True)
def _reach(p: FloatArray, step: FloatArray) -> float:
    """Part of a step up to which no pressure becomes negative."""
    fastest = filled(LANES, 0.0)  # relative fall of a pressure
    for first in range(0, p.size, LANES):
        ps, steps = p[first : first + LANES], step[first : first + LANES]
        for i in range(ps.size):
            falls = -steps[i] / ps[i] if ps[i] > 0.0 else 0.0
            fastest[i] = falls if falls > fastest[i] else fastest[i]
    most = maximum(fastest)
    return 1.0 / most if most > 0.0 else np.inf
