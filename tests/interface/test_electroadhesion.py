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


def test_before_the_voltage_a_film_in_metres_rests() -> None:
    # Rounding of the gap is 1e-21 m here: its squares are below single precision.
    waves = {"shape": "sinusoid", "amplitude": 1e-6, "wavelength": 2.5e-4}
    law = {"law": "electrostatic", "insulation": 1e-5, "voltage": [(0.0, 0.0), (0.1, 0.0), (0.2, 100.0)]}
    found = gfmdlayer.run(
        {
            "units": {"length": "m", "stress": "Pa", "time": "s"},
            "grid": {"points": 256, "period": 2.5e-4},
            "layer": {"thickness": 1e-4, "poisson": 0.45, "material": {"G0": 2e4, "Ginf": 2e5, "tau": 1}},
            "halfspace": {"shear_modulus": np.inf},
            "punch": waves,
            "time": {"end": 0.1, "step": "adaptive"},
        },
        interface=law,
        history=[(0.0, -1.2e-5), (0.1, -8e-6)],
    )
    assert float(abs(found.mean_stress).max()) <= 1e-6
