"""`gfmdlayer fit-material`: fit a law to a measured curve: omega, G' and G'', or t and G."""

from __future__ import annotations

import argparse
from pathlib import Path

from gfmdlayer.cli.terminal import COMPLETE, refuse

LAWS = ("prony", "fractional_zener", "power_law", "kohlrausch", "havriliak_negami")
EXAMPLE = "gfmdlayer fit-material configs/polymer.csv --temperature 35 --reference 25 --wlf 17.4 51.6"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "data", metavar="DATA", help="file with two or three columns; the first must increase"
    )
    parser.add_argument("--law", choices=LAWS, default="prony", help="law to fit (default: a Prony series)")
    parser.add_argument("--columns", metavar="NAMES", help='names of columns, such as "f, E\', tan delta"')
    parser.add_argument(
        "--poisson", metavar="NU", type=float, default=0.5, help="Poisson's ratio, for E (default: 0.5)"
    )
    parser.add_argument("--out", metavar="PATH", help="YAML file, or folder for it (default: NAME.yaml here)")
    parser.add_argument(
        "--branches", metavar="N", type=int, help="number of branches (default: the fewest that fit)"
    )
    parser.add_argument(
        "--relaxed-modulus", metavar="G0", type=float, help="relaxed modulus (default: fitted)"
    )
    parser.add_argument("--normalise", action="store_true", help="write moduli in units of G0")
    parser.add_argument("--temperature", metavar="T", type=float, help="shift the times to this temperature")
    parser.add_argument("--reference", metavar="T0", type=float, help="temperature of the data")
    parser.add_argument("--wlf", metavar=("C1", "C2"), nargs=2, type=float, help="WLF constants at T0")
    parser.add_argument("--force", action="store_true", help="overwrite files")


def fit_material(options: argparse.Namespace) -> int:
    """Fit a law to a measured curve."""
    from gfmdlayer.body.shifts import WLF
    from gfmdlayer.fitting import report
    from gfmdlayer.fitting.measurement import FitError

    given = [value for value in (options.temperature, options.reference, options.wlf) if value is not None]
    if len(given) not in (0, 3):
        return refuse("--temperature, --reference and --wlf: give all three or none")
    if not -1 < options.poisson <= 0.5:
        return refuse(f"--poisson: got {options.poisson:g}; must be a number > -1 and <= 0.5")
    try:
        summary = report.fit_material(
            Path(options.data),
            None if options.out is None else Path(options.out),
            law=options.law,
            poisson=options.poisson,
            names=options.columns,
            branches=options.branches,
            relaxed=options.relaxed_modulus,
            temperature=options.temperature,
            shift=WLF(**dict(zip(("C1", "C2"), options.wlf, strict=True)), reference=options.reference)
            if given
            else None,
            normalise=options.normalise,
            force=options.force,
        )
    except FitError as error:
        return refuse(str(error))
    print(summary)
    return COMPLETE
