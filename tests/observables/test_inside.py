"""Columns of the largest stresses below the surface, and what `output.inside` refuses."""

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import ConfigError

RUN = {
    "layer": {"thickness": 0.03, "poisson": 0.3},
    "halfspace": {"shear_modulus": 0.2, "poisson": 0.4},
    "time": {"end": 0.4, "step": 0.1},
    "trajectory": {"depth": 0.004, "ramp_time": 0.2},
    "output": {"snapshots": [0.2, 0.4], "inside": {"depths": [0.0, 0.01, 0.03, 0.06], "every": 2}},
}
LINE, SURFACE = {"grid": {"points": 128}}, {"grid": {"points": [32, 24]}}


SHEARED = {
    "interface": {"law": "coulomb", "coefficient": 0.5},
    "trajectory": RUN["trajectory"] | {"tangential": {"displacement": 0.003, "ramp_time": 0.4}},
}


@pytest.mark.parametrize("grid", [LINE, SURFACE])
@pytest.mark.parametrize("motion", [{}, SHEARED])
def test_columns_are_the_extremes_of_the_fields(grid, motion):
    data = gfmdlayer.run(RUN | motion | grid)
    fields = gfmdlayer.inside(data, RUN["output"]["inside"]["depths"])
    assert np.isnan(data.largest_von_mises.values[[1, 3]]).all()
    assert np.isnan(data.largest_von_mises_x.values[0])  # nothing touches
    for time in (0.2, 0.4):
        row, at = data.sel(time=time), fields.sel(snapshot=time)
        assert np.isclose(row.largest_von_mises, at.von_mises.max(), rtol=1e-12)
        assert np.isclose(row.largest_shear_stress, at.largest_shear.max(), rtol=1e-7)
        axes = [name for name in "xy" if name in at.dims]
        place = {name: row[f"largest_von_mises_{name}"].item() for name in axes}
        depth = np.abs(at.z.values - row.largest_von_mises_z.item()) < 1e-12
        assert np.isclose(at.von_mises.sel(place).values[depth].max(), row.largest_von_mises, rtol=1e-12)
        interface = at.isel(z=2)
        assert row.interface.values.tolist() == [0]
        assert np.isclose(row.interface_peel.item(), interface.stress_zz.max(), rtol=1e-9, atol=1e-15)
        assert np.isclose(row.interface_shear.item(), interface.shear_on_plane.max(), rtol=1e-12)


def test_the_bond_to_a_rigid_base_is_an_interface():
    base = {"halfspace": {"shear_modulus": np.inf}, "output.inside": {"points": 2, "every": 1}}
    assert gfmdlayer.run(RUN | LINE, **base).interface.values.tolist() == [0]
    free = gfmdlayer.run(RUN | LINE, **base | {"halfspace": {"shear_modulus": 0.0}})
    assert "interface_peel" not in free


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"output.inside": {"every": 1}}, "output.inside.depths: missing; give depths or points"),
        ({"output.inside": {"depths": [0.1, 0.1]}}, "depths must increase"),
        (
            {"halfspace": {"shear_modulus": np.inf}},
            r"output.inside.depths\[3\]: got 0.06; must be at most 0.03, the thickness of the body",
        ),
        ({"output.inside.times": [0.3]}, r"output.inside.times\[0\]: got 0.3; must be one of"),
        ({"output": {"inside": {"points": 3}}}, "output.inside: there is no snapshot with fields"),
        ({"counterbody": {"layer": {"thickness": 0.01}, "halfspace": {"shear_modulus": np.inf}}},
         "must be at most 0.01, the thickness of the counterbody"),
        ({"grid.boundary": "isolated", "grid.datum": 10.0}, "not available with boundary: isolated"),
        (
            {"layer": None, "halfspace": None, "body": {"kind": "anisotropic", "C11": 3, "C12": 1, "C44": 1}},
            "not available with kind: anisotropic",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_with_its_place(keys, said):
    with pytest.raises(ConfigError, match=said):
        gfmdlayer.run(RUN | LINE, **keys)


def test_a_sweep_has_fields_only_where_its_cases_have_the_same_layers_at_their_depths():
    keys = {"output.inside": {"depths": [0.0, 0.03]}, "time.end": 0.2, "output.snapshots": [0.2]}
    for thicknesses, known in (([0.04, 0.05], True), ([0.02, 0.05], False)):
        found = gfmdlayer.run(RUN | LINE, sweep={"layer.thickness": thicknesses}, **keys)
        assert ("von_mises" in found) == known
        assert "pressure" in found


def test_modes_are_not_merged_where_fields_are_asked_for():
    law = {"model": "prony", "G0": 1.0, "branches": [{"G": 1.0, "tau": 10.0**k} for k in range(-3, 3)]}
    stack = {"layers": [{"thickness": 0.05, "material": law}], "halfspace": {"material": law | {"G0": 3.0}}}
    given = {key: value for key, value in RUN.items() if key not in ("layer", "halfspace", "output")}
    plain = gfmdlayer.Case(gfmdlayer.Config(name="a", **given, **LINE, **stack))
    asked = gfmdlayer.Case(gfmdlayer.Config(name="a", **given, **LINE, **stack, output=RUN["output"]))
    q = plain.grid.waves
    assert plain.body.spectrum(q).error > 0
    assert asked.body.spectrum(q).error == 0
