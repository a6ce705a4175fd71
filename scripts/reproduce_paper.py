"""Reproduce Figures 2 to 4 of Petrenko et al. (2024) by the paper's method and by a fast one.

    python scripts/reproduce_paper.py                       all three, as published: some minutes
    python scripts/reproduce_paper.py --quick               1024 points and steps of 0.05 tau
    python scripts/reproduce_paper.py --figures 4 --jobs 2
    python scripts/reproduce_paper.py --inertia uniform     FIRE as published, one inertia for all wavelengths

paper   configs/figureN.yaml: FIRE, and backward Euler with dt = 0.005 tau
fast    the active set, and adaptive exponential steps at a tolerance of 1e-3
fine    the active set, and exponential steps of 0.005 tau: of second order, the reference for both

Backward differences replace G(s) by G - (dt/2) s^2 G'(s). So for one relaxing modulus the relative error of
the paper's pressure is up to dt/(2 tau). This error and the tolerance of the fast method bound the
difference. The edge of contact lies between two points: if it passes a point at a slightly different time,
each edge differs by one cell.

The results stay in DIR/figureN, DIR/figureN-fast and DIR/figureN-fine; the same command resumes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gfmdlayer.config import Config, load
from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.figures.plot_style import save, styled
from gfmdlayer.results.reader import case_path, open_case, open_results
from gfmdlayer.study.cases import SweepCase, cases, label
from gfmdlayer.study.progress import make_display
from gfmdlayer.study.run import run_study
from gfmdlayer.study.workers import WorkerPool, assemble

CONFIGS = Path(__file__).parents[1] / "configs"
TOLERANCE = 1e-3
TIMES = [*(i / 10 for i in (1, 2, 4, 6, 8, 10)), 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0]
AREA_AND_PRESSURE = ("contact_area", "mean_pressure")  # points in contact are counted, as in the paper
TARGET_PRESSURE, TARGET_RATIO = 1e-3, 300


def _active_set(tolerance: float) -> str:
    return f"solver={{method: active_set, tolerance: {tolerance}}}"


METHODS: dict[str, list[str]] = {
    "paper": [],
    "fast": [
        "time.integrator=exponential",
        "time.step=adaptive",
        f"time.tolerance={TOLERANCE}",
        f"output.times={TIMES}",
        _active_set(1e-5),
    ],
    "fine": ["time.integrator=exponential", "time.step=0.005", _active_set(1e-6)],
}


@dataclass(frozen=True)
class Comparison:
    """One case by the three methods; `title` is its swept value.

    `difference`, `own` and `fast` are the largest differences in ptilde of paper and fast, paper and fine,
    fast and fine, over the common times. `of_bound` is the first over its bound, dt/(2 tau) of ptilde plus
    the tolerance of the largest ptilde. `cells` is the largest difference of paper and fast in atilde, in
    grid cells at each edge. `pairs` and `steps` are the FFT pairs and time steps by method.
    """

    title: str
    difference: float
    own: float
    fast: float
    of_bound: float
    cells: float
    pairs: dict[str, int]
    steps: dict[str, int]

    @property
    def ratio(self) -> float:
        """FFT pairs of the paper's method over FFT pairs of the fast one."""
        return self.pairs["paper"] / self.pairs["fast"]

    @property
    def inside(self) -> bool:
        """Whether the difference is within the errors of the paper's step and the tolerance."""
        return self.of_bound <= 1 and self.cells <= 1

    def line(self) -> str:
        """Write a line of the table."""
        return (
            f"| {self.title} | {self.difference:.2e} | {self.of_bound:.2f} | {self.own:.2e} "
            f"| {self.fast:.2e} | {self.cells:g} | {self.pairs['paper']} | {self.pairs['fast']} "
            f"| {self.ratio:.0f} |"
        )


HEAD = """\
| case | paper - fast | of bound | paper - fine | fast - fine | cells | pairs: paper | fast | ratio |
|------|-------------:|---------:|-------------:|------------:|------:|-------------:|-----:|------:|"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, compare and draw; return 0 if every case is inside its bound, else 1."""
    options = _parse(arguments)
    with assemble(options.jobs) as pool:
        if pool is None:  # another rank of mpirun, which has served
            return 0
        found = [each for number in options.figures for each in reproduce(number, options, pool)]
    print("\n".join(_summary(found)))
    return 0 if all(each.inside for each in found) else 1


def reproduce(number: int, options: argparse.Namespace, pool: WorkerPool) -> list[Comparison]:
    """Run the cases of a figure by each method, draw them, and print the differences."""
    name = f"figure{number}"
    folders = {
        method: options.out / (name if method == "paper" else f"{name}-{method}") for method in METHODS
    }
    configs = {
        method: _config(f"{name}-quick" if options.quick else name, method, options) for method in METHODS
    }
    for method, config in configs.items():
        print(f"{name}, {method}:", file=sys.stderr)
        summary = run_study(config, folders[method], pool, display=lambda: make_display(sys.stderr))
        if summary.count("complete") < summary.total:
            sys.exit(f"{folders[method]}: not all cases are complete; the same command tries them again")
    every = cases(configs["paper"])
    found = [compare(case, folders) for case in every]
    print(f"\n### {name.capitalize()}: n = {every[0].config.grid.points[0]}\n\n{HEAD}")
    print("\n".join(each.line() for each in found), flush=True)
    figure = comparison_figure(folders)
    for picture in (options.out / f"{name}.png", options.out / f"{name}.pdf"):
        save(figure, picture)
        print(f"{picture}: lines, the paper's method; circles, the fast one", file=sys.stderr)
    return found


