"""What is impossible or odd about curves together with a model: units mixed up, depths beyond the layer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gfmdlayer.fitting.indentation.curve import CurveError, ForceCurve
from gfmdlayer.fitting.indentation.parameters import Model
from gfmdlayer.fitting.indentation.problem import MODULI

ODD = 1e3  # factor between the modulus of the model and that of the data, which is warned of
STRAIN = 0.3  # depth over thickness, or over the radius of a sphere, beyond which linear theory is doubtful


def refuse_impossible(curves: Sequence[ForceCurve], model: Model) -> None:
    """Refuse depths beyond a layer on a base that is stiffer than it, which the punch would have to pierce.

    Raises
    ------
    CurveError
        Naming each curve.
    """
    reasons = []
    thickness, stiff_base = _thickness(model)
    for curve in curves:
        depth = _reach(curve)
        if stiff_base and depth >= thickness:
            reasons.append(
                f"curve {curve.name}: reaches {depth:.4g} below its first contact, beyond the layer of "
                f"thickness {thickness:.4g}; must stay within it: is a unit, the thickness or the contact "
                "point wrong?"
            )
    if reasons:
        raise CurveError("\n".join(reasons))


def warnings_before(curves: Sequence[ForceCurve], model: Model, factor: float) -> Iterator[str]:
    """Yield what is odd about curves under a model.

    Parameters
    ----------
    curves : sequence of ForceCurve
        The curves.
    model : Model
        Body and indenter, where the fit starts.
    factor : float
        By which its moduli must be multiplied to fit the force.
    """
    thickness, _ = _thickness(model)
    radius = model.keys.get("punch.radius", np.inf)
    for curve in curves:
        yield from (f"curve {curve.name}: {warning}" for warning in curve.warnings())
        depth = _reach(curve)
        for size, name in ((thickness, "thickness of the layer"), (radius, "radius of the punch")):
            if STRAIN * size < depth:
                yield (
                    f"curve {curve.name}: the depth reaches {depth / size:.2g} of the {name}; linear theory "
                    f"is doubtful beyond {STRAIN:g}"
                )
    if not 1 / ODD < factor < ODD:
        key, modulus = next((k, v) for k, v in model.keys.items() if k.rpartition(".")[2] in MODULI)
        yield (
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


def _reach(curve: ForceCurve) -> float:
    """Return the depth below the surface, of a curve whose depth may begin before the contact."""
    return float(max(curve.depth.max(), 0.0))
