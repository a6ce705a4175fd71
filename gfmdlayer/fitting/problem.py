"""The least-squares problem: a model, its free parameters, residuals of the curves and their derivatives.

The fit varies the vector u. A modulus, a time, a length or a stiffness enters by its logarithm; Poisson's
ratios, exponents and corrections of a curve enter directly. An instantaneous modulus Ginf enters by the
logarithm of Ginf - G0 of the same material, so that no step of the fit makes a material that stiffens with
time. Residuals are predicted minus measured values over the noise: forces where the depth or the base of the
cantilever is prescribed, depths where the force is. `prediction` has the predictions, and the covariance of
the residuals by the noise of the prescribed quantity.

Derivatives are forward differences of solutions without extrapolation to zero step, whose error of second
order in the step hardly changes between two of them. Some are exact and need no solution: the derivatives to
corrections of the measured quantity, and, where all moduli of the body are free and depths prescribed, the
derivative to the largest modulus: the force is of first degree in the moduli (Euler), sum_k dF/d(ln G_k) = F.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.body.materials import Material
from gfmdlayer.config import Config, ConfigError
from gfmdlayer.config.model import explain
from gfmdlayer.config.sweeps import assigned
from gfmdlayer.fitting.elastic import adhesion_of, read_adhesion
from gfmdlayer.fitting.force_curve import (
    DEPTH,
    FORCE,
    OF_A_CURVE,
    Correction,
    CurveError,
    ForceCurve,
    baseline,
    numbers_in,
    onset,
)
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.prediction import Prediction
from gfmdlayer.fitting.stepped import KEPT
from gfmdlayer.indentation.indent import as_revolution
from gfmdlayer.validation.problems import shown, unknown_key
from gfmdlayer.validation.sections import Section

# The free parameters: keys of the model and values of a curve, their bounds and scales.

SECTIONS = (
    "name", "units", "grid", "layer", "layers", "halfspace", "punch", "temperature", "shift", "adhesion",
)  # fmt: skip
LINEAR: Mapping[str, tuple[float, float]] = {
    "poisson": (-0.99, 0.5),
    "exponent": (0.01, 1.0),
    "alpha": (0.01, 1.0),
}
WIDE = 1e4  # default bounds of other parameters: the start over this factor, and times this factor

Bounds = tuple[float, float]
Free = Sequence[str] | Mapping[str, Sequence[float] | None]


class IndentationModel:
    """Body, indenter and adhesion: a configuration whose numbers have keys such as layers[0].material.G0."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        if foreign := [key for key in data if key not in SECTIONS]:
            raise ConfigError([f"{key}: {unknown_key(key, SECTIONS, ())}" for key in foreign])
        grid = {"geometry": "axisymmetric"} | dict(data.get("grid") or {})
        self._given = dict(data)
        # The curves have the history; the default depth may be impossible for this body. A sample lies on
        # a rigid base, as that of `bonded_layer`, where the model does not say otherwise.
        own = {key: value for key, value in data.items() if key != "adhesion"}
        rigid = {"halfspace": {"shear_modulus": math.inf}}
        case = {"name": "indentation"} | rigid | own | {"grid": grid, "trajectory": {"depth": 0.0}}
        self.adhesion = read_adhesion(data["adhesion"]) if "adhesion" in data else None
        try:
            self.config = Config.model_validate(case)
        except ValidationError as error:
            raise ConfigError(map(str, explain(error))) from None
        self._data = self.config.model_dump(exclude_none=True)
        self.keys = dict(numbers_in(self._data | {"adhesion": self.adhesion or {}}))

    def under(self, punch: Mapping[str, Any]) -> IndentationModel:
        """Return the model with another indenter."""
        return IndentationModel(self._given | {"punch": dict(punch)})

    def sticking(self, adhesion: Mapping[str, Any] | None) -> IndentationModel:
        """Return the model with other adhesion, or without."""
        rest = {key: value for key, value in self._given.items() if key != "adhesion"}
        return IndentationModel(rest if adhesion is None else rest | {"adhesion": dict(adhesion)})

    def assumed(self, free: Iterable[str]) -> list[str]:
        """Return what decides the result and is neither given nor free, as key = value."""
        found: dict[str, Any] = {}
        for at in ("layer", "layers", "halfspace", "punch"):
            section = getattr(self.config, at)
            parts = section if isinstance(section, tuple) else () if section is None else (section,)
            for i, part in enumerate(parts):
                place = f"{at}[{i}]" if isinstance(section, tuple) else at
                found |= _defaults(part, place, given=at in self._given)
        idle = without_effect(self.config)
        return [
            f"{key} = {_worded(key, value)}"
            for key, value in found.items()
            if key not in {*free} and not key.startswith(idle)
        ]

    def with_values(self, values: dict[str, float]) -> Config:
        """Return the configuration in which the dotted keys have these values."""
        elastic = {
            f"{key[:-2]}Ginf": value for key, value in values.items() if f"{key[:-2]}Ginf" in self._elastic
        }
        dotted = {key.replace("[", ".").replace("]", ""): value for key, value in (elastic | values).items()}
        return Config.model_validate(assigned(self._data, dotted))

    def is_timeless(self, free: Free) -> bool:
        """Whether nothing in the model or among the free parameters depends on time."""
        drifting = {"drift", "force_drift"} & {*free}
        relaxing = [key for key in free if key.rpartition(".")[2] in {"Ginf", "tau"}]
        elastic = all(isinstance(law, Material) and law.elastic for law in self.config.laws)
        return elastic and not drifting and not relaxing

    @cached_property
    def _elastic(self) -> set[str]:
        """Instantaneous moduli that equal G0: these materials stay elastic where only G0 is free."""
        ends = {key: f"{key[:-4]}G0" for key in self.keys if key.endswith(".Ginf")}
        return {key for key, other in ends.items() if self.keys[key] == self.keys[other]}


