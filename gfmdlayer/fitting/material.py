"""`gfmdlayer.fit_material`, and its output: the material in YAML, a figure, a table with warnings."""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.materials import Law, Prony
from gfmdlayer.body.shifts import Shift
from gfmdlayer.figures.labels import SPAN_OF_ROUND, Quantity, finish, name_axes
from gfmdlayer.figures.plot_style import colours, line_style, new_figure, save, styled
from gfmdlayer.files.tables import Answers
from gfmdlayer.files.whole import output_file, write_text
from gfmdlayer.fitting.intervals import mixture
from gfmdlayer.fitting.laws import MODELS, FittedLaw, fit, fit_law
from gfmdlayer.fitting.measurement import (
    SAME_TEMPERATURE,
    CreepCurve,
    FitError,
    MasterCurve,
    Measurement,
    isotherms,
)
from gfmdlayer.fitting.result import Fit, Table
from gfmdlayer.fitting.superposition import LEVEL, FittedNumber, Superposition, superposed
from gfmdlayer.results.names import ResultsError
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import shown

if TYPE_CHECKING:
    import os

    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = "os"
POOR, POOR_RMS = 3.0, 0.02  # a fit is poor if its rms error exceeds both: times the least, value
PLATEAU = 1.2  # beyond this factor from the measured range a modulus is extrapolated


YAML = {".yaml", ".yml"}
LAW_NAMES = {"wlf": "WLF", "arrhenius": "Arrhenius"}


@dataclass(frozen=True)
class MaterialFit(Fit):
    """A law fitted to measured moduli, at one temperature or at several.

    The names of lmfit lead to the same numbers: params, value, stderr, vary, ndata, nvarys, nfree, chisqr (of
    the relative errors), redchi.
    """

    fitted: FittedLaw
    params: Mapping[str, FittedNumber]  # of the law, then of the shift
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    superposition: Superposition | None = None  # of curves at several temperatures

    @property
    def material(self) -> Law:
        """The law, with its shift, as a run takes it; a configuration in other units converts it."""
        law, (time, modulus) = self.fitted.material, self.fitted.measurement.units
        law = law.written_in(modulus, time) if time and modulus else law
        if self.superposition is None or self.superposition.law is None:
            return law
        return law.model_copy(update={"shift": self.superposition.law})

    def __getitem__(self, name: str) -> FittedNumber:
        """Return a fitted number by its name."""
        if name not in self.params:
            raise KeyError(f"{name}: must be one of {', '.join(self.params)}")
        return self.params[name]

    @property
    def ndata(self) -> int:
        """Number of measured moduli."""
        return self.fitted.measurement.moduli.size

    @property
    def nvarys(self) -> int:
        """Number of fitted numbers."""
        return sum(each.vary for each in self.params.values())

    @property
    def nfree(self) -> int:
        """Moduli less fitted numbers."""
        return self.ndata - self.nvarys

    @property
    def chisqr(self) -> float:
        """Sum of squares of the relative errors."""
        return float(np.sum(self.fitted.errors**2))

    @property
    def redchi(self) -> float:
        """`chisqr` over `nfree`."""
        return self.chisqr / max(self.nfree, 1)

    def tables(self) -> list[Table]:
        """Return the table of the numbers with intervals, and that of the shift at each temperature."""
        law = self.fitted.material
        rows = [[*_cells(each), ""] for each in self.params.values()]
        if isinstance(law, Prony):
            rows.append(["Ginf", f"{law.glassy:.6e}", "", "", "sum"])
        found: list[Table] = [(["", "value", "95 % interval", "unit", ""], rows)]
        if (joined := self.superposition) is not None:
            head = ["degrees C", "log10 aT", "95 % interval", *(["log10 bT"] if joined.vertical else [])]
            heights = [[f"{each.value:.4f}"] for each in joined.vertical] or [[]] * len(joined.curves)
            named = zip(joined.temperatures.tolist(), joined.factors, heights, strict=True)
            shifts = [[f"{T:g}", f"{each.value:.4f}", _interval(each), *height] for T, each, height in named]
            found.append((head, shifts))
        return found

    def sentences(self) -> list[str]:
        """Return how the data were read, and warnings."""
        return [*self.notes, *(f"warning: {text}" for text in self.warnings)]

    def lines(self) -> Iterator[str]:
        """Yield how the data were read, tables of the numbers with intervals, and warnings."""
        yield from self.notes
        for head, rows in self.tables():
            yield from _aligned([head, *rows])
        yield from (f"warning: {text}" for text in self.warnings)

    def figure(self, names: Sequence[str] = ()) -> Figure:  # noqa: ARG002
        """Draw the measured moduli with the law, the errors, and the shift over temperature."""
        return fit_figure(self.fitted, self.superposition)

    def to_dataset(self) -> xarray.Dataset:
        """Return the fitted numbers over `parameter`, measured and fitted moduli over `row`.

        Returns
        -------
        xarray.Dataset
            value, low and high over `parameter`; over `row` the abscissa at the reference temperature, and
            measured and fitted moduli of shape (part, row); shift factors over `temperature`.
        """
        import xarray

        curve, each = self.fitted.measurement, [*self.params.values()]
        nan = (math.nan, math.nan)
        ends = np.array([known.interval or nan for known in each]).reshape(-1, 2)
        name, *parts = curve.columns
        data: dict[str, object] = {
            "value": ("parameter", [known.value for known in each]),
            "low": ("parameter", ends[:, 0]),
            "high": ("parameter", ends[:, 1]),
            "measured": (("part", "row"), curve.moduli, {"units": curve.labels[1]}),
            "fitted": (("part", "row"), curve.predicted(self.fitted.material, curve.abscissa)),
        }
        abscissa = "row", curve.abscissa, {"units": curve.labels[0]}
        coordinates: dict[str, object] = {"parameter": [*self.params], "part": parts, name: abscissa}
        if self.superposition is not None:
            coordinates["temperature"] = self.superposition.temperatures
            factors = self.superposition.factors
            data["log10_aT"] = "temperature", [known.value for known in factors]
            data["log10_aT_half"] = (
                "temperature",
                [np.ptp(known.interval) / 2 if known.interval else 0.0 for known in factors],
            )
        about = {"notes": "\n".join(self.notes), "warnings": "\n".join(self.warnings)}
        return xarray.Dataset(data, coordinates, about)

    def write(self, out: str | os.PathLike[str], *, force: bool = False) -> list[Path]:
        """Write the material as YAML, and the figure beside it; return both paths.

        Parameters
        ----------
        out : path-like
            A YAML file, or a folder for NAME.yaml.
        force : bool
            Whether existing files are overwritten; the data never are.
        """
        source = Path(self.fitted.measurement.source.partition(", ")[0])
        folder = str(out) if Path(out).suffix.lower() in YAML else f"{out}/"
        named = output_file(folder, Path(f"{source.stem}.yaml"))
        material, picture = with_suffixes(named, [".png"], force)
        written(material, {material: self._yaml(material.stem)}, force)
        self.plot(picture)
        return [material, picture]

    def _yaml(self, stem: str) -> str:
        shift = self.superposition.law if self.superposition is not None else None
        return material_yaml(self.fitted, stem, [*self.notes], shift)


