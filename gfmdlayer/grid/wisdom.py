"""FFTW wisdom measured once on a machine and kept on its disk: runs with it agree in every bit.

It is kept for the user and with the results, whose later cases then agree with the earlier ones whatever has
become of the user's. One changed bit in wisdom ends the process in FFTW, so that each file has a seal.
"""

from __future__ import annotations

import warnings
from contextlib import suppress
from pathlib import Path

from llvmlite.binding import get_host_cpu_name

from gfmdlayer.files.whole import read_sealed, write_sealed
from gfmdlayer.grid.fftw import VERSION, forget_wisdom
from gfmdlayer.grid.grid import Grid, parts
from gfmdlayer.grid.ranks import Ranks
from gfmdlayer.grid.transforms import Transforms

_MAY_DIFFER = "results may differ from those of other runs in their last bits"


def planned(shape: tuple[int, ...], folder: Path, threads: int = 1, results: Path | None = None) -> str:
    """Wisdom for the transforms of a grid, its windows and coarser grids, from a folder or measured."""
    # The wisdom of `results` comes first. Of several runs that measure at the same time, all use the wisdom
    # of the first one that is done. A warning says where kept wisdom cannot be used, which is replaced, or
    # where none can be kept.
    with_threads = f"-{threads}threads" if threads > 1 else ""
    made_by = f"fftw-{VERSION}-{get_host_cpu_name()}"
    others = "parts" if len(shape) == 1 else "coarser"
    name = f"{made_by}-{'x'.join(map(str, shape))}{with_threads}-and-{others}.wisdom"
    places = [place / name for place in (results, folder) if place is not None]
    wisdom = next(filter(None, (_read(place, shape, threads) for place in places)), None)
    wisdom = wisdom or _measured(shape, threads, None)
    for place in reversed(places):
        wisdom = _keep(place, wisdom)
    return wisdom


def _measured(shape: tuple[int, ...], threads: int, wisdom: str | None) -> str:
    """Return the wisdom after all transforms of a grid have been planned."""
    transforms = Transforms(shape, wisdom, threads=threads)
    for part in parts(shape):
        transforms.for_window(part)
    for grid in Grid(shape, (1.0,) * len(shape)).nested:
        transforms.of_shape(grid.points, single=True)
    return transforms.wisdom


def _read(path: Path, shape: tuple[int, ...], threads: int) -> str | None:
    """Return kept wisdom that FFTW can use; other wisdom is removed with a warning."""
    try:
        kept = read_sealed(path)
    except OSError:
        return None
    wrong = "is damaged"
    if kept is not None:
        wisdom = kept.decode(errors="replace")
        for _ in range(2):
            found = _measured(shape, threads, wisdom)
            own, every = set(wisdom.splitlines()), set(found.splitlines())
            if own == every:  # FFTW measures nothing beside it
                return wisdom
            forget_wisdom()  # that this process has measured for other grids
        if own < every:  # earlier versions did not keep all plans
            with suppress(OSError):
                write_sealed(path, found.encode())
            return found
        wrong = "is not of this FFTW"
    warnings.warn(f"{path}: {wrong} and is replaced; {_MAY_DIFFER}", stacklevel=4)
    with suppress(OSError):
        path.unlink()
    return None


def _keep(path: Path, wisdom: str) -> str:
    """Keep wisdom and return it, or that which another run has kept before."""
    try:
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileExistsError):
                write_sealed(path, wisdom.encode(), replace=False)
        return (read_sealed(path) or b"").decode() or wisdom
    except OSError as error:
        reason = f"cannot be kept ({error.strerror})"
        warnings.warn(f"{path}: FFTW's plans {reason}; {_MAY_DIFFER}", stacklevel=4)
    return wisdom


class RankWisdom:
    """Wisdom that a rank of several keeps in the folder of results, from its first case to the next."""

    def __init__(self, ranks: Ranks, points: tuple[int, ...], folder: Path, threads: int) -> None:
        self._alone = ranks.count == 1
        share = f"{'x'.join(map(str, points))}-rank{ranks.number}of{ranks.count}-{threads}threads"
        made_by = f"fftw-{VERSION}-{get_host_cpu_name()}"
        self._path = folder / f"{made_by}-{share}-and-parts.wisdom"

    def read(self) -> str | None:
        """Return the wisdom that is kept, if any."""
        with suppress(OSError):
            return None if self._alone else (read_sealed(self._path) or b"").decode() or None
        return None

    def keep(self, wisdom: str) -> None:
        """Keep the wisdom of a run, where none is kept."""
        if not self._alone:
            _keep(self._path, wisdom)
