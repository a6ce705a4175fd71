"""An observable is one class and one line in the table: files, sweep, checkpoints and costs follow."""

import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config
from gfmdlayer.observables import OBSERVABLES, Column, Observable, columns
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.reader import open_case, open_results
from gfmdlayer.study.case_run import run_case
from gfmdlayer.study.cases import SweepCase
from gfmdlayer.study.cost import estimate
from gfmdlayer.study.folder import Folder
from tests.recordings import Kept

CONFIG = Config(name="rms").with_values(
    {"grid.points": 32, "time": {"end": 1.5, "step": 0.125}, "output.snapshots": [0.5, 1.0, 1.5]}
)


class RmsPressure(Observable):
    """Root mean square pressure, and its largest value so far, which a resumed run has to remember."""

    COLUMNS = (
        Column("pressure_rms", "root mean square of the contact pressure", "pressure"),
        Column("largest_rms", "largest rms pressure so far", "pressure"),
    )

    def __init__(self, _case):
        self._largest = 0.0

    def measure(self, step):
        rms = float(np.sqrt(np.mean(step.fields["pressure"] ** 2)))
        self._largest = max(self._largest, rms)
        return {"pressure_rms": rms, "largest_rms": self._largest}

    def state(self):
        return {"largest": self._largest}

    def restore(self, state):
        self._largest = float(state["largest"])


def test_a_new_column_is_in_the_files_the_sweep_a_resumed_run_and_the_estimate(
    tmp_path, monkeypatch, run_up_to
):
    before = estimate(CONFIG.model_copy()).storage
    monkeypatch.setitem(OBSERVABLES, "pressure_rms", RmsPressure)
    config = CONFIG.model_copy()  # whose columns are not known yet
    assert estimate(config).storage - before == 2 * 8 * 512  # a block of rows for each column
    folder, case = Folder(tmp_path), SweepCase(0, config, {})
    folder.cases.mkdir()
    run_up_to(1.25, case, folder)  # after the largest pressure, at the end of the ramp
    assert run_case(case, folder).state == "complete"
    with open_case(folder.case(0)) as found:
        rms = found["pressure_rms"]
        assert rms.attrs["long_name"] == "root mean square of the contact pressure"
        assert rms.attrs["units"] == "pressure"
        pressure = found["pressure"]
        np.testing.assert_allclose(
            rms.sel(time=pressure["snapshot"].values), np.sqrt((pressure**2).mean("x")), rtol=1e-12
        )
        np.testing.assert_array_equal(found["largest_rms"], np.maximum.accumulate(rms.values))
        assert rms.values.argmax() == 8
        rows = rms.values
    collect(tmp_path, [CaseRecord(0, folder.case(0), {})], Swept([]))
    with xr.open_dataset(tmp_path / "sweep.h5", engine="h5netcdf") as sweep:
        np.testing.assert_array_equal(sweep["pressure_rms"], rows)
        assert sweep["pressure_rms"].attrs["units"] == "pressure"
        np.testing.assert_array_equal(sweep["largest_rms"], np.maximum.accumulate(rows))


def test_columns_are_known_without_compiled_code():
    program = "import sys, gfmdlayer.observables; print({'numba', 'numpy'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({}, set()),
        ({"trajectory.velocity": 0.1}, {"position", "tangential_force", "friction", "contact_centre"}),
        ({"output.patches": True}, {"patches"}),
        ({"output.histograms.gap": {"max": 0.1, "bins": 7}}, {"gap_histogram"}),
    ],
    ids=["plain", "velocity", "patches", "histogram"],
)
def test_a_configuration_has_the_columns_of_its_options(values, expected):
    always = {column.name for column in columns(CONFIG)}
    asked = {column.name: column for column in columns(CONFIG.with_values(values))}
    assert asked.keys() - always == expected
    assert always <= asked.keys()
    if "gap_histogram" in asked:
        assert asked["gap_histogram"].size == 8  # the last bin is beyond max


# --- mean stress and force, prescribed and measured, with units ---

