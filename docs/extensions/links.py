"""Links of the finished site: files and anchors that a page names are there; a warning otherwise.

Sphinx checks references of its own. This also sees links in raw HTML, in docstrings and in pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

if TYPE_CHECKING:
    from sphinx.application import Sphinx


class _Page(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep what leads elsewhere, and what can be led to."""
        for name, value in attrs:
            if name in {"id", "name"} and value:
                self.anchors.add(value)
            elif name in {"href", "src"} and value and (tag, name) != ("base", "href"):
                self.links.append(value)


def broken(site: Path) -> Iterator[str]:
    """Yield a message for each link within the site that leads nowhere."""
    page = cache(_Page)
    for path in sorted(site.rglob("*.html")):
        for link in page(path).links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file():
                yield f"{path.relative_to(site)}: no file {link}"
            elif parts.fragment and target.suffix == ".html" and _lacks(page(target), parts.fragment):
                yield f"{path.relative_to(site)}: no anchor {link}"


def _lacks(page: _Page, fragment: str) -> bool:
    return unquote(fragment) not in page.anchors


def setup(app: Sphinx) -> dict[str, bool]:
    """Check the site when it is built."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _check(app: Sphinx, failure: Exception | None) -> None:
    from sphinx.util import logging

    if failure is None and app.builder.format == "html":
        logger = logging.getLogger(__name__)
        for message in broken(Path(app.outdir)):
            logger.warning(message, type="links")
