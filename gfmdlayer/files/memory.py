"""A file that is only in memory: arrays of Python take the way of the files that a configuration names."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any, Self


class MemoryFile(type(Path())):  # type: ignore[misc]
    """The contents of a file under a name, which is not on the disk.

    Parameters
    ----------
    name : str
        Name of the file; equal names stand for equal contents.
    contents : bytes
        Its contents.
    """

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

    def is_file(self, **_: Any) -> bool:
        """Whether it can be read."""
        return True

    def open(self, *_: Any, **__: Any) -> io.BytesIO:
        """Open it for reading bytes."""
        return io.BytesIO(self.contents)

    def read_bytes(self) -> bytes:
        """Return its contents."""
        return self.contents

    def read_text(self, encoding: str | None = None, *_: Any, **__: Any) -> str:
        """Return its contents as text."""
        return self.contents.decode(encoding or "utf-8")
