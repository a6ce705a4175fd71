"""Result files are read back labelled, and a file under its final name is complete."""

import os
import subprocess
import sys
import tracemalloc
from itertools import product

import h5py
import numpy as np
import pytest
import xarray as xr

from gfmdlayer.observables import Column, known_columns
from gfmdlayer.observables.observable import Bins
from gfmdlayer.results import case_file as files
from gfmdlayer.results import gathering
from gfmdlayer.results.case_file import case_contents
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.names import VARIABLES, ResultsError, dimension_names
from gfmdlayer.results.netcdf import PACKED, new_file
from gfmdlayer.results.provenance import git_commit
from gfmdlayer.results.reader import attributes, case_path, is_complete, open_case, open_results
from gfmdlayer.results.recording import FEWEST, Recording
from tests.recordings import case_file, named

X = np.linspace(-0.5, 0.5, 16, endpoint=False)
TIMES = np.array([0.0, 0.5, 1.0])


def write_case(path, times=tuple(TIMES), level=1.0, **about):
    with case_file(path, {"x": X}, {"name": "demo", "digest": "abc", "tau": 1.0, **about}) as case:
        for time in times:
            case.row(time=time, contact_area=level * time, mean_pressure=-level * time, transforms=7)
        case.snapshot(1.0, named(level * X, X**2))
    return path


def write_sweep(folder, values):
    """Write cases whose contact area at time 1 is their number plus one."""
    paths = [write_case(case_path(folder, index), level=index + 1.0) for index in range(len(values))]
    return [CaseRecord(i, path, v) for i, (path, v) in enumerate(zip(paths, values, strict=True))]


def collected(folder, records, keys, **how):
    """Collect cases over swept keys, and open the sweep."""
    collect(folder, records, Swept(keys, **how))
    return open_results(folder)


def damage(path, variable="contact_area"):
    """Change a bit of a variable on the disk."""
    with h5py.File(path) as h5:
        chunk = h5[variable].id.get_chunk_info(0)
    contents = bytearray(path.read_bytes())
    contents[chunk.byte_offset + 9] ^= 1
    path.write_bytes(contents)


def test_case_is_read_by_xarray_with_names_coordinates_and_units(tmp_path):
    path = write_case(tmp_path / "0000.h5")
    with xr.open_dataset(path, engine="h5netcdf") as data:
        assert data["contact_area"].dims == data["transforms"].dims == ("time",)
        assert data["pressure"].dims == data["displacement"].dims == ("snapshot", "x")
        assert set(data.coords) == {"time", "x", "snapshot"}
        assert data.encoding["unlimited_dims"] == set()  # whose size would be looked for at each variable
        np.testing.assert_array_equal(data["time"], TIMES)
        np.testing.assert_array_equal(data["mean_pressure"], -TIMES)
        np.testing.assert_array_equal(data["displacement"].sel(snapshot=1.0), X)
        np.testing.assert_array_equal(data["pressure"].sel(snapshot=1.0), X**2)
        assert data["transforms"].dtype == np.int64
        for name, array in data.variables.items():
            declared = (VARIABLES | known_columns())[str(name)]
            assert array.attrs["units"] == declared.units
            assert array.attrs["long_name"] == declared.long_name


def test_two_dimensional_surface_keeps_its_axes(tmp_path):
    field = np.arange(16.0 * 4).reshape(16, 4)
    with case_file(tmp_path / "0000.h5", {"x": X, "y": X[:4]}) as case:
        case.snapshot(0.5, named(field, -field))
        case.snapshot(1.0, named(2 * field, field))
    with open_case(tmp_path / "0000.h5") as data:
        assert data["displacement"].dims == ("snapshot", "x", "y")
        np.testing.assert_array_equal(data["displacement"].sel(snapshot=1.0), 2 * field)
        np.testing.assert_array_equal(data["pressure"].sel(snapshot=0.5), -field)


