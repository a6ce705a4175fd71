"""Prescribed functions of time: depth of the punch or mean pressure on it, and its velocity."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.validation.reading import Reading


class TimeFunction(Protocol):
    """A piecewise smooth function of time, t >= 0."""

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times t > 0 at which its slope jumps; an integrator of second order must step onto them."""
        ...

    def __call__(self, time: float, /) -> float:
        """Value at a time."""
        ...


@dataclass(frozen=True)
class RampHold:
    """Eq. (30): grows linearly to ``target`` over ``ramp_time``, then rests."""

    target: float
    ramp_time: float

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """The end of the ramp."""
        return (self.ramp_time,)

    def __call__(self, time: float) -> float:
        """Value at a time."""
        return self.target * min(time / self.ramp_time, 1.0)


@dataclass(frozen=True)
class Constant:
    """The same at all times."""

    value: float
    breakpoints: tuple[float, ...] = ()

    def scaled(self, ratio: float) -> Constant:
        """Return a multiple of this velocity."""
        return Constant(self.value * ratio)

    def over(self, _begin: float, _length: float, /) -> tuple[float, float]:
        """Values at the ends of a stretch of time, over which it is linear."""
        return self.value, self.value

    def __call__(self, _time: float, /) -> float:
        """Value at a time."""
        return self.value


@dataclass(frozen=True)
class Table:
    """Linear between the rows of a table, constant after the last."""

    times: FloatArray
    values: FloatArray
    account: str = field(default="", compare=False)  # how its file was read

    @classmethod
    def read(
        cls,
        file: Path,
        quantity: str,
        into: tuple[str | None, str | None] = (None, None),
        reading: Reading | None = None,
        refused: Callable[[float], str] | None = None,
    ) -> Table:
        """Read the columns time and `quantity`; the times start at 0 and increase, or TableError.

        `into` are the units of the configuration for both, or None; `refused` returns the reason why a value
        cannot be used, if any.
        """
        import numpy as np

        from gfmdlayer.files.tables import TableError, read_table
        from gfmdlayer.validation.reading import answers

        key = "velocity_reading" if quantity == "velocity" else "reading"
        table = read_table(file, ("time", quantity), answers(reading, key))
        times, values = table.take("time", into[0]), table.take(quantity, into[1])
        if (back := np.flatnonzero(np.diff(times) <= 0)).size:
            row = int(back[0]) + 1
            order = f"time = {times[row]:g} after {times[row - 1]:g}"
            raise TableError(f"{table.place(row)}: {order}; must increase from row to row")
        for row, value in enumerate(values.tolist() if refused else ()):
            if refused and (wrong := refused(value)):
                raise TableError(f"{table.place(row)}: {wrong}")
        if times[0] != 0:
            start = "must be 0, where the simulation starts"
            raise TableError(f"{file}: the first time is {times[0]:g}; {start}")
        return cls(times, values, table.account)

    def scaled(self, ratio: float) -> Table:
        """Return a multiple of this velocity."""
        return Table(self.times, self.values * ratio)

    def over(self, begin: float, length: float) -> tuple[float, float]:
        """Values at the ends of a stretch of time, over which it is linear."""
        return self(begin), self(begin + length)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """The times of the rows but the first."""
        return tuple(self.times[1:].tolist())

    def __call__(self, time: float) -> float:
        """Value at a time, as `numpy.interp` has it."""
        times, values = self._rows
        after = bisect_right(times, time)
        if not 0 < after < len(times):
            return values[-1 if after else 0]
        begun, value = times[after - 1], values[after - 1]
        slope = (values[after] - value) / (times[after] - begun)
        return value if time == begun else float(slope * (time - begun) + value)

    @cached_property
    def _rows(self) -> tuple[list[float], list[float]]:
        """Times and values as Python's numbers, which take a tenth of the time of arrays."""
        return self.times.tolist(), self.values.tolist()


@dataclass(frozen=True)
class Oscillation:
    """amplitude sin(2 pi (t - start)/period) from `start` on, for a number of cycles, not always whole."""

    amplitude: float
    period: float
    start: float
    cycles: float

    @property
    def turns(self) -> tuple[float, ...]:
        """The turning points, at which slip ends."""
        turns = range(math.ceil(2 * self.cycles - 0.5 - 1e-9))
        return tuple(self.start + self.period * (0.25 + 0.5 * turn) for turn in turns)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Start and end, and the turning points."""
        return tuple(dict.fromkeys((self.start, *self.turns, self.start + self.period * self.cycles)))

    def __call__(self, time: float) -> float:
        """Value at a time."""
        passed = min(max((time - self.start) / self.period, 0.0), self.cycles)
        return self.amplitude * math.sin(2 * math.pi * (passed % 1.0))


def distance(velocity: Constant | Table, time: float) -> float:
    """Integral of a velocity from 0 to a time."""
    if isinstance(velocity, Constant):
        return velocity.value * time
    import numpy as np

    times = np.append(velocity.times[velocity.times < time], time)
    values = np.array([velocity(t) for t in times])
    return float((np.diff(times) * (values[1:] + values[:-1]) / 2.0).sum())  # NumPy 1 has no trapezoid
