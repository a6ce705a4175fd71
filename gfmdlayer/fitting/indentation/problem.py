"""The least-squares problem: the forces of a model, its free parameters, residuals and their derivatives.

The fit varies the vector u. A modulus, a time or a length enters by its logarithm; Poisson's ratios,
exponents and values of a curve enter directly. An instantaneous modulus Ginf enters by the logarithm of
Ginf - G0 of the same material, so that no step of the fit makes a material that stiffens with time. Residuals
are predicted minus measured forces over the noise of the curve.

Values of a curve correct its columns: depth = measured depth - contact_point - drift (t - t_first),
force = measured force - force_offset.

Derivatives are forward differences. Two are exact and need no solution: the derivative to an offset of the
force, and, where all moduli of the body are free, the derivative to the last modulus: the force is of first
degree in the moduli (Euler), sum_k dF/d(ln G_k) = F.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError
from scipy.interpolate import PchipInterpolator

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import Config, ConfigError
from gfmdlayer.config.model import explain
from gfmdlayer.config.sweeps import assigned
from gfmdlayer.fitting.indentation.curve import CurveError, Drive, ForceCurve
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.indentation.indent import as_revolution
from gfmdlayer.indentation.model import IsolatedContact
from gfmdlayer.indentation.solve import History, LeftGridError, Space, find_space, make_space, on_halved_steps
from gfmdlayer.validation.problems import shown, unknown_key

# The force of a model at the rows of a measured curve.
#
# A fit chooses the times of the solution once, so that the force depends smoothly on the parameters: between
# two corners of the depth the times are fixed fractions of the piece, or of its rest after first contact.
# They are denser where the force bends, which evens out the errors of interpolation (de Boor 1973) and of the
# solution.

STEPS = 32  # of a mesh; each piece has at least FEWEST
FEWEST = 2
TRIAL = 10  # steps in each piece for the first solution, which shows where the force bends
ONSET = 1.5  # F grows with this power of the depth
WIDER = 1.3  # factor by which the nodes are extended when a contact grows beyond them
EVEN = 0.3  # fraction of the steps that is spread evenly over the time


class Prediction:
    """Forces under the depth of a measured curve."""

    def __init__(self, curve: ForceCurve) -> None:
        self.curve = curve
        self.drive = Drive.of(curve.time, curve.depth)
        self._parts = [np.linspace(0, 1, TRIAL + 1)] * (self.drive.time.size - 1)
        self._space: Space | None = None
        self.changes = 0  # of times and nodes; forces before and after a change must not be compared

    def adapt(self, config: Config, contact_point: float = 0.0, drift: float = 0.0) -> None:
        """Choose the times by the bends of the force of a model, and the nodes by its lengths."""
        self._space, self.changes = None, self.changes + 1
        drive = self.drive.corrected(contact_point, drift)
        self._parts = [np.linspace(0, 1, TRIAL + 1)] * len(self._parts)
        times, force = self._solution(config, drive)
        if times.size > 2 and np.ptp(force) > 0:
            self._parts = _graded(times, force, drive)

    def force(self, config: Config, contact_point: float = 0.0, drift: float = 0.0) -> FloatArray:
        """Return the force at the rows of the curve, without an offset."""
        drive, rows = self.drive.corrected(contact_point, drift), self.curve.time
        times, force = self._solution(config, drive)
        found = np.zeros(rows.size)
        edges = [times[0], *(time for time in drive.breakpoints if time > times[0])]
        for first, last in pairwise(edges):
            inside = (rows >= first) & (rows <= last)
            nodes = (times >= first) & (times <= last)
            found[inside] = _interpolated(times[nodes], force[nodes], rows[inside])
        return found

    def _solution(self, config: Config, drive: Drive) -> tuple[FloatArray, FloatArray]:
        """Return times and forces from the first contact on."""
        times = _mesh(drive, self._parts)
        body, profile = IsolatedContact(config).body, as_revolution(config.punch)
        history = History(times, np.interp(times, drive.time, drive.depth))
        if not history.value.max() > 0:
            return times, np.zeros(times.size)
        while True:
            space = self._space = self._space or find_space(body, profile, history)
            try:
                return times, on_halved_steps(body, space, profile, history, times).force[::2]
            except LeftGridError:
                self._space = make_space(space.features, min(WIDER * space.nodes.reach, profile.rim))
                self.changes += 1
            except ArithmeticError as error:
                raise FitError(f"curve {self.curve.name}: {error}") from error


def _mesh(drive: Drive, parts: list[FloatArray]) -> FloatArray:
    """Return the times of a mesh, from the first contact on."""
    first, begin = drive.first_contact
    times = []
    for piece in range(first, len(parts)):
        end = drive.time[piece + 1]
        times.append(begin + (end - begin) * parts[piece][:-1])
        begin = end
    return np.append(np.concatenate(times), drive.time[-1])


def _interpolated(times: FloatArray, force: FloatArray, rows: FloatArray) -> FloatArray:
    """Interpolate F^(2/3), which is smooth where a sphere touches, until the contact opens.

    From the last two times in contact, F^(2/3) is extended linearly to zero, at most to the next time. So the
    result stays continuous when a further time gets a small contact force.
    """
    root = np.maximum(force, 0.0) ** (1 / ONSET)
    touching = np.flatnonzero(root > 0)
    if touching.size < 2:
        return np.asarray(np.interp(rows, times, force))
    last = int(touching[-1])
    if last < times.size - 1 and root[last] < root[last - 1]:
        pace = (root[last - 1] - root[last]) / (times[last] - times[last - 1])
        leaves = min(times[last] + root[last] / pace, times[last + 1])
        times, root = np.append(times[: last + 1], leaves), np.append(root[: last + 1], 0.0)
    inside = rows <= times[-1]
    found = np.zeros(rows.size)
    found[inside] = np.maximum(PchipInterpolator(times, root)(rows[inside]), 0.0) ** ONSET
    return found


def _graded(times: FloatArray, force: FloatArray, drive: Drive) -> list[FloatArray]:
    """Return the fractions of each piece at which the error of interpolation is even."""
    first, begin = drive.first_contact
    root = np.maximum(force, 0.0) ** (1 / ONSET)
    slope = np.diff(root) / np.diff(times)
    bend = np.abs(np.diff(slope)) / (times[2:] - times[:-2]) / np.ptp(root)
    bend[np.isin(times[1:-1], drive.time)] = 0.0  # a corner of the depth is a node
    bend = np.concatenate((bend[:1], bend, bend[-1:]))
    density = np.sqrt(np.maximum(bend[1:], bend[:-1]))
    density += EVEN * np.sum(density * np.diff(times)) / np.ptp(times) + 1e-300
    level = np.concatenate(([0.0], np.cumsum(density * np.diff(times))))
    parts = [np.linspace(0, 1, FEWEST + 1)] * (drive.time.size - 1)
    for piece in range(first, len(parts)):
        end = drive.time[piece + 1]
        low, high = np.interp([begin, end], times, level)
        steps = max(FEWEST, round(STEPS * (high - low) / level[-1]))
        inner = np.interp(np.linspace(low, high, steps + 1), level, times)
        parts[piece] = np.clip((inner - begin) / (end - begin), 0.0, 1.0)
        parts[piece][[0, -1]] = 0.0, 1.0
        begin = end
    return parts


# The free parameters: keys of the model and values of a curve, their bounds and scales.

OF_A_CURVE = ("contact_point", "drift", "force_offset")
SECTIONS = ("name", "units", "grid", "layer", "layers", "halfspace", "punch", "temperature", "shift")
LINEAR: Mapping[str, tuple[float, float]] = {
    "poisson": (-0.99, 0.5),
    "exponent": (0.01, 1.0),
    "alpha": (0.01, 1.0),
}
WIDE = 1e4  # default bounds of other parameters: the start over this factor, and times this factor

Bounds = tuple[float, float]
Free = Sequence[str] | Mapping[str, Sequence[float] | None]


class Model:
    """Body and indenter: a configuration whose numbers are set by keys such as layers[0].material.G0."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        if foreign := [key for key in data if key not in SECTIONS]:
            raise ConfigError([f"{key}: {unknown_key(key, SECTIONS, ())}" for key in foreign])
        grid = {"geometry": "axisymmetric"} | dict(data.get("grid") or {})
        # The curves prescribe the depth; the default depth may be impossible for this body.
        given = {"name": "indentation"} | dict(data) | {"grid": grid, "trajectory": {"depth": 0.0}}
        try:
            self.config = Config.model_validate(given)
        except ValidationError as error:
            raise ConfigError(map(str, explain(error))) from None
        self._data = self.config.model_dump(exclude_none=True)
        self.keys = dict(_numbers(self._data))

    def with_values(self, values: dict[str, float]) -> Config:
        """Return the configuration in which the dotted keys have these values."""
        elastic = {
            f"{key[:-2]}Ginf": value for key, value in values.items() if f"{key[:-2]}Ginf" in self._elastic
        }
        dotted = {key.replace("[", ".").replace("]", ""): value for key, value in (elastic | values).items()}
        return Config.model_validate(assigned(self._data, dotted))

    @cached_property
    def _elastic(self) -> set[str]:
        """Instantaneous moduli that equal G0: these materials stay elastic where only G0 is free."""
        ends = {key: f"{key[:-4]}G0" for key in self.keys if key.endswith(".Ginf")}
        return {key for key, other in ends.items() if self.keys[key] == self.keys[other]}