@dataclass(frozen=True)
class FreeParameter:
    """A free parameter."""

    key: str  # dotted key of the model, or one of `OF_A_CURVE`
    start: float  # where the fit starts
    bounds: Bounds  # smallest and largest value
    curve: str = ""  # the curve to which it belongs; empty for a parameter that all curves share
    above: str = ""  # for Ginf: the key of G0, whose value is subtracted before the logarithm is taken

    @property
    def name(self) -> str:
        """Key, with the curve to which it belongs."""
        return f"{self.key}[{self.curve}]" if self.curve else self.key

    @property
    def scale(self) -> Literal["logarithmic", "linear"]:
        """Whether its logarithm is fitted."""
        own = self.key in OF_A_CURVE or self.key.rpartition(".")[2] in LINEAR
        return "linear" if own and self.key != "stiffness" else "logarithmic"


def free_parameters(
    model: IndentationModel, free: Free, curves: Sequence[str], spans: Mapping[str, Bounds]
) -> list[FreeParameter]:
    """Return the free parameters of a fit; `spans` has the default bounds of the values of a curve."""
    asked = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    wrong, parameters = [], []
    if not asked:
        raise ConfigError(["free: got no parameter; give at least one key, such as layer.material.G0"])
    for key, bounds in asked.items():
        if key in OF_A_CURVE:
            owners = list(curves) if len(curves) > 1 else [""]
            if key not in spans:
                wrong.append(f"free: {key}: got a curve without a prescribed base; only such curves have it")
                continue
            parameters += [FreeParameter(key, 0.0, _bounds(bounds, spans[key]), owner) for owner in owners]
        elif key.startswith(STICKING) and model.adhesion is None:
            wrong.append(
                f"free: {key}: the model has no adhesion; give its section, such as "
                "adhesion: {model: jkr, work: ...}, or its kind by the option adhesion"
            )
        elif key not in model.keys:
            wrong.append(f"free: {key}: {unknown_key(key, [*model.keys, *OF_A_CURVE], model.keys)}")
        else:
            start, last = model.keys[key], key.rpartition(".")[2]
            default = LINEAR.get(last, (start / WIDE, start * WIDE))
            glassy = f"{key[:-2]}Ginf"
            if last == "G0" and glassy in model.keys and glassy not in asked and start < model.keys[glassy]:
                default = (default[0], model.keys[glassy])
            if last not in LINEAR and not 0 < start < math.inf:
                wrong.append(f"free: {key}: the start is {shown(start)}; it must be > 0 and finite")
                continue
            above = f"{key[:-4]}G0" if last == "Ginf" else ""
            parameters.append(FreeParameter(key, start, _bounds(bounds, default), "", above))
    for parameter in parameters:
        low, high = parameter.bounds
        if not low < high or (parameter.scale == "logarithmic" and low <= 0):
            wrong.append(f"free: {parameter.key}: the bounds are {low:g} and {high:g}; give 0 < low < high")
        elif parameter.key not in OF_A_CURVE and not low <= parameter.start <= high:
            wrong.append(
                f"free: {parameter.key}: the start {parameter.start:g} is not between {low:g} and {high:g}"
            )
    if wrong:
        raise ConfigError(wrong)
    return parameters


