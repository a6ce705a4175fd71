"""A simulation with a part of one's own: a body that the package does not have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config

N, DEPTH, STEP, TOLERANCE = 256, 0.01, 0.05, 1e-9


@dataclass(frozen=True)
class Foundation:
    """Independent springs (Winkler), each a standard solid: K = k + w s theta/(1 + s theta) at every q."""

    k: float
    w: float
    theta: float

    @property
    def mean_stiffness(self):
        return self.k

    def stiffness(self, q, s):
        cycles = np.asarray(s) * self.theta
        return np.asarray(self.k + self.w * cycles / (1 + cycles) + 0 * np.asarray(q))

    def spectrum(self, q):
        one = np.ones(np.shape(q))
        modes = 1 if self.w else 0
        return Spectrum(self.k * one, np.array([self.w * one] * modes).reshape(modes, *one.shape),
                        np.array([self.theta * one] * modes).reshape(modes, *one.shape))  # fmt: skip


def case(body, values):
    config = {
        "grid.points": N,
        "time": {"end": 1.0, "step": STEP, "integrator": "exponential"},
        "solver.tolerance": TOLERANCE,
        "output.snapshots": [1.0],
    }
    return Case(Config(name="foundation").with_values(config | values), body=body)


@pytest.mark.parametrize("method", ["active_set", "conjugate_gradient", "fire"])
@pytest.mark.parametrize("control", ["depth", "load"])
def test_springs_press_in_proportion_to_the_overlap(recorder, method, control):
    amount = {"depth": DEPTH, "load": 0.002}[control]
    asked = {"trajectory": {"control": control, control: amount}, "solver.method": method}
    k, found = 2.0, recorder()
    mine = case(Foundation(k, 0.0, 1.0), asked)
    simulate(mine, found)
    _, u, p = found.snapshots[0]
    overlap = np.maximum(found["depth"][-1] - mine.punch, 0)
    assert 0 < np.count_nonzero(overlap) < N
    # Gaps left in the contact and pressures outside are the tolerance of the largest.
    close = 2 * TOLERANCE * overlap.max()
    np.testing.assert_allclose(p, k * overlap, rtol=0, atol=k * close)
    np.testing.assert_allclose(u, -overlap, rtol=0, atol=close)
    assert found["stored"][-1] == pytest.approx(np.mean(k * overlap**2) / 2, rel=1e-6)


def test_relaxing_springs_follow_the_hereditary_integral_point_by_point(recorder):
    # A point that is touched at t0 is moved at v: p = k v (t - t0) + w v theta (1 - exp(-(t - t0)/theta)).
    found, body, t = recorder(), Foundation(1.0, 9.0, 0.3), 1.0
    mine = case(body, {})
    simulate(mine, found)
    _, _, p = found.snapshots[0]
    since = np.maximum(t - mine.punch / DEPTH, 0)
    exact = DEPTH * (body.k * since + body.w * body.theta * (1 - np.exp(-since / body.theta)))
    # The scheme is exact but for the step in which a point is touched: it moves less than v dt at a time that
    # is off by less than dt. The solver's tolerance is of the glassy stiffness.
    bound = body.w * DEPTH * STEP**2 / body.theta + 2 * TOLERANCE * (body.k + body.w) * DEPTH
    np.testing.assert_allclose(p, exact, rtol=0, atol=bound)
    assert bound < 0.05 * exact.max()


def test_a_part_that_does_not_exist_is_refused():
    with pytest.raises(TypeError, match="a case has no part bodi"):
        Case(Config(name="x"), bodi=Foundation(1.0, 0.0, 1.0))
