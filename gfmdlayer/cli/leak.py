"""`gfmdlayer leak`: how much a fluid leaks through the gap, from the snapshots of results."""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfmdlayer.cli.terminal import COMPLETE, arguments

if TYPE_CHECKING:
    from collections.abc import Mapping

    from xarray import Dataset

EXAMPLE = (
    "gfmdlayer run configs/seal-quick.yaml && "
    "gfmdlayer leak results/seal-quick --viscosity 1.0e-6 --pressure-drop 1.0e-4"
)

_WIDTHS = {
    "time": 10, "flow_xx": 11, "flow_yy": 11, "hydraulic_gap_x": 15, "hydraulic_gap_y": 15, "leak_rate": 11,
    "error": 8, "imbalance": 9, "throat": 6,
}  # fmt: skip


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    text = """
    path DIR  results folder, or the file of one case
    --case N  only this case of a sweep (default: all; the first is drawn)
    --along {x,y} = x  direction of the pressure drop (default: x)
    --viscosity ETA  of the fluid: pressure time
    --pressure-drop P  over the length of the seal: pressure
    --length L  length of the seal along the flow (default: the cell's)
    --width W  width of the seal across the flow (default: the cell's)
    --out FILE  the picture, .png, .pdf or .svg (default: NAME-leak.png with the results)
    --style {paper,screen} = paper  of the picture
    --fields FILE  write flow, pressure and all numbers of the case drawn to an .h5
    """
    arguments(parser, text)


def leak(options: argparse.Namespace) -> int:
    """Print the flow at each snapshot of results, and draw the flow of one case."""
    from gfmdlayer.figures.field_plots import flow_figure
    from gfmdlayer.figures.plot_style import STYLES, check_suffix, save
    from gfmdlayer.figures.snapshot_plots import cases_with_snapshots
    from gfmdlayer.files.whole import unfinished
    from gfmdlayer.interactive.leakage import leakage
    from gfmdlayer.results.reader import open_case, open_results
    from gfmdlayer.results.schema import ResultsError

    path, style = Path(options.path), STYLES[options.style]
    if options.fields is not None:
        check_suffix(Path(options.fields), (".h5",))
    keys = ("viscosity", "pressure_drop", "along", "length", "width")
    seal = {key: getattr(options, key) for key in keys}
    with open_case(path) if path.is_file() else open_results(path) as results:
        name = str(results.attrs.get("name") or path.resolve().stem)
        default = path.with_name(f"{path.stem}-leak.png") if path.is_file() else path / f"{name}-leak.png"
        picture = default if options.out is None else Path(options.out)
        check_suffix(picture)
        most = 1 if options.case is not None else sys.maxsize
        with cases_with_snapshots(path, results, options.case, most) as cases:
            if not cases:
                raise ResultsError(f"{path}: no snapshots; set output.snapshots and run the config again")
            for i, (title, case) in enumerate(cases.items()):
                label = title.replace("$", "")
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always", UserWarning)
                    found = leakage(case, fields=i == 0, **seal)
                _print(label, found, options.along)
                for each in caught:
                    print(f"gfmdlayer: {label}{': ' * bool(label)}{each.message}", file=sys.stderr)
                if i > 0:
                    continue
                if options.fields is not None:
                    with unfinished(Path(options.fields), ".h5") as part:
                        found.to_netcdf(part, engine="h5netcdf")
                    print(options.fields)
                if "fluid_pressure" in found:
                    save(flow_figure(found, title, style), picture, style)
                    print(picture)
    return COMPLETE


def _print(title: str, found: Dataset, along: str) -> None:
    """Print a line for each snapshot."""
    columns: dict[str, Any] = {"time": found["snapshot"]}
    columns |= {name: found[name] for name in _WIDTHS if name in found}
    columns["error"] = abs(found[f"flow_error_{along}"])
    columns["imbalance"] = found["flow_imbalance"]
    if f"throat_points_{along}" in found:
        columns["throat"] = found[f"throat_points_{along}"]
    if title:
        print(title)
    shown = {name: width for name, width in _WIDTHS.items() if name in columns}
    print("  ".join(f"{name:>{width}}" for name, width in shown.items()))
    print("  ".join(f"{_unit(columns, name):>{width}}" for name, width in shown.items()))
    for i in range(found.sizes["snapshot"]):
        print("  ".join(f"{float(columns[name][i]):>{width}.4g}" for name, width in shown.items()))


def _unit(columns: Mapping[str, Any], name: str) -> str:
    if name == "throat":
        return "points"
    unit = str(columns[name].attrs.get("units", "1"))
    return "" if unit == "1" else unit.replace(" ", "")
