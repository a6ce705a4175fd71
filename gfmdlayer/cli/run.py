"""`gfmdlayer run`: run the cases that are not complete yet; also under mpirun or srun."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import (
    COMPLETE,
    FAILED,
    RESUMABLE,
    STATUSES,
    add_config,
    add_out,
    arguments,
    conclude,
    input_problems,
    read_config,
    refuse,
)
from gfmdlayer.execution import CHECKPOINT_EVERY

if TYPE_CHECKING:
    from gfmdlayer.execution.sweep import Shard
    from gfmdlayer.execution.workers import WorkerPool

EXAMPLE = f"gfmdlayer run configs/figure2-quick.yaml --jobs 2\n\n{STATUSES}"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_config(parser)
    add_out(parser)
    text = f"""
    --threads N  threads for the transforms of a large grid (default: OMP_NUM_THREADS, else 1)
    --ranks-per-case N = 1  MPI ranks that share a case, each with a part of its surface (default: 1)
    --shard I/N  run part I of N of the sweep; N runs share DIR (job arrays)
    --checkpoint-every SECONDS = {CHECKPOINT_EVERY}  time between checkpoints of a case; a killed run
      continues from the last (default: %(default)g; 0: after every step; inf: only when a signal stops
      the run)
    """
    arguments(parser, text, **{"I/N": shard})
    text = """
    --restart  remove earlier results in DIR and start over
    --only-failed  run only the cases that failed before
    """
    arguments(parser.add_mutually_exclusive_group(), text)


def shard(text: str) -> Shard:
    """Parse a shard."""
    from gfmdlayer.execution.sweep import Shard

    try:
        return Shard.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def run(options: argparse.Namespace) -> int:
    """Run the cases that are not complete yet."""
    from gfmdlayer.execution import interrupts, workers

    if options.shard and options.restart:
        return refuse(
            "--shard and --restart cannot be combined; start over once with --restart, then run the shards"
        )
    interrupts.listen()
    threads = workers.threads_each(os.environ, options.threads)
    with _pool(options) as pool:
        return COMPLETE if pool is None else _run(options, pool, threads)


def prepare() -> None:
    """Import the modules that a case needs, on the other ranks; compiles nothing."""
    import gfmdlayer.execution.case_run  # noqa: F401


def _pool(options: argparse.Namespace) -> AbstractContextManager[WorkerPool | None]:
    from gfmdlayer.execution import workers

    size = options.ranks_per_case
    if size == 1:
        return workers.assemble(options.jobs, prepare)
    from gfmdlayer.execution.groups import groups_of

    if size < 1:
        raise workers.LauncherError(f"--ranks-per-case {size}: must be 1 or more")
    if options.jobs > 1:
        raise workers.LauncherError("--jobs and --ranks-per-case cannot be combined; leave --jobs out")
    return groups_of(size, prepare)


def _run(options: argparse.Namespace, pool: WorkerPool, threads: int) -> int:
    from dataclasses import fields

    from gfmdlayer.config import ConfigError
    from gfmdlayer.execution import interrupts
    from gfmdlayer.execution.folder import Folder, FolderError
    from gfmdlayer.execution.progress import make_display
    from gfmdlayer.results.schema import ResultsError

    try:
        with interrupts.at_once():
            config, directory = read_config(options, options.ranks_per_case)
            if options.ranks_per_case > 1:
                from gfmdlayer.execution.groups import with_shared_solver

                config = with_shared_solver(config)
            from gfmdlayer.execution.run import RunOptions, run_sweep
        if options.only_failed:
            Folder(directory).must_hold_results()
        given = {each.name: getattr(options, each.name) for each in fields(RunOptions)} | {"threads": threads}
        chosen = RunOptions(**given)
        summary = run_sweep(config, directory, pool, chosen, lambda: make_display(sys.stderr))
    except (ConfigError, FolderError) as error:  # caught here, since it would abort the ranks
        return refuse(*input_problems(error))
    except KeyboardInterrupt:
        print("stopped before the first case")
        return RESUMABLE
    except (ResultsError, PermissionError) as error:  # the folder became read-only during the run
        print(f"gfmdlayer: {error}", file=sys.stderr)
        return FAILED
    return conclude(summary, directory, "case", options.shard)
