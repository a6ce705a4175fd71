"""The page of published values beside those of this code, which are computed while the site is built."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.config import Config as Settings


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the page before the sources are read."""
    app.connect("config-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx, _settings: Settings) -> None:
    path = Path(app.srcdir) / "verification/published.md"
    text = runpy.run_path(str(Path(app.srcdir).parent / "scripts/published.py"))["page"]()
    if not path.exists() or path.read_text(encoding="utf-8") != text:  # an equal page is not read again
        path.write_text(text, encoding="utf-8")
