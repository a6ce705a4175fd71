"""The examples under scripts/examples run on a sweep, and find what the sweep holds."""

import csv
import runpy
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer import open_results
from gfmdlayer.config import Config
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.reader import case_path
from gfmdlayer.study.folder import MARK
from gfmdlayer.study.run import run_study
from gfmdlayer.study.workers import assemble
from tests.recordings import case_file

EXAMPLES = Path(__file__).parents[2] / "scripts" / "examples"
TINY = {
    "name": "tiny", "grid": {"points": 1024}, "time": {"end": 4.0, "step": 0.1},
    "solver": {"method": "active_set"}, "output": {"snapshots": [1.0, 4.0]},
    "sweep": {"layer.thickness": [0.0625, 0.25], "layer.material.Ginf": [2, 5, 10]},
}  # fmt: skip


def example(monkeypatch, name, *arguments):
    """Run an example as a user would; return its variables."""
    monkeypatch.setattr("sys.argv", [name, *map(str, arguments)])
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """Return the folder of a sweep over two keys."""
    folder = tmp_path_factory.mktemp("results") / "tiny"
    with assemble() as team:
        assert team is not None
        assert run_study(Config(**TINY), folder, team).count("complete") == 6
    return folder


def test_every_example_is_tested():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {"relaxation_time", "parameter_map", "export_csv"}


def test_relaxation_time_of_exponentials_is_found(tmp_path, monkeypatch):
    step, end, taus = 0.05, 16.0, (0.5, 1.0, 2.0, 0.0)
    sweep = {"layer.material.tau": [0.5, 1.0, 2.0, 4.0]}
    (tmp_path / "config.yaml").write_text(MARK + Config(name="known", sweep=dict(sweep)).dump())
    records = []
    for index, tau in enumerate(taus):
        path = case_path(tmp_path, index)
        records.append(CaseRecord(index, path, {"layer.material.tau": sweep["layer.material.tau"][index]}))
        with case_file(path, {"x": np.arange(8.0)}) as case:
            for time in np.arange(0.0, end + step / 2, step):
                left = np.exp(-(time - 1) / tau) if tau else 0.0  # the ramp ends at 1
                case.row(time=time, contact_area=min(time, 0.3 - 0.1 * left), mean_pressure=0.1)
    collect(tmp_path, records, Swept(list(sweep)))
    found = example(monkeypatch, "relaxation_time", tmp_path)["relaxation_time"]
    assert found.dims == ("tau",)
    # The trapezoidal rule adds step^2/12 of the slope at the start, the end cuts off exp(-15/tau) (15 + tau).
    for place, tau in enumerate(taus[:3]):
        bound = step**2 / 12 / tau + np.exp(-15 / tau) * (15 + tau) + 1e-12
        assert abs(found[place] - tau) <= bound
    assert np.isnan(found[3])  # an area that does not move has no relaxation time


def test_relaxation_time_of_a_real_sweep_is_told_or_left_out(tiny, monkeypatch):
    found = example(monkeypatch, "relaxation_time", tiny)
    assert found["relaxation_time"].dims == ("thickness", "Ginf")
    told = abs(found["change"]) > 10 / 1024
    assert 0 < told.sum() < 6  # the soft glass on the thick layer hardly moves
    np.testing.assert_array_equal(np.isfinite(found["relaxation_time"]), told)
    # The area relaxes within the run and not before its material does.
    assert found["relaxation_time"].min() > 0.5
    assert found["relaxation_time"].max() < 3.0


def test_cases_with_time_steps_of_their_own_have_the_same_table_and_map(tiny, tmp_path, monkeypatch):
    """Fixed steps of 0.1 are off by some 1 % of the pressure at its peak; adaptive ones by 1e-3."""
    adaptive = {"time": {"end": 4.0, "step": "adaptive"}, "output": {"snapshots": [4.0]}}
    folder, config = tmp_path / "own", Config(**(TINY | adaptive))
    with assemble() as team:
        assert team is not None
        run_study(config, folder, team)
    assert "row" in open_results(folder).dims
    for name, value in (("relaxation_time", "relaxation_time"), ("parameter_map", "overshoot")):
        found = example(monkeypatch, name, folder, tmp_path / "map.pdf")[value]
        expected = example(monkeypatch, name, tiny, tmp_path / "map.pdf")[value]
        assert found.dims == expected.dims
        np.testing.assert_allclose(found, expected, rtol=0.1)


def test_map_of_the_overshoot_is_drawn(tiny, tmp_path, monkeypatch):
    variables = example(monkeypatch, "parameter_map", tiny, tmp_path / "map.pdf")
    assert (tmp_path / "map.pdf").read_bytes().startswith(b"%PDF")
    overshoot = variables["overshoot"]
    assert overshoot.dims == ("thickness", "Ginf")
    # A stiffer glass overshoots more, never beyond Ginf/G0; an elastic halfspace beneath can only lessen it.
    assert (overshoot.diff("Ginf") > 0).all()
    assert (overshoot > 1).all()
    assert (overshoot < overshoot["Ginf"]).all()


def test_export_has_a_line_for_each_case_and_time(tiny, tmp_path, monkeypatch):
    results = example(monkeypatch, "export_csv", tiny, tmp_path)["results"]
    with (tmp_path / "curves.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 3 * 41
    cases = product(TINY["sweep"]["layer.thickness"], TINY["sweep"]["layer.material.Ginf"])
    for i, (thickness, stiffness) in enumerate(cases):
        own = rows[41 * i : 41 * (i + 1)]
        assert {(float(row["thickness"]), float(row["Ginf"])) for row in own} == {(thickness, stiffness)}
        one = results.sel(thickness=thickness, Ginf=stiffness)
        for name in ("time", "contact_area", "mean_pressure"):
            np.testing.assert_array_equal([float(row[name]) for row in own], one[name])
    with (tmp_path / "profiles.csv").open() as file:
        profiles = list(csv.DictReader(file))
    assert len(profiles) == 2 * 3 * 1024
    last = results["pressure"].isel(thickness=1, Ginf=2, snapshot=-1)
    np.testing.assert_array_equal([float(row["pressure"]) for row in profiles[-1024:]], last)