Measured = str | Path | Mapping[Any, Any] | Sequence[str | Path]


@entry()
def fit_material(
    data: Measured,
    law: str = "prony",
    *,
    branches: int | None = None,
    relaxed_modulus: float | None = None,
    poisson: float | None = None,
    modulus: str | None = None,
    units: Mapping[str, str] | None = None,
    decimal: str | None = None,
    columns: Sequence[str] = (),
    table: int | None = None,
    shift: str | Shift = "wlf",
    reference: float | None = None,
    vertical: bool = False,
    normalise: bool = False,
) -> MaterialFit:
    """Fit a law to measured moduli or compliances, at one temperature or at several.

    Parameters
    ----------
    data : path, sequence of paths or mapping
        Tables with headings: omega or f with moduli or compliances, or t with G(t) or J(t); E and D in
        tension. Rows at several temperatures, by a column T [degC], or by a mapping {temperature in degrees
        Celsius: path}, are shifted to one. A mapping of columns by their headings, a frame or a dataset is a
        table too.
    law : str
        prony, fractional_zener, power_law, kohlrausch or havriliak_negami.
    branches : int, optional
        Number of branches of a Prony series; by default the fewest that fit.
    relaxed_modulus : float, optional
        G0 in the unit of the data, 0 for a liquid; fitted by default.
    poisson : float, optional
        Poisson's ratio, for moduli and compliances in tension; 1/2 by default.
    modulus : str, optional
        G or E, for moduli that do not say it.
    units : mapping of str to str, optional
        Units of columns without one, by their names.
    decimal : str, optional
        Decimal mark, "." or ",", where a file leaves it open.
    columns : sequence of str, optional
        Names of the columns in place of their headings.
    table : int, optional
        Number of the table, counted from 1, of a file with several.
    shift : str or Shift
        Of several temperatures: wlf or arrhenius, whose constants are fitted; free, a factor for each; or a
        law that is held, such as ``WLF(C1=17.4, C2=51.6, reference=20)``.
    reference : float, optional
        Temperature of the law in degrees Celsius; by default the one in the middle.
    vertical : bool
        Whether the moduli at each temperature have a factor too.
    normalise : bool
        Whether moduli are in units of G0.

    Returns
    -------
    MaterialFit
        The law, its errors and its curves; printed, it is a table.

    Raises
    ------
    TableError
        A table cannot be read.
    FitError
        The fit is not possible.

    Examples
    --------
    >>> import numpy as np
    >>> omega = np.geomspace(1e-2, 1e2, 30)
    >>> modulus = 1 + 9 * 1j * omega / (1 + 1j * omega)
    >>> fit = gfmdlayer.fit_material({"omega": omega, "G'": modulus.real, "G''": modulus.imag})
    >>> [round(fit[name].value, 4) for name in ("G0", "G_1", "tau_1")]
    [1.0, 9.0, 1.0]
    """
    answers = Answers(decimal, tuple((units or {}).items()), tuple(columns), modulus, table)
    return fitted_material(
        list(_isotherms(data, poisson, answers)), law, branches, relaxed_modulus, shift, reference,
        vertical=vertical, normalise=normalise,
    )  # fmt: skip


