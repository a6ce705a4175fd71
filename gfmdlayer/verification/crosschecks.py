"""Independent methods: other solvers, the paper's integrator, other codes; laws and temperature."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import erfcx

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
from gfmdlayer.body.continuous import FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw
from gfmdlayer.body.materials import Zener
from gfmdlayer.body.shifts import WLF
from gfmdlayer.grid.grid import Grid
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.punch.simple_shapes import Parabola
from gfmdlayer.time_functions import Table
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ALONE, ELASTIC, HALFSPACE, ONE_STEP, RIGID, difference, run
from gfmdlayer.verification.theory import RADIUS, parabola_grid_error, solver_error

_EPS = float(np.finfo(float).eps)
_LAW_TOLERANCE = 1e-4
_SHIFT = {"law": "wlf", "C1": 17.44, "C2": 51.6, "reference": 20.0}
_PAPER: dict[str, object] = {"time.end": 1.0, "time.step": 0.005, "time.integrator": "backward_euler"}


def three_solvers(quick: bool) -> Iterator[Row]:
    """The active set, conjugate gradients and FIRE on the same steps.

    Each has the solver's error at its residual, times Ginf/G0 with the history. Two of them differ by twice
    as much at most, and most at full depth. Errors are relative to the largest ptilde. The edge may differ by
    a cell where it passes close to a point.
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

    Backward Euler on each mode is Eq. (24) with backward differences, within rounding. In the paper's form
    the error of a step grows as a third sum, (j + 1)(j + 2)/2 after j steps, until j passes theta/dt: summed
    over i steps min((i + 3)^3/6, prod_k (1 + theta_k/dt)) times, of ten roundings a step at the scale of the
    glassy stress. The three times theta_k are tau and two up to tau Ginf/G0.
    """
    n, steps = (2**10, 100) if quick else (2**14, 400)
    q = np.asarray(2 * np.pi * np.arange(n // 2 + 1), dtype=np.float64)
    for d, bulk in ((0.05, 1.0), (0.05, np.inf), (np.inf, 1.0)):
        difference = stress_difference(LayeredHalfspace(d, 0.5, bulk), q, 0.005, steps)
        name = f"stress over its rounding, d = {d:g}, G_bulk = {bulk:g}, n = {n}"
        yield Row(name, 0.0, difference, 1.0, "Eq. (24)")


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
    """The loads of a run at prescribed depth, prescribed in a second run, give the same depth.

    Both runs have the solver's error of the pressure, times Ginf/G0 with the history. The depth rises more
    slowly than the pressure, so its error relative to the largest depth is no larger.
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

    It is the same discrete problem on other transforms. The bound is twice the solver's error, with the
    history, relative to the largest ptilde.
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
        computed = run(values, {"grid.points": n, "solver.tolerance": 1e-7})
        bound = expected * (1.5e-6 + 10 * solver_error(1e-7, computed.last("contact_area")))
        bound += 5e-7 if expected > 1 else 5e-8
        if n < known_on:
            bound += expected * 20 * parabola_grid_error(n, computed.last("contact_area") / 2)
        yield Row(f"ptilde, {name}, n = {n}", expected, computed.last("mean_pressure"), bound, "Tamaas 2.9.0")


