"""One rule names the coordinates of swept keys: none means something else in a dataset."""

import numpy as np
import pytest
import xarray

import gfmdlayer
from gfmdlayer.config import Config
from gfmdlayer.observables import Column, known_columns, known_numbers
from gfmdlayer.observables.observable import Bins, Places
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.names import ROW, SNAPSHOT_ROW, VARIABLES, dimension_names
from gfmdlayer.results.reader import case_path, open_results
from gfmdlayer.validation.sections import OneOf, held_by
from tests.recordings import case_file, named

X = np.linspace(-0.5, 0.5, 8, endpoint=False)
ARGUMENTS_OF_SEL = {"indexers", "method", "tolerance", "drop"}
# Each dimension that columns may have, and a field below the surface with the others.
ALONG = (
    Places("interface", "number of the interface", "1", (0.0, 1.0)),
    Places("frequency", "frequency", "1 / time", (0.0, 1.0)),
    Bins("gap_bin", "the gap", "length", (0.0, 1.0, 2.0)),
    Bins("pressure_bin", "pressure", "pressure", (0.0, 1.0, 2.0)),
)
COLUMNS = (
    *(Column(name, name) for name in ("time", "contact_area", "depth", "work", "temperature")),
    *(Column(f"along_{each.name}", "numbers", along=each) for each in ALONG),
)


def keys_below(section, at=""):
    """Yield every dotted key of a section, of all kinds that it may have; lists have one entry."""
    for key, field in section.fields().items():
        held = held_by(field)
        yield f"{at}{key}"
        members = held.members.values() if isinstance(held, OneOf) else filter(None, [held])
        for member in members if at.count(".") < 6 else ():
            yield from keys_below(member, f"{at}{key}.")


UNSWEPT = ("name", "units", "sweep")
EVERY = [key for key in dict.fromkeys(keys_below(Config)) if key.partition(".")[0] not in UNSWEPT]
# Keys of a body of the user's own may have any name; so have the places of lists.
OWN = ["body.frequency", "body.interface", "body.gap_bin", "body.pull_off_force", "body.x", "body.time"]
OWN += ["interface.0", "layers.1.thickness", "body.row", "body.snapshot_row", "body.case"]


def dimensions():
    """Names that results have for other things."""
    ends = {name for each in ALONG for name, *_ in each.ends}
    return {*VARIABLES, *known_numbers(), *ends, "time", "case", ROW, SNAPSHOT_ROW}


def test_no_name_means_something_else():
    """Columns make room themselves: depth_over_time; every other meaning leaves the whole key."""
    keys = [*EVERY, *OWN]
    assert {"trajectory.load", "temperature.value", "interface", "punch.shape", "solver.method"} < {*keys}
    of_xarray = {name for each in (xarray.Dataset, xarray.DataArray) for name in dir(each)}
    ends = {name for each in ALONG for name, *_ in each.ends}
    for key in keys:
        (name,) = dimension_names([key], ends)
        assert name in (key, key.rpartition(".")[2], f"sweep.{key}")
        assert not {name} & (dimensions() | of_xarray | ARGUMENTS_OF_SEL | {"value"}), key
        assert not name.isdigit()


def test_names_that_were_clear_stay():
    keys = ["layer.thickness", "layer.material.G0", "punch.radius", "trajectory.depth", "interface.work"]
    assert dimension_names(keys) == ["thickness", "G0", "radius", "depth", "work"]
    assert dimension_names(["interface"]) == ["interface"]  # no column lies along another one
    assert dimension_names(["solver.method"]) == ["solver.method"]


LAST = {each.rpartition(".")[2]: each for each in EVERY}
# Of those that keep their last parts some are enough, and those whose last part is a column.
TAKEN = [each for last, each in LAST.items() if dimension_names([each]) != [last] or last in known_columns()]


SWEPT = [*TAKEN, *OWN, "interface", "layer.thickness", "grid.points"]
# Listed cases have the names of the others: one in four of them is quick.
LISTED = [pytest.param(key, True, marks=pytest.mark.slow if i % 4 else ()) for i, key in enumerate(SWEPT)]


