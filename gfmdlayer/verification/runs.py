"""Runs of the paper's default case with some values changed, in memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Unpack

import numpy as np

from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.case.parts import Given
from gfmdlayer.config import Config
from gfmdlayer.results.recording import Recording

HALFSPACE: dict[str, object] = {"layer.thickness": 0.0}  # of G_bulk = 1: elastic, E* = 4
ALONE: dict[str, object] = {"layer.thickness": float("inf")}
RIGID: dict[str, object] = {"halfspace.shear_modulus": float("inf")}
ELASTIC: dict[str, object] = {"layer.material.Ginf": 1.0}
ONE_STEP: dict[str, object] = {"time.end": 1.0, "time.step": 1.0}


def run(*values: Mapping[str, object], **parts: Unpack[Given]) -> Recording:
    """Run the paper's default case with these dotted values, later ones before earlier ones.

    `parts` replace parts of the case.
    """
    config = Config(name="verification").with_values({key: each[key] for each in values for key in each})
    recording = Recording()
    simulate(Case(config, **parts), recording)
    return recording


def there_and_back(
    start: float, depth: float, final: float, approach: float, retract: float = 0.0, dwell: float = 0.0
) -> dict[str, object]:
    """Return the trajectory of an approach and a retraction, by default at the same speed."""
    way = {"kind": "approach_retract", "start": start, "depth": depth, "final": final, "dwell": dwell}
    return way | {"approach_speed": approach, "retract_speed": retract or approach}


def exponential(work: float, reach: float) -> dict[str, object]:
    """Return the law of an attraction that decays exponentially over a range."""
    return {"law": "exponential", "work": work, "range": reach}


def adaptive(tolerance: float, **more: object) -> dict[str, object]:
    """Return the section `time` of adaptive steps."""
    return {"time": {"step": "adaptive", "tolerance": tolerance, **more}}


def difference(computed: Recording, reference: Recording, column: str = "mean_pressure") -> float:
    """Largest difference of a column, relative to the largest value of the reference."""
    exact = reference[column]
    return float(np.abs(computed[column] - exact).max() / exact.max())
