"""The output of a fit to a measured curve: the material in YAML, a figure, a summary with warnings."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.body.materials import Law, Prony
from gfmdlayer.body.shifts import WLF
from gfmdlayer.figures.labels import SPAN_OF_ROUND, Quantity, finish, name_axes
from gfmdlayer.figures.plot_style import colours, line_style, new_figure, save, styled
from gfmdlayer.files.tables import Answers
from gfmdlayer.files.whole import output_file, write_text
from gfmdlayer.fitting.laws import FittedLaw, fit, fit_law
from gfmdlayer.fitting.measurement import CreepCurve, FitError, MasterCurve, read
from gfmdlayer.results.names import ResultsError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKERS = "os"
POOR, POOR_RMS = 3.0, 0.02  # a fit is poor if its rms error exceeds both: times the least, value
PLATEAU = 1.2  # beyond this factor from the measured range a modulus is extrapolated


YAML = {".yaml", ".yml"}


def fit_material(
    data: Path,
    out: str | Path | None = None,
    *,
    law: str = "prony",
    branches: int | None = None,
    relaxed: float | None = None,
    temperature: float | None = None,
    shift: WLF | None = None,
    normalise: bool = False,
    force: bool = False,
    poisson: float | None = None,
    answers: Answers = Answers(),  # noqa: B008
) -> str:
    """Fit a law to a file of measurements, write the material and a figure, and return a summary.

    `out` is the YAML file, or with any other name a folder for NAME.yaml (default: the working folder); the
    figure NAME.png lies beside it. `law` is prony or a key of `MODELS`; `normalise` writes moduli in units of
    G0; `force` overwrites existing files, but never the data. For `branches` and `relaxed` see `laws.fit`,
    for `poisson` and `answers` see `measurement.read`. The relaxation times are shifted to a `temperature` by
    a `shift` with the reference of the data.
    """
    if out is not None and Path(out).suffix.lower() not in YAML:
        out = f"{out}/"  # a folder, which is made
    material, picture = with_suffixes(output_file(out, Path(f"{data.stem}.yaml")), [".png"], force, data)
    measured = read(data, poisson, answers)
    if shift is not None and temperature is not None:
        if reason := shift.refused(temperature):
            raise FitError(f"--temperature: {reason}")
        measured = measured.slowed(shift.factor(temperature))
    if law == "prony":
        fitted = fit(measured, branches, relaxed)
    elif branches is None:
        fitted = fit_law(measured, law, relaxed)
    else:
        raise FitError("--branches: only for --law prony; remove it or set --law prony")
    unit = fitted.material.unit
    if normalise:
        fitted = fitted.normalised()
    notes = list(_origin(fitted, temperature, shift, unit if normalise else None))
    written(material, {material: material_yaml(fitted, material.stem, notes)}, force)
    save(fit_figure(fitted), picture)
    warnings = [f"warning: {text}" for text in _warnings(fitted, branches, relaxed)]
    return "\n".join([*notes, *_table(fitted), *warnings, f"material: {material}", f"figure: {picture}"])


def material_yaml(fitted: FittedLaw, name: str, notes: list[str]) -> str:
    """Write the law as a small configuration, with notes above it."""
    material = fitted.material
    lines = [f"# {note}" for note in notes]
    lines += [f"name: {plain_name(name, 'material')}"]
    if all(units := fitted.measurement.units):
        lines += [f"units: {{length: m, stress: {units[1]}, time: {units[0]}}}"]
    lines += ["layer:", "  material:", f"    model: {material.model}"]
    lines += [f"    {name}: {value:.6e}" for name, value in _parameters(material).items()]
    if isinstance(material, Prony):
        lines += ["    branches:"]
        lines += [f"      - {{G: {modulus:.6e}, tau: {time:.6e}}}" for modulus, time in material.branches]
    return "\n".join(lines) + "\n"


def fit_figure(fitted: FittedLaw) -> Figure:
    """Draw measured moduli with the fit, and below them the error, in one column of a journal."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    curve = fitted.measurement
    is_master = isinstance(curve, MasterCurve)
    symbols = ["$G'$", "$G''$"] if is_master else ["$J$" if isinstance(curve, CreepCurve) else "$G$"]
    smooth = np.geomspace(curve.abscissa[0], curve.abscissa[-1], 500)
    lines = curve.predicted(fitted.material, smooth)
    with styled():
        figure = new_figure(1, 100.0)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        for i, (symbol, colour) in enumerate(zip(symbols, colours(3), strict=False)):
            style = {"color": colour, "marker": MARKERS[i], "ms": 3.2, "mfc": "none", "mew": 0.7, "ls": ""}
            above.plot(curve.abscissa, curve.moduli[i], label=f"{symbol}, measured", **style)
            above.plot(smooth, lines[i], color=colour, linestyle=line_style(i), label=f"{symbol}, fitted")
            below.plot(curve.abscissa, 100 * fitted.errors[i], **style)
        above.set(xscale="log", yscale="log")
        span = curve.moduli.max() / curve.moduli.min()
        if span < 100:  # fewer than two powers of ten to label
            few = LogLocator(subs=(1, 2, 5) if span > 10 else range(1, 10))
            above.yaxis.set_major_locator(few if span > SPAN_OF_ROUND else MaxNLocator(5))
            above.yaxis.set_major_formatter("{x:g}")
            above.yaxis.set_minor_formatter("")
        above.set_title("(a)", loc="left")
        above.legend()
        below.axhline(0, color="black", linewidth=0.5)
        limit = 115 * max(fitted.largest, 1e-6)
        below.set(ylabel="error (%)", ylim=(-limit, limit))
        along, across = curve.labels
        name_axes(above, y=Quantity(", ".join(symbols), across))
        name_axes(below, Quantity(r"$\omega$" if is_master else "$t$", along))
        below.set_title("(b)", loc="left")
        finish(figure)
    return figure


