"""Draw the contact sheet docs/figures.png: twelve pictures of `gfmdlayer plot` from quick runs.

    python scripts/figure_sheet.py                       # about a minute
    python scripts/figure_sheet.py --small --out x.png   # a test: coarse grids, few steps

The caption of each picture has its options of `gfmdlayer plot`.
"""

from __future__ import annotations

import argparse
import shlex
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from gfmdlayer.cli import main as gfmdlayer
from gfmdlayer.config import Config
from gfmdlayer.figures.movies import animated
from gfmdlayer.figures.plot_style import PAPER, WIDTH_MM, save, styled
from gfmdlayer.results.reader import open_case
from gfmdlayer.study.run import run_study
from gfmdlayer.study.workers import WorkerPool, assemble

DEFAULT_SHEET = Path(__file__).parents[1] / "docs" / "figures.png"
COLUMNS, WIDTH, GAP, LETTERS = 3, 620, 24, 15  # dots
SMALL = {"grid": 64, "surface": 16, "step": 0.25}
FULL = {"grid": 1024, "surface": 96, "step": 0.05}


class Picture(NamedTuple):
    """A picture of the sheet: its run, and its options of `gfmdlayer plot`."""

    run: str
    options: str


PICTURES = (
    Picture("thicknesses", "--case 2 --inset 0.5 8"),
    Picture("experiment", "--kind curves"),
    Picture("cycles", "--x depth --y force"),
    Picture("three_keys", "--kind curves --log x"),
    Picture("three_keys", "--x thickness --y mean_pressure contact_area --select poisson=0.5"),
    Picture("failures", "--kind map --z mean_pressure dissipated --time max"),
    Picture("samples", "--kind map --x thickness --y Ginf"),
    Picture("shapes", "--kind curves"),
    Picture("shapes", "--kind snapshots --select punch=parabola"),
    Picture("ball", "--kind waterfall"),
    Picture("rough", "--kind snapshots"),
    Picture("ball", "--movie"),
)


