"""The stiffness of the layered body, and whole runs, in the limits of a simpler body."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gfmdlayer.body.layer import LayeredHalfspace
from gfmdlayer.body.materials import Zener
from gfmdlayer.body.relaxation import relaxation_spectrum
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ALONE, HALFSPACE, RIGID, difference, run
from gfmdlayer.verification.theory import (
    DEPTH,
    PARABOLA,
    parabola_grid_error,
    parabola_half_width,
    parabola_pressure,
    solver_error,
)

_EPS = float(np.finfo(float).eps)
_ROUNDING = 40 * _EPS / 2  # some forty operations, none of which cancels
_MATERIAL = Zener(1.0, 10.0, 1.0)
_TOLERANCE = 1e-9


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

    thick = [LayeredHalfspace(math.inf, nu, 7.0).layer_factor(q, 3.0) for nu in (0.0, 0.3, 0.5)]
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
        for expected, found_time in zip(known, times[1:], strict=True):
            yield Row(f"theta/tau, k = {k}", expected, float(found_time), 5e-6, "roots of the denominator D")


def limiting_bodies(quick: bool) -> Iterator[Row]:
    """Whole runs of bodies close to a simpler one.

    Where K is within a part epsilon of the simpler body's at every q, the Cauchy-Schwarz inequality puts the
    mean pressure within epsilon [2 E p'(depth)]^(1/2)/pbar, p' = d pbar/d(depth), E the energy: less than 2
    epsilon. The error of both solvers is added. The base under a layer many wavelengths thick has no effect,
    to the last bit.
    """
    n = 2**10 if quick else 2**14
    steps: dict[str, object] = {"time.end": 2.0, "time.step": 0.1, "solver.tolerance": _TOLERANCE}
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
        solvers = 2 * 10 * solver_error(_TOLERANCE, simple.last("contact_area"))
        bound = 0.0 if part is None else 2 * part + solvers
        off = difference(run(values, close), simple)
        yield Row(f"ptilde over the largest: {name}", 0.0, off, bound, "Eqs. (11) to (14)")


def fast_and_slow(quick: bool) -> Iterator[Row]:
    """The glassy response at t = 0+ and the relaxed one at t = inf.

    A punch pressed in within 1e-9 tau meets Ginf: with G_bulk = Ginf a halfspace of that modulus, for any
    thickness (Fig. 2), but for a part 1e-9 that has relaxed. In the end it meets G0: with G_bulk = G0 a
    halfspace of that modulus (Fig. 4). At 300 tau exp(-299/10) of the slowest mode remains, and adaptive
    steps err by their tolerance of the largest pressure.
    """
    n = 2**10 if quick else 2**14
    a = parabola_half_width(DEPTH)
    p = float(parabola_pressure(a)) / 2
    off = parabola_grid_error(n, a) / 2 + solver_error(_TOLERANCE, 2 * a, p)
    values: dict[str, object] = {"grid.points": n, "solver.tolerance": _TOLERANCE}
    sudden = {"trajectory.ramp_time": 1e-9, "time.end": 1e-9, "time.step": 1e-9}
    for d in (0.03125, 0.25):
        found = run(values, sudden, {"halfspace.shear_modulus": 10.0, "layer.thickness": d})
        bound = 10 * (off + 1e-9 * p)
        yield Row(f"ptilde at t = 0+, d/L = {d:g}", 10 * p, found.last("mean_pressure"), bound, PARABOLA)
    tolerance = 1e-5
    adaptive = {"time": {"end": 300.0, "step": "adaptive", "tolerance": tolerance}}
    found = run(values, adaptive)
    largest = float(found["mean_pressure"].max())
    bound = off + tolerance * largest + 10 * p * math.exp(-299 / 10)
    yield Row("ptilde at t = 300 tau", p, found.last("mean_pressure"), bound, PARABOLA)
