"""The folder of what is measured once on a machine: FFTW's wisdom, the seconds of an FFT pair."""

from __future__ import annotations

import os
from pathlib import Path


def user_cache() -> Path:
    """Return the folder of the user's caches."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gfmdlayer"