@pytest.mark.parametrize(("key", "listed"), [*((key, False) for key in SWEPT), *LISTED])
def test_cases_are_selected_by_every_key_beside_every_dimension(tmp_path, key, listed):
    records = []
    for index in range(2):
        path = case_path(tmp_path, index)
        columns, swept = COLUMNS, {key: 0.5 * (index + 1)}
        with case_file(path, {"x": X}, {"name": "demo"}, columns, swept=swept) as case:
            for time in (0.0, 1.0):
                numbers = {each.name: np.full(each.size, time) if each.along else time for each in COLUMNS}
                case.row(**numbers | {"contact_area": (index + 1) * time})
            case.snapshot(1.0, named((index + 1) * X, X))
        records.append(CaseRecord(index, path, swept))
    collect(tmp_path, records, Swept([key], listed))
    (name,) = dimension_names([key], [end for each in ALONG for end, *_ in each.ends])
    with open_results(tmp_path) as data:
        assert data.coords[name].attrs["key"] == key
        if listed:
            found = data.isel(case=data[name].to_numpy().tolist().index(1.0))
        else:
            found = data.sel({name: 1.0})
            assert data["contact_area"].dims == (name, "time")
        assert float(found["contact_area"].sel(time=1.0)) == 2.0
        assert found["along_interface"].dims == ("time", "interface")
        if not key.startswith("grid."):  # of other grids the cases have fields of their own
            np.testing.assert_array_equal(found["displacement"].sel(snapshot=1.0), 2 * X)


def test_interfaces_are_swept_beside_the_stresses_at_interfaces():
    laws = [{"law": "hard_wall"}, {"law": "exponential", "work": 1e-4, "range": 0.01}]
    given = {
        "grid": {"points": 64}, "trajectory": {"depth": 0.01, "ramp_time": 0.5},
        "time": {"end": 1.0, "step": 0.5}, "output": {"inside": {"points": 3, "every": 1}},
    }  # fmt: skip
    with pytest.warns(UserWarning, match="COARSE"):
        data = gfmdlayer.run(given, sweep={"interface": laws})
    assert data["interface_peel"].dims == ("sweep.interface", "time", "interface")
    assert data["contact_area"].notnull().all()
    attracted = data.sel({"sweep.interface": data["sweep.interface"][1]})
    assert float(attracted["largest_tension"].max()) > 0


SNAPSHOTS = {"name": "s", "grid": {"points": 64}, "time": {"end": 2.0, "step": 0.5}}


@pytest.mark.parametrize(
    ("asked", "times", "known"),
    [
        ([[1], [1, 2]], [1.0, 2.0], [[1, 0], [1, 1]]),  # the first ones of the other: one axis
        ([[], [1, 2]], [1.0, 2.0], [[0, 0], [1, 1]]),
        ([[2], [1, 2]], [[2.0, np.nan], [1.0, 2.0]], [[1, 0], [1, 1]]),  # else the times of each case
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_fields_of_cases_with_other_snapshots_are_loaded(tmp_path, asked, times, known):
    held = gfmdlayer.run(SNAPSHOTS, sweep={"output.snapshots": asked})
    opened = gfmdlayer.run(SNAPSHOTS, sweep={"output.snapshots": asked}, out=tmp_path / "results")
    for data in (held, opened.load()):
        np.testing.assert_array_equal(data["snapshot"], times)
        assert "snapshot" in data.coords
        np.testing.assert_array_equal(data["pressure"].notnull().all("x"), known)
    xarray.testing.assert_equal(held["pressure"], opened["pressure"])
    case = gfmdlayer.open_case(tmp_path / "results" / "cases" / "0001.h5")
    np.testing.assert_array_equal(opened["pressure"][1], case["pressure"])
    assert float(opened["pressure"][1, 0].max()) == float(case["pressure"].sel(snapshot=1.0).max())


@pytest.mark.filterwarnings("ignore")
def test_snapshots_at_the_steady_states_of_several_velocities_are_loaded():
    given = {"grid": {"points": 64}, "time": {"end": 60.0, "step": "adaptive", "steady": 1e-3}}
    data = gfmdlayer.run(given, output={"snapshots": [1.0]}, sweep={"trajectory.velocity": [0.5, 2.0]})
    assert data["pressure"].dims == ("velocity", SNAPSHOT_ROW, "x")
    ends = data["time"].max("row")
    np.testing.assert_allclose(data["snapshot"].isel(snapshot_row=-1), ends)
    assert data["pressure"].notnull().all()
    assert float(ends[0]) != float(ends[1])


def test_a_column_of_results_is_no_dimension_of_a_case():
    """The values of swept keys in the file of a case follow the same rule, beside its columns."""
    names = dimension_names(["trajectory.depth", "temperature.value"], known_columns())
    assert names == ["trajectory.depth", "temperature.value"]