@dataclass(frozen=True)
class Parameter:
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
        return "linear" if own else "logarithmic"


def free_parameters(
    model: Model, free: Free, curves: Sequence[str], spans: Mapping[str, Bounds]
) -> list[Parameter]:
    """Return the free parameters of a fit; `spans` has the default bounds of the values of a curve."""
    asked = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    wrong, found = [], []
    if not asked:
        raise ConfigError(["free: got no parameter; give at least one key, such as layer.material.G0"])
    for key, bounds in asked.items():
        if key in OF_A_CURVE:
            owners = list(curves) if len(curves) > 1 else [""]
            found += [Parameter(key, 0.0, _bounds(bounds, spans[key]), owner) for owner in owners]
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
            found.append(Parameter(key, start, _bounds(bounds, default), "", above))
    for each in found:
        low, high = each.bounds
        if not low < high or (each.scale == "logarithmic" and low <= 0):
            wrong.append(f"free: {each.key}: the bounds are {low:g} and {high:g}; give 0 < low < high")
        elif each.key not in OF_A_CURVE and not low <= each.start <= high:
            wrong.append(f"free: {each.key}: the start {each.start:g} is not between {low:g} and {high:g}")
    if wrong:
        raise ConfigError(wrong)
    return found


def _bounds(given: Sequence[float] | None, default: Bounds) -> Bounds:
    return default if given is None else (float(given[0]), float(given[1]))


