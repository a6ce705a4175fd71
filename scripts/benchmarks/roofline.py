"""What the memory allows: bytes of an FFT pair, against what the machine streams.

The stream is a triad a = b + s c over arrays far larger than the caches, which moves 24 bytes a number
(McCalpin's STREAM). A two-dimensional pair moves at least 64 bytes a point in double precision: along rows
and along columns, forward and back, it reads and writes each number once. A part of the stream near 1 says
that the memory is the limit, and more threads bring no more than the stream gains by them.

OpenMP starts no more threads than OMP_NUM_THREADS allowed when the process began.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba as nb
import numpy as np
from benchmarks.common import bare_pairs
from benchmarks.tables import Cell, Effort, Table

from gfmdlayer.grid.transforms import Transforms

EFFORT = Effort(points=(512, 1024, 2048), repetitions=5)
QUICK = Effort(points=(512,), repetitions=2)

_THREADS = (1, 2)
_STREAMED = 1 << 23  # numbers of each of the three arrays of a thread, 64 MiB
_NUMBERS_OF_A_PAIR = 8  # read or written at each point, at least


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
                        least["pair", t] = min(least["pair", t], _seconds(pairs[t]) / count)
                        least["stream", t] = min(least["stream", t], _seconds(lambda t=t: stream(t)))
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


def _transforms(points: int, threads: int, single: bool) -> Transforms:
    return Transforms((points, points), threads=threads, single=single)


def _seconds(task: Callable[[], None]) -> float:
    begun = time.perf_counter()
    task()
    return time.perf_counter() - begun
