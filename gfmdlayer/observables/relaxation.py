"""Temperature and shift factor over time; errors of the Prony series in place of a continuous law."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from gfmdlayer.body.materials import Material
from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts

if TYPE_CHECKING:
    from gfmdlayer.config import Config


class Temperature(Observable):
    """Temperature of the body, and the factor of relaxation times of the uppermost material with a shift."""

    COLUMNS = (
        Column("temperature", "temperature of the body", "degrees Celsius", symbol="T", origin="as given"),
        Column(
            "shift_factor",
            "aT, factor of relaxation times, of the uppermost material with a shift",
            origin="from the relaxation times at the reference temperature",
        ),
    )

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case with a temperature."""
        return None if config.temperature is None else cls.COLUMNS

    def __init__(self, case: Parts) -> None:
        self._clock = next(clock for clock in case.clocks if clock is not None)

    def measure(self, step: AcceptedStep) -> Mapping[str, float]:
        """Return both at the end of the step."""
        temperature = self._clock.temperature(step.time)
        return {"temperature": temperature, "shift_factor": self._clock.shift.factor(temperature)}


class SpectrumError(Observable):
    """Attribute of a case with a stack, whose modes are merged; has no column.

    It is `spectrum_error`, a bound on the relative error of the stiffness K(q, s) at all q and s >= 0.
    """

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return no columns, where there is a stack."""
        return None if config.layers is None and config.halfspace.material is None else ()

    def __init__(self, case: Parts) -> None:
        self.attributes = {"spectrum_error": case.integrator.spectrum_error}


class SeriesError(Observable):
    """Attributes of a case with laws that are replaced by Prony series; has no column.

    They are the number of branches of all, `law_branches`, the bounds `law_error_in_time` and
    `law_error_in_frequency` on the relative errors of G(t) and G(omega), and the range in which these hold:
    times, and reciprocal angular frequencies, from `law_shortest_time` to `law_longest_time`.
    """

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return no columns, where a law is not a series itself."""
        return None if all(isinstance(law, Material) for law in config.laws) else ()

    def __init__(self, case: Parts) -> None:
        found = case.series
        self.attributes = {
            "law_branches": sum(len(series.material.maxwell_branches) for series in found),
            "law_error_in_time": max(series.error_in_time for series in found),
            "law_error_in_frequency": max(series.error_in_frequency for series in found),
            "law_shortest_time": max(series.shortest for series in found),
            "law_longest_time": min(series.longest for series in found),
        }
