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
    add_team,
    count_cases,
    default_directory,
    interval,
    print_some,
    read_config,
    refuse,
)
from gfmdlayer.execution import CHECKPOINT_EVERY

if TYPE_CHECKING:
    from gfmdlayer.execution.sweep import Shard
    from gfmdlayer.execution.workers import WorkerPool


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    added = verbs.add(
        run,
        "run the cases that are not complete yet; also under mpirun or srun",
        f"gfmdlayer run configs/figure2-quick.yaml --jobs 2\n\n{STATUSES}",
    )
    add_config(added)
    add_team(added)
    added.add_argument(
        "--threads",
        metavar="N",
        type=int,
        help="threads for the transforms of a large grid (default: OMP_NUM_THREADS, else 1)",
    )
    added.add_argument(
        "--shard", metavar="I/N", type=shard, help="run part I of N; N runs at once share DIR (job arrays)"
    )
    added.add_argument(
        "--checkpoint-every",
        metavar="SECONDS",
        type=interval,
        default=CHECKPOINT_EVERY,
        help="time after which the state of a case is kept, for a run that is killed (default: %(default)g; "
        "0: after every step; inf: only when a signal stops the run)",
    )
    which = added.add_mutually_exclusive_group()
    which.add_argument("--restart", action="store_true", help="remove earlier results in DIR and start over")
    which.add_argument("--only-failed", action="store_true", help="run the cases that failed before alone")


def shard(text: str) -> Shard:
    """Take a shard from the command line."""
    from gfmdlayer.execution.sweep import Shard

    try:
        return Shard.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def run(options: argparse.Namespace) -> int:
    """Run the cases that are not complete yet."""
    from gfmdlayer.execution import case_run, interrupts, workers

    if options.shard and options.restart:
        return refuse("--shard and --restart exclude each other: start over once, with --restart alone")
    interrupts.listen()
    try:
        threads = workers.threads_each(os.environ, options.threads)
        with workers.assemble(options.jobs, case_run.prepare) as pool:
            return COMPLETE if pool is None else _run(options, pool, threads)
    except workers.LauncherError as error:
        return refuse(str(error))


def _run(options: argparse.Namespace, pool: WorkerPool, threads: int) -> int:
    from gfmdlayer.config import ConfigError
    from gfmdlayer.execution.folder import Folder, FolderError
    from gfmdlayer.execution.progress import make_display
    from gfmdlayer.execution.run import RunOptions, run_sweep
    from gfmdlayer.results.schema import ResultsError

    try:
        config = read_config(options)
        directory = default_directory(config, options.config) if options.out is None else options.out
        if options.only_failed:
            Folder(Path(directory)).must_hold_results()
        chosen = RunOptions(
            options.restart, options.only_failed, options.shard, threads, options.checkpoint_every
        )
        summary = run_sweep(config, directory, pool, chosen, lambda: make_display(sys.stderr))
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
    if waiting := summary.count("waiting"):
        print(f"no case is left that failed; {count_cases(waiting)} wait: run again without --only-failed")
        return COMPLETE
    if not summary.collected:
        print(f"shard {options.shard} complete; sweep.h5 follows when the other shards are")
        return COMPLETE
    print(f"complete: {Path(directory) / 'sweep.h5'}")
    return COMPLETE
