"""The checks of `gfmdlayer verify`, a line each."""

from __future__ import annotations

from gfmdlayer.verification import balance, closed_forms, crosschecks, limits, orders, peers, viscoelastic
from gfmdlayer.verification.rows import Check

CHECKS: tuple[Check, ...] = (
    Check("Closed forms", closed_forms.periodic_parabola),
    Check("Closed forms", closed_forms.hertz_line),
    Check("Closed forms", closed_forms.hertz_sphere),
    Check("Closed forms", closed_forms.westergaard),
    Check("Closed forms", closed_forms.thin_layer),
    Check("Closed forms", closed_forms.full_contact),
    Check("Closed forms", viscoelastic.depth_control),
    Check("Closed forms", viscoelastic.load_control),
    Check("Limits", limits.stiffness_limits),
    Check("Limits", limits.printed_equation),
    Check("Limits", limits.relaxing_modes),
    Check("Limits", limits.limiting_bodies),
    Check("Limits", limits.fast_and_slow),
    Check("Orders", orders.time_steps),
    Check("Orders", orders.papers_step),
    Check("Orders", orders.grid_spacing),
    Check("Orders", orders.solver_tolerance),
    Check("Energy", viscoelastic.stored_energy),
    Check("Energy", balance.closing),
    Check("Energy", balance.cycle),
    Check("Independent methods", crosschecks.three_solvers),
    Check("Independent methods", crosschecks.two_forms_of_backward_euler),
    Check("Independent methods", crosschecks.load_against_depth),
    Check("Independent methods", crosschecks.lines_and_surfaces),
    Check("Independent methods", crosschecks.recorded_answers),
    Check("Other codes", peers.tamaas, peer="tamaas"),
    Check("Other codes", peers.contact_mechanics, peer="ContactMechanics"),
)
