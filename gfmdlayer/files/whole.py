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
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gfmdlayer.files.shared_folders import write_new

UNFINISHED = ".part"

_UNFINISHED_NAME = re.compile(rf".+-\d+-[0-9a-f]{{8}}{re.escape(UNFINISHED)}(\.\w+)?")


def unfinished_path(path: Path, suffix: str = "") -> Path:
    """Return a name for the unfinished file of `path` that no other process uses.

    Parameters
    ----------
    path : Path
        The final name.
    suffix : str
        Added at the end, for programs that choose the format by it.

    Returns
    -------
    Path
    """
    writer = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"
    return path.with_name(f"{path.name}.{writer}{UNFINISHED}{suffix}")


def is_unfinished(name: str) -> bool:
    """Whether a file name is one that `unfinished_path` gives."""
    return _UNFINISHED_NAME.fullmatch(name) is not None


def publish(part: Path, path: Path, durable: bool = True, replace: bool = True) -> None:
    """Give a closed unfinished file its final name.

    Parameters
    ----------
    part, path : Path
        The unfinished file and its final name, in the same folder.
    durable : bool
        Bring the contents to the disk before and the name after.
    replace : bool
        Replace an earlier file; otherwise the first one stays.

    Raises
    ------
    FileExistsError
        If there is an earlier file and `replace` is false.
    OSError
        If the disk refuses; an earlier file is still there.
    """
    if durable:
        _synchronise(part)
    if replace:
        part.replace(path)
    else:
        _name_first(part, path)
    if durable:
        with suppress(OSError):  # some network file systems refuse; the file is whole all the same
            _synchronise(path.parent)


@contextmanager
def unfinished(path: Path, suffix: str = "", durable: bool = True, replace: bool = True) -> Iterator[Path]:
    """Give the name of an unfinished file to write; it is published if the block ends well, else removed.

    Parameters
    ----------
    path : Path
        The final name.
    suffix : str
        See `unfinished_path`.
    durable, replace : bool
        See `publish`.

    Yields
    ------
    Path
        Name of the file to create, write and close in the block.

    Raises
    ------
    OSError
        See `publish`.
    """
    part = unfinished_path(path, suffix)
    try:
        yield part
        publish(part, path, durable, replace)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str, durable: bool = True, replace: bool = True) -> None:
    """Write a small text file whole.

    Parameters
    ----------
    path : Path
        The final name.
    text : str
        The contents, written in UTF-8.
    durable, replace : bool
        See `publish`.

    Raises
    ------
    OSError
        See `publish`.
    """
    with unfinished(path, durable=durable, replace=replace) as part:
        write_new(part, text.encode())


def cannot_be_written(error: OSError) -> str:
    """Return why a file cannot be written, with its name where the system tells it."""
    named = f": {error.filename}" if error.filename else ""
    return f"cannot be written ({error.strerror or error}{named})"


def _name_first(part: Path, path: Path) -> None:
    """Give a file its final name if no other file has it."""
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


def _synchronise(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
