"""`gfmdlayer check`: tell the cases, the memory and the work ahead."""

from __future__ import annotations

import argparse

from gfmdlayer.cli.terminal import (
    COMPLETE,
    Verbs,
    add_config,
    count_cases,
    default_directory,
    print_some,
    read_config,
    refuse,
)


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    add_config(
        verbs.add(
            check,
            "tell the cases, the memory and the work ahead; run nothing",
            "gfmdlayer check configs/figure2.yaml",
        )
    )


def check(options: argparse.Namespace) -> int:
    """Tell the cases, the memory and the work ahead."""
    from gfmdlayer.config import ConfigError
    from gfmdlayer.running.cost import estimate, total
    from gfmdlayer.sweep import cases, label, remarks

    try:
        config = read_config(options)
        every = cases(config)
    except ConfigError as error:
        return refuse(*error.problems)
    cost = total(estimate(case.config) for case in every)
    print(f"{config.name}: {count_cases(len(every))}")
    if config.sweep:
        print_some(f"  {case.index:04d}  {label(case.values)}" for case in every)
    print(f"steps      {cost.steps:,}")
    print(f"FFT pairs  about {float(f'{cost.pairs:.2g}'):,.0f}")
    print(f"memory     about {_in_bytes(cost.memory)} a process")
    print(f"disk       about {_in_bytes(cost.storage)} in {default_directory(config, options.config)}")
    for remark in remarks(case.config for case in every):
        print(f"warning: {remark}")
    return COMPLETE


def _in_bytes(number: float) -> str:
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if number >= size:
            return f"{number / size:.3g} {unit}"
    return f"{number:.0f} B"
