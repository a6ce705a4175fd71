"""The model of an isolated indenter: columns, estimated cost, checks and run of a case.

It imports the numerics when they are first needed, since `gfmdlayer check` answers without them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

from gfmdlayer.case.footprint import HEADER, REAL, ROWS, count_steps
from gfmdlayer.case.model import (
    PROGRAM,
    ConvergenceError,
    Footprint,
    Model,
    NoRecorder,
    compile_by,
    make_body,
)
from gfmdlayer.history.time_points import SAME_TIME
from gfmdlayer.interface.adhesion import ShortRange
from gfmdlayer.observables.contact import INDENTATION
from gfmdlayer.observables.observable import Column
from gfmdlayer.resumable import CompositeState
from gfmdlayer.validation.sections import files_named

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.body.body import Body
    from gfmdlayer.case.model import Progress, Recorder, Resume
    from gfmdlayer.config import Config
    from gfmdlayer.indentation.indent import IsolatedIndentation
    from gfmdlayer.indentation.solve import Edge

# Adaptive steps of an isolated contact in a stretch between breakpoints, those that grow with the root of
# the tolerance over 1e-4; the fewest that lines between them follow; quarters of a mesh that lands on the
# output times; the work of a step in points times FFT pairs, and its seconds. Measured at tolerances from
# 1e-2 to 1e-6.
_SAMPLES = 2000.0  # of a history, for each change of ln aT by one
_FEWEST, _GROWING, _DRAWN, _QUARTERS, _WORK, _SECONDS = 11, 21, 30, 4, 500, 1e-4


class IsolatedContact(Model):
    """The model of a case with grid.geometry: axisymmetric: it runs as a whole, faster than a checkpoint."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns of a row."""
        return INDENTATION

    @property
    def coordinates(self) -> Mapping[str, FloatArray]:
        """Distances x from the axis."""
        return {"x": self.indentation.radii}

    @property
    def attributes(self) -> Mapping[str, str | float]:
        """How far the profiles reach."""
        if self.config.grid.extent is not None:
            return {}
        return {"axes": "x of each case is its own, up to twice its contact radius; grid.extent sets it"}

    @cached_property
    def body(self) -> Body:
        """The body under the indenter."""
        return make_body(self.config, self.drives.series())

    @cached_property
    def indentation(self) -> IsolatedIndentation:
        """The contact that the configuration describes."""
        import numpy as np

        from gfmdlayer.indentation.indent import DEFAULT_TOLERANCE, IsolatedIndentation
        from gfmdlayer.indentation.solve import History

        config, drive = self.config, self.drives.drive
        grid, time = config.grid, config.time
        times = np.array(list(self._times_of_history()))
        by_force = config.trajectory.control == "force"
        return IsolatedIndentation(
            self.body,
            config.punch_in_units.revolution(),  # type: ignore[attr-defined]  # which the configuration has checked
            History(self._reduced(times), np.array([drive(each) for each in times.tolist()]), by_force),
            tolerance=time.tolerance or DEFAULT_TOLERANCE,
            step=None if isinstance(time.step, str) else time.step,
            adhesion=self._edge,
            snapshots=self._reduced(config.output.snapshot_times).tolist(),
            stops=self._reduced(self.drives.output_times).tolist(),
            points=grid.points[0],
            extent=grid.extent,
        )

    @property
    def _edge(self) -> Edge:
        """The adhesion at the edge of the contact."""
        from gfmdlayer.indentation.solve import NO_ADHESION, Edge

        for law in self.config.interfaces:
            assert isinstance(law, ShortRange)
            return Edge(law.work, law.edge_speed or math.inf, law.edge_exponent, law.healing_work)
        return NO_ADHESION

    def _reduced(self, times: ArrayLike) -> FloatArray:
        """Return the times at which the indenter is followed, which are reduced ones at a temperature."""
        import numpy as np

        reduced, given = self.drives.reduced_time, np.asarray(times, dtype=float)
        return given if reduced is None else np.array([reduced.step(0.0, each) for each in given.tolist()])

    def _in_time(self, reduced_times: FloatArray) -> FloatArray:
        """Return the times of the rows or the profiles."""
        import numpy as np

        reduced = self.drives.reduced_time
        if reduced is None:
            return reduced_times
        times = np.array([reduced.time(each) for each in reduced_times.tolist()])
        landings = np.array(sorted({stop.time for stop in self.drives.landings}))
        near = landings[np.abs(times[:, np.newaxis] - landings).argmin(axis=1)]
        return np.where(np.abs(times - near) <= SAME_TIME * landings[-1], near, times)  # but for rounding

    def _times_of_history(self) -> Iterator[float]:
        """Yield times between which the history is linear in reduced time too, within 1e-7 of the change."""
        import numpy as np

        drives, end = self.drives, self.config.time.end
        knots = [0.0, *sorted({each for each in drives.breakpoints if 0 < each < end}), end]
        reduced = drives.reduced_time
        for begin, stop in pairwise(knots):
            # Between points over which aT grows by a part d, a line is off by d/8 of the change.
            grows = 0.0 if reduced is None else abs(math.log(reduced.factor(stop) / reduced.factor(begin)))
            count = math.ceil(_SAMPLES * grows) if drives.drive(begin) != drives.drive(stop) else 0
            yield from np.linspace(begin, stop, max(count, 1) + 1)[:-1].tolist()
        yield end

    @property
    def footprint(self) -> Footprint:
        """Estimated steps, memory and disk; there are no FFT pairs."""
        config, (steps, _) = self.config, count_steps(self.drives)
        if config.time.step == "adaptive":
            stops = self.drives.landings
            stretches = 1 + sum(stop.breakpoint for stop in stops)
            growing = _GROWING * math.sqrt(1e-4 / (config.time.tolerance or 1e-4))
            each = max(_FEWEST + growing, _DRAWN)
            steps = max(round(stretches * each), _QUARTERS * (len(stops) - 1))
        fields = config.grid.points[0] * (1 + 3 * len(config.output.snapshot_times))
        storage = HEADER + REAL * (len(INDENTATION) * max(steps, ROWS) + fields)
        return Footprint(steps, 0.0, _WORK * steps, PROGRAM, storage, _SECONDS * steps)

    def problems(self) -> Iterator[tuple[str, str]]:
        """Yield a profile or a table that cannot be used: negative forces, depths beyond a rigid base."""
        from gfmdlayer.files.tables import TableError
        from gfmdlayer.time_functions import Table

        trajectory, names = self.config.trajectory, files_named(self.config)
        key = next((name for name in names if name.startswith("punch.")), "punch")
        try:
            self.config.punch_in_units.revolution()  # type: ignore[attr-defined]  # which the configuration has checked
            key = "trajectory.file"
            drive = self.drives.drive
        except TableError as error:
            yield key, str(error)
            return
        if trajectory.file is None:
            return
        assert isinstance(drive, Table)
        thickness = self.config.solid.rigid_below
        if trajectory.control == "force" and (drive.values < 0).any():
            yield key, f"{trajectory.file}: holds a negative force; must be >= 0, there is no adhesion"
        most = float(drive.values.max())
        if trajectory.control == "depth" and most >= thickness:
            message = f"{trajectory.file}: holds a depth of {most:.6g}, beyond the rigid base"
            yield key, f"{message}; must be below the thickness above it, {thickness!r}"

    def warm_up(self) -> None:
        """Compile the kernels by a small contact."""
        compile_by(lambda: type(self)(smallest_equivalent_case(self.config)).run(NoRecorder()))

    def run(self, recorder: Recorder, progress: Progress = None, resume: Resume = None) -> list[str]:
        """Compute all rows and profiles; `progress` is called before the first row only."""
        if resume is not None:
            resume(CompositeState())
        if progress is not None:
            progress(0.0)
        contact = self.indentation
        try:
            solved = contact.solved
        except ArithmeticError as error:
            raise ConvergenceError(str(error)) from error
        columns = contact.columns()
        columns["time"] = self._in_time(columns["time"])
        for values in zip(*(each.tolist() for each in columns.values()), strict=True):
            recorder.row(**dict(zip(columns, values, strict=True)))
        if contact.snapshots:
            kept = contact.profiles()
            fields = {"displacement": kept.displacement, "pressure": kept.pressure, "gap": kept.gap}
            for i, time in enumerate(self._in_time(kept.time).tolist()):
                recorder.snapshot(time, {name: profiles[i] for name, profiles in fields.items()})
        recorder.note(error=solved.error, solutions=solved.solutions)
        if said := [*filter(None, (*contact.warnings, contact.unbalanced("time.")))]:
            recorder.note(warnings="\n".join(said))
        return said


def smallest_equivalent_case(config: Config) -> Config:
    """Return one ramp of the same kind, small beside its layers, with numbers of its own."""
    from gfmdlayer.case.case import sections_like
    from gfmdlayer.config import Config

    control = config.trajectory.control
    return Config.model_validate(
        {
            "name": config.name,
            "grid": {"geometry": config.grid.geometry, "points": 16},
            "punch": {"shape": "sphere", "radius": 0.05},
            "trajectory": {"control": control, control: 5e-4 if control == "depth" else 2.5e-6},
            "time": {"end": 2.0, "step": 1.0},
            **sections_like(config),
        }
    )
