"""Isolated contacts with friction, and those that are wider than their cell answers without images."""

import math

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import Config, ConvergenceError, Parabola, bonded_layer, halfspace, solve
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import NoRecorder, model_of
from gfmdlayer.case.notes import notes
from gfmdlayer.history.traction_creep import TractionCreep
from tests.friction.test_isolated import in_creep_form

R, MU = 10.0, 0.3
ZENER = {"model": "zener", "G0": 1.0, "Ginf": 10.0, "tau": 1.0}
COULOMB = {"law": "coulomb", "coefficient": MU}


def sphere(points, period, *, boundary="isolated", **more):
    """A sphere of contact radius 1 on an incompressible halfspace; half of the largest tangential force."""
    F = 4 / 3 * 4.0 / R
    drive = {"control": "force", "force": 0.5 * MU * F, "start": 1.0, "ramp_time": 1.0}
    return {
        "grid": {"points": [points, points], "period": period, "boundary": boundary},
        "punch": {"shape": "parabola", "radius": R},
        "layer": {"thickness": math.inf, "poisson": 0.5, "material": {"model": "elastic", "G": 1.0}},
        "trajectory": {"control": "force", "force": F, "tangential": drive},
        "interface": COULOMB,
        "time": {"step": 0.25, "end": 2.0},
        **more,
    }


def test_a_sphere_is_that_of_cattaneo_and_mindlin_in_a_cell_of_four_radii():
    """Depth a^2/R, shift 3 mu F (2 - nu)/(16 G a) (1 - (1 - Q/(mu F))^(2/3)), c/a = (1 - Q/(mu F))^(1/3).

    Of 30 points in a diameter each area is right to some 1/30 of the points on its edge, the other two to
    (1/15)^2. Images shift the depth by -0.38, the punch by -0.51.
    """
    F = 4 / 3 * 4.0 / R
    shift = 3 * MU * F * 1.5 / 16 * (1 - 0.5 ** (2 / 3))
    found = gfmdlayer.run(sphere(64, 4.2, output={"snapshots": [2.0]}))
    last = found.isel(time=-1)
    assert float(last.depth) == pytest.approx(1 / R, rel=4e-3)
    assert float(last.tangential_displacement) == pytest.approx(shift, rel=4e-3)
    assert math.sqrt(last.stick_area / last.area) == pytest.approx(0.5 ** (1 / 3), rel=1e-2)
    assert float(last.force) == pytest.approx(F, rel=1e-12)
    assert float(last.tangential_force) == pytest.approx(0.5 * MU * F, rel=1e-6)
    # The heat is less than the friction times the slip of the edge, and the energies are those of the whole.
    assert 0 < float(last.slip_heat) < MU * F * shift
    periodic = gfmdlayer.run(sphere(64, 4.2, boundary="periodic"))
    assert float(periodic.depth[-1]) == pytest.approx(0.62 / R, rel=0.02)
    assert float(found.transforms.sum()) <= 1.2 * float(periodic.transforms.sum())


# Parts that stick by the coupled problems of flat punches, the same for each power of the profile: in
# shared tables of the theory, by dense boundary elements.
@pytest.mark.parametrize(("poisson", "mu", "stick"), [(0.3, 0.3, 0.6891), (0.0, 0.2986, 0.1750)])
def test_the_part_of_a_pressed_cylinder_that_sticks_is_spences(poisson, mu, stick):
    """In cells of 4.2 half-widths, by two loads a spacing; a point is 1/128 of the contact."""
    m, found = 64, None
    E, period = 2 / (1 - poisson), 4.2
    for k in range(1, 2 * m + 1):
        a, before = k / (2 * m), {} if found is None else {"previous": found}
        found = solve(
            halfspace(1.0, poisson=poisson), Parabola(radius=R), force=math.pi * E * a**2 / (4 * R),
            period=period, points=270, friction=mu, isolated=True, datum=10.0, **before,
        )  # fmt: skip
    assert "cell" not in found.attrs
    assert float(found.stick_area / found.area) == pytest.approx(stick, abs=1 / 128)


