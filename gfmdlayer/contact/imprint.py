"""Hardness: contact pressures end at H, and the surfaces lose height there.

Perfect plasticity in series with the body, along the normal, without hardening. The pressure of the wall
satisfies 0 <= p <= H, and the imprint W >= 0 is the height lost so far at each point. A step finds

    min over p of p.A p/2 + (gap0 + W).p        0 <= p <= H, of the given load where there is one

with gap0 the gap without pressure, and A the compliance. With g = gap0 + W + A p,

    p = 0: g >= 0,        0 < p < H: g = 0,        p = H: g <= 0, and then W grows by -g.

-g is the multiplier of p <= H. The dual problem is the least sum of elastic energy and H (W' - W) over
displacements u <= h + W' and W' >= W: an implicit step of flow, of which H times the growth of W is the work.
With attraction the pressure of the wall, p + tau(g), ends at H; the flow leaves no gap, and its work is that
of the stress H - tau(0).
So W does not depend on the number of steps as long as no point leaves the hardness.

W belongs to punch and body together: it adds to the height of the punch, and is no displacement of the body.
So it leaves no stress in the body's memory.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.resumable import State


class Imprint:
    """The height W that punch and surface have lost, one value a point; none with an infinite hardness."""

    def __init__(self, size: int, hardness: float) -> None:
        self.hardness, self.yields = hardness, hardness < math.inf
        self.depth = np.zeros(size if self.yields else 0)

    def under(self, problem: Problem) -> Problem:
        """Return the problem of a step with the height lost so far, and with pressures up to the hardness."""
        if not self.yields:
            return problem
        return replace(problem, obstacle=problem.obstacle + self.depth, hardness=self.hardness)

    def remember(self, solution: Solution) -> None:
        """Add the flow of an accepted step."""
        if solution.flow is not None:
            self.depth = self.depth + solution.flow

    def state(self) -> State:
        """Return the height lost."""
        return {"depth": self.depth} if self.yields else {}

    def restore(self, state: State) -> None:
        """Continue from there."""
        if self.yields:
            self.depth = np.asarray(state["depth"])
