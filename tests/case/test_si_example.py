"""The example in SI units: a steel sphere on a rubber coating, against an isolated indentation."""

import math
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer import indent
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.config import load
from tests.recordings import Kept

CONFIG = Path(__file__).parents[2] / "configs" / "rubber-coating-quick.yaml"


def test_force_and_radius_are_those_of_an_isolated_sphere():
    config, recording = load(CONFIG), Kept()
    case = Case(config)
    simulate(case, recording)
    depth, ramp = config.trajectory.depth, config.trajectory.ramp_time
    assert depth is not None and ramp is not None  # noqa: PT018
    alone = indent(
        case.body, config.punch.model_dump(), [0.0, ramp, config.time.end], depth=[0.0, depth, depth]
    )
    time = np.asarray(recording["time"])
    held = time >= ramp  # before, the contact is a few of the 64 points wide
    # Neighbours ten thicknesses away add nothing: the coating is at rest there, and -1.2415 F/(E* L), by
    # which they lower the steel, is 1e-5 of the depth. 19 points across the contact leave 0.3 %.
    force = np.interp(time, alone["time"], alone["force"])
    np.testing.assert_allclose(np.asarray(recording["force"])[held], force[held], rtol=0.01)
    radius = np.interp(time, alone["time"], alone["contact_radius"])
    area = np.asarray(recording["contact_area_interpolated"]) * config.grid.period[0] ** 2
    np.testing.assert_allclose(np.sqrt(area / np.pi)[held], radius[held], rtol=0.005)
    # Relaxed, an incompressible coating on a rigid base bears 5.1154 times the force of Hertz on its
    # material at (R depth)^(1/2) = thickness, by Abel transforms; it is within exp(-9) of relaxed.
    hertz = 16 / 3 * 1e6 * math.sqrt(5e-3) * depth**1.5
    assert math.sqrt(5e-3 * depth) == pytest.approx(config.layer.thickness)
    assert recording["force"][-1] == pytest.approx(5.1154 * hertz, rel=0.01)
