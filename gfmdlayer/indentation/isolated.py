"""One isolated indentation: its columns, profiles and warnings; and the model of a case with it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.files.tables import TableError
from gfmdlayer.footprint import HEADER, REAL, ROWS, count_steps
from gfmdlayer.indentation.profiles import Profiles, profiles
from gfmdlayer.indentation.solve import (
    Indentation,
    follow,
    in_growing_space,
    on_halved_steps,
    on_steps,
    work_done,
)
from gfmdlayer.indentation.space import History, Space, find_space
from gfmdlayer.model import PROGRAM, ConvergenceError, Footprint, Model, compile_by, make_body, series_of
from gfmdlayer.observables.indentation import INDENTATION
from gfmdlayer.observables.observable import Column
from gfmdlayer.punch.revolution import Revolution
from gfmdlayer.results.journal import Recording
from gfmdlayer.resumable import CompositeState
from gfmdlayer.time_functions import Table
from gfmdlayer.validation.sections import files_named

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.results.journal import Recorder

DEFAULT_TOLERANCE = 1e-4

# Profiles reach to this many times the largest radius of the nodes.
_EXTENT = 2.0

# Negative pressure or gap, relative to the largest pressure or the depth, that is more than rounding.
_NEGATIVE = 1e-6
_CHECKED = 400  # radii at which it is looked for

# Steps of an isolated contact at least, their work in points times FFT pairs, and their seconds.
_FEWEST, _WORK, _SECONDS = 150, 500, 2e-4


@dataclass(frozen=True)
class IsolatedIndentation:
    """A rigid indenter of revolution that is pressed into a body.

    Parameters
    ----------
    body : Body
        The body.
    profile : Revolution
        The indenter.
    history : History
        What is prescribed.
    tolerance : float
        Error of force, depth and contact radius, relative to the largest of each.
    step : float, optional
        Largest length of equal steps; without it the steps are chosen for the tolerance.
    adhesion : float
        Work of adhesion, of an elastic body.
    snapshots, stops : sequence of float
        Times to land on; profiles are kept at the snapshots.
    points : int
        Radial points of the profiles.
    extent : float, optional
        Radius up to which they reach; by default twice the largest contact radius, about.
    """

    body: Body
    profile: Revolution
    history: History
    tolerance: float = DEFAULT_TOLERANCE
    step: float | None = None
    adhesion: float = 0.0
    snapshots: Sequence[float] = ()
    stops: Sequence[float] = ()
    points: int = 256
    extent: float | None = None

    @cached_property
    def _space(self) -> Space:
        return find_space(self.body, self.profile, self.history, self.tolerance, self.adhesion)

    @cached_property
    def radii(self) -> FloatArray:
        """Distances from the axis of the profiles, shape (points,)."""
        extent = _EXTENT * self._space.nodes.reach if self.extent is None else self.extent
        return np.linspace(0.0, extent, self.points)

    @cached_property
    def solved(self) -> Indentation:
        """Force, depth, contact radius and energies over time.

        Raises
        ------
        ArithmeticError
            If a contact radius is not found, or the tolerance is not reached.
        """
        if self.step is not None:
            return self._on_equal_steps(self.step)
        found = follow(
            self.body,
            self.profile,
            self.history,
            tolerance=self.tolerance,
            adhesion=self.adhesion,
            stops=self.stops,
            snapshots=self.snapshots,
            space=self._space,
        )
        if not found.error <= self.tolerance:
            raise ArithmeticError(f"estimated error {found.error:.2e}; the tolerance is {self.tolerance:.2e}")
        return found

    def _on_equal_steps(self, step: float) -> Indentation:
        """Take equal steps of at most this length between breakpoints and snapshots, and their halves."""
        knots = np.unique(np.array([*self.history.time, *self.snapshots, *self.stops]))
        parts = [
            np.linspace(begin, end, max(1, math.ceil((end - begin) / step - 1e-6)) + 1)[:-1]
            for begin, end in pairwise(knots.tolist())
        ]
        time = np.append(np.concatenate(parts), knots[-1])
        kept = np.unique(np.array(self.snapshots, dtype=float))
        return in_growing_space(
            lambda space: on_halved_steps(self.body, space, self.profile, self.history, time, kept),
            self._space,
            self.profile,
            self.tolerance,
        )

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns, each of shape (nt,)."""
        found = self.solved
        work = work_done(found.force, found.depth, float(found.stored[0] + found.dissipated[0]))
        interface = -self.adhesion * math.pi * found.radius**2
        return {
            "time": found.time,
            "force": found.force,
            "depth": found.depth,
            "contact_radius": found.radius,
            "work": work,
            "stored": found.stored,
            "dissipated": found.dissipated,
            "energy_residual": work - found.stored - found.dissipated - interface,
        }

    def profiles(self) -> Profiles:
        """Return the profiles at the snapshots."""
        times = np.unique(np.array(self.snapshots, dtype=float))
        return profiles(self.solved, self.profile, times, self.radii)

    @cached_property
    def warnings(self) -> list[str]:
        """Lines on pressures or gaps below zero, where the contact is not one disc.

        A transform of the pressure that falls from the axis to the edge, and one of the gap that is not
        negative, are enough; where they are not so, the profiles are looked at.
        """
        found = self.solved
        assert found.space is not None
        suspicious = found.rise.max() * found.radius.max() > _NEGATIVE * np.abs(found.force).max()
        if self.adhesion or not suspicious:
            return []
        time = found.time[[int(found.rise.argmax())]]
        again = on_steps(self.body, found.space, self.profile, self.history, found.time, snapshots=time)
        near = profiles(again, self.profile, time, np.linspace(0.0, 2 * found.radius.max(), _CHECKED))
        scales = {"pressure": float(near.pressure.max()), "gap": float(np.abs(found.depth).max())}
        return [
            f"{name} below zero at t = {time[0]:.6g}, by {-least / scale:.1e} of the largest: the contact is "
            "not one disc there"
            for name, scale in scales.items()
            if (least := float(getattr(near, name).min())) < -_NEGATIVE * scale
        ]


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
        return make_body(self.config, series_of(self.programme))

    @cached_property
    def indentation(self) -> IsolatedIndentation:
        """The contact that the configuration describes."""
        config, drive = self.config, self.programme.drive
        grid, time = config.grid, config.time
        times = [0.0, *sorted({each for each in drive.breakpoints if 0 < each < time.end}), time.end]
        by_force = config.trajectory.control == "force"
        return IsolatedIndentation(
            self.body,
            config.punch.revolution(),  # type: ignore[attr-defined]  # which the configuration has checked
            History(np.array(times), np.array([drive(each) for each in times]), by_force),
            tolerance=time.tolerance or DEFAULT_TOLERANCE,
            step=None if isinstance(time.step, str) else time.step,
            snapshots=config.output.snapshot_times,
            stops=self.programme.output_times,
            points=grid.points[0],
            extent=grid.extent,
        )

    @property
    def footprint(self) -> Footprint:
        """Estimated steps, memory and disk; there are no FFT pairs."""
        config, (steps, _) = self.config, count_steps(self.programme)
        steps = max(steps, _FEWEST) if config.time.step == "adaptive" else steps
        fields = config.grid.points[0] * (1 + 3 * len(config.output.snapshots))
        storage = HEADER + REAL * (len(INDENTATION) * max(steps, ROWS) + fields)
        return Footprint(steps, 0.0, _WORK * steps, PROGRAM, storage, _SECONDS * steps)

    def problems(self) -> Iterator[tuple[str, str]]:
        """Yield a profile or a table that cannot be used: negative forces, depths beyond a rigid base."""
        given, names = self.config.trajectory, files_named(self.config)
        key = next((name for name in names if name.startswith("punch.")), "punch")
        try:
            self.config.punch.revolution()  # type: ignore[attr-defined]  # which the configuration has checked
            key = "trajectory.file"
            drive = self.programme.drive
        except TableError as error:
            yield key, str(error)
            return
        if given.file is None:
            return
        assert isinstance(drive, Table)
        thickness = self.config.solid.rigid_below
        if given.control == "force" and (drive.values < 0).any():
            yield key, f"{given.file}: holds a negative force; must be >= 0, there is no adhesion"
        most = float(drive.values.max())
        if given.control == "depth" and most >= thickness:
            message = f"{given.file}: holds a depth of {most:.6g}, beyond the rigid base"
            yield key, f"{message}; must be below the thickness above it, {thickness!r}"

    def warm_up(self, _folder: Path | None = None, _results: Path | None = None, *, plan: bool = True) -> str:  # noqa: ARG002
        """Compile the kernels by a small contact; there is nothing to plan."""
        compile_by(lambda: type(self)(smallest_equivalent_case(self.config)).run(Recording()))
        return ""

    def run(
        self,
        recorder: Recorder,
        progress: Callable[[float], None] | None = None,
        resume: Callable[[CompositeState], None] | None = None,
    ) -> list[str]:
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
        for values in zip(*(each.tolist() for each in columns.values()), strict=True):
            recorder.row(**dict(zip(columns, values, strict=True)))
        if contact.snapshots:
            kept = contact.profiles()
            for snapshot in zip(kept.time.tolist(), kept.displacement, kept.pressure, kept.gap, strict=True):
                recorder.snapshot(*snapshot)
        recorder.note(error=solved.error, solutions=solved.solutions)
        return contact.warnings


def smallest_equivalent_case(config: Config) -> Config:
    """Return one ramp of the same kind whose contact is small beside the layers; a wide one takes long."""
    control, body = config.trajectory.control, config.solid
    size = min((each for each in body.thicknesses if 0 < each < math.inf), default=1.0)
    value = 1e-2 * size if control == "depth" else 1e-3 * size**2 * min(body.moduli)
    return config.with_values(
        {
            "grid": {"geometry": config.grid.geometry, "points": config.grid.points},
            "punch": {"shape": "parabola", "radius": size},
            "trajectory": {"control": control, control: value},
            "time": {"end": 2.0, "step": 1.0},
            "output": {},
        }
    )