def with_suffixes(
    material: Path, suffixes: Sequence[str], force: bool, data: Path | None = None
) -> list[Path]:
    """Return the names of files beside a material; none may be the data, nor exist unless forced."""
    for target in (targets := [material, *map(material.with_suffix, suffixes)]):
        if data is not None and target.exists() and data.exists() and target.samefile(data):
            raise ResultsError(f"{target}: is the data; choose another --out")
        if target.exists() and not force:
            raise ResultsError(f"{target}: exists; choose another --out, or overwrite it with --force")
    return targets


def written(material: Path, texts: Mapping[Path, str], force: bool) -> None:
    """Write the texts of a material and the files beside it, in a folder that is made for them."""
    try:
        material.parent.mkdir(parents=True, exist_ok=True)
        for path, text in texts.items():
            write_text(path, text, replace=force)
    except OSError as error:
        raise ResultsError(f"{material}: cannot be written: {error.strerror or error}") from error


def plain_name(stem: str, instead: str) -> str:
    """Return the name of a configuration in a file of this stem."""
    return re.sub(r"[^A-Za-z0-9_]+", "-", stem).strip("-")[:128] or instead


def _origin(
    fitted: FittedLaw, temperature: float | None, shift: WLF | None, unit: float | None
) -> Iterator[str]:
    """Yield the origin and the error of the law."""
    curve, law = fitted.measurement, fitted.material
    rows, name = curve.abscissa.size, law.model
    kind = f"Prony series of {_branches(len(law.branches))}" if isinstance(law, Prony) else f"Law {name}"
    yield f"{kind}, fitted to the {curve.name} {curve.source!r} of {rows} rows."
    if curve.account:
        yield curve.account
    yield from curve.notes
    yield (
        f"Relative error: {_percent(fitted.rms)} rms, {_percent(fitted.largest)} at most; "
        f"the least error of any series is {_percent(fitted.least)} rms."
    )
    if shift is not None and temperature is not None:
        yield (
            f"WLF: at temperature {temperature:g}, from reference {shift.reference:g} with "
            f"C1 = {shift.C1:g}, C2 = {shift.C2:g}; times multiplied by aT = {shift.factor(temperature):.6g}."
        )
    time, modulus = curve.units
    if unit:
        symbol = _unit_symbol(law)
        yield f"Moduli are in units of {symbol} = {unit:.6g} of the data, times in the unit of the data."
    elif time and modulus:
        yield f"Moduli are in {modulus}, times in {time}; a configuration with units converts them."
    else:
        yield "Moduli and times are in the units of the data."


def _unit_symbol(law: Law) -> str:
    """Name the modulus by which dimensionless pressures are divided."""
    return "G0" if law.relaxed else "G" if hasattr(law, "G") else "Ginf"


def _table(fitted: FittedLaw) -> Iterator[str]:
    law = fitted.material
    if not isinstance(law, Prony):
        yield from (f"{name:>9}  {value:13.6e}" for name, value in _parameters(law).items())
        return
    yield f"{'':>6}  {'G':>13}  {'tau':>13}"
    yield f"{'G0':>6}  {law.G0:13.6e}"
    for number, (modulus, time) in enumerate(law.branches, start=1):
        yield f"{number:6d}  {modulus:13.6e}  {time:13.6e}"
    yield f"{'Ginf':>6}  {law.glassy:13.6e}"


def _parameters(law: Law) -> dict[str, float]:
    """Return the fitted numbers of a law by their names."""
    kept = law.model_dump(exclude={"model", "shift", "tolerance", "branches"}, exclude_none=True)
    return {name: float(value) for name, value in kept.items()}


def _warnings(fitted: FittedLaw, asked: int | None, relaxed: float | None) -> Iterator[str]:
    material, elastic = fitted.material, fitted.measurement.elastic
    if asked is not None and isinstance(material, Prony) and len(material.branches) < asked:
        yield f"{_branches(len(material.branches))} instead of {asked}: more branches do not reduce the error"
    if fitted.rms > max(POOR * fitted.least, POOR_RMS):
        if isinstance(material, Prony):
            yield "the Prony series does not follow the data; try more rows or more --branches"
        else:
            yield f"the law {material.model} does not follow the data; try another law or a Prony series"
    if relaxed is None and material.relaxed and elastic.min() > PLATEAU * material.relaxed:
        yield (
            f"G0 = {material.relaxed:.4g} is extrapolated: the lowest measured modulus is "
            f"{elastic.min():.4g}; measure at {fitted.measurement.slower}, or give --relaxed-modulus"
        )
    decades = np.log(fitted.measurement.abscissa)
    if not 0.25 < (np.median(decades) - decades[0]) / np.ptp(decades) < 0.75:
        yield (
            f"half of the rows lie in less than a quarter of the decades of {fitted.measurement.columns[0]}"
            " and dominate the fit; spread the rows evenly over the decades"
        )
    if elastic.max() * PLATEAU < material.glassy < math.inf:
        yield (
            f"Ginf = {material.glassy:.4g} is extrapolated: the highest measured modulus is "
            f"{elastic.max():.4g}"
        )
    if abs(material.unit - 1) > 1e-6 and not all(fitted.measurement.units):
        symbol = _unit_symbol(material)
        yield (
            f"the moduli are in the unit of the data ({symbol} = {material.unit:.6g}); give "
            f"halfspace.shear_modulus in that unit too, or divide by {symbol} with --normalise"
        )


def _branches(count: int) -> str:
    return "1 branch" if count == 1 else f"{count} branches"


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2g} %"
