"""The start of a fit: model, free parameters, problem, and the first guess of moduli and times."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import ConfigError, text
from gfmdlayer.fitting.indentation.curve import DEPTH, ForceCurve
from gfmdlayer.fitting.indentation.estimates import FitOptions, detect
from gfmdlayer.fitting.indentation.problem import (
    MODULI,
    SECTIONS,
    Free,
    LeastSquares,
    Model,
    Parameter,
    Prediction,
    baseline,
    free_parameters,
    onset,
)
from gfmdlayer.indentation.indent import as_revolution
from gfmdlayer.validation.problems import location_of_key, shown, unknown_key

TIMES = (0.0, 0.01, 0.1, 1.0)  # trials of the shortest relaxation time, over the duration; 0: the model's
STRETCH = 10.0  # default bounds of a cantilever's stiffness: over and times this factor


def read_model(model: Mapping[str, Any] | str | Path, free: Free | None) -> tuple[dict[str, Any], Free]:
    """Return body and indenter as plain data, and the keys of the free parameters."""
    if isinstance(model, Mapping):
        data = dict(model)
    else:
        try:
            document = text.read(Path(model).read_bytes(), str(model))
        except OSError as error:
            raise ConfigError([f"{model}: cannot be read ({error.strerror}); must be a YAML file"]) from None
        if document.problems or not isinstance(document.data, dict):
            found = [f"{place}: {message}" for place, message in document.problems]
            raise ConfigError(found or [f"{model}: must have the keys layer, halfspace and punch"])
        data = document.data
        try:
            Model({key: value for key, value in data.items() if key != "free"})
        except ConfigError as error:
            raise ConfigError(f"{_place(document, each)}: {each}" for each in error.problems) from None
    own = data.pop("free", None)
    keys = own if free is None else free
    if wrong := list(_wrong_keys(keys)):
        allowed = (*SECTIONS, "free")
        foreign = [f"{key}: {unknown_key(key, allowed, ())}" for key in data if key not in allowed]
        raise ConfigError(foreign + wrong)
    return data, keys


def _place(document: text.Document, problem: str) -> text.Place:
    """Return the place in the file of the key that begins a message, such as layers[0].thickness."""
    key = re.sub(r"\[(\d+)\]", r".\1", problem.partition(":")[0])
    return document.place(location_of_key(key))


def _wrong_keys(keys: Any) -> Iterator[str]:
    """Yield errors in the form of the free parameters and their bounds."""
    if not isinstance(keys, (list, tuple, Mapping)) or not keys:
        yield "free: name at least one parameter, such as layer.material.G0, in the model or with --free"
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
    curves: Sequence[ForceCurve], model: Model, parameters: Sequence[Parameter], options: FitOptions
) -> LeastSquares:
    """Return the least-squares problem of curves, at the model's values."""
    offsets = {each.curve: each.start for each in parameters if each.key == "force_offset"}
    return LeastSquares(
        model,
        parameters,
        [
            Prediction(curve, options.segments, offsets.get(curve.name, offsets.get("", 0.0)))
            for curve in curves
        ],
    )


def curve_parameters(
    curves: Sequence[ForceCurve], model: Model, free: Free, options: FitOptions
) -> list[Parameter]:
    """Return the free parameters of a fit, with the starts and the default bounds that follow from curves."""
    depth = max(float(np.ptp(curve.depth)) for curve in curves)
    force = max(float(np.ptp(curve.force)) for curve in curves)
    duration = min(float(np.ptp(curve.time)) for curve in curves)
    spans = {
        "contact_point": (-depth, depth),
        "drift": (-depth / duration, depth / duration),
        "force_offset": (-force, force),
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
        added = [each for each in added if each.curve in {"", *uncertain}]
    else:
        added = []
    found = free_parameters(model, asked, [curve.name for curve in curves], spans) + added
    starts = {curve.name if len(curves) > 1 else "": curve for curve in curves}
    found = [
        replace(each, start=starts[each.curve].stiffness or 1.0) if each.key == "stiffness" else each
        for each in found
    ]
    if options.contact == "given":
        return found
    points = {name: detect(curve) for name, curve in starts.items()}
    return [_from_detection(each, points[each.curve]) if each.key in spans else each for each in found]


def _from_detection(parameter: Parameter, point: Any) -> Parameter:
    start = {"contact_point": point.depth, "force_offset": point.offset}.get(parameter.key, parameter.start)
    low, high = parameter.bounds
    if parameter.key in {"contact_point", "force_offset"}:
        low, high = min(low, 2 * start), max(high, 2 * start)
    return replace(parameter, start=start, bounds=(low, high))


def first_guess(problem: LeastSquares) -> tuple[FloatArray, float]:
    """Return the start of the fit, and the factor by which the moduli of the model were multiplied.

    The force is nearly of first degree in the moduli: one factor fits all of them to the measured force.
    """
    times = [i for i, each in enumerate(problem.parameters) if each.key.rpartition(".")[2] == "tau"]
    duration = max(float(np.ptp(each.curve.time)) for each in problem.predictions)
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


def _scaled(problem: LeastSquares, u: FloatArray) -> tuple[FloatArray, float, float]:
    """Return u with the best common factor on the moduli, the sum of squares, and the factor.

    The force at the measured depth is the predicted one, multiplied by a power of the ratio of the depths.
    """
    moduli = [i for i, each in enumerate(problem.parameters) if each.key.rpartition(".")[2] in MODULI]
    predicted, measured = [], []
    for each in problem.predictions:
        config, at = problem.config(u, each.curve.name), problem.correction(u, each.curve)
        force, depth = each.response(config, at)
        problem.solutions += 1
        since = each.curve.time - each.curve.time[0]
        own = each.curve.depth - at.contact_point - at.drift * since
        if each.kinds != {DEPTH}:
            touching = depth > 0.05 * float(np.max(depth))
            ratio = np.maximum(own[touching], 0.0) / depth[touching]
            force = np.where(depth > 0, force, 0.0)
            force[touching] *= ratio ** onset(as_revolution(config.punch))
        predicted.append(force[each.used])
        measured.append((each.curve.force - baseline(each.curve, at))[each.used])
    x, y = np.concatenate(predicted), np.concatenate(measured)
    along = float(x @ y) / max(float(x @ x), 1e-300)
    factor = along if along > 0 else 1.0
    shifted = u.copy()
    if moduli:
        shifted[moduli] = np.clip(u + math.log(factor), *problem.bounds)[moduli]
    return shifted, float(np.sum((factor * x - y) ** 2)), factor
