"""Pictures of results: curves, maps, snapshots and movies.

The public functions; each is imported when it is first used. They return figures of matplotlib and accept
the datasets of `gfmdlayer.run`, `open_results` and `open_case`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gfmdlayer.figures.curve_plots import curves_figure
    from gfmdlayer.figures.map_plots import map_figure
    from gfmdlayer.figures.plots import plot_results
    from gfmdlayer.figures.snapshots import snapshots_figure, waterfall_figure

__all__ = ["curves_figure", "map_figure", "plot_results", "snapshots_figure", "waterfall_figure"]

_HOME = {
    "curves_figure": "curve_plots",
    "map_figure": "map_plots",
    "plot_results": "plots",
    "snapshots_figure": "snapshots",
    "waterfall_figure": "snapshots",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'gfmdlayer.figures' has no attribute {name!r}")
    return getattr(import_module(f"gfmdlayer.figures.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
