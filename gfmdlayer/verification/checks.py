"""The table of checks, and `verify`, which carries them out and writes the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from gfmdlayer.verification import (
    closed_forms,
    crosschecks,
    energy,
    indentation,
    limits,
    orders,
    peers,
    stacks,
)
from gfmdlayer.verification.adhesion import elastic, films, viscoelastic
from gfmdlayer.verification.report import write_report
from gfmdlayer.verification.rows import Check, Outcome, carry_out

CHECKS: tuple[Check, ...] = (
    Check("Closed forms", closed_forms.periodic_parabola),
    Check("Closed forms", closed_forms.hertz_line),
    Check("Closed forms", closed_forms.hertz_sphere),
    Check("Closed forms", closed_forms.westergaard),
    Check("Closed forms", closed_forms.thin_layer),
    Check("Closed forms", closed_forms.full_contact),
    Check("Closed forms", closed_forms.depth_control),
    Check("Closed forms", closed_forms.load_control),
    Check("Limits", limits.stiffness_limits),
    Check("Limits", limits.printed_equation),
    Check("Limits", limits.relaxing_modes),
    Check("Limits", limits.limiting_bodies),
    Check("Limits", limits.fast_and_slow),
    Check("Laws and temperature", crosschecks.series_of_laws),
    Check("Laws and temperature", crosschecks.jump_of_temperature),
    Check("Orders", orders.time_steps),
    Check("Orders", orders.papers_step),
    Check("Orders", orders.grid_spacing),
    Check("Orders", orders.solver_tolerance),
    Check("Energy", energy.stored_energy),
    Check("Energy", energy.balance),
    Check("Energy", energy.cycle),
    Check("Stacks", stacks.spectrum),
    Check("Stacks", stacks.limits),
    Check("Stacks", stacks.pavement),
    Check("Stacks", stacks.runs),
    Check("Stacks", stacks.different_shifts),
    Check("Adhesion", elastic.line_jkr),
    Check("Adhesion", elastic.wave),
    Check("Adhesion", elastic.full_contact),
    Check("Adhesion", elastic.sphere),
    Check("Adhesion", elastic.rigid_sphere),
    Check("Adhesion", films.pull_in),
    Check("Adhesion", films.flat_film),
    Check("Adhesion", films.delayed_pull_in),
    Check("Adhesion", viscoelastic.rate_dependence),
    Check("Adhesion", viscoelastic.size_of_the_step),
    Check("Adhesion", viscoelastic.flat_punch),
    Check("Adhesion", viscoelastic.thin_films),
    Check("Independent methods", crosschecks.three_solvers),
    Check("Independent methods", crosschecks.two_forms_of_backward_euler),
    Check("Independent methods", crosschecks.load_against_depth),
    Check("Independent methods", crosschecks.lines_and_surfaces),
    Check("Independent methods", crosschecks.recorded_results),
    Check("Isolated indentation", indentation.indented_halfspace),
    Check("Isolated indentation", indentation.indented_layer),
    Check("Isolated indentation", indentation.indented_over_time),
    Check("Isolated indentation", indentation.isolated_and_periodic),
    Check("Isolated indentation", indentation.peeled_sphere),
    Check("Other codes", peers.tamaas, peer="tamaas"),
    Check("Other codes", peers.contact_mechanics, peer="ContactMechanics"),
)


def verify(
    out: Path | None = None,
    *,
    quick: bool = False,
    jobs: int = 1,
    report: Callable[[Check, Outcome], None] = lambda _check, _outcome: None,
    checks: Sequence[Check] | None = None,
) -> bool:
    """Carry out the checks and write the report."""
    checks = CHECKS if checks is None else checks
    if out is not None:
        write_report(out, [], quick)  # before the work, to find out whether it can be written
    outcomes = []
    for check, outcome in zip(checks, _outcomes(checks, quick, jobs), strict=True):
        report(check, outcome)
        outcomes.append((check, outcome))
    if out is not None:
        write_report(out, outcomes, quick)
    return all(outcome.holds for _, outcome in outcomes)


def _outcomes(checks: Sequence[Check], quick: bool, jobs: int) -> Iterator[Outcome]:
    task = partial(carry_out, quick=quick)
    if jobs == 1:
        yield from map(task, checks)
        return
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        yield from pool.map(task, checks)
