"""`gfmdlayer plot`: draw columns of results against time, each other or swept keys, and the snapshots."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gfmdlayer.cli.terminal import COMPLETE, note_incomplete, refuse

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
    parser.add_argument("path", metavar="DIR", help="results folder, or the file of one case")
    parser.add_argument(
        "--out", metavar="FILE", help=".png, .pdf or .svg; a movie: .mp4 or .gif (default: with the results)"
    )
    kinds = parser.add_mutually_exclusive_group()
    described = "; ".join(f"{kind}: {meaning}" for kind, meaning in KINDS.items())
    kinds.add_argument("--kind", choices=tuple(KINDS), help=f"{described} (default: curves and snapshots)")
    kinds.add_argument(
        "--movie",
        dest="kind",
        action="store_const",
        const="movie",
        help="displacement and pressure, one frame for each snapshot: .mp4 with ffmpeg, else .gif",
    )
    parser.add_argument(
        "--style",
        choices=("paper", "screen"),
        help="paper: for a journal (default); screen: for a talk (default of movies)",
    )
    parser.add_argument("--case", metavar="N", type=int, help="draw the snapshots of this case")
    parser.add_argument(
        "--log",
        metavar="AXES",
        type=_axes,
        help="logarithmic axes of the curves: x, y, x,y or none (default: time, where the durations of the "
        "cases differ more than thirtyfold)",
    )
    parser.add_argument("--log-time", action="store_true", help="--log x of curves over time")
    parser.add_argument(
        "--times",
        metavar="T",
        type=float,
        nargs="+",
        default=[],
        help="draw the snapshots of these times, all of them (default: of very many, some)",
    )
    parser.add_argument(
        "--inset",
        metavar="T",
        type=float,
        nargs="+",
        default=[],
        help="draw punch and surface at these snapshot times in an inset of the curves",
    )
    parser.add_argument(
        "--select",
        metavar="KEY=VALUE",
        nargs="+",
        action="extend",
        default=[],
        help="draw only the cases with this (or the nearest) value of a swept key, thickness=0.1, or with "
        "values in a range, thickness=0.1:0.5",
    )
    parser.add_argument(
        "--x", metavar="NAME", default="", help="time (default), a column, or a swept key; map: a swept key"
    )
    parser.add_argument(
        "--y",
        metavar="NAME",
        nargs="+",
        default=[],
        help="columns, one panel for each (default: contact_area_interpolated and mean_pressure, or depth "
        "under a load); loop: one column; map: a swept key",
    )
    parser.add_argument(
        "--z", metavar="NAME", nargs="+", default=[], help="columns of the map; inside: the field"
    )
    parser.add_argument(
        "--time",
        metavar="T",
        help="time of a map, or of curves over a swept key: a number, end (default), or the max or min over "
        "time",
    )
    parser.add_argument("--fps", metavar="N", type=int, help="frames per second of a movie")


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

    for picture in plot_results(
        options.path,
        options.out,
        kind=options.kind,
        case=options.case,
        style=options.style or ("screen" if options.kind == "movie" else "paper"),
        times=options.times,
        log=options.log,
        log_time=options.log_time,
        inset=options.inset,
        time=time,
        select=selected,
        x=options.x,
        y=options.y,
        z=options.z,
        fps=options.fps,
    ):
        print(picture)
    note_incomplete(Path(options.path))
    return COMPLETE
