"""Elastic contact, single modes and viscoelastic halfspaces, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.optimize import brentq

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
from gfmdlayer.body.materials import Zener
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ALONE, ELASTIC, HALFSPACE, ONE_STEP, RIGID, difference, run
from gfmdlayer.verification.theory import (
    DEPTH,
    E_STAR,
    JOHNSON,
    PARABOLA,
    RADIUS,
    grid_error,
    parabola_depth,
    parabola_grid_error,
    parabola_half_width,
    parabola_pressure,
    solver_error,
)

_TOLERANCE = 1e-8
_GLASSY = 10.0  # Ginf/G0
_LEE_RADOK = "Lee and Radok (1960); Eq. (5)"


def periodic_parabola(quick: bool) -> Iterator[Row]:
    """The paper's punch on an elastic halfspace.

    pbar = -(E* L/(2 pi R)) ln cos psi and depth = (L^2/(4 pi^2 R)) [pi^2/6 - Li2(cos^2 psi)], psi = pi a/L.
    Each edge of contact is known within a cell. The mean pressure has the errors of grid and solver, whose
    bounds are derived above.
    """
    n = 2**10 if quick else 2**14
    a = parabola_half_width(DEPTH)
    p = float(parabola_pressure(a))
    computed = run(HALFSPACE, ONE_STEP, {"grid.points": n, "solver.tolerance": _TOLERANCE})
    yield Row(f"atilde, n = {n}", 2 * a, computed.last("contact_area"), 2 / n, PARABOLA)
    off = parabola_grid_error(n, a) + solver_error(_TOLERANCE, 2 * a, p)
    yield Row(f"ptilde, n = {n}", p / 2, computed.last("mean_pressure"), off / 2, PARABOLA)


def hertz_line(quick: bool) -> Iterator[Row]:
    """Hertz's line contact, where the contact is small.

    a^2 = 4 P R/(pi E*) and p_max = E* a/(2 R) for the computed load P. Neighbours a period away change both
    by the fraction psi^2/6, the next term of ln cos psi. The edge is known within a cell. The top of the
    profile is flat, so its error is at most (D/a)^2.
    """
    n, depth = (2**12, 1e-3) if quick else (2**14, 1e-3)
    values = {"grid.points": n, "trajectory.depth": depth, "output.snapshots": [1.0]}
    computed = run(HALFSPACE, ONE_STEP, values, {"solver.tolerance": _TOLERANCE})
    load = 2 * computed.last("mean_pressure")
    a = math.sqrt(4 * load * RADIUS / (np.pi * E_STAR))
    neighbours, cells = (np.pi * a) ** 2 / 6, a * n
    peak = E_STAR * a / (2 * RADIUS)
    source = f"Hertz; {JOHNSON}, ch. 4"
    half_width = computed.last("contact_area") / 2
    yield Row(f"half-width a/L, n = {n}", a, half_width, 1 / n + neighbours * a, source)
    highest = float(computed.fields["pressure"][-1].max())
    yield Row(f"p_max/G, n = {n}", peak, highest, peak * (2 * neighbours + 1 / cells**2), source)


def hertz_sphere(quick: bool) -> Iterator[Row]:
    """Hertz's contact under a sphere, in a periodic cell.

    a^3 = 3 F R/(4 E*), depth = a^2/R, p_max = 3 F/(2 pi a^2), with the displacement due to the neighbours,
    F/(pi E*) (S_1 + S_3 r^2/4). S_1 and S_3 are lattice sums of 1/r minus its mean and of 1/r^3; the rest is
    of the order (a/L)^5. The rim is known to half a cell, and the area to the fraction 1/m, with m points in
    a radius. Depth and peak have errors of m^-2, as in a line contact, times a periodic function of the
    position of the rim, which is below 0.06 and 0.15.
    """
    n, a = (128, 0.1) if quick else (512, 0.1)
    lattice_1, lattice_3 = -3.90026492, 9.03362168
    load = 4 * E_STAR * a**3 / 3
    curvature = lattice_3 * load / (4 * np.pi * E_STAR)
    R, m = 1 / (1 + 2 * curvature), a * n
    a = (3 * load * R / (4 * E_STAR)) ** (1 / 3)
    depth = a**2 / R + lattice_1 * load / (np.pi * E_STAR) + curvature * 2 * a**2 / 5
    trajectory = {"trajectory": {"control": "load", "load": load}, "output.snapshots": [1.0]}
    values = {"grid.points": [n, n], "punch.radius": 1.0, "solver.tolerance": _TOLERANCE}
    computed = run(HALFSPACE, ONE_STEP, trajectory, values)
    source = f"Hertz; {JOHNSON}, ch. 4"
    area, peak = np.pi * a**2, 1.5 * load / (np.pi * a**2)
    yield Row(f"area of contact, {n} x {n}", area, computed.last("contact_area"), area / m, source)
    beyond = depth * a**5
    yield Row(f"depth/L, {n} x {n}", depth, computed.last("depth"), depth * 0.06 / m**2 + beyond, source)
    highest = float(computed.fields["pressure"][-1].max())
    yield Row(f"p_max/G, {n} x {n}", peak, highest, peak * (0.15 / m**2 + a**5), source)


def westergaard(quick: bool) -> Iterator[Row]:
    """A sinusoidal punch on an elastic halfspace.

    pbar = (pi E* h/lambda) S, S = sin^2 psi; growing contact has the compliance of a flat strip, -(2
    lambda/(pi E*)) ln sin psi, which adds up to depth = h S (1 - ln S). The bounds are those of the parabola,
    with d pbar/da = 2 pbar (pi/lambda) cot psi; p_max = 2 pbar/sin psi.
    """
    n, h = (1536 if quick else 3 * 2**12), 0.01
    source = f"Westergaard (1939); {JOHNSON}, ch. 13"
    for waves, part in ((1, 0.1), (1, 0.6), (3, 0.95)):
        depth = part * h
        S = float(brentq(lambda S, depth=depth: h * S * (1 - math.log(S)) - depth, 1e-12, 1, xtol=1e-15))
        psi = math.asin(math.sqrt(S))
        p = np.pi * E_STAR * h * waves * S
        punch = {"shape": "sinusoid", "amplitude": h, "wavelength": 1 / waves}
        values = {"punch": punch, "trajectory.depth": depth, "grid.points": n}
        computed = run(HALFSPACE, ONE_STEP, values, {"solver.tolerance": _TOLERANCE})
        name = f"depth {part:g} h, {waves} wave{'s' * (waves > 1)}, n = {n}"
        yield Row(f"atilde, {name}", 2 * psi / np.pi, computed.last("contact_area"), 2 * waves / n, source)
        steepness = 2 * p * np.pi * waves / math.tan(psi)
        off = grid_error(n, psi / (np.pi * waves), steepness, waves)
        off += _TOLERANCE * p * (2 / math.sin(psi) + 1.5)
        yield Row(f"ptilde, {name}", p / 2, computed.last("mean_pressure"), off / 2, source)


def thin_layer(quick: bool) -> Iterator[Row]:
    """A thin, bonded, incompressible layer on a rigid base.

    If d is small against a, the layer is squeezed like a lubricant: P = 2 G a^5/(15 R d^3) and depth =
    a^2/(6 R). This theory fails near the edge, over a length of the order of the thickness, so by a fraction
    d/a.
    """
    n, d = (2**12, 0.005) if quick else (2**14, 0.0025)
    a = 0.2
    load = 2 * a**5 / (15 * RADIUS * d**3)
    trajectory = {"trajectory": {"control": "load", "load": load}}
    computed = run(ELASTIC, RIGID, ONE_STEP, trajectory, {"grid.points": n, "layer.thickness": d})
    depth = a**2 / (6 * RADIUS)
    yield Row(f"depth/L, d/L = {d:g}", depth, computed.last("depth"), depth * d / a, f"{JOHNSON}, ch. 5.8")


def full_contact(_quick: bool) -> Iterator[Row]:
    """A wave pressed flat at once: the pressure relaxes as the sum of the layer's modes.

    p(t) = h [K_0 + sum_j w_j exp(-t/theta_j)] at the q of the wave, with K from the paper's Eq. (11) at the
    modulus G(s). The load rises within 1e-9 tau, which is the bound relative to the glassy stiffness. The
    mode of the displacement equals the punch's within rounding, and the exponential steps are exact.
    """
    n, h, times = 2**14, 0.01, [0.25, 1.0, 4.0]
    punch = {"shape": "sinusoid", "amplitude": h, "wavelength": 1.0}
    load = {"trajectory": {"control": "load", "load": 50.0, "ramp_time": 1e-9}}
    steps = {"time.end": 4.0, "time.step": 0.25, "output.snapshots": times}
    computed = run({"punch": punch, "grid.points": n}, load, steps)
    spectrum = relaxation_spectrum(LayeredHalfspace(0.05, 0.5, 1.0), Zener(1.0, 10.0, 1.0), [2 * np.pi])
    wave = np.cos(2 * np.pi * (np.arange(n) / n - 0.5))
    for time, pressure in zip(computed.times, computed.fields["pressure"], strict=True):
        left = (spectrum.relaxed + (spectrum.weights * np.exp(-time / spectrum.times)).sum(axis=0)).item()
        amplitude = 2 * float(np.mean(pressure * wave))
        yield Row(
            f"amplitude of p, t = {time:g} tau",
            h * left,
            amplitude,
            1e-9 * h * spectrum.glassy.item() + 1e-14 * 50.0,
            "Eqs. (4), (10), (11)",
        )


def depth_control(quick: bool) -> Iterator[Row]:
    """The paper's ramp on a viscoelastic halfspace, d = inf.

    While the contact does not shrink it is the elastic one of the same depth, and pbar(t) = int G(t - s)
    dF(depth(s)), F the elastic pbar at G = 1. Exponential steps interpolate F linearly: F is convex, and the
    integral of the difference is dt^2/12 F' by the trapezoidal rule, so the pressure is too small by at most
    (Ginf - G0) dt^2/12 F'. Integrated by parts, an error of F itself, from the grid or the solver, counts
    (2 Ginf - G0)/G0 times at most.
    """
    n, step = (2**10, 0.05) if quick else (2**14, 0.0125)
    times = [0.1, 0.5, 1.0, 2.0]
    values = {"grid.points": n, "time.end": 2.0, "time.step": step, "solver.tolerance": _TOLERANCE}
    computed = run(ALONE, values)
    a, at = np.linspace(0, parabola_half_width(DEPTH), 20001), computed.at("mean_pressure", times)
    s, pressures = np.append(parabola_depth(a[:-1]) / DEPTH, 1.0), parabola_pressure(a)
    for time, ptilde in zip(times, at, strict=True):
        done = min(time, 1.0)
        area, F = (float(np.interp(done, s, each)) for each in (2 * a, pressures))
        growth = 1.5 * F / done  # d ln pbar/d ln depth is below 1.5
        off = (_GLASSY - 1) * step**2 / 12 * growth
        off += (2 * _GLASSY - 1) * (parabola_grid_error(n, area / 2) + solver_error(_TOLERANCE, area, F))
        exact = _hereditary(s, pressures, time)
        yield Row(f"ptilde, t = {time:g} tau, n = {n}", exact / 2, float(ptilde), off / 2, _LEE_RADOK)
        touching = computed.at("contact_area", [time]).item()
        yield Row(f"atilde, t = {time:g} tau, n = {n}", area, touching, 2 / n, _LEE_RADOK)


def load_control(quick: bool) -> Iterator[Row]:
    """A viscoelastic halfspace that creeps under a load.

    The contact equals an elastic body's of modulus G0 under F = int J(t - s) dpbar(s), J = 1/G0 - (1/G0 -
    1/Ginf) exp(-t G0/(Ginf tau)). Linear interpolation of F over the steps errs by at most (Ginf - G0)/G0
    dt^2/12 F', F' below the rate of loading times J. The depth has the error of F, and the grid's,
    times d(depth)/dF.
    """
    n, step, load = (2**10, 0.025, 0.05) if quick else (2**14, 0.0125, 0.05)
    times = [0.5, 1.0, 3.0]
    trajectory = {"trajectory": {"control": "load", "load": load}}
    values = {"grid.points": n, "time.end": 3.0, "time.step": step, "solver.tolerance": _TOLERANCE}
    computed = run(ALONE, trajectory, values)
    for time in times:
        F = load * (_creep(time) - _creep(max(time - 1, 0)))
        a = float(np.arccos(np.exp(-2 * np.pi * RADIUS / E_STAR * F)) / np.pi)
        depth = computed.at("depth", [time]).item()
        off = (_GLASSY - 1) * step**2 / 12 * load * _compliance(time)
        off += parabola_grid_error(n, a) + _GLASSY * solver_error(_TOLERANCE, 2 * a, F)
        slope = -2 / (np.pi * E_STAR) * float(np.log(np.sin(np.pi * a)))
        name = f"t = {time:g} tau, n = {n}"
        yield Row(f"depth/L, {name}", float(parabola_depth(a)), depth, off * slope, _LEE_RADOK)
        touching = computed.at("contact_area", [time]).item()
        yield Row(f"atilde, {name}", 2 * a, touching, 2 / n, _LEE_RADOK)


def _hereditary(s: FloatArray, F: FloatArray, time: float) -> float:
    """Integral of G(t - s) dF up to a time by the midpoint rule, G(t) of the paper's default material."""
    done = np.minimum(s, time)
    lag = time - (done[1:] + done[:-1]) / 2
    return float((1 + 9 * np.exp(-lag)) @ np.diff(np.interp(done, s, F)))