def _bounds(asked: Sequence[float] | None, default: Bounds) -> Bounds:
    return default if asked is None else (float(asked[0]), float(asked[1]))


def without_effect(config: Config) -> tuple[str, ...]:
    """Return how keys begin on which nothing depends: the base below an infinite layer, nu of a rigid one."""
    base, last = config.halfspace, (config.layers or (config.layer,))[-1]
    if last is not None and math.isinf(last.thickness):
        return ("halfspace.",)
    return ("halfspace.poisson",) if base is not None and base.shear_modulus == math.inf else ()


_DECIDE_NOTHING = {"tolerance", "moduli"}


def _defaults(section: Section, at: str, given: bool) -> dict[str, Any]:
    """Return the numbers and words of a section that are defaults, by their dotted keys."""
    found: dict[str, Any] = {}
    for name in type(section).model_fields:
        value, key = getattr(section, name), f"{at}.{name}"
        is_given = given and name in section.model_fields_set
        if isinstance(value, Section):
            found |= _defaults(value, key, is_given)
        elif not is_given and name not in _DECIDE_NOTHING and isinstance(value, (int, float, str)):
            found[key] = value
    return found


def _worded(key: str, value: Any) -> str:
    if key == "halfspace.shear_modulus" and value == math.inf:
        return ".inf (a rigid base)"
    return value if isinstance(value, str) else f"{value:g}"


TRIES = 3  # the differences are repeated when the nodes changed on the way, at most so often
# Steps of the differences, in a logarithm and in the scale of a linear parameter (`_scale`): a derivative is
# off by half a step. At the row where the contact opens a force may jump by 1e-4 of the largest one; a
# shorter step would take the jump for a derivative.
STEP, LINEAR_STEP = 5e-3, 2e-3
SOLVED = 1e-5  # error of a solution in steps, over the range of the measured quantity
MODULI = {"G0", "Ginf", "G", "young", "bulk", "shear_modulus", "young_modulus", "bulk_modulus"}
STICKING = "adhesion."  # of the keys of the adhesion
EXACT_STEP = 1e-5  # the same for an elastic body, whose response is smooth
NO_MODULI = {*"tau thickness poisson exponent alpha gamma radius slope angle width face".split()}  # noqa: SIM905


