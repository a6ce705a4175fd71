"""Histories whose control changes between depth and force."""

from __future__ import annotations

import numpy as np

from gfmdlayer import Zener, bonded_layer
from gfmdlayer.indentation.solve import History, find_space, on_halved_steps
from gfmdlayer.punch.revolution import sphere


def test_force_in_place_of_depth_in_the_middle_of_a_history_gives_the_same_contact() -> None:
    # The forces of a run under depth are prescribed between 0.5 and 2.5. Both are extrapolated in the step,
    # to some 1e-5 of the largest values with these 60 steps.
    body, profile = bonded_layer(thickness=2.0, material=Zener(1.5, 6.0, 0.8), base=np.inf), sphere(5.0)
    history = History(np.array([0.0, 1.0, 5.0]), np.array([0.0, 0.4, 0.2]))
    times = np.unique(np.concatenate((np.linspace(0, 1, 20), np.linspace(1, 5, 40))))
    space = find_space(body, profile, history)
    found = on_halved_steps(body, space, profile, history, times)
    by_force = (found.time > 0.5) & (found.time < 2.5)
    mixed = History(found.time, np.where(by_force, found.force, found.depth), by_force)
    again = on_halved_steps(body, space, profile, mixed, times)
    assert np.abs(again.depth - found.depth).max() < 1e-4 * found.depth.max()
    assert np.abs(again.force - found.force).max() < 1e-4 * found.force.max()
