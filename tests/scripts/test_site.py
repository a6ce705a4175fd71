"""The built site in a browser: no text is cut off, pale or behind a scrollbar; scripts/docs.sh runs it."""

from pathlib import Path

import pytest

SITE = Path(__file__).parents[2] / "docs/_build/html"
PAGES = sorted(SITE.rglob("*.html"))

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not PAGES, reason="the site is not built")]


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (400, "dark")])
def test_every_page_can_be_read(width, scheme, visit, flaws):
    """On a narrow window formulas and tables may scroll."""
    page = visit(PAGES[0], width=width, scheme=scheme)
    wide = "article pre, article .formula" if width > 1000 else "article pre"
    found = {}
    for path in PAGES:
        page.goto(path.as_uri())
        if wrong := flaws(page, "article", wide):
            found[str(path.relative_to(SITE))] = wrong
    assert found == {}
