"""The start of a fit: model, free parameters, problem, and the first guess of moduli and times."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import ConfigError
from gfmdlayer.config.bodies import in_keys
from gfmdlayer.fitting.elastic import KINDS, NO_ADHESION, work_for
from gfmdlayer.fitting.estimates import CANDIDATES, PART, ContactPoint, contact_point, detect
from gfmdlayer.fitting.force_curve import DEPTH, CurveError, ForceCurve, baseline, noise_of
from gfmdlayer.fitting.prediction import Prediction
from gfmdlayer.fitting.problem import (
    MODULI,
    SECTIONS,
    STICKING,
    WIDE,
    Free,
    FreeParameter,
    IndentationModel,
    LeastSquares,
    free_parameters,
)
from gfmdlayer.fitting.result import FitOptions
from gfmdlayer.indentation.equilibrium import EdgeAdhesion
from gfmdlayer.indentation.indent import as_revolution
from gfmdlayer.punch.revolution import abel_transform
from gfmdlayer.validation import text
from gfmdlayer.validation.problems import location_of_key, shown, unknown_key
from gfmdlayer.validation.sections import plain

TIMES = (0.0, 0.01, 0.1, 1.0)  # trials of the shortest relaxation time, over the duration; 0: the model's
RANGE, TRIALS = 6.0, 9  # factors on the moduli that are tried with adhesion
FEWEST_BEFORE, SEEN = 5, 5.0  # rows before contact; noises by which the force falls where contact begins
STRETCH = 10.0  # default bounds of a cantilever's stiffness: over and times this factor


def read_model(model: Mapping[str, Any] | str | Path, free: Free | None) -> tuple[dict[str, Any], Free]:
    """Return body and indenter as plain data, and the keys of the free parameters."""
    if isinstance(model, Mapping):
        data = plain(in_keys(model))
    elif not isinstance(model, str | os.PathLike):
        example = "{'body': halfspace(1.0), 'punch': Sphere(radius=1.0)}"
        allowed = f"must be a mapping of a body and a punch, such as {example}, or a YAML file"
        raise ConfigError([f"model: got {shown(model)}; {allowed}"])
    else:
        try:
            document = text.read(Path(model).read_bytes(), str(model))
        except OSError as error:
            raise ConfigError([f"{model}: cannot be read ({error.strerror}); must be a YAML file"]) from None
        if document.problems or not isinstance(document.data, dict):
            problems = [f"{place}: {message}" for place, message in document.problems]
            raise ConfigError(problems or [f"{model}: must have the keys layer, halfspace and punch"])
        data = document.data
        try:
            IndentationModel({key: value for key, value in data.items() if key != "free"})
        except ConfigError as error:
            raise ConfigError(
                f"{_place(document, problem)}: {problem}" for problem in error.problems
            ) from None
    own = data.pop("free", None)
    keys = own if free is None else free
    keys = (keys,) if isinstance(keys, str) else keys
    if wrong := list(_wrong_keys(keys)):
        allowed = (*SECTIONS, "free")
        foreign = [f"{key}: {unknown_key(key, allowed, ())}" for key in data if key not in allowed]
        raise ConfigError(foreign + wrong)
    return data, keys


def _place(document: text.Document, problem: str) -> text.Place:
    """Return the place in the file of the key at the beginning of a message."""
    key = re.sub(r"\[(\d+)\]", r".\1", problem.partition(":")[0])
    return document.place(location_of_key(key))


def _wrong_keys(keys: Any) -> Iterator[str]:
    """Yield errors in the form of the free parameters and their bounds."""
    if not isinstance(keys, (list, tuple, Mapping)) or not keys:
        wanted = "name at least one parameter, such as layer.material.G0, in the model or with --free"
        yield f"free: got {shown(keys)}; {wanted}" if keys else f"free: {wanted}"
        return
    for key in keys:
        if not isinstance(key, str):
            yield f"free: got {shown(key)}; must be a dotted key, such as layer.material.G0"
    for key, bounds in keys.items() if isinstance(keys, Mapping) else ():
        ends = () if isinstance(bounds, str) else np.atleast_1d(np.asarray(bounds, dtype=object))
        if bounds is not None and not (len(ends) == 2 and all(map(_finite, ends))):
            yield f"free: {key}: got {shown(bounds)}; give two finite numbers, [low, high], or no value"


def _finite(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def make_problem(
    curves: Sequence[ForceCurve],
    model: IndentationModel,
    parameters: Sequence[FreeParameter],
    options: FitOptions,
) -> LeastSquares:
    """Return the least-squares problem of curves, at the model's values."""
    offsets = {
        parameter.curve: parameter.start for parameter in parameters if parameter.key == "force_offset"
    }
    return LeastSquares(
        model,
        parameters,
        [
            Prediction(
                curve,
                options.segments,
                offsets.get(curve.name, offsets.get("", 0.0)),
                adhesive=model.adhesion is not None,
            )
            for curve in curves
        ],
    )


