"""The same problem by independent methods; laws and temperature against theirs."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.special import erfcx

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.continuous import FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw
from gfmdlayer.body.layer import LayeredHalfspace
from gfmdlayer.body.materials import Zener
from gfmdlayer.body.relaxation import relaxation_spectrum
from gfmdlayer.body.shifts import WLF
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.time_functions import Table
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ALONE, ELASTIC, ONE_STEP, RIGID, difference, run
from gfmdlayer.verification.theory import parabola_grid_error, solver_error
from gfmdlayer.verification.third_order import ThirdOrder

_EPS = float(np.finfo(float).eps)
_LAW_TOLERANCE = 1e-4
_SHIFT = {"law": "wlf", "C1": 17.44, "C2": 51.6, "reference": 20.0}
_PAPER: dict[str, object] = {"time.end": 1.0, "time.step": 0.005, "time.integrator": "backward_euler"}


def three_solvers(quick: bool) -> Iterator[Row]:
    """The active set, conjugate gradients and FIRE on the same steps.

    Each has the solver's error at its residual, Ginf/G0 of that with the history: two of them differ by twice
    as much at most, most of all at full depth. Relative to the largest ptilde. The edge may differ by a cell
    where it passes close to a point.
    """
    n, tolerance, source = (2**10 if quick else 2**14), 1e-7, "same problem, other method"
    values = {"grid.points": n, "time.end": 2.0, "time.step": 0.1}
    first, *others = (
        run(values, {"solver": {"method": method, "tolerance": tolerance}})
        for method in ("conjugate_gradient", "active_set", "fire")
    )
    bound = 20 * solver_error(tolerance, first.last("contact_area"))
    for method, other in zip(("active set", "fire"), others, strict=True):
        name = f"{method} against conjugate gradients, n = {n}"
        yield Row(f"ptilde: {name}", 0.0, difference(other, first), bound, source)
        cells = float(np.abs(other["contact_area"] - first["contact_area"]).max() * n / 2)
        yield Row(f"edge, in cells: {name}", 0.0, cells, 1.0, source)


def two_forms_of_backward_euler(quick: bool) -> Iterator[Row]:
    """The paper's third-order equation against the relaxing modes.

    Backward Euler on each mode is Eq. (24) with backward differences, to rounding. In the paper's form the
    error of a step grows as a third sum, (j + 1)(j + 2)/2 after j steps, until j passes theta/dt: summed over
    i steps min((i + 3)^3/6, prod_k (1 + theta_k/dt)) times, of ten roundings a step at the scale of the
    glassy stress. The three times theta_k are tau and two up to tau Ginf/G0.
    """
    n, steps = (2**10, 100) if quick else (2**14, 400)
    q = np.asarray(2 * np.pi * np.arange(n // 2 + 1), dtype=np.float64)
    for d, bulk in ((0.05, 1.0), (0.05, np.inf), (np.inf, 1.0)):
        found = stress_difference(LayeredHalfspace(d, 0.5, bulk), q, 0.005, steps)
        name = f"stress over its rounding, d = {d:g}, G_bulk = {bulk:g}, n = {n}"
        yield Row(name, 0.0, found, 1.0, "Eq. (24)")


def stress_difference(body: LayeredHalfspace, q: FloatArray, step: float, steps: int) -> float:
    """Largest difference of the stress by both forms of backward Euler, in units of its rounding."""
    material = Zener(1.0, 10.0, 1.0)
    paper = ThirdOrder(body, material, q, step)
    modes = Modes(relaxation_spectrum(body, material, q), SCHEMES["backward_euler"])
    phases, largest = np.exp(1j * np.arange(q.size)), 0.0
    for i in range(steps):
        (kappa, b), (expected_kappa, expected_b) = paper.terms(step), modes.terms(step)
        u = phases * (min(i * step, 1.0) + 0.2 * np.sin(3 * i * step))  # at most 1.2
        growth = min((i + 3) ** 3 / 6, (1 + 1 / step) * (1 + 10 / step) ** 2)
        rounding = 10 * _EPS * growth * 1.2 * expected_kappa[1:]
        off = np.abs((b - kappa * u) - (expected_b - expected_kappa * u))[1:]
        largest = max(largest, float((off / rounding).max()))
        paper.advance(u)
        modes.advance(u)
    return largest


def load_against_depth(quick: bool) -> Iterator[Row]:
    """The loads that a depth needs, put on as loads, give that depth.

    Both runs have the solver's error of the pressure, Ginf/G0 of it with the history; the depth rises more
    slowly than the pressure, so its error, in parts of the largest depth, is no larger.
    """
    n, tolerance = (2**9 if quick else 2**13), 1e-8
    values = {"grid.points": n, "time.end": 2.0, "time.step": 0.05, "solver.tolerance": tolerance}
    loaded = {"trajectory": {"control": "load", "load": 0.0}}  # the loads are given below
    for name, body in (("halfspace below", {}), ("rigid base, nu = 0.3", RIGID | {"layer.poisson": 0.3})):
        pressed = run(values, body)
        loads = Table(pressed["time"], 2 * pressed["mean_pressure"])
        off = difference(run(values, body, loaded, trajectory=loads), pressed, "depth")
        bound = 2 * 10 * solver_error(tolerance, pressed.last("contact_area"))
        yield Row(f"depth: {name}, n = {n}", 0.0, off, bound, "same problem, other control")


def lines_and_surfaces(quick: bool) -> Iterator[Row]:
    """A ridge on a surface in two directions is a line contact.

    The same discrete problem, solved on other transforms: twice the solver's error, with the history,
    relative to the largest ptilde.
    """
    n, tolerance = (2**8 if quick else 2**11), 1e-7
    values = {"grid.points": n, "time.end": 1.5, "time.step": 0.125, "solver.tolerance": tolerance}
    plane = {"grid": {"points": [n, 8], "period": [1.0, 0.5]}, "punch.radius": [0.25, float("inf")]}
    line = run(values)
    bound = 20 * solver_error(tolerance, line.last("contact_area"))
    off = difference(run(values, plane), line)
    yield Row(f"ptilde, n = {n}", 0.0, off, bound, "same problem, other transforms")


def recorded_results(quick: bool) -> Iterator[Row]:
    """Recorded results of another code: Tamaas 2.9.0, with the kernel of the layer.

    Printed to seven digits; its depth, found by a secant on the load, is within 1e-6, which is 1.5e-6 of the
    pressure. Both codes use the same grid, and so have the same grid error; with small grids the grid's error
    is added to the bound.
    """
    cases = (
        ("elastic, G/G_bulk = 0.25", {"halfspace.shear_modulus": 4.0} | ELASTIC | ONE_STEP, 0.0376030, 2**12),
        ("elastic, G/G_bulk = 2.5", {"halfspace.shear_modulus": 0.4} | ELASTIC | ONE_STEP, 0.0058981, 2**12),
        ("elastic, G/G_bulk = 10", {"halfspace.shear_modulus": 0.1} | ELASTIC | ONE_STEP, 0.0019038, 2**14),
        ("t = tau, d = inf", ALONE | _PAPER, 0.0889770, 2**14),
        ("t = tau, rigid base", RIGID | _PAPER, 1.085422, 2**14),
    )
    for name, values, expected, known_on in cases:
        n = min(known_on, 2**11 if quick else known_on)
        found = run(values, {"grid.points": n, "solver.tolerance": 1e-7})
        bound = expected * (1.5e-6 + 10 * solver_error(1e-7, found.last("contact_area")))
        bound += 5e-7 if expected > 1 else 5e-8
        if n < known_on:
            bound += expected * 20 * parabola_grid_error(n, found.last("contact_area") / 2)
        yield Row(f"ptilde, {name}, n = {n}", expected, found.last("mean_pressure"), bound, "Tamaas 2.9.0")


def series_of_laws(quick: bool) -> Iterator[Row]:
    """The Prony series in place of laws with a continuous spectrum, at 2000 times and frequencies.

    The errors of G(t) and G(omega), relative to their magnitude, keep to the tolerance of the law between the
    samples of the fit. The law itself is checked for the exponent 1/2, where the function of Mittag-Leffler
    is exp(x) erfc(sqrt(x)); the contour integral reaches 1e-12.
    """
    half = FractionalZener(0.1, 1.0, 1.0, 0.5)
    t = np.geomspace(1e-6, 1e6, 2000)
    exact = 0.1 + 0.9 * erfcx(np.sqrt(t))
    found = float(np.abs(half.relaxation_modulus(t) / exact - 1).max())
    yield Row("fractional Zener, exponent 1/2: error of G(t)", 0.0, found, 1e-12, "exp(x) erfc(sqrt x)")
    decades = 4 if quick else 12
    laws = (
        half,
        PowerLaw(1.0, 1.0, 0.3),
        Kohlrausch(0.1, 1.0, 1.0, 0.5),
        HavriliakNegami(0.1, 1.0, 1.0, 0.7, 0.5),
    )
    for law in laws:
        width = decades if law is half else 4
        shortest, longest = 10.0 ** (-width / 2), 10.0 ** (width / 2)
        series = law.prony(shortest, longest, _LAW_TOLERANCE).material
        t = np.geomspace(shortest, longest, 2000)
        in_time = np.abs(series.relaxation_modulus(t) / law.relaxation_modulus(t) - 1).max()
        in_frequency = np.abs(series.complex_modulus(1 / t) / law.complex_modulus(1 / t) - 1).max()
        name = f"{law.model}, {width} decades by {len(series.maxwell_branches)} branches: error of"
        yield Row(f"{name} G(t)", 0.0, float(in_time), _LAW_TOLERANCE, "the law itself")
        yield Row(f"{name} G(omega)", 0.0, float(in_frequency), _LAW_TOLERANCE, "the law itself")


def jump_of_temperature(_quick: bool) -> Iterator[Row]:
    """A flat punch on the material alone, in which the temperature rises from 18 to 30 degrees in 1e-3 tau.

    The contact does not change, so that p(t) = p_0 int G(xi(t) - xi(s))/G0 dh(s)/h_0, p_0 the pressure on
    the relaxed material and the reduced time xi. The displacement is linear over each step, for which the
    exponential scheme is exact: what remains is the tolerance of the solver, 1e-10, of both runs, and the
    rounded edges of the punch, 1e-6 of the cell, which are less than a tenth of a point. The bound is a
    hundred times the tolerance, for a pressure that falls to a tenth of its peak.
    """
    rows = (0.0, 18.0), (1.0, 18.0), (1.001, 30.0), (3.0, 30.0)
    tolerance = 1e-10
    flat: dict[str, object] = {
        "layer.thickness": math.inf,
        "punch": {"shape": "flat", "width": 0.25, "edge_radius": 1e-6},
        "trajectory": {"depth": 0.01, "ramp_time": 0.5},
        "solver.tolerance": tolerance,
        "grid.points": 128,
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "jump.txt"
        file.write_text("".join(f"{time} {degrees}\n" for time, degrees in rows))
        jump: dict[str, object] = {
            "layer.material": {"model": "zener", "shift": _SHIFT},
            "temperature": {"file": str(file)},
            "time": {"step": "adaptive", "tolerance": 1e-5, "end": 3.0},
        }
        found = run(flat | jump)
    elastic = run(flat | {"layer.material": {"model": "elastic"}, "time": {"step": 0.25, "end": 0.5}})
    shift = WLF(C1=17.44, C2=51.6, reference=20.0)
    reduced = ReducedTime(shift, Table(*np.array(rows).T))
    slow = shift.factor(18.0)
    held = found["time"] >= 0.5
    xi = np.array([reduced.step(0.0, time) for time in found["time"][held]])
    ramp = slow * math.expm1(0.5 / slow) / 0.5
    exact = elastic["mean_pressure"][-1] * (1 + 9 * np.exp(-xi) * ramp)
    error = float(np.abs(found["mean_pressure"][held] / exact - 1).max())
    yield Row("p(t)/p - 1, jump of temperature", 0.0, error, 100 * tolerance, "Boltzmann's integral")
