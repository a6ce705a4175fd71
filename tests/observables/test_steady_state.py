"""Steady state: nothing may change over a whole window of time."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from gfmdlayer.config import Config
from gfmdlayer.observables.steady_state import SteadyState

CONFIG = Config(name="steady").with_values({"trajectory.velocity": 1.0, "time.steady": 1e-3})


def steady_time(friction: Callable[[float], float], since: float = 0.0) -> float:
    """Return the time at which a window of length 2 is steady, with steps of 0.25."""
    slow = SimpleNamespace(slowest=lambda _tolerance: 2.0)
    case: Any = SimpleNamespace(config=CONFIG, integrator=slow, breakpoints=(since,), reduced_time=None)
    observable = SteadyState(case)
    solution, surface = SimpleNamespace(mean_pressure=1.0), SimpleNamespace(depth=0.01)
    for time in (0.25 * i for i in range(1000)):
        row = {"friction": friction(time)}
        step: Any = SimpleNamespace(time=time, solution=solution, surface=surface, row=row)
        assert observable.measure(step) == {}
        if observable.finished:
            assert observable.attributes == {"settled": 1, "steady_time": time}
            assert observable.warning == ""
            return time
    assert observable.attributes == {"settled": 0}
    assert "NOT STEADY" in observable.warning
    return math.inf


@pytest.mark.parametrize(
    ("friction", "since", "expected"),
    [
        (lambda _: 0.1, 0.0, 2.0),
        (lambda _: 0.1, 3.1, 5.25),
        (lambda t: 0.1 * (1 + math.exp(-t)), 0.0, 10.0),  # exp(-8) = 3e-4 is left as the window begins
        (lambda t: 0.1 * (1 + 0.01 * math.sin(t)), 0.0, math.inf),
        (lambda t: math.nan if t < 7 else 0.1, 0.0, 9.0),
    ],
    ids=["constant", "after a breakpoint", "decaying", "oscillating", "without contact at first"],
)
def test_it_is_reached_after_a_window_without_change(
    friction: Callable[[float], float], since: float, expected: float
) -> None:
    assert steady_time(friction, since) == expected