def _numbers(data: Any, at: str = "") -> Iterator[tuple[str, float]]:
    """Yield the dotted keys of all numbers of the layers, the halfspace and the punch."""
    items: Any = enumerate(data) if isinstance(data, (list, tuple)) else data.items()
    for key, value in items:
        place = f"{at}[{key}]" if isinstance(key, int) else f"{at}.{key}".lstrip(".")
        if isinstance(value, (Mapping, list, tuple)):
            if at or key in {"layer", "layers", "halfspace", "punch"}:
                yield from _numbers(value, place)
        elif at and isinstance(value, (int, float)) and not isinstance(value, bool):
            yield place, float(value)


TRIES = 3  # the differences are repeated when the nodes changed on the way, at most so often
# Steps of the differences, in a logarithm and in the range of a linear parameter: a derivative is off by half
# a step. At the row where the contact opens a force may jump by 1e-4 of the largest one; a shorter step would
# take the jump for a derivative.
STEP, LINEAR_STEP = 5e-3, 2e-3
MODULI = {"G0", "Ginf", "G", "shear_modulus"}
NO_MODULI = {*"tau thickness poisson exponent alpha gamma radius slope angle width face".split()}  # noqa: SIM905


class LeastSquares:
    """Residuals of curves under a model."""

    def __init__(
        self, model: Model, parameters: Sequence[Parameter], predictions: Sequence[Prediction]
    ) -> None:
        self.model, self.parameters, self.predictions = model, list(parameters), list(predictions)
        # Standard deviation of the force of each curve, by which its residuals are divided.
        self.noise = np.array([each.curve.noise or np.abs(each.curve.force).max() for each in predictions])
        self.solutions = 0  # number of solved contact problems, each over a whole curve
        self._last: tuple[object, list[FloatArray]] = (None, [])

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of u."""
        low, high = np.array([each.bounds for each in self.parameters]).T.copy()
        for i, each in enumerate(self.parameters):
            if each.above:  # u is ln(Ginf - G0); with G0 free a lower bound of Ginf is no bound of u
                base = self.model.keys[each.above]
                is_free = any(other.key == each.above for other in self.parameters)
                smallest = max(each.start - base, 0.1 * base) / WIDE
                low[i] = smallest if is_free else max(low[i] - base, smallest)
                high[i] = high[i] if is_free else high[i] - base
            if each.scale == "logarithmic":
                low[i], high[i] = np.log(low[i]), np.log(high[i])
        return low, high

    @cached_property
    def start(self) -> FloatArray:
        """The u at which the fit starts, within the bounds."""
        values = {each.name: each.start for each in self.parameters}
        return np.clip(self.coordinates(values), *self.bounds)

    def values(self, u: FloatArray) -> dict[str, float]:
        """Return the parameters at u, by name."""
        found: dict[str, float] = {}
        for each, at in zip(self.parameters, u.tolist(), strict=True):
            found[each.name] = float(np.exp(at)) if each.scale == "logarithmic" else at
        for each in self.parameters:
            if each.above:
                found[each.name] += found.get(each.above, self.model.keys[each.above])
        return found

    def coordinates(self, values: Mapping[str, float]) -> FloatArray:
        """Return the u of parameters."""
        u = np.empty(len(self.parameters))
        for i, each in enumerate(self.parameters):
            value = values[each.name]
            if each.above:
                base = values.get(each.above, self.model.keys[each.above])
                value = max(value - base, 0.1 * base)
            u[i] = np.log(value) if each.scale == "logarithmic" else value
        return u

    def reported(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the parameters on their scales, logarithmic or linear, and their derivatives to u."""
        values = self.values(u)
        found, slopes = u.copy(), np.eye(u.size)
        for i, each in enumerate(self.parameters):
            if not each.above:
                continue
            value, base = values[each.name], values.get(each.above, self.model.keys[each.above])
            found[i], slopes[i, i] = np.log(value), 1 - base / value
            if each.above in values:
                slopes[i, [p.name for p in self.parameters].index(each.above)] = base / value
        return found, slopes

    def config(self, u: FloatArray) -> Config:
        """Return the configuration at u."""
        values = self.values(u)
        own = [each for each in self.parameters if each.key not in OF_A_CURVE]
        return self.model.with_values({each.key: values[each.name] for each in own})

    def adapt(self, u: FloatArray) -> None:
        """Choose the times of the solutions for the forces at u."""
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

        Infinite where the values are impossible or the contact is not found: the fit then steps less.
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
        """Derivative of the forces to one parameter; zeros for the one that follows from Euler's theorem."""
        parameter = self.parameters[i]
        if self._euler is not None and i == self._euler[-1]:
            return [np.zeros(1) for _ in forces]
        moved = u.copy()
        low, high = parameter.bounds
        step = STEP if parameter.scale == "logarithmic" else LINEAR_STEP * (high - low)
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
    def _euler(self) -> list[int] | None:
        """The free moduli, if all moduli of the body are free; None otherwise, or if a key is not known."""
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


