"""Seconds of an FFT pair on this machine: measured once for each size and kept beside FFTW's wisdom.

    pair-16384.seconds     with the plans of a run
    pair-16384.hasty       before any run, with a plan that takes no time to make

Reading a kept number imports no numerics.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.files.whole import write_text

if TYPE_CHECKING:
    from gfmdlayer.grid.transforms import Transforms

LARGEST = 1 << 20  # points of a pair that is measured without a plan for it
_REPEATS, _BATCH = 5, 1e-3  # batches of pairs, and the seconds of one


def pair_seconds(shape: tuple[int, ...], folder: Path) -> float:
    """Return the seconds of a forward and a backward transform of a grid, kept or measured.

    They are measured with a hasty plan, on a line of as many points but at most `LARGEST`.
    """
    for kind in ("seconds", "hasty"):
        with suppress(OSError, ValueError):
            return float(_kept(shape, folder, kind).read_text(encoding="ascii"))
    from gfmdlayer.grid.fftw import forget_wisdom
    from gfmdlayer.grid.transforms import Transforms

    size = math.prod(shape)
    hasty = Transforms((min(size, LARGEST),), time_limit=0.0)
    found = _measured(hasty) * max(1.0, size * math.log(size) / (LARGEST * math.log(LARGEST)))
    forget_wisdom()  # a run in this process makes better plans
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        write_text(_kept(shape, folder, "hasty"), repr(found))
    return found


def keep_pair_seconds(shape: tuple[int, ...], wisdom: str, folder: Path, threads: int = 1) -> None:
    """Measure a pair with the plans of a run, and keep it in a folder where that is not done yet."""
    from gfmdlayer.grid.transforms import Transforms

    if not (path := _kept(shape, folder)).exists():
        with suppress(OSError):
            write_text(path, repr(_measured(Transforms(shape, wisdom, threads=threads))), replace=False)


def _kept(shape: tuple[int, ...], folder: Path, kind: str = "seconds") -> Path:
    return folder / f"pair-{'x'.join(map(str, shape))}.{kind}"


def _measured(transforms: Transforms) -> float:
    """Return the shortest time of a pair among some batches: other work on the machine only adds to it."""
    field, spectrum = transforms.empty_field(), transforms.empty_spectrum()
    field[:], number, best = 0.0, 1, math.inf
    for _ in range(_REPEATS):
        begun = time.perf_counter()
        for _ in range(number):
            transforms.transform(field, spectrum)
            transforms.transform_back(spectrum, field)
        each = (time.perf_counter() - begun) / number
        best, number = min(best, each), max(1, round(_BATCH / max(each, 1e-9)))
    return best
