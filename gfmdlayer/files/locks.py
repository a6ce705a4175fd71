"""Locks between processes, kept by the kernel: it releases a lock when its holder dies; ages of processes.

On a file system without locks nothing is locked, and the user has to keep two runs apart.
"""

from __future__ import annotations

import errno
import fcntl
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

# Files in folders where other users may write: no link is followed, and a file may hold anything.

_LARGEST = 1 << 22  # bytes of a small file


def no_link(path: str, flags: int) -> int:
    """Open a file that is no symbolic link, as the `opener` of Python's open does."""
    try:
        return os.open(path, flags | os.O_NOFOLLOW, 0o666)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, "is a symbolic link", path) from None
        raise


def write_new(path: Path, contents: bytes | bytearray) -> None:
    """Write a file that must not exist, not even as a symbolic link."""
    with open(path, "xb", buffering=0, opener=no_link) as file:
        rest = memoryview(contents)
        while rest:
            rest = rest[file.write(rest) :]


def read_small(path: Path) -> bytes:
    """Read a small regular file; any other, such as a pipe, is not waited for."""
    contents = b""
    with open(path, "rb", buffering=0, opener=regular_and_no_link) as file:
        while len(contents) <= _LARGEST and (part := file.read(_LARGEST + 1)):
            contents += part
    if len(contents) > _LARGEST:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return contents


def read_json(path: Path) -> dict[str, Any] | None:
    """Read a small JSON file; None where there is none or it cannot be read."""
    import json  # which help on the command line does without

    with suppress(OSError, ValueError, RecursionError):
        content = json.loads(read_small(path))
        if isinstance(content, dict):
            return content
    return None


def is_gone(folder: Path) -> bool:
    """Whether a folder was removed; one that cannot be read for a while is not."""
    try:
        folder.stat()
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:
        return False
    return False


def regular(path: str, flags: int) -> int:
    """Open a regular file, also by a link, as `opener` of Python's open: a pipe is not waited for."""
    return _if_regular(os.open(path, flags | os.O_NONBLOCK), path)


def regular_and_no_link(path: str, flags: int) -> int:
    """Open a regular file that is no symbolic link, as `opener` of Python's open."""
    return _if_regular(no_link(path, flags | os.O_NONBLOCK), path)


def _if_regular(descriptor: int, path: str) -> int:
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "is no regular file", path)
    return descriptor


def printable(text: str) -> str:
    """Return text in which characters that steer a terminal are written out by their codes; lines stay."""
    if text.isprintable():
        return text
    lines = text.split("\n")
    shown = ((c if c.isprintable() else c.encode("unicode_escape").decode() for c in line) for line in lines)
    return "\n".join(map("".join, shown))


def try_lock(file: IO[str], shared: bool = False) -> bool | None:
    """Lock an open file without waiting; return whether it is, None on a file system without locks."""
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        return False if error.errno in (errno.EAGAIN, errno.EACCES) else None
    return True


def open_for_writing(path: Path) -> bool:
    """Whether another process has an existing HDF5 file open for writing, by the lock that HDF5 holds."""
    try:
        with open(path, "rb", opener=regular) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in (errno.EAGAIN, errno.EACCES) and os.access(path, os.R_OK)
    return False


def born(process: int | None = None) -> str:
    """Return when a process began, which distinguishes it from a later one of the same number.

    Empty where that is unknown, and of a process that has ended and is still listed.
    """
    with suppress(OSError, IndexError):  # not on every system
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        state = Path(f"/proc/{process or os.getpid()}/stat").read_bytes().rpartition(b")")[2].split()
        if state[0] not in (b"Z", b"X"):
            return f"{boot} {state[19].decode()}"  # clock ticks from the start of the machine
    return ""
