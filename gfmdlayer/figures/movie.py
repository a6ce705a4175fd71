"""Movies of a case, a frame for each snapshot: displacement and pressure."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.plot_style import SCREEN, Style, colours, new_figure, styled, time_axis
from gfmdlayer.figures.snapshot_plots import PRESSURE_COLOURS, draw_map, heights
from gfmdlayer.figures.snapshot_selection import extent, limits
from gfmdlayer.files.whole import unfinished
from gfmdlayer.results.schema import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

SUFFIXES = (".mp4", ".gif")
SECONDS = 8.0  # that a movie lasts, unless its frames are few or many
RATES = (2, 25)  # frames a second, at least and at most
DPI = 100


def default_suffix() -> str:
    """Return .mp4 where ffmpeg is present, else .gif."""
    return ".mp4" if shutil.which("ffmpeg") else ".gif"


def check_movie(path: Path) -> None:
    """Raise ResultsError unless the movie can be written here in the format that the suffix names."""
    if path.suffix.lower() not in SUFFIXES:
        raise ResultsError(
            f"{path}: no movie can be written as {path.suffix or 'no suffix'!r}; use {', '.join(SUFFIXES)}"
        )
    if path.suffix.lower() == ".mp4" and not shutil.which("ffmpeg"):
        raise ResultsError(f"{path}: needs ffmpeg, which is not found; use .gif")


def write_movie(case: Dataset, path: Path, title: str = "", style: Style = SCREEN) -> None:
    """Write a movie of a case.

    Parameters
    ----------
    case
        A case with snapshots, as the reader opens it; one of them is in memory at a time.
    path
        The movie; .mp4 needs ffmpeg.
    title
        What tells the case from others.
    style
        Letters and lines.

    Raises
    ------
    ResultsError
        If the movie cannot be written.
    """
    from matplotlib.animation import FFMpegWriter, PillowWriter

    check_movie(path)
    frames = case.sizes["snapshot"]
    rate = int(np.clip(frames / SECONDS, *RATES))
    writer = PillowWriter(fps=rate) if path.suffix.lower() == ".gif" else FFMpegWriter(fps=rate)
    with styled(style):
        figure, show = animated(case, title, style)
        try:
            with unfinished(path, path.suffix) as part, writer.saving(figure, str(part), DPI):
                for place in range(frames):
                    show(place)
                    writer.grab_frame()
        except subprocess.CalledProcessError as error:
            last = str(error.stderr or "").strip().splitlines()[-1:]
            why = ": ".join([f"it ended with {error.returncode}", *last])
            raise ResultsError(f"{path}: ffmpeg could not write it ({why}); .gif does without") from error
        except OSError as error:
            raise ResultsError(f"{path}: cannot be written: {error.strerror or error}") from error


def animated(case: Dataset, title: str = "", style: Style = SCREEN) -> tuple[Figure, Callable[[int], None]]:
    """Return a figure of displacement and pressure, and a function that brings it to a snapshot."""
    if "y" in case["pressure"].dims:
        draw, (across, up) = _surface, (np.ptp(extent([case], name)) for name in "xy")
        height = 25.0 + 62.0 * min(up / across, 2.0)
    else:
        draw, height = _line, 85.0
    figure = new_figure(2, height, style)
    panels = figure.subplots(1, 2)
    updates = [
        draw(axes, case, name, symbol)
        for axes, (name, symbol) in zip(
            panels, {"displacement": "$u$", "pressure": "$p$"}.items(), strict=True
        )
    ]
    label, tau = time_axis(case)
    times = case["snapshot"].to_numpy() / tau
    heading = figure.suptitle("")

    def show(place: int) -> None:
        heading.set_text(f"{title}    {label} = {times[place]:.4g}".strip())
        for update in updates:
            update(place)

    show(0)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # nothing moves from frame to frame, and frames come faster
    return figure, show


def _line(axes: Axes, case: Dataset, name: str, symbol: str) -> Callable[[int], None]:
    """Draw a line contact: the field and, with the displacement, the punch."""
    x, (low, high) = case["x"].to_numpy(), limits(case[name])
    (field,) = axes.plot(x, np.full(x.shape, np.nan), color=colours(1)[0])
    (punch,) = axes.plot(x, np.full(x.shape, np.nan), color="0.4", linestyle=(0, (4, 2)))
    span = heights(np.array([low, high])) if name == "displacement" else (0.0, 1.05 * high or 1.0)
    axes.set(xlabel="$x$", ylabel=symbol, xlim=extent([case], "x"), ylim=span)

    def update(place: int) -> None:
        one = case.isel(snapshot=place)
        field.set_ydata(one[name].to_numpy())
        if name == "displacement" and "gap" in case:
            punch.set_ydata(one["displacement"].to_numpy() + one["gap"].to_numpy())

    return update


def _surface(axes: Axes, case: Dataset, name: str, symbol: str) -> Callable[[int], None]:
    """Draw a surface in two dimensions as a map."""
    low, high = limits(case[name])
    window = {axis: extent([case], axis) for axis in "xy"}
    low = 0.0 if name == "pressure" else low
    cmap = PRESSURE_COLOURS if name == "pressure" else "viridis"
    mesh = draw_map(axes, case[name].isel(snapshot=0), window, vmin=low, vmax=high, cmap=cmap)
    axes.set(xlabel="$x$", ylabel="$y$")
    axes.figure.colorbar(mesh, ax=axes, label=symbol, shrink=0.85)

    def update(place: int) -> None:
        mesh.set_data(case[name].isel(snapshot=place).transpose("y", "x").to_numpy())

    return update
