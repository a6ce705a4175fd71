"""Runs in the tests' own process, which spare the start of another one."""

import sys
from contextlib import chdir
from pathlib import Path

import pytest

from gfmdlayer.config import load
from gfmdlayer.study.progress import Log
from gfmdlayer.study.run import RunOptions, run_study
from gfmdlayer.study.workers import assemble


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
            summary = run_study(config, out, pool, RunOptions(**options), lambda: Log(sys.stderr))
        return summary, capsys.readouterr().err

    return run