def test_histograms_stand_along_their_bins(tmp_path):
    edges, path = np.array([0.0, 1.0, 2.0, np.inf]), tmp_path / "0000.h5"
    parts = np.random.default_rng(1).random((2 * FEWEST + 1, 3))
    bins = Bins("gap_bin", "the gap", "length", tuple(edges))
    columns = [Column("time", "time", "time"), Column("gap_histogram", "part of the surface", along=bins)]
    with case_file(path, {"x": X}, columns=columns) as case:
        for time, part in enumerate(parts):
            case.row(time=float(time), gap_histogram=part)
    with open_case(path) as data:
        assert data["gap_histogram"].dims == ("time", "gap_bin")
        np.testing.assert_array_equal(data["gap_histogram"], parts)
        np.testing.assert_array_equal(data["gap_bin"], edges[:-1])
        np.testing.assert_array_equal(data["gap_histogram"].coords["gap_bin_end"], edges[1:])
    with h5py.File(path, "r+") as fewer:
        fewer["gap_histogram"].resize(2, axis=0)
    assert not is_complete(path)


def test_a_distribution_may_have_one_bin(tmp_path):
    bins = Bins("gap_bin", "the gap", "length", (0.0, np.inf))
    columns = [Column("time", "time", "time"), Column("gap_histogram", "part of the surface", along=bins)]
    with case_file(tmp_path / "0000.h5", {"x": X}, columns=columns) as case:
        for time in range(3):
            case.row(time=float(time), gap_histogram=np.array([time / 2]))
    with open_case(tmp_path / "0000.h5") as data:
        np.testing.assert_array_equal(data["gap_histogram"], [[0.0], [0.5], [1.0]])


def test_snapshots_are_compressed_in_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "BLOCK", 24)
    monkeypatch.setattr(files, "_template", files._template.__wrapped__)  # not a cached one
    field = np.arange(16.0 * 10).reshape(16, 10)
    with case_file(tmp_path / "0000.h5", {"x": X, "y": X[:10]}) as case:
        case.snapshot(0.5, named(field, -field, 2 * field))
    with h5py.File(tmp_path / "0000.h5") as h5:
        assert {(h5[name].chunks, h5[name].compression) for name in ("displacement", "pressure", "gap")} == {
            ((1, 3, 10), "gzip")  # 160 points need 7 blocks, of 16 rows 3 each
        }
        np.testing.assert_array_equal(h5["gap"][0], 2 * field)


def test_gap_is_kept_with_every_snapshot_or_with_none(tmp_path):
    for first, then in (((X, X), (X, X, X)), ((X, X, X), (X, X))):
        with case_file(tmp_path / "0.h5", {"x": X}) as case:
            case.snapshot(0.0, named(*first))
            with pytest.raises(ValueError, match="some snapshots have a gap"):
                case.snapshot(1.0, named(*then))


def test_a_field_that_is_not_declared_is_refused_at_its_first_snapshot(tmp_path):
    with case_file(tmp_path / "0.h5", {"x": X}) as case:
        with pytest.raises(ValueError, match="declares no field 'bond'; known: displacement, pressure, gap"):
            case.snapshot(0.0, named(X, X) | {"bond": X})
        case.snapshot(0.0, named(X, X))  # it recorded nothing of them


def test_no_rows_and_no_snapshots_still_open(tmp_path):
    with case_file(tmp_path / "0000.h5", {"x": X}):
        pass
    assert is_complete(tmp_path / "0000.h5")
    with open_case(tmp_path / "0000.h5") as data:
        assert data.sizes == {"time": 0, "x": 16, "snapshot": 0}


def test_rows_beyond_what_is_held_keep_their_order(tmp_path):
    times = np.arange(2.5 * FEWEST)
    path = write_case(tmp_path / "0000.h5", tuple(times))
    with open_case(path) as data:
        np.testing.assert_array_equal(data["contact_area"], times)


