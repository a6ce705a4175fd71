"""The folder of files made once on a machine: seconds of FFT pairs, compiled kernels."""

from __future__ import annotations

import io
import os
import stat
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Self


def user_cache() -> Path:
    """Return the folder of the user's caches; without a home that can be written, a temporary one."""
    places = [Path(os.environ.get("XDG_CACHE_HOME", ""))]
    with suppress(RuntimeError):  # a user that the system does not know
        places.append(Path.home() / ".cache")
    for place in places:
        if place.is_absolute() and is_writable(place / "gfmdlayer"):
            return place / "gfmdlayer"
    return _own_temporary()


def is_writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which is made where there is none."""
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    return False


@cache
def _own_temporary() -> Path:
    """Return this user's temporary folder; a new one where another user has taken its name."""
    folder = Path(tempfile.gettempdir()) / f"gfmdlayer-{os.getuid()}"
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022:
            return folder
    return Path(tempfile.mkdtemp(prefix=f"gfmdlayer-{os.getuid()}-"))


# A file that is only in memory: arrays of Python take the way of the files that a configuration names.


class MemoryFile(type(Path())):  # type: ignore[misc]
    """The contents of a file that is not on the disk, under a name; equal names mean equal contents."""

    contents: bytes

    def __new__(cls, name: str, contents: bytes) -> Self:  # noqa: D102
        self: Self = super().__new__(cls, name)
        self.contents = contents
        return self

    def __init__(self, name: str, contents: bytes) -> None:  # noqa: ARG002
        if sys.version_info >= (3, 12):
            super().__init__(name)

    def __reduce__(self) -> tuple[type[MemoryFile], tuple[str, bytes]]:
        """Keep the contents on the way between processes."""
        return MemoryFile, (str(self), self.contents)

    def absolute(self) -> Self:
        """Return itself: it is in no folder."""
        return self

    def exists(self, **_: Any) -> bool:
        """Whether it can be read."""
        return True

    is_file = exists

    def open(
        self, mode: str = "r", _buffering: int = -1, encoding: str | None = None, *_: Any, **__: Any
    ) -> Any:
        """Open it for reading, as `read_bytes` and `read_text` do."""
        held = io.BytesIO(self.contents)
        return held if "b" in mode else io.TextIOWrapper(held, encoding or "utf-8")
