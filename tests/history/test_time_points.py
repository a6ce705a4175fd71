"""The time points of a run, and its rows and progress at each."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gfmdlayer.case.case import Case
from gfmdlayer.case.model import ConvergenceError, simulate
from gfmdlayer.config import Config
from gfmdlayer.config.sections import whole_steps
from gfmdlayer.grid.grid import Grid
from gfmdlayer.history.time_points import Instant, equal_steps, landing_steps
from gfmdlayer.punch.simple_shapes import Parabola

times = st.floats(1e-3, 10.0)


def test_equal_steps_start_with_a_step_from_rest_to_zero_and_stop_at_the_end():
    steps = list(equal_steps(1.0, 0.1, [], []))
    assert [round(instant.time / 0.1, 9) for instant in steps] == list(range(11))
    assert {instant.step for instant in steps} == {0.1}
    assert not any(instant.snapshot or instant.breakpoint for instant in steps)


def test_equal_steps_mark_the_snapshots_and_the_last_time_before_each_breakpoint():
    steps = list(equal_steps(2.0, 0.05, [0.0, 0.3, 2.0], [0.15, 1.02]))
    assert [i.time for i in steps if i.snapshot] == pytest.approx([0.0, 0.3, 2.0], rel=1e-12, abs=0)
    assert [i.time for i in steps if i.breakpoint] == pytest.approx([0.15, 1.0], rel=1e-12)


@pytest.mark.parametrize(("time", "whole"), [(0.3, True), (0.0, True), (0.33, False), (0.1 * 3, True)])
def test_a_whole_number_of_steps_may_be_off_by_rounding_only(time, whole):
    assert whole_steps(time, 0.1) is whole
    assert whole_steps(time + 1e-6, 0.1) is False


@settings(deadline=None)
@given(
    end=times,
    step=st.floats(0.02, 20.0),
    snapshots=st.lists(st.floats(0.0, 1.0), max_size=5),
    breakpoints=st.lists(times, max_size=5),
)
@example(end=1.0, step=0.05, snapshots=[0.1 * 3 / 1.0], breakpoints=[0.3])
@example(end=8.0, step=0.005, snapshots=[0.125 * (1 + 1e-12)], breakpoints=[1.0])
@example(end=0.1, step=0.1, snapshots=[0.0, 1.0], breakpoints=[0.1])
def test_steps_land_on_every_snapshot_and_breakpoint(end, step, snapshots, breakpoints):
    asked = [fraction * end for fraction in snapshots]
    steps = list(landing_steps(end, step, asked, breakpoints))
    assert steps[0] == Instant(0.0, 0.0, snapshot=0.0 in asked)
    assert steps[-1].time == pytest.approx(end, rel=1e-12)
    for before, after in pairwise(steps):
        assert after.time > before.time
        assert after.step == pytest.approx(after.time - before.time, rel=1e-6, abs=1e-14 * end)
        assert after.step <= step * (1 + 2e-6)
    # Times closer than a millionth of a step may share one; none is lost.
    for mark, wanted in (("snapshot", asked), ("breakpoint", [t for t in breakpoints if t < end])):
        found = [instant.time for instant in steps if getattr(instant, mark)]
        assert len(found) <= len(set(wanted))
        for time in wanted:
            assert any(math.isclose(time, t, rel_tol=1e-9, abs_tol=2e-6 * step) for t in found)


SMALL = {"grid.points": 256, "time.end": 1.5, "time.step": 0.125}


@pytest.mark.parametrize("integrator", ["backward_euler", "exponential"])
def test_every_step_from_rest_on_has_a_row(integrator, run):
    found = run(SMALL | {"time.integrator": integrator, "output.snapshots": [0.0, 0.5, 1.5]})
    np.testing.assert_allclose(found["time"], np.arange(13) * 0.125, rtol=1e-12)
    np.testing.assert_allclose(found["depth"], 0.01 * np.minimum(found["time"], 1), rtol=1e-12)
    assert found["mean_pressure"][0] == pytest.approx(0, abs=1e-12)
    assert found["contact_area"][0] <= 1 / 256  # the apex
    assert (found["residual"] <= 1e-6).all()
    assert (found["transforms"] >= found["iterations"]).all()
    assert [time for time, _, _ in found.snapshots] == pytest.approx([0.0, 0.5, 1.5])
    heights = Parabola().heights(Grid((256,), (1.0,)))
    for time, u, p in found.snapshots:
        assert u.shape == p.shape == (256,)
        assert (u <= heights - 0.01 * min(time, 1.0)).all()
        assert abs(u.mean()) <= 1e-15


def test_a_step_that_does_not_converge_ends_the_run(recorder):
    config = Config(name="hopeless").with_values(SMALL | {"solver.max_iterations": 3})
    with pytest.raises(
        ConvergenceError, match=r"t = 0\.125: residual .* after 3 iterations of active_set; the tolerance"
    ):
        simulate(config, recorder())


def test_progress_is_called_after_every_step_and_may_stop_the_run(recorder):
    times = []

    def stop(time):
        times.append(time)
        if time >= 0.5:
            raise KeyboardInterrupt

    found, case = recorder(), Case(Config(name="stopped").with_values(SMALL))
    case.stepwise = True
    with pytest.raises(KeyboardInterrupt):
        simulate(case, found, stop)
    assert len(found.rows) == len(times) == 5
