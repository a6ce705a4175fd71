"""`gfmdlayer fit-indentation`: fit moduli, times and thicknesses to measured force curves of an indenter."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfmdlayer.cli.terminal import COMPLETE, FAILED, STATUSES, add_out, conclude, input_problems, refuse

if TYPE_CHECKING:
    from gfmdlayer.fitting.indentation.estimates import FitOptions

EXAMPLE = (
    "gfmdlayer fit-indentation configs/gel.csv --model configs/gel.model.yml --contact detect\n"
    "  gfmdlayer fit-indentation map.h5 --model gel.model.yml --each --jobs 4 --out results/map\n\n"
    f"{STATUSES}"
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "data", metavar="DATA", nargs="+", help="files of curves (text, HDF5, AFM formats), or folders"
    )
    parser.add_argument(
        "--model",
        metavar="YAML",
        nargs="+",
        required=True,
        help="file of body and indenter, with the keys of a configuration; several files are compared",
    )
    parser.add_argument(
        "--free",
        metavar="KEY",
        nargs="+",
        help="free parameters, such as layer.material.G0, contact_point, drift, force_offset or tilt; with "
        "bounds KEY=LOW:HIGH (default: the key `free` of the model)",
    )
    parser.add_argument(
        "--units",
        metavar=("TIME", "DEPTH", "FORCE"),
        nargs=3,
        help="units of columns without a unit, such as s nm nN; a model without units is then in SI",
    )
    parser.add_argument(
        "--contact",
        choices=("given", "detect"),
        default="given",
        help="detect: also fit the contact point and the offset of the force (default: given)",
    )
    parser.add_argument(
        "--prescribed",
        choices=("depth", "force", "base"),
        help="what the instrument prescribes, for curves whose files do not name it (default: guessed)",
    )
    parser.add_argument(
        "--stiffness",
        metavar="K[:ERROR]",
        help="stiffness of the cantilever, in the model's units, and its relative error, as in 0.05:0.1; "
        "with an error it is fitted too",
    )
    parser.add_argument(
        "--adhesion",
        choices=("none", "jkr", "dmt", "choose"),
        help="adhesion of an elastic body: fit the work of JKR or the force of DMT, or choose by BIC "
        "(default: the section `adhesion` of the model)",
    )
    parser.add_argument(
        "--segments",
        metavar="NAME",
        nargs="+",
        default=(),
        help="segments whose rows count, such as approach hold (default: all)",
    )
    parser.add_argument(
        "--loss",
        choices=("linear", "soft_l1", "huber", "cauchy"),
        default="linear",
        help="loss of the residuals; soft_l1, huber and cauchy give outliers less weight (default: linear)",
    )
    parser.add_argument(
        "--profile", action="store_true", help="also find profile intervals; takes three to ten times as long"
    )
    parser.add_argument(
        "--each",
        action="store_true",
        help="fit each curve by itself into a results folder, with maps; also under mpirun or srun",
    )
    add_out(parser)
    parser.add_argument("--restart", action="store_true", help="with --each: remove earlier results in DIR")
    parser.add_argument("--force", action="store_true", help="overwrite files")


def fit_indentation(options: argparse.Namespace) -> int:
    """Fit moduli, times and thicknesses to measured force curves."""
    from gfmdlayer.fitting.indentation.estimates import FitOptions
    from gfmdlayer.fitting.measurement import FitError

    try:
        spring = _spring(options.stiffness)
        if isinstance(spring, str):
            return refuse(spring)
        chosen = FitOptions(
            options.loss,
            options.profile,
            options.contact,
            tuple(options.segments),
            options.prescribed,
            *spring,
            options.adhesion,
        )
        free = _free(options.free)
        if isinstance(free, str):
            return refuse(free)
        if options.each:
            if len(options.model) > 1:
                return refuse("--each takes one model; leave --each out to compare several")
            return _fit_each(options, chosen, free)
        if options.restart or options.jobs > 1:
            return refuse("--restart and --jobs: only with --each")
        return _fit_together(options, chosen, free)
    except FitError as error:
        return refuse(*str(error).splitlines())


def _spring(text: str | None) -> tuple[float | None, float | None] | str:
    """Read K or K:ERROR; return an error message as a string."""
    if text is None:
        return None, None
    value, colon, error = text.partition(":")
    try:
        return float(value), float(error) if colon else None
    except ValueError:
        return f"--stiffness {text}: must be K, or K:ERROR, with numbers"


def _free(keys: list[str] | None) -> dict[str, list[float] | None] | str | None:
    """Read KEY or KEY=LOW:HIGH; return an error message as a string."""
    if keys is None:
        return None
    found: dict[str, list[float] | None] = {}
    for text in keys:
        key, equals, bounds = text.partition("=")
        try:
            low, high = map(float, bounds.split(":")) if equals else (0.0, 0.0)
        except ValueError:
            return f"--free {text}: must be KEY, or KEY=LOW:HIGH with two numbers"
        found[key] = [low, high] if equals else None
    return found


def _fit_together(options: argparse.Namespace, chosen: FitOptions, free: Any) -> int:
    from gfmdlayer.fitting.indentation import report
    from gfmdlayer.fitting.indentation.curve import in_si
    from gfmdlayer.fitting.indentation.curve_files import entries, read_curve
    from gfmdlayer.fitting.indentation.fit import fit_curves
    from gfmdlayer.fitting.indentation.problem import Model
    from gfmdlayer.fitting.indentation.starts import read_model

    out = Path(options.out or f"{Path(options.data[0]).stem}-fit")
    report.targets(out, options.force)
    models = {str(path): read_model(path, free) for path in options.model}
    checked = {path: (Model(data), keys) for path, (data, keys) in models.items()}
    found = entries([Path(each) for each in options.data])
    fits = {}
    for path, (model, keys) in checked.items():
        curves = [read_curve(entry, options.units, in_si(model.config.units), chosen) for entry in found]
        fits[path] = fit_curves(curves, model, keys, chosen)
    best = min(fits, key=lambda path: fits[path].bic)
    if len(fits) > 1:
        print("\n".join(report.comparison(fits)), end=f"\n\n{best}:\n")
    print("\n".join(report.write_report(fits[best], out, options.force)))
    return COMPLETE


def _fit_each(options: argparse.Namespace, chosen: FitOptions, free: Any) -> int:
    from gfmdlayer.execution import interrupts, workers

    interrupts.listen()
    workers.threads_each(os.environ)
    with workers.assemble(options.jobs, _prepare) as pool:
        return COMPLETE if pool is None else _run(options, chosen, free, pool)


def _prepare() -> None:
    """Import the modules of a fit on the other MPI ranks."""
    import gfmdlayer.fitting.force_map  # noqa: F401


def _run(options: argparse.Namespace, chosen: FitOptions, free: Any, pool: Any) -> int:
    from gfmdlayer.execution.progress import make_display
    from gfmdlayer.fitting.force_map import ForceMap
    from gfmdlayer.fitting.indentation.starts import read_model
    from gfmdlayer.results.schema import ResultsError

    paths = [Path(each) for each in options.data]
    directory = Path(options.out or Path("results") / f"{paths[0].stem}-fits")
    try:
        data, keys = read_model(options.model[0], free)
        curves = ForceMap(paths, directory, data, keys, chosen, options.units)
        summary = curves.run(pool, options.restart, lambda: make_display(sys.stderr))
    except ResultsError as error:
        print(f"gfmdlayer: {error}", file=sys.stderr)
        return FAILED
    except Exception as error:  # an exception that leaves the pool aborts the ranks
        if not (problems := input_problems(error)):
            raise
        return refuse(*problems)
    return conclude(summary, directory, "curve")
