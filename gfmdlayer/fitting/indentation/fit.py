"""Fit of a body under an indenter to measured force curves.

The free parameters minimise the sum of squares of predicted minus measured force over the noise
(`problem.LeastSquares`, the trust-region reflective method of scipy). The fit starts with all free moduli
multiplied by the factor that fits the forces best, and with the best of several relaxation times.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import ConfigError, text
from gfmdlayer.fitting.indentation.curve import DEPTH, WORDS, ForceCurve, Sizes, in_si
from gfmdlayer.fitting.indentation.curve_files import Units, afm_curve, curve_facts, entries, read_curve
from gfmdlayer.fitting.indentation.estimates import FitOptions, IndentationFit, conclude, detect, minimised
from gfmdlayer.fitting.indentation.problem import (
    MODULI,
    SECTIONS,
    Free,
    LeastSquares,
    Model,
    Parameter,
    Prediction,
    baseline,
    depths,
    free_parameters,
    onset,
    refuse_impossible,
    refuse_mixed_units,
    warnings_before,
)
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.indentation.indent import as_revolution
from gfmdlayer.validation.problems import shown, unknown_key

Given = ForceCurve | str | Path | Mapping[str, Any]
TIMES = (0.0, 0.01, 0.1, 1.0)  # trials of the shortest relaxation time, over the duration; 0: the model's
ROUGH, FINE = 1e-2, 1e-5  # precision of the first fit, and of the fits after the times are chosen again
ROUNDS = 4
STRETCH = 10.0  # default bounds of a cantilever's stiffness: over and times this factor
STAYS = 0.2  # change of a logarithm below which the times of the solution stay


def fit_indentation(
    curves: Given | Iterable[Given],
    model: Mapping[str, Any] | str | Path,
    free: Free | None = None,
    *,
    units: Units | None = None,
    loss: str = "linear",
    profile: bool = False,
    contact: str = "given",
    segments: Sequence[str] = (),
    prescribed: str | None = None,
    stiffness: float | None = None,
    stiffness_error: float | None = None,
) -> IndentationFit:
    """Fit moduli, times, thicknesses and more to measured force curves.

    Parameters
    ----------
    curves : ForceCurve, path, mapping or Dataset, or an iterable of these
        Measured curves: files or folders (see `curve_files`), columns time, depth and force, or curves of
        afmformats and nanite. All curves share the parameters of the model; each has its own contact point,
        drift, stiffness and baseline of the force.
    model : mapping, str or Path
        Body and indenter with the keys of a configuration (layer or layers, halfspace, punch), or a YAML
        file with them. The fit starts from these values. A key `free` names the free parameters.
    free : sequence of str, or mapping
        Dotted keys of the model, and contact_point, drift, force_offset, force_drift, tilt, stiffness; a
        mapping gives bounds as [low, high], or None.
    units : sequence of str, optional
        Units of time, depth and force for columns without units, such as ("s", "nm", "nN").
    loss, profile, contact, segments, prescribed, stiffness, stiffness_error
        See `FitOptions`.

    Returns
    -------
    IndentationFit

    Raises
    ------
    ConfigError
        The model or a key is not possible.
    CurveError
        A curve cannot be used.
    FitError
        The fit is not possible.

    Examples
    --------
    Hertz's force on a halfspace of G = 7, nu = 1/2 under a paraboloid of radius 5:

    >>> import numpy as np
    >>> from gfmdlayer import ForceCurve, fit_indentation
    >>> depth = np.linspace(0.0, 0.1, 50)
    >>> force = 8 / 3 * 7.0 * 5.0**0.5 * depth**1.5 / (1 - 0.5)
    >>> material = {"model": "zener", "G0": 1.0, "Ginf": 1.0}
    >>> model = {
    ...     "layer": {"thickness": float("inf"), "material": material},
    ...     "punch": {"shape": "parabola", "radius": 5.0},
    ... }
    >>> fit = fit_indentation(ForceCurve("ramp", depth, depth, force), model, ["layer.material.G0"])
    >>> print(f"{fit['G0'].value:.2f}")
    7.00
    """
    options = FitOptions(loss, profile, contact, tuple(segments), prescribed, stiffness, stiffness_error)
    single = isinstance(curves, (ForceCurve, str, Path)) or hasattr(curves, "keys")
    every: Iterable[Any] = [curves] if single else curves  # type: ignore[assignment]
    data, keys = read_model(model, free)
    made = Model(data)
    given = list(_curves(every, units, in_si(made.config.units), options))
    if not given:
        raise FitError("got no curve; give at least one")
    return fit_curves(given, made, keys, options)


def _curves(
    given: Iterable[Any], units: Units | None, into: Sizes, options: FitOptions
) -> Iterator[ForceCurve]:
    """Yield the curves, given in any form that `fit_indentation` takes."""
    for number, each in enumerate(given):
        if isinstance(each, ForceCurve):
            yield each
        elif isinstance(each, (str, Path)):
            yield from (read_curve(entry, units, into, options) for entry in entries([Path(each)]))
        elif hasattr(each, "metadata") and hasattr(each, "columns"):  # of afmformats and nanite
            yield afm_curve(each, f"{Path(each.path).stem}-{each.enum}", into, options)
        elif all(key in each for key in ("time", "depth", "force")):
            time, depth, force = (np.asarray(each[key]) for key in ("time", "depth", "force"))
            words = {key: list(map(str, np.asarray(each[key]))) for key in WORDS if key in each}
            facts = curve_facts(words, options.stiffness, options)
            yield ForceCurve(str(number), time, depth, force, **facts)
        else:
            raise FitError(f"curve {number}: must have the columns time, depth and force")


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
    own = data.pop("free", None)
    keys = own if free is None else free
    if wrong := list(_wrong_keys(keys)):
        allowed = (*SECTIONS, "free")
        foreign = [f"{key}: {unknown_key(key, allowed, ())}" for key in data if key not in allowed]
        raise ConfigError(foreign + wrong)
    return data, keys


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


def fit_curves(curves: Sequence[ForceCurve], model: Model, free: Free, options: FitOptions) -> IndentationFit:
    """Fit a checked model to curves, see `fit_indentation`."""
    names = [curve.name for curve in curves]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise FitError(f"curve {', '.join(twice)}: this name is given twice; give each curve its own name")
    parameters = _parameters(curves, model, free, options)
    reached = depths(curves, parameters)
    refuse_impossible(reached, model)
    rows = sum(curve.time.size for curve in curves)
    if rows < 2 * len(parameters):
        raise FitError(
            f"{rows} rows are too few for {len(parameters)} free parameters; the fit needs at least "
            f"{2 * len(parameters)}"
        )
    problem = make_problem(curves, model, parameters, options)
    u, scale = _first_guess(problem)
    refuse_mixed_units(model, scale)
    notes = list(warnings_before(curves, reached, model, scale))
    start = problem.values(u)
    u = _solve(problem, u, options.loss)
    return conclude(problem, u, options, notes, start)


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


def _parameters(
    curves: Sequence[ForceCurve], model: Model, free: Free, options: FitOptions
) -> list[Parameter]:
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


def _first_guess(problem: LeastSquares) -> tuple[FloatArray, float]:
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


def _solve(problem: LeastSquares, u: FloatArray, loss: str) -> FloatArray:
    """Fit; then choose the times of the solutions and the noise again and refit, until u stays."""
    minimise = partial(minimised, problem.residuals, problem.jacobian, bounds=problem.bounds)
    problem.adapt(u)
    u = minimise(start=u, precision=ROUGH)
    for _ in range(ROUNDS):
        before = u
        problem.adapt(u)
        _estimate_noise(problem, u, loss)
        problem.weigh(u)
        u = minimise(start=u, loss=loss, precision=FINE)
        if np.abs(u - before).max() < STAYS:
            break
    return u


def _estimate_noise(problem: LeastSquares, u: FloatArray, loss: str) -> None:
    """Set the noise of forces and depths from the residuals at u, where it is not given."""
    for i, (found, each) in enumerate(zip(problem.measured(u), problem.predictions, strict=True)):
        for k in np.flatnonzero(~problem.noise_is_given(i)):
            rows = each.used & (each.curve.by_force == bool(k))
            problem.noise[i, k] = _spread((found - each.curve.measured)[rows], loss)


def _spread(residual: FloatArray, loss: str) -> float:
    """Return the standard deviation of a residual, without outliers if the loss is not linear."""
    if loss == "linear":
        found = float(np.sqrt(np.mean(residual**2)))
    else:
        found = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    return max(found, 1e-12 * float(np.abs(residual).max()), 1e-300)