# Checks of curves with a model: mixed units, depths beyond the layer.

ODD, MIXED = 1e2, 1e6  # factor between the moduli of model and data: a warning, an error
WIDEST = 100.0  # contact radius over thickness; beyond it the lengths have different units
STRAIN = 0.3  # depth over thickness, or over the radius of a sphere; beyond it linear theory is doubtful


def depths(curves: Sequence[ForceCurve], parameters: Sequence[Parameter]) -> dict[str, float]:
    """Return the largest depth of each curve below the contact point from which its fit starts."""
    points = {each.curve: each.start for each in parameters if each.key == "contact_point"}
    return {
        curve.name: max(float(curve.depth.max()) - points.get(curve.name, points.get("", 0.0)), 0.0)
        for curve in curves
    }


def refuse_impossible(reached: Mapping[str, float], model: Model) -> None:
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


def warnings_before(
    curves: Sequence[ForceCurve], reached: Mapping[str, float], model: Model, factor: float
) -> Iterator[str]:
    """Yield warnings about curves under a model; its moduli times `factor` fit the force."""
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
    """Reject forces that need moduli of another order than the model has: the units differ."""
    if not 1 / MIXED < factor < MIXED:
        raise FitError(_other_modulus(model, factor))


def _other_modulus(model: Model, factor: float) -> str:
    key, modulus = next((k, v) for k, v in model.keys.items() if k.rpartition(".")[2] in MODULI)
    return (
        f"the forces need moduli {factor:.2g} times larger than in the model ({key} = {modulus * factor:.3g} "
        f"instead of {modulus:g}). Do force, depth, punch and moduli have the same units?"
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