def _compliance(time: float) -> float:
    """Creep compliance J(t) of the paper's default material."""
    return 1 - 0.9 * float(np.exp(-time / 10))


def _creep(time: float) -> float:
    """Integral of J from 0 to `time`."""
    return time + 9 * float(np.expm1(-time / 10))


# Limits: stiffness and whole runs of bodies that approach a simpler body.

_EPS = float(np.finfo(float).eps)
_ROUNDING = 40 * _EPS / 2  # some forty operations, none of which cancels
_MATERIAL = Zener(1.0, 10.0, 1.0)
_TIGHT = 1e-9


def stiffness_limits(_quick: bool) -> Iterator[Row]:
    """The stiffness K(q) of the layered body in limits with a closed form.

    S(q) = q G/((1 - nu) K) of Eq. (11). Forty operations, none of which cancels, round off by 40 eps/2. Under
    long waves a layer on a rigid base has S = (2/3) (qd)^3 but for a part (9/5) (qd)^2, the next term of
    Eq. (13); a thin layer takes the stiffness of its base but for a part of the order of q d times the
    contrast of the moduli.
    """
    q = np.logspace(-8, 6, 57)

    def worst(values: object) -> float:
        return float(np.abs(np.asarray(values) - 1).max())

    deep = [LayeredHalfspace(d, nu, 7.0) for d in (math.inf, 1e300) for nu in (0.0, 0.3, 0.5)]
    thick = [body.layer_factor(q, 3.0) for body in deep]
    yield Row("S - 1, d = inf", 0.0, worst(thick), _ROUNDING, "Eq. (29)")
    alike = [LayeredHalfspace(1.0, nu, 5.0, nu).layer_factor(q, 5.0) for nu in (0.0, 0.3, 0.5)]
    yield Row("S - 1, layer of the halfspace's material", 0.0, worst(alike), _ROUNDING, "Eq. (12), m = n = 0")
    bare = LayeredHalfspace(0.0, 0.5, 7.0, 0.3).stiffness(q, 3.0) / (q * 7.0 / 0.7)
    yield Row("K/(q G_bulk/(1 - nu_bulk)) - 1, d = 0", 0.0, worst(bare), _ROUNDING, "Eq. (9)")
    x = 1e-5
    squeezed = LayeredHalfspace(1.0, 0.5, math.inf).layer_factor(x, 1.0).item() / (2 / 3 * x**3)
    yield Row("S/((2/3) (qd)^3), rigid base", 1.0, squeezed, 2 * x**2 + _ROUNDING, "Eq. (13)")
    thin = LayeredHalfspace(1e-8, 0.5, 4.0).layer_factor(1.0, 1.0).item()
    yield Row("S, G/G_bulk = 1/4, qd = 1e-8", 0.25, thin, 4e-8, "Eq. (11)")
    confined = LayeredHalfspace(0.1, 0.3, math.inf).stiffness(0.0, 3.0).item()
    modulus = 2 * 3.0 * 0.7 / 0.4 / 0.1
    yield Row(
        "K(0) d, compressible on a rigid base", modulus, confined, modulus * _ROUNDING, "P-wave modulus"
    )


