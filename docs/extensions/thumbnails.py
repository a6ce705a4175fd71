"""Thumbnails of the gallery: one panel of a picture, one thick curve, no words, at their final size."""

from __future__ import annotations

import pickle
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib import pyplot as plt
from sphinx_gallery.scrapers import matplotlib_scraper

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from sphinx.application import Sphinx

# The panel of a picture and the curve in it; by default the first panel, and the last curve.
_CHOSEN = {
    "plot_adhesion": (0, -2),
    "plot_coated_sphere": (1, -1),
    "plot_electroadhesion": (1, 2),
    "plot_fit": (0, 1),
    "plot_rolling": (1, -1),
    "plot_rough": (1, -1),
    "plot_seal": (2, 0),
    "plot_tread": (1, -1),
}
_INCHES, _DOTS = (2.0, 1.4), 200
_OURS = "thumbnails"  # beside the folder that the gallery writes its own into


def scrape(block: Any, names: Any, settings: dict[str, Any], **options: Any) -> str:
    """Save the figures of a block, the first one as a thumbnail too."""
    if plt.get_fignums():
        figure = pickle.loads(pickle.dumps(plt.figure(plt.get_fignums()[0])))
        source = Path(names["src_file"])
        panel, curve = _CHOSEN.get(source.stem, (0, -1))
        for each in figure.axes[:panel] + figure.axes[panel + 1 :]:
            figure.delaxes(each)
        _simplify(figure.axes[0], curve)
        figure.set_layout_engine("none")
        figure.set_size_inches(_INCHES)
        folder = Path(names["target_file"]).parent / "images" / _OURS
        folder.mkdir(parents=True, exist_ok=True)
        figure.savefig(folder / f"sphx_glr_{source.stem}_thumb.png", dpi=_DOTS)
        plt.close(figure)
    return str(matplotlib_scraper(block, names, settings, **options))


def _simplify(axes: Axes, curve: int) -> None:
    axes.set(position=(0.02, 0.03, 0.96, 0.94), xlabel="", ylabel="", title="")
    for part in (axes.get_legend(), *axes.texts):
        if part is not None:
            part.remove()
    axes.tick_params(which="both", length=0, labelleft=False, labelbottom=False)
    axes.spines[:].set_visible(False)
    axes.set_anchor("C")
    curves = [line for line in axes.lines if len(line.get_xdata()) > 2]
    for line in curves:
        chosen = line is curves[curve]
        line.set(linewidth=3.5 if chosen else 1.2, alpha=1.0 if chosen else 0.45, linestyle="-")
        line.set_zorder(3 if chosen else 2)


def setup(app: Sphinx) -> dict[str, bool]:
    """Put the thumbnails in the place of the gallery's own, after it has run the scripts."""
    app.connect("builder-inited", _replace, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _replace(app: Sphinx) -> None:
    for path in (Path(app.srcdir) / "examples").rglob(f"images/{_OURS}/*.png"):
        shutil.copy(path, path.parents[1] / "thumb" / path.name)
