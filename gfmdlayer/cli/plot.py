"""`gfmdlayer plot`: draw columns of results against time, each other or swept keys, and the snapshots."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gfmdlayer.cli.terminal import COMPLETE, arguments, note_incomplete, refuse

KINDS = {
    "curves": "contact area and mean pressure over time (depth if the load is prescribed; also friction for "
    "a moving punch), or the columns --y over --x",
    "loop": "force over depth for the whole run, with the area of the loop; --y tangential_force or friction "
    "over the displacement along the surface",
    "snapshots": "the surface at the snapshot times: profiles, or maps of pressure and gap with a cut",
    "stick": "where the surfaces stick and slip at the snapshot times, with the shear traction",
    "inside": "sections with contours of a stress below the surface, --z; of a surface also the stresses at "
    "the interfaces",
    "waterfall": "pressure profiles through time",
    "body": "the layers and their moduli; DIR may also be a configuration file",
    "map": "contact area and mean pressure, or the columns of --z, over two swept keys",
}
# The kinds of figure that take an option; None stands for no --kind: the curves and the snapshots.
KINDS_WITH: dict[str, tuple[str | None, ...]] = {
    "log": (None, "curves"),
    "log_time": (None, "curves"),
    "times": (None, "snapshots", "stick", "inside", "waterfall", "movie"),
    "inset": (None, "curves"),
    "x": (None, "curves", "map"),
    "y": (None, "curves", "loop", "map"),
    "z": ("map", "inside"),
    "time": ("map", "curves", None),
    "fps": ("movie",),
}

MOST_FRAMES = 100  # per second, the limit of a GIF

EXAMPLE = "gfmdlayer plot results/figure2-quick --out figure2.pdf --log x"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    text = """
    path DIR  results folder, or the file of one case
    --out FILE  .png, .pdf or .svg; a movie: .mp4 or .gif (default: with the results)
    """
    arguments(parser, text)
    kinds = parser.add_mutually_exclusive_group()
    described = "; ".join(f"{kind}: {meaning}" for kind, meaning in KINDS.items())
    kinds.add_argument("--kind", choices=tuple(KINDS), help=f"{described} (default: curves and snapshots)")
    meaning = "displacement and pressure, one frame for each snapshot: .mp4 with ffmpeg, else .gif"
    kinds.add_argument("--movie", dest="kind", action="store_const", const="movie", help=meaning)
    text = """
    --style {paper,screen}  paper: for a journal (default); screen: for a talk (default of movies)
    --case N  draw the snapshots of this case
    --log AXES  logarithmic axes of the curves: x, y, x,y or none (default: time, where the durations of the
      cases differ more than thirtyfold)
    --log-time  --log x of curves over time
    --times T ...  draw the snapshots of these times, all of them (default: of very many, some)
    --inset T ...  draw punch and surface at these snapshot times in an inset of the curves
    --select KEY=VALUE ...  draw only the cases with this (or the nearest) value of a swept key,
      thickness=0.1, or with values in a range, thickness=0.1:0.5
    --x NAME  time (default), a column, or a swept key; map: a swept key
    --y NAME ...  columns, one panel for each (default: contact_area_interpolated and mean_pressure, or
      depth under a load); loop: one column; map: a swept key
    --z NAME ...  columns of the map; inside: the field
    """
    arguments(parser, text, AXES=_axes)
    text = """
    --time T  time of a map, or of curves over a swept key: a number, end (default), or the max or min over
      time
    --fps N  frames per second of a movie
    """
    arguments(parser, text, T=str)


def _axes(text: str) -> tuple[str, ...]:
    """Return the names of axes; an error of the parser for other words."""
    names = tuple(text.split(",")) if text != "none" else ()
    if not set(names) <= {"x", "y"}:
        raise argparse.ArgumentTypeError(f"got {text!r}; must be x, y, x,y or none")
    return names


def _selected(texts: list[str]) -> dict[str, str]:
    """Return the selected values by key; ValueError for another form."""
    selected: dict[str, str] = {}
    for text in texts:
        key, _, value = (part.strip() for part in text.partition("="))
        if not (key and value):
            raise ValueError(f"--select: got {text!r}; must be KEY=VALUE, such as thickness=0.1")
        if key in selected:
            raise ValueError(f"--select: {key} is given twice; give it once, or as a range: 0.1:0.5")
        selected[key] = value
    return selected


def _time(text: str | None) -> Any:
    """Return the time of a map; ValueError for another word."""
    if text in ("end", "max", "min", None):
        return text
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"--time: got {text!r}; must be a number, end, max or min") from None


def plot(options: argparse.Namespace) -> int:
    """Draw the figures of results."""
    for name, kinds in KINDS_WITH.items():
        if getattr(options, name) not in (None, False, (), [], "") and options.kind not in kinds:
            allowed = " or ".join(f"--kind {kind}" for kind in kinds if kind)
            return refuse(f"--{name.replace('_', '-')}: only with {allowed}")
    try:
        selected, time = _selected(options.select), _time(options.time)
    except ValueError as error:
        return refuse(str(error))
    if options.fps is not None and not 1 <= options.fps <= MOST_FRAMES:
        return refuse(f"--fps: got {options.fps}; must be a whole number from 1 to {MOST_FRAMES}")
    from gfmdlayer.figures.plots import plot_results

    given = {name: getattr(options, name) for name in ("kind", "case", "times", "log", "log_time", "inset")}
    given |= {name: getattr(options, name) for name in ("y", "z", "fps")}
    style = options.style or ("screen" if options.kind == "movie" else "paper")
    more = {"x": options.x or "", "style": style, "time": time, "select": selected}
    for picture in plot_results(options.path, options.out, **given, **more):
        print(picture)
    note_incomplete(Path(options.path))
    return COMPLETE
