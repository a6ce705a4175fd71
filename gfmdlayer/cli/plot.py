"""`gfmdlayer plot`: draw columns of results against time, each other or swept keys, and the snapshots."""

from __future__ import annotations

import argparse
from typing import Any

from gfmdlayer.cli.terminal import COMPLETE, refuse

KINDS = {
    "curves": "contact area and mean pressure (depth, where the load is prescribed; of a moving punch also "
    "friction) against time, or the columns of --y against that of --x",
    "loop": "force against depth over the whole run, with the area of the loop",
    "snapshots": "the surface at the snapshot times: profiles, or maps of pressure and gap with a cut",
    "waterfall": "pressure profiles through time",
    "body": "the layers and their moduli; also of a configuration, DIR then being its file",
    "map": "contact area and mean pressure, or the columns of --z, over two swept keys",
}
# The kinds of figure that take an option; None, without --kind, is the curves and the snapshots.
KINDS_WITH: dict[str, tuple[str | None, ...]] = {
    "log_time": (None, "curves"),
    "inset": (None, "curves"),
    "x": (None, "curves", "map"),
    "y": (None, "curves", "loop", "map"),
    "z": ("map",),
    "time": ("map", "curves", None),
    "fps": ("movie",),
}

MOST_FRAMES = 100  # in a second; more than a GIF can have

EXAMPLE = "gfmdlayer plot results/figure2-quick --out figure2.pdf --log-time"


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
        help="displacement and pressure, a frame a snapshot: .mp4 where ffmpeg is present, else .gif",
    )
    parser.add_argument(
        "--style",
        choices=("paper", "screen"),
        help="for a journal (default) or for a talk (default of movies)",
    )
    parser.add_argument("--case", metavar="N", type=int, help="the case whose snapshots are drawn")
    parser.add_argument("--log-time", action="store_true", help="logarithmic time axis of the curves")
    parser.add_argument(
        "--inset",
        metavar="T",
        type=float,
        nargs="+",
        default=[],
        help="inset of punch and surface in the curves, at these snapshot times",
    )
    parser.add_argument(
        "--select",
        metavar="KEY=VALUE",
        nargs="+",
        action="extend",
        default=[],
        help="draw the cases with this value of a swept key, or the nearest: thickness=0.1; or with values "
        "in a range: thickness=0.1:0.5",
    )
    parser.add_argument(
        "--x",
        metavar="NAME",
        default="",
        help="time (default), a column, or a swept key; of a map: a swept key",
    )
    parser.add_argument(
        "--y",
        metavar="NAME",
        nargs="+",
        default=[],
        help="columns, in a panel each; of a loop: one; of a map: a swept key",
    )
    parser.add_argument("--z", metavar="NAME", nargs="+", default=[], help="columns of the map")
    parser.add_argument(
        "--time",
        metavar="T",
        help="time of a map, or of curves against a swept key: a number, end (default), or for the extremes "
        "over time max or min",
    )
    parser.add_argument("--fps", metavar="N", type=int, help="frames of a movie in a second")


def _selected(texts: list[str]) -> dict[str, str]:
    """Return what is selected, by key; ValueError where that is not said."""
    selected: dict[str, str] = {}
    for text in texts:
        key, _, value = (part.strip() for part in text.partition("="))
        if not (key and value):
            raise ValueError(f"--select: got {text!r}; must be KEY=VALUE, such as thickness=0.1")
        if key in selected:
            raise ValueError(f"--select: {key} is given twice; must be given once, or with a range: 0.1:0.5")
        selected[key] = value
    return selected


def _time(text: str | None) -> Any:
    """Return the time of a map; ValueError where it is none."""
    if text in ("end", "max", "min", None):
        return text
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"--time: got {text!r}; must be a number, end, max or min") from None


def plot(options: argparse.Namespace) -> int:
    """Draw the figures of results."""
    for name, kinds in KINDS_WITH.items():
        if getattr(options, name) not in (None, False, [], "") and options.kind not in kinds:
            allowed = " or ".join(f"--kind {kind}" for kind in kinds if kind)
            return refuse(f"--{name.replace('_', '-')}: has no effect on this figure; must be with {allowed}")
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
    return COMPLETE
