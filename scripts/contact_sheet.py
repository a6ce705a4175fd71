"""Draw contact sheets to look at: every kind of picture of every quick configuration, also in SI units.

    python scripts/contact_sheet.py sheets              # some minutes; sheets/NAME.png for each run
    python scripts/contact_sheet.py sheets --only figure2-quick experiment

The runs are on coarse grids, in few steps. tests/figures/test_everything.py checks the same pictures.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

import gfmdlayer
from gfmdlayer.config import Config, load
from gfmdlayer.figures.body_plot import body_figure, config_of
from gfmdlayer.figures.curve_plots import curves_figure, loop_figure
from gfmdlayer.figures.field_plots import inside_figure, stick_figure
from gfmdlayer.figures.labels import SCALES
from gfmdlayer.figures.map_plots import map_figure
from gfmdlayer.figures.movies import animated
from gfmdlayer.figures.plot_style import PAPER, SCREEN, Style, styled
from gfmdlayer.figures.selection import case_dimensions, case_titles, swept, varying
from gfmdlayer.figures.snapshots import (
    Inset,
    cases_with_snapshots,
    snapshots_figure,
    waterfall_figure,
)
from gfmdlayer.results.names import FIELDS, ResultsError
from gfmdlayer.results.reader import open_results
from gfmdlayer.validation.units import Units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "scripts"))
import figure_sheet  # noqa: E402

CONFIGS = {path.stem: path for path in sorted((ROOT / "configs").glob("*-quick.yaml"))}
OTHERS = tuple(dict.fromkeys(each.run for each in figure_sheet.PICTURES))
NAMES = (*CONFIGS, *OTHERS)
ALSO_IN_SI = ("figure2-quick", "cylinder-rolling-quick", "samples", "rough")
LONGER, TOLERANCE, VALUES, PANELS = 5, 0.05, 3, 9
SI = Units(length="m", stress="Pa", time="s")
SIZES = {"length": 1e-4, "pressure": 2e6, "time": 5e-3}  # of L, G0 and tau
DPI, COLUMNS, WIDTH, GAP = 110, 3, 760, 12

Picture = tuple[str, Callable[[], "Figure"], "Style"]


def run(name: str, folder: Path) -> Path:
    """Run a configuration on a coarse grid, in few steps, with few values; return its folder."""
    out = folder / name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if name in CONFIGS:
            gfmdlayer.run(CONFIGS[name], out=out, progress=False, **cut(load(CONFIGS[name])))
        else:
            (folder / f"{name}-files").mkdir(parents=True, exist_ok=True)
            every = figure_sheet.runs(figure_sheet.SMALL, folder / f"{name}-files")
            gfmdlayer.run({"name": name} | every[name], out=out, progress=False)
    return out


def cut(config: Config) -> dict[str, Any]:
    """Return the keys that make a configuration cheap."""
    step, swept_values = config.time.step, config.sweep.items()
    values: dict[str, Any] = {"grid.points": 128 if len(config.grid.points) == 1 else [32, 32]}
    values |= {"time.tolerance": TOLERANCE} if step == "adaptive" else {"time.step": LONGER * step}
    values |= {"time.end": 60.0} if config.time.steady else {}
    values |= {} if config.output.snapshots else {"output.snapshots": "every"}
    values |= {"punch.short_cutoff": 0.1} if getattr(config.punch, "short_cutoff", 1.0) < 0.1 else {}
    if config.sweep and all(isinstance(each, list) for _, each in swept_values):
        values["sweep"] = {key: each[:VALUES] for key, each in swept_values}
    return values


def in_si(data: Dataset) -> Dataset:
    """Return dimensionless results in metres, pascals and seconds: a cell of 0.1 mm, 2 MPa, 5 ms."""
    every = {}
    for name, each in data.variables.items():
        words = str(each.attrs.get("units", "1"))
        size = 1.0
        for over, part, power in re.findall(r"(/?)\s*([a-z]+)(?:\^(\d+))?", words):
            of = SIZES["pressure"] * SIZES["length"] ** 2 if part == "force" else SIZES.get(part, 1.0)
            size *= of ** (int(power or 1) * (-1 if over else 1))
        is_known = words != "1" and each.dtype.kind in "if"
        about = {**each.attrs, **({"units": SI.label(words)} if words != "1" else {})}
        every[name] = (each.dims, each.to_numpy() * size if is_known else each.to_numpy(), about)
    scales = [scale for scale, _ in SCALES.values()]
    kept = {key: value for key, value in data.attrs.items() if key not in scales}
    coordinates = {name: every.pop(name) for name in list(every) if name in data.coords}
    return type(data)(every, coordinates, kept)


def pictures(path: Path) -> Iterator[Picture]:
    """Yield the pictures of the results in a folder: a title, a function that draws it, its style."""
    with ExitStack() as stack:
        results = stack.enter_context(open_results(path))
        if "case" in results.coords:  # whose surfaces may differ in their times
            results = results.drop_vars([name for name in FIELDS if name in results]).load()
        opened = stack.enter_context(cases_with_snapshots(path, results, None, 2))
        cases = {title: case.load() for title, case in opened.items()}
        config, which = config_of(path, None)
        yield "body", lambda: body_figure(config, title=which), PAPER
        yield "loop", lambda: loop_figure(path, results), PAPER
        if "slip_heat" in results:
            yield "loop along the surface", lambda: loop_figure(path, results, y="tangential_force"), PAPER
        yield from _of(results, cases, "")
        if path.name in ALSO_IN_SI:
            si = in_si(results)
            yield from _of(si, dict(zip(titles(si, cases), map(in_si, cases.values()), strict=True)), "SI ")


def titles(results: Dataset, cases: dict[str, Dataset]) -> list[str]:
    """Return the titles of cases with the swept values of results in other units."""
    if "case" not in results.coords:  # the only one
        return list(cases)
    every = dict(zip(results["case"].to_numpy().flat, case_titles(results).values(), strict=True))
    return [every[int(case["case"])] for case in cases.values()]


def _of(results: Dataset, cases: dict[str, Dataset], prefix: str) -> Iterator[Picture]:
    along = {"time", "row", *case_dimensions(results)}
    over_time = [name for name, each in results.data_vars.items() if {"time", "row"} & {*each.dims}]
    columns = [str(name) for name in over_time if {*results[name].dims} <= along]
    numbers, _ = varying(results, [name for name in columns if np.isfinite(results[name]).any()])
    for i in range(0, len(numbers), PANELS):
        part = numbers[i : i + PANELS]
        yield f"{prefix}columns {i}", lambda part=part: curves_figure(results, y=part), PAPER
    yield f"{prefix}one column", lambda: curves_figure(results, 1, log=["x"]), PAPER
    yield f"{prefix}talk", lambda: curves_figure(results, style=SCREEN), SCREEN
    depth = "depth_over_time" if "depth_over_time" in results else "depth"
    yield f"{prefix}any", lambda: curves_figure(results, x=depth, y=["force"]), PAPER
    keys = [str(key.name) for key in swept(results) if key.ndim]
    for key in keys:
        yield f"{prefix}key {key}", lambda key=key: curves_figure(results, x=key, time="max"), PAPER
    if "slip_heat" in results:
        yield (
            f"{prefix}slip",
            lambda: curves_figure(results, x="tangential_displacement", y=["friction"]),
            PAPER,
        )
    if len(keys) > 1:
        yield f"{prefix}map", lambda: map_figure(results, z=["force", "work"]), PAPER
    title, first = next(iter(cases.items()), ("", None))
    if first is None:
        return
    times = first["snapshot"].to_numpy()[[0, -1]].tolist()
    if "gap" in first:
        inset = lambda: curves_figure(results, inset=Inset.of(first, times))  # noqa: E731
        yield f"{prefix}inset", inset, PAPER
    yield f"{prefix}snapshots", lambda: snapshots_figure({title: first}), PAPER
    if len(cases) > 1:
        yield f"{prefix}cases", lambda: snapshots_figure(cases), PAPER
    if "shear_x" in first:
        yield f"{prefix}stick", lambda: stick_figure(first, title), PAPER
    if "von_mises" in first:
        yield f"{prefix}inside", lambda: inside_figure(first, "", title), PAPER
    yield f"{prefix}waterfall", lambda: waterfall_figure(first, title), PAPER
    for style in (PAPER, SCREEN) if not prefix else (SCREEN,):
        yield f"{prefix}movie", lambda style=style: _frame(first, title, style), style


def _frame(case: Dataset, title: str, style: Style) -> Figure:
    """Draw the last frame of a movie."""
    with styled(style):
        figure, show = animated(case, title, style)
        show(case.sizes["snapshot"] - 1)
    return figure


def sheet(drawn: Sequence[Image.Image]) -> Image.Image:
    """Put each picture into the shortest column."""
    ends, places = [GAP] * COLUMNS, []
    for each in drawn:
        column = int(np.argmin(ends))
        places.append((GAP + column * (WIDTH + GAP), ends[column]))
        ends[column] += each.height + GAP
    whole = Image.new("RGB", (GAP + COLUMNS * (WIDTH + GAP), max(ends)), "lightgrey")
    for each, place in zip(drawn, places, strict=True):
        whole.paste(each, place)
    return whole


def image(figure: Figure, style: Style, folder: Path) -> Image.Image:
    """Return a figure as it looks on a page."""
    with styled(style):
        figure.savefig(folder / "a.png", dpi=DPI / style.scale)
    with Image.open(folder / "a.png") as found:
        return found.convert("RGB").crop((0, 0, min(found.width, WIDTH), found.height))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the configurations and write the sheets."""
    look = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=look)
    parser.add_argument("out", metavar="DIR", type=Path, help="folder of the sheets")
    parser.add_argument("--only", metavar="NAME", nargs="+", choices=NAMES, default=NAMES)
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        for name in options.only:
            drawn = []
            for title, draw, style in pictures(run(name, Path(scratch))):
                try:
                    drawn.append(image(draw(), style, Path(scratch)))
                except ResultsError as error:
                    print(f"{name}, {title}: {error}")
            sheet(drawn).save(options.out / f"{name}.png")
            print(options.out / f"{name}.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
