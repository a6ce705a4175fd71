"""Results are read beside other programs that have the same files open, and none waits for another."""

import fcntl
import shutil
from pathlib import Path

import h5py
import pytest
import xarray

import gfmdlayer
from gfmdlayer.results.reader import is_complete

CONF = {
    "name": "kept",
    "grid": {"points": 64},
    "time": {"end": 0.5, "step": 0.1},
    "trajectory": {"ramp_time": 0.2},
    "output": {"snapshots": [0.5]},
    "sweep": {"layer.thickness": [0.1, 0.2]},
}
OTHERS = {
    "h5py": h5py.File,
    "h5py without locks": lambda path: h5py.File(path, locking=False),
    "xarray": lambda path: xarray.open_dataset(path, engine="h5netcdf"),
    "xarray without locks": lambda path: xarray.open_dataset(
        path, engine="h5netcdf", driver_kwds={"locking": False}
    ),
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return the folder of a complete sweep."""
    out = tmp_path_factory.mktemp("results") / "kept"
    gfmdlayer.run(CONF, out=out)
    return out


def states(folder: Path):
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in folder.glob("cases/0*")}


@pytest.mark.parametrize("other", OTHERS)
def test_a_complete_case_that_somebody_reads_is_left_and_read(results, other):
    before = states(results)
    with OTHERS[other](results / "cases/0001.h5"):
        with gfmdlayer.open_case(results / "cases/0001.h5") as case:
            assert float(case.depth[-1]) == 0.01
        with gfmdlayer.run(CONF, out=results) as again:
            assert again.sizes["thickness"] == 2
    assert states(results) == before


@pytest.mark.parametrize("other", OTHERS)
def test_others_open_results_within_the_block_and_after_it(results, other):
    files = [results / "sweep.h5", *(results / "cases").glob("*.h5")]
    with gfmdlayer.open_results(results) as data, gfmdlayer.open_case(files[1]) as case:
        for file in files:
            OTHERS[other](file).close()
        assert float(data.displacement.isel(thickness=1).min()) < 0 < len(case.time)
    for file in files:
        OTHERS[other](file).close()


def test_a_file_is_closed_at_the_end_of_the_block(results, tmp_path):
    """A file that is open for reading cannot be opened for writing by the same driver."""
    own = shutil.copytree(results, tmp_path / "own")
    with gfmdlayer.open_results(own) as data:
        with pytest.raises(OSError, match="read-only"):
            h5py.File(own / "sweep.h5", "r+", driver="stdio", locking=False)
        assert "displacement" in data
    h5py.File(own / "sweep.h5", "r+", driver="stdio", locking=False).close()


def test_no_lock_is_taken(results):
    """Under an exclusive lock of somebody else, a reader that asked for a lock would be refused one."""
    case = results / "cases/0000.h5"
    with case.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(BlockingIOError):
            h5py.File(case)
        assert is_complete(case)
        with gfmdlayer.open_case(case) as data:
            assert float(data.depth[-1]) == 0.01


def test_an_unreadable_file_is_not_taken_for_a_damaged_one(results, monkeypatch):
    """Where the system fails, a sound file is neither set aside nor computed again."""
    before = states(results)

    def fails(*_, **__):
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(h5py, "File", fails)
    with pytest.raises(OSError, match=r"0000\.h5: cannot be read .*Too many open files"):
        gfmdlayer.run(CONF, out=results)
    assert states(results) == before
