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

from gfmdlayer.files.shared_folders import read_small, regular, write_new
from gfmdlayer.files.whole import unfinished

_FORM = b"\ngfmdlayer seal %08x\n"
_SEAL = re.compile(rb"\ngfmdlayer seal ([0-9a-f]{8})\n")
_LENGTH = len(_FORM % 0)
_BLOCK = 1 << 16  # bytes read at a time


def seal(file: BinaryIO) -> None:
    """Append the seal to a file that is open for reading and writing."""
    size = file.seek(0, 2)
    checksum = _checksum(file, size)
    file.seek(size)
    file.write(_FORM % checksum)


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
        If the file cannot be read, or is no regular one.
    """
    with open(path, "rb", opener=regular) as file:
        contents = file.seek(0, 2) - _LENGTH
        if not 0 <= contents <= most:
            return None
        file.seek(contents)
        found = _SEAL.fullmatch(file.read())
        return None if found is None else int(found[1], 16) == _checksum(file, contents)


def write_sealed(path: Path, contents: bytes, replace: bool = True) -> None:
    """Write a small file whole, with its seal.

    Parameters
    ----------
    path : Path
        The final name.
    contents : bytes
        The contents.
    replace : bool
        See `gfmdlayer.files.whole.publish`.

    Raises
    ------
    OSError
        See `gfmdlayer.files.whole.publish`.
    """
    with unfinished(path, replace=replace) as part:
        write_new(part, contents + _FORM % zlib.crc32(contents))


def read_sealed(path: Path) -> bytes | None:
    """Return the contents of a small file without the seal; None where they are not those that were sealed.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    written = read_small(path)
    contents = written[:-_LENGTH]
    return contents if written == contents + _FORM % zlib.crc32(contents) else None


def _checksum(file: BinaryIO, size: int) -> int:
    """Return the CRC-32 of the first bytes of a file."""
    file.seek(0)
    checksum = 0
    while size > 0 and (block := file.read(min(size, _BLOCK))):
        size, checksum = size - len(block), zlib.crc32(block, checksum)
    return checksum
