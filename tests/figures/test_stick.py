"""Pictures of stick and slip show the contact that the run found, also beside an attraction."""

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.figures.field_plots import SLIP, STICK, stick_figure
from gfmdlayer.figures.snapshots import touching

ADHESIVE = {
    "layer": {"thickness": 0.1, "poisson": 0.45},
    "interface": [
        {"law": "shear_strength", "stress": 0.3},
        {"law": "exponential", "work": 5e-3, "range": 1e-2},
    ],
    "trajectory": {
        "depth": 0.001,
        "ramp_time": 0.2,
        "tangential": {"displacement": 0.003, "start": 0.2, "ramp_time": 0.2},
    },
    "time": {"end": 0.4, "step": 0.05},
    "output": {"snapshots": [0.0, 0.2, 0.3, 0.4]},
}


VOLTAGE = {
    "grid.points": [16, 16],
    "interface": [
        {"law": "electrostatic", "insulation": 0.02, "permittivity": 8e-3, "voltage": 0.3},
        {"law": "shear_strength", "stress": 0.3},
    ],
}
CASES = {"line": {"grid.points": 128}, "surface": {"grid.points": [32, 32]}, "voltage": VOLTAGE}


@pytest.fixture(scope="module", params=CASES)
def adhesive(request):
    return gfmdlayer.run(gfmdlayer.Config(name="stick").with_values(ADHESIVE | CASES[request.param]))


def test_stick_and_slip_of_an_adhesive_contact_cover_the_areas_of_the_rows(adhesive):
    """The pressure, that of the wall less the attraction, is negative in most of the contact."""
    rows = adhesive.sel(time=adhesive["snapshot"].to_numpy())
    assert (rows["mean_pressure"] < 0).all()
    figure = stick_figure(adhesive, every=True)
    if "y" in adhesive.dims:
        shown = [panel.images[0].get_array() for panel in figure.axes[:4]]
    else:
        shown = list(figure.axes[0].images[0].get_array())
    points = adhesive["gap"].isel(snapshot=0).size
    sticking, slipping = ([(part == state).sum() / points for part in shown] for state in (STICK, SLIP))
    np.testing.assert_allclose(sticking, rows["stick_area"], atol=1e-12)
    np.testing.assert_allclose(np.add(sticking, slipping), rows["contact_area"], atol=1e-12)
    assert max(sticking) > 0
    assert max(slipping) > 0


def test_pictures_agree_on_the_contact(adhesive):
    """The gap is zero where slip has a value, and nowhere else."""
    np.testing.assert_array_equal(touching(adhesive), touching(adhesive.drop_vars("slip_velocity_x")))
