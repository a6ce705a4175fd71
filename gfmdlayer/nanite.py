"""Models of an elastic layer on a base for nanite, PyJibe, and other users of its interface.

    import gfmdlayer.nanite
    gfmdlayer.nanite.register()
    curve.fit_model(model_key="layer_sphere")

An indenter presses a bonded layer of thickness t, E and nu on a base of E_base and nu_base, without friction
and adhesion: the force is exact at any depth, see docs/theory/indentation.md. nanite fits one segment of
force over tip position, without time: fit moduli that relax with `gfmdlayer.fit_indentation` on its curves.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.layers import bonded_layer
from gfmdlayer.indentation.solve import History, find_space, on_steps
from gfmdlayer.punch.revolution import Revolution, cone, paraboloid, sphere

DEPTHS = 48  # at which the force is computed; it is smooth between them
RIGID = 1e6  # a base this many times stiffer than the layer counts as rigid
GLASS = 70e9  # Young's modulus of the base by default

_PARAMETERS = {
    "E": ("Young's Modulus of the Layer", "Pa", 3e3),
    "t": ("Thickness of the Layer", "m", 10e-6),
    "E_base": ("Young's Modulus of the Base", "Pa", GLASS),
    "nu": ("Poisson's Ratio of the Layer", "", 0.5),
    "nu_base": ("Poisson's Ratio of the Base", "", 0.3),
    "contact_point": ("Contact Point", "m", 0.0),
    "baseline": ("Force Baseline", "N", 0.0),
}
# The profile of each indenter, its size, and the power of the depth of the force at first contact.
_INDENTERS: dict[str, tuple[Callable[[float], Revolution], tuple[str, str, str, float], float]] = {
    "sphere": (sphere, ("R", "Tip Radius", "m", 10e-6), 1.5),
    "paraboloid": (paraboloid, ("R", "Tip Radius", "m", 10e-6), 1.5),
    "cone": (
        lambda alpha: cone(1 / math.tan(math.radians(alpha))),
        ("alpha", "Half Cone Angle", "°", 25.0),
        2.0,
    ),
}


def register() -> list[str]:
    """Register the models with nanite, and return their keys: layer_sphere, layer_paraboloid, layer_cone."""
    from nanite.model import register_model

    return [register_model(model(shape)).model_key for shape in _INDENTERS]


def model(shape: str) -> SimpleNamespace:
    """Return the model of an indenter, sphere, paraboloid or cone, as nanite's interface asks for it."""
    if shape not in _INDENTERS:
        raise ValueError(f"shape: got {shape!r}; must be one of {', '.join(_INDENTERS)}")
    profile, (size, words, unit, start), power = _INDENTERS[shape]
    first = {key: _PARAMETERS[key] for key in ("E", "t", "E_base")}
    about = first | {size: (words, unit, start)} | _PARAMETERS

    def force(delta: FloatArray, *values: float, **named: float) -> FloatArray:
        parameters = dict(zip(about, values, strict=False)) | named
        at = {key: float(parameters.get(key, default)) for key, (_, _, default) in about.items()}
        depth = at.pop("contact_point") - np.asarray(delta, dtype=float)
        baseline, pressed = at.pop("baseline"), depth > 0
        total = baseline + 0.0 * depth  # NaN stays
        if pressed.any():
            E, punch = at["E"], profile(at[size])
            base = at["E_base"] / E if at["E_base"] < RIGID * E else math.inf
            body = at["t"], base, at["nu"], at["nu_base"]
            # The largest depth is rounded up, so that a moving contact point needs few solutions.
            deepest = _rounded(float(depth[pressed].max()))
            root = _root(deepest, body, (punch.rim, punch.sphere, *map(_numbers, punch[2:])), power)
            total[pressed] += E * root(depth[pressed]) ** power
        return total

    starts = {"delta": inspect.Parameter.empty, **{key: start for key, (_, _, start) in about.items()}}
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    parameters = [inspect.Parameter(key, kind, default=start) for key, start in starts.items()]
    force.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    force.__doc__ = f"Force [N] of a {shape} on an elastic layer on a base, over the tip position delta [m]."

    def defaults() -> Any:
        import lmfit

        parameters = lmfit.Parameters()
        for key, (_, _, default) in about.items():
            limits = {"min": 0.0, "max": 0.5} if key.startswith("nu") else {"min": 1e-12}
            limits |= {"max": 89.0} if key == "alpha" else {}
            if key in {"contact_point", "baseline"}:
                limits = {}
            parameters.add(key, value=default, vary=key in {"E", "contact_point", "baseline"}, **limits)
        return parameters

    return SimpleNamespace(
        get_parameter_defaults=defaults,
        model_doc=force.__doc__,
        model_func=force,
        model_key=f"layer_{shape}",
        model_name=f"{shape} on an elastic layer (gfmdlayer)",
        parameter_keys=list(about),
        parameter_names=[name for name, _, _ in about.values()],
        parameter_units=[unit for _, unit, _ in about.values()],
        valid_axes_x=["tip position"],
        valid_axes_y=["force"],
    )


def _rounded(depth: float) -> float:
    """Round a depth up to 1.05 to an integer power."""
    return 1.05 ** math.ceil(math.log(depth, 1.05) - 1e-9)


def _numbers(values: FloatArray) -> tuple[float, ...]:
    return tuple(values.tolist())


@lru_cache(maxsize=256)
def _root(
    deepest: float, body: tuple[float, float, float, float], profile: tuple[Any, ...], power: float
) -> Callable[[FloatArray], FloatArray]:
    """Return F^(1/power) over the depth, for a layer of E = 1."""
    t, E_base, nu, nu_base = body
    rim, radius, *pieces = profile
    punch = Revolution(rim, radius, *(np.array(each) for each in pieces))
    layer, base = 1 / (2 * (1 + nu)), E_base / (2 * (1 + nu_base))
    made = bonded_layer(t, layer, poisson=nu, halfspace=base, halfspace_poisson=nu_base)
    depths = deepest * np.linspace(0, 1, DEPTHS) ** 1.5
    history = History(depths / deepest, depths)
    force = on_steps(made, find_space(made, punch, history), punch, history, history.time).force
    root: Callable[[FloatArray], FloatArray] = PchipInterpolator(
        depths, np.maximum(force, 0.0) ** (1 / power)
    )
    return root
