"""The tangential drive of a punch with friction: a displacement or a force along the surface over time.

ramp          0 -> value over ramp_time, from `start` on, then rest
oscillation   value sin(2 pi (t - start)/period) from `start` on
table         linear between the rows of a file
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field

from gfmdlayer.body.materials import shifts
from gfmdlayer.config.layers import Layers
from gfmdlayer.config.sections import MOST_ROWS
from gfmdlayer.contact.solvers import AUTO
from gfmdlayer.interface.interface import Friction
from gfmdlayer.validation.fields import File, Finite, NotNegative, Optional, Word, given
from gfmdlayer.validation.problems import Location, Problem, dotted
from gfmdlayer.validation.sections import Section, sections_in

KINDS = ("ramp", "oscillation", "table")
CONTROLS = ("displacement", "force")
_KEYS_OF = {"ramp_time": "ramp", "period": "oscillation", "cycles": "oscillation", "file": "table"}
_MOST_CYCLES = 10_000


class Tangential(Section):
    """A displacement of the punch along the surface, or a force on it, over time."""

    control: Annotated[str, Word(*CONTROLS)] = "displacement"
    """prescribed quantity: displacement of the punch, or force on it"""
    kind: Annotated[str, Word(*KINDS)] = "ramp"
    """ramp, oscillation (a sine), or table (from a file)"""
    displacement: Annotated[Finite | None, given] = None
    """displacement at the end of the ramp, or amplitude: length"""
    force: Annotated[Finite | None, given] = None
    """control: force: at the end of the ramp, or amplitude; of a line per length: force"""
    start: Annotated[NotNegative | None, given] = Field(
        default_factory=lambda data: None if data.get("kind") == "table" else 0.0
    )
    """time at which it begins, default 0: time"""
    ramp_time: Optional = Field(default_factory=lambda data: 1.0 if data.get("kind") == "ramp" else None)
    """ramp: its duration, default 1: time"""
    period: Optional = Field(default_factory=lambda data: 1.0 if data.get("kind") == "oscillation" else None)
    """oscillation: its period, default 1: time"""
    cycles: Optional = None
    """oscillation: number of cycles; default: to the end of the run"""
    file: Annotated[File | None, given] = None
    """kind: table: file with two columns, time and displacement or force"""
    direction: Finite = 0.0
    """angle from the x axis, on a surface: degrees"""

    def problems(self) -> Iterator[Problem]:
        """Refuse keys that have no meaning for this control and kind, and missing ones."""
        others = ("control", "kind")
        for key, kind in _KEYS_OF.items():
            if self.kind != kind and getattr(self, key) is not None:
                yield Problem((key,), f"only for kind: {kind}; remove it or set kind: {kind}", others)
        if self.kind == "table":
            for key in ("start", *CONTROLS):
                if getattr(self, key) is not None:
                    yield Problem((key,), "the table gives it; remove it", others)
            if self.file is None:
                yield Problem(("file",), "missing; kind: table needs the name of a file", others)
            return
        if getattr(self, self.control) is None:
            message = f"missing; control: {self.control} with kind: {self.kind} needs a number, finite"
            yield Problem((self.control,), message, others)
        other = CONTROLS[self.control == CONTROLS[0]]
        if getattr(self, other) is not None:
            message = f"only for control: {other}; remove it or set control: {other}"
            yield Problem((other,), message, others)


def problems_of_the_friction(config: Any) -> Iterator[Problem]:
    """Yield contradictions between friction at the interface and the other sections of a `Config`."""
    laws = [(at, law) for at, law in sections_in(config) if isinstance(law, Friction)]
    motion = config.trajectory
    if not laws:
        for key in ("tangential", "creepage"):
            if getattr(motion, key) is not None:
                message = "needs friction; remove it, or add interface: {law: coulomb, coefficient: 0.4}"
                yield Problem(("trajectory", key), message, ("interface",))
        return
    for i, (at, law) in enumerate(laws):
        if any(type(law) is type(earlier) for _, earlier in laws[:i]):
            yield Problem((*at, "law"), f"got {law.law!r} twice; give it once", ("interface",), chooses=True)
    at = (*laws[0][0], "law")
    yield from _problems_of_the_drive(config)
    yield from _problems_beside(config, at)


def _problems_of_the_drive(config: Any) -> Iterator[Problem]:
    """Yield contradictions between tangential drive, creepage and velocity."""
    motion, drive = config.trajectory, config.trajectory.tangential
    velocity = ("trajectory.velocity", "trajectory.velocity_file")
    if motion.creepage is not None and not motion.moves:
        message = "needs a punch that rolls; set trajectory.velocity, or remove it"
        yield Problem(("trajectory", "creepage"), message, velocity)
    yield from _problems_of_the_steps(config)
    if drive is None:
        return
    if motion.creepage is not None and drive.control == "force":
        message = "given beside a tangential force, of which it follows; remove one of the two"
        yield Problem(("trajectory", "creepage"), message, ("trajectory.tangential",))
    if motion.moves and drive.control == "displacement":
        message = "got displacement with a velocity; must be force, or give trajectory.creepage in its place"
        yield Problem(("trajectory", "tangential", "control"), message, velocity)
    if len(config.grid.points) == 1 and drive.direction != 0:
        message = f"got {drive.direction!r}; must be 0 on a line, whose only direction is x"
        yield Problem(("trajectory", "tangential", "direction"), message, ("grid.points",))


def _problems_of_the_steps(config: Any) -> Iterator[Problem]:
    """Yield oscillations and speeds for which a run would take too many steps."""
    motion, drive, time = config.trajectory, config.trajectory.tangential, config.time
    if drive is not None and drive.period is not None:
        cycles = drive.cycles or (time.end - (drive.start or 0.0)) / drive.period
        if cycles > _MOST_CYCLES:
            message = f"got {drive.period!r}, {cycles:.3g} cycles in the run; must be at most {_MOST_CYCLES}"
            yield Problem(("trajectory", "tangential", "period"), message, ("time.end",))
    if motion.velocity and time.step == "adaptive":
        spacing = min(L / n for L, n in zip(config.grid.period, config.grid.points, strict=True))
        if (steps := time.end * abs(motion.velocity) / spacing) > MOST_ROWS:
            message = (
                f"got adaptive: with friction material moves by a grid point a step at most, {steps:.3g} "
                f"steps; must be at most {MOST_ROWS}, by an earlier time.end or fewer grid.points"
            )
            yield Problem(("time", "step"), message, ("trajectory.velocity", "time.end", "grid.points"))


def _problems_beside(config: Any, at: Location) -> Iterator[Problem]:
    """Yield what friction does not go with, at the place of its law or at the other key."""
    law = (dotted(at),)
    refused = {
        ("grid", "geometry"): config.grid.geometry == "axisymmetric" and "got axisymmetric; must be periodic",
        ("grid", "boundary"): config.grid.isolated and "got isolated; must be periodic",
        ("counterbody",): config.counterbody is not None and "must be a rigid punch; remove it",
        ("body",): not isinstance(config.body, Layers | None)
        and "must be layers, which have a shear response",
        ("solver", "method"): config.solver.method != AUTO and f"got {config.solver.method}; must be auto",
        ("output", "stiffness"): config.output.stiffness is not None and "must be left out",
    }
    for place, message in refused.items():
        if message:
            yield Problem(place, f"{message} with friction at the interface", law)
    if config.hardness is not None:
        message = (
            "friction beside a hardness is not available: where surfaces yield, shear lowers the hardness"
        )
        yield Problem(at, f"{message}; remove one of the two laws", ("interface",), chooses=True)
    different = {shift for shift in shifts(config).values() if shift is not None}
    if config.temperature is not None and len(different) > 1:
        message = "needs one common shift of all materials with friction at the interface"
        yield Problem(("temperature",), message, law)