@pytest.mark.slow
@pytest.mark.parametrize(("poisson", "mu", "stick"), [(0.3, 0.3, 0.8962), (0.0, 0.2986, 0.5018)])
def test_the_part_of_a_pressed_sphere_that_sticks_is_spences(poisson, mu, stick):
    """As on a line; 16 points in a radius."""
    m, found = 16, None
    for k in range(1, 2 * m + 1):
        a, before = k / (2 * m), {} if found is None else {"previous": found}
        found = solve(
            halfspace(1.0, poisson=poisson), Parabola(radius=R), depth=a**2 / R, period=4.25,
            points=(68, 68), friction=mu, isolated=True, **before,
        )  # fmt: skip
    assert math.sqrt(found.stick_area / found.area) == pytest.approx(stick, abs=0.5 / m)


def test_the_cell_does_not_matter():
    """A sphere on a film in windows of 1.6, 4.2 and 8.4; the first is solved in a cell of 3.2."""
    body = bonded_layer(0.5, 5.0, poisson=0.3, halfspace=1.0, halfspace_poisson=0.3)
    narrow, middle, wide = (
        solve(
            body, Parabola(radius=R), depth=0.06, period=n * 0.1, points=(n, n), friction=MU, isolated=True,
            tangential_displacement=(0.01, 0.004), tolerance=1e-9,
        )
        for n in (16, 42, 84)
    )  # fmt: skip
    assert "32 x 32 points, 4 times as many" in narrow.attrs["cell"]
    assert not {"cell"} & {*middle.attrs, *wide.attrs}
    for name in ("force", "tangential_force_x", "tangential_force_y", "area", "stick_area"):
        # A grid ends its waves along a square, by other waves in another cell: 1/L^2, some 1e-6 here.
        assert float(middle[name]) == pytest.approx(float(wide[name]), rel=1e-5), name
        assert float(narrow[name]) == pytest.approx(float(wide[name]), rel=1e-5), name
    assert narrow.pressure.shape == (16, 16)
    assert not narrow.displacement.isnull().any()  # of all that the user sees
    inner = wide.sel(x=narrow.x, y=narrow.y, method="nearest")
    for name in ("displacement", "displacement_x", "displacement_y"):  # with the same ends, at each point
        size = float(abs(inner[name]).max())
        np.testing.assert_allclose(narrow[name], inner[name].to_numpy(), rtol=0, atol=5e-4 * size)
        known = middle[name].sel(x=narrow.x, y=narrow.y, method="nearest").to_numpy()
        assert np.nanmax(np.abs(known - inner[name].to_numpy())) < 5e-4 * size
    assert middle.displacement_x.isnull().any()


def film(base, points, period, **more):
    """A sphere that is pressed into a Zener film, rests, and moves along it."""
    return {
        "grid": {"points": [points, points], "period": period, "boundary": "isolated"},
        "punch": {"shape": "parabola", "radius": 1.0},
        "layer": {"thickness": 0.1, "poisson": 0.45, "material": ZENER},
        "halfspace": {"shear_modulus": base},
        "trajectory": {"control": "depth", "depth": 0.01, "ramp_time": 1.0},
        "time": {"step": 0.1, "end": 4.0},
        **more,
    }


@pytest.mark.parametrize(("base", "a", "F"), [(5.0, 0.11127, (2.831623e-2, 1.839963e-2)),
                                              (0.2, 0.06115, (3.133563e-3, 2.030913e-3))])  # fmt: skip
@pytest.mark.parametrize("mu", [0.0, 1e-6])
def test_forces_on_a_relaxing_film_are_those_of_the_indenter(base, a, F, mu):
    """F(1) and F(4) of `indent` at 1e-5, the lower base with a response that is negative in some waves.

    Steps of 0.1 and 15 to 25 points in a radius are right to some 2e-4 each.
    """
    law = {"law": "coulomb", "coefficient": mu}
    found = gfmdlayer.run(film(base, 64, 4.2 * a, interface=law))
    assert np.interp([1.0, 4.0], found.time, found.force) == pytest.approx(F, rel=4e-4)
    total = found.stored[-1] + found.dissipated[-1]
    assert float(total) == pytest.approx(float(found.work[-1]), rel=1e-3)
    assert (found.dissipated.diff("time") > -1e-9 * float(total)).all()
    assert 0 < float(found.attrs["fit_error"]) <= 1e-6


