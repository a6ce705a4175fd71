"""`plot`, `report` and `leak`: pictures, a page for the browser, and the leakage of results."""

from __future__ import annotations

import argparse
import sys
import warnings
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfmdlayer.cli.terminal import COMPLETE, arguments, note_incomplete, refuse, verb

if TYPE_CHECKING:
    from collections.abc import Mapping

    from xarray import Dataset

    from gfmdlayer.figures.report.page import Listed
    from gfmdlayer.study.folder import Folder

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
    "convergence": "errors that `gfmdlayer converge` estimated, by column and source, and those of the first "
    "column, --y, over the work",
    "map": "contact area and mean pressure, or the columns of --z, over two swept keys",
}
# The kinds of figure that take an option; None stands for no --kind: the curves and the snapshots.
KINDS_WITH: dict[str, tuple[str | None, ...]] = {
    "log": (None, "curves", "map"),
    "log_time": (None, "curves"),
    "times": (None, "snapshots", "stick", "inside", "waterfall", "movie"),
    "inset": (None, "curves"),
    "x": (None, "curves", "map"),
    "y": (None, "curves", "loop", "map", "convergence"),
    "z": ("map", "inside"),
    "time": ("map", "curves", None),
    "fps": ("movie",),
    "trust": ("body",),
}

MOST_FRAMES = 100  # per second, the limit of a GIF


def _options_of_plot(parser: argparse.ArgumentParser) -> None:
    text = """
    path DIR  results folder, or the file of one case
    --out PATH  .png, .pdf or .svg, a movie .mp4 or .gif, or folder for it (default: with the results)
    """
    arguments(parser, text)
    kinds = parser.add_mutually_exclusive_group()
    described = "; ".join(f"{kind}: {meaning}" for kind, meaning in KINDS.items())
    usual = "curves and snapshots; of a folder with estimates alone these"
    kinds.add_argument("--kind", choices=tuple(KINDS), help=f"{described} (default: {usual})")
    meaning = "displacement and pressure, one frame for each snapshot: .mp4 with ffmpeg, else .gif"
    kinds.add_argument("--movie", dest="kind", action="store_const", const="movie", help=meaning)
    text = """
    --style {paper,screen}  paper: for a journal (default); screen: for a talk (default of movies)
    --case N  draw the snapshots of this case
    --labels {words,symbols} = words  axes in words with the symbol behind, or the symbol alone
    --columns  list the columns of the results, with unit and meaning, and draw nothing
    --log AXES  logarithmic axes: x, y, x,y or none; z: the colours of a map (default: time, where the
      durations of the cases differ more than thirtyfold, or half of the rows lie in the first fifteenth; of a
      map as the values are spread)
    --log-time  --log x of curves over time
    --times T ...  draw the snapshots of these times, all of them (default: of very many, some)
    --inset T ...  draw punch and surface at these snapshot times in an inset of the curves
    --select KEY=VALUE ...  draw only the cases with this (or the nearest) value of a swept key,
      thickness=0.1, or with values in a range, thickness=0.1:0.5
    --x NAME  time, a column, or a swept key; map: a swept key (default: time; of cases with one row each the
      swept key); reduced_velocity: a swept velocity times the shift factor of the temperature
    --y NAME ...  columns, one panel for each (default: contact_area_interpolated and mean_pressure, or
      depth under a load); loop: one column; map: a swept key
    --z NAME ...  columns of the map; inside: the field
    """
    arguments(parser, text, AXES=_axes)
    text = """
    --time T  time of a map, or of curves over a swept key: a number, end (default), or the max or min over
      time
    --fps N  frames per second of a movie
    --trust  body: run the Python code that the results name; without it such a body is refused
    """
    arguments(parser, text, T=str)


def _axes(text: str) -> tuple[str, ...]:
    """Return the names of axes; an error of the parser for other words."""
    names = tuple(text.split(",")) if text != "none" else ()
    if not set(names) <= {"x", "y", "z"}:
        raise argparse.ArgumentTypeError(f"got {text!r}; must be x, y, z, some of them as x,y, or none")
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


@verb(_options_of_plot, "gfmdlayer plot results/figure2-quick --out figure2.pdf --log x")
def plot(options: argparse.Namespace) -> int:
    """Draw columns of results against time, each other or swept keys, and the snapshots."""
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
    if options.columns:
        print(_table_of_columns(Path(options.path)))
        return COMPLETE
    from gfmdlayer.figures.plots import plot_results

    given = {name: getattr(options, name) for name in ("kind", "case", "times", "log", "log_time", "inset")}
    given |= {name: getattr(options, name) for name in ("y", "z", "fps", "trust", "labels")}
    style = options.style or ("screen" if options.kind == "movie" else "paper")
    more = {"x": options.x or "", "style": style, "time": time, "select": selected}
    for picture in plot_results(options.path, options.out, **given, **more):
        print(picture)
    note_incomplete(Path(options.path))
    return COMPLETE