def curve_parameters(
    curves: Sequence[ForceCurve], model: IndentationModel, free: Free, options: FitOptions
) -> list[FreeParameter]:
    """Return the free parameters of a fit, with the starts and the default bounds that follow from curves."""
    if options.contact == "given" and "force_offset" not in free:
        for curve in curves:
            if curve.force.max() <= 0:
                reason = "no force is positive; forces are positive where the indenter presses"
                hint = "Is the baseline below zero? Detect the contact"
                raise CurveError(f"curve {curve.name}: {reason}. {hint}")
    depth = max(float(np.ptp(curve.depth)) for curve in curves)
    force = max(float(np.ptp(curve.force)) for curve in curves)
    lowest = min(float(curve.force.min()) for curve in curves)
    highest = max(float(curve.force.max()) for curve in curves)
    duration = min(float(np.ptp(curve.time)) for curve in curves)
    spans = {
        "contact_point": (-depth, depth),
        "drift": (-depth / duration, depth / duration),
        "force_offset": (min(-force, lowest), max(force, highest)),
        "force_drift": (-force / duration, force / duration),
        "tilt": (-force / depth, force / depth),
    }
    springs = {curve.name: curve.stiffness for curve in curves if curve.by_base and curve.stiffness}
    if len(springs) == len(curves):
        spans["stiffness"] = (min(springs.values()) / STRETCH, max(springs.values()) * STRETCH)
    asked = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    uncertain = [curve.name for curve in curves if curve.by_base and curve.stiffness_error]
    if options.contact == "detect":
        asked |= {key: asked.get(key) for key in ("contact_point", "force_offset")}
    if uncertain and "stiffness" not in asked:
        spans["stiffness"] = (min(springs.values()) / STRETCH, max(springs.values()) * STRETCH)
        added = free_parameters(model, {"stiffness": None}, [curve.name for curve in curves], spans)
        added = [parameter for parameter in added if parameter.curve in {"", *uncertain}]
    else:
        added = []
    parameters = free_parameters(model, asked, [curve.name for curve in curves], spans) + added
    starts = {curve.name if len(curves) > 1 else "": curve for curve in curves}
    parameters = [
        replace(parameter, start=starts[parameter.curve].stiffness or 1.0)
        if parameter.key == "stiffness"
        else parameter
        for parameter in parameters
    ]
    if options.contact != "detect" and "contact_point" not in asked:
        return parameters
    if options.contact == "given":
        return parameters
    sticks = model.adhesion is not None or options.adhesion is not None
    points = {
        name: _touch(curve) if sticks else contact_point(curve, options.contact)
        for name, curve in starts.items()
    }
    if "tilt" in asked:  # the offset is that of the first row
        first = {name: float(curve.position_of_drive[0]) for name, curve in starts.items()}
        points = {
            name: point._replace(offset=point.offset - point.slope * (point.depth - first[name]))
            for name, point in points.items()
        }
    return [
        _from_detection(parameter, points[parameter.curve]) if parameter.key in spans else parameter
        for parameter in parameters
    ]


def _touch(curve: ForceCurve) -> ContactPoint:
    """Find the contact point of a curve that may stick: where the force falls below its noise, if it does."""
    end = int(np.argmax(curve.force)) + 1
    force, noise = curve.force[:end], noise_of(curve.force)
    lowest = int(np.argmin(force))
    before = force[: max(lowest - FEWEST_BEFORE, 1)]
    if lowest <= FEWEST_BEFORE or float(np.median(before)) - force[lowest] < SEEN * noise:
        return _change(curve) if curve.by_base else detect(curve)
    offset = float(np.median(before))
    row = int(np.argmax(force < (offset + force[lowest]) / 2))
    return ContactPoint(float(curve.position_of_drive[row]), noise, offset)


