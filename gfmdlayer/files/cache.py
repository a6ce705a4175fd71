"""The folder of what is made once on a machine: FFTW's wisdom, seconds of FFT pairs, compiled kernels."""

from __future__ import annotations

import os
import stat
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path


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
        found = folder.lstat()
        if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022:
            return folder
    return Path(tempfile.mkdtemp(prefix=f"gfmdlayer-{os.getuid()}-"))
