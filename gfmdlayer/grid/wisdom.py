"""FFTW's plans, measured once on a machine and then the same for every run: runs agree in every bit."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile

import pyfftw

from gfmdlayer.grid.grid import parts
from gfmdlayer.grid.transforms import Transforms


def planned(shape: tuple[int, ...], folder: Path, threads: int = 1) -> str:
    """Wisdom for fields of a shape and threads, from the folder if it is there, else measured and put there.

    Whoever puts it there first wins: of several runs that measure at once, all use the same plans.  Where the
    folder cannot be written, the plans are this run's own.
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
        with NamedTemporaryFile("w", dir=folder, suffix=".part", encoding="ascii") as file:
            file.write(wisdom)
            file.flush()
            os.link(file.name, kept)
    with suppress(OSError, UnicodeDecodeError):
        return kept.read_text(encoding="ascii")
    return wisdom