def fitted_material(
    curves: Sequence[Measurement],
    law: str,
    branches: int | None,
    relaxed: float | None,
    shift: str | Shift = "wlf",
    reference: float | None = None,
    *,
    vertical: bool = False,
    normalise: bool = False,
    notes: Sequence[str] = (),
) -> MaterialFit:
    """Fit a law to curves that are read; `notes` come before those of the data."""
    laws = ("prony", *MODELS)
    if law not in laws:
        raise FitError(f"law: got {law!r}; must be one of {', '.join(laws)}")
    if law != "prony" and branches is not None:
        raise FitError("--branches: only for --law prony; remove it or set --law prony")
    joined = None
    if len(curves) > 1:
        if missing := [each.source for each in curves if each.temperature is None]:
            raise FitError(f"{missing[0]}: has no temperature; give one to each of several curves")
        joined = superposed(curves, reference, shift, vertical=vertical, relaxed=relaxed)
    measured = curves[0] if joined is None else joined.master
    fitted = fit(measured, branches, relaxed) if law == "prony" else fit_law(measured, law, relaxed)
    unit = fitted.material.unit
    if normalise:
        fitted = fitted.normalised()
    params = {each.name: each for each in fitted_numbers(fitted, relaxed)}
    if joined is not None:
        params |= {each.name: each for each in joined.constants}
    if joined is not None and joined.law is None:
        notes = [*notes, "Factors are free: the material is that of the reference, without a shift."]
    told = tuple(_origin(fitted, unit if normalise else None, notes))
    warnings = list(_warnings(fitted, branches, relaxed))
    if joined is not None and fitted.least > POOR_RMS:
        warnings.append(
            f"the curves do not lie on one master curve: the least error of any series is "
            f"{_percent(fitted.least)}; try moduli that are shifted too (vertical), a free shift, or fewer "
            "temperatures"
        )
    return MaterialFit(fitted, params, told, tuple(warnings), joined)


def _isotherms(data: Any, poisson: float | None, answers: Answers) -> Iterator[Measurement]:
    """Yield the curves of files, of a mapping from temperatures to files, or of columns."""
    if isinstance(data, (str, Path)):
        yield from isotherms(Path(data), poisson, answers)
    elif hasattr(data, "keys") and all(isinstance(key, (int, float)) for key in data.keys()):  # noqa: SIM118
        for temperature, path in data.items():
            yield from _at(float(temperature), isotherms(Path(path), poisson, answers))
    elif hasattr(data, "keys"):
        with tempfile.TemporaryDirectory(prefix="gfmdlayer-") as folder:
            path = Path(folder) / "columns.csv"
            path.write_text(_as_table(data), encoding="utf-8")
            yield from isotherms(path, poisson, answers)
    elif not isinstance(data, Iterable):
        allowed = (
            "must be a path, several, a mapping from temperatures to paths, or columns by their headings"
        )
        raise FitError(f"data: got {shown(data)}; {allowed}")
    else:
        for each in data:
            yield from isotherms(Path(each), poisson, answers)


