"""Verification: `gfmdlayer verify` compares results with theory, row by row.

    rows.py     a row of the table, a curve of convergence, a check; the report and its pictures
    theory.py   closed forms of elastic contact, and bounds on the errors of grid and solver
    runs.py     runs of the paper's default case, in memory

The other modules contain the checks. A check is a function that yields rows; its docstring gives the theory
and derives the bounds. The table of all checks is here: add a new check to a group of `_GROUPS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from gfmdlayer.verification import (
    adhesion,
    closed_forms,
    crosschecks,
    hardness,
    indentation,
    orders,
    stacks,
    transport,
)
from gfmdlayer.verification.rows import Check, CheckResult, carry_out, write_report

_GROUPS = {
    "Closed forms": (
        closed_forms.periodic_parabola,
        closed_forms.hertz_line,
        closed_forms.hertz_sphere,
        closed_forms.westergaard,
        closed_forms.thin_layer,
        closed_forms.full_contact,
        closed_forms.depth_control,
        closed_forms.load_control,
    ),
    "Limits": (
        closed_forms.stiffness_limits,
        closed_forms.printed_equation,
        closed_forms.relaxing_modes,
        closed_forms.limiting_bodies,
        closed_forms.fast_and_slow,
    ),
    "Laws and temperature": (crosschecks.series_of_laws, crosschecks.jump_of_temperature),
    "Orders": (orders.time_steps, orders.papers_step, orders.grid_spacing, orders.solver_tolerance),
    "Energy": (orders.stored_energy, orders.balance, orders.cycle),
    "Stacks": (stacks.spectrum, stacks.limits, stacks.pavement, stacks.runs, stacks.different_shifts),
    "Adhesion": (
        adhesion.line_jkr,
        adhesion.wave,
        adhesion.full_contact,
        adhesion.sphere,
        adhesion.rigid_sphere,
        adhesion.pull_in,
        adhesion.flat_film,
        adhesion.delayed_pull_in,
        adhesion.rate_dependence,
        adhesion.size_of_the_step,
        adhesion.flat_punch,
        adhesion.thin_films,
    ),
    "Leakage, conductance and stiffness of a contact": (
        transport.leakage,
        transport.closing,
        transport.conductance,
        transport.stiffness,
    ),
    "Independent methods": (
        crosschecks.three_solvers,
        crosschecks.two_forms_of_backward_euler,
        crosschecks.load_against_depth,
        crosschecks.lines_and_surfaces,
        crosschecks.recorded_results,
    ),
    "Isolated indentation": (
        indentation.indented_halfspace,
        indentation.indented_layer,
        indentation.indented_over_time,
        indentation.isolated_and_periodic,
        indentation.without_images,
        indentation.peeled_sphere,
        indentation.peeled_thin_layer,
    ),
    "Hardness": (hardness.yielding, hardness.over_time),
    "Other codes": (crosschecks.tamaas, crosschecks.contact_mechanics, hardness.saturated),
}
_PEERS: dict[object, str] = {
    crosschecks.tamaas: "tamaas",
    crosschecks.contact_mechanics: "ContactMechanics",
    hardness.saturated: "tamaas",
}
CHECKS = tuple(
    Check(group, find, _PEERS.get(find, "")) for group, members in _GROUPS.items() for find in members
)


def verify(
    out: Path | None = None,
    *,
    quick: bool = False,
    jobs: int = 1,
    report: Callable[[Check, CheckResult], None] = lambda _check, _outcome: None,
    checks: Sequence[Check] | None = None,
) -> bool:
    """Carry out the checks; return whether every row lies inside its bound.

    Checks against codes that are not installed do not count. With `out`, a folder, verification.md and its
    pictures are written there; `report` gets each check and its outcome in the order of the table.
    """
    checks = CHECKS if checks is None else checks
    if out is not None:
        write_report(out, [], quick)  # fails before the work if it cannot be written
    outcomes = []
    for check, outcome in zip(checks, _outcomes(checks, quick, jobs), strict=True):
        report(check, outcome)
        outcomes.append((check, outcome))
    if out is not None:
        write_report(out, outcomes, quick)
    return all(outcome.holds for _, outcome in outcomes)


def _outcomes(checks: Sequence[Check], quick: bool, jobs: int) -> Iterator[CheckResult]:
    task = partial(carry_out, quick=quick)
    if jobs == 1:
        yield from map(task, checks)
        return
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        yield from pool.map(task, checks)