def test_backward_euler_is_of_first_order():
    """Towards the exponential steps, of second order: half of the steps have half of the error."""
    found = []
    for integrator, step in (("exponential", 0.05), ("backward_euler", 0.1), ("backward_euler", 0.05)):
        time = {"step": step, "end": 1.0, "integrator": integrator}
        found.append(float(gfmdlayer.run(film(5.0, 24, 0.5, interface=COULOMB, time=time)).force[-1]))
    assert (found[2] - found[0]) / (found[1] - found[0]) == pytest.approx(0.5, abs=0.1)


@pytest.mark.slow
def test_adaptive_steps_with_friction_close_the_energies():
    drive = {"displacement": 0.006, "start": 1.0, "ramp_time": 3.0}
    path = {"control": "depth", "depth": 0.01, "ramp_time": 1.0, "tangential": drive}
    given = film(5.0, 32, 4.2 * 0.11127, interface=COULOMB, trajectory=path)
    fixed = gfmdlayer.run(given)
    found = gfmdlayer.run(given | {"time": {"step": "adaptive", "end": 4.0, "tolerance": 1e-4}})
    for name in ("force", "tangential_force", "stored", "dissipated", "slip_heat"):
        of_fixed = float(fixed[name][-1])
        assert float(found[name][-1]) == pytest.approx(of_fixed, rel=3e-3), name  # of fixed steps
    assert float(abs(found.energy_residual).max()) < 1e-3 * float(found.work[-1])
    assert 40 < found.sizes["time"] < 300


def test_a_run_in_creep_form_is_that_of_relaxing_modes():
    """On a periodic layer; steps are exact for tractions, not displacements, that are linear in time."""
    config = Config(
        name="layer", grid={"points": 256}, layers=[{"thickness": 0.05, "poisson": 0.5, "material": ZENER}],
        halfspace={"shear_modulus": 1.0, "poisson": 0.3}, interface={"law": "coulomb", "coefficient": 0.4},
        trajectory={"control": "load", "load": 0.02,
                    "tangential": {"displacement": 0.004, "start": 2.0, "ramp_time": 2.0}},
        time={"end": 4.2, "step": 0.05},
    )  # fmt: skip
    case, rows = Case(config), []

    class Rows(NoRecorder):
        def row(self, **values):
            rows[-1].append(values)

    for given in ({}, {"history": TractionCreep(case.grid, in_creep_form(case.body, case.grid))}):
        rows.append([])
        Case(config, **given).run(Rows())
    for name in ("depth", "friction", "stored", "dissipated", "slip_heat"):
        one, other = (np.array([row[name] for row in each]) for each in rows)
        assert np.nanmax(np.abs(one - other)) < 2e-4 * np.nanmax(np.abs(one)), name


# The period is a window.


def test_a_wide_contact_gets_a_larger_cell_and_its_cost_is_said():
    """Frictionless and frictional: a run in a cell of 2.2 radii is the one in a cell of 8.8."""
    for law, cell in ((None, "2.55"), (COULOMB, "2")):
        config = sphere(22, 2.2, output={"snapshots": [2.0]})
        if law is None:
            del config["interface"]
            config["trajectory"].pop("tangential")
        wide = config | {"grid": config["grid"] | {"points": [88, 88], "period": 8.8}}
        narrow, wide = gfmdlayer.run(config), gfmdlayer.run(wide)
        assert f"a cell of {cell} periods inside" in narrow.attrs["cell"]
        assert "cell" not in wide.attrs
        (note,) = [note for note in notes([Config(name="a", **config)]) if "isolated takes" in note]
        assert narrow.attrs["cell"] in note
        assert narrow.pressure.shape == (1, 22, 22)
        inner = wide.sel(x=narrow.x, y=narrow.y, method="nearest").isel(snapshot=0)
        off = np.abs(narrow.pressure[0] - inner.pressure.to_numpy()).max()
        assert off < 2e-3 * float(inner.pressure.max())  # of the fit; with friction there is none
        for name in ("depth", "force", "area"):
            assert float(narrow[name][-1]) == pytest.approx(float(wide[name][-1]), rel=1e-3), name
    footprints = [model_of(Config(name="a", **sphere(22, L))).footprint for L in (2.2, 8.0)]
    assert footprints[0].work > 2 * footprints[1].work