class LeastSquares:
    """Residuals of curves under a model."""

    def __init__(
        self, model: IndentationModel, parameters: Sequence[FreeParameter], predictions: Sequence[Prediction]
    ) -> None:
        self.model, self.parameters, self.predictions = model, list(parameters), list(predictions)
        self._models = {
            prediction.curve.name: model
            if prediction.curve.punch is None
            else model.under(prediction.curve.punch)
            for prediction in predictions
        }
        # Standard deviations of force and depth of each curve, by which its residuals are divided.
        self.noise = np.array(
            [
                [
                    prediction.curve.noise or float(np.ptp(prediction.curve.force)),
                    prediction.curve.depth_noise or float(np.ptp(prediction.curve.depth)),
                ]
                for prediction in predictions
            ]
        )
        # Errors of rows and jumps of each curve by the noise of its prescribed quantity, see `weigh`.
        self._scatter: list[FloatArray | None] = [None for _ in predictions]
        self._roots: list[_Root] = []
        self.decorrelate()
        self.solutions = 0  # number of solved contact problems, each over a whole curve
        self._last: tuple[object, list[FloatArray]] = (None, [])
        self._slopes: tuple[object, list[list[FloatArray]]] = (None, [])
        self._configs: dict[tuple[object, ...], Config] = {}  # the latest

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of u."""
        low, high = np.array([parameter.bounds for parameter in self.parameters]).T.copy()
        for i, parameter in enumerate(self.parameters):
            if parameter.above:  # u is ln(Ginf - G0); with G0 free a lower bound of Ginf is no bound of u
                base = self.model.keys[parameter.above]
                is_free = any(other.key == parameter.above for other in self.parameters)
                smallest = max(parameter.start - base, 0.1 * base) / WIDE
                low[i] = smallest if is_free else max(low[i] - base, smallest)
                high[i] = high[i] if is_free else high[i] - base
            if parameter.scale == "logarithmic":
                low[i], high[i] = np.log(low[i]), np.log(high[i])
        return low, high

    @cached_property
    def start(self) -> FloatArray:
        """The u at which the fit starts, within the bounds."""
        values = {parameter.name: parameter.start for parameter in self.parameters}
        return np.clip(self.coordinates(values), *self.bounds)

    def values(self, u: FloatArray) -> dict[str, float]:
        """Return the parameters at u, by name."""
        values: dict[str, float] = {}
        for parameter, at in zip(self.parameters, u.tolist(), strict=True):
            values[parameter.name] = float(np.exp(at)) if parameter.scale == "logarithmic" else at
        for parameter in self.parameters:
            if parameter.above:
                values[parameter.name] += values.get(parameter.above, self.model.keys[parameter.above])
        return values

    def coordinates(self, values: Mapping[str, float]) -> FloatArray:
        """Return the u of parameters."""
        u = np.empty(len(self.parameters))
        for i, parameter in enumerate(self.parameters):
            value = values[parameter.name]
            if parameter.above:
                base = values.get(parameter.above, self.model.keys[parameter.above])
                value = max(value - base, 0.1 * base)
            u[i] = np.log(value) if parameter.scale == "logarithmic" else value
        return u

    def reported(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the parameters on their scales, logarithmic or linear, and their derivatives to u."""
        values = self.values(u)
        scaled, slopes = u.copy(), np.eye(u.size)
        for i, parameter in enumerate(self.parameters):
            if not parameter.above:
                continue
            value, base = (
                values[parameter.name],
                values.get(parameter.above, self.model.keys[parameter.above]),
            )
            scaled[i], slopes[i, i] = np.log(value), 1 - base / value
            if parameter.above in values:
                slopes[i, [p.name for p in self.parameters].index(parameter.above)] = base / value
        return scaled, slopes

    def config(self, u: FloatArray, curve: str | None = None) -> Config:
        """Return the configuration at u, with the indenter of a curve."""
        values = self.values(u)
        own = {
            parameter.key: values[parameter.name]
            for parameter in self.parameters
            if parameter.key not in OF_A_CURVE and not parameter.key.startswith(STICKING)
        }
        model = self.model if curve is None else self._models[curve]
        known = (id(model), *own.items())
        if known not in self._configs:
            self._configs = {known: model.with_values(own)} | dict(list(self._configs.items())[: KEPT - 1])
        return self._configs[known]

    def correction(self, u: FloatArray, curve: ForceCurve) -> Correction:
        """Return the values of a curve at u."""
        values = self.values(u)
        own = {
            parameter.key: values[parameter.name]
            for parameter in self.parameters
            if parameter.key in OF_A_CURVE and parameter.curve in {"", curve.name}
        }
        return Correction(
            **({"stiffness": curve.stiffness or math.inf} | own), adhesion=adhesion_of(self.adhesion(u))
        )

    def at(self, u: FloatArray, prediction: Prediction) -> tuple[Config, Correction]:
        """Return the configuration and the values of a curve at u."""
        return self.config(u, prediction.curve.name), self.correction(u, prediction.curve)

    def adhesion(self, u: FloatArray) -> dict[str, str | float] | None:
        """Return the section `adhesion` of the model at u."""
        if self.model.adhesion is None:
            return None
        values = self.values(u)
        return {key: values.get(f"{STICKING}{key}", fixed) for key, fixed in self.model.adhesion.items()}

    def adapt(self, u: FloatArray) -> None:
        """Choose the times of the solutions for the responses at u, and the rows in contact by the data."""
        self._scatter = [None for _ in self.predictions]
        self.decorrelate()
        for prediction in self.predictions:
            prediction.adapt(*self.at(u, prediction))
            prediction.label(*self.at(u, prediction))

    def contact_stays(self, u: FloatArray) -> bool:
        """Whether the rows in contact, taken from the data again at u, are the same."""
        stays = True
        for prediction in self.predictions:
            before = prediction.touch.touching
            prediction.label(*self.at(u, prediction))
            after = prediction.touch.touching
            stays &= before is after is None or bool(np.array_equal(before, after))  # type: ignore[arg-type]
        return stays

    def weigh(self, u: FloatArray) -> None:
        """Find the covariance of the residuals by the noise of the prescribed quantities, at u."""
        for i, prediction in enumerate(self.predictions):
            self._scatter[i], solutions = prediction.scatter(*self.at(u, prediction), self.noise_of_rows(i))
            self.solutions += solutions
        self.decorrelate()

    def decorrelate(self) -> None:
        """Weigh the covariance of the residuals against the noise."""
        self._roots = []
        for i, (prediction, scatter) in enumerate(zip(self.predictions, self._scatter, strict=True)):
            scaled = np.zeros((0, 0))
            if scatter is not None:
                rows, jumps = np.split(scatter, [prediction.used.size])
                scaled = np.vstack(
                    (rows[prediction.used] / self.noise_of_rows(i)[prediction.used][:, np.newaxis], jumps)
                )
            self._roots.append(_Root(scaled))

    def noise_of_rows(self, i: int) -> FloatArray:
        """Return the standard deviation of the measured quantity of a curve, shape (rows,)."""
        prediction = self.predictions[i]
        noise = np.where(prediction.curve.by_force, self.noise[i, 1], self.noise[i, 0])
        if prediction.curve.weights is not None:
            noise = noise / np.where(prediction.used, prediction.curve.weights, 1.0)
        return np.where(prediction.touch.uncertain, np.inf, noise)

    def noise_is_given(self, i: int) -> BoolArray:
        """Whether the noise of force and depth of a curve is given, or needs no estimate; shape (2,)."""
        prediction = self.predictions[i]
        noise = (prediction.curve.noise, prediction.curve.depth_noise)
        measured = prediction.curve.by_force[prediction.used]
        return np.array([noise[k] is not None or not (measured == bool(k)).any() for k in (0, 1)])

    @cached_property
    def least_noise(self) -> FloatArray:
        """The errors of a solution in steps, which a curve without noise does not make exact: see `noise`."""
        return (0.0 if self.is_elastic else SOLVED) * self._ranges

    @property
    def _ranges(self) -> FloatArray:
        """Ranges of force and depth of each curve, shape (curves, 2)."""
        return np.array([[np.ptp(each.curve.force), np.ptp(each.curve.depth)] for each in self.predictions])

    @property
    def is_exact(self) -> bool:
        """Whether the noise that was estimated is within the error of a solution in steps."""
        estimated = ~np.array([self.noise_is_given(i) for i in range(len(self.predictions))])
        return bool(estimated.any() and np.all((self.noise <= SOLVED * self._ranges)[estimated]))

    @property
    def noise_is_known(self) -> bool:
        """Whether no noise must be estimated, or is larger than the error of the solutions."""
        given = np.array([self.noise_is_given(i) for i in range(len(self.predictions))])
        return bool(np.all(given | (self.noise <= self.least_noise)))

    def log_determinant(self, i: int) -> float:
        """Logarithm of the determinant of the covariance of a curve's residuals, over its noise."""
        return self._roots[i].log_determinant

    def measured(self, u: FloatArray) -> list[FloatArray]:
        """Return the predicted values of the measured quantity of each curve at u."""
        if self._last[0] != (u.tobytes(), self._changes):
            values = [self._measured(u, prediction) for prediction in self.predictions]
            self._last = ((u.tobytes(), self._changes), values)
        return self._last[1]

    @property
    def _changes(self) -> tuple[int, ...]:
        return tuple(prediction.changes for prediction in self.predictions)

    @property
    def rows(self) -> int:
        """Number of residuals of the curves."""
        return sum(int(prediction.used.sum()) for prediction in self.predictions)

    def residuals(self, u: FloatArray) -> FloatArray:
        """Return predicted minus measured values over the noise, the known stiffness, and places of jumps.

        Infinite where the values are impossible or the contact is not found: the fit then steps less.
        """
        try:
            values = self.measured(u)
        except (ValidationError, FitError):
            return np.full(self.rows + self._further, np.inf)
        away = [f - prediction.curve.measured for f, prediction in zip(values, self.predictions, strict=True)]
        before: FloatArray = np.array([(u[i] - math.log(at)) / error for i, at, error in self._known_before])
        return self._joined(away, self._jumps(u), before)

    def _jumps(self, u: FloatArray, rough: bool = False) -> list[FloatArray]:
        """Return the residuals of the places of jumps of each curve."""
        return [prediction.jumps(*self.at(u, prediction), rough) for prediction in self.predictions]

    def jumps(self, u: FloatArray) -> FloatArray:
        """Return the places of all jumps at u, predicted less measured, over their errors."""
        return np.concatenate(self._jumps(u))

    @property
    def is_homogeneous(self) -> bool:
        """Whether all residuals belong to rows, whose common noise is estimated at last."""
        return not self._further

    @property
    def _further(self) -> int:
        """Number of residuals that belong to no row."""
        return len(self._known_before) + sum(len(prediction.touch.jumps) for prediction in self.predictions)

    def _uncorrelated(self, i: int, rows: FloatArray, jumps: FloatArray) -> list[FloatArray]:
        """Return the rows of a curve that count, over the noise, and its jumps, both uncorrelated."""
        prediction = self.predictions[i]
        scaled = rows[prediction.used] / self.noise_of_rows(i)[prediction.used]
        return np.split(self._roots[i] @ np.append(scaled, jumps), [scaled.size])

    def scaled(self, i: int, rows: FloatArray) -> FloatArray:
        """Return values at all rows of a curve as residuals that count, over the noise, uncorrelated."""
        return self._uncorrelated(i, rows, np.zeros(len(self.predictions[i].touch.jumps)))[0]

    def _joined(
        self, rows: Sequence[FloatArray], jumps: Sequence[FloatArray], before: FloatArray
    ) -> FloatArray:
        """Join the rows of all curves, parameters measured beforehand, and the jumps; uncorrelated."""
        parts = [self._uncorrelated(i, *pair) for i, pair in enumerate(zip(rows, jumps, strict=True))]
        return np.concatenate([*(part[0] for part in parts), before, *(part[1] for part in parts)])

    def rows_over_noise(self, u: FloatArray) -> list[FloatArray]:
        """Return the uncorrelated residuals of each curve at all its rows, over the noise; 0 if not used."""
        residuals = []
        for i, (values, jumps) in enumerate(zip(self.measured(u), self._jumps(u), strict=True)):
            prediction = self.predictions[i]
            residuals.append(np.zeros(prediction.used.size))
            residuals[i][prediction.used] = self._uncorrelated(i, values - prediction.curve.measured, jumps)[
                0
            ]
        return residuals

    @cached_property
    def _known_before(self) -> list[tuple[int, float, float]]:
        """The parameters that were measured beforehand: number, value, relative error."""
        curves = {prediction.curve.name: prediction.curve for prediction in self.predictions}
        known = []
        for i, parameter in enumerate(self.parameters):
            curve = curves[parameter.curve or next(iter(curves))]
            if parameter.key == "stiffness" and curve.stiffness and curve.stiffness_error:
                known.append((i, curve.stiffness, curve.stiffness_error))
        return known

    def jacobian(self, u: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals, shape (residuals, parameters)."""
        before = np.zeros((len(self._known_before), u.size))
        for row, (i, _, error) in enumerate(self._known_before):
            before[row, i] = 1 / error
        columns, slopes_of_rows = [], self.derivatives(u)
        at = self._jumps(u, rough=True)
        for i, column in enumerate(slopes_of_rows):
            moved = self._moved(i, u) if self._further > len(self._known_before) else u
            there = at if moved is u else self._jumps(moved, rough=True)
            slopes = [(b - a) / (moved[i] - u[i]) if a.size else a for a, b in zip(at, there, strict=True)]
            columns.append(self._joined(column, slopes, before[:, i]))
        return np.stack(columns, axis=1)

    def derivatives(self, u: FloatArray) -> list[list[FloatArray]]:
        """Return the derivatives of the measured quantity of each curve, for each parameter."""
        if self._slopes[0] == (u.tobytes(), self._changes):
            return self._slopes[1]
        for _ in range(TRIES):
            before = self._changes
            rough = self.measured(u)
            if not self.is_elastic:
                rough = [self._measured(u, prediction, rough=True) for prediction in self.predictions]
            columns = [self._column(i, u, rough) for i in range(u.size)]
            if self._changes == before:
                break
        if (exact := self._by_euler(u)) is not None:
            others = [i for i in self._euler or () if i != exact]
            values = self.measured(u)
            for k, prediction in enumerate(self.predictions):
                force = values[k] - baseline(prediction.curve, self.correction(u, prediction.curve))
                columns[exact][k] = force - sum((columns[i][k] for i in others), np.zeros(1))
        self._slopes = ((u.tobytes(), self._changes), columns)
        return columns

    def _column(self, i: int, u: FloatArray, at_u: list[FloatArray]) -> list[FloatArray]:
        """Derivative of the measured values to one parameter; zeros for the one by Euler's theorem."""
        parameter = self.parameters[i]
        if i == self._by_euler(u):
            return [np.zeros(1) for _ in at_u]
        moved, column = self._moved(i, u), []
        for values, prediction in zip(at_u, self.predictions, strict=True):
            if parameter.curve not in {"", prediction.curve.name}:
                column.append(np.zeros(values.size))
            elif (exact := _added(parameter.key, prediction)) is not None:
                column.append(exact)
            else:
                column.append((self._measured(moved, prediction, rough=True) - values) / (moved[i] - u[i]))
        return column

    def _moved(self, i: int, u: FloatArray) -> FloatArray:
        """Return u with the step of a difference in one parameter."""
        parameter, moved = self.parameters[i], u.copy()
        logarithmic = parameter.scale == "logarithmic"
        scale = 1.0 if logarithmic else self._scale(parameter)
        if self.is_elastic:
            step = EXACT_STEP * scale
        else:
            step = (STEP if logarithmic else LINEAR_STEP) * scale
            step *= 2 if self.model.adhesion else 1  # the place of a jump is known to a part of a step
        moved[i] += step if u[i] + step <= self.bounds[1][i] else -step
        try:
            self.config(moved)
        except ValidationError:  # a bound that depends on another parameter
            moved[i] = 2 * u[i] - moved[i]
        return moved

    def _scale(self, parameter: FreeParameter) -> float:
        """Return the size of a linear parameter: a correction of a curve counts beside its indentation."""
        if parameter.key not in OF_A_CURVE:
            return parameter.bounds[1] - parameter.bounds[0]
        curves = [each.curve for each in self.predictions if parameter.curve in {"", each.curve.name}]
        depth = min(curve.indentation[1] for curve in curves)
        force = min(float(np.ptp(curve.force)) for curve in curves)
        duration = min(float(np.ptp(curve.time)) for curve in curves)
        sizes = {"contact_point": depth, "drift": depth / duration, "force_offset": force}
        sizes |= {"force_drift": force / duration, "tilt": force / depth}
        return 2 * sizes[parameter.key]

    @cached_property
    def is_elastic(self) -> bool:
        """Whether the body does not relax."""
        return self.predictions[0].is_elastic(self.config(self.start))

    def _measured(self, u: FloatArray, prediction: Prediction, rough: bool = False) -> FloatArray:
        self.solutions += 1
        return prediction.measured(*self.at(u, prediction), rough)

    def _by_euler(self, u: FloatArray) -> int | None:
        """Return the modulus whose derivative follows from the others': the largest, the last of equal ones.

        The error of the others' differences would exceed the derivative to a small one.
        """
        return max(self._euler[::-1], key=lambda i: float(u[i])) if self._euler else None

    @cached_property
    def _euler(self) -> list[int] | None:
        """The free moduli, if all moduli of the body are free; None otherwise, or if a key is not known."""
        if any(each.kinds != {DEPTH} for each in self.predictions):
            return None
        free = {each.key: i for i, each in enumerate(self.parameters)}
        moduli = []
        for key, value in self.model.keys.items():
            last = key.rpartition(".")[2]
            if last in MODULI and np.isfinite(value) and value != 0:
                if key not in free:
                    return None
                moduli.append(free[key])
            elif last not in MODULI | NO_MODULI and not key.startswith("punch."):
                return None
        return moduli or None


class _Root:
    """The inverse root of 1 + A A^T, for A of few columns."""

    def __init__(self, A: FloatArray) -> None:
        self._vectors, singular, _ = np.linalg.svd(A, full_matrices=False)
        self._less = (1 + singular**2) ** -0.5 - 1
        self.log_determinant = float(np.sum(np.log1p(singular**2)))

    def __matmul__(self, values: FloatArray) -> FloatArray:
        if not self._less.size:
            return values
        return np.asarray(values + self._vectors @ (self._less * (self._vectors.T @ values)))


def _added(key: str, prediction: Prediction) -> FloatArray | None:
    """Return the derivative of the measured quantity to a correction that is added to it, or None."""
    curve = prediction.curve
    if key in {"force_offset", "force_drift", "tilt"} and FORCE not in prediction.kinds:
        one: dict[str, Any] = {key: 1.0}
        return baseline(curve, Correction(**one))
    if key in {"contact_point", "drift"} and prediction.kinds == {FORCE}:
        return np.ones(curve.time.size) if key == "contact_point" else curve.time - curve.time[0]
    return None


# Checks of curves with a model: mixed units, depths beyond the layer.

ODD, MIXED = 1e2, 1e6  # factor between the moduli of model and data: a warning, an error
WIDEST = 100.0  # contact radius over thickness; beyond it the lengths have different units
STRAIN = 0.3  # depth over thickness, or over the radius of a sphere; beyond it linear theory is doubtful


def depths(curves: Sequence[ForceCurve], parameters: Sequence[FreeParameter]) -> dict[str, float]:
    """Return the largest depth of each curve below the contact point from which its fit starts."""
    points = {each.curve: each.start for each in parameters if each.key == "contact_point"}
    return {
        curve.name: max(float(curve.depth.max()) - points.get(curve.name, points.get("", 0.0)), 0.0)
        for curve in curves
    }


def refuse_impossible(reached: Mapping[str, float], model: IndentationModel) -> None:
    """Reject depths beyond a layer on a stiffer base, and contacts far wider than the layer is thick."""
    reasons = []
    thickness, stiff_base = _thickness(model)
    radius = model.keys.get("punch.radius", 0.0)
    for name, depth in reached.items():
        if (contact := min(math.sqrt(radius * depth), radius)) > WIDEST * thickness:
            reasons.append(
                f"curve {name}: a radius of {radius:.4g} and a depth of {depth:.4g} give a contact of about "
                f"{contact:.4g}, {contact / thickness:.2g} thicknesses of the layer; the limit is {WIDEST:g}."
                " Are all lengths in the same unit?"
            )
        if stiff_base and depth >= thickness:
            reasons.append(
                f"curve {name}: the depth reaches {depth:.4g} below first contact, more than the thickness "
                f"{thickness:.4g} of the layer. Is a unit, the thickness or the contact point wrong?"
            )
    if reasons:
        raise CurveError("\n".join(reasons))


def refuse_adhesion(problem: LeastSquares) -> None:
    """Reject adhesion of a body that relaxes, and adhesion that curves without a retraction should give."""
    adhesion = problem.model.adhesion
    if adhesion is None:
        return
    if adhesion["model"] == "dmt" and not problem.is_elastic:
        raise ConfigError(
            [
                "adhesion: got 'dmt' under a body that relaxes; must be 'jkr', or the body elastic: material "
                "{model: elastic, G: ...}, or Ginf equal to G0 and not free"
            ]
        )
    if any(each.key.startswith(STICKING) for each in problem.parameters) and not any(
        each.retracts for each in problem.predictions
    ):
        names = ", ".join(each.curve.name for each in problem.predictions)
        raise CurveError(
            f"curve {names}: adhesion is asked of a curve without a retraction; give the rows of the "
            f"retraction, or a fixed value of the adhesion"
        )


def warnings_before(
    curves: Sequence[ForceCurve],
    reached: Mapping[str, float],
    model: IndentationModel,
    factor: float,
    free: Iterable[str],
) -> Iterator[str]:
    """Yield defaults of the model, and doubts about the curves; its moduli times `factor` fit the force."""
    thickness, _ = _thickness(model)
    radius = model.keys.get("punch.radius", np.inf)
    if assumed := model.assumed(free):
        yield f"the model leaves open, and the fit assumes: {', '.join(assumed)}"
    for curve in curves:
        yield from (f"curve {curve.name}: {warning}" for warning in curve.warnings())
        if curve.looks_swapped() and onset(as_revolution(model.config.punch)) > 1:
            yield (
                f"curve {curve.name}: the force bends down as the depth grows, where this indenter bends it "
                "up; are force and depth swapped, or is the contact point wrong?"
            )
        depth = reached[curve.name]
        for size, name in ((thickness, "thickness of the layer"), (radius, "radius of the punch")):
            if STRAIN * size < depth:
                yield (
                    f"curve {curve.name}: the depth reaches {depth / size:.2g} of the {name}; linear theory "
                    f"is doubtful beyond {STRAIN:g}"
                )
    if not 1 / ODD < factor < ODD:
        yield _other_modulus(model, factor)


def refuse_mixed_units(model: IndentationModel, factor: float) -> None:
    """Reject forces that need moduli of another order than the model has: the units differ."""
    if not 1 / MIXED < factor < MIXED:
        raise FitError(_other_modulus(model, factor))


def _other_modulus(model: IndentationModel, factor: float) -> str:
    key, modulus = next((k, v) for k, v in model.keys.items() if k.rpartition(".")[2] in MODULI)
    return (
        f"the forces need moduli {factor:.2g} times larger than in the model ({key} = {modulus * factor:.3g} "
        f"instead of {modulus:g}). Do force, depth, punch and moduli have the same units? Are force and "
        "depth swapped?"
    )


def _thickness(model: IndentationModel) -> tuple[float, bool]:
    """Return the thickness above the halfspace, and whether the halfspace is stiffer than the layer."""
    keys = [key for key in model.keys if key.endswith(".thickness")]
    thickness = sum(model.keys[key] for key in keys)
    base = next(
        (model.keys[key] for key in model.keys if key.startswith("halfspace.") and key.endswith("_modulus")),
        0.0,
    )
    moduli = [
        value
        for key, value in model.keys.items()
        if key.startswith("layer") and key.rpartition(".")[2] in MODULI
    ]
    return thickness, base > max(moduli, default=0.0)
