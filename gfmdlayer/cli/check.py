"""`gfmdlayer check`: list the cases, the memory and the work of a configuration; run nothing."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import (
    COMPLETE,
    LISTED,
    add_config,
    add_out,
    count_cases,
    cut_short,
    read_config,
    results_folder,
)

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.execution.sweep import SweepCase

MOST_LAWS = 8  # whose series are computed

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
    from gfmdlayer.notes import notes

    config = read_config(options)
    every = Cases(config)
    some: Sequence[SweepCase] = every.examined()
    part = len(some) / len(every)
    directory = results_folder(options, config)
    some, found = _in_folder(directory, config, some) if part == 1 else (some, [])
    cost = total((estimate(case.config) for case in some), part)
    lines = [f"{config.name}: {count_cases(len(every))}"]
    if config.sweep:
        first = some if part == 1 else every[:LISTED]
        lines += cut_short((f"  {case.index:04d}  {label(case.values)}" for case in first), len(every))
    if part < 1:
        lines.append(f"examined   {len(some)} cases, drawn at random; a run examines all before it begins")
    lines += [
        f"steps      {'about ' * (part < 1)}{cost.steps:,}",
        *([f"FFT pairs  about {float(f'{cost.pairs:.2g}'):,.0f}"] if cost.pairs else []),
        f"memory     about {preflight.in_bytes(cost.memory)} a process",
        f"disk       about {preflight.in_bytes(cost.storage)} in {directory}",
        *_solvers([case.config for case in some]),
        *_laws([case.config for case in some]),
        _time(directory, some, part),
        *found,
    ]
    memory = preflight.memory_warnings(cost.memory, options.jobs)
    space = preflight.disk_warnings(directory, cost.storage)
    lines += [f"warning: {text}" for text in (*notes(case.config for case in some), *memory, *space)]
    print("\n".join(lines))
    return COMPLETE


def _solvers(every: Sequence[Config]) -> list[str]:
    """Return the contact solvers, and why they are taken."""
    chosen = dict.fromkeys(config.contact_solver for config in every if not config.grid.axisymmetric)
    return [f"solver     {each.method}: {each.reason}" for each in chosen]


def _laws(configs: Sequence[Config]) -> list[str]:
    """Describe the series that replace laws with a continuous spectrum, in some cases of a long sweep."""
    from gfmdlayer.body.continuous import ContinuousLaw

    continuous = [config for config in configs if any(isinstance(law, ContinuousLaw) for law in config.laws)]
    if not continuous:
        return []
    from gfmdlayer import inputs

    found = []
    for config in continuous[:: -(-len(continuous) // MOST_LAWS)]:
        found += [
            f"law        {law.model} by {len(series.material.maxwell_branches)} branches: "
            f"error at most {series.error_in_time:.1e} of G(t), {series.error_in_frequency:.1e} of G(omega), "
            f"t and 1/omega from {series.shortest:.3g} to {series.longest:.3g}"
            for law, series in zip(config.laws, inputs.make_series(config), strict=True)
            if isinstance(law, ContinuousLaw)
        ]
    return list(dict.fromkeys(found))


def _in_folder(
    directory: Path, config: Config, every: Sequence[SweepCase]
) -> tuple[Sequence[SweepCase], list[str]]:
    """Return the cases as they are in the results folder, and lines on what it holds."""
    from gfmdlayer.execution.folder import Folder

    folder = Folder(directory)
    if not folder.is_results():
        return every, []
    from gfmdlayer.execution import growth
    from gfmdlayer.execution.folder import FolderError

    try:
        found = growth.compare(folder, config)
    except FolderError as error:
        return every, [f"warning: a run would be refused: {error}"]
    every = growth.with_earlier(folder, found.numbered(every))
    first, *others = growth.lines(folder, found, every)
    return every, [f"cases      {first}", *(f"           {line}" for line in others)]


def _time(directory: Path, every: Sequence[SweepCase], part: float) -> str:
    """Estimate the seconds of the cases that are not complete; `every` may be a part of them."""
    from gfmdlayer.execution.cost import CostModel
    from gfmdlayer.execution.folder import Folder
    from gfmdlayer.execution.status import duration

    folder = Folder(directory)
    complete = folder.numbers()["h5"] if folder.is_results() else set()
    done = {folder.case(case.index): case.config for case in every if case.index in complete}
    model = CostModel.of_files(done) if done else CostModel()  # which reads no file
    left = [case for case in every if case.index not in complete]
    seconds = sum(model.seconds(case.config) for case in left) / part
    of = "" if len(left) == len(every) else f" for the {count_cases(round(len(left) / part))} left"
    return f"time       about {duration(seconds)} on one core{of}"
