"""Adhesion: elastic bodies (JKR, Johnson, Maugis, Bradley), viscoelastic pull-off, films across a gap."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.closed_form import LayeredHalfspace
from gfmdlayer.results.recording import Recording
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import (
    ALONE,
    ELASTIC,
    HALFSPACE,
    RIGID,
    adaptive,
    exponential,
    run,
    there_and_back,
)
from gfmdlayer.verification.theory import E_STAR, RADIUS, parabola_depth, parabola_pressure

_JKR = "periodic JKR, closed form; Johnson, Kendall and Roberts, Proc. R. Soc. A 324 (1971) 301"
_WAVE = "Johnson, Int. J. Solids Struct. 32 (1995) 423"
_MAUGIS = "Maugis, J. Colloid Interface Sci. 150 (1992) 243"
_BRADLEY = "Bradley, Phil. Mag. 13 (1932) 853"


def cycle(start: float, depth: float, final: float, speed: float) -> dict[str, object]:
    """Approach and retraction at a speed, by adaptive steps."""
    return {"trajectory": there_and_back(start, depth, final, speed), **adaptive(1e-3)}


def retraction(computed: Recording) -> tuple[FloatArray, FloatArray]:
    """Depth, rising, and mean stress of the retraction while there is contact."""
    depth, stress = computed["depth"], computed["mean_stress"]
    held = np.flatnonzero((np.arange(depth.size) >= depth.argmax()) & (computed["contact_area"] > 0))
    return depth[held][::-1], stress[held][::-1]


def _adhesive_rows(
    computed: Recording, depth: FloatArray, pressure: FloatArray, name: str, source: str, *places: float
) -> Iterator[Row]:
    """Yield pull-off and pressures at depths of the retraction, with a hundredth of the pull-off as bound."""
    ours, stress = retraction(computed)
    stable = slice(int(depth.argmin()), None)  # beyond the least depth of the branch
    least = float(pressure[stable].min())
    yield Row(f"pull-off pressure, {name}", least, float(stress.min()), 0.01 * -least, source)
    for place in places:
        theory = float(np.interp(place, depth[stable], pressure[stable]))
        value = float(np.interp(place, ours, stress))
        yield Row(f"pressure at depth {place:g}, {name}", theory, value, 0.01 * -least, source)


def line_jkr(_quick: bool) -> Iterator[Row]:
    """The line contact of a parabola with adhesion of short range.

    At half-width a the mean pressure is sqrt(2 E* w tan(pi a)) below the pressure without adhesion, and the
    depth is smaller by the depth of a flat strip of this width. A range rho smears the edge over the cohesive
    zone l = (pi/4) E* rho^2/w, and the pull-off falls short: by 11, 3 and 0.5 % where rho is halved twice, of
    second order and more. With six points to l the grid adds 0.1 %. The bound at the shortest range is 1 %,
    at the others the last digit of an independent program, the time between two rows included.
    """
    work = 1e-3
    a = np.linspace(5e-3, 0.2, 20001)
    pull = np.sqrt(2 * E_STAR * work * np.tan(np.pi * a))
    pressure = parabola_pressure(a) - pull
    depth = parabola_depth(a) + 2 / (np.pi * E_STAR) * np.log(np.sin(np.pi * a)) * pull
    values = {"grid.points": 2048, "interface": exponential(work, 1e-3)}
    computed = run(HALFSPACE, values, cycle(-0.004, 0.004, -0.016, 0.01))
    yield from _adhesive_rows(computed, depth, pressure, "line", _JKR, 0.003, 0.0, -0.003, -0.006)
    critical = (2 * work * RADIUS**2 / (math.pi * E_STAR)) ** (1 / 3)
    alone = -0.75 * math.sqrt(2 * math.pi * critical * E_STAR * work)
    yield Row(
        "pull-off of an isolated line", alone, float(computed["mean_stress"].min()), 0.01 * -alone, _JKR
    )
    least, known = float(pressure.min()), "dense Newton's method and FIRE, an independent program"
    for reach, theory in ((4e-3, 0.888), (2e-3, 0.970)):
        wide = {"grid.points": 1024, "interface": exponential(work, reach), "output.times": 0.01}
        part = float(run(HALFSPACE, wide, cycle(-0.004, 0.004, -0.016, 0.01))["mean_stress"].min()) / least
        yield Row(f"pull-off over the pull-off of JKR, range {reach:g}", theory, part, 0.002, known)


def wave(_quick: bool) -> Iterator[Row]:
    """A wavy punch with adhesion, from partial contact back to none.

    p = p_1 sin^2(psi) - sqrt(2 E* w tan(psi)/lambda), psi = pi a/lambda, p_1 = pi E* A/lambda, with the depth
    A (s - s ln s), s = sin^2 psi, minus the term of a flat strip. Range and grid as for the line.
    """
    amplitude, work = 0.02, 2e-3
    psi = np.linspace(0.02, 1.2, 20001)
    s, pull = np.sin(psi) ** 2, np.sqrt(2 * E_STAR * work * np.tan(psi))
    pressure = math.pi * E_STAR * amplitude * s - pull
    depth = amplitude * (s - s * np.log(s)) + 2 / (math.pi * E_STAR) * np.log(np.sin(psi)) * pull
    punch = {"shape": "sinusoid", "amplitude": amplitude, "wavelength": 1.0}
    values = {"grid.points": 1024, "interface": exponential(work, 2e-3), "punch": punch}
    computed = run(HALFSPACE, values, cycle(0, 0.012, -0.015, 0.01))
    yield from _adhesive_rows(computed, depth, pressure, "wave", _WAVE, 0.009, 0.003, -0.003)


def full_contact(_quick: bool) -> Iterator[Row]:
    """Full contact with a wavy punch is lost where the tension in its troughs reaches the strength.

    In full contact the pressure is pbar - p_1 cos(2 pi x/lambda); a trough opens where pbar - p_1 =
    -w/range. The load falls from twice the opening load, in steps of a hundredth of it.
    """
    amplitude, work, reach = 0.002, 1e-3, 0.05
    strength, height = work / reach, math.pi * E_STAR * amplitude
    opens = height - strength
    motion = there_and_back(0.0, 2 * opens, 0.5 * opens, 100 * opens, opens)
    motion |= {"control": "load", "load": motion.pop("depth")}
    values: dict[str, object] = {
        "grid.points": 256,
        "interface": exponential(work, reach),
        "punch": {"shape": "sinusoid", "amplitude": amplitude, "wavelength": 1.0},
        "trajectory": motion,
    }
    computed = run(HALFSPACE, values, {"time.step": 0.01, "time.integrator": "exponential"})
    load = float(computed["mean_stress"][computed["contact_area"] == 1].min())
    yield Row("load at which full contact opens", opens, load, 0.011 * opens, "pi E* A/L - w/range")


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
        computed = run(HALFSPACE, values, motion)
        ratio = -float(computed["force"].min()) / (math.pi * work * radius)
        yield Row(f"pull-off/(pi w R), lambda = {parameter:g}", theory, ratio, 0.01 * theory, _MAUGIS)


def rigid_sphere(_quick: bool) -> Iterator[Row]:
    """The force between a sphere and a body too stiff to deform, out of contact: Bradley's.

    In Derjaguin's approximation it is 2 pi R times the energy at the closest gap. The body, stiffer than
    the attraction by a factor 1e6, yields by a part 1e-6. The sum over the points is exact for an
    exponential law, whose force falls like a Gaussian; at the rim of the cell, where r = L/2, the law of
    Lennard-Jones has fallen to (s/g)^3 of its largest value, and the force beyond is the part (4/3)
    (s/g)^2.
    """
    work, radius, reach, gap = 1e-3, 1.0, 2e-3, 2e-4
    rim = (reach / (0.125 / radius)) ** 2
    z = 1 + gap / reach
    for law, part, beyond in (
        (exponential(work, reach), math.exp(-gap / reach), 0.0),
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


# Pull-off from viscoelastic bodies: slow and fast limits, their maximum, the time step.

_WORK, _RANGE, _DEPTH = 2e-4, 4e-4, 2e-3
_RELAXED = "the relaxed elastic body, same grid and law"
_KENDALL = "Kendall, J. Phys. D 4 (1971) 1186"
_GENT = (
    "Schapery, Int. J. Fract. 39 (1989) 163; Afferrante and Violano, J. Mech. Phys. Solids 158 (2022) 104669"
)


def _pulled(speed: float, dwell: float = 200.0, tolerance: float = 1e-3, **body: object) -> Recording:
    """Press a parabola in, rest for the dwell, retract; without a dwell the approach is as fast."""
    approach = 50 * _DEPTH if dwell else speed
    final = -0.02 if speed > 1e-3 else -0.006
    values = {
        "grid.points": 1024,
        "interface": exponential(_WORK, _RANGE),
        "trajectory": there_and_back(0.0, _DEPTH, final, approach, speed, dwell),
    }
    return run(ALONE, values, adaptive(tolerance), body)


def _least(computed: Recording) -> float:
    return -float(computed["mean_stress"].min())


def rate_dependence(_quick: bool) -> Iterator[Row]:
    """Pull-off of a parabola from a Zener halfspace of Ginf = 10 G0 after full relaxation.

    A slow retraction meets the relaxed body. In a fast one each part of the edge opens as in a glassy body,
    whose energy for the same tension is less by G0/Ginf: the apparent work is w Ginf/G0, until the strength
    w/range caps it. The apparent work is (P/P_relaxed)^(3/2) by JKR's scaling; the scaling neglects the
    cohesive zone, which is longer by Ginf/G0 in the glassy body: 0.05 and 0.15 of the contact for contrasts
    of 2 and 5. Between the limits the heat has its largest value.
    """
    fine = {"grid.points": 2048}  # five points in the cohesive zone
    law = {"interface": exponential(_WORK, _RANGE)}
    elastic = _least(run(ALONE, ELASTIC, law, fine, cycle(0.0, _DEPTH, -0.006, 1e-2)))
    slow = _pulled(1e-8, **fine)
    yield Row("slow pull-off over the relaxed elastic one", 1.0, _least(slow) / elastic, 0.01, _RELAXED)
    for contrast, bound in ((2.0, 0.1), (5.0, 0.75)):
        fast = _pulled(1.0, **{"layer.material.Ginf": contrast})
        apparent = (_least(fast) / elastic) ** 1.5
        yield Row(f"apparent work over w, fast, Ginf = {contrast:g} G0", contrast, apparent, bound, _GENT)
    pulls = [_least(_pulled(speed)) for speed in (1e-5, 1e-4, 1e-3, 1e-2)]
    rising = float(np.min(np.diff([_least(slow), *pulls])))
    yield Row("least growth of the pull-off with the speed, negative part", 0.0, min(rising, 0.0), 0.0, _GENT)
    work = [_pulled(speed, 0.0).last("work") for speed in (1e-7, 3e-4, 100.0)]
    ends = max(work[0], work[2]) / work[1]
    yield Row("work of a cycle, slowest or fastest over that between", min(ends, 1.0), ends, 0.0, _GENT)


def size_of_the_step(_quick: bool) -> Iterator[Row]:
    """The pull-off by adaptive steps does not depend on the tolerance.

    A step is as long as the edge takes to open a gap by the part s of the range, s = 0.5, 0.3, 0.14 at
    tolerances of 1e-3, 1e-4, 1e-5. The traction of the opening edge, and so the pull, is in error by a part
    of third order, 0.05 s^3 = 6e-3, 1.3e-3, 1.4e-4. (With u linear over the steps it was 0.1 s^2.)
    """
    coarse, fine, finest = (_least(_pulled(1e-4, tolerance=tolerance)) for tolerance in (1e-3, 1e-4, 1e-5))
    source = "no dependence on the step"
    yield Row("pull-off, tolerance 1e-3 over 1e-4", 1.0, coarse / fine, 7e-3, source)
    yield Row("pull-off, tolerance 1e-4 over 1e-5", 1.0, fine / finest, 1.5e-3, source)


def flat_punch(_quick: bool) -> Iterator[Row]:
    """A flat punch on a Zener halfspace of Ginf = 4 G0 and on thin films: Kendall's limits.

    Strips of half-width a in a period L part at the mean tension sqrt(2 E* w tan(pi a/L)/L), with E* of the
    relaxed body for slow and of the glassy body for fast retraction. The cohesive zone l takes a part of
    the order of l/a of the tension: 2 % in the relaxed, 6 % in the glassy body. Any speed lies between.
    """
    half, pull_offs = 0.1, []
    values = {
        "grid.points": 4096,
        "interface": exponential(_WORK, 2e-4),
        "punch": {"shape": "flat", "width": 2 * half, "edge_radius": 1e-4},
        "layer.material.Ginf": 4.0,
    }
    for speed in (1e-7, 1e-3, 10.0):
        motion = {"trajectory": there_and_back(-1e-3, 0.0, -0.05, 1.0, speed, dwell=100.0)}
        pull_offs.append(_least(run(ALONE, values, motion, adaptive(1e-3))))
    slow = math.sqrt(2 * E_STAR * _WORK * math.tan(math.pi * half))
    yield Row("slow pull-off of a flat punch", slow, pull_offs[0], 0.04 * slow, _KENDALL)
    yield Row("fast pull-off of a flat punch", 2 * slow, pull_offs[2], 0.08 * 2 * slow, _KENDALL)
    inside = min(max(pull_offs[1], pull_offs[0]), pull_offs[2])
    yield Row("pull-off between, against the limits", inside, pull_offs[1], 0.0, _KENDALL)


def thin_films(quick: bool) -> Iterator[Row]:
    """A flat punch on compressible films on a rigid base: the tension falls as d^(-1/2).

    A film that is thin against the punch stores sigma^2 d/(2 M) per area, with M = 2 G (1 - nu)/(1 - 2 nu),
    and parts at sigma = sqrt(2 M w/d) where this is w. Edges take a part of the order of d/a.
    """
    half, poisson = 0.25, 0.3
    modulus = 2 * (1 - poisson) / (1 - 2 * poisson)
    for thickness in (0.02,) if quick else (0.01, 0.02):
        tension = math.sqrt(2 * modulus * _WORK / thickness)
        values: dict[str, object] = {
            "grid.points": 4096,
            "layer": {"thickness": thickness, "poisson": poisson, "material": {"Ginf": 1.0}},
            "interface": exponential(_WORK, 3e-4),
            "punch": {"shape": "flat", "width": 2 * half, "edge_radius": 1e-4},
        }
        computed = run(RIGID, values, cycle(-5e-4, 1e-4, -5e-3, 1e-2))
        largest = _least(computed) / (2 * half)
        bound = thickness / half
        yield Row(f"tension at pull-off, d = {thickness:g}", tension, largest, bound * tension, _KENDALL)


# Films attracted across a gap: uniform pull-in, wavelength of the instability, its delay.

_PULL_IN = "V^2 = 8 K (g0 + h0)^3/(27 eps0)"
_FILM = "Shenoy and Sharma, Phys. Rev. Lett. 86 (2001) 119"
_DELAY = "equation of the uniform mode, by an adaptive Runge-Kutta method"

_GAP, _INSULATION = 2e-3, 1e-3
_THICKNESS, _POISSON = 0.05, 0.2  # compressible enough for the uniform mode to be the lowest
_FILM_BODY: dict[str, object] = {  # under a flat punch
    "grid.points": 16,
    "layer.thickness": _THICKNESS,
    "layer.poisson": _POISSON,
    "punch": {"shape": "sinusoid", "amplitude": 1e-12, "wavelength": 1.0},
}


def _voltage(square: float) -> dict[str, object]:
    """Interface of a voltage of one; `square` is eps0 V^2."""
    law = {"law": "electrostatic", "voltage": 1.0, "insulation": _INSULATION, "permittivity": square}
    return {"interface": law}


def _first(computed: Recording, quantity: str) -> float:
    """Time or depth of the first instability of a run."""
    return float(np.asarray(computed.noted[f"instability_{quantity}"])[0])


def pull_in(_quick: bool) -> Iterator[Row]:
    """A flat punch under voltage, brought down upon a compressible film on a rigid base.

    The film, a spring K(0) = 2 G (1 - nu)/((1 - 2 nu) d) per area, snaps to the punch at the gap at rest g0
    with eps0 V^2 = 8 K (g0 + h0)^3/(27). Adaptive steps locate an instability to a thousandth of
    a gap.
    """
    stiffness = float(LayeredHalfspace(_THICKNESS, _POISSON, math.inf).stiffness(0.0, 1.0))
    square = 8 * stiffness * (_GAP + _INSULATION) ** 3 / 27
    values = {"trajectory": there_and_back(-2 * _GAP, 0.0, -2 * _GAP, _GAP)}
    computed = run(RIGID, ELASTIC, _FILM_BODY, _voltage(square), values, adaptive(1e-4, end=2.0))
    yield Row("g0 at pull-in", _GAP, -_first(computed, "depth"), 1e-3 * _GAP, _PULL_IN)


def flat_film(_quick: bool) -> Iterator[Row]:
    """The wavelength at which a flat incompressible film becomes unstable under a punch at a distance.

    The flat state ends where the attraction falls with the gap faster than the lowest mode of the film is
    stiff: 6.2229 G/d, at q d = 2.1196. The grid has waves at steps of 2 pi d/L = 0.1 in q d. Heights of 1e-5
    of the gap choose the phase, and lower the threshold by a part of the order of (1e-5)^(2/3).
    """
    period = 2 * math.pi * 10 * _THICKNESS
    q = 2 * math.pi / period * np.arange(1, 65)
    stiffness = LayeredHalfspace(_THICKNESS, 0.5, math.inf).stiffness(q, 1.0)
    lowest = int(np.argmin(stiffness))
    square = float(stiffness[lowest]) * (_GAP + _INSULATION) ** 3
    cutoffs = {"short_cutoff": _THICKNESS, "roll_off": 1.2 * _THICKNESS, "rms_height": 1e-5 * _GAP}
    values: dict[str, object] = {
        "grid": {"points": 256, "period": period},
        "layer.thickness": _THICKNESS,
        "punch": {"shape": "self_affine", "hurst": 0.8, "seed": 1, **cutoffs},
        "trajectory": there_and_back(-1.5 * _GAP, 0.0, -2 * _GAP, _GAP),
        "output.snapshots": "every",
    }
    computed = run(RIGID, ELASTIC, values, _voltage(square), adaptive(1e-4, end=1.0))
    closest = -_first(computed, "depth")
    theory = 6.2229 / _THICKNESS
    attraction = square / (closest + _INSULATION) ** 3
    yield Row("|w''| where the flat film ends", theory, attraction, 5e-3 * theory, _FILM)
    before = max(i for i, time in enumerate(computed.times) if time < _first(computed, "time"))
    shape = computed.fields["displacement"][before]
    wave = int(np.argmax(np.abs(np.fft.rfft(shape))[1:]))
    yield Row("q d of the wave that grows", 2.1196, float(q[wave]) * _THICKNESS, 0.1, _FILM)


def delayed_pull_in(_quick: bool) -> Iterator[Row]:
    """A film that is stable while it is glassy, and snaps to the punch when it has relaxed.

    The punch is brought at once to a distance between those of pull-in of the glassy and of the relaxed
    film. The uniform mode, a Zener spring of K(0) times G(t)/G0, sinks towards it until no equilibrium is
    left: K_inf u - w xi = eps0 V^2/(2 (g0 + h0 - u)^2), tau dxi/dt + xi = u.
    """
    relaxed, contrast = float(LayeredHalfspace(_THICKNESS, _POISSON, math.inf).stiffness(0.0, 1.0)), 4.0
    rest = _GAP + _INSULATION
    square = 8 * 1.5 * relaxed * rest**3 / 27  # half more than the relaxed film carries
    glassy, weight = contrast * relaxed, (contrast - 1) * relaxed

    last = rest - (square / glassy) ** (1 / 3)  # beyond it the attraction grows faster than the film's stress

    def excess(u: float, xi: float) -> float:
        return float(glassy * u - weight * xi - square / (2 * (rest - u) ** 2))

    def rate(_time: float, state: FloatArray) -> list[float]:
        xi = float(state[0])
        u = brentq(excess, 0.0, last, args=(xi,), xtol=1e-15) if excess(last, xi) > 0 else last
        return [float(u) - xi]

    def ends(_time: float, state: FloatArray) -> float:
        return excess(last, float(state[0]))

    ends.terminal = True  # type: ignore[attr-defined]
    followed = solve_ivp(rate, (0, 50), [0.0], events=ends, rtol=1e-9, atol=1e-15)
    theory = float(followed.t_events[0][0])
    sudden = _GAP / 1e-6
    values = {
        "layer.material.Ginf": contrast,
        "trajectory": there_and_back(-2 * _GAP, -_GAP, -2 * _GAP, sudden, dwell=2 * theory),
    }
    computed = run(RIGID, _FILM_BODY, _voltage(square), values, adaptive(1e-4, end=2 * theory))
    yield Row("time of pull-in/tau", theory, _first(computed, "time"), 0.02 * theory, _DELAY)
