"""Writing a file whole: under its final name a file is complete.

The contents go to an unfinished file in the same folder, NAME.HOST-PID-RANDOM.part, which gets the final
name when all has been written. Two processes that write the same file, even on hosts that share a name, never
touch each other's unfinished file. A killed process leaves one behind; `is_unfinished` recognises it.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import socket
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from gfmdlayer.files.hdf5 import SIGNATURE
from gfmdlayer.files.locks import regular, write_new

UNFINISHED = ".part"

_UNFINISHED_NAME = re.compile(rf".+-\d+-[0-9a-f]{{8}}{re.escape(UNFINISHED)}(\.\w+)?")


def output_file(out: str | Path | None, default: Path) -> Path:
    """Return the file that `--out` means: in a folder, the default name; without an ending, the default's.

    A folder is one that is there, or has a name that ends in a slash.
    """
    if out is None:
        return default
    file = Path(out)
    if file.is_dir() or str(out).endswith(os.sep):
        return file / default.name
    return file if file.suffix else file.with_name(file.name + default.suffix)


def unfinished_path(path: Path, suffix: str = "") -> Path:
    """Return a name for the unfinished file of `path` that no other process uses."""
    writer = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"
    return path.with_name(f"{path.name}.{writer}{UNFINISHED}{suffix}")


def is_unfinished(name: str) -> bool:
    """Whether a file name is one that `unfinished_path` gives."""
    return _UNFINISHED_NAME.fullmatch(name) is not None


def publish(part: Path, path: Path, durable: bool = True, replace: bool = True) -> None:
    """Give a closed unfinished file its final name; `durable` brings it to the disk.

    Without `replace` an earlier file stays, and FileExistsError says so.
    """
    if durable:
        synchronise(part)
    if replace:
        part.replace(path)
    else:
        try:
            os.link(part, path)
        except FileExistsError:
            raise
        except OSError:  # a file system without hard links
            if path.exists():
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
            part.replace(path)
        else:
            part.unlink()
    if durable:
        with suppress(OSError):  # some network file systems refuse; the file is whole all the same
            synchronise(path.parent)


@contextmanager
def unfinished(path: Path, suffix: str = "", durable: bool = True, replace: bool = True) -> Iterator[Path]:
    """Give the name of an unfinished file to write; it is published if the block ends well, else removed."""
    part = unfinished_path(path, suffix)
    try:
        yield part
        publish(part, path, durable, replace)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str, durable: bool = True, replace: bool = True) -> None:
    """Write a small text file whole."""
    with unfinished(path, durable=durable, replace=replace) as part:
        write_new(part, text.encode())


def cannot_be_written(error: OSError) -> str:
    """Return why a file cannot be written, with its name where the system gives it."""
    named = f": {error.filename}" if error.filename else ""
    return f"cannot be written ({error.strerror or error}{named})"


def synchronise(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # no pipe is waited for
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


# Seals: the checksum of all bytes of a file, at its end.
#
# A line of fixed length, `gfmdlayer seal CRC-32`, follows the contents. HDF5 ignores bytes behind those it
# knows, and cuts them off where another program changes the file, which then has no seal. HDF5 itself
# notices a changed byte in few places, and some of them end the process.

_FORM = b"\ngfmdlayer seal %08x\n"
_SEAL = re.compile(rb"\ngfmdlayer seal ([0-9a-f]{8})\n")
_LENGTH = len(_FORM % 0)
_HEAD = 48  # bytes of the superblock of HDF5 with the end of the file
_BLOCK = 1 << 16  # bytes read at a time


def seal(file: BinaryIO) -> None:
    """Append the seal to a file that is open for reading and writing."""
    size = file.seek(0, 2)
    checksum = _checksum(file, size)
    file.seek(size)
    file.write(_FORM % checksum)


def sealed(contents: bytearray) -> bytearray:
    """Append the seal to the contents of a file in memory, and return them."""
    contents += _FORM % zlib.crc32(contents)
    return contents


def is_sealed(contents: bytes) -> bool | None:
    """Whether the contents of a file are those that were sealed; None without a seal."""
    seal = _SEAL.fullmatch(contents, max(0, len(contents) - _LENGTH))
    if seal is None:
        return False if _lost_seal(contents[:_HEAD], len(contents)) else None
    return int(seal[1], 16) == zlib.crc32(memoryview(contents)[:-_LENGTH])


def is_intact(path: Path, most: float = float("inf")) -> bool | None:
    """Whether the bytes of a file are those that were sealed; None without a seal, or above `most` bytes."""
    with open(path, "rb", opener=regular) as file:
        head, size = file.read(_HEAD), file.seek(0, 2)
        file.seek(max(0, size - _LENGTH))
        if (seal := _SEAL.fullmatch(file.read())) is None:
            return False if _lost_seal(head, size) else None
        return None if size - _LENGTH > most else int(seal[1], 16) == _checksum(file, size - _LENGTH)


def _lost_seal(head: bytes, size: int) -> bool:
    """Whether other bytes are in the place of the seal, behind the end of the file that HDF5 knows."""
    # A program that changes the file cuts the seal off.
    if head[:8] != SIGNATURE or len(head) < _HEAD:
        return False
    place = 28 if head[8] >= 2 else 40  # of the end in the superblock
    return size == int.from_bytes(head[place : place + 8], "little") + _LENGTH


def _checksum(file: BinaryIO, size: int) -> int:
    """Return the CRC-32 of the first bytes of a file."""
    file.seek(0)
    checksum = 0
    while size > 0 and (block := file.read(min(size, _BLOCK))):
        size, checksum = size - len(block), zlib.crc32(block, checksum)
    return checksum
