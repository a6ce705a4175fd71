"""A sweep of which cases are not complete yet is opened and drawn, and these cases are named."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import gfmdlayer
from gfmdlayer.cli import main
from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import case_path, open_case, open_results
from gfmdlayer.study.folder import Folder

KEYS = {
    "name": "half", "units": {"length": "mm", "stress": "MPa", "time": "s"}, "grid": {"points": 64},
    "time": {"end": 0.3, "step": 0.1}, "output": {"snapshots": [0.3]},
    "sweep": {"layer.thickness": [0.1, 0.2], "trajectory.depth": [0.01, 0.02]},
}  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "half"
    gfmdlayer.run(KEYS, out=folder).close()
    return folder


@pytest.fixture
def folder(whole, tmp_path):
    return Path(shutil.copytree(whole, tmp_path / "half"))


def test_the_complete_cases_of_a_half_finished_sweep_are_those_of_the_whole_one(folder):
    with open_results(folder) as data:
        whole = data.load()
    (folder / "sweep.h5").unlink()
    case_path(folder, 1).unlink()
    case_path(folder, 2).rename(case_path(folder, 2).with_suffix(".checkpoint"))
    case_path(folder, 2).with_suffix(".failed").write_text('{"reason": "no memory"}')
    half = open_results(folder)
    assert (half.attrs["incomplete"], half.attrs["failed"]) == ("0001", "0002: no memory")
    assert (half.attrs["complete"], whole.attrs["complete"]) == (0, 1)
    missing = whole.case.isin([1, 2])
    expected = whole.where(~missing).drop_vars("case").assign_coords(case=whole.case)
    xr.testing.assert_identical(half.load().drop_attrs(), expected[list(half)].drop_attrs())
    assert half.thickness.attrs == whole.thickness.attrs
    notes = curves_figure(half).get_supxlabel()
    assert "1 of 4 cases not complete yet" in notes
    assert "1 of 4 cases failed" in notes


@pytest.mark.parametrize("verb", ["plot", "report"])
def test_pictures_and_report_of_a_half_finished_sweep_name_its_cases(folder, verb, capsys):
    (folder / "sweep.h5").unlink()
    case_path(folder, 3).unlink()
    assert main([verb, str(folder)]) == 0
    assert capsys.readouterr().err == "note: 1 of 4 cases not complete yet: 0003\n"


def test_a_sweep_that_grows_is_not_taken_for_the_one_before(folder):
    sweep = KEYS["sweep"] | {"trajectory.depth": [0.01, 0.02, 0.03]}
    Folder(folder).store(gfmdlayer.load(folder / "config.yaml", {"sweep": sweep}), [0, 1, 4, 2, 3, 5])
    data = open_results(folder)
    assert data.attrs["incomplete"] == "0004 0005"
    np.testing.assert_array_equal(data.case, [[0, 1, 4], [2, 3, 5]])


def test_a_sweep_without_a_complete_case_is_refused(folder):
    (folder / "sweep.h5").unlink()
    for index in range(4):
        case_path(folder, index).unlink()
    with pytest.raises(ResultsError, match="no complete case"):
        open_results(folder)


def test_cases_carry_the_swept_values_as_coordinates(folder):
    """So xarray puts them together; `depth` is a column, and the swept key has its whole name."""
    cases = [open_case(case_path(folder, index)) for index in (0, 2)]
    found = xr.concat(cases, "thickness", data_vars="all", coords="different", compat="equals", join="outer")
    np.testing.assert_array_equal(found.thickness, [0.1, 0.2])
    assert found.thickness.attrs == {"long_name": "thickness of the layer", "symbol": "d", "units": "mm"}
    assert float(cases[1].coords["trajectory.depth"]) == 0.01
    assert found.depth.dims == ("thickness", "time")
    np.testing.assert_array_equal(found.force[1], cases[1].force)


@pytest.mark.filterwarnings("error::FutureWarning", "error::DeprecationWarning")
def test_nothing_that_xarray_will_change_is_used(folder, tmp_path):
    with open_results(folder) as data:
        data.load().to_netcdf(tmp_path / "copy.nc", engine="h5netcdf")
        curves_figure(data, x="thickness", time=0.1)
        curves_figure(data, x="thickness", y=["force"])
    (folder / "sweep.h5").unlink()
    case_path(folder, 3).unlink()
    open_results(folder).close()
    memory = gfmdlayer.run(KEYS)
    memory.to_netcdf(tmp_path / "memory.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "memory.nc", engine="h5netcdf") as copy:
        np.testing.assert_array_equal(copy.force, memory.force)
