"""Contact pressures that end at a hardness, against plasticity theory and Tamaas."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.self_affine import SelfAffine
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import Recording, run

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


def _pressed(points: int, hardness: float, load: float, steps: int = 1, **punch: Any) -> Recording:
    """Press a punch, the rough one by default, into an elastic halfspace by a mean pressure that grows."""
    return run(
        {
            "grid.points": [points, points],
            "layer.thickness": 0.0,
            "halfspace.shear_modulus": _E_STAR / 4,
            "punch": punch or _ROUGH,
            "interface": {"law": "hard_wall", "hardness": hardness},
            "trajectory": {"control": "load", "load": load},
            "time": {"end": 1.0, "step": 1 / steps},
            "solver.tolerance": _TOLERANCE,
            "output.snapshots": [1.0],
        }
    )


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
        found = _pressed(n, hardness, 0.5 * hardness)
        ratio = found.last("mean_stress") / hardness / found.last("contact_area")
        yield Row(f"F/(H A), H/E* = {hardness:g}", 1.0, ratio, hardness / _SLOPE / _E_STAR, "plastic limit")
    once, often = (_pressed(n, 0.02, 0.004, steps).last("plastic_work") for steps in (1, 8))
    depth = found.last("depth")
    yield Row("H W, 8 steps over 1", 1.0, often / once, 8 * _TOLERANCE * 0.02 * depth / once, "implicit flow")


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
    found = _pressed(n, hardness, load)
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, [1.0, 1.0], [n, n])
    model.E, model.nu = _E_STAR, 0.0
    surface: FloatArray = -SelfAffine(**_ROUGH).heights(Grid((n, n), (1.0, 1.0)))
    solver = tamaas.KatoSaturated(model, surface, _TOLERANCE / 1000, hardness)
    solver.max_iter = 100_000
    solver.solve(load)
    off = float(np.abs(np.asarray(model.traction).reshape(n, n) - found.snapshots[-1][2]).max() / hardness)
    source = f"Tamaas {tamaas.__version__}"
    yield Row(f"largest difference of the pressures over H, n = {n}^2", 0.0, off, 1e-6, source)