def _at(temperature: float, curves: Sequence[Measurement]) -> Iterator[Measurement]:
    """Yield the curves of a file, all at a temperature that is given for it."""
    for curve in curves:
        if curve.temperature is not None and abs(curve.temperature - temperature) > SAME_TEMPERATURE:
            raise FitError(
                f"{curve.source}: got the temperature {temperature:g}, and {curve.temperature:g} in the file"
            )
        yield replace(curve, temperature=temperature)


def _as_table(held: Any) -> str:
    """Write columns that are held in memory as a table, with their units in the headings."""
    every = {str(key): held[key] for key in (*held.keys(), *getattr(held, "coords", ()))}
    units = {key: getattr(values, "attrs", {}).get("units", "") for key, values in every.items()}
    heads = [f"{key} [{units[key]}]" if units[key] else key for key in every]
    rows = zip(*(np.asarray(values, float).tolist() for values in every.values()), strict=True)
    return "\n".join([";".join(heads), *(";".join(map(repr, row)) for row in rows)]) + "\n"


def fitted_numbers(fitted: FittedLaw, relaxed: float | None) -> Iterator[FittedNumber]:
    """Yield the numbers of a law with 95 % intervals, for correlated noise, see `intervals`.

    They count by their logarithms, exponents by themselves.
    """
    curve, law = fitted.measurement, fitted.material
    names, values, build = _numbers(law)
    held = {"G0"} if relaxed is not None else {"tau"} if law.model == "power_law" else set[str]()
    free = [i for i, name in enumerate(names) if values[i] > 0 and name not in held]

    def predicted(changes: FloatArray) -> FloatArray:
        trial = np.array(values)
        trial[free] *= np.exp(changes)
        return np.ravel(curve.predicted(build(trial.tolist()), curve.abscissa) / curve.moduli)

    step = 1e-4
    slopes = [(predicted(step * d) - predicted(-step * d)) / (2 * step) for d in np.eye(len(free))]
    blocks = [curve.abscissa.size] * curve.moduli.shape[0]
    half = mixture(-np.ravel(fitted.errors), np.column_stack(slopes), blocks, level=LEVEL).half
    time, modulus = curve.units
    for i, (name, value) in enumerate(zip(names, values, strict=True)):
        wide = half[free.index(i)] if i in free else None
        ends = (
            None
            if wide is None
            else (value * math.exp(-min(wide, 700.0)), value * math.exp(min(wide, 700.0)))
        )
        unit = modulus if name.startswith("G") else time if name.startswith("tau") else ""
        yield FittedNumber(name, value, ends, unit)


def _numbers(law: Law) -> tuple[list[str], list[float], Callable[[Sequence[float]], Law]]:
    """Return names and values of the numbers of a law, and the law as a function of the values."""
    if isinstance(law, Prony):
        pairs = range(1, len(law.branches) + 1)
        names = ["G0", *(f"{key}_{k}" for k in pairs for key in ("G", "tau"))]
        values = [law.G0, *(value for branch in law.branches for value in branch)]

        def series(given: Sequence[float]) -> Law:
            return Prony(given[0], tuple(zip(given[1::2], given[2::2], strict=True)))

        return names, [float(each) for each in values], series
    known = _parameters(law)
    return (
        [*known],
        [*known.values()],
        lambda given: law.model_copy(update=dict(zip(known, given, strict=True))),
    )


