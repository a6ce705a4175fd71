"""FFTW wisdom measured once on a machine and kept on its disk: runs with it agree in every bit."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pyfftw

from gfmdlayer.files.whole import write_text
from gfmdlayer.grid.grid import parts
from gfmdlayer.grid.transforms import Transforms


def planned(shape: tuple[int, ...], folder: Path, threads: int = 1) -> str:
    """Wisdom for the transforms of a grid and of its windows, read from a folder or measured and kept there.

    Of several runs that measure at the same time, all use the wisdom of the first one that is done.

    Parameters
    ----------
    shape : tuple of int
        Shape of the fields.
    folder : Path
        Where wisdom is kept. If it cannot be written, the plans are this run's own.
    threads : int
        Threads of a transform.

    Returns
    -------
    str
        Wisdom for `Transforms`.
    """
    suffix = f"-{threads}threads" if threads > 1 else ""
    kept = folder / f"fftw-{pyfftw.fftw_version}-{'x'.join(map(str, shape))}{suffix}-and-parts.wisdom"
    with suppress(OSError, UnicodeDecodeError):
        return kept.read_text(encoding="ascii")
    transforms = Transforms(shape, threads=threads)
    for part in parts(shape):
        transforms.shorter(part)
    wisdom = transforms.wisdom
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        write_text(kept, wisdom, replace=False)
    with suppress(OSError, UnicodeDecodeError):
        return kept.read_text(encoding="ascii")
    return wisdom
