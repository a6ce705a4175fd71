"""`run` and `check`: run the cases of a configuration, or list them with their memory and work."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import (
    COMPLETE,
    FAILED,
    LISTED,
    OUT,
    RESUMABLE,
    STATUSES,
    add_config,
    arguments,
    conclude,
    count_cases,
    cut_short,
    input_problems,
    read_cases,
    refuse,
    verb,
)
from gfmdlayer.study import CHECKPOINT_EVERY

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.study.cases import Cases, Shard, SweepCase
    from gfmdlayer.study.workers import WorkerPool
    from gfmdlayer.validation.quantities import Written


def _options_of_cases(parser: argparse.ArgumentParser) -> None:
    add_config(parser)
    arguments(parser, OUT)


def _options_of_run(parser: argparse.ArgumentParser) -> None:
    _options_of_cases(parser)
    text = f"""
    --threads N  threads for the transforms of a large grid (default: OMP_NUM_THREADS, else
                 2 from 2048 x 2048 points for one process with two cores or more, else 1)
    --ranks-per-case N = 1  MPI ranks that share a case, each with a part of its surface (default: 1)
    --shard I/N  where this run starts in the sweep, as the I-th of N that share DIR (job arrays)
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
    from gfmdlayer.study.cases import Shard

    try:
        return Shard.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


@verb(_options_of_run, f"gfmdlayer run configs/figure2-quick.yaml --jobs 2\n\n{STATUSES}")
def run(options: argparse.Namespace) -> int:
    """Run the cases that are not complete yet; also under mpirun or srun."""
    from gfmdlayer.study import interrupts, workers

    if options.shard and options.restart:
        return refuse(
            "--shard and --restart cannot be combined; start over once with --restart, then run the shards"
        )
    interrupts.listen()
    threads = workers.threads_each(os.environ, options.threads, options.jobs * options.ranks_per_case)
    with _pool(options) as pool:
        return COMPLETE if pool is None else _run(options, pool, threads)


def prepare() -> None:
    """Import the modules that a case needs, on the other ranks; compiles nothing."""
    import gfmdlayer.study.case_run  # noqa: F401


def _pool(options: argparse.Namespace) -> AbstractContextManager[WorkerPool | None]:
    from gfmdlayer.study import workers

    size = options.ranks_per_case
    if size == 1:
        return workers.assemble(options.jobs, prepare)
    from gfmdlayer.study.groups import groups_of

    if size < 1:
        raise workers.LauncherError(f"--ranks-per-case {size}: must be 1 or more")
    if options.jobs > 1:
        raise workers.LauncherError("--jobs and --ranks-per-case cannot be combined; leave --jobs out")
    return groups_of(size, prepare)


def _options_of_converge(parser: argparse.ArgumentParser) -> None:
    _options_of_cases(parser)
    text = f"""
    --columns NAMES  columns of the results, with commas between them (default: all)
    --at MOMENTS = end,peak,worst  end, peak (largest magnitude), worst (largest error at common times), or
      times (default: all three words)
    --to ACCURACY = 1e-3  accuracy, relative to the largest value of each column, for which numerical choices
      are suggested (default: %(default)g)
    --write FILE  write the configuration with these choices
    --json FILE  write the estimates as JSON
    --keep  keep the results of all runs, in DIR/convergence
    --restart  remove earlier runs there and start over
    --threads N  threads for the transforms of a large grid (default: OMP_NUM_THREADS, else
                 2 from 2048 x 2048 points for one process with two cores or more, else 1)
    --ranks-per-case N = 1  MPI ranks that share a case, each with a part of its surface (default: 1)
    --checkpoint-every SECONDS = {CHECKPOINT_EVERY}  time between checkpoints of a case (default: %(default)g)
    """
    arguments(parser, text, NAMES=_names, MOMENTS=_moments, ACCURACY=float)


def _names(text: str) -> tuple[str, ...]:
    return tuple(filter(None, (name.strip() for name in text.split(","))))


def _moments(text: str) -> tuple[str | float, ...]:
    """Parse moments: words, and times."""

    def moment(word: str) -> str | float:
        try:
            return float(word)
        except ValueError:
            return word

    return tuple(map(moment, _names(text)))


