"""A voltage across a uniform gap, and the snap that its theory predicts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gfmdlayer

THICKNESS, POISSON = 0.05, 0.3
STIFFNESS = 2 * (1 - POISSON) / ((1 - 2 * POISSON) * THICKNESS)  # of a bonded layer of G = 1, per area
GAP, H0 = 0.004, 0.001
PULL_IN = (8 * STIFFNESS * (GAP + H0) ** 3 / 27) ** 0.5  # with a permittivity of 1
FILM: dict[str, Any] = {
    "grid": {"points": 32},
    "layer": {"thickness": THICKNESS, "poisson": POISSON, "material": {"model": "elastic", "G": 1.0}},
    "halfspace": {"shear_modulus": np.inf},
}


def under(volts: Any, **keys: Any) -> Any:
    """Run a flat plate at a gap under a voltage."""
    law = {"law": "electrostatic", "voltage": volts, "insulation": H0, "permittivity": 1.0}
    rest = [(0.0, -GAP), (1.0, -GAP)]
    return gfmdlayer.run(FILM | keys, interface=law, punch=np.zeros(32), history=rest)


def test_a_film_snaps_at_the_pull_in_voltage() -> None:
    ramp = [(0.0, 0.0), (1.0, 1.2 * PULL_IN)]
    found = under(ramp, time={"end": 1.0, "step": "adaptive"})
    snap = int(np.argmax(found.contact_area.to_numpy() > 0))
    before, after = 1.2 * found.time.to_numpy()[[snap - 1, snap]]
    # The steps land beside the instability.
    assert 0.999 < before < 1 < after < 1.001


@pytest.mark.parametrize("part", [0.3, 0.9, -0.9])
def test_below_it_stress_and_field_balance(part: float) -> None:
    volts = part * PULL_IN
    found = under(volts, time={"end": 1.0, "step": 1.0})
    lifted = float(GAP - found.mean_gap[-1])
    field = 0.5 * volts**2 / (GAP + H0 - lifted) ** 2
    # The residual, 1e-6, is relative to the largest traction, which the law has in contact.
    bound = 1e-6 * 0.5 * volts**2 / H0**2
    assert STIFFNESS * lifted == pytest.approx(field, abs=bound)
    assert float(found.mean_stress[-1]) == pytest.approx(-field, abs=bound)
