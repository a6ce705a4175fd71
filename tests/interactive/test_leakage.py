"""`gfmdlayer.leakage`: leak rates of stored snapshots, their doubts, and bad input."""

import warnings
from functools import cache

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import quad

import gfmdlayer
from gfmdlayer import ConfigError
from gfmdlayer.transport.leakage import flow_through, mean_under_fluid

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


def test_a_contact_solved_better_than_asked_is_not_doubted():
    """The search ends far below a loose tolerance: what counts is the residual that it has reached."""
    exact = quiet(_solved(1e-10))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="the throat")
        warnings.filterwarnings("error", message=".*would do")
        loose = gfmdlayer.leakage(_solved(1e-3))
    assert loose.flow_xx == pytest.approx(float(exact.flow_xx), rel=0.01)


def _solved(residual):
    """Return a contact at a load where the critical gap is some hundredths of the depth."""
    body, punch = (
        gfmdlayer.halfspace(1.0),
        gfmdlayer.SelfAffine(hurst=0.8, roll_off=0.25, short_cutoff=1 / 32, rms_slope=0.1, seed=1),
    )
    return gfmdlayer.solve(body, punch, mean_pressure=0.07, points=(128, 128), tolerance=residual)


@pytest.mark.parametrize("tolerance", [1e-4])
def test_a_loosely_solved_contact_is_doubted_and_the_tolerance_that_is_named_will_do(tolerance):
    """Against a contact solved to 1e-10."""
    exact = quiet(_solved(1e-10))
    with pytest.warns(UserWarning, match="would do") as caught:
        loose = gfmdlayer.leakage(_solved(tolerance))
    said = [str(each.message) for each in caught if "solver.tolerance" in str(each.message)]
    enough = min(float(text.partition("solver.tolerance: ")[2].split()[0]) for text in said)
    assert enough < tolerance
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*would do")
        fine = gfmdlayer.leakage(_solved(enough))
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


# The leak under a fluid that lifts the surface.

WAVE, MODULUS = 0.01, 4.0  # amplitude of a wave of period 1, and E* = 2 G/(1 - nu)
CLOSING = np.pi * MODULUS * WAVE  # mean pressure that closes the wave


def westergaard(pressure):
    """Return the mean of the cube of the gap under a wave (Westergaard 1939), by quadrature."""
    edge = np.sqrt(pressure / CLOSING)

    def cube(angle):
        s = max(np.sin(angle), edge)
        return (2 * WAVE * (s * np.sqrt(s**2 - edge**2) - edge**2 * np.arccosh(s / edge))) ** 3

    return 2 / np.pi * quad(cube, np.arcsin(edge), np.pi / 2, epsrel=1e-9)[0]


@cache
def wave():
    body = gfmdlayer.halfspace(1.0, poisson=0.5)
    return body, gfmdlayer.solve(
        body, lambda x: WAVE * np.cos(2 * np.pi * x), mean_pressure=0.4 * CLOSING, points=512
    )


def test_a_fluid_that_lifts_a_wave_leaks_by_the_integral_over_its_pressure():
    """The flow along the ridges of Westergaard's contacts, integrated over the load that the fluid takes."""
    body, data = wave()
    drops = np.array([1e-3, 0.1, 0.2, 0.3]) * CLOSING
    flow = quiet(
        data, along="y", viscosity=1 / 12, pressure_drop=drops, coupled=True, body=body, length=2.0, width=3.0
    )
    exact = [quad(lambda P: westergaard(0.4 * CLOSING - P), 0, drop, epsrel=1e-8)[0] for drop in drops]
    # Edges between points of the grid leave 1e-4 of the cube; the interval contains the integral.
    np.testing.assert_allclose(flow.leak_rate, np.multiply(exact, 3 / 2), rtol=5e-4)
    np.testing.assert_allclose(flow.leak_rate_per_width, flow.leak_rate / 3.0)
    np.testing.assert_allclose(flow.leak_rate_one_way, drops * float(flow.flow_yy) * 3 / 2)
    assert (flow.leak_rate_low <= flow.leak_rate).all()
    assert (flow.leak_rate_high >= flow.leak_rate).all()
    slope = (westergaard(0.401 * CLOSING) - westergaard(0.399 * CLOSING)) / (0.002 * CLOSING)
    first = 1 - slope / westergaard(0.4 * CLOSING) * drops[0] / 2  # a small drop takes half of itself
    assert float(flow.leak_rate[0] / flow.leak_rate_one_way[0]) == pytest.approx(first, abs=2e-4)


