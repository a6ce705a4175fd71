"""What the memory allows: bytes of an FFT pair and of each pass of a solve, against what the machine streams.

The stream is a triad a = b + s c over arrays far larger than the caches, which moves 24 bytes a number
(McCalpin's STREAM). A two-dimensional pair moves at least 64 bytes a point in double precision: along rows
and along columns, forward and back, it reads and writes each number once. A part of the stream near 1 says
that the memory is the limit, and more threads bring no more than the stream gains by them.

The passes are those of a first solve of a rough surface, on its finest grid; their bytes are the arrays that
they read and those that they write. What is left of the solve is on one thread.

OpenMP starts no more threads than OMP_NUM_THREADS allowed when the process began.
"""

from __future__ import annotations

import inspect
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from unittest.mock import patch

import numba as nb
import numpy as np
from benchmarks.common import Cell, Effort, Table, bare_pairs, seconds
from benchmarks.slabs import configuration

from gfmdlayer.case.case import Case
from gfmdlayer.contact.nested.iteration import ParallelPasses
from gfmdlayer.grid.transforms import SurfaceFilter, Transforms

EFFORT = Effort(points=(512, 1024, 2048), repetitions=5)
QUICK = Effort(points=(512,), repetitions=2)

_THREADS = (1, 2)
_STREAMED = 1 << 23  # numbers of each of the three arrays of a thread, 64 MiB
_NUMBERS_OF_A_PAIR = 8  # read or written at each point, at least
_NUMBERS_OF_A_FILTER = 6.5  # likewise: columns are read and written once, factors are half a number a point
# Arrays that a pass reads and writes, where the load is given and there is no hardness.
_ARRAYS = {
    "advance": (("x", "y", "step", "change"), ("x", "y", "r")),
    "precondition": (("r", "z", "d"), ("z",)),
    "hold": (("r", "D"), ("D",)),
    "correlate": (("r", "last", "z", "d"), ("z",)),
    "direct": (("x", "r", "z", "d"), ("d", "step")),
    "project": (("x", "r", "d"), ("step",)),
    "respond": (("x", "step", "change"), ()),
    "extent": (("h", "p", "gap"), ("gap",)),
    "displace": (("stiffness", "intercept", "pressure"), ("u", "pressure")),
    "settle": (("h", "p", "gap"), ("gap", "u")),
}
_COARSER = "on coarser grids, and between grids"


@nb.njit(nogil=True, fastmath={"contract"})
def _triad(a: Any, b: Any, c: Any) -> None:
    for i in range(a.size):
        a[i] = b[i] + 3.0 * c[i]


