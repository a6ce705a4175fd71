"""Whether an interface law goes with the rest of a configuration."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gfmdlayer.contact.solvers import AUTO, SOLVERS
from gfmdlayer.interface.electrostatic import NO_PERMITTIVITY, Electrostatic
from gfmdlayer.interface.interface import Interface
from gfmdlayer.validation.problems import Problem
from gfmdlayer.validation.sections import sections_in


def attracting(interface: Interface | tuple[Interface, ...] | None) -> tuple[Interface, ...]:
    """Return the laws that attract: none of the hard wall alone."""
    every = interface if isinstance(interface, tuple) else () if interface is None else (interface,)
    return tuple(law for law in every if law.attracts)


def problems_of_the_interface(config: Any) -> Iterator[Problem]:
    """Yield contradictions between the interface laws of a `Config` and its other sections."""
    if config.interface == ():
        yield Problem(("interface",), "got an empty list; must hold at least one {law: ...}")
    if not config.interfaces:
        return
    for at, law in sections_in(config):
        if isinstance(law, Electrostatic) and law.permittivity_of_vacuum(config.units) is None:
            yield Problem((*at, "permittivity"), NO_PERMITTIVITY, ("units",))
    if config.solver.method != AUTO and not SOLVERS[config.solver.method].adhesive:
        able = " or ".join(name for name, declared in SOLVERS.items() if declared.adhesive)
        message = f"got {config.solver.method}, which solves for the hard wall alone; must be {able}"
        yield Problem(("solver", "method"), f"{message} with an interface that attracts", ("interface",))
