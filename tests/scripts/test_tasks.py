"""The numbered tasks of the gallery run, draw one picture each, and agree with their independent number."""

import runpy
import warnings
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot as plt

TASKS = sorted((Path(__file__).parents[2] / "docs/gallery/tasks").glob("plot_*.py"))


def test_the_tasks_are_numbered():
    assert [path.stem.split("_")[1] for path in TASKS] == [str(i + 1) for i in range(8)]


# The site's build runs all of them, and each asserts its number itself.
LONG = ("2_wlf", "3_seal", "8_slurm")


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=pytest.mark.slow) if any(each in path.stem for each in LONG) else path
        for path in TASKS
    ],
    ids=lambda path: path.stem,
)
def test_a_task_agrees_with_its_independent_number(path, capsys):
    mpl.use("Agg")
    plt.close("all")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of small grids
        names = runpy.run_path(str(path))
    found, expected, within = (names[name] for name in ("found", "expected", "within"))
    assert np.isfinite([found, expected]).all()
    assert 0 < within < 0.25
    assert found == pytest.approx(expected, rel=within)
    assert found != expected
    assert len(plt.get_fignums()) == 1
    assert names["__doc__"].startswith(f"\n{path.stem.split('_')[1]}. ")
    assert "*In another way.*" in names["__doc__"]
    said = capsys.readouterr().out
    assert said.strip()
    plt.close("all")
