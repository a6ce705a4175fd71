"""A file made from the bytes of another one has what HDF5 would have written."""

import h5py
import numpy as np
import pytest
import xarray as xr

from gfmdlayer.observables import Column
from gfmdlayer.observables.observable import Bins
from gfmdlayer.results import case_file
from gfmdlayer.results.case_file import case_contents, write_case
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.reader import is_complete
from gfmdlayer.results.recording import Recording
from tests.recordings import named

COLUMNS = (
    Column("time", "time", "time"),
    Column("depth", "depth of the punch", "length"),
    Column("attempts", "whole numbers", "1", "i8"),
    Column("short", "single precision", "pressure", "f4"),
    Column("sizes", "number of patches", "1", along=Bins("size", "area of a patch", "1", (0.0, 1.0, 4.0))),
)
TEXTS = "", "x", "µ and π", "a: 1\nb: 2\n" * 400, "\N{GREEK SMALL LETTER ALPHA}" * 5


def contents(rows, snapshots=0, text="x", numbers=(1.5, 2), bins=False, points=16, swept=None):
    """Return the contents of a case of random rows, with attributes of all types."""
    rng = np.random.default_rng(rows)
    recording = Recording()
    values = rng.normal(size=(rows, 3))
    for i in range(rows):
        also = {"sizes": rng.integers(0, 9, 2).astype(float)} if bins else {}
        depth, short = float(values[i, 0]), float(values[i, 1])
        recording.row(time=float(i), depth=depth, attempts=2**40 + i, short=short, **also)
    x = np.linspace(-0.5, 0.5, points)
    for i in range(snapshots):
        recording.snapshot(float(i), named(x + i, x - i, x * i))
    about = {
        "name": text,
        "control": "depth",
        "tau": numbers[0],
        "count": numbers[1],
        "depths": np.array(numbers),
        "none": np.empty(0),
    }
    return case_contents(recording, {"x": x}, about, COLUMNS, swept=swept or {"layer.thickness": 0.25})


def written_by_hdf5(path, case):
    """Write a case as HDF5 lays it out, one variable and one attribute after the other."""
    with h5py.File(path, "w") as h5:
        for name, variable in case.variables.items():
            values, form = variable.values, variable.form
            text = form.dtype == ""
            held = values.astype(object) if text else values
            dataset = h5.create_dataset(name, data=held, dtype=h5py.string_dtype() if text else form.dtype)
            if form.dimensions == (name,):
                dataset.make_scale(name)
            else:
                for axis, dimension in zip(dataset.dims, form.dimensions, strict=True):
                    axis.attach_scale(h5[dimension])
            dataset.attrs.update(dict(form.described))
            if form.beside:
                dataset.attrs["coordinates"] = " ".join(form.beside)
        h5.attrs.update(case.attributes)
        h5.attrs["coordinates"] = " ".join(n for n, v in case.variables.items() if not v.form.dimensions)


def plainly(path):
    """Return all that a file holds, by names: types, shapes, values in their bits, dimensions, attributes."""
    structure = {"DIMENSION_LIST", "REFERENCE_LIST"}

    def noted(of):
        return {
            n: (type(v), np.asarray(v).dtype.str, np.shape(v), np.asarray(v).tolist())
            for n, v in of.attrs.items()
            if n not in structure
        }

    with h5py.File(path) as h5:
        return {"/": noted(h5)} | {
            name: (
                data.dtype.str,
                data.shape,
                data[()].tobytes() if data.dtype.kind != "O" else data[()],
                [[scale.name for scale in axis.values()] for axis in data.dims],
                noted(data),
            )
            for name, data in h5.items()
        }


@pytest.mark.parametrize("snapshots", [0, 3])
@pytest.mark.parametrize("bins", [False, True])
def test_files_of_one_layout_have_what_hdf5_writes(tmp_path, snapshots, bins):
    """With other numbers of rows and other lengths of texts, which come after one another in one process."""
    for i, (rows, text) in enumerate(zip((7, 1, 300, 129, 128), TEXTS, strict=True)):
        case = contents(rows, snapshots, text, (-0.1 * i, 3**i), bins, swept={"layer.thickness": 0.1 * i})
        ours, theirs = tmp_path / f"{i}.h5", tmp_path / f"{i}.hdf5.h5"
        write_case(ours, case)
        written_by_hdf5(theirs, case)
        assert is_complete(ours)
        assert plainly(ours) == plainly(theirs)
        with (
            xr.open_dataset(ours, engine="h5netcdf") as one,
            xr.open_dataset(theirs, engine="h5netcdf") as other,
        ):
            xr.testing.assert_identical(one, other)
            xr.testing.assert_identical(one, case.dataset())