def printed_equation(_quick: bool) -> Iterator[Row]:
    """The stiffness against Eqs. (11) and (12) as printed.

    At real and complex moduli. The printed form cancels for thin layers; from qd = 1 on its
    denominator is above 1/2, and ten operations on terms below 8 cost less than 160 eps.
    """
    x, moduli = np.linspace(1.0, 40.0, 157), np.array([[0.1], [1.0], [10.0], [1 + 1j], [0.5 + 30j]])
    off = 0.0
    for nu, nu_bulk, bulk in ((0.5, 0.5, 1.0), (0.5, 0.5, 100.0), (0.3, 0.4, 0.1), (0.0, 0.5, 2.0)):
        g, r = moduli / bulk, np.exp(-2 * x)
        m = (g - 1) / (g + 3 - 4 * nu)
        n = 1 - 4 * (1 - nu) / (1 + g * (3 - 4 * nu_bulk))
        numerator = 1 + 4 * m * x * r - m * n * r**2
        denominator = 1 - (m + n + 4 * m * x**2) * r + m * n * r**2
        ours = LayeredHalfspace(1.0, nu, bulk, nu_bulk).layer_factor(x, moduli)
        off = max(off, float(np.abs(ours * denominator / numerator - 1).max()))
    yield Row("S against Eq. (11) as printed", 0.0, off, 160 * _EPS, "Eqs. (11), (12)")


