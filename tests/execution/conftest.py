"""Runs in the tests' own process, which spare the start of another one."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from gfmdlayer.config import Config, load
from gfmdlayer.execution.progress import Log
from gfmdlayer.execution.run import RunOptions, Summary, run_sweep
from gfmdlayer.execution.workers import assemble


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path: Path) -> Iterator[None]:
    with chdir(tmp_path):
        yield


@pytest.fixture
def run_here(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[Summary, str]]:
    """Run a configuration, or the file of one; return the summary and the log."""

    def run(config: Config | str, out: str | Path = "out", **options: Any) -> tuple[Summary, str]:
        config = load(Path(config)) if isinstance(config, str) else config
        with assemble() as pool:
            assert pool is not None
            summary = run_sweep(config, out, pool, RunOptions(**options), lambda: Log(sys.stderr))
        return summary, capsys.readouterr().err

    return run


@pytest.fixture(scope="session")
def bits() -> Callable[[str | Path], dict[str, bytes]]:
    """Return the bits of every variable of an HDF5 file, or of every such file in a results folder."""

    def bits(place: str | Path) -> dict[str, bytes]:
        place, found = Path(place), {}
        for path in sorted(place.rglob("*.h5")) if place.is_dir() else [place]:
            prefix = f"{path.relative_to(place)}:" if place.is_dir() else ""
            with h5py.File(path) as h5:
                found |= {f"{prefix}{name}": np.asarray(h5[name]).tobytes() for name in h5}
        return found

    return bits
