"""The command line: verbs of a few lines each that call the library.

Nothing heavy is imported before a verb needs it, so that help and `check` answer at once.

Exit status: 0 all cases complete; 1 some case failed; 2 bad input; 75 stopped by a signal, resumable.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.executors import Team

COMPLETE, FAILED, REFUSED, RESUMABLE = 0, 1, 2, 75
LISTED = 20  # entries of a list before it is cut short

STATUSES = (
    "exit status: 0 all cases complete; 1 some case failed; 2 bad input; 75 stopped by a signal, resumable"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    options = _parser().parse_args(arguments)
    try:
        status: int = options.verb(options)
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read our output has seen enough; Python must not try to write the rest when it exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return COMPLETE
    return status


def run(options: argparse.Namespace) -> int:
    """Run the cases that are not complete yet."""
    from gfmdlayer import executors, interrupts, sweep

    executors.one_thread_each(os.environ)
    interrupts.listen()
    try:
        with executors.assemble(options.jobs, sweep.prepare) as team:
            return COMPLETE if team is None else _run(options, team)
    except executors.LauncherError as error:
        return _refuse(str(error))


def _run(options: argparse.Namespace, team: Team) -> int:
    from gfmdlayer.config import ConfigError, load
    from gfmdlayer.folder import FolderError
    from gfmdlayer.progress import report_to
    from gfmdlayer.results.schema import ResultsError
    from gfmdlayer.sweep import objections, run_sweep

    try:
        config = load(options.config, options.set, objections)
        directory = _default_directory(config) if options.out is None else options.out
        summary = run_sweep(config, directory, team, options.restart, lambda: report_to(sys.stderr))
    except ConfigError as error:
        return _refuse(*error.problems)
    except FolderError as error:
        return _refuse(str(error))
    except ResultsError as error:
        print(f"gfmdlayer: {error}", file=sys.stderr)
        return FAILED
    if summary.count("stopped"):
        print(f"stopped: {summary.count('stopped')} cases wait; the same command takes them up")
        return RESUMABLE
    if summary.failures:
        print(f"{len(summary.failures)} of {len(summary.outcomes)} cases failed:")
        _print_some(f"  {outcome.index:04d}: {outcome.reason}" for outcome in summary.failures)
        print(f"what is complete is in {directory}; the same command tries the failed ones again")
        return FAILED
    print(f"complete: {Path(directory) / 'sweep.h5'}")
    return COMPLETE


def check(options: argparse.Namespace) -> int:
    """Tell the cases, the memory and the work ahead."""
    from gfmdlayer.config import ConfigError, load
    from gfmdlayer.cost import estimate, total
    from gfmdlayer.sweep import cases, label, objections

    try:
        config = load(options.config, options.set, objections)
        every = cases(config)
    except ConfigError as error:
        return _refuse(*error.problems)
    cost = total(estimate(case.config) for case in every)
    print(f"{config.name}: {_cases(len(every))}")
    if config.sweep:
        _print_some(f"  {case.index:04d}  {label(case.values)}" for case in every)
    print(f"steps      {cost.steps:,}")
    print(f"FFT pairs  about {float(f'{cost.pairs:.2g}'):,.0f}")
    print(f"memory     about {_bytes(cost.memory)} a process")
    print(f"disk       about {_bytes(cost.storage)} in {_default_directory(config)}")
    return COMPLETE


def _folder(name: str) -> str:
    if not name:
        raise argparse.ArgumentTypeError("got an empty name; must be the name of a folder")
    return name


def status(options: argparse.Namespace) -> int:
    """Tell what is done, running, failed and waiting."""
    from gfmdlayer.folder import Folder, FolderError, read_json
    from gfmdlayer.progress import running
    from gfmdlayer.sweep import combinations, label

    folder = Folder(Path(options.directory))
    try:
        values = combinations(folder.stored_sweep())
    except FolderError as error:
        return _refuse(str(error))
    at_work = running(folder)
    busy = {case.index for case in at_work}
    complete = {int(path.stem) for path in folder.cases.glob("[0-9]*.h5")} - busy
    failed = {int(path.stem) for path in folder.cases.glob("[0-9]*.failed")} - busy - complete
    waiting = len(values) - len(complete) - len(failed) - len(busy)
    print(f"{_cases(len(values))}: {len(complete)} complete, {len(busy)} running, ", end="")
    print(f"{len(failed)} failed, {waiting} waiting")
    _print_some(
        f"  {case.index:04d} running on {case.host} (process {case.pid}): "
        f"time {case.simulated_time:g} of {case.end:g}  {label(values[case.index])}"
        for case in at_work
    )
    reasons = {
        index: (read_json(folder.case(index, "failed")) or {}).get("reason") for index in sorted(failed)
    }
    _print_some(
        f"  {index:04d} failed: {reason}  {label(values[index])}" for index, reason in reasons.items()
    )
    return COMPLETE


def plot(options: argparse.Namespace) -> int:
    """Draw the figure of a results folder."""
    from gfmdlayer.results.plots import plot_results
    from gfmdlayer.results.schema import ResultsError

    try:
        print(plot_results(Path(options.directory), options.out))
    except ResultsError as error:
        return _refuse(str(error))
    return COMPLETE


def fit_material(options: argparse.Namespace) -> int:
    """Fit a Prony series to a measured curve."""
    from gfmdlayer import fitting
    from gfmdlayer.results.schema import ResultsError
    from gfmdlayer.tables import TableError

    shift = (options.temperature, options.reference, options.wlf)
    if None in shift and any(value is not None for value in shift):
        return _refuse("--temperature, --reference and --wlf: must be given together")
    try:
        report = fitting.fit_material(
            Path(options.data),
            None if options.out is None else Path(options.out),
            branches=options.branches,
            relaxed=options.relaxed_modulus,
            wlf=None if options.wlf is None else fitting.WLF(*shift[:2], *options.wlf),
            normalise=options.normalise,
            force=options.force,
        )
    except (TableError, fitting.FitError, ResultsError) as error:
        return _refuse(str(error))
    print(report)
    return COMPLETE


class _Version(argparse.Action):
    """Print the version; it is looked up only when asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        from importlib.metadata import version

        print(f"gfmdlayer {version('gfmdlayer')}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    example = "example:\n  gfmdlayer run configs/figure2-quick.yaml && gfmdlayer plot results/figure2-quick"
    parser = argparse.ArgumentParser(
        prog="gfmdlayer",
        description="Contact with a viscoelastic layer, by Green's function molecular dynamics.",
        epilog=f"{STATUSES}\n\n{example}",
        formatter_class=raw,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    verbs = parser.add_subparsers(metavar="VERB", required=True)

    def verb(function: Any, summary: str, example: str) -> argparse.ArgumentParser:
        epilog = f"example:\n  {example}"
        added = verbs.add_parser(
            function.__name__.replace("_", "-"),
            help=summary,
            description=summary,
            epilog=epilog,
            formatter_class=raw,
        )
        added.set_defaults(verb=function)
        return added

    added = verb(
        run,
        "run the cases that are not complete yet; also under mpirun or srun",
        f"gfmdlayer run configs/figure2-quick.yaml --out results/first --jobs 2\n\n{STATUSES}",
    )
    _add_config(added)
    added.add_argument("--out", metavar="DIR", type=_folder, help="results folder (default: results/NAME)")
    added.add_argument("--jobs", metavar="N", type=int, default=1, help="processes (default: 1)")
    added.add_argument("--restart", action="store_true", help="remove earlier results in DIR and start over")
    added = verb(
        check,
        "tell the cases, the memory and the work ahead; run nothing",
        "gfmdlayer check configs/figure2.yaml",
    )
    _add_config(added)
    added = verb(
        status,
        "tell what is done, running, failed and waiting",
        "gfmdlayer status results/figure2-quick",
    )
    added.add_argument("directory", metavar="DIR", help="results folder")
    added = verb(
        plot,
        "draw contact area and mean pressure against time, and the snapshots",
        "gfmdlayer plot results/figure2-quick --out figure2.png",
    )
    added.add_argument("directory", metavar="DIR", help="results folder")
    added.add_argument("--out", metavar="PNG", help="the figure (default: in DIR)")
    added = verb(
        fit_material,
        "fit a Prony series to a master curve (omega, G', G'') or a relaxation curve (t, G)",
        "gfmdlayer fit-material polymer.csv --normalise --temperature 60 --reference 25 --wlf 17.4 51.6",
    )
    added.add_argument("data", metavar="DATA", help="file of two or three columns, the first increasing")
    added.add_argument("--out", metavar="PATH", help="YAML file, or folder for it (default: NAME.yaml here)")
    added.add_argument("--branches", metavar="N", type=int, help="(default: the fewest that are enough)")
    added.add_argument("--relaxed-modulus", metavar="G0", type=float, help="(default: fitted)")
    added.add_argument("--normalise", action="store_true", help="write moduli in units of G0")
    added.add_argument("--temperature", metavar="T", type=float, help="temperature to shift the times to")
    added.add_argument("--reference", metavar="T0", type=float, help="temperature of the data")
    added.add_argument("--wlf", metavar=("C1", "C2"), nargs=2, type=float, help="constants of the shift")
    added.add_argument("--force", action="store_true", help="overwrite files")
    return parser


def _add_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("config", metavar="CONFIG", help="YAML file")
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="set a key, such as layer.thickness=0.1; may be given several times",
    )


def _refuse(*problems: str) -> int:
    for problem in problems:
        print(f"gfmdlayer: {problem}", file=sys.stderr)
    return REFUSED


def _default_directory(config: Config) -> Path:
    return Path("results") / config.name


def _cases(number: int) -> str:
    return "1 case" if number == 1 else f"{number} cases"


def _print_some(lines: Iterable[str]) -> None:
    """Print the first lines of a list, and how many more there are."""
    every = list(lines)
    for line in every[:LISTED]:
        print(line)
    if len(every) > LISTED:
        print(f"  ... and {len(every) - LISTED} more")


def _bytes(number: float) -> str:
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if number >= size:
            return f"{number / size:.3g} {unit}"
    return f"{number:.0f} B"
