"""`fit-material` and `fit-indentation`: fits to measured curves."""

from __future__ import annotations

import argparse
import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfmdlayer.cli.terminal import (
    COMPLETE,
    FAILED,
    STATUSES,
    arguments,
    conclude,
    input_problems,
    refuse,
    verb,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gfmdlayer.files.tables import Answers
    from gfmdlayer.fitting.result import FitOptions

_READING = """
--decimal MARK  decimal mark of the file, . or , (default: found)
--columns NAMES  names in place of the headings, such as "f [Hz], E', -, tan delta"; - is not read
--table N  number of the table in a file with several
"""

_FIT_MATERIAL = """
data DATA  table with headings: omega or f with moduli or compliances, or t with G(t) or J(t)
--modulus {G,E}  moduli and compliances that do not say it: G in shear, E in tension
--units NAME=UNIT ...  units of columns without a unit, such as frequency=Hz
--law {prony,fractional_zener,power_law,kohlrausch,havriliak_negami} = prony  law to fit
  (default: a Prony series)
--poisson NU  Poisson's ratio, for moduli and compliances in tension (default: 0.5)
--out PATH  YAML file, or folder for NAME.yaml; the figure lies beside it (default: here)
--branches N  number of branches (default: the fewest that fit)
--relaxed-modulus G0  relaxed modulus (default: fitted)
--normalise  write moduli in units of G0
--temperature T  shift the times to this temperature
--reference T0  temperature of the data
--wlf C1 C2  WLF constants at T0
--force  overwrite files
"""


@verb(
    _FIT_MATERIAL + _READING.lstrip(),
    "gfmdlayer fit-material configs/polymer.csv --temperature 35 --reference 25 --wlf 17.4 51.6",
)
def fit_material(options: argparse.Namespace) -> int:
    """Fit a law to a measured curve: omega, G' and G'', or t and G."""
    from gfmdlayer.body.shifts import WLF
    from gfmdlayer.fitting import material
    from gfmdlayer.fitting.measurement import FitError

    temperatures = [
        value for value in (options.temperature, options.reference, options.wlf) if value is not None
    ]
    if len(temperatures) not in (0, 3):
        return refuse("--temperature, --reference and --wlf: give all three or none")
    if options.poisson is not None and not -1 < options.poisson <= 0.5:
        return refuse(f"--poisson: got {options.poisson:g}; must be a number > -1 and <= 0.5")
    try:
        summary = material.fit_material(
            Path(options.data),
            options.out,
            law=options.law,
            poisson=options.poisson,
            answers=_answers(options, _units(options.units), options.modulus),
            branches=options.branches,
            relaxed=options.relaxed_modulus,
            temperature=options.temperature,
            shift=WLF(**dict(zip(("C1", "C2"), options.wlf, strict=True)), reference=options.reference)
            if temperatures
            else None,
            normalise=options.normalise,
            force=options.force,
        )
    except FitError as error:
        return refuse(str(error))
    print(summary)
    return COMPLETE


_OUT_OF_INDENTATION = """
--out PATH  YAML file, or folder for NAME-fit.yaml; the other files lie beside it (default: here); of curves
  that are fitted one by one the results folder (default: results/NAME-fits)
--jobs N = 1  processes (default: 1)
"""


def _answers(
    options: argparse.Namespace, units: Sequence[tuple[str, str]], modulus: str | None = None
) -> Answers:
    """Return what the command line says about a table."""
    from gfmdlayer.files.tables import Answers
    from gfmdlayer.fitting.measurement import FitError

    if options.decimal not in {None, ".", ","}:
        raise FitError(f"--decimal {options.decimal}: must be . or ,")
    names = tuple(name.strip() for name in (options.columns or "").split(",")) if options.columns else ()
    return Answers(options.decimal, tuple(units), names, modulus, options.table, key="")


def _units(words: Sequence[str], order: Sequence[str] = ()) -> list[tuple[str, str]]:
    """Read NAME=UNIT, or a unit for each of some columns in their order."""
    from gfmdlayer.files.units import unit_of
    from gfmdlayer.fitting.measurement import FitError

    if order and words and not any("=" in word for word in words):
        if len(words) != len(order):
            raise FitError(
                f"--units: got {len(words)} words; must be units of {', '.join(order)}, or NAME=UNIT"
            )
        words = [f"{name}={word}" for name, word in zip(order, words, strict=True)]
    pairs = [(name, unit) for name, _, unit in (word.partition("=") for word in words)]
    for name, unit in pairs:
        if unit_of(unit) is None:
            raise FitError(f"--units {name}={unit}: must be NAME=UNIT with a unit, such as time=ms")
    return pairs


_EXAMPLES_OF_INDENTATION = (
    "gfmdlayer fit-indentation configs/gel.csv --model configs/gel.model.yml --contact detect\n"
    "  gfmdlayer fit-indentation map.h5 --model gel.model.yml --jobs 4 --out results/map\n\n"
    f"{STATUSES}"
)


def _options_of_indentation(parser: argparse.ArgumentParser) -> None:
    arguments(parser, "data DATA ...  files of curves (text, HDF5, AFM formats), or folders")
    meaning = "file of body and indenter, with the keys of a configuration; several files are compared"
    parser.add_argument("--model", metavar="YAML", nargs="+", required=True, help=meaning)
    text = """
    --free KEY ...  free parameters, such as layer.material.G0, contact_point, drift, force_offset or tilt;
      with bounds KEY=LOW:HIGH (default: the key `free` of the model)
    --units UNIT ...  units of columns without a unit: of time, depth and force, such as s nm nN, or by name,
      such as force=nN; a model without units is then in SI
    --contact {given,detect,deviation,gradient,constant_line,constant_polynomial,line_polynomial} = given  how
      the contact point is found; detect: also fit it and the offset of the force; others: depths count from
      the point that this estimator finds (default: given, the depths count from it)
    --baseline {none,offset,tilt} = none  subtract the mean force before contact, or its straight line, before
      the fit (default: none)
    --weight LENGTH  weigh residuals by the distance from the contact point over this length, up to 1
    --range LOW:HIGH  only rows of these depths below the contact point
    --sensitivity S  deflection of the cantilever per volt, in the model's units, if the file lacks it
    --sampling RATE  rows in a unit of time, for a curve without time; not needed where nothing relaxes
    --prescribed {depth,force,base}  quantity that the instrument prescribes, if the files do not name it
      (default: guessed)
    --stiffness K[:ERROR]  stiffness of the cantilever, in the model's units, and its relative error, as in
      0.05:0.1; with an error it is fitted too
    --adhesion {none,jkr,dmt,choose}  fit the work of JKR or, of an elastic body, the force of DMT, or
      choose by BIC (default: the section `adhesion` of the model)
    --segments NAME ...  segments whose rows count, such as approach hold (default: all)
    --loss {linear,soft_l1,huber,cauchy} = linear  loss of the residuals; soft_l1, huber and cauchy give
      outliers less weight (default: linear)
    --profile  also find profile intervals; takes three to ten times as long
    --each  fit each curve by itself into a results folder, with maps; also under mpirun or srun (default: for
      several curves at different places)
    --joint  fit one model to all curves, also to those at different places
    """
    arguments(parser, text, S=float, RATE=float)
    arguments(parser, _READING)
    arguments(parser, _OUT_OF_INDENTATION)
    arguments(
        parser, "--restart  of curves one by one: remove earlier results in DIR\n--force  overwrite files"
    )


@verb(_options_of_indentation, _EXAMPLES_OF_INDENTATION)
def fit_indentation(options: argparse.Namespace) -> int:
    """Fit moduli, times and thicknesses to measured force curves of an indenter."""
    from gfmdlayer.fitting.curve_files import is_map, sources
    from gfmdlayer.fitting.measurement import FitError
    from gfmdlayer.fitting.result import FitOptions
    from gfmdlayer.study import interrupts, workers

    try:
        first = options.loss, options.profile, options.contact, tuple(options.segments), options.prescribed
        spring = _spring(options.stiffness)
        chosen = FitOptions(
            *first,
            *spring,
            options.adhesion,
            options.sensitivity,
            options.sampling,
            options.baseline,
            options.weight,
            _between(options.range),
        )
        answers = _answers(options, _units(options.units, ("time", "depth", "force")))
        free = _free(options.free)
        if options.each and options.joint:
            return refuse("--each and --joint exclude each other")
        if options.each or (not options.joint and is_map(sources(map(Path, options.data)))):
            if len(options.model) > 1:
                return refuse("curves are fitted one by one with one model; --joint compares several")
            interrupts.listen()
            workers.threads_each(os.environ)
            with workers.assemble(options.jobs, _prepare) as pool:
                return COMPLETE if pool is None else _run(options, chosen, free, answers, pool)
        if options.restart or options.jobs > 1:
            return refuse("--restart and --jobs: only of curves that are fitted one by one (--each)")
        return _fit_together(options, chosen, free, answers)
    except FitError as error:
        return refuse(*str(error).splitlines())


def _spring(text: str | None) -> tuple[float | None, float | None]:
    """Read K or K:ERROR."""
    from gfmdlayer.fitting.measurement import FitError

    if text is None:
        return None, None
    value, colon, error = text.partition(":")
    try:
        return float(value), float(error) if colon else None
    except ValueError:
        raise FitError(f"--stiffness {text}: must be K, or K:ERROR, with numbers") from None


def _between(text: str | None) -> tuple[float, float] | None:
    """Read LOW:HIGH."""
    from gfmdlayer.fitting.measurement import FitError

    if text is None:
        return None
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        raise FitError(f"--range {text}: must be LOW:HIGH with two numbers") from None
    return low, high


def _free(keys: list[str]) -> dict[str, list[float] | None] | None:
    """Read KEY or KEY=LOW:HIGH; None without any."""
    from gfmdlayer.fitting.measurement import FitError

    bounds_of: dict[str, list[float] | None] = {}
    for text in keys:
        key, equals, bounds = text.partition("=")
        try:
            low, high = map(float, bounds.split(":")) if equals else (0.0, 0.0)
        except ValueError:
            raise FitError(f"--free {text}: must be KEY, or KEY=LOW:HIGH with two numbers") from None
        bounds_of[key] = [low, high] if equals else None
    return bounds_of or None


def _fit_together(options: argparse.Namespace, chosen: FitOptions, free: Any, answers: Answers) -> int:
    from gfmdlayer.fitting import indentation_report as report
    from gfmdlayer.fitting.curve_files import entries, read_curve, units_of
    from gfmdlayer.fitting.estimates import best_of
    from gfmdlayer.fitting.indentation import fit_curves, usable
    from gfmdlayer.fitting.problem import IndentationModel
    from gfmdlayer.fitting.starts import read_model

    out, *_ = report.targets(options.out, options.force, f"{Path(options.data[0]).stem}-fit")
    models = {str(path): read_model(path, free) for path in options.model}
    checked = {path: (IndentationModel(data), keys) for path, (data, keys) in models.items()}
    measured = entries([Path(each) for each in options.data])
    fits = {}
    for path, (model, keys) in checked.items():
        into, timeless = units_of(model.config.units), model.is_timeless(keys)
        made = (partial(read_curve, entry, answers, into, chosen, timeless=timeless) for entry in measured)
        curves, lost = usable(made)
        fits[path] = fit_curves(curves, model, keys, chosen, notes=lost)
    best, _ = best_of(fits)
    if len(fits) > 1:
        print("\n".join(report.comparison(fits)), end=f"\n\n{best}:\n")
    print("\n".join(report.write_report(fits[best], out, options.force)))
    return COMPLETE


def _prepare() -> None:
    """Import the modules of a fit on the other MPI ranks."""
    import gfmdlayer.fitting.force_map  # noqa: F401


def _run(options: argparse.Namespace, chosen: FitOptions, free: Any, answers: Answers, pool: Any) -> int:
    from gfmdlayer.fitting.force_map import ForceMap
    from gfmdlayer.fitting.starts import read_model
    from gfmdlayer.interactive.fit_map import FitMap
    from gfmdlayer.results.names import ResultsError
    from gfmdlayer.results.reader import open_results
    from gfmdlayer.study.progress import make_display

    paths = [Path(each) for each in options.data]
    directory = Path(options.out or Path("results") / f"{paths[0].stem}-fits")
    try:
        data, keys = read_model(options.model[0], free)
        curves = ForceMap(paths, directory, data, keys, chosen, answers)
        summary = curves.run(pool, options.restart, lambda: make_display(sys.stderr))
        if summary.collected and summary.count("complete"):
            with open_results(directory) as found:
                fits = FitMap(found)
                print(fits)
                fits.plot(directory / "map.png")
    except ResultsError as error:
        print(f"gfmdlayer: {error}", file=sys.stderr)
        return FAILED
    except Exception as error:  # an exception that leaves the pool aborts the ranks
        if not (problems := input_problems(error)):
            raise
        return refuse(*problems)
    return conclude(summary, directory, "curve")