def _config(name: str, method: str, options: argparse.Namespace) -> Config:
    given = [*METHODS[method]]
    if options.points:
        given.append(f"grid.points={options.points}")
    if options.inertia and method == "paper":
        given.append(f"solver.inertia={options.inertia}")
    return load(CONFIGS / f"{name}.yaml", given)


def compare(case: SweepCase, folders: dict[str, Path]) -> Comparison:
    """Compare a case at the common times of the three methods."""
    rows: dict[str, dict[str, Any]] = {}
    for method, folder in folders.items():
        with open_case(case_path(folder, case.index)) as dataset:
            rows[method] = {
                name: dataset[name].to_numpy()
                for name in ("time", "mean_pressure", "contact_area", "transforms")
            }
    common = {method: _at(TIMES, columns["time"]) for method, columns in rows.items()}
    p, a = (
        {method: columns[name][common[method]] for method, columns in rows.items()}
        for name in ("mean_pressure", "contact_area")
    )
    step, tau = case.config.time.step, case.config.layer.material.tau  # type: ignore[union-attr]
    difference = np.abs(p["paper"] - p["fast"])
    bound = float(step) / (2 * tau) * p["fast"] + TOLERANCE * rows["fast"]["mean_pressure"].max()
    return Comparison(
        title=label(case.values),
        difference=float(difference.max()),
        own=float(np.abs(p["paper"] - p["fine"]).max()),
        fast=float(np.abs(p["fast"] - p["fine"]).max()),
        of_bound=float((difference / bound).max()),
        cells=round(float(np.abs(a["paper"] - a["fast"]).max()) * case.config.grid.points[0] / 2, 6),
        pairs={method: int(columns["transforms"].sum()) for method, columns in rows.items()},
        steps={method: columns["time"].size - 1 for method, columns in rows.items()},
    )


def _at(times: Iterable[float], rows: Any) -> list[int]:
    """Return the indices of the rows at these times."""
    places = [int(np.argmin(np.abs(rows - time))) for time in times]
    np.testing.assert_allclose(rows[places], list(times), rtol=1e-9)
    return places


def comparison_figure(folders: dict[str, Path]) -> Figure:
    """Draw the paper's two panels: lines for its method, circles for the steps of the fast one."""
    with open_results(folders["paper"]) as paper:
        figure = curves_figure(paper, y=AREA_AND_PRESSURE)
    with styled():
        for file in sorted((folders["fast"] / "cases").glob("*.h5")):
            with open_case(file) as fast:
                for axes, name in zip(figure.axes, AREA_AND_PRESSURE, strict=True):
                    axes.plot(
                        fast["time"], fast[name], "o", color="black", markersize=2.2, mfc="none", mew=0.5
                    )
    return figure


def _summary(found: list[Comparison]) -> list[str]:
    difference, cells = max(each.difference for each in found), max(each.cells for each in found)
    total = {method: sum(each.pairs[method] for each in found) for method in METHODS}
    steps = {method: sum(each.steps[method] for each in found) for method in METHODS}
    least = min(each.ratio for each in found)
    return [
        "",
        f"largest difference in ptilde: {difference:.2e} ({_verdict(difference < TARGET_PRESSURE)} "
        f"{TARGET_PRESSURE:g}), of which the paper's method {max(each.own for each in found):.2e} and the "
        f"fast one {max(each.fast for each in found):.2e}, against fine steps",
        f"largest difference in atilde: {cells:g} grid cells at each edge ({_verdict(cells <= 1)} 1)",
        f"work: {total['paper']} FFT pairs ({total['paper'] / steps['paper']:.0f} per step) over "
        f"{total['fast']} ({total['fast'] / len(found):.0f} per case), {total['paper'] / total['fast']:.0f} "
        f"times; at least {least:.0f} times ({_verdict(least >= TARGET_RATIO)} {TARGET_RATIO})",
        f"cases inside their bound: {sum(each.inside for each in found)} of {len(found)}",
    ]


def _verdict(met: bool) -> str:
    return "meets" if met else "misses"


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--figures", nargs="+", type=int, choices=(2, 3, 4), default=[2, 3, 4])
    parser.add_argument("--quick", action="store_true", help="use the -quick configs")
    parser.add_argument("--points", metavar="N", type=int, help="grid points (default: the configs')")
    parser.add_argument("--inertia", choices=("mass_weighted", "uniform"), help="inertia of the paper's FIRE")
    parser.add_argument("--jobs", metavar="N", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--out", metavar="DIR", type=Path, help="(default: results/paper, or paper-quick)")
    options = parser.parse_args(arguments)
    options.out = options.out or Path("results") / ("paper-quick" if options.quick else "paper")
    return options


if __name__ == "__main__":
    sys.exit(main())
