"""`gfmdlayer run`: run the cases that are not complete yet."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import (
    COMPLETE,
    FAILED,
    RESUMABLE,
    STATUSES,
    Verbs,
    add_config,
    default_directory,
    folder_name,
    print_some,
    refuse,
)

if TYPE_CHECKING:
    from gfmdlayer.running.executors import Team


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    added = verbs.add(
        run,
        "run the cases that are not complete yet; also under mpirun or srun",
        f"gfmdlayer run configs/figure2-quick.yaml --jobs 2\n\n{STATUSES}",
    )
    add_config(added)
    added.add_argument(
        "--out", metavar="DIR", type=folder_name, help="results folder (default: results/NAME)"
    )
    added.add_argument("--jobs", metavar="N", type=int, default=1, help="processes (default: 1)")
    added.add_argument(
        "--threads",
        metavar="N",
        type=int,
        help="threads for the transforms of a large grid (default: OMP_NUM_THREADS, else 1)",
    )
    added.add_argument("--restart", action="store_true", help="remove earlier results in DIR and start over")


def run(options: argparse.Namespace) -> int:
    """Run the cases that are not complete yet."""
    from gfmdlayer.running import cases, executors, interrupts

    interrupts.listen()
    try:
        threads = executors.threads_each(os.environ, options.threads)
        with executors.assemble(options.jobs, cases.prepare) as team:
            return COMPLETE if team is None else _run(options, team, threads)
    except executors.LauncherError as error:
        return refuse(str(error))


def _run(options: argparse.Namespace, team: Team, threads: int) -> int:
    from gfmdlayer.config import ConfigError, load
    from gfmdlayer.results.schema import ResultsError
    from gfmdlayer.running.folder import FolderError
    from gfmdlayer.running.reports import report_to
    from gfmdlayer.running.run import run_sweep
    from gfmdlayer.sweep import objections

    try:
        config = load(options.config, options.set, objections)
        directory = default_directory(config) if options.out is None else options.out
        summary = run_sweep(config, directory, team, options.restart, lambda: report_to(sys.stderr), threads)
    except ConfigError as error:
        return refuse(*error.problems)
    except FolderError as error:
        return refuse(str(error))
    except ResultsError as error:
        print(f"gfmdlayer: {error}", file=sys.stderr)
        return FAILED
    if summary.count("stopped"):
        print(f"stopped: {summary.count('stopped')} cases wait; the same command takes them up")
        return RESUMABLE
    if summary.failures:
        print(f"{len(summary.failures)} of {len(summary.outcomes)} cases failed:")
        print_some(f"  {outcome.index:04d}: {outcome.reason}" for outcome in summary.failures)
        print(f"what is complete is in {directory}; the same command tries the failed ones again")
        return FAILED
    print(f"complete: {Path(directory) / 'sweep.h5'}")
    return COMPLETE