def _change(curve: ForceCurve) -> ContactPoint:
    """Find where an approach leaves its baseline: the force is constant before, and a parabola after it.

    The depth of a soft cantilever, which dives in, has the noise of the force and goes back and forth.
    """
    end = int(np.argmax(curve.force)) + 1
    end = int(np.argmax(curve.force[:end] > PART * curve.force[end - 1])) + 1
    position, force = curve.position_of_drive[:end], curve.force[:end]
    last = end - FEWEST_BEFORE
    if last <= FEWEST_BEFORE:
        return detect(curve)  # which names the missing rows
    squares = {}
    for row in np.unique(np.linspace(FEWEST_BEFORE, last, CANDIDATES).astype(int)).tolist():
        powers = np.vander(position[row:] - position[row], 3)
        rest = force[row:] - powers @ np.linalg.lstsq(powers, force[row:], rcond=None)[0]
        squares[row] = force[:row].var() * row + float(rest @ rest)
    row = min(squares, key=lambda split: squares[split])
    offset = float(np.mean(force[:row]))
    return ContactPoint(float(position[row]), abs(float(position[row] - position[row - 1])), offset)


def _from_detection(parameter: FreeParameter, point: Any) -> FreeParameter:
    found = {"contact_point": point.depth, "force_offset": point.offset, "tilt": point.slope}
    start = found.get(parameter.key, parameter.start)
    low, high = parameter.bounds
    if parameter.key in found:
        low, high = min(low, 2 * start), max(high, 2 * start)
    return replace(parameter, start=start, bounds=(low, high))


def first_guess(problem: LeastSquares) -> tuple[FloatArray, float]:
    """Return the start of the fit, and the factor by which the moduli of the model were multiplied.

    The force is nearly of first degree in the moduli: one factor fits all of them to the measured force.
    """
    if problem.model.adhesion is not None:
        return _sticking_guess(problem)
    times = [i for i, parameter in enumerate(problem.parameters) if parameter.key.rpartition(".")[2] == "tau"]
    duration = max(float(np.ptp(prediction.curve.time)) for prediction in problem.predictions)
    shifts = [0.0]
    if times:
        first = min(problem.start[i] for i in times)
        shifts += [math.log(part * duration) - first for part in TIMES if part]
    trials = []
    for shift in shifts:
        u = problem.start.copy()
        u[times] += shift
        trials.append(_scaled(problem, np.clip(u, *problem.bounds)))
    least = min(range(len(trials)), key=lambda k: trials[k][1] * (1 if k else 0.5))
    return trials[least][0], trials[0][2]


def _sticking_guess(problem: LeastSquares) -> tuple[FloatArray, float]:
    """Return the start of a fit with adhesion, and the factor on the moduli.

    For each of several factors the adhesion follows from the largest pull of the curves.
    """
    moduli = [
        i for i, parameter in enumerate(problem.parameters) if parameter.key.rpartition(".")[2] in MODULI
    ]
    sticky = [i for i, parameter in enumerate(problem.parameters) if parameter.key.startswith(STICKING)]
    trials, middle = [], _scaled(problem, problem.start)[2]
    low, high = problem.bounds
    for factor in middle * np.geomspace(1 / RANGE, RANGE, TRIALS) if moduli else [1.0]:
        u = problem.start.copy()
        u[moduli] = np.clip(u + math.log(factor), low, high - 1e-12)[moduli]  # a glassy modulus is above G0
        if sticky:
            u[sticky] = np.clip(math.log(_sticking(problem, u)), *np.array(problem.bounds)[:, sticky])
        trials.append((float(np.sum(problem.residuals(u) ** 2)), factor, u))
    _, factor, u = min(trials, key=lambda trial: trial[0])
    return u, float(factor if moduli else middle)


