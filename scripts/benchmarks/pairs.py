"""FFT pairs per time step: of each solver on growing grids; of FIRE by inertia and first guess."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from benchmarks.common import METHODS, STEP, default_case, run
from benchmarks.tables import Cell, Effort, Table

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.prediction import DisplacementPrediction
from gfmdlayer.model import simulate, warm_up
from gfmdlayer.resumable import Stateless
from gfmdlayer.simulation import Case
from gfmdlayer.verification.runs import Recording

EFFORT = Effort(points=(1 << 12, 1 << 14, 1 << 16))
QUICK = Effort(points=(1 << 10, 1 << 12), steps=100)
LARGE = 1 << 20  # only for the active set

_INGREDIENTS_AT = 1 << 14
_STARTS = {1: "last step", 2: "linear", 3: "quadratic"}  # by the number of past steps


def measure(effort: Effort) -> Iterator[Table]:
    """Count the pairs of all steps after t = 0."""
    rows = [
        _row(method, points, effort.steps)
        for method in METHODS
        for points in effort.points
        if points < LARGE or method == "active_set"
    ]
    title = f"FFT pairs per step, {effort.steps} steps of {STEP} tau, residual 1e-6"
    note = (
        "Targets at n = 16384: active_set ≤ 8 in the ramp and ≤ 5 in the hold; "
        "fire ≤ 120 over all steps, at n = 65536 at most 1.5 times as many. FIRE is mass-weighted here."
    )
    yield Table("pairs", title, rows, note)
    at = max((points for points in effort.points if points <= _INGREDIENTS_AT), default=effort.points[0])
    ingredients: list[dict[str, Cell]] = [
        {"inertia": inertia, "start": start, **_counts(_fire(at, effort.steps, inertia, past))}
        for inertia in ("uniform", "mass_weighted")
        for past, start in _STARTS.items()
    ]
    yield Table("ingredients", f"FIRE by inertia and first guess: FFT pairs per step, n = {at}", ingredients)


def _row(method: str, points: int, steps: int) -> dict[str, Cell]:
    config = default_case(
        grid__points=points, time__end=steps * STEP, solver={"method": method, "tolerance": 1e-6}
    )
    trace = run(config)
    return {
        "solver": method,
        "n": points,
        **_counts(trace),
        "most": int(trace["transforms"][1:].max()),
        "largest residual": float(trace["residual"].max()),
    }


def _counts(trace: Recording) -> dict[str, Cell]:
    """Mean FFT pairs of a step in the ramp, in the hold, and in both."""
    times, pairs = trace["time"][1:], trace["transforms"][1:]
    in_ramp = times <= 1 + STEP / 2
    return {
        "ramp": _mean(pairs[in_ramp]),
        "hold": _mean(pairs[~in_ramp]),
        "all": _mean(pairs),
    }


def _mean(values: FloatArray) -> float | None:
    return float(values.mean()) if values.size else None


class _Polynomial(Stateless):
    """Extrapolation of the displacement by a polynomial through the last `past` steps."""

    def __init__(self, points: int, past: int) -> None:
        self._size, self._fields = points, deque[tuple[float, FloatArray]](maxlen=past)

    def at(self, time: float) -> FloatArray:
        """Return the displacement at a time."""
        guess = DisplacementPrediction(self._size)
        for each, field in self._fields:
            guess.remember(each, field, field)
        return guess.at(time)

    def remember(self, time: float, field: FloatArray, _gap: FloatArray, at_breakpoint: bool = False) -> None:
        """Keep an accepted step; the polynomial uses no step before a breakpoint."""
        if at_breakpoint:
            self._fields.clear()
        self._fields.append((time, field))


def _fire(points: int, steps: int, inertia: str, past: int) -> Recording:
    """Run FIRE, started from a polynomial through `past` earlier fields."""
    config = default_case(
        grid__points=points, time__end=steps * STEP, solver={"method": "fire", "inertia": inertia}
    )
    recording = Recording()
    simulate(Case(config, warm_up(config), guess=_Polynomial(points, past)), recording)
    return recording
