"""The least-squares problem: residuals of all curves, and their derivatives to the free parameters.

The fit moves the vector u: the logarithms of positive parameters, others as they are, and of an instantaneous
modulus the logarithm of Ginf - G0. Residuals are predicted minus measured forces over the noise of the curve.

Derivatives are forward differences, but for two that are exact and cost no solution: to an offset of the
force, and to the last of the moduli where all moduli of the body are free, for the force is of first degree
in them (Euler): sum_k dF/d(ln G_k) = F.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
from pydantic import ValidationError

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import Config
from gfmdlayer.fitting.indentation.curve import CurveError, ForceCurve
from gfmdlayer.fitting.indentation.forward import Prediction
from gfmdlayer.fitting.indentation.parameters import OF_A_CURVE, WIDE, Model, Parameter
from gfmdlayer.fitting.measurement import FitError

TRIES = 3  # of the differences, where a contact leaves the nodes on the way
# Steps of the differences in a logarithm, and in the range of a linear parameter: a derivative is off by half
# a step. At the row where contact is lost a force may jump by 1e-4 of the largest one, which a shorter
# step would turn into a derivative.
STEP, LINEAR_STEP = 5e-3, 2e-3
MODULI = {"G0", "Ginf", "G", "shear_modulus"}
NO_MODULI = {
    "tau",
    "thickness",
    "poisson",
    "exponent",
    "alpha",
    "gamma",
    "radius",
    "slope",
    "angle",
    "width",
    "face",
}


class LeastSquares:
    """Residuals of curves under a model."""

    def __init__(
        self, model: Model, parameters: Sequence[Parameter], predictions: Sequence[Prediction]
    ) -> None:
        self.model, self.parameters, self.predictions = model, list(parameters), list(predictions)
        self.noise = np.array([each.curve.noise or np.abs(each.curve.force).max() for each in predictions])
        self.solutions = 0
        self._last: tuple[object, list[FloatArray]] = (None, [])

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of u."""
        low, high = np.array([each.bounds for each in self.parameters]).T.copy()
        for i, each in enumerate(self.parameters):
            if each.above:  # of Ginf - G0; with G0 free the lower bound of Ginf itself would not be one of u
                base = self._fixed(each.above)
                is_free = any(other.key == each.above for other in self.parameters)
                smallest = max(each.start - base, 0.1 * base) / WIDE
                low[i] = smallest if is_free else max(low[i] - base, smallest)
                high[i] = high[i] if is_free else high[i] - base
            if each.scale == "logarithmic":
                low[i], high[i] = np.log(low[i]), np.log(high[i])
        return low, high

    @cached_property
    def start(self) -> FloatArray:
        """The u of the parameters' starts, within the bounds."""
        values = {each.name: each.start for each in self.parameters}
        return np.clip(self.coordinates(values), *self.bounds)

    def values(self, u: FloatArray) -> dict[str, float]:
        """Return the parameters at u, by name."""
        found: dict[str, float] = {}
        for each, at in zip(self.parameters, u.tolist(), strict=True):
            found[each.name] = float(np.exp(at)) if each.scale == "logarithmic" else at
        for each in self.parameters:
            if each.above:
                found[each.name] += found.get(each.above, self._fixed(each.above))
        return found

    def coordinates(self, values: Mapping[str, float]) -> FloatArray:
        """Return the u of parameters."""
        u = np.empty(len(self.parameters))
        for i, each in enumerate(self.parameters):
            value = values[each.name]
            if each.above:
                base = values.get(each.above, self._fixed(each.above))
                value = max(value - base, 0.1 * base)
            u[i] = np.log(value) if each.scale == "logarithmic" else value
        return u

    def reported(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the parameters on their scales, ln or as they are, and their derivatives to u."""
        values = self.values(u)
        found, slopes = u.copy(), np.eye(u.size)
        for i, each in enumerate(self.parameters):
            if not each.above:
                continue
            value, base = values[each.name], values.get(each.above, self._fixed(each.above))
            found[i], slopes[i, i] = np.log(value), 1 - base / value
            if each.above in values:
                slopes[i, [p.name for p in self.parameters].index(each.above)] = base / value
        return found, slopes

    def config(self, u: FloatArray) -> Config:
        """Return the configuration at u."""
        values = self.values(u)
        return self.model.with_values({each.key: values[each.name] for each in self._of_the_model})

    def adapt(self, u: FloatArray) -> None:
        """Choose the times of the solutions by the forces at u."""
        config = self.config(u)
        for prediction in self.predictions:
            prediction.adapt(config, **self._motion(u, prediction.curve.name))

    def forces(self, u: FloatArray) -> list[FloatArray]:
        """Return the forces of each curve at u."""
        if self._last[0] != (u.tobytes(), self._changes):
            config = self.config(u)
            forces = [self._force(config, u, prediction) for prediction in self.predictions]
            self._last = ((u.tobytes(), self._changes), forces)
        return self._last[1]

    @property
    def _changes(self) -> tuple[int, ...]:
        return tuple(each.changes for each in self.predictions)

    def residuals(self, u: FloatArray) -> FloatArray:
        """Return predicted minus measured force over the noise, curve after curve.

        Infinite where the model refuses the values or its contact is not found: the fit then steps less.
        """
        try:
            forces = self.forces(u)
        except (ValidationError, FitError):
            return np.full(sum(each.curve.time.size for each in self.predictions), np.inf)
        return np.concatenate(
            [
                (force - each.curve.force) / noise
                for force, each, noise in zip(forces, self.predictions, self.noise, strict=True)
            ]
        )

    def jacobian(self, u: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals, shape (rows, parameters)."""
        for _ in range(TRIES):
            forces, before = self.forces(u), self._changes
            columns = [self._column(i, u, forces) for i in range(u.size)]
            if self._changes == before:
                break
        if self._euler is not None:
            *others, last = self._euler
            whole = [f - self.offset(u, p.curve.name) for f, p in zip(forces, self.predictions, strict=True)]
            columns[last] = [
                force - sum((columns[i][k] for i in others), np.zeros(1)) for k, force in enumerate(whole)
            ]
        scaled = [
            np.concatenate([part / noise for part, noise in zip(column, self.noise, strict=True)])
            for column in columns
        ]
        return np.stack(scaled, axis=1)

    def _column(self, i: int, u: FloatArray, forces: list[FloatArray]) -> list[FloatArray]:
        """Differences of the forces to one parameter; zeros where Euler's theorem gives them."""
        parameter = self.parameters[i]
        if self._euler is not None and i == self._euler[-1]:
            return [np.zeros(1) for _ in forces]
        moved = u.copy()
        step = STEP if parameter.scale == "logarithmic" else LINEAR_STEP * self._range(parameter)
        moved[i] += step if u[i] + step <= self.bounds[1][i] else -step
        try:
            config = self.config(moved)
        except ValidationError:  # a bound that depends on another parameter
            moved[i] = 2 * u[i] - moved[i]
            config = self.config(moved)
        column = []
        for force, prediction in zip(forces, self.predictions, strict=True):
            if parameter.curve not in {"", prediction.curve.name}:
                column.append(np.zeros(force.size))
            elif parameter.key == "force_offset":
                column.append(np.ones(force.size))
            else:
                column.append((self._force(config, moved, prediction) - force) / (moved[i] - u[i]))
        return column

    def _range(self, parameter: Parameter) -> float:
        low, high = parameter.bounds
        return high - low

    def _force(self, config: Config, u: FloatArray, prediction: Prediction) -> FloatArray:
        self.solutions += 1
        name = prediction.curve.name
        return prediction.force(config, **self._motion(u, name)) + self.offset(u, name)

    def _motion(self, u: FloatArray, curve: str) -> dict[str, float]:
        """Contact point and drift of a curve, where they are free."""
        return {
            each.key: float(u[i])
            for i, each in enumerate(self.parameters)
            if each.key in {"contact_point", "drift"} and each.curve in {"", curve}
        }

    def offset(self, u: FloatArray, curve: str) -> float:
        """Return the offset of the force of a curve."""
        return sum(
            float(u[i])
            for i, each in enumerate(self.parameters)
            if each.key == "force_offset" and each.curve in {"", curve}
        )

    @cached_property
    def _of_the_model(self) -> list[Parameter]:
        return [each for each in self.parameters if each.key not in OF_A_CURVE]

    def _fixed(self, key: str) -> float:
        return self.model.keys[key]

    @cached_property
    def _euler(self) -> list[int] | None:
        """The free moduli, where they are all moduli of the body and nothing else might be one."""
        free = {each.key: i for i, each in enumerate(self.parameters)}
        found = []
        for key, value in self.model.keys.items():
            last = key.rpartition(".")[2]
            if last in MODULI and np.isfinite(value) and value != 0:
                if key not in free:
                    return None
                found.append(free[key])
            elif last not in MODULI | NO_MODULI and not key.startswith("punch."):
                return None
        return found or None


# What is impossible or odd about curves together with a model: units mixed up, depths beyond the layer.

ODD, MIXED = 1e2, 1e6  # factors between the moduli of the model and of the data: warned of, refused
WIDEST = 100.0  # contact radius over thickness beyond which lengths are of different units
STRAIN = 0.3  # depth over thickness, or over the radius of a sphere, beyond which linear theory is doubtful


def depths(curves: Sequence[ForceCurve], parameters: Sequence[Parameter]) -> dict[str, float]:
    """Return the largest depth of each curve below the contact point at which its fit starts."""
    points = {each.curve: each.start for each in parameters if each.key == "contact_point"}
    return {
        curve.name: max(float(curve.depth.max()) - points.get(curve.name, points.get("", 0.0)), 0.0)
        for curve in curves
    }


def refuse_impossible(reached: Mapping[str, float], model: Model) -> None:
    """Refuse depths beyond a layer that a stiffer base carries, and contacts far wider than it is thick."""
    reasons = []
    thickness, stiff_base = _thickness(model)
    radius = model.keys.get("punch.radius", 0.0)
    for name, depth in reached.items():
        if (contact := min(math.sqrt(radius * depth), radius)) > WIDEST * thickness:
            reasons.append(
                f"curve {name}: a radius of {radius:.4g} and a depth of {depth:.4g} make a contact of about "
                f"{contact:.4g}, {contact / thickness:.2g} thicknesses of the layer; must be at most "
                f"{WIDEST:g}: are the units of lengths the same?"
            )
        if stiff_base and depth >= thickness:
            reasons.append(
                f"curve {name}: reaches {depth:.4g} below its first contact, beyond the layer of "
                f"thickness {thickness:.4g}; must stay within it: is a unit, the thickness or the contact "
                "point wrong?"
            )
    if reasons:
        raise CurveError("\n".join(reasons))


def warnings_before(
    curves: Sequence[ForceCurve], reached: Mapping[str, float], model: Model, factor: float
) -> Iterator[str]:
    """Yield what is odd about curves under a model."""
    thickness, _ = _thickness(model)
    radius = model.keys.get("punch.radius", np.inf)
    for curve in curves:
        yield from (f"curve {curve.name}: {warning}" for warning in curve.warnings())
        depth = reached[curve.name]
        for size, name in ((thickness, "thickness of the layer"), (radius, "radius of the punch")):
            if STRAIN * size < depth:
                yield (
                    f"curve {curve.name}: the depth reaches {depth / size:.2g} of the {name}; linear theory "
                    f"is doubtful beyond {STRAIN:g}"
                )
    if not 1 / ODD < factor < ODD:
        yield _other_modulus(model, factor)


def refuse_mixed_units(model: Model, factor: float) -> None:
    """Refuse forces that ask for moduli of another order than those of the model: units are mixed up."""
    if not 1 / MIXED < factor < MIXED:
        raise FitError(_other_modulus(model, factor))


def _other_modulus(model: Model, factor: float) -> str:
    key, modulus = next((k, v) for k, v in model.keys.items() if k.rpartition(".")[2] in MODULI)
    return (
        f"the forces ask for moduli {factor:.2g} times those of the model ({key} = {modulus:g} would be "
        f"{modulus * factor:.3g}): are the units of force, depth, punch and moduli the same?"
    )


def _thickness(model: Model) -> tuple[float, bool]:
    """Return the thickness above the halfspace, and whether the halfspace is stiffer than the layer."""
    keys = [key for key in model.keys if key.endswith(".thickness")]
    thickness = sum(model.keys[key] for key in keys)
    base = model.keys.get("halfspace.shear_modulus", 0.0)
    moduli = [
        value
        for key, value in model.keys.items()
        if key.startswith("layer") and key.rpartition(".")[2] in MODULI
    ]
    return thickness, base > max(moduli, default=0.0)