def runs(size: dict[str, Any], folder: Path) -> dict[str, dict[str, Any]]:
    """Return the configurations by name; write the loading cycles to a file in the folder."""
    table = folder / "cycle.txt"
    table.write_text("0 0\n1 0.01\n2 0\n3 0.01\n4 0\n")
    steps = {"step": size["step"], "integrator": "exponential"}
    line = {"grid": {"points": size["grid"]}, "solver": {"method": "active_set"}}
    surface = line | {"grid": {"points": [size["surface"]] * 2}}
    zener = {"model": "zener", "G0": 1.0, "tau": 1.0}
    return {
        "thicknesses": line
        | {
            "time": steps | {"end": 8.0},
            "halfspace": {"shear_modulus": 10.0},
            "output": {"snapshots": [0.5, 8.0]},
            "sweep": {"layer.thickness": [0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, np.inf]},
        },
        "experiment": surface
        | {
            "units": {"length": "m", "stress": "Pa", "time": "s"},
            "grid": {"points": [size["surface"]] * 2, "period": 4e-3},
            "layer": {"thickness": 2e-4, "material": {"model": "zener", "G0": 1e6, "Ginf": 1e7, "tau": 1e-3}},
            "halfspace": {"shear_modulus": np.inf},
            "punch": {"shape": "sphere", "radius": 5e-3},
            "trajectory": {"control": "force", "force": 1.0, "ramp_time": 1e-3},
            "time": {"end": 2e-2, "step": 4e-3 * size["step"], "integrator": "exponential"},
            "sweep": {"trajectory.force": [0.1, 0.3, 1.0]},
        },
        "cycles": line
        | {
            "time": steps | {"end": 4.0},
            "trajectory": {"kind": "table", "file": str(table)},
            "sweep": {"layer.material.tau": [0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0]},
        },
        "three_keys": line
        | {
            "time": steps | {"end": 8.0},
            "sweep": {
                "layer.thickness": [0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, np.inf],
                "halfspace.shear_modulus": [0.1, 1, 10],
                "layer.poisson": [0.3, 0.4, 0.5],
            },
        },
        "failures": line
        | {
            "grid": {"points": size["grid"] // 4},
            "time": steps | {"end": 4.0, "step": 0.25},
            "solver": {"method": "fire", "max_iterations": 70},
            "sweep": {
                "layer.material.Ginf": [1.5, 2.0, 5.0, 10.0, 20.0, 50.0],
                "layer.thickness": [0.01, 0.02, 0.05, 0.1, 0.2, 0.5],
            },
        },
        "samples": line
        | {
            "time": steps | {"end": 4.0},
            "sweep": {
                "sobol": {
                    "samples": 32,
                    "layer.thickness": {"from": 0.01, "to": 1.0, "scale": "log"},
                    "halfspace.shear_modulus": {"from": 0.1, "to": 100.0, "scale": "log"},
                    "layer.material.Ginf": {"from": 2.0, "to": 50.0, "scale": "log"},
                }
            },
        },
        "shapes": line
        | {
            "time": steps | {"end": 4.0},
            "output": {"snapshots": [0.25 * i for i in range(1, 17)]},
            "sweep": {
                "punch": [
                    {"shape": "parabola", "radius": 0.25},
                    {"shape": "parabola", "radius": 0.5},
                    {"shape": "cylinder", "radius": 0.5},
                    {"shape": "wedge", "slope": 0.2},
                ],
                "layer.material": [zener | {"Ginf": 10.0}, zener | {"Ginf": 2.0}],
            },
        },
        "rough": surface
        | {
            "layer": {"thickness": 0.2},
            "halfspace": {"shear_modulus": np.inf},
            "punch": {
                "shape": "self_affine",
                "hurst": 0.8,
                "roll_off": 0.5,
                "short_cutoff": 0.15,
                "rms_slope": 0.1,
                "seed": 1,
            },
            "trajectory": {"control": "load", "load": 0.05},
            "time": steps | {"end": 3.0},
            "output": {"snapshots": [0.25 * i for i in range(1, 13)]},
        },
        "ball": surface
        | {
            "punch": {"shape": "sphere", "radius": 1.0},
            "trajectory": {"control": "load", "load": 0.02},
            "time": steps | {"end": 4.0},
            "output": {"snapshots": [0.25 * i for i in range(1, 17)]},
        },
    }


def draw(picture: Picture, folder: Path, out: Path) -> None:
    """Draw a picture with the command line; for a movie, its middle frame."""
    if "--movie" in picture.options:
        with open_case(folder / "cases" / "0000.h5") as case, styled(PAPER):
            figure, show = animated(case, "", PAPER)
            show(case.sizes["snapshot"] // 2)
            save(figure, out)
    elif status := gfmdlayer(["plot", str(folder), "--out", str(out), *shlex.split(picture.options)]):
        raise SystemExit(f"gfmdlayer plot {picture.options}: exit status {status}")


def sheet(pictures: Sequence[tuple[str, Path]]) -> Image.Image:
    """Put each picture under its caption into the shortest column."""
    font = ImageFont.truetype(font_manager.findfont("DejaVu Sans Mono"), LETTERS)
    placed, ends = [], [GAP] * COLUMNS
    for caption, path in pictures:
        with Image.open(path) as whole:
            scale = WIDTH / (WIDTH_MM[2] / 25.4 * PAPER.dpi)
            part = whole.convert("RGB").resize((round(whole.width * scale), round(whole.height * scale)))
        column = int(np.argmin(ends))
        placed.append((caption, part, (GAP + column * (WIDTH + GAP), ends[column])))
        ends[column] += part.height + 2 * LETTERS + GAP
    found = Image.new("RGB", (GAP + COLUMNS * (WIDTH + GAP), max(ends)), "white")
    pen = ImageDraw.Draw(found)
    for caption, part, (x, y) in placed:
        pen.text((x, y), caption, "black", font)
        found.paste(part, (x, y + 2 * LETTERS))
    return found.quantize(256, dither=Image.Dither.NONE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases, draw the pictures, and write the sheet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--small", action="store_true", help="coarse grids, few steps")
    parser.add_argument("--only", metavar="RUN", nargs="+", help="only the pictures of these runs")
    parser.add_argument("--runs", metavar="DIR", type=Path, help="keep the runs in this folder")
    parser.add_argument("--out", metavar="FILE", type=Path, default=DEFAULT_SHEET)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as scratch, assemble() as pool:
        if pool is None:  # another rank of mpirun, which has served
            return 0
        chosen = [each for each in PICTURES if options.only is None or each.run in options.only]
        folder = options.runs or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        _run_all({each.run for each in chosen}, SMALL if options.small else FULL, folder, pool)
        drawn = []
        for i, picture in enumerate(chosen):
            out = Path(scratch) / f"{i}.png"
            draw(picture, folder / picture.run, out)
            drawn.append((picture.options, out))
        sheet(drawn).save(options.out, optimize=True)
    return 0


def _run_all(names: set[str], size: dict[str, Any], folder: Path, pool: WorkerPool) -> None:
    for name, values in runs(size, folder).items():
        if name in names:
            run_study(Config(name=name, **values), folder / name, pool)


if __name__ == "__main__":
    raise SystemExit(main())
