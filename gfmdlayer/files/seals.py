"""Seals: the checksum of all bytes of a file, at its end.

A line of fixed length, `gfmdlayer seal CRC-32`, follows the contents. HDF5 ignores bytes behind those it
knows, and cuts them off where another program changes the file: such a file has no seal. HDF5 itself notices
a changed byte in few places, and some of them end the process.
"""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import BinaryIO

_SEAL = re.compile(rb"\ngfmdlayer seal ([0-9a-f]{8})\n")
_LENGTH = len(b"\ngfmdlayer seal 01234567\n")
_BLOCK = 1 << 16  # bytes read at a time


def seal(file: BinaryIO) -> None:
    """Append the seal to a file that is open for reading and writing."""
    size = file.seek(0, 2)
    checksum = _checksum(file, size)
    file.seek(size)
    file.write(b"\ngfmdlayer seal %08x\n" % checksum)


def is_intact(path: Path, most: float = float("inf")) -> bool | None:
    """Whether the bytes of a file are those that were sealed.

    Parameters
    ----------
    path : Path
        The file.
    most : float
        Bytes up to which a file is read.

    Returns
    -------
    bool or None
        None where the file has no seal, or is larger.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    with path.open("rb") as file:
        contents = file.seek(0, 2) - _LENGTH
        if not 0 <= contents <= most:
            return None
        file.seek(contents)
        found = _SEAL.fullmatch(file.read())
        return None if found is None else int(found[1], 16) == _checksum(file, contents)


def _checksum(file: BinaryIO, size: int) -> int:
    """Return the CRC-32 of the first bytes of a file."""
    file.seek(0)
    checksum = 0
    while size > 0 and (block := file.read(min(size, _BLOCK))):
        size, checksum = size - len(block), zlib.crc32(block, checksum)
    return checksum