def relaxing_modes(_quick: bool) -> Iterator[Row]:
    """The exact relaxation spectrum against the stiffness at the modulus G(s).

    K_0 + sum_j w_j s theta_j/(1 + s theta_j) is K(q, G(s)) at every complex s: to rounding, of three modes
    forty operations each. The times theta_j of the paper's default body were found to six digits from the
    roots in multiple precision.
    """
    q = 2 * np.pi * np.arange(1, 2049)
    off = 0.0
    for body in (
        LayeredHalfspace(0.05, 0.5, 1.0),
        LayeredHalfspace(0.05, 0.5, 256.0),
        LayeredHalfspace(0.01, 0.3, 0.1, 0.4),
    ):
        spectrum = relaxation_spectrum(body, _MATERIAL, q)
        for s in 1j * np.logspace(-4, 4, 33):
            exact = body.stiffness(q, _MATERIAL.laplace(s))
            off = max(off, float(np.abs(spectrum.stiffness(s) / exact - 1).max()))
    yield Row("K(q, s) by modes against Eq. (11)", 0.0, off, 3 * _ROUNDING, "Eqs. (4), (11)")
    default = LayeredHalfspace(0.05, 0.5, 1.0)
    for k, known in ((1, (4.17316, 9.84365)), (3, (5.32998, 8.24585)), (10, (5.49934, 5.60627))):
        times = np.sort(relaxation_spectrum(default, _MATERIAL, [2 * np.pi * k]).times.ravel())
        for expected, computed in zip(known, times[1:], strict=True):
            yield Row(f"theta/tau, k = {k}", expected, float(computed), 5e-6, "roots of the denominator D")