def write_fit(
    data: Path | Sequence[Path],
    out: str | Path | None = None,
    *,
    law: str = "prony",
    branches: int | None = None,
    relaxed: float | None = None,
    temperature: float | None = None,
    held: Shift | None = None,
    shift: str = "wlf",
    reference: float | None = None,
    vertical: bool = False,
    temperatures: Sequence[float] = (),
    normalise: bool = False,
    force: bool = False,
    poisson: float | None = None,
    answers: Answers = Answers(),  # noqa: B008
) -> str:
    """Fit a law to files of measurements, write the material and a figure, and return a summary.

    `out` is the YAML file, or with any other name a folder for NAME.yaml (default: the working folder); the
    figure NAME.png lies beside it. `force` overwrites existing files, but never the data. `temperatures` are
    those of the files. Curves at several temperatures are shifted by the `held` law, or by `shift`; a single
    curve is shifted to a `temperature` by the `held` law with the reference of the data.
    """
    paths = [data] if isinstance(data, Path) else [*data]
    if out is not None and Path(out).suffix.lower() not in YAML:
        out = f"{out}/"  # a folder, which is made
    material, picture = with_suffixes(
        output_file(out, Path(f"{paths[0].stem}.yaml")), [".png"], force, *paths
    )
    if temperatures and len(temperatures) != len(paths):
        raise FitError(
            f"--temperatures: got {len(temperatures)} for {len(paths)} files; must be one for each"
        )
    read = [isotherms(path, poisson, answers) for path in paths]
    if temperatures:
        read = [list(_at(at, each)) for at, each in zip(temperatures, read, strict=True)]
    curves = [curve for each in read for curve in each]
    notes: list[str] = []
    if len(curves) == 1 and held is not None and temperature is not None:
        if reason := held.refused(temperature):
            raise FitError(f"--temperature: {reason}")
        curves = [curves[0].slowed(held.factor(temperature))]
        notes = [_moved(held, temperature)]
    elif len(curves) == 1 and held is not None:
        raise FitError("--wlf: a single curve also needs --temperature, to which it is shifted")
    elif len(curves) > 1 and temperature is not None:
        raise FitError(
            "--temperature: of curves at several temperatures the material has the shift; leave it out"
        )
    found = fitted_material(
        curves, law, branches, relaxed, held or shift, reference if len(curves) > 1 else None,
        vertical=vertical, normalise=normalise, notes=notes,
    )  # fmt: skip
    shifts = found.superposition.law if found.superposition is not None else None
    text = material_yaml(found.fitted, material.stem, [*found.notes], shifts)
    written(material, {material: text}, force)
    save(fit_figure(found.fitted, found.superposition), picture)
    return "\n".join([str(found), f"material: {material}", f"figure: {picture}"])


def _cells(number: FittedNumber) -> list[str]:
    return [number.name, f"{number.value:.6e}", _interval(number), number.unit]


def _interval(number: FittedNumber) -> str:
    if number.interval is None:
        return "held"
    return f"{number.interval[0]:.5g} to {number.interval[1]:.5g}"


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the rows of a table with their cells below each other."""
    widths = [max(len(row[c]) for row in rows) for c in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


def material_yaml(fitted: FittedLaw, name: str, notes: list[str], shift: Shift | None = None) -> str:
    """Write the law as a small configuration, with notes above it."""
    material = fitted.material
    lines = [f"# {note}" for note in notes]
    lines += [f"name: {plain_name(name, 'material')}"]
    if all(units := fitted.measurement.units):
        lines += [f"units: {{length: m, stress: {units[1]}, time: {units[0]}}}"]
    lines += ["layer:", "  material:", f"    model: {material.model}"]
    lines += [f"    {name}: {value:.6e}" for name, value in _parameters(material).items()]
    if shift is not None:
        lines += ["    shift:", *(f"      {key}: {value}" for key, value in shift.model_dump().items())]
    if isinstance(material, Prony):
        lines += ["    branches:"]
        lines += [f"      - {{G: {modulus:.6e}, tau: {time:.6e}}}" for modulus, time in material.branches]
    return "\n".join(lines) + "\n"


def fit_figure(fitted: FittedLaw, joined: Superposition | None = None) -> Figure:
    """Draw measured moduli with the fit, below them the error, and the shift of several temperatures."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    curve = fitted.measurement
    is_master = isinstance(curve, MasterCurve)
    symbols = ["$G'$", "$G''$"] if is_master else ["$J$" if isinstance(curve, CreepCurve) else "$G$"]
    smooth = np.geomspace(curve.abscissa[0], curve.abscissa[-1], 500)
    lines = curve.predicted(fitted.material, smooth)
    with styled():
        if joined is None:
            figure = new_figure(1, 100.0)
            above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        else:
            figure = new_figure(2, 100.0)
            panels = figure.subplots(2, 2, height_ratios=(2.2, 1))
            (raw, above), (factors, below) = panels.tolist()
            below.sharex(above)
            above.tick_params(labelbottom=False)
            _draw_shifts(raw, factors, joined)
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
        above.set_title("(a)" if joined is None else "(b)", loc="left")
        above.legend()
        below.axhline(0, color="black", linewidth=0.5)
        limit = 115 * max(fitted.largest, 1e-6)
        below.set(ylabel="error (%)", ylim=(-limit, limit))
        along, across = curve.labels
        name_axes(above, y=Quantity(", ".join(symbols), across))
        name_axes(below, Quantity(r"$\omega$" if is_master else "$t$", along))
        below.set_title("(b)" if joined is None else "(d)", loc="left")
        finish(figure)
    return figure