def series_of_laws(quick: bool) -> Iterator[Row]:
    """The Prony series in place of laws with a continuous spectrum, at 2000 times and frequencies.

    The errors of G(t) and G(omega), relative to their magnitude, keep to the tolerance of the law between the
    samples of the fit. The law itself is checked for the exponent 1/2, where the function of Mittag-Leffler
    is exp(x) erfc(sqrt(x)); the contour integral reaches 1e-12.
    """
    half = FractionalZener(0.1, 1.0, 1.0, 0.5)
    t = np.geomspace(1e-6, 1e6, 2000)
    exact = 0.1 + 0.9 * erfcx(np.sqrt(t))
    error = float(np.abs(half.relaxation_modulus(t) / exact - 1).max())
    yield Row("fractional Zener, exponent 1/2: error of G(t)", 0.0, error, 1e-12, "exp(x) erfc(sqrt x)")
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
    """A flat punch on a halfspace; its temperature rises from 18 to 30 degrees in 1e-3 tau.

    The contact does not change, so that p(t) = p_0 int G(xi(t) - xi(s))/G0 dh(s)/h_0, p_0 the pressure on
    the relaxed material and the reduced time xi. The displacement is linear over each step, for which the
    exponential scheme is exact. There remain the tolerance of the solver, 1e-10, of both runs, and the
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
        computed = run(flat | jump)
    elastic = run(flat | {"layer.material": {"model": "elastic"}, "time": {"step": 0.25, "end": 0.5}})
    shift = WLF(C1=17.44, C2=51.6, reference=20.0)
    reduced = ReducedTime(shift, Table(*np.array(rows).T))
    slow = shift.factor(18.0)
    held = computed["time"] >= 0.5
    xi = np.array([reduced.step(0.0, time) for time in computed["time"][held]])
    ramp = slow * math.expm1(0.5 / slow) / 0.5
    exact = elastic["mean_pressure"][-1] * (1 + 9 * np.exp(-xi) * ramp)
    error = float(np.abs(computed["mean_pressure"][held] / exact - 1).max())
    yield Row("p(t)/p - 1, jump of temperature", 0.0, error, 100 * tolerance, "Boltzmann's integral")


# The paper's integrator: its third-order constitutive equation, Eq. (24), by backward Euler.
#
# For an incompressible Zener layer on an incompressible halfspace the stress of each mode follows its
# displacement by
#
#     sum_k (c_{k+1,1} + c_{k,1}) tau^k d^k sigma/dt^k = -2 q sum_k (c_{k+1,0} G0 + c_{k,0} Ginf) tau^k d^k
#     u/dt^k,   k = 0 ... 3.
#
# Every derivative, on both sides, is a backward difference. The stress of the next step is then sigma =
# -kappa u + b with slopes -kappa and intercepts b that do not depend on u (lines 5 and 6 of the pseudocode).
#
# The history consists of the scaled differences Y_k = (tau/dt)^k nabla^k y of stress and displacement instead
# of old values: third differences of old values would be divided by (dt/tau)^3, which costs seven digits at
# dt = 0.005 tau.


class Coefficients(NamedTuple):
    """Coefficients of tau^k d^k/dt^k on the two sides of Eq. (24), k = 0 ... 3 along the first axis."""

    stress: FloatArray
    displacement: FloatArray


def constitutive_coefficients(layer: LayeredHalfspace, material: Zener, q: FloatArray) -> Coefficients:
    """Return the coefficients of both sides of Eq. (24), up to a factor common to both.

    The c_{j,k} of Eq. (21) are the coefficients of (1 + s)^2 N (k = 0) and (1 + s)^2 D (k = 1), the numerator
    and denominator of 1/S at the modulus G(s) = (G0 + s Ginf)/(1 + s), times G_bulk^2.  Expanded in the
    coefficients of N and D in G, none of which is negative, they keep their digits for thin layers and for a
    rigid or missing halfspace, where Eq. (21) as printed cancels or overflows.
    """
    G0, Ginf = material.G0, material.Ginf
    # N2 G^2 + N1 G G_bulk + N0 G_bulk^2, divided through by the larger modulus squared.
    scale = max(Ginf, layer.bulk_modulus)
    soft, hard, bulk = (
        (G0 / scale, Ginf / scale, layer.bulk_modulus / scale) if np.isfinite(scale) else (0.0, 0.0, 1.0)
    )
    numerator, denominator = layer.quadratics(q)
    c = [  # c[k] holds c_{1,k}, c_{2,k}, c_{3,k}
        np.stack(
            (
                square * soft**2 + linear * soft * bulk + constant * bulk**2,
                2 * square * soft * hard + linear * (soft + hard) * bulk + 2 * constant * bulk**2,
                square * hard**2 + linear * hard * bulk + constant * bulk**2,
            )
        )
        for constant, linear, square in (numerator, denominator)
    ]
    return Coefficients(stress=_times(c[1], 1.0, 1.0), displacement=2 * q * _times(c[0], G0, Ginf))


def _times(polynomial: FloatArray, constant: float, linear: float) -> FloatArray:
    """Multiply polynomials in s, coefficients along the first axis, by constant + linear s."""
    nothing = np.zeros_like(polynomial[:1])
    return constant * np.concatenate((polynomial, nothing)) + linear * np.concatenate((nothing, polynomial))


class ThirdOrder:
    """Backward Euler on Eq. (24), with a fixed time step."""

    def __init__(self, layer: LayeredHalfspace, material: Zener, q: FloatArray, step: float) -> None:
        if layer.poisson != 0.5 or (np.isfinite(layer.bulk_modulus) and layer.bulk_poisson != 0.5):
            raise ValueError("Eq. (24) holds for incompressible solids, nu = nu_bulk = 0.5")
        q = np.ravel(q)
        resisting = q > 0
        stress, displacement = (np.zeros((4, q.size)) for _ in range(2))
        stress[0] = 1.0  # at q = 0 the equation reads sigma = 0
        stress[:, resisting], displacement[:, resisting] = constitutive_coefficients(
            layer, material, q[resisting]
        )
        self._step, self._rate = step, material.tau / step
        powers = self._rate ** np.arange(4)[:, None]
        weight = (stress * powers).sum(axis=0)
        self.stiffness = (displacement * powers).sum(axis=0) / weight
        self._coefficients = np.stack([stress, displacement])[:, 1:] / weight  # of k = 1, 2, 3
        self._past = np.zeros((2, 3, q.size), dtype=np.complex128)  # Y_0, Y_1, Y_2 of sigma and of u
        self._b = np.zeros(q.size, dtype=np.complex128)

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, sigma = -kappa u + b, at the end of the next step (lines 5 and 6).

        Y_k of the next step is rate^k y - (rate^k Y_0 + rate^(k-1) Y_1 + ... + rate Y_(k-1)) of the last one;
        b collects the sums in brackets.
        """
        if step != self._step:
            raise ValueError(f"step {step} after steps of {self._step}: third differences need equal steps")
        bracket = np.zeros_like(self._past[:, 0])
        self._b = np.zeros_like(self._b)
        for k in range(3):
            bracket = self._rate * (bracket + self._past[:, k])
            self._b += (self._coefficients[:, k] * bracket).sum(axis=0)
        return self.stiffness, self._b

    def advance(self, spectrum: ComplexArray) -> None:
        """Advance the history by the step of the last `terms` with its displacement (lines 8 and 9)."""
        value = np.stack([self._b - self.stiffness * spectrum, spectrum])
        first = self._rate * (value - self._past[:, 0])
        self._past = np.stack([value, first, self._rate * (first - self._past[:, 1])], axis=1)