def test_provenance_is_stored(tmp_path):
    about = attributes(write_case(tmp_path / "0000.h5"))
    expected = {"gfmdlayer_version", "git_commit", "python_version", "numpy_version", "h5py_version"}
    assert expected | {"hostname", "started", "finished", "wall_seconds", "digest"} <= about.keys()
    assert about["rows"] == 3


def test_long_attributes_are_kept_whole(tmp_path):
    # HDF5 limits an attribute stored in the header to 64 KiB.
    with case_file(tmp_path / "0000.h5", {"x": X}, {"config": "k: v\n" * 40_000}):
        pass
    assert attributes(tmp_path / "0000.h5")["config"] == "k: v\n" * 40_000


def test_folder_below_a_repository_has_no_commit(tmp_path):
    (tmp_path / ".git").mkdir()
    (tmp_path / "below").mkdir()
    assert git_commit(tmp_path / "below") == "unknown"
    assert git_commit(tmp_path) == "unknown"


@pytest.mark.parametrize("name", ["TERM", "INT", "USR1"])
def test_a_request_to_stop_does_not_make_the_commit_unknown(tmp_path, monkeypatch, name):
    # mpirun, scancel and terminals send the signal to git too, while it runs.
    (tmp_path / ".git").mkdir()
    git = tmp_path / "git"
    git.write_text(f"#!/bin/sh\nkill -{name} $$\necho 1f2e3d\n")
    git.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert git_commit(tmp_path) == "1f2e3d"


def test_unknown_variable_is_refused(tmp_path):
    with (
        pytest.raises(KeyError, match="no variable 'contact_aera'"),
        case_file(tmp_path / "0.h5", {"x": X}) as c,
    ):
        c.row(time=0.0, contact_aera=0.1)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([{"time": 0.0, "depth": 0.0}, {"time": 1.0}], "columns"),
        ([{"time": 0.0}, {"time": 1.0, "depth": 0.0}], "columns"),
        ([{"depth": 0.0}], "needs its time"),
        ([{"time": 1.0}, {"time": 1.0}], "follows"),
        ([{"time": float("nan")}], "follows"),
    ],
)
def test_wrong_rows_are_refused(tmp_path, rows, message):
    *before, wrong = rows
    with case_file(tmp_path / "0.h5", {"x": X}) as case:
        for row in before:
            case.row(**row)
        with pytest.raises(ValueError, match=message):
            case.row(**wrong)


def test_snapshot_of_another_shape_is_refused(tmp_path):
    with (
        pytest.raises(ValueError, match="pressure of shape"),
        case_file(tmp_path / "0.h5", {"x": X}) as case,
    ):
        case.snapshot(0.0, named(X, X[:4]))


def test_exception_leaves_the_earlier_result_and_nothing_else(tmp_path):
    path = write_case(tmp_path / "0000.h5", level=2.0)
    with pytest.raises(ZeroDivisionError), case_file(path, {"x": X}) as case:
        case.row(time=1.0 / 0)
    assert list(tmp_path.iterdir()) == [path]
    with open_case(path) as data:
        assert data["contact_area"][-1] == 2.0


