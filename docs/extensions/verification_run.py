"""The table of `gfmdlayer verify --quick`, computed by a process of its own while the gallery is drawn.

It is computed once for each state of the package: the table is newer than every source.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from sphinx.util import logging

import gfmdlayer

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_started: list[subprocess.Popen[str]] = []


def setup(app: Sphinx) -> dict[str, bool]:
    """Begin before the gallery, and wait before the pages are read."""
    app.connect("config-inited", _begin)
    app.connect("env-before-read-docs", _wait)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _begin(app: Sphinx, *_: object) -> None:
    folder = Path(app.srcdir) / "verification/run"
    table = folder / "verification.md"
    sources = Path(gfmdlayer.__file__).parent.rglob("*.py")
    if table.exists() and table.stat().st_mtime > max(each.stat().st_mtime for each in sources):
        return
    command = [sys.executable, "-m", "gfmdlayer", "verify", "--quick", "--out", str(folder)]
    _started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))


def _wait(*_: object) -> None:
    while _started:
        process = _started.pop()
        said, _error = process.communicate()
        if process.returncode:  # a warning ends the build of scripts/docs.sh
            logging.getLogger(__name__).warning("gfmdlayer verify --quick failed:\n%s", said[-4000:])
