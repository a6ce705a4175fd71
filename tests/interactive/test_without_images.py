"""`solve(isolated=True)` and runs with grid.boundary: isolated, against closed forms and `indent`."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from gfmdlayer import (
    Config,
    ConfigError,
    Parabola,
    Solid,
    Spectrum,
    Zener,
    bonded_layer,
    halfspace,
    indent,
    run,
    solve,
)
from gfmdlayer.case.model import model_of
from gfmdlayer.observables import columns

E = 4.0  # 2 G/(1 - nu) of an incompressible halfspace with G = 1
DEPTH = 0.01


def test_a_sphere_is_hertz_in_a_cell_of_six_radii():
    """Force at given depth and depth at given force: with images they are 0.8 and 0.27 off."""
    a, F = math.sqrt(DEPTH), 4 / 3 * E * DEPTH**1.5
    cell = {"period": 6 * a, "points": (128, 128), "isolated": True}
    assert float(solve(halfspace(1.0), Parabola(radius=1.0), depth=DEPTH, **cell).force) == pytest.approx(
        F, rel=1e-4
    )
    found = solve(halfspace(1.0), Parabola(radius=1.0), force=F, **cell)
    assert float(found.depth) == pytest.approx(DEPTH, rel=1e-4)
    assert float(found.area_interpolated) == pytest.approx(math.pi * a**2, rel=1e-3)  # of a grid point, 2e-3
    assert not {"contact_area", "mean_pressure"} & set(found)


def ellipse():
    """Hertz for z = x^2/4 + y^2/2 at the depth: force and semi-axes (m is the squared eccentricity)."""
    m = brentq(lambda m: (ellipk(m) - ellipe(m)) / (ellipe(m) / (1 - m) - ellipk(m)) - 0.5, 1e-9, 1 - 1e-9)
    a = math.sqrt(DEPTH * (1 - ellipe(m) / ellipk(m)) / (m / 4))
    b = a * math.sqrt(1 - m)
    return 2 * math.pi / 3 * a * b * DEPTH * E / (ellipk(m) * b), a, b


@pytest.mark.parametrize("points", [(128, 128), (192, 128)], ids=["square", "rectangle"])
def test_an_ellipse_is_hertz(points):
    F, a, b = ellipse()
    period = 6 * a if points == (128, 128) else (6 * a, 6 * b)
    found = solve(
        halfspace(1.0), lambda x, y: -(x**2) / 4 - y**2 / 2, depth=DEPTH, period=period, points=points,
        isolated=True,
    )  # fmt: skip
    assert float(found.force) == pytest.approx(F, rel=1e-4)


def test_a_square_punch_has_the_capacitance_of_the_square():
    """F = pi 0.3667874 E* s depth (Read, J. Comput. Phys. 133 (1997) 1), by extrapolation."""
    found = []
    for points in (16, 32):
        inside = np.arange(4 * points) < points
        heights = np.where(np.add.outer(~inside, ~inside), -1.0, 0.0)
        contact = solve(halfspace(1.0), heights, depth=DEPTH, period=0.8, isolated=True)
        found.append(float(contact.force) / (math.pi * 0.3667874 * E * 0.2 * DEPTH))
    error = 1 - found[0]
    # The next term of the error is of the order of the square of the first.
    assert 2 * found[1] - found[0] == pytest.approx(1, abs=2 * error**2)


def test_a_cylinder_is_hertz_with_its_depth_from_the_datum():
    """Johnson, Contact Mechanics, section 5.6: a surface point at the distance B >> a counts as at rest."""
    a, B = 0.1, 3.0
    F, depth = math.pi * E * a**2 / 4, a**2 / 2 * (math.log(2 * B / a) + 0.5)
    found = solve(
        halfspace(1.0), Parabola(radius=1.0), force=F, period=5 * a, points=1024, isolated=True, datum=B
    )
    assert float(found.depth) == pytest.approx(depth, rel=(a / B) ** 2)
    assert float(found.pressure.max()) == pytest.approx(E * a / 2, rel=1e-4)
    assert float(found.area_interpolated) == pytest.approx(2 * a, rel=1e-3)


def test_a_line_of_spheres_is_hertz_with_the_displacements_of_the_others():
    """Along one axis without images: the doubly isolated contact, and the point loads F at n W on a line.

    Their displacement, counted from its mean at the distance B, is 2 F/(pi E W) (gamma + ln(B/2W)). Of the
    next term, F/(pi E) 2 zeta(3)/W^3, counts a quarter of the mean squares of the radius: under the load,
    2 a^2/5, and under the weight of a displacement at a given load, that of a flat punch, 2 a^2/3. Left is
    (a/W)^5.
    """
    F, W, B = 0.002, 0.9, 9.0
    a = (3 * F / (4 * E)) ** (1 / 3)
    shift = F / (math.pi * E) * (2 / W * (np.euler_gamma + math.log(B / (2 * W))))
    shift += F / (math.pi * E) * 2 * 1.2020569 / W**3 * (2 / 5 + 2 / 3) * a**2 / 4
    cells = {"period": (5 * a, W), "points": (80, 128), "isolated": (True, False), "datum": B}
    row = solve(halfspace(1.0), Parabola(radius=1.0), force=F, **cells)
    alone = {"period": (5 * a, W), "points": (80, 128), "isolated": True}
    one = solve(halfspace(1.0), Parabola(radius=1.0), force=F, **alone)
    # Both responses are fits, within 3e-5 and 1e-6 of the largest of their smooth parts, some a^2/2.
    assert float(row.depth - one.depth) == pytest.approx(shift, abs=(3e-5 + (a / W) ** 5) * a**2)
    assert float(row.pressure.max()) == pytest.approx(float(one.pressure.max()), rel=(a / W) ** 3)


@pytest.mark.parametrize("axis", [0, 1])
def test_on_a_rigid_base_one_isolated_axis_is_the_limit_of_a_long_period(axis):
    """Responses end like exp(-pi/2 x/d) at most: half a period of 12 thicknesses away, 1e-8."""
    body, turn = bonded_layer(0.05, 1.0, poisson=0.4), slice(None, None, 1 - 2 * axis)
    alone = {"period": (0.6, 0.3)[turn], "points": (96, 48)[turn], "isolated": (True, False)[turn]}
    long = {"period": (1.2, 0.3)[turn], "points": (192, 48)[turn]}
    found, limit = (solve(body, Parabola(radius=1.0), depth=DEPTH, **cell) for cell in (alone, long))
    assert float(found.force) == pytest.approx(float(limit.force), rel=1e-6)
    wide = {"period": 0.6, "points": (96, 96)}
    one = solve(body, Parabola(radius=1.0), depth=DEPTH, isolated=True, **wide)
    row = solve(body, Parabola(radius=1.0), depth=DEPTH, isolated=(True, False)[turn], **wide)
    assert float(row.force) == pytest.approx(float(one.force), rel=2e-4)  # the tolerance of the fit is 1e-3
    assert abs(float(found.force / one.force) - 1) > 0.02  # the neighbours count


@pytest.mark.parametrize("axis", [0, 1])
def test_a_cylinder_on_a_surface_is_hertz_over_a_period(axis):
    a, B, W, turn = 0.1, 3.0, 0.3, slice(None, None, 1 - 2 * axis)
    F, depth = math.pi * E * a**2 / 4, a**2 / 2 * (math.log(2 * B / a) + 0.5)
    found = solve(
        halfspace(1.0), Parabola(radius=(1.0, math.inf)[turn]), force=F * W, datum=B,
        period=(5 * a, W)[turn], points=(512, 8)[turn], isolated=(True, False)[turn],
    )  # fmt: skip
    assert float(found.depth) == pytest.approx(depth, rel=(a / B) ** 2)
    assert float(found.pressure.max()) == pytest.approx(E * a / 2, rel=2e-4)
    assert float(found.area_interpolated) == pytest.approx(2 * a * W, rel=1e-3)


def test_displacement_is_that_of_a_wider_cell_and_nan_beyond_reach():
    a = math.sqrt(DEPTH)
    body = bonded_layer(0.1, 1.0, poisson=0.4, halfspace=0.3)
    narrow, wide = (
        solve(body, Parabola(radius=1.0), depth=DEPTH, period=c * a, points=(16 * c, 16 * c), isolated=True)
        for c in (6, 12)
    )
    assert narrow.displacement.isnull().any()
    assert (narrow.displacement.isnull() == narrow.gap.isnull()).all()
    assert not narrow.displacement.where(narrow.contact).isnull().all()
    inner = wide.displacement.sel(x=narrow.x, y=narrow.y, method="nearest")
    assert float(np.abs(narrow.displacement - inner.to_numpy()).max()) < 1e-3 * DEPTH  # the fit's tolerance


def test_a_contact_wider_than_the_reach_is_that_of_a_larger_cell():
    """The period is a window: this one is 2.5 radii wide, and was refused before."""
    body, punch = halfspace(1.0), Parabola(radius=1.0)
    found = solve(body, punch, depth=DEPTH, period=0.25, points=(40, 40), isolated=True)
    assert found.attrs["cell"].startswith("a cell of 2 periods inside, for a contact some 0.")
    assert found.attrs["cell"].endswith("80 x 80 points, 4 times as many")
    assert found.pressure.shape == (40, 40)
    assert float(found.force) == pytest.approx(4 / 3 * E * DEPTH**1.5, rel=2e-3)  # of 16 points in a radius
    wide = solve(body, punch, depth=DEPTH, period=0.5, points=(80, 80), isolated=True)
    assert float(found.force) == pytest.approx(float(wide.force), rel=1e-6)
    off = found.pressure.to_numpy() - wide.pressure[20:-20, 20:-20].to_numpy()
    assert np.abs(off).max() < 1e-5 * float(wide.pressure.max())  # ten times the residual


def test_a_contact_that_attraction_widens_is_that_of_a_larger_cell():
    """It was refused: the cell was that of the contact without attraction."""
    law = {"law": "exponential", "work": 0.03, "range": 0.06}
    given = {"depth": 0.04, "isolated": True, "interface": law}
    body, punch = halfspace(1.0), Parabola(radius=0.5)
    found = solve(body, punch, period=2.0, points=(32, 32), **given)
    assert found.attrs["cell"].startswith("a cell of 2 periods inside")
    wide = solve(body, punch, period=4.0, points=(64, 64), **given)
    assert "cell" not in wide.attrs
    # The punch ends at a gap of 1 beside the window, where exp(-1/range) is left of the attraction.
    assert float(found.force) == pytest.approx(float(wide.force), rel=1e-5)
    off = found.pressure.to_numpy() - wide.pressure[16:-16, 16:-16].to_numpy()
    assert np.abs(off).max() < 1e-5 * float(np.abs(wide.pressure).max())  # ten times the residual


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"depth": 0.01, "isolated": True}, "must have a datum"),
        ({"mean_pressure": 0.01, "isolated": True}, "must be depth or force"),
        ({"depth": 0.01, "datum": 2.0}, "only with isolated=True"),
        ({"depth": 0.01, "isolated": (True, False)}, "must be True or False"),
        ({"depth": 0.01, "points": (32, 32), "isolated": (True, 1)}, "a pair of them, along x and y"),
        ({"depth": 0.01, "points": (32, 32), "isolated": (True, False)}, "must have a datum"),
    ],
)
def test_options_that_do_not_go_together_are_refused(options, words):
    with pytest.raises(ConfigError, match=words):
        solve(halfspace(1.0), Parabola(radius=1.0), **options)


MATERIAL = {"model": "zener", "G0": 1.0, "Ginf": 10.0, "tau": 1.0}


def loaded(boundary, period, layer, base, **keys):
    """A sphere that approaches, holds and retracts."""
    path = {"kind": "approach_retract", "start": 0.0, "depth": DEPTH, "approach_speed": DEPTH, "dwell": 3.0}
    return {
        "grid": {"points": [128, 128], "period": period, "boundary": boundary},
        "layer": {"thickness": 0.1, "material": MATERIAL} | layer,
        "halfspace": {"shear_modulus": base},
        "punch": {"shape": "parabola", "radius": 1.0},
        "trajectory": path | {"retract_speed": DEPTH, "final": 0.0},
        "time": {"step": "adaptive", "tolerance": 1e-4},
    } | keys


@pytest.mark.parametrize(
    ("layer", "base", "most"),
    # Tolerances of the steps, of the fit in the long waves and of 25 points in a radius, about 1e-4 each.
    [({"poisson": 0.5}, math.inf, 2e-4), ({"poisson": 0.45}, 5.0, 2e-4), ({"poisson": 0.45}, 0.2, 2.5e-4)],
    ids=["rigid base", "stiff base", "soft base"],
)
def test_ramp_hold_and_retraction_are_those_of_the_isolated_indenter(layer, base, most):
    """In a cell of five contact radii, where images change the force by 0.02 to 1 and more."""
    body = bonded_layer(0.1, Zener(G0=1.0, Ginf=10.0, tau=1.0), poisson=layer["poisson"], halfspace=base)
    exact = indent(body, Parabola(radius=1.0), [0, 1, 4, 5], depth=[0, DEPTH, DEPTH, 0], tolerance=1e-5)
    largest, period = float(exact.force.max()), 5 * float(exact.contact_radius.max())
    found = run(loaded("isolated", period, layer, base))
    assert np.abs(found.force - np.interp(found.time, exact.time, exact.force)).max() < most * largest
    area = np.pi * np.interp(found.time, exact.time, exact.contact_radius) ** 2
    assert np.abs(found.area_interpolated - area).max() < 0.01 * area.max()
    for name in ("work", "stored", "dissipated"):
        energy = np.interp(found.time, exact.time, exact[name])
        assert np.abs(found[name] - energy).max() < 2e-3 * exact.work.max()  # by trapezoids over the steps
    if base > 1:  # else there is no room in the periodic cell
        periodic = run(loaded("periodic", period, layer, base))
        assert found.transforms.sum() <= 1.1 * periodic.transforms.sum()


def test_adhesion_does_not_depend_on_the_cell():
    """Of points at equal spacings."""
    law = {"law": "exponential", "work": 5e-5, "range": 5e-4}
    body = bonded_layer(0.1, 1.0, poisson=0.4, halfspace=0.3)
    narrow, wide = (
        solve(
            body, Parabola(radius=1.0), depth=0.005, interface=law, period=0.1 * c, points=(12 * c, 12 * c),
            isolated=True,
        )
        for c in (8, 12)
    )  # fmt: skip
    assert float(narrow.pressure.min()) < -0.1 * float(narrow.pressure.max())
    assert float(narrow.force) == pytest.approx(float(wide.force), rel=1e-3)  # the tolerance of the fit


class Bed(Solid):
    """Independent springs of a material."""

    k: float

    @property
    def mean_stiffness(self):
        return self.k

    def stiffness(self, waves, s):
        return self.spectrum(waves).stiffness(s)

    def spectrum(self, waves):
        return Spectrum.of_material(self.k + 0 * np.asarray(waves, dtype=float), Zener(1.0, 10.0, 1.0))


def test_an_own_body_of_springs_has_the_force_of_the_overlap():
    """F = k pi R depth^2 of the relaxed springs, on a grid of 50 points in a diameter."""
    body = Bed(k=3.0)
    found = solve(body, Parabola(radius=1.0), depth=DEPTH, period=0.8, points=(144, 144), isolated=True)
    assert float(found.force) == pytest.approx(3.0 * math.pi * DEPTH**2, rel=2e-3)  # (1/25)^2


@pytest.mark.parametrize("points", [64, [64, 64]], ids=["line", "surface"])
def test_no_column_is_a_mean_over_the_cell(points):
    config = Config(
        name="a", grid={"points": points, "boundary": "isolated"}, halfspace={"shear_modulus": math.inf},
        trajectory={"control": "force", "force": 0.01}, output={"patches": True},
        interface={"law": "exponential", "work": 0.01, "range": 0.01},
    )  # fmt: skip
    found = {each.name: each for each in columns(config)}
    assert {"force", "area", "work"} < set(found)
    for each in found.values():
        assert "over the cell" not in each.origin
        assert "per area" not in each.long_name
        assert not each.long_name.startswith("part of the surface")
    assert config.unit(found["area"].units) == ("length" if points == 64 else "length^2")


@pytest.mark.parametrize(("control", "fits", "wide"), [("depth", 0.01, 0.02), ("force", 0.02, 0.06)])
def test_a_run_whose_contact_becomes_too_wide_has_a_larger_cell_from_the_beginning(control, fits, wide):
    """The widest radius of the window would be 0.105; under the larger force the glassy layer has less."""
    config = loaded("isolated", 0.5, {"poisson": 0.45}, 5.0, time={"step": 0.25, "end": 2.0})
    config["grid"]["points"] = [64, 64]
    for value in (fits, wide):
        path = {"control": control, control: value, "ramp_time": 1.0}
        given = config | {"trajectory": path}
        assert not list(model_of(Config(name="a", **given)).problems())
        found = run(given)
        assert found.time[-1] == 2.0
        assert ("cell" in found.attrs) == (value == wide)
    grid = {"points": [128, 128], "period": 1.0, "boundary": "isolated"}
    alone = run(given | {"grid": grid})
    assert "cell" not in alone.attrs
    assert float(found.area[-1]) > math.pi * 0.105**2
    for name in ("force", "depth", "area", "stored"):
        assert float(found[name][-1]) == pytest.approx(float(alone[name][-1]), rel=1e-3), name  # of the fits


def test_tractions_of_nothing_but_rounding_are_no_contact_beyond_reach(tmp_path):
    """After the pull-off tractions of 1e-8 lie all over the cell, less than 1e-6 of the strength."""
    (tmp_path / "depth.txt").write_text("0 0.01\n1 -0.06\n")
    found = run(
        Config(
            name="a",
            grid={"points": [32, 32], "period": 2.0, "boundary": "isolated"},
            layer={"thickness": 0.05},
            halfspace={"shear_modulus": math.inf},
            punch={"radius": 1.0},
            interface={"law": "dugdale", "work": 0.004, "stress": 0.14},
            trajectory={"kind": "table", "file": str(tmp_path / "depth.txt")},
            time={"end": 1.0, "step": 0.02},
        )
    )
    assert found.time[-1] == 1.0
    assert float(found.force.min()) < -0.01  # it held
    assert abs(float(found.force[-1])) < 1e-6 * 0.14 * 4.0  # the tolerance over the cell
