"""Tables of a section, its effort; the paper's default case; bare FFT pairs and times; runs on MPI ranks."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numba as nb
import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.case.model import simulate, warm_up
from gfmdlayer.config import Config, load
from gfmdlayer.grid.transforms import Plans, Transforms, backward, forward
from gfmdlayer.results.recording import Recording

Cell = float | int | str | None


@dataclass(frozen=True)
class Table:
    """A table; all rows have the same keys, the headings of the columns."""

    name: str  # key in the JSON file
    title: str
    rows: list[dict[str, Cell]]  # None is an empty cell
    note: str = ""  # below the table

    def markdown(self) -> str:
        """Return the table in Markdown; numbers have three digits and are aligned to the right."""
        columns = list(self.rows[0])
        texts = [columns, *([_text(row[column]) for column in columns] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
        words = [any(isinstance(row[column], str) for row in self.rows) for column in columns]
        heads, *body = (
            "| "
            + " | ".join(
                text.ljust(width) if is_word else text.rjust(width)
                for text, width, is_word in zip(line, widths, words, strict=True)
            )
            + " |"
            for line in texts
        )
        rule = "|" + "|".join(
            "-" * (w + 1) + ("-" if word else ":") for w, word in zip(widths, words, strict=True)
        )
        note = ["", self.note] if self.note else []
        return "\n".join([f"### {self.title}", "", heads, rule + "|", *body, *note, ""])


@dataclass(frozen=True)
class Effort:
    """Size of the computations of a section."""

    points: tuple[int, ...]  # grid points n
    steps: int = 400  # of 0.005 tau
    repetitions: int = 5  # of each measured time; the median counts
    cases: int = 1  # of a sweep
    against: Path | None = None  # another checkout


def _text(cell: Cell) -> str:
    if cell is None:
        return "–"
    if isinstance(cell, float):
        return f"{cell:.3g}" if abs(cell) < 1000 else f"{cell:.0f}"
    return str(cell)


METHODS = ("active_set", "conjugate_gradient", "fire")
STEP = 0.005  # the paper's, in tau
_DEFAULT = Path(__file__).parents[2] / "configs" / "indentation.yaml"


def default_case(**values: object) -> Config:
    """Return the paper's default case with other values; two underscores replace the dot of a key."""
    return load(_DEFAULT).with_values({key.replace("__", "."): value for key, value in values.items()})


def run(config: Config) -> Recording:
    """Simulate a case in memory, after compilation."""
    recording = Recording()
    warm_up(config)
    simulate(config, recording)
    return recording


def bare_pairs(transforms: Transforms, count: int) -> Callable[[], None]:
    """Return a compiled task of `count` FFT pairs."""
    field, back, spectrum = transforms.empty_field(), transforms.empty_field(), transforms.empty_spectrum()
    field[:] = np.cos(np.arange(field.size))
    _pairs(transforms.plans, field, spectrum, back, 1)
    return lambda: _pairs(transforms.plans, field, spectrum, back, count)


def ratio(whole: Callable[[], object], part: Callable[[], object], repetitions: int) -> float:
    """Return the median ratio of the times of two tasks that run in turns."""
    return float(np.median([seconds(whole) / seconds(part) for _ in range(repetitions)]))


def cpu_seconds(task: Callable[[], object]) -> float:
    """Return the CPU time of a task."""
    begun = time.process_time()
    task()
    return time.process_time() - begun


def cpu_of_a_pair(transforms: Transforms, least: float = 0.0) -> float:
    """Return the CPU time of a bare FFT pair, the shortest of five measurements of `least` seconds."""
    count = max(3, 3_000_000 // math.prod(transforms.shape))
    if least:
        count = max(3, math.ceil(3 * least / seconds(bare_pairs(transforms, 3))))
    task = bare_pairs(transforms, count)
    return min(cpu_seconds(task) for _ in range(5)) / count


def seconds(task: Callable[[], object]) -> float:
    """Return the wall time of a task."""
    begun = time.perf_counter()
    task()
    return time.perf_counter() - begun


@nb.njit(nogil=True, cache=True)
def _pairs(plans: Plans, field: FloatArray, spectrum: ComplexArray, back: FloatArray, count: int) -> None:
    for _ in range(count):
        forward(plans, field, spectrum)
        backward(plans, spectrum, back)


def mpirun() -> str | None:
    """Return the launcher of the environment's own MPI library, or of the machine's, or None."""
    return shutil.which("mpirun", path=str(Path(sys.executable).parent)) or shutil.which("mpirun")


def over_ranks(number: int, script: str, *arguments: str, folder: Path | None = None) -> str | None:
    """Run a script on MPI ranks and return the last line of its output; None without mpirun.

    One rank needs no launcher. A failed script raises RuntimeError.
    """
    launcher = mpirun()
    if number > 1 and launcher is None:
        return None
    ranks = [launcher, "-n", str(number)] if number > 1 and launcher else []
    paths = (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH"))
    done = subprocess.run(
        [*ranks, sys.executable, script, *arguments],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{script} on {number} ranks: {done.stderr}")
    return done.stdout.splitlines()[-1]
