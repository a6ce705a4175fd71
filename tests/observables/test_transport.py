"""Columns of seals, switches and joints: against the functions of the fields, over ranks, after a stop."""

import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import ConfigError
from gfmdlayer.config import Config
from gfmdlayer.grid.grid import Grid
from gfmdlayer.results.reader import open_case
from gfmdlayer.study.case_run import run_case
from gfmdlayer.study.cases import SweepCase
from gfmdlayer.study.cost import estimate
from gfmdlayer.study.folder import Folder
from gfmdlayer.transport.leakage import bruggeman, flow_through
from gfmdlayer.transport.percolation import throats
from gfmdlayer.transport.spots import Spots, impedance, inverse

MPIRUN = Path(sys.executable).parent / "mpirun"
FREQUENCIES = [0.0, 0.5, float("inf")]
OUTPUT = {
    "observables": ["critical_gap_x", "critical_gap_y", "flow_bruggeman", "spot_radius"],
    "leakage": {"every": 4},
    "conductance": {"body": {"resistivity": 2.0, "films": [{"thickness": 0.02, "resistivity": 5.0}]},
     "punch": {"resistivity": 1.0}},
    "stiffness": {"frequencies": FREQUENCIES, "every": 3}, "snapshots": [0.1, 0.5, 1.0],
}  # fmt: skip
CASE = {
    "name": "seal",
    "grid": {"points": [64, 32], "period": [1.0, 0.5]},
    "layer": {"thickness": 0.2, "poisson": 0.4},
    "punch": {
        "shape": "self_affine", "hurst": 0.8, "roll_off": 0.25, "short_cutoff": 0.0625, "rms_slope": 0.1,
        "seed": 1,
    },
    "trajectory": {"control": "load", "load": 0.04, "ramp_time": 0.1},
    "time": {"end": 1.0, "step": 0.05},
    "solver": {"tolerance": 1e-8},
    "output": OUTPUT,
}  # fmt: skip


@cache
def run():
    return gfmdlayer.run(CASE)


def at_the_snapshots():
    """Return the rows at the snapshots, and their gaps."""
    data = run()
    return data.sel(time=data.snapshot.values, method="nearest"), [each.to_numpy() for each in data.gap]


def test_flow_and_its_estimates_are_those_of_the_gap():
    rows, gaps = at_the_snapshots()
    for i, gap in enumerate(gaps):
        K = flow_through(gap, (1.0, 0.5)).tensor
        np.testing.assert_array_equal(
            [rows.flow_xx[i], rows.flow_xy[i], rows.flow_yy[i]], K.ravel()[[0, 1, 3]]
        )
        assert float(rows.hydraulic_gap_y[i]) == pytest.approx(K[1, 1] ** (1 / 3))
        narrow = throats(gap, (1 / 64, 1 / 64))
        assert [rows.critical_gap_x[i], rows.critical_gap_y[i]] == [each.gap for each in narrow]
        assert [rows.throat_points_x[i], rows.throat_points_y[i]] == [each.points for each in narrow]
        assert rows.flow_bruggeman[i] == bruggeman(gap)
    assert rows.flow_xx.attrs["units"] == "length^3"
    assert rows.flow_xx[0] > rows.flow_xx[-1]  # the layer relaxes


def test_resistance_and_spot_radius_are_those_of_the_contact():
    rows, gaps = at_the_snapshots()
    q = Grid((64, 32), (1.0, 0.5)).wavenumbers
    both = impedance(q, [(0.02, 0.2)], 0.5) + impedance(q, [], 1.0)
    for i, gap in enumerate(gaps):
        bare, filmed = (Spots(Z, 1 / 64**2, 1e-14).total(gap <= 0) for Z in (impedance(q, [], 1.0), both))
        # The tolerance of the sum is 1e-8, for a preconditioner that is within a small factor of the inverse.
        assert float(rows.spot_radius[i]) == pytest.approx(bare / 4, rel=1e-7)
        assert float(rows.resistance[i]) == pytest.approx(1 / filmed + 0.02 * 5.0 / 0.5, rel=1e-7)
    first = run().isel(time=0)
    assert (float(first.spot_radius), float(first.resistance)) == (0.0, float("inf"))  # no contact yet


def test_the_dynamic_stiffness_is_that_of_the_body_at_each_frequency():
    rows, gaps = at_the_snapshots()
    body, waves = Config(**CASE).solid, Grid((64, 32), (1.0, 0.5)).waves
    np.testing.assert_array_equal(rows.frequency, FREQUENCIES)
    for i, gap in enumerate(gaps):
        for k, s in enumerate((0.0, 1j * np.pi, 1e12)):
            S = Spots(inverse(body.stiffness(waves, s)), 1 / 64**2, 1e-14).total(gap <= 0)
            assert float(rows.storage_stiffness[i, k]) == pytest.approx(S.real, rel=1e-6)
            assert float(rows.loss_stiffness[i, k]) == pytest.approx(np.imag(S), rel=1e-6, abs=1e-12)


