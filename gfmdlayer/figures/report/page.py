"""The page of a case or a sweep: data, style and program in one HTML file, which needs no network.

The curves are drawn by Plotly.js (MIT licence), as the package `plotly` brings it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from gfmdlayer.figures.plot_style import check_suffix
from gfmdlayer.figures.report.cases import Listed
from gfmdlayer.figures.report.payload import payload
from gfmdlayer.figures.snapshot_plots import GAP_COLOURS, PRESSURE_COLOURS
from gfmdlayer.files.whole import write_text
from gfmdlayer.results.provenance import now, provenance
from gfmdlayer.results.schema import ResultsError

PROGRAM = ("data.js", "figures.js", "curves.js", "surfaces.js", "distributions.js", "tables.js")
COLOURS = 32  # of a scale; browsers interpolate


def write_report(cases: Sequence[Listed], out: Path, title: str, config: str = "") -> Path:
    """Write the page (.html) of a case or a sweep, over an earlier one; return its path.

    `config` is the configuration, by default that of the first complete case.
    """
    check_suffix(out, (".html", ".htm"))
    try:
        write_text(out, page(payload(cases, config), title))
    except OSError as error:
        raise ResultsError(f"{out}: cannot be written: {error.strerror or error}") from error
    return out


def page(data: dict[str, Any], title: str) -> str:
    """Return the page with these data."""
    from plotly.offline import get_plotlyjs

    here = files(__package__)
    version = provenance()["gfmdlayer_version"]
    about = {"title": title, "written": f"{now()} by gfmdlayer {version}", "colours": _colours()}
    parts = {
        "title": escape(title),
        "style": (here / "page.css").read_text(encoding="utf-8"),
        "plotly": get_plotlyjs(),
        "data": json.dumps(about | data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "program": "\n".join((here / name).read_text(encoding="utf-8") for name in PROGRAM),
    }
    pieces = (here / "page.html").read_text(encoding="utf-8").split("@@")
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(pieces))


def _colours() -> dict[str, list[str]]:
    """Return the colours of curves, pressure and gap from the least to the largest value."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    names = {"curves": "viridis", "pressure": PRESSURE_COLOURS, "gap": GAP_COLOURS}
    return {
        use: [to_hex(colormaps[name](i / (COLOURS - 1))) for i in range(COLOURS)]
        for use, name in names.items()
    }
