"""Contact pressures that end at a hardness, against plasticity theory and Tamaas."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.self_affine import SelfAffine
from gfmdlayer.results.recording import Recording
from gfmdlayer.time_functions import Table
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import HALFSPACE, run

_E_STAR = 1.0
_SLOPE = 0.1
_ROUGH: dict[str, Any] = {
    "shape": "self_affine",
    "hurst": 0.8,
    "roll_off": 0.25,
    "short_cutoff": 0.08,
    "rms_slope": _SLOPE,
    "seed": 1,
}
_TOLERANCE = 1e-9
_POINTS, _NUMPY = 128, "a program of its own"  # of `over_time`


def _pressed(points: int, hardness: float, load: float, steps: int = 1, **punch: Any) -> Recording:
    """Press a punch, the rough one by default, into an elastic halfspace by a mean pressure that grows."""
    values = {
        "grid.points": [points, points],
        "halfspace.shear_modulus": _E_STAR / 4,
        "punch": punch or _ROUGH,
        "interface": {"law": "hard_wall", "hardness": hardness},
        "trajectory": {"control": "load", "load": load},
        "time": {"end": 1.0, "step": 1 / steps},
        "solver.tolerance": _TOLERANCE,
        "output.snapshots": [1.0],
    }
    return run(HALFSPACE, values)


def yielding(quick: bool) -> Iterator[Row]:
    """Asperities that yield at a hardness.

    A sphere yields first where the largest pressure of Hertz is the hardness, at F = pi^3 R^2 H^3/(6 E*^2)
    (Johnson, Contact Mechanics, ch. 4). A pressure beside a square root is known to (D/a)^(3/2), D the
    spacing, and the load goes with its third power. Soft asperities carry F = H A but for an elastic rim: the
    elastic displacement H/E* times a radius moves the edge of a flank by this over the slope, which is the
    part H/(slope E*) of the radius. The imprint of a growing load does not depend on the number of steps;
    the error of the solver in it is its tolerance times the mean depth, at each step.
    """
    n, hardness = (64 if quick else 256), 0.08
    first = math.pi**3 * hardness**3 / 6 / _E_STAR**2
    low, high = 0.5, 1.5
    for _ in range(8):
        middle = (low + high) / 2
        pressed = _pressed(n, hardness, middle * first, shape="parabola", radius=1.0)
        low, high = (low, middle) if pressed.last("yielded_area") > 0 else (middle, high)
    radius = math.pi * hardness / (2 * _E_STAR)
    bound = 3 * (1 / n / radius) ** 1.5 + (high - low)
    yield Row(f"load of first yield of a sphere, n = {n}^2", 1.0, (low + high) / 2, bound, "Johnson, ch. 4")
    n = 64 if quick else 128
    for hardness in (5e-3, 5e-4):
        computed = _pressed(n, hardness, 0.5 * hardness)
        ratio = computed.last("mean_stress") / hardness / computed.last("contact_area")
        yield Row(f"F/(H A), H/E* = {hardness:g}", 1.0, ratio, hardness / _SLOPE / _E_STAR, "plastic limit")
    once, often = (_pressed(n, 0.02, 0.004, steps).last("plastic_work") for steps in (1, 8))
    depth = computed.last("depth")
    yield Row("H W, 8 steps over 1", 1.0, often / once, 8 * _TOLERANCE * 0.02 * depth / once, "implicit flow")


def over_time(quick: bool) -> Iterator[Row]:  # noqa: ARG001  # another grid has other numbers
    """A rough punch that yields on a Zener halfspace: pressed in, held, and withdrawn.

    The numbers of the theory are those of a program of its own, some 60 lines of NumPy, for the same heights
    on 128 x 128 points: projected conjugate gradients without a preconditioner, and displacements that are
    linear in time over steps of 1/64. The bound is half of their last digit.
    """
    times, corners = np.linspace(0.0, 5.0, 321), [0.0, 1.0, 4.0, 4.98, 5.0]
    for control, most, answer, (first, held), energies in (
        ("load", 0.02, "depth", (0.003882, 0.004175), {"dissipated": 6.4321e-6, "plastic_work": 1.4629e-5}),
        ("depth", 0.003, "mean_stress", (0.007984, 0.001306), {"plastic_work": 4.4840e-6}),
    ):
        drive = np.interp(times, corners, [0.0, most, most, 0.02 * most, 0.02 * most])
        values = {
            "grid.points": [_POINTS, _POINTS],
            "layer.thickness": math.inf,
            "interface": {"law": "hard_wall", "hardness": 0.2},
            "trajectory": {"control": control, control: most},
            "time": {"end": 5.0, "step": 1 / 64, "integrator": "exponential"},
            "solver.tolerance": _TOLERANCE,
        }
        computed = run(values, punch=_heights(), trajectory=Table(times, drive))
        under = f"under a {control} that is held"
        for time, theory in ((1.0, first), (4.0, held)):
            value = computed.at(answer, [time]).item()
            yield Row(f"{answer} at t = {time:g} {under}", theory, value, 5e-7, _NUMPY)
        for name, theory in energies.items():
            bound = 0.5e-4 * 10.0 ** math.floor(math.log10(theory))
            yield Row(f"{name} {under}", theory, computed.last(name), bound, _NUMPY)
        flow = computed.last("plastic_work") - float(computed.at("plastic_work", [1.0])[0])
        theory, bound = (5.8e-7, 0.5e-8) if control == "load" else (0.0, 1e-9 * computed.last("plastic_work"))
        yield Row(f"plastic_work after t = 1 {under}", theory, flow, bound, _NUMPY)


def _heights() -> FloatArray:
    """Self-affine heights of Hurst exponent 0.8 with 4 to 32 waves in the period; the slope is `_SLOPE`."""
    n = _POINTS
    q = 2 * math.pi * np.hypot(*np.meshgrid(np.fft.rfftfreq(n, 1 / n), np.fft.fftfreq(n, 1 / n)))
    inside = (q >= 8 * math.pi * 0.999) & (q <= 64 * math.pi * 1.001)
    amplitudes = np.where(inside, np.maximum(q, 1.0) ** -1.8, 0.0)
    phases = np.fft.rfft2(np.random.default_rng(1).standard_normal((n, n)))
    slope = np.fft.irfft2(phases * amplitudes * q, s=(n, n)).std()
    z = np.fft.irfft2(phases * amplitudes, s=(n, n)) * _SLOPE / slope
    return np.ravel(z.max() - z)


def saturated(quick: bool) -> Iterator[Row]:
    """Pressures up to a hardness, by the saturated solver of Tamaas and here.

    Frerot et al., J. Open Source Softw. 5 (2020) 2121. The discrete problem is the same: a first loading.
    Tamaas ends by a mean of errors, far below its largest one, so it runs to a thousandth of our tolerance.
    The bound is a millionth of the hardness.
    """
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    tamaas.initialize(1)
    n, hardness, load = (32 if quick else 64), 0.02, 0.004
    computed = _pressed(n, hardness, load)
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, [1.0, 1.0], [n, n])
    model.E, model.nu = _E_STAR, 0.0
    surface: FloatArray = -SelfAffine(**_ROUGH).heights(Grid((n, n), (1.0, 1.0)))
    solver = tamaas.KatoSaturated(model, surface, _TOLERANCE / 1000, hardness)
    solver.max_iter = 100_000
    solver.solve(load)
    off = float(
        np.abs(np.asarray(model.traction).reshape(n, n) - computed.fields["pressure"][-1]).max() / hardness
    )
    source = f"Tamaas {tamaas.__version__}"
    yield Row(f"largest difference of the pressures over H, n = {n}^2", 0.0, off, 1e-6, source)