@pytest.mark.parametrize("words", TEXTS[1:])
def test_a_swept_word_is_a_text(tmp_path, words):
    case = contents(3, swept={"trajectory.control": words, "layer.thickness": 0.1})
    write_case(tmp_path / "ours.h5", case)
    written_by_hdf5(tmp_path / "theirs.h5", case)
    assert plainly(tmp_path / "ours.h5") == plainly(tmp_path / "theirs.h5")
    with xr.open_dataset(tmp_path / "ours.h5", engine="h5netcdf") as data:
        assert data["control"].item() == words


def test_a_case_without_rows_has_a_file(tmp_path):
    write_case(tmp_path / "0.h5", contents(0))
    with h5py.File(tmp_path / "0.h5") as h5:
        assert (h5["time"].shape, h5["x"].shape, h5.attrs["rows"]) == ((0,), (16,), 0)
    assert is_complete(tmp_path / "0.h5")


def test_more_rows_than_a_file_in_memory_may_have_are_written_alike(tmp_path, monkeypatch):
    case = contents(100)
    write_case(tmp_path / "made.h5", case)
    monkeypatch.setattr(case_file, "SMALL", 100)
    write_case(tmp_path / "written.h5", case)
    assert plainly(tmp_path / "made.h5") == plainly(tmp_path / "written.h5")
    assert (tmp_path / "made.h5").stat().st_size < (tmp_path / "written.h5").stat().st_size


def test_other_programs_may_change_the_file(tmp_path):
    """Attributes and variables are added, replaced and removed, the texts of the file among them."""
    path = tmp_path / "0.h5"
    write_case(path, contents(50, text=TEXTS[3]))
    for i in range(3):
        with h5py.File(path, "r+") as h5:
            h5.attrs["name"] = f"changed {i} " * 300
            h5.attrs["note"] = "mine"
            h5["mine"] = np.arange(1000.0)
            h5["depth"][...] = i
        with h5py.File(path, "r+") as h5:
            assert h5.attrs["name"] == f"changed {i} " * 300
            del h5["mine"], h5.attrs["note"]
            assert h5["depth"][:].tolist() == [i] * 50
            assert h5["time"][:].tolist() == list(range(50))


def test_a_sweep_is_collected_alike_from_files_of_a_template_and_of_hdf5(tmp_path):
    """With and without the templates of this process; a flipped bit of a column is noticed in both."""
    keys = ["layer.thickness"]
    every = [contents(5, text=f"{i}", bins=False, swept={keys[0]: 0.1 * i}) for i in range(4)]
    sweeps = []
    for write in write_case, written_by_hdf5:
        folder = tmp_path / write.__name__
        records = [CaseRecord(i, folder / f"{i}.h5", {keys[0]: 0.1 * i}) for i in range(4)]
        folder.mkdir()
        for record, case in zip(records, every, strict=True):
            write(record.source, case)
        sweeps.append(plainly(collect(folder, records, Swept(keys))))
    assert sweeps[0] == sweeps[1]
    spoiled = bytearray(records_of(tmp_path / "write_case")[2].read_bytes())
    place = bytes(spoiled).index(every[2].values("depth").tobytes())
    spoiled[place + 3] ^= 1
    records_of(tmp_path / "write_case")[2].write_bytes(spoiled)
    records = [
        CaseRecord(i, p, {keys[0]: 0.1 * i}) for i, p in enumerate(records_of(tmp_path / "write_case"))
    ]
    with h5py.File(collect(tmp_path / "write_case", records, Swept(keys))) as h5:
        assert h5.attrs["failed"] == "0002: no complete result file"


def records_of(folder):
    """Return the files of the cases."""
    return sorted(folder.glob("[0-9].h5"))
