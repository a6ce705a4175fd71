"""`gfmdlayer check`: tell the cases, the memory and the work ahead."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import (
    COMPLETE,
    Verbs,
    add_config,
    add_team,
    count_cases,
    default_directory,
    print_some,
    read_config,
    refuse,
)

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.execution.sweep import Case


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    added = verbs.add(
        check,
        "tell the cases, the memory and the work ahead; run nothing",
        "gfmdlayer check configs/figure2.yaml",
    )
    add_config(added)
    add_team(added)


def check(options: argparse.Namespace) -> int:
    """Tell the cases, the memory and the work ahead."""
    from gfmdlayer.config import ConfigError
    from gfmdlayer.execution import preflight
    from gfmdlayer.execution.cost import estimate, total
    from gfmdlayer.execution.sweep import cases, label, notes

    try:
        config = read_config(options)
        every = cases(config)
    except ConfigError as error:
        return refuse(*error.problems)
    cost = total(estimate(case.config) for case in every)
    directory = Path(options.out or default_directory(config, options.config))
    print(f"{config.name}: {count_cases(len(every))}")
    if config.sweep:
        print_some(f"  {case.index:04d}  {label(case.values)}" for case in every)
    print(f"steps      {cost.steps:,}")
    print(f"FFT pairs  about {float(f'{cost.pairs:.2g}'):,.0f}")
    print(f"memory     about {preflight.in_bytes(cost.memory)} a process")
    print(f"disk       about {preflight.in_bytes(cost.storage)} in {directory}")
    for line in _from_finished_cases(directory, config, every):
        print(line)
    memory = preflight.memory_warnings(options.jobs * cost.memory)
    space = preflight.disk_warnings(directory, cost.storage)
    for warning in (*notes(case.config for case in every), *memory, *space):
        print(f"warning: {warning}")
    return COMPLETE


def _from_finished_cases(directory: Path, config: Config, every: Sequence[Case]) -> list[str]:
    """Tell the time that is left, where cases of the same configuration are complete."""
    from gfmdlayer.execution.folder import Folder, FolderError, changed_keys

    folder = Folder(directory)
    present = {path.name for path in folder.cases.glob("[0-9]*.h5")}
    done = [case for case in every if folder.case(case.index).name in present]
    with suppress(FolderError):
        if done and not changed_keys(folder.stored_config(), config):
            from gfmdlayer.execution.cost import CostModel
            from gfmdlayer.execution.status import duration

            left = [case for case in every if folder.case(case.index).name not in present]
            model = CostModel.of_files({folder.case(case.index): case.config for case in done})
            if left and model.fitted:
                seconds = sum(model.seconds(case.config) for case in left)
                return [f"time       about {duration(seconds)} on one core for the {len(left)} cases left"]
    return []
