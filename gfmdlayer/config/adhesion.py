"""Whether an interface law goes with the rest of a configuration."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gfmdlayer.interface.electrostatic import NO_PERMITTIVITY, Electrostatic
from gfmdlayer.validation.problems import Problem
from gfmdlayer.validation.sections import sections_in


def problems_of_the_interface(config: Any) -> Iterator[Problem]:
    """Yield contradictions between the interface laws of a `Config` and its other sections."""
    if config.interface == ():
        yield Problem(("interface",), "got an empty list; must hold at least one {law: ...}")
    for at, law in sections_in(config):
        if isinstance(law, Electrostatic) and law.permittivity_of_vacuum(config.units) is None:
            yield Problem((*at, "permittivity"), NO_PERMITTIVITY, ("units",))