@verb(_options_of_converge, "gfmdlayer converge configs/figure2-quick.yaml --columns force,work")
def converge(options: argparse.Namespace) -> int:
    """Estimate how sure each number of a case is, from runs on coarser grids and with other steps."""
    from gfmdlayer.study import interrupts, workers

    interrupts.listen()
    threads = workers.threads_each(os.environ, options.threads, options.jobs * options.ranks_per_case)
    with _pool(options) as pool:
        return COMPLETE if pool is None else _converge(options, pool, threads)


def _converge(options: argparse.Namespace, pool: WorkerPool, threads: int | None) -> int:
    import json

    from gfmdlayer.config import ConfigError
    from gfmdlayer.files.whole import write_text
    from gfmdlayer.results.names import ResultsError
    from gfmdlayer.study import interrupts
    from gfmdlayer.study.folder import FolderError
    from gfmdlayer.study.progress import make_display

    try:
        with interrupts.at_once():
            cases, directory = read_cases(options, options.ranks_per_case)
            from gfmdlayer.convergence.converge import asked_of, better, estimated
            from gfmdlayer.results.convergence import FILE
            from gfmdlayer.study.run import RunOptions

            asked = asked_of(cases, options.columns or (), options.at, options.to)
        names = ("restart", "checkpoint_every", "ranks_per_case")
        chosen = RunOptions(threads=threads, **{name: getattr(options, name) for name in names})
        show = partial(make_display, sys.stderr)
        found = estimated(cases, directory, pool, asked, chosen, show, keep=options.keep)
    except (ConfigError, FolderError) as error:  # caught here, since it would abort the ranks
        return refuse(*input_problems(error))
    except (ResultsError, PermissionError) as error:
        print(f"gfmdlayer: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        found = None
    if found is None:
        print("stopped; the same command continues")
        return RESUMABLE
    print(found)
    try:
        if options.json:
            write_text(Path(options.json), json.dumps(found.as_json(), indent=1, allow_nan=False) + "\n")
        if options.write:
            write_text(Path(options.write), better(cases.config, found).dump())
    except OSError as error:
        return refuse(f"{error.filename}: cannot be written ({error.strerror})")
    written = [directory / FILE, *filter(None, (options.json, options.write))]
    print("".join(f"{path}\n" for path in written), end="")
    return FAILED if found.failed else COMPLETE


def _run(options: argparse.Namespace, pool: WorkerPool, threads: int | None) -> int:
    from dataclasses import fields

    from gfmdlayer.config import ConfigError
    from gfmdlayer.results.names import ResultsError
    from gfmdlayer.study import interrupts
    from gfmdlayer.study.folder import Folder, FolderError
    from gfmdlayer.study.progress import make_display

    try:
        with interrupts.at_once():
            cases, directory = read_cases(options, options.ranks_per_case)
            from gfmdlayer.study.run import RunOptions, run_study
        if options.only_failed:
            Folder(directory).must_hold_results()
        given = {each.name: getattr(options, each.name) for each in fields(RunOptions)} | {"threads": threads}
        chosen = RunOptions(**given)
        summary = run_study(cases, directory, pool, chosen, lambda: make_display(sys.stderr))
    except (ConfigError, FolderError) as error:  # caught here, since it would abort the ranks
        return refuse(*input_problems(error))
    except KeyboardInterrupt:
        print("stopped before the first case")
        return RESUMABLE
    except (ResultsError, PermissionError) as error:  # the folder became read-only during the run
        print(f"gfmdlayer: {error}", file=sys.stderr)
        return FAILED
    return conclude(summary, directory, "case")


MOST_EXPLAINED = 8  # cases whose methods are listed
CERTAIN = 1.0  # seconds; below them, those of loading the kernels and of single steps decide


@verb(_options_of_cases, "gfmdlayer check configs/figure2.yaml")
def check(options: argparse.Namespace) -> int:
    """List the cases, the memory and the work of a configuration; run nothing."""
    from gfmdlayer.case.model import model_of
    from gfmdlayer.case.notes import accounts, notes
    from gfmdlayer.grid.library import own
    from gfmdlayer.study import preflight
    from gfmdlayer.study.cases import label
    from gfmdlayer.study.cost import total

    every, directory = read_cases(options)
    config = every.config
    some: Sequence[SweepCase] = list(every.sample())
    part = len(some) / len(every)
    some, found = _in_folder(directory, every, some) if part == 1 else (some, [])
    counted = part == 1 and all(
        c.config.time.at_once or (c.config.time.step != "adaptive" and c.config.time.steady is None)
        for c in some
    )
    cost = total((case.cost for case in some), part)
    explained = some[:: -(-len(some) // MOST_EXPLAINED)]
    lines = [f"{config.name}: {count_cases(len(every))}"]
    if config.sweep:
        first = some if part == 1 else map(every.__getitem__, range(LISTED))
        lines += cut_short((f"  {case.index:04d}  {label(case.values)}" for case in first), len(every))
    lines += (f"taken      {line}" for line in _taken(config))
    if part < 1:
        checks = "as a run does; it checks each before its start"
        lines.append(f"examined   {len(some)} cases at random, {checks}")
    lines += [
        f"steps      {'about ' * (not counted)}{cost.steps:,}",
        *([f"FFT pairs  about {float(f'{cost.pairs:.2g}'):,.0f}"] if cost.pairs else []),
        f"memory     about {preflight.in_bytes(cost.memory)} a process",
        f"disk       about {preflight.in_bytes(cost.storage)} in {directory}",
        *dict.fromkeys(line for case in explained for line in model_of(case.config).methods()),
        *([f"transforms {fftw.version}, {fftw.place}"] if (fftw := own()) else []),
        *(f"read       {line}" for line in accounts(case.config for case in some)),
        _time(directory, some, part),
        *found,
    ]
    memory = preflight.memory_warnings(cost.memory, options.jobs)
    space = preflight.disk_warnings(directory, cost.storage)
    lines += [f"warning: {text}" for text in (*notes(case.config for case in some), *memory, *space)]
    print("\n".join(lines))
    return COMPLETE


def _taken(config: Config) -> Iterator[str]:
    """Yield the numbers for which texts are taken, those with units and the words for times, by keys."""
    from gfmdlayer.config.sweeps import unswept
    from gfmdlayer.validation.problems import dotted_key, without_last_places
    from gfmdlayer.validation.sections import described, texts_in

    found: dict[str, list[Written]] = {}
    for at, value in texts_in(config):
        found.setdefault(dotted_key(without_last_places(at)), []).append(value)
    for key, values in found.items():
        swept = unswept(key)
        words = described(type(config), swept)[1] or described(type(config), swept.rpartition(".")[0])[1]
        texts, numbers = [each.text for each in values], [f"{each:.9g}" for each in values]
        more = [f"... ({len(values)})"] if len(values) > LISTED else []
        left, right = (", ".join([*parts[:LISTED], *more]) for parts in (texts, numbers))
        yield f"{key} = {left}: {right} {config.unit(words)}"


def _in_folder(
    directory: Path, cases: Cases, every: Sequence[SweepCase]
) -> tuple[Sequence[SweepCase], list[str]]:
    """Return the cases with their numbers in the results folder, and lines about its contents."""
    from gfmdlayer.study.folder import Folder

    folder = Folder(directory)
    if not folder.is_results():
        return every, []
    from gfmdlayer.study import growth
    from gfmdlayer.study.folder import FolderError

    try:
        found = growth.compare(folder, cases)
    except FolderError as error:
        return every, [f"warning: a run would be rejected: {error}"]
    files = folder.numbers()
    continued = growth.with_earlier(folder, files)
    every = [continued(found.numbered(case)) for case in every]
    first, *others = growth.lines(files, found, every)
    return every, [f"cases      {first}", *(f"           {line}" for line in others)]


def _time(directory: Path, every: Sequence[SweepCase], part: float) -> str:
    """Estimate the time of the cases that are not complete; `every` may be a sample of them."""
    from gfmdlayer.results.provenance import duration
    from gfmdlayer.study.cost import CostModel, expected_seconds
    from gfmdlayer.study.folder import Folder

    folder = Folder(directory)
    complete = folder.numbers()["h5"] if folder.is_results() else set()
    done = {folder.case(case.index): case.config for case in every if case.index in complete}
    model = CostModel.of_files(done) if done else CostModel()
    left = [case for case in every if case.index not in complete]
    each = (expected_seconds(case.config, cost=case.cost) * model.factor(case.config) for case in left)
    seconds = sum(each) / part
    if not all(model.knows(case.config) for case in left):
        return "time       not known before a case with friction is complete"
    about = "a few seconds" if seconds < CERTAIN else f"about {duration(seconds)}"
    of = "" if len(left) == len(every) else f" for the {count_cases(round(len(left) / part))} left"
    return f"time       {about} on one core{of}"