def test_a_punch_ends_with_the_window():
    """A flat face over the whole window is a square punch, pi 0.3667874 E* s depth (Read, 1997)."""
    found = [
        float(solve(halfspace(1.0), np.zeros((n, n)), depth=0.01, period=1.0, isolated=True).force)
        for n in (16, 32)
    ]
    exact = math.pi * 0.3667874 * 4.0 * 0.01
    with pytest.warns(UserWarning, match="EDGE: the contact reaches the edge of the window"):
        solve(halfspace(1.0), np.zeros((16, 16)), depth=0.01, period=1.0, isolated=True)
    with pytest.warns(UserWarning, match="EDGE"):
        gfmdlayer.run(sphere(16, 1.6, time={"step": 0.5, "end": 1.0}))
    error = 1 - found[0] / exact
    assert 2 * found[1] / exact - found[0] / exact == pytest.approx(1, abs=2 * error**2)
    same = solve(halfspace(1.0), np.zeros((16, 16)), depth=0.01, period=1.0, isolated=True, friction=0.2)
    assert float(same.force) == pytest.approx(found[0], rel=1e-3)  # incompressible; the fit's tolerance


def test_faces_and_asperities_that_touch_far_apart_run():
    """A disc of 0.78 periods, and two asperities that are 0.7 periods apart; both were refused before."""
    given = {
        "grid": {"points": [32, 32], "boundary": "isolated"}, "halfspace": {"shear_modulus": math.inf},
        "layer": {"thickness": 0.2, "poisson": 0.3}, "time": {"end": 1.0, "step": 0.1},
        "trajectory": {"control": "depth", "depth": 0.01, "ramp_time": 1.0},
    }  # fmt: skip
    shallow = {"trajectory": {"control": "depth", "depth": 0.001, "ramp_time": 1.0}}
    disc = Config(name="a", **given | shallow, punch={"shape": "flat", "width": 0.78, "edge_radius": 0.1})
    assert not list(model_of(disc).problems())
    found = gfmdlayer.run(disc)
    assert "periods inside" in found.attrs["cell"]
    assert float(found.area[-1]) == pytest.approx(math.pi * 0.39**2, rel=0.1)
    two = gfmdlayer.run(given, punch=lambda x, y: -((np.abs(x) - 0.35) ** 2 + y**2) / 2)
    one = gfmdlayer.run(given, punch=lambda x, y: -(x**2 + y**2) / 2)
    assert "periods inside" in two.attrs["cell"]
    assert "cell" not in one.attrs
    # They are three layer thicknesses apart, where the surface between has all but returned.
    assert float(two.force[-1]) == pytest.approx(2 * float(one.force[-1]), rel=0.02)


def test_tractions_that_reach_further_than_the_estimate_end_the_run_with_a_period():
    """An attraction is not part of the estimate: that of a long range is felt all over the cell."""
    config = sphere(32, 4.2, time={"step": 0.5, "end": 1.0})
    config["trajectory"].pop("tangential")
    config["interface"] = {"law": "exponential", "work": 0.1, "range": 0.5}
    with pytest.raises(ConvergenceError, match=r"periods apart.*would do"):
        gfmdlayer.run(config)


def test_attraction_beside_friction():
    """In two cells that both hold all tractions above 1e-3 of the largest."""
    law = {"law": "exponential", "work": 1e-3, "range": 0.02}
    narrow, wide = (
        solve(
            halfspace(1.0, poisson=0.3), Parabola(radius=R), force=0.05, period=L, points=(n, n),
            isolated=True, friction=MU, tangential_force=0.005, interface=law,
        )
        for L, n in ((4.0, 64), (6.0, 96))
    )  # fmt: skip
    assert float(narrow.depth) == pytest.approx(float(wide.depth), rel=2e-3)
    assert float(narrow.stick_area) == pytest.approx(float(wide.stick_area), rel=1e-6)


# What the period of other cells does.


