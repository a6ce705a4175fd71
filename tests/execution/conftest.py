"""Runs in the tests' own process, which spare the start of another one."""

import sys
from contextlib import chdir
from pathlib import Path

import h5py
import numpy as np
import pytest

from gfmdlayer.config import load
from gfmdlayer.execution.progress import Log
from gfmdlayer.execution.run import RunOptions, run_sweep
from gfmdlayer.execution.workers import assemble


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path):
    with chdir(tmp_path):
        yield


@pytest.fixture
def run_here(capsys):
    """Run a configuration, or the file of one; return the summary and the log."""

    def run(config, out="out", **options):
        config = load(Path(config)) if isinstance(config, str) else config
        with assemble() as pool:
            assert pool is not None
            summary = run_sweep(config, out, pool, RunOptions(**options), lambda: Log(sys.stderr))
        return summary, capsys.readouterr().err

    return run


@pytest.fixture(scope="session")
def bits():
    """Return the bits of every variable of an HDF5 file, or of every such file in a results folder."""

    def bits(place):
        place, found = Path(place), {}
        for path in sorted(place.rglob("*.h5")) if place.is_dir() else [place]:
            prefix = f"{path.relative_to(place)}:" if place.is_dir() else ""
            with h5py.File(path) as h5:
                found |= {f"{prefix}{name}": np.asarray(h5[name]).tobytes() for name in h5}
        return found

    return bits