def test_of_one_material_the_stiffness_is_proportional_to_its_modulus():
    found = gfmdlayer.run(CASE, layer={"thickness": float("inf")}).isel(time=-1)
    material = Config(**{**CASE, "layer": {"thickness": float("inf")}}).layer
    assert material is not None
    ratio = complex(material.material.laplace(1j * np.pi) / material.material.laplace(0.0))
    S = found.storage_stiffness + 1j * found.loss_stiffness
    np.testing.assert_allclose(S[1] / S[0], ratio, rtol=1e-9)
    np.testing.assert_allclose(S[2] / S[0], 10.0, rtol=1e-9)  # Ginf/G0


def test_an_isolated_contact_has_the_resistance_and_the_stiffness_of_its_disc():
    """R = (rho_1 + rho_2)/(4 a) and S = 2 E* a, for any period; the edge is 0.13 spacings inside (`spots`).

    Both have the response without images, which is known within 1e-3, and so their product has less error.
    """
    radius, depth, values = 1.0, 0.02, []
    for n, period in ((32, 0.6), (64, 1.2)):
        config = Config(name="a").with_values(
            {
                "grid": {"points": [n, n], "period": period, "boundary": "isolated"},
                "layer": {"thickness": float("inf"), "material": {"model": "elastic", "G": 1.0}},
                "punch": {"shape": "parabola", "radius": radius},
                "trajectory": {"depth": depth, "ramp_time": 1.0},
                "time": {"end": 1.0, "step": 1.0},
                "output.conductance": {"body": {"resistivity": 3.0}, "punch": {"resistivity": 1.0}},
                "output.stiffness": {"frequencies": [0.0]},
            }
        )
        found = gfmdlayer.run(config).isel(time=-1)
        a = (float(found.area) / np.pi) ** 0.5 - 0.13 * period / n
        R, S = float(found.resistance), float(found.storage_stiffness[0])
        assert pytest.approx(4.0 / (4 * a), rel=4e-3) == R  # the outline of a disc of 15 points is rough
        assert pytest.approx(2 * 4.0 * a, rel=4e-3) == S
        assert pytest.approx(4.0 * 4.0 / 2, rel=1e-3) == R * S
        values.append((R, S))
    np.testing.assert_allclose(values[0], values[1], rtol=2e-3)


def test_beside_an_attraction_the_stiffness_at_rest_is_the_slope_of_the_force(tmp_path):
    """A quotient of differences on both sides of a depth, while no point of the grid joins the contact."""
    depth, step = 0.02, 1e-6
    (tmp_path / "depth.txt").write_text(f"0 0\n1 {depth - step}\n2 {depth}\n3 {depth + step}\n")
    config = Config(name="a").with_values(
        {
            "grid.points": [32, 32],
            "layer": {"thickness": 0.1, "poisson": 0.3, "material": {"model": "elastic", "G": 1.0}},
            "halfspace.shear_modulus": float("inf"),
            "interface": {"law": "exponential", "work": 2e-3, "range": 0.05},
            "trajectory": {"kind": "table", "file": str(tmp_path / "depth.txt")},
            "time": {"end": 3.0, "step": 1.0},
            "solver.tolerance": 1e-12,
            "output.stiffness": {"frequencies": [0.0]},
        }
    )
    found = gfmdlayer.run(config)
    assert found.contact_area[1] == found.contact_area[3]
    slope = 2 * float(found.mean_pressure[3] - found.mean_pressure[1]) / (2 * step)
    assert float(found.storage_stiffness[2, 0]) == pytest.approx(slope, rel=1e-5)


def test_columns_of_every_nth_row_are_nan_in_the_others_but_for_snapshots_and_the_end():
    data = run()
    rows = np.arange(data.sizes["time"])
    shots = np.isclose(data.time.to_numpy()[:, None], data.snapshot.to_numpy()).any(axis=1)
    np.testing.assert_array_equal(data.flow_xx.notnull(), (rows % 4 == 0) | shots)
    np.testing.assert_array_equal(data.loss_stiffness.notnull().all("frequency"), (rows % 3 == 0) | shots)
    assert data.critical_gap_x.notnull().all()


def test_a_stopped_run_continues_with_the_same_bits(tmp_path, run_up_to):
    config = Config(**CASE).with_values({"trajectory.load": 0.12})
    found, said = [], []
    for name in ("once", "twice"):
        folder, case = Folder(tmp_path / name), SweepCase(0, config, {})
        folder.cases.mkdir(parents=True)
        if name == "twice":
            run_up_to(0.6, case, folder)
        ended = run_case(case, folder)
        assert ended.state == "complete"
        said.append(ended.note)
        with open_case(folder.case(0)) as data:
            found.append(data.load())
    for name in ("flow_xx", "spot_radius", "resistance", "loss_stiffness", "critical_gap_y"):
        np.testing.assert_array_equal(found[0][name], found[1][name])
    np.testing.assert_array_equal(found[0].frequency, FREQUENCIES)
    assert said[0] == said[1]  # a doubt of the rows before the stop is not forgotten
    assert "points across it" in said[0]


