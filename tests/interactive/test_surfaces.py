"""`solve` of measured surfaces, which say points, period and unit, and of several loads in one call."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

import gfmdlayer
from gfmdlayer import (
    ConfigError,
    ConvergenceError,
    Exponential,
    FractionalZener,
    Parabola,
    SelfAffine,
    halfspace,
    solve,
)

HALF = halfspace(1.0)
X = 0.5 * np.arange(24)  # micrometres: a cell of 12 x 16
Y = 0.5 * np.arange(32)
HEIGHTS = 1e-3 * np.random.default_rng(3).normal(size=(24, 32))  # micrometres
LOADS = [2e-3, 4e-3]


def by_hand():
    return solve(HALF, HEIGHTS, mean_pressure=LOADS, period=(12.0, 16.0))


def array(**attrs):
    about = {name: (name, values, {"units": "um"}) for name, values in (("x", X), ("y", Y))}
    return xarray.DataArray(1e3 * HEIGHTS, coords=about, dims=("x", "y"), attrs={"units": "nm"} | attrs)


def file_of_columns(folder):
    x, y = np.meshgrid(X, Y, indexing="ij")
    rows = np.column_stack((x.ravel(), y.ravel(), 1e3 * HEIGHTS.ravel()))
    np.savetxt(folder / "surface.xyz", rows, header="x (um) y (um) z (nm)", comments="", fmt="%.17g")
    return folder / "surface.xyz"


SURFACES = {
    "DataArray": lambda _: array(),
    "DataArray over y, x": lambda _: array().transpose("y", "x"),
    "DataArray backwards": lambda _: array().isel(x=slice(None, None, -1)),
    "file": file_of_columns,
    "name of a file": lambda folder: str(file_of_columns(folder)),
    "Topography": lambda folder: gfmdlayer.Topography(file=file_of_columns(folder)),
    "keys": lambda folder: {"shape": "topography", "file": str(file_of_columns(folder))},
    "SurfaceTopography": lambda _: SimpleNamespace(
        heights=lambda: HEIGHTS, physical_sizes=(12.0, 16.0), nb_grid_pts=(24, 32), unit="um"
    ),
}


@pytest.mark.filterwarnings("ignore:.*join up")
@pytest.mark.parametrize("form", SURFACES)
def test_a_surface_gives_points_period_and_unit(form, tmp_path):
    found, expected = solve(HALF, SURFACES[form](tmp_path), mean_pressure=LOADS), by_hand()
    assert dict(found.sizes) == {"mean_pressure": 2, "x": 24, "y": 32}
    assert found.attrs["unit_of_length"] == "um"
    for name in ("x", "y", "pressure", "gap", "contact_area"):
        scale = float(abs(expected[name]).max())
        assert (
            np.abs(found[name].values - expected[name].values).max() < 1e-8 * scale
        )  # the heights' rounding


@pytest.mark.filterwarnings("ignore:.*join up")
def test_another_period_than_the_surface_has_is_refused(tmp_path):
    for surface in (array(), file_of_columns(tmp_path)):
        with pytest.raises(ConfigError, match=r"period: got 5\.0, but the surface has 12 x 16 um; remove it"):
            solve(HALF, surface, mean_pressure=0.01, period=5.0)
    assert solve(HALF, array(), mean_pressure=0.01, period=(12.0, 16.0)).sizes["x"] == 24
    np.save(tmp_path / "bare.npy", HEIGHTS)
    with pytest.raises(ConfigError, match=r"period: missing; give it, as .*bare\.npy does not say the size"):
        solve(HALF, tmp_path / "bare.npy", mean_pressure=0.01)
    found = solve(HALF, tmp_path / "bare.npy", mean_pressure=LOADS, period=(12.0, 16.0))
    assert np.allclose(found.pressure, by_hand().pressure, rtol=0, atol=1e-12)


def test_units_that_do_not_agree_are_refused():
    for units, said in (
        ("", "heights in no unit, x in um, y in um"),
        ("Pa", "heights in Pa, x in um, y in um"),
    ):
        with pytest.raises(ConfigError, match=f"punch: got {said}; must be lengths"):
            solve(HALF, array(units=units), mean_pressure=0.01)
    uneven = array().assign_coords(x=("x", X**1.1, {"units": "um"}))
    with pytest.raises(ConfigError, match="punch: got unequal steps of x; must be equal"):
        solve(HALF, uneven, mean_pressure=0.01)
    with pytest.raises(ConfigError, match=r"punch\.fil: unknown key"):
        solve(HALF, {"shape": "topography", "fil": "a.txt"}, mean_pressure=0.01)


def test_an_imprint_is_that_of_all_loads_before():
    """Unloading adds nothing to the imprint: stresses stay below the hardness."""
    keys = {"law": "hard_wall", "hardness": 0.5}
    rough = SelfAffine(hurst=0.8, rms_slope=0.5, short_cutoff=0.1, seed=1)
    how = {"punch": rough, "points": (32, 32), "interface": keys}
    found = solve(HALF, **how, mean_pressure=[0.05, 0.02, 0.05])
    first = found.imprint.isel(mean_pressure=0)
    assert float(first.max()) > 0
    assert np.array_equal(found.imprint.isel(mean_pressure=1), first)
    alone = solve(HALF, **how, mean_pressure=0.05)
    assert np.allclose(first, alone.imprint, rtol=0, atol=1e-12)
    again = found.imprint.isel(mean_pressure=2)
    assert np.allclose(again, first, rtol=0, atol=1e-3 * float(first.max()))  # elastic up to the load before


def test_several_loads_are_the_contacts_one_by_one():
    """Each is solved to 1e-6 of its largest pressure, whatever it begins from."""
    rough = SelfAffine(hurst=0.8, rms_slope=0.1, short_cutoff=0.05, seed=1)
    for name, values in (
        ("mean_pressure", [0.01, 0.03, 0.02]),
        ("depth", [0.001, 0.003]),
        ("force", [0.01, 0.02]),
    ):
        together = solve(HALF, rough, points=(64, 64), **{name: values})
        assert together[name].values.tolist() == values
        for i, value in enumerate(values):
            alone = solve(HALF, rough, points=(64, 64), **{name: value})
            error = np.abs(together.pressure.isel({name: i}) - alone.pressure).max()
            assert float(error) < 1e-5 * float(alone.pressure.max())  # some residuals


def test_several_loads_with_friction_follow_each_other():
    """A smaller force after a larger one leaves slip behind: not the contact of the smaller force alone."""
    how = {"punch": Parabola(radius=0.25), "friction": 0.3, "tangential_force": 0.002}
    together = solve(HALF, **how, force=[0.01, 0.02])
    first = solve(HALF, **how, force=0.01)
    second = solve(HALF, **how, force=0.02, previous=first)
    assert np.array_equal(together.shear_x.isel(force=1), second.shear_x)


def test_a_pull_that_no_contact_carries_is_told():
    law = Exponential(work=1e-3, range=4e-3)
    with pytest.raises(ConvergenceError, match=r"PULLED OFF: no contact carries the mean pressure of -0\.05"):
        solve(HALF, Parabola(radius=0.25), mean_pressure=-0.05, interface=law)


def test_a_continuous_law_is_relaxed_or_glassy():
    law, punch = FractionalZener(G0=1.0, Ginf=10.0, tau=1.0, exponent=0.5), Parabola(radius=0.25)
    for instantaneous, modulus in ((False, 1.0), (True, 10.0)):
        found = solve(halfspace(law), punch, depth=0.01, instantaneous=instantaneous)
        assert float(found.force) == float(solve(halfspace(modulus), punch, depth=0.01).force)


def test_a_warning_stands_at_the_line_of_the_user():
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        for _ in range(3):
            solve(HALF, Parabola(radius=1e-3), depth=0.01, points=256)
    assert [(str(each.message)[:8], each.filename) for each in told] == [("STRAINED", __file__)]
