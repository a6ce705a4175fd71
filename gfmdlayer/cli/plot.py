"""`gfmdlayer plot`: draw contact area, mean pressure and friction against time, and the snapshots."""

from __future__ import annotations

import argparse

from gfmdlayer.cli.terminal import COMPLETE, refuse

KINDS = {
    "curves": "contact area, mean pressure and, of a moving punch, friction against time",
    "snapshots": "the surface at the snapshot times: profiles, or maps of pressure and gap with a cut",
    "waterfall": "pressure profiles through time",
    "map": "contact area and mean pressure over two swept keys",
}
# The kinds of figure that take an option; None, without --kind, is the curves and the snapshots.
KINDS_WITH: dict[str, set[str | None]] = {
    "log_time": {None, "curves"},
    "inset": {None, "curves"},
    "time": {"map"},
}

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
    parser.add_argument("--time", metavar="T", type=float, help="time of the map (default: the last)")


def plot(options: argparse.Namespace) -> int:
    """Draw the figures of results."""
    for name, kinds in KINDS_WITH.items():
        if getattr(options, name) not in (None, False, []) and options.kind not in kinds:
            allowed = " or ".join(f"--kind {kind}" for kind in kinds if kind)
            return refuse(f"--{name.replace('_', '-')}: has no effect on this figure; must be with {allowed}")
    from gfmdlayer.figures.plots import plot_results

    for picture in plot_results(
        options.path,
        options.out,
        kind=options.kind,
        case=options.case,
        style=options.style or ("screen" if options.kind == "movie" else "paper"),
        log_time=options.log_time,
        inset=options.inset,
        time=options.time,
    ):
        print(picture)
    return COMPLETE
