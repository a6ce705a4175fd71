"""Rolling in runs: creepages, spin and forces, marched and at once; signs, columns, balance of the energy."""

import math

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.figures.selection import default_abscissa

MU, SPACING = 0.3, 1 / 32
ELASTIC = {"thickness": math.inf, "poisson": 0.3, "material": {"model": "elastic", "G": 1.0}}
RELAXING = {"thickness": 0.1, "poisson": 0.45, "material": {"G0": 1.0, "Ginf": 5.0, "tau": 0.3}}
CREEP = {"x": 0.01, "y": 0.004, "spin": 0.3}


def rolling(layer, **more):
    """A parabola that rolls by a spacing in a time of 1 on a surface of 32 x 32 points, a unit period."""
    keys = {
        "grid": {"points": [32, 32]}, "layer": layer, "interface": {"law": "coulomb", "coefficient": MU},
        "trajectory": {
            "control": "force", "force": 0.02, "ramp_time": 1.0, "velocity": SPACING, "creepage": CREEP,
        },
        "time": {"end": 1.0, "steady": "at_once"}, "solver": {"tolerance": 1e-8},
    }  # fmt: skip
    if math.isfinite(layer["thickness"]):
        keys["halfspace"] = {"shear_modulus": 2.0, "poisson": 0.3}
    for name, values in more.items():
        keys[name] = keys[name] | values if name in keys else values
    return keys


def marched(keys, ways):
    """The same by steps of a spacing."""
    return gfmdlayer.run(keys | {"time": {"end": float(ways), "step": 1.0}, "output": {"snapshots": [ways]}})


FORCED = {
    "trajectory": {"tangential": {"control": "force", "force": 0.003, "ramp_time": 1.0, "direction": 30.0}}
}
ISOLATED = {"grid": {"points": [32, 32], "boundary": "isolated"}, "trajectory": {"force": 0.01}}


@pytest.mark.parametrize(
    ("layer", "more", "ways"),
    [
        (ELASTIC, {}, 128),
        pytest.param(RELAXING, {}, 400, marks=pytest.mark.slow),
        (ELASTIC, FORCED, 128),
        (ELASTIC, ISOLATED, 128),
        (RELAXING, ISOLATED, 400),
        pytest.param(RELAXING, {"trajectory": {"velocity": -SPACING}}, 400, marks=pytest.mark.slow),
    ],
)
def test_marching_ends_in_the_state_that_is_found_at_once(layer, more, ways):
    """It is the same problem: slip, memory and motion repeat themselves. What is left decays with the way."""
    keys = rolling(layer, **more)
    if more is FORCED:
        keys["trajectory"]["creepage"] = {"spin": CREEP["spin"]}
    steady, last = gfmdlayer.run(keys), marched(keys, ways).isel(time=-1, snapshot=-1)
    assert steady.sizes["time"] == 1
    assert steady.attrs["settled"] == 1
    once = steady.isel(time=-1, snapshot=-1)
    for name in ("pressure", "shear_x", "shear_y", "displacement"):
        field = once[name].to_numpy()  # NaN where an isolated contact has no displacements
        assert np.nanmax(np.abs(last[name].to_numpy() - field)) < 2e-4 * np.nanmax(np.abs(field))
    for name in ("depth", "stored", "transverse_force", "spin_moment", "creepage", "lateral_creepage"):
        assert float(last[name]) == pytest.approx(float(once[name]), rel=3e-4)


@pytest.mark.parametrize("layer", [ELASTIC, RELAXING])
def test_the_state_satisfies_coulombs_law_with_its_own_slip(layer):
    """Where a point slips, t is against the slip and mu p; elsewhere at most that, without a slip."""
    found = gfmdlayer.run(rolling(layer)).isel(time=-1, snapshot=-1)
    p, tx, ty = (found[name].to_numpy() for name in ("pressure", "shear_x", "shear_y"))
    slip = np.array([found.slip_velocity_x.to_numpy(), found.slip_velocity_y.to_numpy()])  # in a time of 1
    touching = p > 0
    size, bound = np.hypot(tx, ty), MU * p
    assert (size[touching] <= bound[touching] * (1 + 1e-9)).all()
    slips = touching & (np.hypot(*np.nan_to_num(slip)) > 1e-5 * SPACING)
    assert 0.1 < slips.sum() / touching.sum() < 0.95
    along = (tx * slip[0] + ty * slip[1])[slips] / (size * np.hypot(*slip))[slips]
    assert along == pytest.approx(-1, abs=1e-4)
    assert size[slips] == pytest.approx(bound[slips], rel=1e-5)


def test_forces_have_the_signs_of_creepages_and_spin():
    """D = xi V dt: a punch that slides ahead, to the left, or turns to the left, takes the surface along."""
    layer = ELASTIC | {"poisson": 0.5}
    names = "tangential_force", "transverse_force", "spin_moment"
    for number, creepage in enumerate(({"x": 0.01}, {"y": 0.01}, {"spin": 0.3})):
        found = gfmdlayer.run(rolling(layer, trajectory={"creepage": creepage}))
        assert float(found[names[number]][-1]) > 0
    # Kalker's C23: spin has a lateral force of its sign; lateral creepage has a moment of the other.
    assert float(found.transverse_force[-1]) > 0
    lateral = gfmdlayer.run(rolling(layer, trajectory={"creepage": {"y": 0.01}}))
    assert float(lateral.spin_moment[-1]) < 0


