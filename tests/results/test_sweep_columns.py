"""The sweep file has every column that the cases have; what a case lacks is NaN, with a word about it."""

import numpy as np

from gfmdlayer.observables import Column
from gfmdlayer.observables.observable import Bins
from gfmdlayer.results import provenance
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.reader import case_path, open_results
from tests.recordings import case_file

TIMES = (0.0, 1.0, 3.0)
PLAIN = (Column("time", "time", "time"), Column("depth", "indentation depth", "length"))


def gap_histogram(*edges):
    return Column("gap_histogram", "part of the surface", along=Bins("gap_bin", "the gap", "length", edges))


def write(folder, index, *further):
    """Write a case whose columns are its number plus one times the time."""
    path = case_path(folder, index)
    with case_file(path, {"x": np.arange(8.0)}, {"name": "demo"}, (*PLAIN, *further)) as case:
        for time in TIMES:
            level = (index + 1) * time
            rows = {each.name: np.full(each.size, level) if each.along else level for each in further}
            case.row(time=time, depth=level, **rows)
    return CaseRecord(index, path, {"trajectory.depth": 0.1 * (index + 1), "punch.radius": 2.0})


def test_numbers_and_distributions_of_all_cases_are_labelled(tmp_path):
    of_gap, count = gap_histogram(0.0, 1.0, np.inf), Column("patches", "number of patches", dtype="i8")
    records = [write(tmp_path, index, of_gap, count) for index in range(3)]
    collect(tmp_path, records, Swept(["trajectory.depth", "punch.radius"]))
    with open_results(tmp_path) as data:
        assert data["gap_histogram"].dims == ("depth", "radius", "time", "gap_bin")
        assert data["gap_histogram"].attrs["long_name"] == "part of the surface"
        np.testing.assert_array_equal(data["gap_bin"], [0.0, 1.0])
        np.testing.assert_array_equal(data["gap_histogram"].coords["gap_bin_end"], [1.0, np.inf])
        expected = np.outer([1, 2, 3], TIMES)
        np.testing.assert_array_equal(data["patches"].sel(radius=2.0), expected)
        np.testing.assert_array_equal(
            data["gap_histogram"].isel(radius=0), np.repeat(expected[..., None], 2, axis=-1)
        )
        # The swept key keeps its name, and the column gets another.
        np.testing.assert_allclose(data["depth"], [0.1, 0.2, 0.3])
        np.testing.assert_array_equal(data["depth_over_time"].isel(radius=0), expected)
        assert data["depth_over_time"].attrs["units"] == "length"
        assert data.attrs["notes"] == ""


def test_a_column_that_some_cases_lack_is_nan_there_and_said(tmp_path, monkeypatch):
    records = [write(tmp_path, 0, gap_histogram(0.0, 1.0, np.inf), Column("work", "work"))]
    records += [write(tmp_path, 1, gap_histogram(0.0, 2.0, np.inf), Column("work", "work"))]
    monkeypatch.setattr(provenance, "git_commit", lambda _: "an earlier one")
    provenance._software.cache_clear()
    records += [write(tmp_path, index) for index in range(2, 9)]
    provenance._software.cache_clear()
    collect(tmp_path, records, Swept(["trajectory.depth"]))
    with open_results(tmp_path) as data:
        assert data["work"].isnull().all("time").to_numpy().tolist() == [False] * 2 + [True] * 7
        found = data["gap_histogram"].isnull().all(("time", "gap_bin")).to_numpy().tolist()
        assert found == [False] + [True] * 8
        assert not data["depth_over_time"].isnull().any()
        of_versions, of_histogram, of_work = sorted(data.attrs["notes"].splitlines())
    first = "NaN in cases 0001, 0002, 0003, 0004, 0005 and 3 more"
    assert of_histogram == f"gap_histogram: {first}"
    assert of_versions.startswith("different versions")
    assert of_work == "work: NaN in cases 0002, 0003, 0004, 0005, 0006 and 2 more"
