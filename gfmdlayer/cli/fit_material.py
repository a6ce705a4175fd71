"""`gfmdlayer fit-material`: fit a law to a measured curve: omega, G' and G'', or t and G."""

from __future__ import annotations

import argparse
from pathlib import Path

from gfmdlayer.cli.terminal import COMPLETE, arguments, refuse

EXAMPLE = "gfmdlayer fit-material configs/polymer.csv --temperature 35 --reference 25 --wlf 17.4 51.6"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    text = """
    data DATA  file with two or three columns; the first must increase
    --law {prony,fractional_zener,power_law,kohlrausch,havriliak_negami} = prony  law to fit
      (default: a Prony series)
    --columns NAMES  names of columns, such as "f, E', tan delta"
    --poisson NU = 0.5  Poisson's ratio, for E (default: 0.5)
    --out PATH  YAML file, or folder for it (default: NAME.yaml here)
    --branches N  number of branches (default: the fewest that fit)
    --relaxed-modulus G0  relaxed modulus (default: fitted)
    --normalise  write moduli in units of G0
    --temperature T  shift the times to this temperature
    --reference T0  temperature of the data
    --wlf C1 C2  WLF constants at T0
    --force  overwrite files
    """
    arguments(parser, text)


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