def test_a_sweep_has_the_columns_and_the_frequencies():
    both = gfmdlayer.run(
        CASE, sweep={"trajectory.load": [0.02, 0.04]}, **{"time.end": 0.2, "output.snapshots": [0.1]}
    )
    assert both.storage_stiffness.dims == ("trajectory.load", "time", "frequency")
    np.testing.assert_array_equal(both.frequency, FREQUENCIES)
    assert (both.flow_xx.isel(time=-1).diff("trajectory.load") < 0).all()


def test_over_ranks_the_first_computes_the_columns_for_all(tmp_path):
    config = Config(**CASE).with_values(
        {"time.end": 0.2, "output.snapshots": [0.1], "solver.method": "nested_gradient"}
    )
    (tmp_path / "seal.yaml").write_text(config.dump())
    command = [sys.executable, "-m", "gfmdlayer", "run", "seal.yaml", "--ranks-per-case", "2", "--out", "r"]
    ran = subprocess.run(
        [str(MPIRUN), "-n", "2", *command],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    alone = gfmdlayer.run(config)
    with open_case(tmp_path / "r/cases/0000.h5") as data:
        for name in (
            "flow_xx",
            "critical_gap_y",
            "flow_bruggeman",
            "spot_radius",
            "resistance",
            "loss_stiffness",
        ):
            # The ranks' contact differs by the solver's tolerance.
            np.testing.assert_allclose(data[name], alone[name], rtol=1e-4, atol=1e-12, err_msg=name)


def test_the_conductance_of_a_creeping_sphere_follows_the_area():
    """4 a with images while the modulus falls tenfold; the edge of the points is 0.13 spacings inside."""
    n = 128
    data = gfmdlayer.run(
        {
            "grid": {"points": [n, n]},
            "layer": {"thickness": float("inf")},
            "punch": {"shape": "parabola", "radius": 2.0},
            "trajectory": {"control": "load", "load": 0.01, "ramp_time": 0.01},
            "time": {"end": 6.0, "step": "adaptive", "tolerance": 1e-2},
            "output": {"observables": ["spot_radius"]},
        }
    )
    data = data.isel(time=data.time.values >= 0.01)  # contacts of a few points on the ramp have no circle
    a = np.sqrt(data.contact_area / np.pi) - 0.13 / n
    resistance = 1 / (4 * a) - 3.90026492 / (2 * np.pi) + 9.0336217 * a**2 / (6 * np.pi)
    np.testing.assert_allclose(4 * data.spot_radius * resistance, 1.0, rtol=5e-3)
    assert a[-1] / a[0] > 1.5


def test_a_line_leaks_in_closed_form_and_has_a_resistance_per_length():
    line = {"grid": {"points": 256}, "time": {"end": 1.0, "step": 0.5}}
    output = {"leakage": {}, "conductance": {"body": {"resistivity": 2.0}}, "snapshots": [1.0]}
    data = gfmdlayer.run({**line, "output": output})
    last = data.isel(time=-1, snapshot=-1)
    assert float(last.flow_xx) == 0.0
    assert float(last.flow_yy) == pytest.approx(float((last.gap**3).mean()))
    b = float(last.contact_area) / 2 - 0.19 / 256
    # The edge of a strip is open to 0.01 spacings.
    assert float(last.resistance) == pytest.approx(-2 * np.log(np.sin(np.pi * b)) / np.pi, rel=1e-3)
    assert last.resistance.attrs["units"] == "ohm length"


def test_check_knows_the_memory_of_the_flow_and_the_time_of_the_spots():
    config = Config(name="large", grid={"points": [1024, 1024]})
    plain = estimate(config)
    flow = estimate(config.with_values({"output.leakage": {"every": 5}}))
    assert 2.0e9 < flow.memory - plain.memory < 3.0e9  # measured: 2.4 GB for an open gap
    spots = estimate(config.with_values({"output.observables": ["spot_radius"]}))
    assert spots.pairs - plain.pairs > 20 * plain.steps


def test_a_coarse_throat_is_said_at_the_end():
    with pytest.warns(UserWarning, match="t = .*points across it"):
        gfmdlayer.run(CASE, trajectory__load=0.2, output={"leakage": {"every": 5}})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"output": {"observables": ["critical_gap_z"]}}, "must be one of critical_gap_x, critical_gap_y"),
        ({"output": {"observables": ["spot_radius", "spot_radius"]}}, "name it once"),
        ({"grid": {"points": 64}, "output": {"observables": ["critical_gap_y"]}}, "a line does not have"),
        ({"output": {"conductance": {}}}, "two perfect conductors"),
        ({"output": {"stiffness": {"frequencies": []}}}, "a list of 1 to 100 numbers"),
        ({"output": {"stiffness": {"frequencies": [2.0, 1.0]}}}, "frequencies must increase"),
        ({"output": {"leakage": {"every": 0}}}, "every: got 0"),
        (
            {"output": {"stiffness": {"frequencies": [1.0]}}, "trajectory": {"velocity": 1.0}},
            "a punch that does not move",
        ),
        ({"grid": {"geometry": "axisymmetric"}, "output": {"leakage": {}}}, "not used with grid.geometry"),
    ],
)  # fmt: skip
def test_settings_that_cannot_be_used_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        Config(**{"name": "a", "grid": {"points": [32, 32]}, **values})