def _table_of_columns(path: Path) -> str:
    """Return the columns of results and the numbers of their cases, each with its unit and meaning."""
    from gfmdlayer.results.reader import open_case, open_results

    with open_case(path) if path.is_file() else open_results(path) as results:
        every = {
            str(name): each.attrs for name, each in results.variables.items() if "long_name" in each.attrs
        }
    rows = [(name, str(each.get("units", "1")), str(each["long_name"])) for name, each in every.items()]
    wide = [max(len(row[i]) for row in rows) for i in (0, 1)]
    return "\n".join(f"{name:{wide[0]}}  {unit:{wide[1]}}  {meaning}" for name, unit, meaning in rows)


_REPORT = """
path DIR  results folder, or the file of one case
--out PATH  the page, .html, or folder for it (default: DIR/report.html)
--format {html,md,csv} = html  md: warnings and the table of cases in Markdown; csv: the table alone
"""


@verb(_REPORT, "gfmdlayer report results/figure2-quick")
def report(options: argparse.Namespace) -> int:
    """Write a page for the browser: curves, surfaces, cases, configuration, provenance."""
    from gfmdlayer.figures.report.page import Listed, write_report
    from gfmdlayer.files.whole import output_file
    from gfmdlayer.results.reader import open_case
    from gfmdlayer.study.folder import Folder

    path = Path(options.path)
    if path.is_file():
        out = path.with_name(f"{path.stem}-report.{options.format}")
        open_case(path).close()  # refuses a file that is no case
        number = int(path.stem) if path.stem.isdecimal() else 0
        cases, title, config = [Listed(number, path, {})], path.stem, ""
    else:
        out, folder = path / f"report.{options.format}", Folder(path)
        cases, title = _listed(folder), path.resolve().name
        config = folder.config.read_text(encoding="utf-8", errors="replace")
    print(write_report(cases, output_file(options.out, out), title, config))
    note_incomplete(path)
    return COMPLETE


def _listed(folder: Folder) -> list[Listed]:
    """Return all cases of a folder, with the state of each."""
    from gfmdlayer.config.sweeps import combinations
    from gfmdlayer.figures.report.page import Listed
    from gfmdlayer.results.stored import must_agree
    from gfmdlayer.study.status import overview

    numbers, seen = folder.case_numbers(), overview(folder)
    states = dict.fromkeys(folder.numbers()["failed"], ("failed", ""))
    states |= {record.index: ("failed", record.reason) for record in seen.failures}
    states |= dict.fromkeys(folder.numbers()["h5"], ("complete", ""))
    for case in seen.running:
        states[case.index] = "running", f"at time {case.simulated_time:g} of {case.end:g}"
    values = list(combinations(folder.stored_sweep()))
    must_agree(folder.config, numbers, len(values))
    return [
        Listed(number, folder.case(number), swept, *states.get(number, ("waiting", "")))
        for number, swept in zip(numbers, values, strict=True)
    ]


_WIDTHS = {
    "time": 10, "flow_xx": 11, "flow_yy": 11, "hydraulic_gap_x": 15, "hydraulic_gap_y": 15,
    "pressure_drop": 13, "leak_rate": 11, "leak_rate_low": 13, "leak_rate_high": 14,
    "error": 8, "imbalance": 9, "throat": 6,
}  # fmt: skip
_LEAK = """
path DIR  results folder, or the file of one case
--case N  only this case of a sweep (default: all; the first is drawn)
--along {x,y} = x  direction of the pressure drop (default: x)
--viscosity ETA  of the fluid: pressure time
--pressure-drop P ...  over the length of the seal, one or several that increase: pressure
--length L  length of the seal along the flow (default: the cell's)
--width W  width of the seal across the flow (default: the cell's)
--diameter D  of a ring, whose width is pi times it
--coupled  the fluid lifts the surface: its pressure takes the place of contact pressure along the seal
--plot  draw the leak rate over time and over the pressure drops, with its interval of doubt
--out PATH  the picture, .png, .pdf or .svg, or folder for it (default: NAME-leak.png with the results; with
  --plot NAME-leak-curve.png)
--style {paper,screen} = paper  of the picture
--trust  run the Python code that the results name as their body, for the lift
--fields PATH  write flow, pressure and all numbers of the case drawn to an .h5, or into a folder
"""
_EXAMPLE_OF_LEAK = (
    "gfmdlayer run configs/seal-quick.yaml && "
    "gfmdlayer leak results/seal-quick --viscosity 1.0e-6 --pressure-drop 1.0e-4"
)


