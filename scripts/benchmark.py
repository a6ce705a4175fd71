"""Work of a time step in FFT pairs, and time over the time of the bare FFT pairs.

All results are counts, or ratios of times of tasks that run in turns; so they hold on other machines too.

    python scripts/benchmark.py                     all sections: some minutes
    python scripts/benchmark.py --quick             small grids: about a minute
    python scripts/benchmark.py --only pairs whole_run --points 16384
    python scripts/benchmark.py --only overhead --cases 10000
    python scripts/benchmark.py --only sweep --against ../other-checkout
    python scripts/benchmark.py --json all.json --markdown all.md
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib import import_module
from pathlib import Path

from benchmarks.common import Effort, Table

from gfmdlayer.grid.library import library
from gfmdlayer.results.provenance import provenance

# A section is a module of scripts/benchmarks with `measure(effort)`, which yields tables, and the efforts
# `EFFORT` and `QUICK`. The first line of its docstring is its help. To add a section, add its name.
NAMES = (
    "iteration",
    "pairs",
    "whole_run",
    "overhead",
    "sweep",
    "first_use",
    "ranks",
    "slabs",
    "roofline",
    "peer",
    "rough",
    "ablation",
    "indentation",
    "adhesion",
)
SECTIONS = {name: import_module(f"benchmarks.{name}") for name in NAMES}
OPTIONAL = (
    "first_use",
    "ranks",
    "slabs",
    "roofline",
    "peer",
    "rough",
    "ablation",
    "adhesion",
)  # --quick omits them


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure the sections and write their tables."""
    options = _parse(arguments)
    tables: list[Table] = []
    machine = _machine()
    print("\n".join(f"- {key}: {value}" for key, value in machine.items()), end="\n\n")
    try:
        for name in options.only or [name for name in SECTIONS if not (options.quick and name in OPTIONAL)]:
            print(f"measuring {name} ...", file=sys.stderr, flush=True)
            for table in SECTIONS[name].measure(_effort(name, options)):
                print(table.markdown(), flush=True)
                tables.append(table)
    finally:  # tables of other sections survive a failure
        _write(tables, machine, options)


def _write(tables: Sequence[Table], machine: dict[str, str], options: argparse.Namespace) -> None:
    if options.markdown:
        options.markdown.write_text("\n".join(table.markdown() for table in tables), encoding="utf-8")
    if options.json:
        content = {"machine": machine, "tables": {table.name: asdict(table) for table in tables}}
        options.json.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    sections = "\n".join(f"    {name:11} {_first_line(module.__doc__)}" for name, module in SECTIONS.items())
    parser = argparse.ArgumentParser(
        description=f"{__doc__}\nSections\n{sections}", formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--quick", action="store_true", help="small grids, few steps and repetitions")
    add("--large", action="store_true", help="also FFT pairs of the active set at n = 2^20")
    add("--only", nargs="+", choices=SECTIONS, metavar="NAME", help="only these sections")
    add("--points", nargs="+", type=_positive, metavar="N", help="grid points (default: the section's)")
    add(
        "--steps", type=_positive, metavar="N", help="time steps, or simulated cases (default: the section's)"
    )
    add("--cases", type=_positive, metavar="N", help="cases of a sweep (default: the section's)")
    add("--repetitions", type=_positive, metavar="N", help="repetitions of each measured time")
    add("--against", type=Path, metavar="PATH", help="another checkout, which takes turns (for sweep)")
    add("--json", type=Path, metavar="FILE", help="write the tables and a description of the machine")
    add("--markdown", type=Path, metavar="FILE", help="write the tables")
    options = parser.parse_args(arguments)
    for file in (options.json, options.markdown):
        if file and not file.parent.is_dir():
            parser.error(f"{file}: no folder {file.parent}")
    if options.against and not (options.against / "gfmdlayer" / "__init__.py").is_file():
        parser.error(f"--against {options.against}: no checkout of gfmdlayer")
    return options


def _first_line(text: str | None) -> str:
    return (text or "").partition("\n")[0].rstrip(".")


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be 1 or more")
    return value


def _effort(name: str, options: argparse.Namespace) -> Effort:
    section = SECTIONS[name]
    effort: Effort = section.QUICK if options.quick else section.EFFORT
    given = {
        key: value for key in ("steps", "repetitions", "cases", "against") if (value := getattr(options, key))
    }
    points = tuple(options.points or effort.points)
    if options.large and name == "pairs":
        points += (section.LARGE,)
    return replace(effort, points=points, **given)


def _machine() -> dict[str, str]:
    software = {key: value for key, value in provenance().items() if key != "hostname"}
    return {"cpu": _cpu(), "fftw": library().version, "system": platform.platform(), **software}


def _cpu() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
