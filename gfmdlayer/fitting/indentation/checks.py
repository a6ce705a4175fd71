"""What is impossible or odd about curves together with a model: units mixed up, depths beyond the layer."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from gfmdlayer.fitting.indentation.curve import CurveError, ForceCurve
from gfmdlayer.fitting.indentation.parameters import Model, Parameter
from gfmdlayer.fitting.indentation.problem import MODULI
from gfmdlayer.fitting.measurement import FitError

ODD, MIXED = 1e2, 1e6  # factors between the moduli of the model and of the data: warned of, refused
WIDE = 100.0  # contact radius over thickness beyond which lengths are of different units
STRAIN = 0.3  # depth over thickness, or over the radius of a sphere, beyond which linear theory is doubtful


def depths(curves: Sequence[ForceCurve], parameters: Sequence[Parameter]) -> dict[str, float]:
    """Return the largest depth of each curve below the contact point at which its fit starts."""
    points = {each.curve: each.start for each in parameters if each.key == "contact_point"}
    return {
        curve.name: max(float(curve.depth.max()) - points.get(curve.name, points.get("", 0.0)), 0.0)
        for curve in curves
    }


def refuse_impossible(reached: Mapping[str, float], model: Model) -> None:
    """Refuse depths beyond a layer that a stiffer base carries, and contacts far wider than it is thick.

    Parameters
    ----------
    reached : mapping of str to float
        Largest depth of each curve.
    model : Model
        Body and indenter.

    Raises
    ------
    CurveError
        Naming each curve.
    """
    reasons = []
    thickness, stiff_base = _thickness(model)
    radius = model.keys.get("punch.radius", 0.0)
    for name, depth in reached.items():
        if (contact := min(math.sqrt(radius * depth), radius)) > WIDE * thickness:
            reasons.append(
                f"curve {name}: a radius of {radius:.4g} and a depth of {depth:.4g} make a contact of about "
                f"{contact:.4g}, {contact / thickness:.2g} thicknesses of the layer; must be at most "
                f"{WIDE:g}: are the units of lengths the same?"
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
    """Yield what is odd about curves under a model.

    Parameters
    ----------
    curves : sequence of ForceCurve
        The curves.
    reached : mapping of str to float
        Largest depth of each curve.
    model : Model
        Body and indenter, where the fit starts.
    factor : float
        By which its moduli must be multiplied to fit the force.
    """
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
    """Refuse forces that ask for moduli of another order than those of the model: units are mixed up.

    Raises
    ------
    FitError
        The factor is beyond `MIXED`.
    """
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
