"""Movies, a frame for each snapshot: displacement and pressure; on a surface, gap and pressure."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D

from gfmdlayer.figures.labels import explained, finish, name_axes, quantity
from gfmdlayer.figures.plot_style import (
    SCREEN,
    Style,
    check_suffix,
    colours,
    legend_above,
    new_figure,
    styled,
)
from gfmdlayer.figures.snapshots import (
    PUNCH,
    Extremes,
    contact_entry,
    draw_bar,
    draw_map,
    heights,
    limits,
    map_values,
    mark_contact,
    snapshot_titles,
    touching,
)
from gfmdlayer.files.whole import unfinished
from gfmdlayer.results.names import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

MOVIES = (".mp4", ".gif")
SECONDS = 8.0  # duration of a movie, unless its frames are few or many
RATES = (2, 25)  # least and largest number of frames per second
FRAME_DPI = 100


def default_suffix() -> str:
    """Return .mp4 if ffmpeg is present, else .gif."""
    return ".mp4" if shutil.which("ffmpeg") else ".gif"


def write_movie(
    case: Dataset, path: Path, title: str = "", style: Style = SCREEN, fps: int | None = None
) -> None:
    """Write a movie of a case, .mp4 (needs ffmpeg) or .gif; one snapshot at a time is in memory."""
    from matplotlib.animation import FFMpegWriter, PillowWriter

    check_suffix(path, MOVIES)
    if path.suffix.lower() == ".mp4" and not shutil.which("ffmpeg"):
        raise ResultsError(f"{path}: needs ffmpeg, which is not found; use .gif")
    frames = case.sizes["snapshot"]
    rate = int(np.clip(frames / SECONDS, *RATES)) if fps is None else fps
    writer = PillowWriter(fps=rate) if path.suffix.lower() == ".gif" else FFMpegWriter(fps=rate)
    with styled(style):
        figure, show = animated(case, title, style)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with unfinished(path, path.suffix) as part, writer.saving(figure, str(part), FRAME_DPI):
                for i in range(frames):
                    show(i)
                    writer.grab_frame()
        except subprocess.CalledProcessError as error:
            last = str(error.stderr or "").strip().splitlines()[-1:]
            reason = ": ".join([f"exit status {error.returncode}", *last])
            raise ResultsError(
                f"{path}: ffmpeg could not write it ({reason}); .gif needs no ffmpeg"
            ) from error
        except OSError as error:
            raise ResultsError(f"{path}: cannot be written: {error.strerror or error}") from error


def animated(case: Dataset, title: str = "", style: Style = SCREEN) -> tuple[Figure, Callable[[int], None]]:
    """Return a figure of displacement and pressure, and a function that shows snapshot i in it.

    On a surface the gap, with the spots of contact, stands in the place of the displacement.
    """
    seen, first = Extremes.of([case]), "displacement"
    if "y" in case["pressure"].dims:
        first = "gap" if "gap" in case else first
        draw, (across, up) = _moving_surface, (np.ptp(ends) for ends in seen.view.values())
        height = 25.0 + 62.0 * min(up / across, 2.0)
    else:
        draw, height = _moving_line, 85.0
    figure = new_figure(2, height, style)
    panels = figure.subplots(1, 2)
    updates = [draw(axes, case, name, seen) for axes, name in zip(panels, (first, "pressure"), strict=True)]
    if "y" in case["pressure"].dims:
        panels[1].set_ylabel("")
    if "gap" in case:
        punch = [] if "y" in case["pressure"].dims else [Line2D([], [], label="punch", **PUNCH)]
        legend_above(figure, [*punch, contact_entry()])
    finish(figure, explained(case, [first, "pressure"]))
    times = snapshot_titles(case)

    def show(i: int) -> None:
        panels[0].set_title(f"{title}    {times[i]}".strip(), loc="left")
        for update in updates:
            update(i)

    show(0)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # nothing moves from frame to frame, and frames are drawn faster
    return figure, show


def _moving_line(axes: Axes, case: Dataset, name: str, seen: Extremes) -> Callable[[int], None]:
    """Draw a field of a line contact and, with the displacement, the punch."""
    along, up = (quantity(case[each], case.attrs) for each in ("x", name))
    x = case["x"].to_numpy() / along.scale
    (field,) = axes.plot(x, np.full(x.shape, np.nan), color=colours(1)[0])
    (punch,) = axes.plot(x, np.full(x.shape, np.nan), **PUNCH)
    touched = mark_contact(axes, x, x, np.zeros(x.shape, dtype=bool))
    ends = seen.pressures if name == "pressure" else heights(limits(case[name]))
    name_axes(axes, along, up)
    axes.set(xlim=np.divide(seen.view["x"], along.scale), ylim=np.divide(ends, up.scale))

    def update(i: int) -> None:
        one = case.isel(snapshot=i)
        field.set_ydata(one[name].to_numpy() / up.scale)
        if name == "displacement" and "gap" in case:
            surface, gap = one["displacement"].to_numpy() / up.scale, one["gap"].to_numpy()
            punch.set_ydata(surface + gap / up.scale)
            touched.set_ydata(np.where(touching(one), surface, np.nan))

    return update


def _moving_surface(axes: Axes, case: Dataset, name: str, seen: Extremes) -> Callable[[int], None]:
    """Draw a field of a surface in two dimensions as a map."""
    field = case[name]
    ends = (seen.least, seen.peak) if name == "pressure" else limits(field)
    mesh = draw_map(axes, case, field.isel(snapshot=0), seen.view, ends)
    name_axes(axes, quantity(case["x"], case.attrs), quantity(case["y"], case.attrs))
    draw_bar(axes, mesh, quantity(field, case.attrs))

    def update(i: int) -> None:
        mesh.set_data(map_values(case, field.isel(snapshot=i)))

    return update
