"""Time of a whole run, with history, observables and HDF5 output, over its bare FFT pairs."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
from benchmarks.common import METHODS, STEP, Cell, Effort, Table, bare_pairs, default_case, ratio

from gfmdlayer.case.model import warm_up
from gfmdlayer.config import Config
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.study.case_run import run_case
from gfmdlayer.study.cases import SweepCase
from gfmdlayer.study.folder import Folder

EFFORT = Effort(points=(1 << 14,), repetitions=5)
QUICK = Effort(points=(1 << 12,), steps=100, repetitions=3)


def measure(effort: Effort) -> list[Table]:
    """Run the case like `gfmdlayer run`, in turns with the same number of bare pairs."""
    rows = [_row(method, points, effort) for method in METHODS for points in effort.points]
    title = f"Whole run / its bare FFT pairs, {effort.steps} steps of {STEP} tau"
    note = (
        "The time contains history, observables and HDF5 output, after compilation. Transforms "
        "of a window count by their points, so the other work has a larger share. The time of a step is in "
        "bare pairs; its target is 1.6 times 8 pairs in the ramp and 5 in the hold."
    )
    return [Table("whole_run", title, rows, note)]


def _row(method: str, points: int, effort: Effort) -> dict[str, Cell]:
    config = default_case(
        grid__points=points, time__end=effort.steps * STEP, solver={"method": method, "tolerance": 1e-6}
    )
    warm_up(config)
    pairs = run_to_file(config)
    of_bare = ratio(
        lambda: run_to_file(config),
        bare_pairs(Transforms(config.grid.points), pairs),
        effort.repetitions,
    )
    published = points == 1 << 14
    return {
        "solver": method,
        "n": points,
        "pairs": pairs,
        "run / bare pairs": of_bare,
        "target": "≤ 1.6" if published else None,
        "a step [bare pairs]": of_bare * pairs / effort.steps,
        "target ": "≤ 10.4" if published and method == "active_set" else None,
    }


def run_to_file(config: Config) -> int:
    """Run a case into a temporary folder and return its FFT pairs."""
    return effort_of_run(config)[0]


def effort_of_run(config: Config) -> tuple[int, int]:
    """Run a case into a temporary folder and return its FFT pairs and iterations."""
    with TemporaryDirectory() as name:
        folder = Folder(Path(name))
        folder.cases.mkdir()
        outcome = run_case(SweepCase(0, config, {}), folder)
        if outcome.state != "complete":
            raise RuntimeError(f"the run with {config.solver.method} failed: {outcome.reason}")
        with h5py.File(folder.case(0)) as file:
            return int(file["transforms"][:].sum()), int(file["iterations"][:].sum())
