"""`gfmdlayer plot`: draw the figure of a results folder."""

from __future__ import annotations

import argparse
from pathlib import Path

from gfmdlayer.cli.terminal import COMPLETE, Verbs, refuse


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    added = verbs.add(
        plot,
        "draw contact area and mean pressure against time, and the snapshots",
        "gfmdlayer plot results/figure2-quick --out figure2.png",
    )
    added.add_argument("directory", metavar="DIR", help="results folder")
    added.add_argument("--out", metavar="PNG", help="the figure (default: in DIR)")


def plot(options: argparse.Namespace) -> int:
    """Draw the figure of a results folder."""
    from gfmdlayer.results.plots import plot_results
    from gfmdlayer.results.schema import ResultsError

    try:
        print(plot_results(Path(options.directory), options.out))
    except ResultsError as error:
        return refuse(str(error))
    return COMPLETE
