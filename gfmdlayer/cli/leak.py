"""`gfmdlayer leak`: how much a fluid leaks through the gap, from the snapshots of results."""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfmdlayer.cli.terminal import COMPLETE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from xarray import Dataset

EXAMPLE = (
    "gfmdlayer run configs/seal-quick.yaml && "
    "gfmdlayer leak results/seal-quick --viscosity 1.0e-6 --pressure-drop 1.0e-4"
)

_SHOWN = (
    ("time", 10),
    ("flow_xx", 11),
    ("flow_yy", 11),
    ("hydraulic_gap_x", 15),
    ("hydraulic_gap_y", 15),
    ("leak_rate", 11),
    ("error", 8),
    ("imbalance", 9),
    ("throat", 6),
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("path", metavar="DIR", help="results folder, or the file of one case")
    parser.add_argument(
        "--case", metavar="N", type=int, help="only this case of a sweep (default: all; the first is drawn)"
    )
    parser.add_argument(
        "--along", choices=("x", "y"), default="x", help="direction of the pressure drop (default: x)"
    )
    parser.add_argument("--viscosity", metavar="ETA", type=float, help="of the fluid: pressure time")
    parser.add_argument(
        "--pressure-drop", metavar="P", type=float, help="over the length of the seal: pressure"
    )
    parser.add_argument(
        "--length", metavar="L", type=float, help="length of the seal along the flow (default: the cell's)"
    )
    parser.add_argument(
        "--width", metavar="W", type=float, help="width of the seal across the flow (default: the cell's)"
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        help="the picture, .png, .pdf or .svg (default: NAME-leak.png with the results)",
    )
    parser.add_argument("--style", choices=("paper", "screen"), default="paper", help="of the picture")
    parser.add_argument(
        "--fields", metavar="FILE", help="write flow, pressure and all numbers of the case drawn to an .h5"
    )


def leak(options: argparse.Namespace) -> int:
    """Print the flow at each snapshot of results, and draw the flow of one case."""
    from gfmdlayer.figures.interface_plots import flow_figure
    from gfmdlayer.figures.plot_style import STYLES, check_suffix, save
    from gfmdlayer.figures.snapshot_plots import cases_with_snapshots
    from gfmdlayer.files.whole import unfinished
    from gfmdlayer.interactive.leakage import leakage
    from gfmdlayer.results.reader import open_case, open_results
    from gfmdlayer.results.schema import ResultsError

    path, style = Path(options.path), STYLES[options.style]
    if options.fields is not None:
        check_suffix(Path(options.fields), (".h5",))
    seal = {
        name: getattr(options, name) for name in ("viscosity", "pressure_drop", "along", "length", "width")
    }
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
    columns |= {name: found[name] for name, _ in _SHOWN if name in found}
    columns["error"] = abs(found[f"flow_error_{along}"])
    columns["imbalance"] = found["flow_imbalance"]
    if f"throat_points_{along}" in found:
        columns["throat"] = found[f"throat_points_{along}"]
    if title:
        print(title)
    print("  ".join(f"{name:>{width}}" for name, width in _SHOWN if name in columns))
    print("  ".join(f"{_unit(columns, name):>{width}}" for name, width in _SHOWN if name in columns))
    for i in range(found.sizes["snapshot"]):
        values = ((float(columns[name][i]), width) for name, width in _SHOWN if name in columns)
        print("  ".join(f"{value:>{width}.4g}" for value, width in values))


def _unit(columns: Mapping[str, Any], name: str) -> str:
    if name == "throat":
        return "points"
    unit = str(columns[name].attrs.get("units", "1"))
    return "" if unit == "1" else unit.replace(" ", "")
