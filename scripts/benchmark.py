"""How much work a time step takes, and how near it comes to its FFT pairs.

Every figure is a count, or a ratio of times taken in turns within the run, so that it holds elsewhere.

    python scripts/benchmark.py                     all sections: some minutes
    python scripts/benchmark.py --quick             a look: about a minute
    python scripts/benchmark.py --only pairs run --points 16384
    python scripts/benchmark.py --only overhead --cases 10000
    python scripts/benchmark.py --json all.json --markdown all.md --plot work.png

Sections
    iteration   a FIRE iteration over its bare FFT pairs
    pairs       FFT pairs per step, and what the ingredients of FIRE bring
    run         a whole run over its bare FFT pairs
    work        error against work: integrator, solver, step length
    ranks       Figures 2 to 4 on two MPI ranks against one
    overhead    what a case of a sweep costs beside its solves, alone and over two ranks
    peer        the same halfspace by Tamaas, where it is installed (extra `bench`)
    rough       a rough surface in two dimensions: a viscoelastic run, an elastic halfspace beside Tamaas
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import pyfftw
from benchmarks import iteration, overhead, pairs, peer, ranks, rough, whole_run, work
from benchmarks.tables import Effort, Table

from gfmdlayer.figures.plot_style import check_suffix
from gfmdlayer.results.provenance import provenance
from gfmdlayer.results.schema import ResultsError

SECTIONS = {
    "iteration": iteration,
    "pairs": pairs,
    "run": whole_run,
    "work": work,
    "overhead": overhead,
    "ranks": ranks,
    "peer": peer,
    "rough": rough,
}
QUICK = ("iteration", "pairs", "run", "overhead")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure the asked sections and write what they find."""
    asked = _parse(arguments)
    tables: list[Table] = []
    machine = _machine()
    print("\n".join(f"- {key}: {value}" for key, value in machine.items()), end="\n\n")
    for name in asked.only or (QUICK if asked.quick else SECTIONS):
        print(f"measuring {name} ...", file=sys.stderr, flush=True)
        for table in SECTIONS[name].measure(_effort(name, asked)):
            print(table.markdown(), flush=True)
            tables.append(table)
    if asked.markdown:
        asked.markdown.write_text("\n".join(table.markdown() for table in tables), encoding="utf-8")
    if asked.json:
        found = {"machine": machine, "tables": {table.name: asdict(table) for table in tables}}
        asked.json.write_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small grids, few steps and repetitions")
    parser.add_argument("--large", action="store_true", help="FFT pairs of the active set at n = 2^20 too")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, metavar="NAME", help=", ".join(SECTIONS))
    parser.add_argument(
        "--points", nargs="+", type=_positive, metavar="N", help="grid points in place of a section's own"
    )
    parser.add_argument(
        "--steps", type=_positive, metavar="N", help="time steps, or cases, in place of a section's own"
    )
    parser.add_argument(
        "--cases", type=_positive, metavar="N", help="of the sweep whose overhead is measured"
    )
    parser.add_argument("--repetitions", type=_positive, metavar="N", help="of each measured time")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything, with the machine")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the tables")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw error against work (.png, .pdf, .svg)"
    )
    asked = parser.parse_args(arguments)
    for file in (asked.json, asked.markdown, asked.plot):
        if file and not file.parent.is_dir():
            parser.error(f"{file}: there is no folder {file.parent}")
    if asked.plot:
        try:
            check_suffix(asked.plot)
        except ResultsError as error:
            parser.error(str(error))
    return asked


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be 1 or more")
    return value


def _effort(name: str, asked: argparse.Namespace) -> Effort:
    section = SECTIONS[name]
    effort: Effort = section.QUICK if asked.quick else section.EFFORT
    given = {
        key: getattr(asked, key) for key in ("steps", "repetitions", "cases", "plot") if getattr(asked, key)
    }
    points = tuple(asked.points or effort.points)
    if asked.large and name == "pairs":
        points += (pairs.LARGE,)
    return replace(effort, points=points, **given)


def _machine() -> dict[str, str]:
    software = {key: value for key, value in provenance().items() if key != "hostname"}
    return {"cpu": _cpu(), "fftw": pyfftw.fftw_version, "system": platform.platform(), **software}


def _cpu() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