def test_two_writers_of_one_case_write_to_different_files(tmp_path):
    path = tmp_path / "0000.h5"
    with new_file(path) as one, new_file(path) as other:
        for each, file in enumerate((one, other)):
            file.begin().attrs["number"] = each
        assert len(list(tmp_path.iterdir())) == 2
    assert attributes(path)["number"] == 0  # the last that was complete
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("snapshots", [0, 1])
def test_killed_process_leaves_nothing_under_the_final_name(tmp_path, snapshots):
    def half(path, contents):
        path.write_bytes(contents[: len(contents) // 2])
        os._exit(9)

    process = os.fork()
    if process == 0:
        try:
            recording = Recording()
            recording.row(time=0.0, depth=0.0)
            for _ in range(snapshots):
                recording.snapshot(0.0, named(X, X))
            files.write_new, files.write_at = half, lambda *_: os._exit(9)
            files.write_case(tmp_path / "0000.h5", case_contents(recording, {"x": X}))
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 9
    (left,) = tmp_path.iterdir()
    assert left.name.startswith("0000.h5.")
    assert left.name.endswith(".part")
    assert not is_complete(left)


def test_full_disk_is_a_clear_error_at_any_byte(tmp_path):
    # The whole file takes about 200 kB; HDF5 alone would end some of these in a segmentation fault.
    code = """
import resource, signal, sys
import numpy as np
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.case_file import case_contents, write_case
from gfmdlayer.results.recording import Recording
recording = Recording()
for i in range(1100):
    recording.row(time=float(i), depth=0.0)
    if i % 100 == 0:
        fields = np.random.default_rng(i).random((2, 1024))
        recording.snapshot(float(i), dict(zip(("displacement", "pressure"), fields)))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
for limit in range(0, 180_000, 9973):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        write_case(sys.argv[1], case_contents(recording, {"x": np.arange(1024.0)}))
    except ResultsError as error:
        print(error)
"""
    path = tmp_path / "0000.h5"
    command = [sys.executable, "-c", code, str(path)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.splitlines() == [f"{path}: cannot be written: File too large"] * 19
    assert list(tmp_path.iterdir()) == []


def test_only_complete_cases_count_as_complete(tmp_path):
    whole = write_case(tmp_path / "whole.h5")
    contents = whole.read_bytes()
    (tmp_path / "truncated.h5").write_bytes(contents[: len(contents) // 2])
    (tmp_path / "empty.h5").write_bytes(b"")
    (tmp_path / "foreign.h5").write_text("not HDF5")
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["time"] = TIMES
    (tmp_path / "rows.h5").write_bytes(contents)
    with h5py.File(tmp_path / "rows.h5", "r+") as fewer:
        fewer.attrs["rows"] += 1
    assert is_complete(whole)
    assert is_complete(whole, "abc")
    assert not is_complete(whole, "another config")
    for name in ("truncated", "empty", "foreign", "other", "rows", "missing"):
        assert not is_complete(tmp_path / f"{name}.h5"), name
    assert not is_complete(tmp_path)


def test_any_changed_bit_is_found(tmp_path):
    """In attributes, coordinates and the structure of the file too, where HDF5 has no checksums."""
    path = write_case(tmp_path / "0000.h5")
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for place, bit in zip(rng.integers(0, len(whole), 100), rng.integers(0, 8, 100), strict=True):
        changed = bytearray(whole)
        changed[place] ^= 1 << bit
        path.write_bytes(changed)
        assert not is_complete(path), place
        with pytest.raises(ResultsError, match=r"damaged|not a complete result file"):
            open_case(path)


@pytest.mark.parametrize("variable", ["contact_area", "pressure"])
def test_damage_is_found_by_hdf5_where_another_program_has_changed_the_file(variable, tmp_path):
    path = write_case(tmp_path / "0000.h5")
    with h5py.File(path, "r+") as h5:
        h5.attrs["remark"] = "mine " * 100
    assert is_complete(path)
    damage(path, variable)
    assert not is_complete(path)
    with pytest.raises(ResultsError, match="not a complete result file"):
        open_case(path)


def test_a_damaged_sweep_file_is_refused(tmp_path):
    collect(tmp_path, write_sweep(tmp_path, [{"a.b": 1}, {"a.b": 2}]), Swept(["a.b"]))
    damage(tmp_path / "sweep.h5")
    with pytest.raises(ResultsError, match=r"sweep\.h5: is damaged: it holds other bytes than were written"):
        open_results(tmp_path)


def test_sweep_over_a_product_is_labelled_by_its_keys(tmp_path):
    thick, moduli = [0, 0.25, float("inf")], [1.0, 10.0]
    keys = ["layer.thickness", "halfspace.shear_modulus"]
    records = write_sweep(tmp_path, [dict(zip(keys, (d, g), strict=True)) for d in thick for g in moduli])
    with collected(tmp_path, records, keys) as data:
        assert data["contact_area"].dims == ("thickness", "shear_modulus", "time")
        np.testing.assert_array_equal(data["thickness"], thick)
        assert data["thickness"].attrs["key"] == "layer.thickness"
        assert data["thickness"].attrs["symbol"] == "d"
        assert data["shear_modulus"].attrs["symbol"] == "G_bulk"
        last = data.sel(thickness=np.inf, shear_modulus=1.0, time=1.0)
        assert last["contact_area"] == 5.0
        assert last["mean_pressure"] == -5.0
        assert last["case"] == 4
        assert data.attrs["failed"] == ""
        assert data.attrs["tau"] == 1.0


def test_sweep_has_the_snapshots_of_its_cases_labelled(tmp_path):
    keys = ["layer.thickness", "halfspace.shear_modulus"]
    records = write_sweep(tmp_path, [dict(zip(keys, p, strict=True)) for p in product((0.1, 0.2), (1, 2, 3))])
    with collected(tmp_path, records, keys) as data:
        assert data["displacement"].dims == ("thickness", "shear_modulus", "snapshot", "x")
        assert data["displacement"].attrs["units"] == data["x"].attrs["units"] == "length"
        expected = np.arange(1.0, 7.0).reshape(2, 3, 1, 1) * X  # case number plus one, times X
        np.testing.assert_array_equal(data["displacement"], expected)
        one = data["displacement"].sel(thickness=0.2, shear_modulus=3, snapshot=1.0)
        np.testing.assert_array_equal(one, 6 * X)
        some = data["displacement"].isel(shear_modulus=[2, 0], x=slice(None, None, -3), snapshot=0)
        np.testing.assert_array_equal(some, expected[:, [2, 0], 0, ::-3])


def test_snapshots_are_read_from_the_chosen_cases_alone(tmp_path):
    records = write_sweep(tmp_path, [{"a.b": value} for value in range(4)])
    collect(tmp_path, records, Swept(["a.b"]))
    records[1].source.write_text("damaged")
    records[2].source.unlink()
    with open_results(tmp_path) as data:
        np.testing.assert_array_equal(data["displacement"].sel(b=3, snapshot=1.0), 4 * X)
        assert np.isnan(data["displacement"].sel(b=2)).all()
        with pytest.raises(ResultsError, match=r"0001\.h5: displacement cannot be read: is damaged"):
            data["displacement"].sel(b=1).load()


def test_snapshots_on_different_grids_are_not_put_together(tmp_path):
    records = write_sweep(tmp_path, [{"grid.period": 1.0}, {"grid.period": 2.0}])
    with collected(tmp_path, records, ["grid.period"]) as data:
        assert "contact_area" in data
        assert not {"displacement", "pressure"} & set(data.data_vars)
    records = write_sweep(tmp_path, [{"a.b": 1}, {"a.b": 2}])
    collect(tmp_path, records, Swept(["a.b"]))
    with case_file(records[1].source, {"x": X[:8]}) as other:
        other.snapshot(1.0, named(X[:8], X[:8]))
    with open_results(tmp_path) as data, pytest.raises(ResultsError, match=r"0001\.h5: displacement of"):
        data["displacement"].load()
    with case_file(records[1].source, {"x": X}) as other:
        for time in open_case(records[0].source)["snapshot"].values:
            other.snapshot(time + 1e-3, named(X, X))
    with (
        open_results(tmp_path) as data,
        pytest.raises(ResultsError, match="at other times than in the sweep"),
    ):
        data["displacement"].load()


def test_cases_that_ended_in_a_steady_state_keep_their_last_row(tmp_path):
    records, ends = [], (3, 2, 4)
    for index, end in enumerate(ends):
        path = case_path(tmp_path, index)
        with case_file(path, {"x": X}) as case:
            for time in range(end + 1):
                area, friction = 0.1 * time, 0.01 * (index + 1) * time
                case.row(
                    time=time, contact_area=area, mean_pressure=1.0, friction=friction, tangential_force=0.0
                )
            case.note(settled=1 if index < 2 else 0)
        records.append(CaseRecord(index, path, {"trajectory.velocity": float(index)}))
    with collected(tmp_path, records, ["trajectory.velocity"]) as data:
        np.testing.assert_array_equal(data["time"], range(5))
        assert data["velocity"].attrs["symbol"] == "v"
        for index, end in enumerate(ends):
            found = data["friction"].isel(velocity=index)
            np.testing.assert_allclose(found, 0.01 * (index + 1) * np.minimum(range(5), end))
    assert attributes(records[0].source)["settled"] == 1


def test_shared_last_parts_take_the_whole_key():
    keys = ["layer.poisson", "halfspace.poisson", "layer.thickness"]
    assert dimension_names(keys) == ["layer.poisson", "halfspace.poisson", "thickness"]
    assert dimension_names(["some.time"]) == ["some.time"]


def test_list_of_combinations_has_one_dimension(tmp_path):
    keys = ["layer.thickness", "layer.material.Ginf"]
    pairs = [(0.1, 10.0), (0.2, 20.0), (0.1, 30.0)]
    with collected(
        tmp_path, write_sweep(tmp_path, [dict(zip(keys, p, strict=True)) for p in pairs]), keys
    ) as data:
        assert data["contact_area"].dims == ("case", "time")
        np.testing.assert_array_equal(data["case"], [0, 1, 2])
        np.testing.assert_array_equal(data.coords["thickness"], [0.1, 0.2, 0.1])
        np.testing.assert_array_equal(data.coords["Ginf"], [10.0, 20.0, 30.0])
        np.testing.assert_array_equal(data["contact_area"].sel(time=1.0), [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("key", "values", "labels"),
    [
        ("a.b", ["fire", "active_set"], ["fire", "active_set"]),
        ("grid.b", [64, [64, 128]], ["64", "64x128"]),
        ("a.b", [[1, 2], [0.5]], ["[1, 2]", "[0.5]"]),
        ("a.b", [0.005, "adaptive"], ["0.005", "adaptive"]),
        ("a.b", [{"model": "zener", "G0": 1.0}, {"model": "prony"}], ["model=zener, G0=1.0", "model=prony"]),
    ],
)
def test_values_that_are_no_numbers_become_text(tmp_path, key, values, labels):
    with collected(tmp_path, write_sweep(tmp_path, [{key: value} for value in values]), [key]) as data:
        assert data["b"].to_numpy().tolist() == labels
        assert data["contact_area"].sel(b=labels[1], time=1.0) == 2.0


def test_failed_and_missing_cases_are_nan_and_named(tmp_path):
    records = write_sweep(tmp_path, [{"layer.thickness": d} for d in (0.1, 0.2, 0.3)])
    records[0] = CaseRecord(0, records[0].source, records[0].values, "did not converge at time 0.2")
    records[2].source.unlink()
    with collected(tmp_path, records, ["layer.thickness"]) as data:
        np.testing.assert_array_equal(data["contact_area"].sel(time=1.0), [np.nan, 2.0, np.nan])
        expected = ["0000: did not converge at time 0.2", "0002: no complete result file"]
        assert data.attrs["failed"].splitlines() == expected


def test_sweep_where_every_case_failed_opens(tmp_path):
    records = [CaseRecord(i, case_path(tmp_path, i), {"a.b": i}, "no") for i in range(2)]
    with collected(tmp_path, records, ["a.b"]) as data:
        assert data.sizes == {"b": 2, "time": 0}


def collect_steps(folder, steps, **how):
    """Collect cases whose rows are at these times; their contact area is the time."""
    paths = [write_case(case_path(folder, i), times) for i, times in enumerate(steps)]
    records = [CaseRecord(i, path, {"a.b": i}) for i, path in enumerate(paths)]
    records.append(CaseRecord(len(paths), case_path(folder, len(paths)), {"a.b": len(paths)}, "no"))
    collect(folder, records, Swept(["a.b"], **how))


def test_cases_with_steps_of_their_own_keep_all_of_their_rows(tmp_path):
    steps, nan = [(0.0, 0.2, 1.0), (0.0, 0.2, 0.3, 0.7, 1.5)], np.nan
    collect_steps(tmp_path, steps)
    with open_results(tmp_path) as data:
        assert data["contact_area"].dims == data["time"].dims == ("b", "row")
        np.testing.assert_array_equal(data["time"], [[*steps[0], nan, nan], steps[1], [nan] * 5])
        np.testing.assert_array_equal(data["contact_area"], data["time"])
        assert data["time"].attrs["units"] == "time"
        assert set(data["contact_area"].coords) == {"b", "case", "row", "time"}
        one = data["contact_area"].sel(b=0).swap_dims(row="time").dropna("time")
        assert float(one.sel(time=0.2)) == 0.2


def test_cases_of_equal_steps_share_time_and_are_nan_behind_their_ends(tmp_path):
    # 3 * 0.1 differs from 0.3 by rounding and is the same time.
    collect_steps(tmp_path, [(0.0, 0.2, 3 * 0.1), (0.0, 0.2, 0.3, 1.0)])
    with open_results(tmp_path) as data:
        assert data["contact_area"].dims == ("b", "time")
        np.testing.assert_array_equal(data["time"], [0.0, 0.2, 0.3, 1.0])
        found = data["contact_area"]
        np.testing.assert_allclose(found[:2], [[0.0, 0.2, 0.3, np.nan], [0.0, 0.2, 0.3, 1.0]], rtol=1e-15)
        assert found[2].isnull().all()


@pytest.mark.parametrize("asked", [0.4, (0.4, 3 * 0.4)])
def test_output_times_are_a_common_axis_to_the_end_of_the_longest_case(tmp_path, asked):
    collect_steps(tmp_path, [(0.0, 0.1, 0.4, 0.5), (0.0, 0.1, 0.3, 0.4, 0.8, 1.0, 1.2)], asked=asked)
    with open_results(tmp_path) as data:
        times = [0.0, 0.1, 0.4, *([0.8] if asked == 0.4 else []), 1.2]  # 0 and 0.1 are in both cases
        np.testing.assert_allclose(data["time"], times, rtol=1e-15)
        np.testing.assert_allclose(data["contact_area"].sel(b=1), times, rtol=1e-15)
        np.testing.assert_array_equal(data["contact_area"].sel(b=0)[:3], times[:3])
        assert data["contact_area"].sel(b=0)[3:].isnull().all()


def test_a_list_keeps_one_dimension_where_it_happens_to_be_a_product(tmp_path):
    records = write_sweep(tmp_path, [{"layer.thickness": d} for d in (0.1, 0.2)])
    with collected(tmp_path, records, ["layer.thickness"], listed=True) as data:
        assert data["contact_area"].dims == ("case", "time")
        np.testing.assert_array_equal(data.coords["thickness"], [0.1, 0.2])


def test_a_thousand_failures_are_named(tmp_path):
    # Beyond the 64 kB that HDF5 allows an attribute of fixed length.
    reason = "ConvergenceError: t = 0.1: residual 1e-3 after 20000 iterations of fire; the tolerance is 1e-6"
    records = [CaseRecord(i, case_path(tmp_path, i), {"a.b": i}, reason) for i in range(1000)]
    with collected(tmp_path, records, ["a.b"]) as data:
        assert len(data.attrs["failed"]) > 65_536
        assert data.attrs["failed"].splitlines() == [f"{i:04d}: {reason}" for i in range(1000)]


def test_a_damaged_case_is_left_out_of_the_sweep_and_no_other(tmp_path):
    records = write_sweep(tmp_path, [{"a.b": i} for i in range(3)])
    damage(records[1].source)
    with collected(tmp_path, records, ["a.b"]) as data:
        assert data["contact_area"].isnull().all("time").to_numpy().tolist() == [False, True, False]
        assert data.attrs["failed"] == "0001: no complete result file"


@pytest.mark.parametrize("made_here", [False, True])
def test_collecting_holds_a_bounded_number_of_cases(tmp_path, monkeypatch, made_here):
    # A curve of 20 000 rows takes 160 kB, a case of three columns 480 kB; the record of a case and its labels
    # less than 1 kB. Two of the cases stay in memory, and of each column two chunks of `CHUNK` numbers,
    # one packed. The chunk that is being packed, in another order and then shorter, adds to either peak.
    monkeypatch.setattr(gathering, "KEPT", 2 * 480_000)
    path, rows = case_path(tmp_path, 0), np.linspace(0, 1, 20_000)
    if made_here:  # by a template of this process, and read without HDF5
        monkeypatch.setattr(files, "SMALL", 1 << 22)
        monkeypatch.setattr(gathering, "SMALL", 1 << 22)
        with case_file(path, {"x": X}) as case:
            for time in rows:
                case.row(time=time, contact_area=time, transforms=7)
    else:
        write_case(path, rows)
    peaks = []
    for number in (9, 40):
        records = [CaseRecord(i, path, {"a.b": i}) for i in range(number)]
        tracemalloc.start()
        collect(tmp_path, records, Swept(["a.b"]))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < peaks[0] + 31 * 1000 + 2 * 8 * gathering.CHUNK
    assert peaks[1] < 10 * 160_000 + 3 * 4 * 8 * gathering.CHUNK


def test_chunks_are_packed_as_hdf5_packs_them(tmp_path):
    # 70 cases of 3000 rows: chunks of 21 cases, of which the last reaches beyond the cases.
    times = np.linspace(0, 1, 3000)
    records = []
    for index in range(70):
        with case_file(path := case_path(tmp_path, index), {"x": X}) as case:
            for time in times[: 3000 - index % 3]:
                case.row(time=time, contact_area=np.sin(index * time), transforms=index)
        records.append(CaseRecord(index, path, {"a.b": index}, "lost" if index == 40 else None))
    collect(tmp_path, records, Swept(["a.b"]))
    with h5py.File(tmp_path / "sweep.h5") as h5:
        column = h5["contact_area"]
        values = column[()]
        assert column.chunks == (21, 3000)
        again = h5py.File(tmp_path / "again.h5", "w").create_dataset(
            "column", data=values, chunks=column.chunks, fillvalue=np.nan, **PACKED
        )
        assert column.id.get_num_chunks() == again.id.get_num_chunks() == 4
        for i in range(4):
            place = again.id.get_chunk_info(i).chunk_offset
            assert column.id.read_direct_chunk(place) == again.id.read_direct_chunk(place)
    for index in range(70):
        held = 0 if index == 40 else 3000 - index % 3
        assert values[index, :held].tobytes() == np.sin(index * times[:held]).tobytes()
        assert np.isnan(values[index, held:]).all()


def test_single_case_is_opened_itself(tmp_path):
    records = write_sweep(tmp_path, [{}])
    for with_sweep_file in (False, True):
        if with_sweep_file:
            collect(tmp_path, records, Swept([]))
        with open_results(tmp_path) as data:
            assert data["displacement"].dims == ("snapshot", "x")


def test_folders_without_results_are_refused_by_name(tmp_path):
    with pytest.raises(ResultsError, match="nowhere: no such folder"):
        open_results(tmp_path / "nowhere")
    with pytest.raises(ResultsError, match="not a folder of results"):
        open_results(tmp_path)
    (tmp_path / "cases").mkdir()
    with pytest.raises(ResultsError, match="no complete case"):
        open_results(tmp_path)
    write_sweep(tmp_path, [{}, {}])
    with pytest.raises(ResultsError, match=r"2 complete cases but no sweep\.h5"):
        open_results(tmp_path)
    with pytest.raises(ResultsError, match=r"0009\.h5: no such file"):
        open_case(case_path(tmp_path, 9))