def limiting_bodies(quick: bool) -> Iterator[Row]:
    """Whole runs of bodies that are close to a simpler body.

    If K differs from the simpler body's by at most a fraction epsilon at every q, the Cauchy-Schwarz
    inequality
    bounds the relative difference of the mean pressure by epsilon [2 E p'(depth)]^(1/2)/pbar, p' =
    d pbar/d(depth), E the energy: less than 2 epsilon. The errors of both solvers are added. The base under a
    layer many wavelengths thick has no effect, to the last bit.
    """
    n = 2**10 if quick else 2**14
    steps: dict[str, object] = {"time.end": 2.0, "time.step": 0.1, "solver.tolerance": _TIGHT}
    values = steps | {"grid.points": n}
    q = 2 * np.pi * np.arange(1, n // 2 + 1)

    def epsilon(close: LayeredHalfspace, simple: LayeredHalfspace) -> float:
        return max(float(np.abs(close.stiffness(q, G) / simple.stiffness(q, G) - 1).max()) for G in (1, 10))

    thin = epsilon(LayeredHalfspace(1e-12, 0.5, 1.0), LayeredHalfspace(0.0, 0.5, 1.0))
    stiff = epsilon(LayeredHalfspace(0.05, 0.5, 1e9), LayeredHalfspace(0.05, 0.5, math.inf))
    for name, body, close, part in (
        ("d = 1e-12 L against none", HALFSPACE, {"layer.thickness": 1e-12}, thin),
        ("d = 100 L against d = inf", ALONE, {"layer.thickness": 100.0}, None),
        ("G_bulk = 1e9 G0 against a rigid base", RIGID, {"halfspace.shear_modulus": 1e9}, stiff),
    ):
        simple = run(values, body)
        solvers = 2 * 10 * solver_error(_TIGHT, simple.last("contact_area"))
        bound = 0.0 if part is None else 2 * part + solvers
        off = difference(run(values, close), simple)
        yield Row(f"ptilde over the largest: {name}", 0.0, off, bound, "Eqs. (11) to (14)")


def fast_and_slow(quick: bool) -> Iterator[Row]:
    """The glassy response at t = 0+ and the relaxed one at t = inf.

    A punch pressed in within 1e-9 tau meets Ginf. With G_bulk = Ginf the body is then a halfspace of that
    modulus for any thickness (Fig. 2), except for the fraction 1e-9 that has relaxed. In the end the punch
    meets G0; with G_bulk = G0 the body is a halfspace of that modulus (Fig. 4). At 300 tau exp(-299/10) of
    the slowest mode remains, and adaptive steps err by their tolerance times the largest pressure.
    """
    n = 2**10 if quick else 2**14
    a = parabola_half_width(DEPTH)
    p = float(parabola_pressure(a)) / 2
    off = parabola_grid_error(n, a) / 2 + solver_error(_TIGHT, 2 * a, p)
    values: dict[str, object] = {"grid.points": n, "solver.tolerance": _TIGHT}
    sudden = {"trajectory.ramp_time": 1e-9, "time.end": 1e-9, "time.step": 1e-9}
    for d in (0.03125, 0.25):
        computed = run(values, sudden, {"halfspace.shear_modulus": 10.0, "layer.thickness": d})
        bound = 10 * (off + 1e-9 * p)
        yield Row(f"ptilde at t = 0+, d/L = {d:g}", 10 * p, computed.last("mean_pressure"), bound, PARABOLA)
    tolerance = 1e-5
    adaptive = {"time": {"end": 300.0, "step": "adaptive", "tolerance": tolerance}}
    computed = run(values, adaptive)
    largest = float(computed["mean_pressure"].max())
    bound = off + tolerance * largest + 10 * p * math.exp(-299 / 10)
    yield Row("ptilde at t = 300 tau", p, computed.last("mean_pressure"), bound, PARABOLA)
