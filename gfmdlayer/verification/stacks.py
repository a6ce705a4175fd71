"""Stacks of layers: the spectrum against the boundary-value problem, limits, a pavement, and whole runs."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.body.layer import Layer
from gfmdlayer.body.layers import LayerStack
from gfmdlayer.body.materials import Elastic, Prony
from gfmdlayer.body.shifts import WLF, Arrhenius
from gfmdlayer.case.case import Case
from gfmdlayer.config import Config
from gfmdlayer.results.recording import Recording
from gfmdlayer.verification.orders import FINE_STEPS, residual
from gfmdlayer.verification.rows import Convergence, Row
from gfmdlayer.verification.runs import difference, run
from gfmdlayer.verification.theory import solver_error

_SKIN = Prony(5.0, [(20.0, 0.1), (5.0, 1.0)])
_SOFT = Prony(1.0, [(3.0, 0.02), (4.0, 0.5), (1.0, 10.0)])
_BASE = Layer(math.inf, 0.3, Prony(20.0, [(7.0, 2.0)]))
_ABOVE = (Layer(0.02, 0.4, _SKIN), Layer(0.1, 0.5, _SOFT))
_STACKS = {
    "on a viscoelastic halfspace": LayerStack((*_ABOVE, _BASE)),
    "on a rigid base": LayerStack(_ABOVE, rigid=True),
    "free": LayerStack(_ABOVE),
}
_BODY: dict[str, object] = {
    "layers": [
        {"thickness": 0.02, "poisson": 0.4, "material": {"model": "zener", "G0": 5.0, "Ginf": 25.0}},
        {"thickness": 0.1, "poisson": 0.5, "material": {"model": "zener", "Ginf": 5.0, "tau": 0.5}},
    ],
    "halfspace": {"poisson": 0.3, "material": {"model": "zener", "G0": 20.0, "Ginf": 27.0, "tau": 2.0}},
}
_STEPS = (0.1, 0.05, 0.025)
_ROUNDING = 1e-11  # see `spectrum`


def spectrum(_quick: bool) -> Iterator[Row]:
    """The modes of three stacks against K(q, s) from the boundary-value problem, at complex s.

    The dense system of the layers' displacement functions amplifies rounding by its condition number, which
    is below 1e5 for these wavenumbers. Stiffness and modes are themselves accurate to some hundred roundings
    (`tests/body/test_stack.py`, 50 digits).
    """
    q, frequencies = np.geomspace(3.0, 300.0, 7), 1j * np.logspace(-4, 4, 9)
    for name, body in _STACKS.items():
        modes, off = body.spectrum(q), 0.0
        for s in frequencies:
            exact = np.array([_boundary_value_stiffness(body, wavenumber, s) for wavenumber in q])
            off = max(off, float(np.abs(modes.stiffness(s) / exact - 1).max()))
        yield Row(f"K(q, s) by modes, two layers {name}", 0.0, off, _ROUNDING, "boundary-value problem")
        yield Row(f"least weight, {name}", 0.0, max(0.0, float(-modes.weights.min())), 0.0, "second law")


def limits(_quick: bool) -> Iterator[Row]:
    """Layers without effect (cut in two, or of the halfspace's material), and merged modes in their bound.

    Equal bodies differ only by the rounding of the modes. Balanced truncation gives a bound on the relative
    error of K at all s >= 0; this rounding is added.
    """
    q, frequencies = np.geomspace(1e-6, 1e6, 25), np.logspace(-6, 6, 13)
    above, below = _ABOVE
    whole = LayerStack((above, below, _BASE))
    cut = LayerStack((above, Layer(0.03, 0.5, _SOFT), Layer(0.07, 0.5, _SOFT), _BASE))
    extended = LayerStack((above, below, Layer(0.2, _BASE.poisson, _BASE.material), _BASE))
    reference = whole.spectrum(q)

    def off(body: LayerStack) -> float:
        modes = body.spectrum(q)
        return max(float(np.abs(modes.stiffness(s) / reference.stiffness(s) - 1).max()) for s in frequencies)

    yield Row("a layer cut in two, q from 1e-6 to 1e6", 0.0, off(cut), _ROUNDING, "continuity")
    yield Row("a layer of the halfspace's material", 0.0, off(extended), _ROUNDING, "continuity")
    for accuracy in (1e-3, 1e-6, 1e-9):
        merged = LayerStack(whole.layers, accuracy=accuracy)
        bound = merged.spectrum(q).error + _ROUNDING
        yield Row(f"modes merged to {accuracy:g}", 0.0, off(merged), bound, "balanced truncation")


def pavement(_quick: bool) -> Iterator[Row]:
    """Deflection of a pavement under one and two loaded discs, a case of the code ELLEA1.

    Layers of 150 and 600 mm on a halfspace, E = 3000, 200, 40 MPa, nu = 0.3, 0.35, 0.4; a pressure p = 1.1
    MPa on a disc of radius a = 150 mm. The deflection is p a int J_1(q a) J_0(q r)/K(q) dq; the halfspace of
    the first material is subtracted, for which the integral is known: p a (1 - nu)/G for r = 0, 2/pi of it at
    r = a. The rest decays as exp(-2 q d) and is found by Gauss's rule to rounding. Known to five digits.
    """
    from scipy.special import j0, j1

    data = ((150.0, 3000.0, 0.3), (600.0, 200.0, 0.35), (math.inf, 40.0, 0.4))
    layers = tuple(Layer(d, nu, Elastic(E / (2 * (1 + nu)))) for d, E, nu in data)
    p, a, first = 1.1, 150.0, layers[0]
    alone = (1 - first.poisson) / first.material.relaxed
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edges = np.append(0.0, np.geomspace(1e-6, 40.0, 60)) / first.thickness
    half = np.diff(edges)[:, np.newaxis] / 2
    q = edges[:-1, np.newaxis] + half * (1 + nodes)
    rest = half * weights * j1(q * a) * (1 / LayerStack(layers).stiffness(q, 0.0).real - alone / q)
    for name, r, factor, discs, known in (
        ("under a disc", 0.0, 1.0, 1, 1.0508),
        ("midway between two discs", a, 2 / math.pi, 2, 1.9174),
    ):
        deflection = discs * p * a * (alone * factor + float((rest * j0(q * r)).sum()))
        yield Row(f"pavement: deflection {name}, mm", known, deflection, 1e-4 * known, "ELLEA1, in ALVA")


def runs(quick: bool) -> Iterator[Row | Convergence]:
    """Order of the time steps and balance of energy in whole runs of a stack.

    See `orders.time_steps` and `orders.balance` for the bounds. Merging modes changes K by a
    fraction epsilon at most, and so the pressure by less than 2 epsilon, see `closed_forms.limiting_bodies`.
    """
    n = 2**10 if quick else 2**13
    values = {**_BODY, "grid.points": n, "time.end": 2.0, "solver.tolerance": 1e-7}
    fine = run(values, {"time.step": _STEPS[-1] / 16})
    every = [run(values, {"time.step": step}) for step in _STEPS]
    errors = tuple(_error(coarse, fine) for coarse in every)
    curve = Convergence("step", "stack: exponential integrator", _STEPS, errors, 2)
    yield curve
    yield curve.row(0.11, f"u linear in a step, n = {n}")
    finer = (run({**values, "solver.tolerance": 1e-9}, {"time.step": step}) for step in FINE_STEPS)
    balance = Convergence("step", "stack: energy balance", FINE_STEPS, tuple(map(residual, finer)), 2)
    yield balance
    yield balance.row(0.2, f"first law, n = {n}")
    merged = _body_of(values)
    exact = run(values, {"time.step": _STEPS[-1]}, body=LayerStack(merged.layers))
    bound = 2 * merged.accuracy + 2 * 10 * solver_error(1e-7, float(exact["contact_area"].max()))
    yield Row("stack: merged modes", 0.0, difference(every[-1], exact), bound, f"all modes, n = {n}")


def different_shifts(quick: bool) -> Iterator[Row]:
    """Three materials with different shifts at one temperature, against a stack with shifted times.

    The second stack keeps all its modes; the bound is the error of the two solutions.
    """
    n = 2**8 if quick else 2**10
    laws = [
        WLF(C1=17.44, C2=51.6, reference=20.0),
        Arrhenius(activation_energy=8e4, reference=20.0),
        Arrhenius(activation_energy=2e5, reference=25.0),
    ]
    places = ["layers.0.material", "layers.1.material", "halfspace.material"]
    times = [1.0, 0.5, 2.0]
    common = {**_BODY, "grid.points": n, "time": {"end": 2.0, "step": 0.1}, "solver.tolerance": 1e-7}
    shifts = {f"{at}.shift": law.model_dump() for at, law in zip(places, laws, strict=True)}
    shifted = {f"{at}.tau": tau * law.factor(26.0) for at, tau, law in zip(places, times, laws, strict=True)}
    computed = run(common, shifts, {"temperature": {"value": 26.0}})
    expected = run(common, shifted, body=LayerStack(_body_of({**common, **shifted}).layers))
    bound = 2 * 10 * solver_error(1e-7, float(expected["contact_area"].max()))
    off = difference(computed, expected)
    yield Row("stack: different shifts at 26 degrees", 0.0, off, bound, f"shifted times, n = {n}")


def _body_of(values: dict[str, object]) -> LayerStack:
    """Return the stack of a run, whose modes are merged."""
    body = Case(Config(name="verification").with_values(values)).body
    assert isinstance(body, LayerStack)
    return body


def _error(computed: Recording, fine: Recording) -> float:
    """Largest error of the mean pressure at the times of the coarsest steps, relative to the largest."""
    times = np.arange(1, 21) * 0.1
    exact = fine.at("mean_pressure", times)
    return float(np.abs(computed.at("mean_pressure", times) - exact).max() / exact.max())


def _boundary_value_stiffness(body: LayerStack, q: float, s: complex) -> complex:
    """K(q, s) from the displacement functions of all layers and the conditions at all faces."""
    rows: list[ComplexArray] = []
    unknown = sum(2 if math.isinf(layer.thickness) else 4 for layer in body.layers)
    before, column = np.zeros((4, unknown), dtype=complex), 0
    first: ComplexArray | None = None
    for layer in body.layers:
        G = complex(layer.material.laplace(s))
        functions = 2 if math.isinf(layer.thickness) else 4
        top, bottom = np.zeros((2, 4, unknown), dtype=complex)
        d = 0.0 if functions == 2 else layer.thickness
        own = slice(column, column + functions)
        top[:, own] = _displacement_functions(q, d, 0.0, layer.poisson, G)[:, :functions]
        bottom[:, own] = _displacement_functions(q, d, d, layer.poisson, G)[:, :functions]
        if first is None:
            first = top
            rows += [top[0], top[3] / abs(G)]  # W = 1 and no shear
        else:
            scale = np.array([1.0, 1.0, abs(G), abs(G)])[:, np.newaxis]
            rows += [*((top - before) / scale)]
        before, column = bottom, column + functions
    if unknown % 4 == 0:
        rows += [*(before[:2] if body.rigid else before[2:] / np.abs(before[2:]).max())]
    assert first is not None
    right = np.zeros(unknown)
    right[0] = 1.0
    return complex(-q * (first[2] @ np.linalg.solve(np.array(rows), right)))


def _displacement_functions(q: float, d: float, z: float, nu: float, G: complex) -> ComplexArray:
    """W, U, sigma_zz/q and sigma_xz/q of four displacement functions at the depth z, for u_x = i U.

    With psi = exp(-qz) and exp(q(z - d)), and psi' its derivative by qz: (U, W) = (psi, psi') and (qz psi,
    qz psi' - (3 - 4 nu) psi).
    """
    columns: list[FloatArray] = []
    for sign, psi in ((-1.0, math.exp(-q * z)), (1.0, math.exp(q * (z - d)))):
        slope, x = sign * psi, q * z
        columns.append(np.array([slope, psi, 2 * psi, 2 * slope]))
        normal = 2 * (-2 * (1 - nu) * slope + x * psi)
        shear = (4 * nu - 2) * psi + 2 * x * slope
        columns.append(np.array([x * slope - (3 - 4 * nu) * psi, x * psi, normal, shear]))
    return np.asarray(np.array(columns).T * np.array([1, 1, G, G])[:, np.newaxis])
