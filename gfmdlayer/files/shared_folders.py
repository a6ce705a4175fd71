"""Files in folders where other users may write: no link is followed, and what is read may be anything."""

from __future__ import annotations

import errno
import json
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import Any

_LARGEST = 1 << 22  # bytes of a small file


def no_link(path: str, flags: int) -> int:
    """Open a file that is no symbolic link, as the `opener` of Python's open does.

    Raises
    ------
    OSError
        If it is one, or cannot be opened.
    """
    try:
        return os.open(path, flags | os.O_NOFOLLOW, 0o666)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, "is a symbolic link", path) from None
        raise


def write_new(path: Path, contents: bytes) -> None:
    """Write a file that must not exist, not even as a symbolic link.

    Raises
    ------
    OSError
        If there is one, or it cannot be written.
    """
    with open(path, "xb", opener=no_link) as file:
        file.write(contents)


def read_small(path: Path) -> bytes:
    """Read a small regular file; any other, such as a pipe, is not waited for.

    Raises
    ------
    OSError
        If it is none, or larger than some megabytes.
    """
    with open(path, "rb", opener=_regular_and_no_link) as file:
        contents = file.read(_LARGEST + 1)
    if len(contents) > _LARGEST:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return contents


def read_json(path: Path) -> dict[str, Any] | None:
    """Read a small JSON file; None where there is none or it cannot be read."""
    with suppress(OSError, ValueError, RecursionError):
        content = json.loads(read_small(path))
        if isinstance(content, dict):
            return content
    return None


def regular(path: str, flags: int) -> int:
    """Open a regular file, also by a link, as the `opener` of Python's open does: a pipe is not waited for.

    Raises
    ------
    OSError
        If it is none, or cannot be opened.
    """
    return _if_regular(os.open(path, flags | os.O_NONBLOCK), path)


def _regular_and_no_link(path: str, flags: int) -> int:
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
