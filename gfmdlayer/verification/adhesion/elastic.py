"""Adhesion of elastic bodies: JKR's line contact, Johnson's wave, Maugis' sphere, Bradley's limit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import HALFSPACE, Recording, run
from gfmdlayer.verification.theory import E_STAR, RADIUS, parabola_depth, parabola_pressure

_JKR = "periodic JKR, closed form; Johnson, Kendall and Roberts, Proc. R. Soc. A 324 (1971) 301"
_WAVE = "Johnson, Int. J. Solids Struct. 32 (1995) 423"
_MAUGIS = "Maugis, J. Colloid Interface Sci. 150 (1992) 243"
_BRADLEY = "Bradley, Phil. Mag. 13 (1932) 853"


def cycle(start: float, depth: float, final: float, speed: float) -> dict[str, object]:
    """Approach and retraction at a speed, by adaptive steps."""
    motion = {"kind": "approach_retract", "start": start, "depth": depth, "final": final}
    both = {"approach_speed": speed, "retract_speed": speed}
    return {"trajectory": motion | both, "time": {"step": "adaptive", "tolerance": 1e-3}}


def retraction(found: Recording) -> tuple[FloatArray, FloatArray]:
    """Depth, rising, and mean stress of the retraction while there is contact."""
    depth, stress = found["depth"], found["mean_stress"]
    held = np.flatnonzero((np.arange(depth.size) >= depth.argmax()) & (found["contact_area"] > 0))
    return depth[held][::-1], stress[held][::-1]


def _adhesive_rows(
    found: Recording,
    depth: FloatArray,
    pressure: FloatArray,
    name: str,
    source: str,
    places: tuple[float, ...],
) -> Iterator[Row]:
    """Yield pull-off and pressures at depths of the retraction, with a hundredth of the pull-off as bound."""
    ours, stress = retraction(found)
    stable = slice(int(depth.argmin()), None)  # beyond the least depth of the branch
    least = float(pressure[stable].min())
    yield Row(f"pull-off pressure, {name}", least, float(stress.min()), 0.01 * -least, source)
    for place in places:
        theory = float(np.interp(place, depth[stable], pressure[stable]))
        value = float(np.interp(place, ours, stress))
        yield Row(f"pressure at depth {place:g}, {name}", theory, value, 0.01 * -least, source)


def line_jkr(_quick: bool) -> Iterator[Row]:
    """The line contact of a parabola with adhesion of short range.

    At half-width a the mean pressure is that without adhesion less sqrt(2 E* w tan(pi a)), at a depth that
    is less by what a flat strip of that width takes. A range rho smears the edge over the cohesive zone l =
    (pi/4) E* rho^2/w, and the pull-off falls short: by 11, 3 and 0.5 % where rho is halved twice, of second
    order and more. With six points to l the lattice adds 0.1 %. The bound at the shortest range is 1 %; at
    the others the last digit of an independent program, the time between two rows included.
    """
    work = 1e-3
    a = np.linspace(5e-3, 0.2, 20001)
    pull = np.sqrt(2 * E_STAR * work * np.tan(np.pi * a))
    pressure = parabola_pressure(a) - pull
    depth = parabola_depth(a) + 2 / (np.pi * E_STAR) * np.log(np.sin(np.pi * a)) * pull
    law = {"law": "exponential", "work": work, "range": 1e-3}
    values = {"grid.points": 2048, "interface": law}
    found = run(HALFSPACE, values, cycle(-0.004, 0.004, -0.016, 0.01))
    yield from _adhesive_rows(found, depth, pressure, "line", _JKR, (0.003, 0.0, -0.003, -0.006))
    critical = (2 * work * RADIUS**2 / (math.pi * E_STAR)) ** (1 / 3)
    alone = -0.75 * math.sqrt(2 * math.pi * critical * E_STAR * work)
    yield Row("pull-off of an isolated line", alone, float(found["mean_stress"].min()), 0.01 * -alone, _JKR)
    least, known = float(pressure.min()), "dense Newton's method and FIRE, an independent program"
    for reach, theory in ((4e-3, 0.888), (2e-3, 0.970)):
        wide = values | {"grid.points": 1024, "interface": law | {"range": reach}, "output.times": 0.01}
        part = float(run(HALFSPACE, wide, cycle(-0.004, 0.004, -0.016, 0.01))["mean_stress"].min()) / least
        yield Row(f"pull-off over that of JKR, range {reach:g}", theory, part, 0.002, known)


def wave(_quick: bool) -> Iterator[Row]:
    """A wavy punch with adhesion, from partial contact back to none.

    p = p_1 sin^2(psi) - sqrt(2 E* w tan(psi)/lambda), psi = pi a/lambda, p_1 = pi E* A/lambda, with the depth
    A (s - s ln s), s = sin^2 psi, less that of a flat strip. Range and grid as for the line.
    """
    amplitude, work = 0.02, 2e-3
    psi = np.linspace(0.02, 1.2, 20001)
    s, pull = np.sin(psi) ** 2, np.sqrt(2 * E_STAR * work * np.tan(psi))
    pressure = math.pi * E_STAR * amplitude * s - pull
    depth = amplitude * (s - s * np.log(s)) + 2 / (math.pi * E_STAR) * np.log(np.sin(psi)) * pull
    law = {"law": "exponential", "work": work, "range": 2e-3}
    punch = {"shape": "sinusoid", "amplitude": amplitude, "wavelength": 1.0}
    found = run(
        HALFSPACE, {"grid.points": 1024, "interface": law, "punch": punch}, cycle(0, 0.012, -0.015, 0.01)
    )
    yield from _adhesive_rows(found, depth, pressure, "wave", _WAVE, (0.009, 0.003, -0.003))


def full_contact(_quick: bool) -> Iterator[Row]:
    """Full contact with a wavy punch is lost where the tension in its troughs reaches the strength.

    In full contact the pressure is pbar - p_1 cos(2 pi x/lambda); a trough opens where pbar - p_1 =
    -w/range. The load falls from twice that of the opening; steps of a hundredth of it locate the opening.
    """
    amplitude, work, reach = 0.002, 1e-3, 0.05
    strength, height = work / reach, math.pi * E_STAR * amplitude
    opens = height - strength
    law = {"law": "exponential", "work": work, "range": reach}
    punch = {"shape": "sinusoid", "amplitude": amplitude, "wavelength": 1.0}
    motion = {
        "control": "load",
        "kind": "approach_retract",
        "start": 0.0,
        "load": 2 * opens,
        "final": 0.5 * opens,
        "approach_speed": 100 * opens,
        "retract_speed": opens,
    }
    values: dict[str, object] = {"grid.points": 256, "interface": law, "punch": punch, "trajectory": motion}
    found = run(HALFSPACE, values, {"time.step": 0.01, "time.integrator": "exponential"})
    load, full = found["mean_stress"], found["contact_area"] == 1
    yield Row(
        "load at which full contact opens",
        opens,
        float(load[full].min()),
        0.011 * opens,
        "pi E* A/L - w/range",
    )


def sphere(quick: bool) -> Iterator[Row]:
    """Pull-off force of a sphere over pi w R, from DMT to JKR.

    Dugdale's stress s, lambda = 2 s (R/(pi w K^2))^(1/3), K = 4 E*/3; Maugis' cubic solved for its least
    force. Errors, of which each raises the force:

    - The end of Dugdale's law, smoothed over the part r of its range as a cubic, has the variance r^2/20 of
      the range squared. An exponential law of the same work and stress has 1, and pulls 0.7 to 5 % more:
      0.25 % for r = 1, taken here.
    - The grid: three points in the cohesive zone l = (pi/4) E* w/s^2 are then within 0.1 %. With r = 0.2 it
      takes ten for 1 % and forty for 0.1 %.
    - The neighbours in a cell of period L draw the surface up around the punch, as a curvature 1/R that is
      less by 4.5 F/(pi E* L^3): 0.05 % for L = 1, and 0.22 % for L = 0.6.
    """
    work, radius = 2.8e-4, 1.0
    K = 4 * E_STAR / 3
    unit = (math.pi**2 * work**2 * radius / K**2) ** (1 / 3)  # of depths
    whole, peak = cycle(0.0, unit, -3 * unit, unit), cycle(0.0, 0.05 * unit, -0.45 * unit, unit)
    peak["time"] = {"end": 0.55, "step": 0.05, "integrator": "exponential"}
    cases = [(0.05, 64, 1.0, 1.9814), (0.1, 64, 1.0, 1.9506), (0.5, 64, 1.0, 1.7182), (1, 128, 1.0, 1.6007)]
    if not quick:
        cases += [(2, 256, 0.6, 1.5346), (3, 512, 0.6, 1.5168), (5, 1024, 0.6, 1.5063)]
    for parameter, points, period, theory in cases:
        stress = parameter / 2 * (math.pi * work * K**2 / radius) ** (1 / 3)
        law = {"law": "dugdale", "work": work, "stress": stress, "smoothing": 1.0}
        values: dict[str, object] = {
            "grid": {"points": [points, points], "period": period},
            "interface": law,
            "punch": {"shape": "parabola", "radius": radius},
        }
        motion = whole | {"output.times": 0.05} if parameter < 1 else peak
        found = run(HALFSPACE, values, motion)
        ratio = -float(found["force"].min()) / (math.pi * work * radius)
        yield Row(f"pull-off/(pi w R), lambda = {parameter:g}", theory, ratio, 0.01 * theory, _MAUGIS)


def rigid_sphere(_quick: bool) -> Iterator[Row]:
    """The force between a sphere and a body too stiff to deform, out of contact: Bradley's.

    In Derjaguin's approximation it is 2 pi R times the energy at the closest gap. The body, stiffer than
    the attraction by a factor 1e6, yields by a part 1e-6. The sum over the points is exact for an
    exponential law, whose force falls like a Gaussian; at the rim of the cell, where r = L/2, the law of
    Lennard-Jones has fallen to (s/g)^3 of its largest value, and what lies beyond is the part (4/3)
    (s/g)^2.
    """
    work, radius, reach, gap = 1e-3, 1.0, 2e-3, 2e-4
    rim = (reach / (0.125 / radius)) ** 2
    z = 1 + gap / reach
    for law, part, beyond in (
        ({"law": "exponential", "work": work, "range": reach}, math.exp(-gap / reach), 0.0),
        ({"law": "lennard_jones", "work": work, "separation": reach}, (4 * z**-2 - z**-8) / 3, 4 / 3 * rim),
    ):
        values: Mapping[str, object] = {
            "grid.points": [128, 128],
            "interface": law,
            "punch": {"shape": "parabola", "radius": radius},
            "halfspace.shear_modulus": 1e6,
            "trajectory": cycle(-gap, 0.0, -gap, 1.0)["trajectory"],
            "time": {"end": gap / 2, "step": gap / 2},
        }
        attraction = -run(HALFSPACE, values)["force"][0] / (2 * math.pi * work * radius)
        yield Row(f"force/(2 pi w R), {law['law']}", part, float(attraction), beyond + 1e-5, _BRADLEY)
