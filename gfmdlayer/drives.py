"""The quantities that a configuration imposes over time: drives, velocity, temperature, voltage.

`Drives` are made once for each case. The model, its footprint, the notes, the checks and growing studies
read it, so that the breakpoints of all imposed quantities are found in one place. Files are read when a
quantity is first used, and each file once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfmdlayer.body.materials import Material, PronySeries, shifts
from gfmdlayer.body.shifts import Shift
from gfmdlayer.config import Config
from gfmdlayer.config.sections import MOST_ROWS
from gfmdlayer.history import time_points
from gfmdlayer.interface.adhesion import Electrostatic
from gfmdlayer.step import Instant
from gfmdlayer.time_functions import Constant, Oscillation, RampHold, Table, TimeFunction
from gfmdlayer.validation.reading import Reading
from gfmdlayer.validation.units import label_of

if TYPE_CHECKING:
    from gfmdlayer.history.reduced_time import ReducedTime
    from gfmdlayer.interface.friction import ShearBound
    from gfmdlayer.interface.law import Interaction


# Steps of a stretch in which a punch with friction moves, times the root of the tolerance: 50 at 1e-4. The
# tangential force is then within about the tolerance (measured, docs/theory/friction.md).
_STEPS_OF_SLIP = 0.5
# The same where contact begins: there each step leaves some 0.02 (step/time)^2 of the force. And before a
# swing ends: a body that relaxes sticks again when the punch has become slow enough.
_FIRST_PART, _GROWTH, _GROWTH_OF_SWING = 10.0, 10.0, 30.0

# The imposed quantities in files: their names in headings, and their units in words of a configuration.
_IMPOSED = {
    "depth": ("depth", "length"), "gap": ("mean gap", "length"), "load": ("mean pressure", "pressure"),
    "force": ("force", "force"),
    "velocity": ("velocity", "length / time"), "displacement": ("displacement", "length"),
    "tangential force": ("tangential force", "force"), "temperature": ("temperature", "degC"),
    "voltage": ("voltage", "V"),
}  # fmt: skip
_LEAST_WORK = 1e-6  # of the work of adhesion, beside which energies of a distant punch are rounding
_ALONG = {"displacement": "displacement", "force": "tangential force"}  # the surface


def _growing(tolerance: float, factor: float = _GROWTH) -> Iterator[float]:
    """Yield parts of a stretch from the end where steps are short, with growing steps up to the even ones."""
    part, growth = _FIRST_PART * tolerance, factor * math.sqrt(tolerance)
    while part * growth < math.sqrt(tolerance) / _STEPS_OF_SLIP:
        yield part
        part *= 1 + growth


class Drives:
    """The imposed quantities of a case over time; arguments replace those of the configuration.

    TableError at the first use of a quantity whose file cannot be used.
    """

    def __init__(self, config: Config, drive: TimeFunction | None = None, **replaced: object) -> None:
        self.config = config
        own = {} if drive is None else {"drive": drive}
        vars(self).update({**replaced, **own})  # where the cached properties look first

    @cached_property
    def drive(self) -> TimeFunction:
        """Depth, mean gap or mean pressure over time, as `trajectory.control` says; see `closing`.

        A force is divided by the area of the cell, by the length of a line's cell, or by 1 where the contact
        is isolated.
        """
        trajectory = self.config.trajectory
        unit, table = self._prescribed(trajectory, trajectory.control)
        if table is not None:
            return table
        if trajectory.ramp_time is not None:
            return RampHold(getattr(trajectory, trajectory.control) / unit, trajectory.ramp_time)
        import numpy as np

        times, values = np.array(trajectory.corners).T
        return Table(times, values / unit)

    def closing(self, mean_height: float) -> Drives:
        """Return the drives with the depth for each mean gap, for a punch of this mean height."""
        drive = self.drive
        if isinstance(drive, RampHold):  # from the first touch
            depth: TimeFunction = replace(drive, target=mean_height - drive.target)
        elif isinstance(drive, Table):
            depth = replace(drive, values=mean_height - drive.values)
        else:
            raise TypeError(
                f"trajectory: got {type(drive).__name__}; must be RampHold or Table with control: gap"
            )
        others = {name: part for name, part in vars(self).items() if name not in ("config", "drive")}
        return Drives(self.config, depth, **others)

    def _prescribed(self, section: Any, quantity: str) -> tuple[float, Table | None]:
        """Return the unit of a drive, the area of the cell for a force, and the drive where it is a table."""
        unit = math.prod(self.config.grid.period) if section.control == "force" else 1.0
        if section.file is None:
            return unit, None
        table = self._table(section.file, quantity, section.reading)
        return unit, replace(table, values=table.values / unit)

    @cached_property
    def velocity(self) -> Constant | Table | None:
        """Velocity of the punch along x; None where the punch rests."""
        trajectory = self.config.trajectory
        if trajectory.velocity_file is not None:
            return self._table(trajectory.velocity_file, "velocity", trajectory.velocity_reading)
        return None if trajectory.velocity is None else Constant(trajectory.velocity)

    @cached_property
    def tangential(self) -> TimeFunction | None:
        """Displacement of the punch along the surface, or mean shear traction, over time; None without one.

        A force is divided by the area of the cell, or by the length of a line's cell.
        """
        section, end = self.config.trajectory.tangential, self.config.time.end
        if section is None:
            return None
        unit, table = self._prescribed(section, _ALONG[section.control])
        if table is not None:
            return table
        value, start = getattr(section, section.control) / unit, section.start or 0.0
        if section.period is not None:
            cycles = max(end - start, 0.0) / section.period if section.cycles is None else section.cycles
            return Oscillation(value, section.period, start, min(cycles, end / section.period))
        import numpy as np

        assert section.ramp_time is not None
        begin = [0.0] * (start > 0)
        return Table(np.array([*begin, start, start + section.ramp_time]), np.array([*begin, 0.0, value]))

    @cached_property
    def friction(self) -> ShearBound | None:
        """Bound of the shear traction; None without friction."""
        if not self.config.friction:
            return None
        from gfmdlayer.interface.friction import ShearBound

        return ShearBound.of(self.config.friction, self.config.units)

    @cached_property
    def temperature(self) -> Constant | Table | None:
        """Temperature of the body in degrees Celsius; None without `temperature`.

        TableError if a value of the file is outside of the range of a shift, or the file ends before the run.
        """
        section, end = self.config.temperature, self.config.time.end
        if section is None:
            return None
        if section.file is None:
            assert section.value is not None
            return Constant(section.value)
        felt = tuple(filter(None, shifts(self.config).values()))
        table = self._table(section.file, "temperature", section.reading, felt)
        if (last := float(table.times[-1])) < end:
            from gfmdlayer.files.tables import TableError

            raise TableError(f"{section.file}: ends at time {last:g}; must reach time.end = {end:g}")
        return table

    @cached_property
    def interface(self) -> Interaction:
        """Interaction of surface and punch across the gap beside the hard wall, voltages included."""
        from gfmdlayer.interface.law import total

        return total(law.interaction(self.config.units) for law in self.config.interfaces)

    @cached_property
    def reduced_time(self) -> ReducedTime | None:
        """Reduced time of the whole body; None without a temperature, and where shifts differ."""
        felt = list(filter(None, self._by_law))
        return felt[0] if len({reduced.shift for reduced in felt}) == 1 else None

    @cached_property
    def reduced_times(self) -> tuple[ReducedTime | None, ...]:
        """Reduced time of each of `config.laws`; None for a law whose relaxation times do not change."""
        common = self.reduced_time
        return self._by_law if common is None else (common,) * len(self.config.laws)

    @cached_property
    def _by_law(self) -> tuple[ReducedTime | None, ...]:
        """Reduced time of each law that relaxes and has a shift."""
        temperature, laws = self.temperature, self.config.laws
        if temperature is None:
            return (None,) * len(laws)
        from gfmdlayer.history.reduced_time import ReducedTime

        felt = (None if isinstance(law, Material) and law.elastic else law.shift for law in laws)
        return tuple(None if shift is None else ReducedTime(shift, temperature) for shift in felt)

    @property
    def elapse_apart(self) -> bool:
        """Whether reduced times of layers differ by a ratio that changes."""
        apart = self.reduced_time is None and any(self.reduced_times)
        return apart and not isinstance(self.temperature, Constant)

    @cached_property
    def _slowed(self) -> tuple[float, ...]:
        """Factor of the times of each law where shifts differ at a constant temperature, else 1."""
        once = self.reduced_time is None and not self.elapse_apart
        return tuple(each.factor(0.0) if once and each is not None else 1.0 for each in self.reduced_times)

    def series(self, wavenumber: float = 0.0) -> tuple[PronySeries, ...]:
        """Return the laws of the case as series of Maxwell branches over the times of its run.

        `wavenumber` [1/length] is the largest one along x that a moving punch drives. At a constant
        temperature the times of laws with different shifts are those at this temperature.
        """
        every = zip(self.config.laws, self.reduced_times, self._slowed, strict=True)
        return tuple(
            law.prony(*self.times_of_response(reduced, wavenumber)).slowed(factor)
            for law, reduced, factor in every
        )

    def elapsed(self, instant: Instant) -> float:
        """Return the length of the step to a time point, in reduced time where the whole body has one."""
        if self.reduced_time is None:
            return instant.step
        return self.reduced_time.step(instant.time - instant.step, instant.step)

    @cached_property
    def breakpoints(self) -> tuple[float, ...]:
        """Times t > 0 at which the slope of an imposed quantity jumps; not sorted."""
        thermal = next((reduced.temperature for reduced in self.reduced_times if reduced is not None), None)
        # The law of a hard wall needs no import.
        attracts = self.config.interfaces or "interface" in vars(self)
        every = self.drive, self.velocity, self.tangential, self.interface if attracts else None, thermal
        return tuple(time for quantity in every if quantity is not None for time in quantity.breakpoints)

    @property
    def least_scales(self) -> tuple[float, float, float]:
        """Smallest scales of response, depth and work: of an interface that attracts, else zero."""
        law = self.interface
        reach, work = (law.range, _LEAST_WORK * law.work) if law.attracts else (0.0, 0.0)
        return 0.0 if self.config.trajectory.places else reach, reach, work

    @property
    def drawn(self) -> tuple[float, float, float]:
        """Largest drive, the exponent of the response over it under Hertz, and its first stretch.

        They do not depend on the end of the run, which may grow.
        """
        corners = self.drive.breakpoints
        largest = max(float(self.drive(time)) for time in (0.0, *corners))
        growth = 1.0 if self.config.trajectory.places else 2 / 3
        return largest, growth, min((time for time in corners if time > 0), default=math.inf)

    @property
    def output_times(self) -> tuple[float, ...]:
        """Times of the rows on which adaptive steps land."""
        times, end = self.config.output.row_times, self.config.time.end
        return _multiples(times, end) if isinstance(times, float) else times or ()

    @cached_property
    def landings(self) -> Sequence[Instant]:
        """Times on which the steps land, with the length of fixed steps to each of them."""
        time, snapshots = self.config.time, self.config.output.snapshot_times
        if time.at_once:
            return (self._steady,)
        if isinstance(time.step, str):
            times = (*self.output_times, *self._resolving_slip())
            return time_points.stops(time.end, snapshots, self.breakpoints, times)
        equal = time.integrator == "backward_euler"
        fixed = time_points.equal_stops if equal else time_points.landing_stops
        return fixed(time.end, time.step, snapshots, self.breakpoints)

    @cached_property
    def _steady(self) -> Instant:
        """The step of the steady state at the end, in which the material moves by a spacing of the grid."""
        config = self.config
        assert self.velocity is not None
        spacing = config.grid.period[0] / config.grid.points[0]
        step = spacing / abs(self.velocity(config.time.end))
        return Instant(config.time.end, step, snapshot=True, breakpoint=True)

    def _resolving_slip(self) -> Iterator[float]:
        """Yield times on which adaptive steps land where surfaces slip, as tractions depend on the path.

        Each stretch between breakpoints in which the punch moves has some steps, more of them where contact
        begins and before a swing ends. Material moves by at most one point of the grid in a step.
        """
        time, grid = self.config.time, self.config.grid
        bound = self.friction
        if bound is None or (bound.is_frictionless and bound.over_speed is None):
            return
        import numpy as np

        assert time.tolerance is not None
        fastest = 0.0 if self.velocity is None else _fastest(self.velocity)
        spacing = min(L / n for L, n in zip(grid.period, grid.points, strict=True))
        turns = self.tangential.turns if isinstance(self.tangential, Oscillation) else ()
        stops = sorted({0.0, time.end, *(each for each in self.breakpoints if 0 < each < time.end)})
        for begin, end in pairwise(stops):
            drives = [drive for drive in (self.drive, self.tangential) if drive is not None]
            count, moves = 1.0, any(d(begin) != d(end) for d in drives)
            if moves:
                count = _STEPS_OF_SLIP / math.sqrt(time.tolerance)
                if self.drive(begin) <= 0 and not fastest:
                    yield from (begin + part * (end - begin) for part in _growing(time.tolerance))
                if end in turns:
                    parts = _growing(time.tolerance, _GROWTH_OF_SWING)
                    yield from (end - part * (end - begin) for part in parts)
            if fastest:
                count = max(count, (end - begin) / (spacing / fastest))
            yield from np.linspace(begin, end, min(math.ceil(count), MOST_ROWS) + 1)[1:-1].tolist()

    def fixed_steps(self) -> time_points.FixedSteps:
        """Return fixed steps: backward Euler takes equal ones, other schemes land on breakpoints."""
        time, snapshots = self.config.time, self.config.output.snapshot_times
        if time.at_once:
            return time_points.FixedSteps(self.landings, self.landings, self._steady.step)
        assert not isinstance(time.step, str)
        equal = time.integrator == "backward_euler"
        steps = time_points.equal_steps if equal else time_points.landing_steps
        instants = steps(time.end, time.step, snapshots, self.breakpoints)
        return time_points.FixedSteps(instants, self.landings, time.step)

    def times_of_response(self, reduced: ReducedTime | None, wavenumber: float = 0.0) -> tuple[float, float]:
        """Return the shortest and the longest time over which the response of a law matters.

        The longest is the end of the run. The shortest is the time step; with adaptive steps it is the part
        of the shortest stretch between breakpoints that their tolerance is: relaxation within it changes the
        pressure by no more than that. A moving punch also drives the shortest wave of the grid along x, with
        `wavenumber` [1/length]. With a temperature these are reduced times, at any time of the run.
        """
        time = self.config.time
        if isinstance(time.step, str):
            inner = sorted(each for each in set(self.breakpoints) if 0 < each < time.end)
            assert time.tolerance is not None
            shortest = time.tolerance * min(after - t for t, after in pairwise((0.0, *inner, time.end)))
        else:
            shortest = time.step
        if self.velocity is not None and (fastest := _fastest(self.velocity) * wavenumber):
            shortest = min(shortest, 1 / fastest)
        least, most = (1.0, 1.0) if reduced is None else reduced.extremes
        return shortest / most, time.end / least

    def tables(self) -> Iterator[tuple[Path, str, Table]]:
        """Yield file, quantity and table of drive, velocity, tangential drive and voltages."""
        given = self.config.trajectory
        named = [(given.file, given.control, given.reading)]
        named.append((given.velocity_file, "velocity", given.velocity_reading))
        if (along := given.tangential) is not None:
            named.append((along.file, _ALONG[along.control], along.reading))
        voltages = (law for law in self.config.interfaces if isinstance(law, Electrostatic))
        named += [(law.voltage, "voltage", law.reading) for law in voltages if isinstance(law.voltage, Path)]
        for file, quantity, reading in named:
            if file is not None:
                yield file, quantity, self._table(file, quantity, reading)

    def accounts(self) -> Iterator[str]:
        """Yield how each file of an imposed quantity was read."""
        yield from (table.account for _, _, table in self.tables())
        if isinstance(self.temperature, Table):
            yield self.temperature.account
        if self.friction is not None and self.friction.over_speed is not None:
            yield self.friction.over_speed.account

    def _table(
        self, file: Path, quantity: str, reading: Reading | None, felt: tuple[Shift, ...] = ()
    ) -> Table:
        """Return a table of a quantity over time; the last few files are kept while they do not change."""
        changed: tuple[int, ...] = ()
        with suppress(OSError):  # an array has no file: its name is the digest of its contents
            status = file.stat()
            changed = status.st_mtime_ns, status.st_size, status.st_ino
        name, words = _IMPOSED[quantity]
        if words == "force" and self.config.forces_per_length:
            name, words = f"{name} per length", "force / length"
        units = self.config.units
        label = words if quantity in {"temperature", "voltage"} else label_of(units, words)
        return _read(file, name, (label_of(units, "time"), label), reading, felt, changed)


def _fastest(velocity: Constant | Table) -> float:
    """Return the largest speed."""
    import numpy as np

    return float(np.abs(velocity.values if isinstance(velocity, Table) else velocity.value).max())


@lru_cache(maxsize=8)
def _read(
    file: Path,
    quantity: str,
    into: tuple[str | None, str | None],
    reading: Reading | None,
    felt: tuple[Shift, ...],
    _changed: tuple[int, ...],
) -> Table:
    """Read a table; temperatures must be within the range of the shifts that feel them."""

    def refused(value: float) -> str:
        return next(filter(None, (shift.refused(value) for shift in felt)), "")

    return Table.read(file, quantity, into, reading, refused if felt else None)


@lru_cache(maxsize=4)
def _multiples(spacing: float, end: float) -> tuple[float, ...]:
    return tuple(spacing * i for i in range(1, math.floor(end / spacing + 1e-9) + 1))
