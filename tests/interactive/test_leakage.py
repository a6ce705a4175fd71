"""`gfmdlayer.leakage`: leak rates of stored snapshots, their doubts, and bad input."""

import warnings
from functools import cache

import numpy as np
import pytest
import xarray as xr

import gfmdlayer
from gfmdlayer import ConfigError
from gfmdlayer.transport.leakage import flow_through

ROUGH = {
    "shape": "self_affine", "hurst": 0.8, "roll_off": 0.5, "short_cutoff": 0.0625, "rms_slope": 0.1,
    "seed": 1,
}  # fmt: skip
SEAL = {
    "grid": {"points": [64, 64]}, "layer": {"thickness": float("inf")}, "punch": ROUGH,
    "trajectory": {"control": "load", "load": 0.03, "ramp_time": 0.1},
    "time": {"end": 10.0, "step": "adaptive", "tolerance": 1e-2}, "output": {"snapshots": [0.1, 10.0]},
}  # fmt: skip


@cache
def seal():
    return gfmdlayer.run(SEAL)


def quiet(data, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return gfmdlayer.leakage(data, **options)


def test_a_seal_leaks_less_when_it_has_relaxed():
    found = quiet(seal(), viscosity=2.0, pressure_drop=24.0, length=3.0, width=5.0, along="y")
    assert found.flow_xx.dims == ("snapshot",)
    assert (found.flow_xx.diff("snapshot") < 0).all()
    np.testing.assert_allclose(found.leak_rate, found.flow_yy * 24 / (12 * 2) / 3 * 5)
    np.testing.assert_allclose(found.hydraulic_gap_x**3, found.flow_xx)
    for i, shot in enumerate(seal().gap):
        K = flow_through(shot.to_numpy(), (1.0, 1.0)).tensor
        np.testing.assert_allclose(
            [found.flow_xx[i], found.flow_xy[i], found.flow_yy[i]], K.ravel()[[0, 1, 3]]
        )
        linear = flow_through(shot.to_numpy(), (1.0, 1.0), "linear").tensor
        assert float(found.flow_error_x[i]) == pytest.approx(linear[0, 0] / K[0, 0] - 1)


def test_the_mean_of_the_flow_at_the_points_is_the_tensor():
    found = quiet(seal(), fields=True, along="y")
    np.testing.assert_allclose(found.flow_y.mean(("x", "y")), found.flow_yy, rtol=1e-8)
    np.testing.assert_allclose(found.flow_x.mean(("x", "y")), found.flow_xy, rtol=1e-6)
    assert bool((found.fluid_pressure.isnull() | (seal().gap > 0)).all())


def test_names_of_units_are_those_of_the_run():
    data = seal().assign_attrs(units="length: um, stress: MPa, time: s")
    found = quiet(data, viscosity=1e-9, pressure_drop=0.1)
    assert (found.flow_xx.attrs["units"], found.leak_rate.attrs["units"]) == ("um^3", "um^3/s")
    assert quiet(seal()).flow_xx.attrs["units"] == "length^3"


def test_a_sweep_has_a_flow_for_each_case_and_none_for_a_failed_one():
    both = xr.concat([seal(), seal() * np.nan], dim="load")
    found = quiet(both)
    assert found.flow_xx.dims == ("load", "snapshot")
    np.testing.assert_array_equal(found.flow_xx[0], quiet(seal()).flow_xx)
    assert found.flow_xx[1].isnull().all()


def test_a_stored_sweep_of_adaptive_steps_has_the_flow_of_each_case(tmp_path):
    """Each case has its own time steps; the loads differ by 1 %, so do the flows by little."""
    every = {**SEAL, "sweep": {"trajectory.load": [0.03, 0.0303]}}
    sweep = gfmdlayer.run(every, out=tmp_path / "sweep")
    found = quiet(sweep)
    for place, K in np.ndenumerate(found.flow_xx):
        assert flow_through(sweep.gap[place].to_numpy(), (1.0, 1.0)).tensor[0, 0] == K
    assert (found.flow_xx[1] < found.flow_xx[0]).all()
    assert (found.flow_xx[1] > 0.8 * found.flow_xx[0]).all()


def test_a_line_leaks_in_closed_form():
    body = gfmdlayer.halfspace(1.0)
    found = gfmdlayer.solve(body, lambda x: 0.01 * np.cos(2 * np.pi * x), mean_pressure=0.03, points=256)
    flow = gfmdlayer.leakage(found, along="y", viscosity=1.0, pressure_drop=1.0, length=2.0)
    assert float(flow.flow_xx) == 0.0
    assert float(flow.flow_yy) == pytest.approx(float((found.gap**3).mean()))
    assert float(flow.leak_rate) == pytest.approx(float(flow.flow_yy) / 12 / 2)  # across the period, 1
    assert "throat_points_x" not in flow


def test_a_coarse_throat_is_doubted():
    with pytest.warns(
        UserWarning, match=r"t = 10: the throat along . has [\d.]+ points .*take more grid.points"
    ):
        gfmdlayer.leakage(seal())


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_a_loosely_solved_contact_is_doubted_and_the_tolerance_that_is_named_will_do(tolerance):
    """At a load where the critical gap is some hundredths of the depth, against a contact solved to 1e-10."""
    body, punch = (
        gfmdlayer.halfspace(1.0),
        gfmdlayer.SelfAffine(hurst=0.8, roll_off=0.25, short_cutoff=1 / 32, rms_slope=0.1, seed=1),
    )

    def solved(residual):
        return gfmdlayer.solve(body, punch, mean_pressure=0.07, points=(128, 128), tolerance=residual)

    exact = quiet(solved(1e-10))
    with pytest.warns(UserWarning, match="would do") as caught:
        loose = gfmdlayer.leakage(solved(tolerance))
    said = [str(each.message) for each in caught if "solver.tolerance" in str(each.message)]
    enough = min(float(text.partition("solver.tolerance: ")[2].split()[0]) for text in said)
    assert enough < tolerance
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*would do")
        fine = gfmdlayer.leakage(solved(enough))
    assert fine.flow_xx == pytest.approx(float(exact.flow_xx), rel=0.01)
    assert abs(float(loose.flow_xx / exact.flow_xx) - 1) > abs(float(fine.flow_xx / exact.flow_xx) - 1)


def test_a_fluid_that_lifts_the_surface_is_doubted():
    gentle = quiet(seal(), viscosity=1.0, pressure_drop=1e-6)
    assert (gentle.lift < 0.1).all()
    with pytest.warns(UserWarning, match="drop should be below") as caught:
        strong = gfmdlayer.leakage(seal(), viscosity=1.0, pressure_drop=1.0)
    np.testing.assert_allclose(strong.lift / gentle.lift, 1e6)
    assert any("contact pressure around the throat" in str(each.message) for each in caught)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"viscosity": 0.0, "pressure_drop": 1.0}, "viscosity: got 0.0; must be a number > 0"),
        ({"viscosity": -1.0, "pressure_drop": 1.0}, "viscosity: got -1.0"),
        ({"viscosity": 1.0, "pressure_drop": float("nan")}, "pressure_drop: got .nan"),
        ({"viscosity": 1.0}, "pressure_drop: missing"),
        ({"length": 2.0}, "viscosity: missing"),
        ({"along": "z"}, "along: got the text 'z'; must be x or y"),
    ],
)
def test_arguments_that_cannot_be_used_are_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        gfmdlayer.leakage(seal(), **options)


def test_data_without_gaps_are_refused():
    with pytest.raises(ConfigError, match=r"has no gap along x; set output\.snapshots"):
        gfmdlayer.leakage(seal().drop_vars("gap"))
    with pytest.raises(ConfigError, match="has no snapshot"):
        gfmdlayer.leakage(seal().isel(snapshot=[]))


def test_an_isolated_contact_is_refused():
    tip = {"grid": {"geometry": "axisymmetric"}, "punch": {"shape": "sphere", "radius": 8.0}}
    data = gfmdlayer.run({**tip, "time": {"end": 1.0, "step": 0.5}, "output": {"snapshots": [1.0]}})
    with pytest.raises(ConfigError, match="an isolated contact has no cell"):
        gfmdlayer.leakage(data)
