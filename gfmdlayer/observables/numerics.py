"""Numerics of a run: effort of each step, errors of the series and modes, and the steady state at its end."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gfmdlayer.body.materials import Material
from gfmdlayer.observables.observable import Column, Observable, Observed, declared

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gfmdlayer.config import Config
    from gfmdlayer.step import Step


class Effort(Observable):
    """Counts transforms, iterations and attempts until a step is accepted."""

    COLUMNS = declared("""
        transforms | pairs of Fourier transforms (forward and backward) spent on the step; a pair over a
          window counts as its part of the surface | 1 | in this step, rejected attempts included | | i8
        iterations | iterations of the contact solver in the step | 1 |
          in this step, rejected attempts included | | i8
        rejected | attempts at the step that were rejected | 1 |
          in this step, rejected attempts included | | i8
        """)
    KEPT = "transforms", "iterations", "attempts"

    def __init__(self, _case: Observed) -> None:
        self._transforms = self._iterations = self._attempts = 0

    def attempt(self, step: Step) -> None:
        """Count an attempt."""
        self._transforms += step.pairs
        self._iterations += step.iterations
        self._attempts += 1

    def measure(self, _step: Step) -> Mapping[str, float]:
        """Return the counts and begin at zero for the next step."""
        made = self._transforms, self._iterations, self._attempts - 1
        counts = {column.name: count for column, count in zip(self.COLUMNS, made, strict=True)}
        self._transforms = self._iterations = self._attempts = 0
        return counts


class SpectrumError(Observable):
    """Attribute `spectrum_error` of a case with a stack, whose modes are merged.

    It is a bound on the relative error of the stiffness K(q, s) at all q and s >= 0.
    """

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return no columns, where modes may be merged."""
        return () if config.solid.merges and not config.friction else None

    def __init__(self, case: Observed) -> None:
        self.attributes = {"spectrum_error": case.history.spectrum_error}


class SeriesError(Observable):
    """Attributes of a case with continuous laws, which Prony series replace.

    They are the number of all branches, `law_branches`; bounds on the relative errors of G(t) and G(omega),
    `law_error_in_time` and `law_error_in_frequency`; and the range in which these hold: times, and reciprocal
    angular frequencies, from `law_shortest_time` to `law_longest_time`.
    """

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return no columns, where a law is not a series itself."""
        return None if all(isinstance(law, Material) for law in config.laws) else ()

    def __init__(self, case: Observed) -> None:
        laws = case.series
        self.attributes = {
            "law_branches": sum(len(series.material.maxwell_branches) for series in laws),
            "law_error_in_time": max(series.error_in_time for series in laws),
            "law_error_in_frequency": max(series.error_in_frequency for series in laws),
            "law_shortest_time": max(series.shortest for series in laws),
            "law_longest_time": min(series.longest for series in laws),
        }


# Numbers of a whole case, which `case.accuracy` finds at its end.
ACCURACY_PREFIX = "accuracy_"
ACCURACY = declared("""
    accuracy_area | estimated error of the interpolated contact area, relative | 1 | where this is largest
    accuracy_steps | tolerance of adaptive steps | 1 | of each step
    accuracy_residual | largest residual of the contact problem | 1 | over the steps
    accuracy_balance | largest residual of the energies over the largest work | 1 | over the steps
    accuracy_contact_points | most points in contact | 1 | over the steps
    accuracy_wave_points | points for the shortest wave of a rough surface | 1 | over the cell
    accuracy_fit | error of the compliance of an isolated body | 1 | relative
    accuracy_slope | largest slope of the punch | 1 | down to the largest depth
    accuracy_strain | largest strain, about: mean pressure in contact over 2 G(t), or depth over the thickness
      of all layers, whichever is less | 1 | over the steps
    """)

_ROUNDING = 1e-12  # of friction, where the body is elastic


class SteadyState(Observable):
    """Ends the run of a moving punch in its steady state; attributes `settled`, 0 or 1, and `steady_time`.

    Mean pressure, depth and friction have then each stayed within a tolerance, relative to their largest
    value, over a whole window of time: the time of the slowest process (`SlidingModes.slowest`).
    The first window begins with the last breakpoint of the drives, another one after each that was not
    steady. A state that is found at once is steady.
    """

    KEPT = "begun", "least", "most"  # no run is resumed from a steady state, which ends it

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return no columns, in a case with a steady state."""
        return None if config.time.steady is None else ()

    def __init__(self, case: Observed) -> None:
        time = case.config.time
        assert time.steady is not None
        self._at_once = time.at_once
        self._tolerance = 0.0 if isinstance(time.steady, str) else time.steady
        reduced = case.drives.reduced_time
        slowdown = 1.0 if reduced is None else reduced.factor(math.inf)
        self._window = 0.0 if self._at_once else case.history.slowest(self._tolerance) * slowdown
        self._since = max(case.drives.breakpoints, default=0.0)
        self._begun = math.inf
        self._least: tuple[float, ...] = ()
        self._most: tuple[float, ...] = ()
        self.attributes = {"settled": 0}
        within = "" if self._at_once else f" within {self._tolerance:g}"
        self.warning = f"NOT STEADY{within} at time.end = {time.end:g}"

    def measure(self, step: Step) -> Mapping[str, float]:
        """Compare the step with the others of its window."""
        if self._at_once:
            self._settle(step.time)
            return {}
        values = step.mean_pressure, step.depth, float(step.row["friction"])
        if step.time < self._since or math.isnan(values[-1]):
            return {}
        if self._begun == math.inf:
            self._begin(step.time, values)
            return {}
        self._least = tuple(map(min, self._least, values))
        self._most = tuple(map(max, self._most, values))
        if step.time - self._begun >= self._window * (1 - 1e-9):
            if all(map(self._is_steady, self._least, self._most)):
                self._settle(step.time)
            self._begin(step.time, values)
        return {}

    def into(self, record: NDArray[Any]) -> None:
        """Write tolerance and state into a record of a compiled loop."""
        now = record[0]
        now["asked"], now["settled"], now["rounding"] = True, math.nan, _ROUNDING
        now["tolerance"], now["window"], now["since"] = self._tolerance, self._window, self._since
        now["begun"] = self._begun
        if self._least:
            now["least"], now["most"] = self._least, self._most

    def out_of(self, record: NDArray[Any]) -> None:
        """Take over the state of a compiled loop."""
        now = record[0]
        if now["begun"] < math.inf:
            self._begin(float(now["begun"]), tuple(now["least"].tolist()))
            self._most = tuple(now["most"].tolist())
        if not math.isnan(now["settled"]):
            self._settle(float(now["settled"]))

    def _settle(self, time: float) -> None:
        self.finished, self.warning = True, ""
        self.attributes = {"settled": 1, "steady_time": time}

    def _is_steady(self, least: float, most: float) -> bool:
        return most - least <= self._tolerance * max(abs(least), abs(most)) + _ROUNDING

    def _begin(self, time: float, values: tuple[float, ...]) -> None:
        self._begun, self._least, self._most = time, values, values