def test_the_integral_solves_the_flow_along_a_seal():
    """Finite differences of d/dx(K(p0 - P) dP/dx) = 0 by rounds, for K = exp(-b p): (exp(b D) - 1)/(b D)."""
    b, drop, n = 3.0, 1.0, 400
    levels = np.linspace(0.0, drop, 9)
    (mean,), (spread,) = mean_under_fluid(levels, np.exp(b * levels), np.array([drop]))
    P = np.linspace(drop, 0.0, n + 1)
    for _ in range(200):
        resistance = np.exp(-b * (P[1:] + P[:-1]) / 2)
        P = drop - drop * np.concatenate(([0.0], np.cumsum(resistance))) / resistance.sum()
    assert mean == pytest.approx((np.exp(b * drop) - 1) / (b * drop), rel=1e-6)
    assert mean == pytest.approx(n / resistance.sum() / drop, rel=b**2 / 24 / n)
    assert spread < 1e-6


def test_a_gap_between_plates_leaks_as_reynolds_says():
    """h^3/(12 eta) times drop, width over length; a ring is pi times its diameter wide."""
    x = np.arange(16) / 16
    gap = xr.DataArray(np.full((16, 16), 0.3), coords={"x": x, "y": x}, dims=("x", "y"))
    flow = quiet(
        gap.to_dataset(name="gap"), viscosity=2.0, pressure_drop=[1.0, 5.0], length=4.0, diameter=7.0
    )
    np.testing.assert_allclose(flow.leak_rate, 0.3**3 / 24 * np.array([1.0, 5.0]) * 7 * np.pi / 4)
    np.testing.assert_allclose(flow.leak_rate_low, flow.leak_rate)
    np.testing.assert_allclose(flow.leak_rate_high, flow.leak_rate)


def test_a_relaxing_seal_under_fluid_leaks_as_one_under_the_lower_load():
    """With a fluid from the beginning the seal would bear the load less its pressure, at each time."""
    drops = np.linspace(0.0, 0.012, 5)[1:]
    found = quiet(seal(), viscosity=1 / 12, pressure_drop=drops, coupled=True)
    loads = 0.03 - np.linspace(0.0, drops[-1], 5)
    runs = [gfmdlayer.run(SEAL | {"trajectory": SEAL["trajectory"] | {"load": load}}) for load in loads]
    own = np.array([quiet(each).flow_xx for each in runs])
    for i in range(2):
        (mean, *_), _ = mean_under_fluid(0.03 - loads, own[:, i], drops[-1:])
        # Steps of 1 % leave a third of a percent in the creep of each run, and threefold that in K.
        assert float(found.leak_rate[i, -1] / drops[-1]) == pytest.approx(mean, rel=0.01)
        assert (found.leak_rate[i] > found.leak_rate_one_way[i]).all()


def test_a_fluid_that_lifts_the_seal_off_has_no_rate():
    body, data = wave()
    with pytest.warns(UserWarning, match="lifts the seal off, which is pressed with"):
        flow = gfmdlayer.leakage(
            data, along="y", viscosity=1.0, pressure_drop=[0.2 * CLOSING, CLOSING], coupled=True, body=body
        )
    np.testing.assert_array_equal(np.isfinite(flow.leak_rate), [True, False])
    assert np.isfinite(flow.leak_rate_one_way).all()


def test_a_seal_that_is_closed_at_its_outlet_does_not_leak_but_may():
    """Across the ridges of a line contact nothing flows, under any load but none."""
    body, data = wave()
    flow = quiet(data, viscosity=1.0, pressure_drop=0.1 * CLOSING, coupled=True, body=body)
    assert float(flow.leak_rate) == float(flow.leak_rate_low) == float(flow.leak_rate_high) == 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pressure_drop": [1.0, 1.0]}, "numbers that increase"),
        ({"pressure_drop": [1.0, -1.0]}, "pressure_drop: got -1.0; must be a number > 0"),
        ({"pressure_drop": []}, "pressure_drop: got .nan"),
        ({"pressure_drop": 1.0, "width": 1.0, "diameter": 1.0}, "diameter: beside width"),
        ({"pressure_drop": 1.0, "viscosity": None, "coupled": True}, "viscosity: missing; coupled"),
        ({"pressure_drop": 1.0, "coupled": True}, "body: missing; coupled needs the body"),
    ],
)
def test_leak_rates_that_cannot_be_computed_are_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        gfmdlayer.leakage(wave()[1], **{"viscosity": 1.0, **options})


def test_a_fluid_under_an_adhesive_or_moving_contact_is_refused():
    config = SEAL | {
        "grid": {"points": [16, 16]},
        "punch": {"shape": "sinusoid", "amplitude": 0.01, "wavelength": 1.0},
    }
    sliding = gfmdlayer.run(config | {"trajectory": SEAL["trajectory"] | {"velocity": 0.1}})
    with pytest.raises(ConfigError, match="coupled: got a contact with a moving punch; must be a hard wall"):
        gfmdlayer.leakage(sliding, viscosity=1.0, pressure_drop=1e-3, coupled=True)