def _sticking(problem: LeastSquares, u: FloatArray) -> float:
    """Return the work, or the force, of adhesion that has the largest pull of the curves."""
    (kind,) = (str(value) for key, value in (problem.model.adhesion or {}).items() if key == "model")
    sizes = []
    for prediction in problem.predictions:
        config, at = problem.at(u, prediction)
        force = prediction.curve.force - baseline(prediction.curve, at)
        pull = max(-float(np.min(force[prediction.used])), 3 * noise_of(prediction.curve.force))
        pull = max(pull, 1e-4 * float(np.max(force)))
        if kind == "jkr":
            bare = prediction.contacts(config, at._replace(adhesion=EdgeAdhesion()))
            pull = work_for(pull, bare.equilibria)
        sizes.append(pull)
    return float(np.median(sizes))


def _scaled(problem: LeastSquares, u: FloatArray) -> tuple[FloatArray, float, float]:
    """Return u with the best common factor on the moduli, the sum of squares, and the factor.

    The force at the measured depth is the predicted one, multiplied by a power of the ratio of the depths.
    """
    moduli = [
        i for i, parameter in enumerate(problem.parameters) if parameter.key.rpartition(".")[2] in MODULI
    ]
    predicted, measured = [], []
    for prediction in problem.predictions:
        config, at = problem.at(u, prediction)
        force, depth = prediction.response(config, at._replace(adhesion=EdgeAdhesion()))
        problem.solutions += 1
        since = prediction.curve.time - prediction.curve.time[0]
        own = prediction.curve.depth - at.contact_point - at.drift * since
        if prediction.kinds != {DEPTH}:
            touching = depth > 0.05 * float(np.max(depth))
            ratio = np.maximum(own[touching], 0.0) / depth[touching]
            force = np.where(depth > 0, force, 0.0)
            force[touching] *= ratio ** prediction.setup(config).onset
        predicted.append(force[prediction.used])
        measured.append((prediction.curve.force - baseline(prediction.curve, at))[prediction.used])
    x, y = np.concatenate(predicted), np.concatenate(measured)
    along = float(x @ y) / max(float(x @ x), 1e-300)
    factor = along if along > 0 else 1.0
    shifted = u.copy()
    if moduli:
        shifted[moduli] = np.clip(u + math.log(factor), *problem.bounds)[moduli]
    return shifted, float(np.sum((factor * x - y) ** 2)), factor


def with_adhesion(
    model: IndentationModel, free: Free, kind: str, curves: Sequence[ForceCurve]
) -> tuple[IndentationModel, Free]:
    """Return a model with adhesion of a kind whose work or force is free, or without adhesion."""
    asked = keys_with_adhesion(model, free, kind)
    if kind == NO_ADHESION:
        return model.sticking(None), asked
    name = KINDS[kind]
    key = f"{STICKING}{name}"
    if model.adhesion is not None and model.adhesion["model"] == kind:
        return model, asked
    start, bounds = _size(model, kind, curves), asked[key]
    if bounds is None:
        asked[key] = [start / WIDE**2, start * WIDE]
    elif 0 < bounds[0] < bounds[1] and not bounds[0] <= start <= bounds[1]:
        start = math.sqrt(bounds[0] * bounds[1])
    return model.sticking({"model": kind, name: start}), asked


def keys_with_adhesion(model: IndentationModel, free: Free, kind: str) -> dict[str, Sequence[float] | None]:
    """Return the free parameters with one kind of adhesion in place of the model's."""
    asked = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    own = "" if kind == NO_ADHESION else f"{STICKING}{KINDS[kind]}"
    others = {
        key: bounds
        for key, bounds in asked.items()
        if key != own and not (key.startswith(STICKING) and key in model.keys)
    }
    return others | ({own: asked.get(own)} if own else {})


def _size(model: IndentationModel, kind: str, curves: Sequence[ForceCurve]) -> float:
    """Return the size that adhesion may have: the largest force, or its energy over the area of contact."""
    force = max(float(np.ptp(curve.force)) for curve in curves)
    if kind == "dmt":
        return force
    depth = max(float(np.ptp(curve.depth)) for curve in curves)
    profile = as_revolution(model.config.punch)
    radius = depth
    while radius < profile.rim and abel_transform(profile, radius) < depth:
        radius *= 2
    return force * depth / min(radius, profile.rim) ** 2