@verb(_LEAK, _EXAMPLE_OF_LEAK)
def leak(options: argparse.Namespace) -> int:
    """Print how much a fluid leaks through the gap, from the snapshots of results."""
    from gfmdlayer.figures.field_plots import flow_figure, leak_figure
    from gfmdlayer.figures.plot_style import STYLES, check_suffix, save
    from gfmdlayer.figures.snapshots import cases_with_snapshots
    from gfmdlayer.files.whole import output_file, unfinished
    from gfmdlayer.interactive.leakage import leakage
    from gfmdlayer.results.names import ResultsError
    from gfmdlayer.results.reader import open_case, open_results

    path, style = Path(options.path), STYLES[options.style]
    written = options.fields and output_file(options.fields, Path(f"{path.resolve().stem}-leak.h5"))
    if written:
        check_suffix(written, (".h5",))
    keys = ("viscosity", "along", "length", "width", "diameter", "coupled", "trust")
    seal = {key: getattr(options, key) for key in keys}
    drops = options.pressure_drop
    seal["pressure_drop"] = drops if len(drops) > 1 else drops[0] if drops else None
    flows: dict[str, Dataset] = {}
    with open_case(path) if path.is_file() else open_results(path) as results:
        name = str(results.attrs.get("name") or path.resolve().stem)
        suffix = "leak-curve" if options.plot else "leak"
        default = (
            path.with_name(f"{path.stem}-{suffix}.png") if path.is_file() else path / f"{name}-{suffix}.png"
        )
        picture = output_file(options.out, default)
        check_suffix(picture)
        most = 1 if options.case is not None else sys.maxsize
        with cases_with_snapshots(path, results, options.case, most) as cases:
            if not cases:
                raise ResultsError(f"{path}: no snapshots; set output.snapshots and run the config again")
            first = next(iter(cases.values()))
            if options.out is not None and not options.plot and "y" not in first.dims:
                return refuse("--out: the flow along a line has no map to draw; leave --out away")
            if options.plot and (refusal := _no_curve(drops, first)):
                return refuse(refusal)
            for i, (title, case) in enumerate(cases.items()):
                label = title.replace("$", "")
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always", UserWarning)
                    flows[title] = flow = leakage(case, fields=i == 0, **seal)
                _print(label, flow, options.along)
                for warning in caught:
                    print(f"gfmdlayer: {label}{': ' * bool(label)}{warning.message}", file=sys.stderr)
                if i == 0 and written:
                    with unfinished(written, ".h5") as part:
                        flow.to_netcdf(part, engine="h5netcdf")
                    print(written)
                if i == 0 and "fluid_pressure" in flow and not options.plot:
                    save(flow_figure(flow, title, style), picture, style)
                    print(picture)
    if options.plot:
        save(leak_figure(flows, style), picture, style)
        print(picture)
    return COMPLETE


def _no_curve(drops: list[float], case: Dataset) -> str:
    """Say why there is no curve of the leak, or nothing."""
    if not drops:
        return "--plot: a curve of the leak needs --viscosity and --pressure-drop"
    if len(drops) == 1 and case.sizes["snapshot"] == 1:
        return (
            "--plot: one snapshot and one drop make no curve; give several times of --pressure-drop, or run "
            "with several output.snapshots"
        )
    return ""


def _print(title: str, flow: Dataset, along: str) -> None:
    """Print a line for each snapshot, and for each drop of the pressure."""
    columns: dict[str, Any] = {"time": flow["snapshot"]}
    columns |= {name: flow[name] for name in _WIDTHS if name in flow}
    columns["error"] = abs(flow[f"flow_error_{along}"])
    columns["imbalance"] = flow["flow_imbalance"]
    if f"throat_points_{along}" in flow:
        columns["throat"] = flow[f"throat_points_{along}"]
    if title:
        print(title)
    shown = {name: width for name, width in _WIDTHS.items() if name in columns}
    print("  ".join(f"{name:>{width}}" for name, width in shown.items()))
    print("  ".join(f"{_unit(columns, name):>{width}}" for name, width in shown.items()))
    for i, j in product(range(flow.sizes["snapshot"]), range(flow.sizes.get("pressure_drop", 1))):
        place = {"snapshot": i, "pressure_drop": j}
        row = {name: columns[name].isel(place, missing_dims="ignore") for name in shown}
        print("  ".join(f"{float(row[name]):>{width}.4g}" for name, width in shown.items()))


def _unit(columns: Mapping[str, Any], name: str) -> str:
    if name == "throat":
        return "points"
    unit = str(columns[name].attrs.get("units", "1"))
    return "" if unit == "1" else unit.replace(" ", "")