def measure(effort: Effort) -> Iterator[Table]:
    """Time pairs in both precisions and the triad, on one and two threads, in turns."""
    with ThreadPoolExecutor(max(_THREADS)) as pool:
        arrays = [tuple(np.ones(_STREAMED) for _ in range(3)) for _ in range(max(_THREADS))]
        _triad(*arrays[0])

        def stream(threads: int) -> None:
            list(pool.map(lambda each: _triad(*each), arrays[:threads]))

        rows: list[dict[str, Cell]] = []
        for points in effort.points:
            for single in (False, True):
                count = max(1, (1 << 23) // points**2)
                pairs = {t: bare_pairs(_transforms(points, t, single), count) for t in _THREADS}
                least = {(kind, t): np.inf for kind in ("pair", "stream") for t in _THREADS}
                for _ in range(effort.repetitions):
                    for t in _THREADS:
                        least["pair", t] = min(least["pair", t], seconds(pairs[t]) / count)
                        least["stream", t] = min(least["stream", t], seconds(lambda t=t: stream(t)))
                size = 4 if single else 8
                for t in _THREADS:
                    streamed = t * 24 * _STREAMED / least["stream", t]
                    moved = _NUMBERS_OF_A_PAIR * size * points**2 / least["pair", t]
                    rows.append(
                        {
                            "points": f"{points}²",
                            "precision": "single" if single else "double",
                            "threads": t,
                            "pair [ms]": 1e3 * least["pair", t],
                            "times faster": least["pair", 1] / least["pair", t],
                            "pair [GB/s]": moved / 1e9,
                            "stream [GB/s]": streamed / 1e9,
                            "stream, times faster": streamed * least["stream", 1] / (24 * _STREAMED),
                            "part of the stream": moved / streamed,
                        }
                    )
        note = "Parts above 1: the fields stay in the cache between passes."
        yield Table("roofline", "FFT pairs against the memory", rows, note)
        yield _passes(max(effort.points), effort.repetitions, stream)


def _passes(points: int, repetitions: int, stream: Callable[[int], None]) -> Table:
    """Time the passes of a solve on one and on two threads, in turns; the fastest solve of each counts."""
    least: dict[int, tuple[float, dict[str, list[float]]]] = {}
    streamed = dict.fromkeys(_THREADS, 0.0)
    solves = {threads: _solve(points, threads) for threads in _THREADS}
    for _ in range(repetitions):
        for threads, solve in solves.items():
            found = _clocked(points, solve)
            least[threads] = min(least.get(threads, found), found, key=lambda each: each[0])
            moved = 24 * _STREAMED * threads
            streamed[threads] = max(streamed[threads], moved / seconds(lambda t=threads: stream(t)))
    rows: list[dict[str, Cell]] = []
    for threads, (whole, clocks) in least.items():
        clocks["the rest"] = [whole - sum(clock[0] for clock in clocks.values()), np.nan, 1]
        clocks["the solve"] = [whole, np.nan, 1]
        for name, (spent, moved, calls) in clocks.items():
            alone = least[1][1].get(name, [np.nan])[0]
            rows.append(
                {
                    "pass": name,
                    "threads": threads,
                    "calls": int(calls),
                    "time [ms]": 1e3 * spent,
                    "share of the solve": spent / whole,
                    "times faster": alone / spent,
                    "GB/s": None if np.isnan(moved) else moved / spent / 1e9,
                    "part of the stream": None if np.isnan(moved) else moved / spent / streamed[threads],
                }
            )
    title = f"Passes of a first solve of a rough surface, {points} x {points} points"
    note = "The rest: coarser transfers, sums and copies by NumPy, new arrays, the interpreter."
    return Table("roofline-passes", title, rows, note)


def _solve(points: int, threads: int) -> Callable[[], object]:
    """A solve from rest; the first one compiles and plans."""
    case = Case(configuration(points), threads=threads)
    problem = case.contact.loading.problem(*case.contact.history.terms(0.0), 1.0)
    case.contact.solve(problem, 0.0)
    return lambda: case.contact.solve(problem, 0.0)


def _clocked(points: int, solve: Callable[[], object]) -> tuple[float, dict[str, list[float]]]:
    """Seconds of a solve; seconds, bytes and calls of its passes, those on coarser grids together."""
    clocks: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0, 0])

    def timed(method: Callable[..., Any], describe: Callable[..., tuple[str, float]]) -> Callable[..., Any]:
        def call(self: Any, *arguments: Any) -> Any:
            begun = time.perf_counter()
            answer = method(self, *arguments)
            spent = time.perf_counter() - begun
            name, moved = describe(*arguments)
            for i, some in enumerate((spent, moved, 1)):
                clocks[name][i] += some
            return answer

        return call

    def of_pass(kernel: Any, *arguments: Any) -> tuple[str, float]:
        name, names = kernel.py_func.__name__, [*inspect.signature(kernel.py_func).parameters][2:]
        if name not in _ARRAYS:
            return _COARSER, np.nan
        of = dict(zip(names, arguments, strict=True))
        moved = sum(of[each].nbytes for each in sum(_ARRAYS[name], ()))
        first = of[_ARRAYS[name][0][0]]
        single = first.dtype.itemsize == (8 if first.dtype.kind == "c" else 4)
        return _named(name, single, first.size, moved)

    def of_transform(source: Any, target: Any) -> tuple[str, float]:
        field = source if source.dtype.kind == "f" else target
        return _named("transform", field.itemsize == 4, field.size, field.nbytes * _NUMBERS_OF_A_PAIR / 2)

    def of_filter(field: Any, _target: Any) -> tuple[str, float]:
        moved = field.nbytes * _NUMBERS_OF_A_FILTER
        return _named("filter: transforms, factors", field.itemsize == 4, field.size, moved)

    def _named(name: str, single: bool, size: int, moved: float) -> tuple[str, float]:
        if size < points**2 / 2:
            return _COARSER, np.nan
        return f"{name}, {'single' if single else 'double'}", moved

    with (
        patch.object(ParallelPasses, "__call__", timed(ParallelPasses.__call__, of_pass)),
        patch.object(ParallelPasses, "only", timed(ParallelPasses.only, of_pass)),
        patch.object(SurfaceFilter, "__call__", timed(SurfaceFilter.__call__, of_filter)),
        patch.object(Transforms, "transform", timed(Transforms.transform, of_transform)),
        patch.object(Transforms, "transform_back", timed(Transforms.transform_back, of_transform)),
    ):
        whole = seconds(solve)
    return whole, dict(sorted(clocks.items(), key=lambda each: -each[1][0]))


def _transforms(points: int, threads: int, single: bool) -> Transforms:
    return Transforms((points, points), threads=threads, single=single)