@pytest.mark.slow
def test_the_note_tells_how_far_a_period_changes_the_creepage():
    """A compressible cylinder that rolls freely: the difference of two periods is that of their notes."""
    E, a, found, said = 2 / 0.7, 1.0, [], []
    for period, n in ((8.0, 256), (16.0, 512)):
        drive = {"control": "force", "force": 1e-9, "ramp_time": 0.1}
        config = {
            "name": "rolling", "grid": {"points": n, "period": period}, "punch": {"radius": 50.0},
            "layer": {"thickness": math.inf, "poisson": 0.3, "material": {"model": "elastic", "G": 1.0}},
            "trajectory": {"control": "force", "force": math.pi * E * a**2 / 200, "ramp_time": 0.1,
                           "velocity": 1.0, "tangential": drive},
            "interface": COULOMB, "time": {"step": period / n, "end": 9.0},
        }  # fmt: skip
        (note,) = [
            note for note in notes([Config(**config)]) if note.startswith("grid.period: a cell cannot")
        ]
        said.append(float(note.split(" by ")[1].split(",")[0]))
        found.append(float(gfmdlayer.run(config).creepage[-20:].mean()))
    assert found[1] - found[0] == pytest.approx(said[0] - said[1], rel=0.12)  # two digits; and (a/L)^2


@pytest.mark.parametrize(
    "change",
    [
        {"layer": {"thickness": math.inf, "poisson": 0.5}},
        {"layer": {"thickness": 0.1, "poisson": 0.3}},
        {"trajectory": {"control": "force", "force": 0.01}},
    ],
)
def test_other_cells_have_no_such_note(change):
    config = {
        "name": "a", "grid": {"points": 64}, "interface": COULOMB, "halfspace": {"poisson": 0.5},
        "layer": {"thickness": math.inf, "poisson": 0.3},
        "trajectory": {"control": "force", "force": 0.01, "velocity": 1.0},
    } | change  # fmt: skip
    assert not [note for note in notes([Config(**config)]) if "cannot stretch" in note]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"trajectory": {"control": "load", "load": 0.1}}, "an isolated contact does not have"),
        ({"halfspace": {"shear_modulus": 0.0}, "layer": {"thickness": 0.1}}, "without a base"),
    ],
)
def test_what_needs_a_cell_is_refused(change, words):
    given = {"grid": {"points": [32, 32], "boundary": "isolated"}, "interface": COULOMB} | change
    with pytest.raises(gfmdlayer.ConfigError, match=words):
        Config(name="a", **given)


def test_no_column_of_a_contact_with_friction_is_a_mean_over_the_cell():
    columns = model_of(Config(name="a", **sphere(32, 4.2))).columns
    assert {"tangential_force", "stick_area", "slip_heat", "transverse_force"} < {
        each.name for each in columns
    }
    for each in columns:
        assert "over the cell" not in each.origin
        assert "per area" not in each.long_name
        assert "mean tangential" not in each.long_name


@pytest.mark.filterwarnings("ignore:grid.period", "ignore:COARSE")
def test_a_punch_that_moves_without_friction_has_the_force_of_a_wide_periodic_cell():
    """On a bonded layer images two periods away do not count; the response without them is within 1e-3.

    The run ends before what the body remembers leaves the cell.
    """
    base = {
        "layer": {"thickness": 0.2, "poisson": 0.45},
        "halfspace.shear_modulus": math.inf,
        "punch.radius": 1.0,
        "trajectory": {"depth": 0.01, "ramp_time": 0.5, "velocity": 0.5},
        "time": {"end": 0.75, "step": 0.0625},
    }
    alone = {"grid": {"points": [32, 32], "period": 1.0, "boundary": "isolated"}}
    config = gfmdlayer.Config(name="a")
    found = gfmdlayer.run(config.with_values(base | alone))
    wide = gfmdlayer.run(config.with_values(base | {"grid": {"points": [64, 64], "period": 2.0}}))
    assert float(found.force[-1]) == pytest.approx(float(wide.force[-1]), rel=1e-3)
    named = gfmdlayer.run(config.with_values(base | alone), interface={"law": "coulomb", "coefficient": 0})
    np.testing.assert_array_equal(named.force, found.force)