def test_states_of_a_sweep_are_drawn_over_its_key(tmp_path):
    config = rolling(ELASTIC, sweep={"trajectory.creepage": [0.001, 0.002, 0.004]})
    del config["trajectory"]["creepage"]
    found = gfmdlayer.run(config, out=tmp_path / "out")
    assert default_abscissa(found) == "creepage"
    assert default_abscissa(found.isel(creepage=0)) == "time"


def test_rows_before_the_steady_state_are_refused():
    for output in ({"times": 0.1}, {"snapshots": [0.1, 1.0]}):
        with pytest.raises(gfmdlayer.ConfigError, match=r"output\.\w+: .* the only row is the steady"):
            gfmdlayer.run(rolling(ELASTIC, output=output))


def test_a_mirrored_state_has_mirrored_forces():
    """Across x: lateral creepage and spin, lateral force and moment change their signs, to the tolerance."""
    mirrored = {"trajectory": {"creepage": {"x": CREEP["x"], "y": -CREEP["y"], "spin": -CREEP["spin"]}}}
    one, other = (gfmdlayer.run(rolling(RELAXING, **more)).isel(time=-1) for more in ({}, mirrored))
    for name, sign in (("tangential_force", 1), ("transverse_force", -1), ("spin_moment", -1), ("depth", 1)):
        assert float(other[name]) == pytest.approx(sign * float(one[name]), rel=1e-5)


def test_a_number_is_the_creepage_along_x():
    """The same bits, marched."""
    one, other = (
        marched(rolling(ELASTIC, trajectory={"creepage": creepage}), 4) for creepage in (0.01, {"x": 0.01})
    )
    assert one.drop_attrs().identical(other.drop_attrs())


@pytest.mark.parametrize("material", [ELASTIC["material"], RELAXING["material"]])
def test_the_work_of_the_state_becomes_heat(material):
    """Per way: <p u_z'> + xi t_x + eta t_y + phi m = heat of relaxation + heat of slip.

    The middle of a step is that of its work and of its heat of slip: an elastic body with equal kernels
    balances to the residual. Relaxation is of the second order in the spacing,
    .5 % with 20 points in contact along x.
    """
    layer = ELASTIC | {"poisson": 0.5, "material": material}
    keys = rolling(layer, grid={"points": [64, 64]}, trajectory={"force": 0.06, "velocity": 0.5})
    found = gfmdlayer.run(keys).isel(time=-1, snapshot=-1)
    wave = 2j * np.pi * np.fft.fftfreq(64, 1 / 64)[:, np.newaxis]
    slope = np.fft.ifft(wave * np.fft.fft(found.displacement.to_numpy(), axis=0), axis=0).real
    work = float((found.pressure.to_numpy() * slope).mean())
    work += CREEP["x"] * 0.06 * float(found.interface_friction)
    work += CREEP["y"] * float(found.transverse_force) + CREEP["spin"] * float(found.spin_moment)
    heat = 64 * float(found.slip_heat + found.dissipated)
    assert heat == pytest.approx(work, rel=1e-5 if material is ELASTIC["material"] else 8e-3)


def test_wang_and_knothes_cylinders_roll_at_once():
    """Largest pressure of rollers of a standard solid, by speed (CONTACT's values), to .5 %.

    The cell has 35 half-widths, whose images raise p by (pi a/L)^2/6, .15 %; 40 to 60 points are in contact.
    """
    radius, load, nu, speed = 50.0, 600 / 571.5, 0.4, 1000.0
    a = math.sqrt(4 * radius * load * (1 - nu) / math.pi)
    for creep, largest in ((0.0, 60.32), (0.009, 78.74), (0.045, 84.72), (2.0, 85.31)):
        material = {"G0": 0.5, "Ginf": 1.0, "tau": creep / 2} if creep else {"model": "elastic", "G": 0.5}
        found = gfmdlayer.run(
            {
                "grid": {"points": 1024, "period": 35 * a},
                "layer": {"thickness": math.inf, "poisson": nu, "material": material},
                "punch": {"shape": "parabola", "radius": radius},
                "interface": {"law": "coulomb", "coefficient": 0.0},
                "trajectory": {"control": "force", "force": load, "velocity": speed, "creepage": 0.0},
                "time": {"steady": "at_once"},
            }
        )
        assert 571.5 * float(found.pressure[-1].max()) == pytest.approx(largest, rel=0.005)
        # All of the force is the loss of the body, which heats it on the way, to the second order.
        heat = float(found.dissipated[-1]) / (35 * a / 1024) / (load / (35 * a))
        assert float(found.hysteresis_friction[-1]) == pytest.approx(heat, rel=2e-3, abs=1e-9)


def test_what_a_state_at_once_says_is_no_remedy_by_steps():
    """A step moves by a spacing, whatever time.step is; one that slides away is not steady within 0."""
    keys = {
        "grid": {"points": [16, 16]},
        "trajectory": {"control": "force", "force": 0.02, "velocity": 0.1, "creepage": 0.01},
        "interface": {"law": "coulomb", "coefficient": 0.5},
        "time": {"steady": "at_once"},
    }
    for time in {}, {"step": "adaptive"}, {"step": 0.01}:
        said = gfmdlayer.run({**keys, "time": keys["time"] | time}).warnings
        assert "SLIP HEAT is rough" in said
        assert "use more grid.points" in said
        assert "time.step" not in said
    del keys["trajectory"]["creepage"]
    keys["trajectory"]["tangential"] = {"control": "force", "force": 0.02}
    slides = gfmdlayer.run(keys)
    assert "SLIDES AWAY" in slides.ended
    assert "NOT STEADY at time.end" in slides.warnings
