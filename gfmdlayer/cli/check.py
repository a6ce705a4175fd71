"""`gfmdlayer check`: list the cases, the memory and the work of a configuration; run nothing."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import COMPLETE, LISTED, add_config, add_out, count_cases, cut_short, read_config

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.execution.sweep import SweepCase

MOST_EXPLAINED = 8  # cases whose methods are listed

EXAMPLE = "gfmdlayer check configs/figure2.yaml"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_config(parser)
    add_out(parser)


def check(options: argparse.Namespace) -> int:
    """List the cases, the memory and the work of a configuration."""
    from gfmdlayer.execution import preflight
    from gfmdlayer.execution.cost import estimate, total
    from gfmdlayer.execution.sweep import Cases, label
    from gfmdlayer.model import model_of
    from gfmdlayer.notes import notes

    config, directory = read_config(options)
    every = Cases(config)
    some: Sequence[SweepCase] = every.examined()
    part = len(some) / len(every)
    some, found = _in_folder(directory, config, some) if part == 1 else (some, [])
    cost = total((estimate(case.config) for case in some), part)
    explained = some[:: -(-len(some) // MOST_EXPLAINED)]
    lines = [f"{config.name}: {count_cases(len(every))}"]
    if config.sweep:
        first = some if part == 1 else every[:LISTED]
        lines += cut_short((f"  {case.index:04d}  {label(case.values)}" for case in first), len(every))
    if part < 1:
        checks = "as a run does; it checks each before its start"
        lines.append(f"examined   {len(some)} cases at random, {checks}")
    lines += [
        f"steps      {'about ' * (part < 1)}{cost.steps:,}",
        *([f"FFT pairs  about {float(f'{cost.pairs:.2g}'):,.0f}"] if cost.pairs else []),
        f"memory     about {preflight.in_bytes(cost.memory)} a process",
        f"disk       about {preflight.in_bytes(cost.storage)} in {directory}",
        *dict.fromkeys(line for case in explained for line in model_of(case.config).methods()),
        _time(directory, some, part),
        *found,
    ]
    memory = preflight.memory_warnings(cost.memory, options.jobs)
    space = preflight.disk_warnings(directory, cost.storage)
    lines += [f"warning: {text}" for text in (*notes(case.config for case in some), *memory, *space)]
    print("\n".join(lines))
    return COMPLETE


def _in_folder(
    directory: Path, config: Config, every: Sequence[SweepCase]
) -> tuple[Sequence[SweepCase], list[str]]:
    """Return the cases with their numbers in the results folder, and lines about its contents."""
    from gfmdlayer.execution.folder import Folder

    folder = Folder(directory)
    if not folder.is_results():
        return every, []
    from gfmdlayer.execution import growth
    from gfmdlayer.execution.folder import FolderError

    try:
        found = growth.compare(folder, config)
    except FolderError as error:
        return every, [f"warning: a run would be rejected: {error}"]
    files = folder.numbers()
    continued = growth.with_earlier(folder, files)
    every = [continued(case) for case in found.numbered(every)]
    first, *others = growth.lines(files, found, [case.index for case in every], every)
    return every, [f"cases      {first}", *(f"           {line}" for line in others)]


def _time(directory: Path, every: Sequence[SweepCase], part: float) -> str:
    """Estimate the time of the cases that are not complete; `every` may be a sample of them."""
    from gfmdlayer.execution.cost import CostModel
    from gfmdlayer.execution.folder import Folder
    from gfmdlayer.execution.status import duration

    folder = Folder(directory)
    complete = folder.numbers()["h5"] if folder.is_results() else set()
    done = {folder.case(case.index): case.config for case in every if case.index in complete}
    model = CostModel.of_files(done) if done else CostModel()
    left = [case for case in every if case.index not in complete]
    seconds = sum(model.seconds(case.config) for case in left) / part
    of = "" if len(left) == len(every) else f" for the {count_cases(round(len(left) / part))} left"
    return f"time       about {duration(seconds)} on one core{of}"
