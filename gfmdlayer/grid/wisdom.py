"""FFTW's plans, measured once on a machine and then the same for every run: runs agree in every bit."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pyfftw

from gfmdlayer.files.whole import write_text
from gfmdlayer.grid.grid import parts
from gfmdlayer.grid.transforms import Transforms


def planned(shape: tuple[int, ...], folder: Path, threads: int = 1) -> str:
    """Wisdom for fields of a shape and threads, from the folder if it is there, else measured and put there.

    Of several runs that measure at once all use the plans that were put there first.  Where the folder cannot
    be written, a run uses its own.
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
