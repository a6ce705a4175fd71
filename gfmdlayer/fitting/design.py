"""Expected intervals of proposed indentations, and the second curve that would determine a parameter.

A planned curve is computed at the values of the model. With the derivatives J of its rows, over their noise,
the expected covariance of the parameters is (J^T J)^-1, as in `estimates`, for all curves together; each
curve has its own contact point, drift, stiffness and baseline.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gfmdlayer.config import ConfigError
from gfmdlayer.fitting.elastic import adhesion_of
from gfmdlayer.fitting.estimates import conclude
from gfmdlayer.fitting.force_curve import (
    BASE,
    DEPTH,
    FORCE,
    OF_A_CURVE,
    PRESCRIBED,
    Correction,
    ForceCurve,
    column,
)
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.prediction import Prediction
from gfmdlayer.fitting.problem import (
    SECTIONS,
    Free,
    IndentationModel,
    LeastSquares,
    refuse_adhesion,
)
from gfmdlayer.fitting.result import FitOptions, IndentationFit
from gfmdlayer.fitting.starts import curve_parameters, make_problem, read_model
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import unknown_key

KEYS = ("name", "time", *PRESCRIBED, "rows", "noise", "depth_noise", "stiffness", "stiffness_error", "punch")
ROWS = 400
FASTER, WIDER = 10.0, 5.0  # factors of the time and of the radius of proposed second curves
BETTER = 0.5  # of the error of the first curve: a proposed curve must reduce it so much

Plan = Mapping[str, Any]


@entry()
def design_indentation(
    plans: Plan | Iterable[Plan], model: Mapping[str, Any] | str | Path, free: Free | None = None
) -> IndentationFit:
    """Return the intervals that proposed indentations would give, one or several together.

    Parameters
    ----------
    plans : mapping, or iterable of these
        Each has the corners of a history: `time`, shape (corners,), and `depth`, `force` or `base`, which is
        the prescribed quantity; `noise` of the force or `depth_noise`, as the instrument measures the one or
        the other; and optionally `name`, `rows` (default 400), `stiffness` of the cantilever and
        `stiffness_error`, and a `punch` of its own. Units are those of the model.
    model : mapping, str or Path
        Body and indenter, see `fit_indentation`, at the values that are expected.
    free : sequence of str, or mapping
        Parameters that a fit would find, see `fit_indentation`.

    Returns
    -------
    IndentationFit
        Values are the model's; errors, intervals, correlations and warnings are those that a fit would have.

    Raises
    ------
    ConfigError
        A plan, the model or a key is not possible.
    CurveError
        A planned curve cannot be fitted.

    Examples
    --------
    Creep for one relaxation time leaves the relaxed modulus open; ten times as long, it is known to a few
    percent:

    >>> material = {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": 1.0}
    >>> model = {
    ...     "layer": {"thickness": 10.0, "material": material},
    ...     "punch": {"shape": "sphere", "radius": 5.0},
    ... }
    >>> free = ["layer.material.G0", "layer.material.Ginf", "layer.material.tau"]
    >>> creep = {"time": [0, 1, 2], "force": [0, 1, 1], "depth_noise": 0.001}
    >>> short = gfmdlayer.design_indentation(creep, model, free)
    >>> long = gfmdlayer.design_indentation(creep | {"time": [0, 1, 11]}, model, free)
    >>> print(10 * long["G0"].error < short["G0"].error)
    True
    """
    data, keys = read_model(model, free)
    made = IndentationModel(data)
    proposed = [plans] if isinstance(plans, Mapping) else list(plans)
    if not proposed:
        raise ConfigError(["plans: got none; give at least one"])
    return _expected([_planned(plan, made, number) for number, plan in enumerate(proposed)], made, keys)


def _planned(plan: Plan, model: IndentationModel, number: int) -> ForceCurve:
    """Return the curve of a plan, with the model's response and without noise."""
    name = str(plan.get("name", number))
    if foreign := [key for key in plan if key not in KEYS]:
        raise ConfigError([f"plan {name}: {key}: {unknown_key(key, KEYS, ())}" for key in foreign])
    kinds = [key for key in PRESCRIBED if key in plan]
    if len(kinds) != 1 or "time" not in plan:
        raise ConfigError(
            [f"plan {name}: got {', '.join(plan)}; must have time and one of depth, force, base"]
        )
    (kind,) = kinds
    needed = "depth_noise" if kind == FORCE else "noise"
    if needed not in plan:
        raise ConfigError([f"plan {name}: {needed} is missing; give the noise of the measured quantity"])
    corners, values = (column(name, key, plan[key]) for key in ("time", kind))
    is_finite = np.isfinite(corners).all() and np.isfinite(values).all()
    if corners.size < 2 or corners.shape != values.shape or not (is_finite and np.diff(corners).min() > 0):
        raise ConfigError(
            [f"plan {name}: time and {kind} must have two or more finite corners each, times ascending"]
        )
    time = np.linspace(corners[0], corners[-1], int(plan.get("rows", ROWS)))
    own = np.interp(time, corners, values)
    stiffness: Any = plan.get("stiffness")
    if kind == BASE and stiffness is None:
        raise ConfigError([f"plan {name}: the base is prescribed; give the stiffness of the cantilever"])
    # Until the response is known, half of the motion of the base bends the cantilever.
    force = own if kind == FORCE else np.maximum(own, 0.0) * (stiffness / 2 if kind == BASE else 1.0)
    facts = {key: plan[key] for key in ("noise", "depth_noise", "stiffness_error", "punch") if key in plan}
    depth = {FORCE: time, DEPTH: own}.get(kind, own - force / (stiffness or math.inf))
    curve = ForceCurve(name, time, depth, force, prescribed=kind, stiffness=stiffness, **facts)
    config = (model if curve.punch is None else model.under(curve.punch)).config
    prediction = Prediction(curve, adhesive=model.adhesion is not None)
    at = Correction(stiffness=stiffness or math.inf, adhesion=adhesion_of(model.adhesion))
    prediction.adapt(config, at)
    response, deep = prediction.response(config, at)
    if kind == FORCE:
        return replace(curve, depth=deep)
    return replace(curve, force=response, depth=own - response / stiffness if kind == BASE else own)


def _expected(curves: Sequence[ForceCurve], model: IndentationModel, free: Free) -> IndentationFit:
    """Return the fit of curves without noise, at the values of the model."""
    options = FitOptions()
    problem = make_problem(curves, model, curve_parameters(curves, model, free, options), options)
    refuse_adhesion(problem)
    for prediction in problem.predictions:
        noise = prediction.curve.noise if prediction.kinds == {FORCE} else prediction.curve.depth_noise
        prediction.drives = [replace(drive, error=noise or 0.0) for drive in prediction.drives]
    u = problem.start
    problem.adapt(u)
    problem.weigh(u)
    return conclude(problem, u, options, [], problem.values(u), measured=False)


def second_curve(problem: LeastSquares, u: Any, fit: IndentationFit, free: Free) -> Iterator[str]:
    """Yield the second curve that would determine a parameter, for each that one curve does not determine."""
    open_ones = [estimate for estimate in fit.parameters if estimate.is_open]
    if len(problem.predictions) != 1 or not open_ones:
        return
    data = fit.config.model_dump(exclude_none=True)
    model = IndentationModel({key: data[key] for key in SECTIONS if key in data and key != "name"})
    keys = [key for key in free if key in model.keys or key in OF_A_CURVE]
    first = _plan(problem, u, fit)
    trials = {}
    for words, second in _proposals(first, model):
        try:
            curves = [_planned(each, model, number) for number, each in enumerate((first, second))]
            together = _expected(curves, model, keys)
        except (FitError, ConfigError, ValueError, ArithmeticError):
            continue  # an impossible proposal: too deep, or too wide
        trials[words] = {each.key: each for each in together.parameters if not each.curve}
    for estimate in open_ones:
        known = {words: errors[estimate.key] for words, errors in trials.items() if estimate.key in errors}
        if not known:
            continue
        words, best = min(known.items(), key=lambda item: item[1].error)
        if best.error < BETTER * estimate.error and not best.is_open:
            size = f"{100 * best.error / best.value:.2g} %" if best.relative else f"{best.error:.2g}"
            yield f"{estimate.name}: a second curve {words} would give it with a standard error of {size}"
        else:
            tried = f"{FASTER:g} times faster or slower, a hold, a radius {WIDER:g} times larger or smaller"
            yield f"{estimate.name}: no second curve would determine it, of those that were tried ({tried})"


def _plan(problem: LeastSquares, u: Any, fit: IndentationFit) -> dict[str, Any]:
    """Return the plan of a measured curve, without its corrections."""
    (prediction,), (measured,) = problem.predictions, fit.curves
    curve, at = measured.curve, problem.correction(u, measured.curve)
    kind = curve.segments[0].prescribed
    time, values = prediction.corrected(at)
    noise = {
        key: value
        for key, value in (("noise", measured.noise), ("depth_noise", measured.depth_noise))
        if math.isfinite(value)
    }
    plan = {"name": "first", "time": time, kind: values, "rows": curve.time.size, **noise}
    if curve.stiffness:
        plan |= {"stiffness": at.stiffness, "stiffness_error": curve.stiffness_error}
    return plan if curve.punch is None else plan | {"punch": dict(curve.punch)}


def _proposals(plan: dict[str, Any], model: IndentationModel) -> Iterator[tuple[str, dict[str, Any]]]:
    kind = next(key for key in PRESCRIBED if key in plan)
    begin, time, values = plan["time"][0], plan["time"], plan[kind]
    second = plan | {"name": "second"}
    yield f"{FASTER:g} times slower", second | {"time": begin + FASTER * (time - begin)}
    yield f"{FASTER:g} times faster", second | {"time": begin + (time - begin) / FASTER}
    top = int(np.argmax(values)) + 1
    duration = float(np.ptp(time))
    longer = {
        "time": np.append(time[:top], time[top - 1] + FASTER * duration),
        kind: np.append(values[:top], values[top - 1]),
    }
    yield f"with a hold of {FASTER * duration:.3g}", second | longer
    punch = dict(plan.get("punch") or model.config.punch.model_dump(exclude_none=True))
    if "radius" in punch:
        for factor in (WIDER, 1 / WIDER):
            radius = factor * punch["radius"]
            yield f"with a radius of {radius:.3g}", second | {"punch": punch | {"radius": radius}}