UNITS = {"length": "mm", "stress": "MPa", "time": "s"}
LINE = Config(name="line").with_values(
    {"grid": {"points": 64, "period": 2.0}, "time": {"end": 1.0, "step": 0.25}, "layer.material.G0": 3.0,
     "layer.material.Ginf": 5.0}
)  # fmt: skip
SURFACE = LINE.with_values({"grid": {"points": [16, 8], "period": [2.0, 1.5]}})


def rows(config):
    recording = Kept()
    simulate(config, recording)
    return {name: np.asarray(recording[name]) for name in ("mean_pressure", "mean_stress", "force", "depth")}


@pytest.mark.parametrize(("config", "cell"), [(LINE, 2.0), (SURFACE, 3.0)], ids=["line", "surface"])
def test_force_and_mean_stress_follow_from_ptilde(config, cell):
    found = rows(config)
    assert found["force"][-1] > 0
    np.testing.assert_allclose(found["mean_stress"], 2 * 3.0 * found["mean_pressure"], rtol=1e-14)
    np.testing.assert_allclose(found["force"], cell * found["mean_stress"], rtol=1e-14)


@pytest.mark.parametrize(("config", "cell"), [(LINE, 2.0), (SURFACE, 3.0)], ids=["line", "surface"])
def test_a_prescribed_force_is_the_load_times_the_cell(config, cell, tmp_path):
    by_load = rows(config.with_values({"trajectory": {"control": "load", "load": 0.5}}))
    by_force = rows(config.with_values({"trajectory": {"control": "force", "force": 0.5 * cell}}))
    for name, values in by_load.items():
        np.testing.assert_array_equal(by_force[name], values)
    table = tmp_path / "force.txt"
    table.write_text(f"time force\n0 0\n1 {0.5 * cell}\n")
    trajectory = {"control": "force", "kind": "table", "file": str(table)}
    by_table = rows(config.with_values({"trajectory": trajectory}))
    np.testing.assert_allclose(by_table["force"], by_load["force"], rtol=1e-12)
    np.testing.assert_allclose(by_table["depth"], by_load["depth"], rtol=1e-12)


def test_files_of_cases_and_sweeps_name_units_and_modulus(tmp_path):
    folder, records = Folder(tmp_path), []
    folder.cases.mkdir()
    histogram = {"max": 1.0, "bins": 2}
    config = LINE.with_values(
        {"units": UNITS, "output.histograms": {"pressure": histogram}, "output.snapshots": [1.0]}
    )
    for index, force in enumerate((0.5, 1.0)):
        values = {"trajectory": {"control": "force", "force": force}}
        assert run_case(SweepCase(index, config.with_values(values), {}), folder).state == "complete"
        records.append(CaseRecord(index, folder.case(index), {"trajectory.force": force}))
    collect(tmp_path, records, Swept(["trajectory.force"], unit=config.unit))
    expected = {
        "time": "s", "mean_pressure": "1", "mean_stress": "MPa", "depth": "mm", "work": "N/mm",
        "pressure_bin": "MPa", "pressure_bin_end": "MPa",
    }  # fmt: skip
    with open_case(folder.case(0)) as case:
        fields = {"x": "mm", "snapshot": "s", "displacement": "mm", "pressure": "MPa", "gap": "mm"}
        for name, label in (expected | fields | {"force": "N/mm"}).items():
            assert case[name].attrs["units"] == label, name
        assert case.attrs["G0"] == 3.0
        assert case.attrs["units"] == "length: mm, stress: MPa, time: s"
    with open_results(tmp_path) as sweep:
        for name, label in (expected | {"force": "N/mm", "force_over_time": "N/mm"}).items():
            assert sweep[name].attrs["units"] == label, name
        assert sweep["force"].dims == ("force",)  # the swept key
        np.testing.assert_allclose(sweep["force_over_time"].sel(time=1.0), [0.5, 1.0], rtol=1e-6)
        assert sweep.attrs["G0"] == 3.0
        assert sweep.attrs["units"] == "length: mm, stress: MPa, time: s"
