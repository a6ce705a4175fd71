"""Residuals that are not noise: shapes that a model cannot make.

Each closed door of a model - the exponent of its indenter, a finite thickness, adhesion, a tilted baseline, a
faster or a slower relaxation - changes the force by a shape z. With F the contact force, x = depth over the
largest one, m the power with which F begins, to first order

    exponent F ln x,   thickness F sqrt(x),   adhesion x^(m/2),   tilt: the position,
    relaxation  integral of exp(-(t - s)/tau) d(x^m)(s).

A fit of [J, z] to the residual by generalised least squares, with the spectra of `intervals`, gives the size
of z beside the largest size that noise has (Bonferroni over the shapes). Several shapes are often alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import dct
from scipy.stats import f as f_ratio

from gfmdlayer.arrays import FloatArray
from gfmdlayer.fitting.intervals import mixture
from gfmdlayer.fitting.prediction import Prediction
from gfmdlayer.fitting.problem import MODULI, LeastSquares

CHANCE = 0.05  # of a false alarm
APART = 6.0  # of the times of a missing branch from those of the model
RESOLVED, LONG = 2.0, 3.0  # shortest such time in spacings of rows, longest in durations
SLOW = 6  # slowest cosines of a part as long as the baseline
SHARED, FLIPS, FEWEST_CURVES = (
    24,
    511,
    6,
)  # cosines and random signs of several curves; curves of one protocol
WITHIN = 0.1  # of the noise: smaller residuals give no doubt, whatever their order
NOISE_ONLY = "the intervals contain noise only"
FIRST_ORDER = 0.5  # relative change of a modulus up to which the first order tells its size
WIDER = 1.5  # factor of the intervals by correlated noise that is worth a word


@dataclass(frozen=True)
class ResidualShape:
    """A shape in the residual."""

    name: str
    ratio: float  # its size over the largest one that noise has
    changes: FloatArray  # of the parameters u of the fit, if the model could make it
    # Measured less predicted values that the shape, with these changes, would explain; of each curve at all
    # its rows.
    rows: list[FloatArray]


def found_shapes(
    problem: LeastSquares, u: FloatArray, residuals: FloatArray, jacobian: FloatArray
) -> list[ResidualShape]:
    """Return the shapes in the residual that are larger than noise makes them, the largest first."""
    if problem.is_exact or np.mean(residuals[: problem.rows] ** 2) < WITHIN**2:
        return []
    found = (shape for shape in shapes(problem, u, residuals, jacobian) if shape.ratio > 1)
    return sorted(found, key=lambda shape: -shape.ratio)


def doubts(
    problem: LeastSquares,
    u: FloatArray,
    residuals: FloatArray,
    found: Sequence[ResidualShape],
    widened: float,
) -> Iterator[str]:
    """Yield a sentence for each sign that the residuals at u are not noise, or correlated noise.

    `residuals` as of the problem; `found`: see `found_shapes`; `widened`: factor of the intervals by
    correlated noise.
    """
    if problem.is_exact or np.mean(residuals[: problem.rows] ** 2) < WITHIN**2:
        return
    apart = [pair for pair in map(_beside_baseline, _used(problem, residuals)) if pair is not None]
    worst = max((ratio for ratio, chance in apart if chance < CHANCE / len(apart)), default=0.0)
    if found:
        yield _sentence(problem, u, found)
    if worst:
        yield (
            f"slow residuals in contact are {worst:.2g} times those before contact: the model does not make "
            f"them, and {NOISE_ONLY}"
        )
    shared = _shared(problem, residuals)
    if shared < CHANCE:
        yield (
            f"the residuals of the {len(problem.predictions)} curves have a shape in common (probability by "
            f"chance {shared:.2g}): the model does not make it, and {NOISE_ONLY}"
        )
    if widened > WIDER and not (found or worst):
        noise = "as before contact" if apart else "with those of their neighbours"
        yield f"residuals are correlated {noise}: the intervals are {widened:.2g} times those of white noise"


def shapes(
    problem: LeastSquares, u: FloatArray, residuals: FloatArray, jacobian: FloatArray
) -> Iterator[ResidualShape]:
    """Yield the shapes that the model cannot make, with their sizes in the residual."""
    columns, derivatives = _columns(problem, u), problem.derivatives(u)
    blocks = [rows for each in problem.predictions for rows in each.blocks]
    m, lengths = u.size, np.linalg.norm(jacobian, axis=0)  # in SI some are 1e9 times others
    lengths[lengths == 0.0] = 1.0
    for name, rows in columns.items():
        further = np.zeros(residuals.size - problem.rows)
        z = np.concatenate([*(problem.scaled(i, column) for i, column in enumerate(rows)), further])
        size = float(np.linalg.norm(z))
        if not size > 0:
            continue
        whole = np.column_stack((jacobian / lengths, z / size))
        own = np.zeros((1, m + 1))
        own[0, m] = 1.0
        level = 1 - CHANCE / len(columns)
        made = mixture(-residuals, whole, blocks, level=level, along=own, generalised=True)
        sizes = np.linalg.lstsq(whole, -residuals, rcond=None)[0]
        changes, own_size = (sizes[:-1] / lengths).tolist(), float(sizes[-1])
        explained = [
            column * (own_size / size)
            + sum(change * of_u[i] for change, of_u in zip(changes, derivatives, strict=True))
            for i, column in enumerate(rows)
        ]
        ratio = float(abs(made.centers[0]) / made.half[0])
        yield ResidualShape(name, ratio, np.array(changes), explained)


def _columns(problem: LeastSquares, u: FloatArray) -> dict[str, list[FloatArray]]:
    """Return the shapes in the measured quantity of each curve, at its rows, by their names."""
    free = {each.key for each in problem.parameters}
    times = [value for key, value in problem.model.keys.items() if key.rpartition(".")[2] == "tau"] + [
        value for key, value in problem.values(u).items() if key.rpartition(".")[2] == "tau"
    ]
    found: dict[str, list[FloatArray]] = {}
    for prediction in problem.predictions:
        for name, column in _of_curve(problem, u, prediction, times).items():
            found.setdefault(name, []).append(column)
    if problem.model.adhesion is not None:
        found.pop("adhesion", None)
    if "tilt" in free:
        found.pop("a tilted baseline", None)
    return {name: rows for name, rows in found.items() if len(rows) == len(problem.predictions)}


def _of_curve(
    problem: LeastSquares, u: FloatArray, prediction: Prediction, times: Sequence[float]
) -> Mapping[str, FloatArray]:
    """Return the shapes of one curve."""
    config, at = problem.at(u, prediction)
    curve, power = prediction.curve, prediction.setup(config).onset
    force, depth = prediction.response(config, at)
    deepest = float(np.max(depth))
    if not deepest > 0:
        return {}
    x = np.maximum(depth, 0.0) / deepest
    touching = x > 0
    logarithm = np.log(np.where(touching, x, 1.0))
    position = curve.position_of_drive
    found = {
        "another exponent of the indenter": force * logarithm,
        "a finite or another thickness": force * np.sqrt(x),
        "adhesion": np.where(touching, x ** (power / 2), 0.0),
        "a tilted baseline": position - position[0],
    }
    spacing, duration = float(np.median(np.diff(curve.time))), float(np.ptp(curve.time))
    known = times if not problem.is_elastic else [duration]
    fast, slow = min(known) / APART, max(known) * APART
    if fast > RESOLVED * spacing:
        found["a faster relaxation"] = _relaxing(curve.time, x**power, fast)
    if slow < LONG * duration and not problem.is_elastic:
        found["a slower relaxation"] = _relaxing(curve.time, x**power, slow)
    # Of the depth where the force is prescribed, and of a force that bends the cantilever.
    slope = power * np.maximum(force, 1e-3 * float(np.max(force))) / np.maximum(depth, 1e-3 * deepest)
    softer = 1 / (1 + slope / at.stiffness) if curve.by_base else 1.0
    return {
        name: np.where(curve.by_force, -column / slope, column * (1.0 if "tilt" in name else softer))
        for name, column in found.items()
    }


def _relaxing(time: FloatArray, shape: FloatArray, tau: float) -> FloatArray:
    """Return the force of a branch of unit modulus."""
    force = np.zeros(time.size)
    steps = np.diff(time) / tau
    for i, (step, change) in enumerate(zip(steps.tolist(), np.diff(shape).tolist(), strict=True)):
        force[i + 1] = force[i] * math.exp(-step) - change * math.expm1(-step) / step
    return force


def _used(problem: LeastSquares, residuals: FloatArray) -> Iterator[tuple[Prediction, FloatArray]]:
    """Yield each curve with its residuals."""
    begin = 0
    for prediction in problem.predictions:
        rows = int(prediction.used.sum())
        yield prediction, residuals[begin : begin + rows]
        begin += rows


def _beside_baseline(pair: tuple[Prediction, FloatArray]) -> tuple[float, float] | None:
    """Return the slow power in contact over that before contact, and its probability by chance.

    Contact is cut into parts as long as the rows before it. None without enough rows.
    """
    prediction, residuals = pair
    curve = prediction.curve
    begin = curve.indentation[0]
    touches = np.flatnonzero(curve.position_of_drive[prediction.used] > begin)
    before = int(touches[0]) if touches.size else 0
    if before < 4 * SLOW:
        return None
    ends = range(before, residuals.size + 1, before)
    parts = [dct(residuals[end - before : end], norm="ortho") for end in ends]
    if len(parts) < 2:
        return None
    slow = np.array([np.mean(z[1 : SLOW + 1] ** 2) for z in parts])
    fast = np.array([np.median(z[before // 2 :] ** 2) for z in parts])
    ratio = float(slow[1:].mean() / fast[1:].mean() / (slow[0] / fast[0]))
    return ratio, float(f_ratio.sf(ratio, max((len(parts) - 1) * SLOW - 3, 1), SLOW))


def _shared(problem: LeastSquares, residuals: FloatArray) -> float:
    """Return the probability by chance of what the residuals of curves of one protocol share; 1 for few."""
    curves = [pair for pair in _used(problem, residuals) if pair[1].size > SHARED]
    sizes = np.array([rows.size for _, rows in curves])
    spans = np.array([np.ptp(each.curve.time) for each, _ in curves])
    if len(curves) < FEWEST_CURVES or np.ptp(sizes) > 0.1 * sizes.max() or np.ptp(spans) > 0.1 * spans.max():
        return 1.0
    z = np.array([dct(rows, norm="ortho")[1 : SHARED + 1] for _, rows in curves])
    z /= np.sqrt(np.maximum(np.mean(z**2, axis=1, keepdims=True), 1e-300))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (FLIPS, len(z)))
    larger = np.sum((signs @ z) ** 2, axis=1) >= np.sum(z.sum(axis=0) ** 2)
    return float((1 + larger.sum()) / (FLIPS + 1))


def _sentence(problem: LeastSquares, u: FloatArray, found: Sequence[ResidualShape]) -> str:
    """Say which shapes would explain the residual, and how the first modulus would change."""
    names = [shape.name for shape in found]
    listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"
    moduli = [i for i, each in enumerate(problem.parameters) if each.key.rpartition(".")[2] in MODULI]
    size = f"{found[0].ratio:.2g} times its limit"
    sentence = f"the residual has a shape beyond noise ({size}); {listed} would make it"
    if moduli:
        name, value = problem.parameters[moduli[0]].name, problem.values(u)
        changed = [problem.values(np.clip(u + shape.changes, *problem.bounds))[name] for shape in found]
        percents = [_percent(each / value[name] - 1) for each in changed]
        many = percents[0] if len(percents) == 1 else f"{', '.join(percents[:-1])} or {percents[-1]}"
        sentence += f", and {name} would change by {many} %"
    return f"{sentence}. {NOISE_ONLY.capitalize()}"


def _percent(change: float) -> str:
    """Write a relative change, which is known to first order only."""
    if abs(change) > FIRST_ORDER:
        return f"more than {math.copysign(100 * FIRST_ORDER, change):+.0f}"
    return f"{100 * change:+.2g}"
