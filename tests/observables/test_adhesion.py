"""Observables of an interface that attracts, against the surfaces and curves that they come from."""

from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

import gfmdlayer
from gfmdlayer.config import Config
from gfmdlayer.grid.grid import Grid
from gfmdlayer.observables import columns
from gfmdlayer.observables.adhesion import PART, AdhesionColumns
from gfmdlayer.results.recording import Recording

LAW = {"law": "exponential", "work": 1e-3, "range": 4e-3}
PULL = {
    "grid": {"points": 256}, "layer": {"thickness": 0}, "interface": LAW,
    "trajectory": {"kind": "approach_retract", "start": -0.01, "depth": 0.002, "approach_speed": 0.01,
     "retract_speed": 0.01},
    "time": {"step": 0.02},
}  # fmt: skip


@pytest.fixture(scope="module")
def pulled():
    return gfmdlayer.run(PULL | {"output": {"snapshots": [1.2, 1.6]}})


def test_energy_tension_and_attractive_area_follow_from_the_surface(pulled):
    law = gfmdlayer.Exponential(work=1e-3, range=4e-3)
    for time in (1.2, 1.6):
        row, surface = pulled.sel(time=time, method="nearest"), pulled.sel(snapshot=time)
        gap = surface.gap.to_numpy()
        # The gap of a point in contact is exactly zero in a snapshot, and within the residual in the row.
        assert float(row.interface_energy) == pytest.approx(law.energy(gap).mean(), rel=1e-5)
        attracted = (gap > 0) & (law.traction(gap) >= PART * 0.25)
        assert float(row.attractive_area) == attracted.mean() > 0
        assert float(row.largest_tension) == -float(surface.pressure.min()) > 0


def test_pull_off_and_work_of_separation_follow_from_the_curve(pulled):
    force, depth = pulled.force.to_numpy(), pulled.depth.to_numpy()
    back = np.append(False, np.diff(depth) <= 0)
    assert pulled.attrs["pull_off_force"] == -force[back].min() > 0.01
    assert pulled.attrs["pull_off_stress"] == -pulled.mean_stress.to_numpy()[back].min()
    # Much finer than the steps, so that where the force changes sign does not matter.
    fine = np.linspace(0, depth.size - 1, 100 * (depth.size - 1) + 1)
    pull = np.maximum(-np.interp(fine, np.arange(depth.size), force), 0)
    fallen = np.maximum(-np.diff(np.interp(fine, np.arange(depth.size), depth)), 0)
    work = float((0.5 * (pull[1:] + pull[:-1]) * fallen).sum())
    assert pulled.attrs["work_of_separation"] == pytest.approx(work, rel=1e-4)


def test_a_sweep_holds_the_numbers_of_its_cases(tmp_path):
    short = PULL | {"time": {"step": 0.1}}
    swept = {"interface.work": [5e-4, 1e-3], "trajectory.retract_speed": [0.01, 0.02]}
    memory = gfmdlayer.run(short, sweep=swept)
    folder = gfmdlayer.run(short, sweep=swept, out=tmp_path / "out")
    for data in (memory, folder):
        assert data.pull_off_force.dims == ("work", "retract_speed")
        assert data.pull_off_force.attrs["units"] == "force / length"
        assert (data.pull_off_force.isel(work=1) > data.pull_off_force.isel(work=0)).all()
        assert "pull_off_force" not in data.attrs
    xarray.testing.assert_equal(memory.work_of_separation, folder.work_of_separation.load())
    case = gfmdlayer.open_case(tmp_path / "out" / "cases" / "0003.h5")
    assert case.attrs["pull_off_force"] == float(folder.pull_off_force[1, 1])


def test_the_hard_wall_has_no_columns_of_adhesion():
    names = {column.name for column in columns(Config(name="a", interface={"law": "hard_wall"}))}
    assert names.isdisjoint(column.name for column in AdhesionColumns.COLUMNS)
    assert names == {column.name for column in columns(Config(name="a"))}


def test_the_work_counts_only_the_pull_in_retraction():
    law, nothing = gfmdlayer.Exponential(work=1e-3, range=4e-3).interaction(), np.zeros(4)
    fields = {"touching": nothing == 0, "traction": nothing, "distance": nothing, "pressure": nothing}
    found = AdhesionColumns(SimpleNamespace(grid=Grid((4,), (1.0,))))
    for depth, pressure in ((0, -3), (1, -3), (2, -1), (1, 1), (0, -1), (-1, -1), (-2, 0)):
        row = {"force": 2 * pressure}
        found.measure(
            SimpleNamespace(depth=depth, mean_pressure=pressure, row=row, interface=law, fields=fields)
        )
    # From 2 to 1 and from 1 to 0 half a step each pulls, 1/4; then a whole one, 1, and a triangle, 1/2.
    assert found.attributes == {"pull_off_force": 2, "pull_off_stress": 1, "work_of_separation": 2.0}


def test_snapshots_hold_the_traction_in_memory_in_files_and_after_a_resume(pulled, tmp_path):
    law = gfmdlayer.Exponential(work=1e-3, range=4e-3)
    np.testing.assert_allclose(pulled.traction, law.traction(pulled.gap), rtol=1e-14)
    keys = PULL | {"name": "a", "output": {"snapshots": [1.2, 1.6]}}
    folder = gfmdlayer.run(keys, out=tmp_path / "out")
    xarray.testing.assert_equal(folder.traction.load(), pulled.traction)
    assert "traction" not in gfmdlayer.run(keys | {"interface": {"law": "hard_wall"}, "time": {"step": 0.1}})
    # The recording of a case that is taken up has what a checkpoint has kept.
    fields = {name: np.full(256, float(i)) for i, name in enumerate(("displacement", "pressure", "traction"))}
    one, again = Recording(tmp_path / "snapshots"), Recording(tmp_path / "snapshots")
    with closing(one), closing(again):
        one.row(time=0.0)
        one.snapshot(0.5, fields)
        again.go_on(*one.kept())
        assert again.fields.keys() == fields.keys()
        np.testing.assert_array_equal([each for (each,) in again.fields.values()], [*fields.values()])
