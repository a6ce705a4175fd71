"""Mean stress and force of a contact, prescribed and measured, with units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gfmdlayer.config import Config
from gfmdlayer.execution.case_run import run_case
from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.sweep import SweepCase
from gfmdlayer.model import simulate
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.reader import open_case, open_results
from gfmdlayer.verification.runs import Recording

UNITS = {"length": "mm", "stress": "MPa", "time": "s"}
LINE = Config(name="line").with_values(
    {"grid": {"points": 64, "period": 2.0}, "time": {"end": 1.0, "step": 0.25}, "layer.material.G0": 3.0,
     "layer.material.Ginf": 5.0}
)  # fmt: skip
SURFACE = LINE.with_values({"grid": {"points": [16, 8], "period": [2.0, 1.5]}})


def rows(config: Config) -> dict[str, np.ndarray]:
    recording = Recording()
    simulate(config, recording)
    return {name: np.asarray(recording[name]) for name in ("mean_pressure", "mean_stress", "force", "depth")}


@pytest.mark.parametrize(("config", "cell"), [(LINE, 2.0), (SURFACE, 3.0)], ids=["line", "surface"])
def test_force_and_mean_stress_follow_from_ptilde(config: Config, cell: float) -> None:
    found = rows(config)
    assert found["force"][-1] > 0
    np.testing.assert_allclose(found["mean_stress"], 2 * 3.0 * found["mean_pressure"], rtol=1e-14)
    np.testing.assert_allclose(found["force"], cell * found["mean_stress"], rtol=1e-14)


@pytest.mark.parametrize(("config", "cell"), [(LINE, 2.0), (SURFACE, 3.0)], ids=["line", "surface"])
def test_a_prescribed_force_is_the_load_times_the_cell(config: Config, cell: float, tmp_path: Path) -> None:
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


def test_files_of_cases_and_sweeps_name_units_and_modulus(tmp_path: Path) -> None:
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
