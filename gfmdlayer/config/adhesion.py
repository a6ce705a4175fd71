"""Whether an interface law goes with the rest of a configuration, and the solver that is meant with one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gfmdlayer.config.sections import Solver
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.interface.electrostatic import NO_PERMITTIVITY, Electrostatic
from gfmdlayer.interface.interface import Interface
from gfmdlayer.validation.problems import Problem
from gfmdlayer.validation.sections import sections_in

_DEFAULT = "newton"


def attracting(interface: Interface | tuple[Interface, ...] | None) -> tuple[Interface, ...]:
    """Return the laws that attract: none of the hard wall alone."""
    every = interface if isinstance(interface, tuple) else () if interface is None else (interface,)
    return tuple(law for law in every if law.attracts)


def solving(interface: Interface | tuple[Interface, ...] | None, solver: Solver) -> Solver:
    """Return the solver that is meant: one for attraction, where the method is left out.

    Parameters
    ----------
    interface : Interface, or tuple of Interface
        The value of this key.
    solver : Solver
        The section as it is given.

    Returns
    -------
    Solver
        Its method then counts as a default, which follows an interface that is swept.
    """
    if "method" in solver.model_fields_set or not attracting(interface):
        return solver
    solver = solver.model_copy(update={"method": _DEFAULT})
    solver.model_fields_set.discard("method")
    return solver


def problems_of_the_interface(config: Any) -> Iterator[Problem]:
    """Yield contradictions between the interface laws of a `Config` and its other sections."""
    if config.interface == ():
        yield Problem(("interface",), "got an empty list; must hold at least one {law: ...}")
    if not config.interfaces:
        return
    for at, law in sections_in(config):
        if isinstance(law, Electrostatic) and law.permittivity_of_vacuum(config.units) is None:
            yield Problem((*at, "permittivity"), NO_PERMITTIVITY, ("units",))
    if config.grid.axisymmetric:
        message = (
            "given with grid.geometry: axisymmetric, which has the hard wall alone; must be left out "
            "(gfmdlayer.indent has a work of adhesion)"
        )
        yield Problem(("interface",), message, ("grid.geometry",))
    elif not SOLVERS[config.solver.method].adhesive:
        able = " or ".join(name for name, declared in SOLVERS.items() if declared.adhesive)
        message = f"got {config.solver.method}, which solves for the hard wall alone; must be {able}"
        yield Problem(("solver", "method"), f"{message} with an interface that attracts", ("interface",))
