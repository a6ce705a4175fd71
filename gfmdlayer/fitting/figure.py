"""The figure of a fit: (a) measured moduli and the fitted curve, (b) the relative error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.plot_style import colours, line_style, new_figure, styled
from gfmdlayer.fitting.measurement import MasterCurve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gfmdlayer.fitting.prony import Fit

MARKERS = "os"


def fit_figure(fitted: Fit) -> Figure:
    """Draw measured moduli with the fit, and below them the error, in one column of a journal."""
    from matplotlib.ticker import LogLocator

    curve = fitted.measurement
    is_master = isinstance(curve, MasterCurve)
    symbols = ["$G'$", "$G''$"] if is_master else ["$G$"]
    smooth = np.geomspace(curve.abscissa[0], curve.abscissa[-1], 500)
    lines = curve.predicted(fitted.material, smooth)
    with styled():
        figure = new_figure(1, 100.0)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        for i, (symbol, colour) in enumerate(zip(symbols, colours(3), strict=False)):
            style = {"color": colour, "marker": MARKERS[i], "ms": 3.2, "mfc": "none", "mew": 0.7, "ls": ""}
            above.plot(curve.abscissa, curve.moduli[i], label=f"{symbol}, measured", **style)
            above.plot(smooth, lines[i], color=colour, linestyle=line_style(i), label=f"{symbol}, fitted")
            below.plot(curve.abscissa, 100 * fitted.errors[i], **style)
        above.set(xscale="log", yscale="log", ylabel=", ".join(symbols))
        span = curve.moduli.max() / curve.moduli.min()
        if span < 100:  # fewer than two powers of ten to label
            above.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if span > 10 else range(1, 10)))
            above.yaxis.set_major_formatter("{x:g}")
            above.yaxis.set_minor_formatter("")
        above.set_title("(a)", loc="left")
        above.legend()
        below.axhline(0, color="black", linewidth=0.5)
        limit = 115 * max(fitted.largest, 1e-6)
        below.set(xlabel=r"$\omega$" if is_master else "$t$", ylabel="error (%)", ylim=(-limit, limit))
        below.set_title("(b)", loc="left")
    return figure
