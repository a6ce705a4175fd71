"""What a run itself says about the accuracy of its numbers, without a second run.

    area            contact_area_error over contact_area_interpolated, where this is largest
    steps           tolerance of adaptive steps: the largest error of a step
    residual        largest residual of a step
    balance         largest residual of the energies over the work
    contact_points  most points in contact
    wave_points     points for the shortest wave of a rough surface
    fit             error of the compliance of an isolated body
    slope           largest slope of the punch down to the largest depth
    strain          largest mean pressure in contact over 2 G(t), or the depth over the thickness of all
                    layers, whichever is less

Neither equations nor variations see slopes and strains beyond small ones: linear elasticity holds for those.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gfmdlayer.observables.numerics import ACCURACY_PREFIX

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.case.model import Model
    from gfmdlayer.config import Config
    from gfmdlayer.results.recording import Recording

MOST_TIMES = 64  # at which the modulus is computed


def accuracy(model: Model, recording: Recording) -> dict[str, float]:
    """Return the attributes of a case, known from its rows and its configuration."""
    if not recording.count:
        return {}
    import numpy as np

    config, held = model.config, recording.widths
    found: dict[str, Any] = {}
    for area, error in _AREAS:
        if area in held and (areas := recording[area]).max() > 0:
            at = int(np.argmax(areas))
            found["area"] = recording[error][at] / areas[at]
    found["steps"] = config.time.tolerance
    if "residual" in held:
        found["residual"] = _largest(recording["residual"])
    if "energy_residual" in held and (work := _largest(recording["work"])) > 0:
        found["balance"] = _largest(recording["energy_residual"]) / work
    if points := recording.noted.get("most_contact_points"):
        found["contact_points"] = points
    if (waves := getattr(config.punch, "short_cutoff", None)) is not None and model.grid is not None:
        spacings = (L / n for L, n in zip(config.grid.period, config.grid.points, strict=True))
        found["wave_points"] = waves / max(spacings)
    found["fit"] = model.attributes.get("fit_error")
    found |= strains(config, {name: recording[name] for name in _READ & held.keys()})
    parts = getattr(model, "parts", None)
    if parts is not None and parts.grid.ranks.count == 1:
        grid = parts.grid
        spacing = [L / n for L, n in zip(grid.period, grid.points, strict=True)]
        found["slope"] = steepest(parts.punch.reshape(grid.shape), spacing, _largest(recording["depth"]))
    return {f"{ACCURACY_PREFIX}{name}": float(value) for name, value in found.items() if value is not None}


_AREAS = ("contact_area_interpolated", "contact_area_error"), ("area_interpolated", "area_error")
_READ = {"time", "contact_area", "mean_stress", "area", "force", "contact_radius", "depth"}


def strains(config: Config, columns: Mapping[str, FloatArray]) -> dict[str, float]:
    """Return the largest strain, or nothing of a geometry without a contact area."""
    import numpy as np

    if "contact_area" in columns:
        force, area = columns["mean_stress"], columns["contact_area"]
    elif "area" in columns:
        force, area = columns["force"], columns["area"]
    elif "contact_radius" in columns:
        force, area = columns["force"], math.pi * columns["contact_radius"] ** 2
    else:
        return {}
    touching = np.flatnonzero(area > 0)
    if not touching.size or not config.laws:
        return {}
    chosen = touching[np.unique(np.linspace(0, touching.size - 1, MOST_TIMES).astype(int))]
    moduli = np.asarray(config.laws[0].relaxation_modulus(columns["time"][chosen]), float)
    pressure = np.abs(force[chosen] / area[chosen])
    strain = float(np.nanmax(np.where(moduli > 0, pressure / (2 * np.where(moduli > 0, moduli, 1.0)), 0.0)))
    thickness = sum(config.solid.thicknesses)
    limited = _largest(columns["depth"]) / thickness if 0 < thickness < math.inf else math.inf
    return {"strain": min(strain, limited)}


def steepest(heights: FloatArray, spacing: list[float], depth: float) -> float:
    """Return the largest slope between neighbours that both lie within a depth of the lowest point."""
    import numpy as np

    most, within = 0.0, heights <= max(depth, 0.0) + float(heights.min())
    for axis, step in enumerate(spacing):
        beside = within & np.roll(within, -1, axis)
        rises = np.abs(np.roll(heights, -1, axis) - heights)[beside]
        most = max(most, float(rises.max(initial=0.0)) / step)
    return most


def _largest(values: FloatArray) -> float:
    import numpy as np

    return float(np.nanmax(np.abs(values), initial=0.0))