def _draw_shifts(raw: Axes, factors: Axes, joined: Superposition) -> None:
    """Draw the curves as measured, and log10 aT over temperature with its law."""
    import matplotlib as mpl

    temperatures, first = joined.temperatures, joined.curves[0]
    colour = mpl.colormaps["coolwarm"]
    span = np.ptp(temperatures) or 1.0
    for curve, T in zip(joined.curves, temperatures.tolist(), strict=True):
        for marker, values in zip(MARKERS, curve.moduli, strict=False):
            shade = colour((T - temperatures[0]) / span)
            raw.plot(curve.abscissa, values, marker=marker, ms=2.5, mfc="none", mew=0.6, ls="", color=shade)
    raw.set(xscale="log", yscale="log")
    along, across = first.labels
    symbol = r"$\omega$" if isinstance(first, MasterCurve) else "$t$"
    values = (
        "$G'$, $G''$" if isinstance(first, MasterCurve) else "$J$" if isinstance(first, CreepCurve) else "$G$"
    )
    name_axes(raw, Quantity(symbol, along), Quantity(values, across))
    ends = f"{temperatures[0]:g} to {temperatures[-1]:g} °C".replace("-", "−")
    raw.set_title(f"(a) as measured, {ends}", loc="left")
    found = [each.value for each in joined.factors]
    half = [np.ptp(each.interval) / 2 if each.interval else 0.0 for each in joined.factors]
    factors.errorbar(temperatures, found, half, fmt="o", ms=3.2, mfc="none", mew=0.7, color="black", lw=0.7)
    if joined.law is not None:
        fine = np.linspace(temperatures[0], temperatures[-1], 200)
        logs = [joined.law.logarithm(T) / math.log(10) for T in fine.tolist()]
        factors.plot(fine, logs, color=colours(3)[0], label=LAW_NAMES[joined.law.law])
        factors.legend()
    name_axes(factors, Quantity("temperature", "°C"), Quantity(r"$\log_{10} a_T$"))
    factors.set_title("(c)", loc="left")


def with_suffixes(material: Path, suffixes: Sequence[str], force: bool, *data: Path) -> list[Path]:
    """Return the names of files beside a material; none may be the data, nor exist unless forced."""
    for target in (targets := [material, *map(material.with_suffix, suffixes)]):
        if target.exists() and any(each.exists() and target.samefile(each) for each in data):
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


def _origin(fitted: FittedLaw, unit: float | None, notes: Sequence[str]) -> Iterator[str]:
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
    yield from notes
    time, modulus = curve.units
    if unit:
        symbol = _unit_symbol(law)
        yield f"Moduli are in units of {symbol} = {unit:.6g} of the data, times in the unit of the data."
    elif time and modulus:
        yield f"Moduli are in {modulus}, times in {time}; a configuration with units converts them."
    else:
        yield "Moduli and times are in the units of the data."


def _moved(shift: Shift, temperature: float) -> str:
    """Say by what the times of a curve were multiplied."""
    constants = ", ".join(
        f"{key} = {value:g}" for key, value in shift.model_dump(exclude={"law", "reference"}).items()
    )
    reference = f"from reference {shift.reference:g} with {constants}"
    return (
        f"{LAW_NAMES[shift.law]}: at temperature {temperature:g}, {reference}; "
        f"times multiplied by aT = {shift.factor(temperature):.6g}."
    )


def _unit_symbol(law: Law) -> str:
    """Name the modulus by which dimensionless pressures are divided."""
    return "G0" if law.relaxed else "G" if hasattr(law, "G") else "Ginf"


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
    if relaxed is None and isinstance(fitted.measurement, CreepCurve) and not material.relaxed:
        yield (
            "the creep goes on to the end of the data, and the material is taken as a liquid, G0 = 0; a "
            "solid whose creep ends later looks the same: measure at longer times, or say --relaxed-modulus 0"
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