# Comparison with other codes, if they are installed.

_LOAD = 0.05
_TRAJECTORY = {"trajectory": {"control": "load", "load": _LOAD}}


class TamaasHalfspace:
    """The paper's default material as a halfspace of period 1, in the steps of Tamaas.

    Tamaas steps a generalised Maxwell halfspace by backward Euler and solves each step for a mean pressure by
    the method of Polonsky and Keer. Its Young's modulus is the relaxed one, its displacement counts into the
    body, and its surface is minus the height of the punch.
    """

    def __init__(self, heights: FloatArray, step: float, tolerance: float) -> None:
        import tamaas

        tamaas.set_log_level(tamaas.LogLevel.error)
        tamaas.initialize(1)
        self.version = str(tamaas.__version__)
        self._model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_1d, [1.0], [heights.size])
        self._model.E, self._model.nu = 3.0, 0.5
        self._surface = -heights  # kept here, since the solver refers to it
        self._solver = tamaas.MaxwellViscoelastic(self._model, self._surface, tolerance, step, [9.0], [1.0])
        self._solver.max_iter = 100_000

    def press(self, load: float) -> float:
        """Take a time step to a mean pressure and return the depth."""
        self._solver.solve(load)
        return -float(self._model.displacement.mean())

    @property
    def displacement(self) -> FloatArray:
        """Displacement of the surface, positive upward, of zero mean."""
        into_body = np.ravel(self._model.displacement)
        return np.asarray(into_body.mean() - into_body)

    @property
    def contact_area(self) -> float:
        """Fraction of the points in contact."""
        return float((np.ravel(self._model.traction) > 0).mean())


def tamaas(quick: bool) -> Iterator[Row]:
    """A viscoelastic halfspace under a load, by Tamaas and by backward Euler here.

    Frerot et al., J. Open Source Softw. 5 (2020) 2121. Problem and steps are the same. The difference is the
    error of both solvers, times Ginf/G0 with the history, and smaller in the depth than in the pressure.
    Tamaas runs to a tenth of our residual.
    """
    n, step, steps, tolerance = (2**9 if quick else 2**11), 0.1, 15, 1e-7
    peer = TamaasHalfspace(Parabola(radius=RADIUS).heights(Grid((n,), (1.0,))), step, tolerance / 100)
    depths = [peer.press(_LOAD * min(i * step, 1.0)) for i in range(1, steps + 1)]
    time = {"time": {"end": steps * step, "step": step, "integrator": "backward_euler"}}
    computed = run(ALONE, _TRAJECTORY, time, {"grid.points": n, "solver.tolerance": tolerance})
    area, depth = computed.last("contact_area"), computed["depth"][1:]
    source = f"Tamaas {peer.version}"
    off = float(np.abs(np.array(depths) - depth).max() / depth.max())
    yield Row(f"depth over the largest, n = {n}", 0.0, off, 1.1 * 10 * solver_error(tolerance, area), source)
    yield Row(f"atilde, n = {n}", peer.contact_area, area, 2 / n, source)


def contact_mechanics(quick: bool) -> Iterator[Row]:
    """An elastic halfspace under a load, by ContactMechanics and here.

    The discrete problem is the same; the bound is twice the solver's error. The depth in ContactMechanics is
    the mean height of the punch minus the mean gap.
    """
    from ContactMechanics import PeriodicFFTElasticHalfSpace
    from ContactMechanics.Systems import NonSmoothContactSystem
    from SurfaceTopography import UniformLineScan

    n, tolerance = (2**9 if quick else 2**12), 1e-8
    heights = -Parabola(radius=RADIUS).heights(Grid((n,), (1.0,)))
    system = NonSmoothContactSystem(
        PeriodicFFTElasticHalfSpace((n,), 4.0, (1.0,)), UniformLineScan(heights, 1.0, periodic=True)
    )
    answer = system.minimize_proxy(external_force=_LOAD, pentol=tolerance * 1e-4)
    peer_depth = float(-heights.mean() - system.compute_gap(system.disp, answer.offset).mean())
    peer_area = float(system.compute_nb_contact_pts() / n)
    computed = run(HALFSPACE, ONE_STEP, _TRAJECTORY, {"grid.points": n, "solver.tolerance": tolerance})
    area, depth = computed.last("contact_area"), computed.last("depth")
    source = f"ContactMechanics {version('ContactMechanics')}"
    yield Row(f"depth/L, n = {n}", peer_depth, depth, depth * 2 * solver_error(tolerance, area), source)
    yield Row(f"atilde, n = {n}", peer_area, area, 2 / n, source)
