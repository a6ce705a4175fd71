"""The prescribed depth, load or force over time; defaults after Eq. (30) of the paper.

    ramp_hold         0 -> depth over ramp_time, then rest
    approach_retract  start -> depth at approach_speed, rest for dwell, -> final at retract_speed; in cycles
    table             linear between the rows of a file

A load or a force may take the place of the depth. A negative depth is a gap between the punch and the surface
at rest; negative loads and forces pull.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Annotated, Any

from pydantic import Field

from gfmdlayer.config.sections import Time
from gfmdlayer.config.tangential import Tangential
from gfmdlayer.validation.fields import File, Finite, MustBe, NotNegative, Optional, Word, given
from gfmdlayer.validation.problems import Problem, shown
from gfmdlayer.validation.sections import Section

KINDS = ("ramp_hold", "approach_retract", "table")
CONTROLS = ("depth", "load", "force")
# The keys that only one kind has.
_KEYS_OF = {
    "ramp_time": "ramp_hold",
    **dict.fromkeys(
        ("start", "approach_speed", "dwell", "retract_speed", "final", "cycles"), "approach_retract"
    ),
    "file": "table",
}
_MOST_CYCLES = 10_000
# Times closer than this part of the run count as one (`history.time_points`); each part of a cycle is longer.
_SHORTEST = 1e-9

Cycles = Annotated[
    int, Field(strict=True, ge=1, le=_MOST_CYCLES), MustBe(f"a whole number from 1 to {_MOST_CYCLES}")
]


def _of_approach(default: Callable[[Mapping[str, Any]], object]) -> Any:
    """Make a default for kind: approach_retract from the keys before."""
    return Field(
        default_factory=lambda data: default(data) if data.get("kind") == "approach_retract" else None
    )


def _speed_to_the_peak(keys: Mapping[str, Any]) -> float | None:
    """The speed that reaches the peak in a time of 1, as the default ramp does."""
    start, peak = keys.get("start"), keys.get(keys.get("control", ""))
    return peak - start if start is not None and peak is not None and start < peak else None


class Trajectory(Section):
    """The prescribed depth of Eq. (30), mean pressure or force over time."""

    control: Annotated[str, Word(*CONTROLS)] = "depth"
    """prescribed quantity: depth, load (mean pressure) or force"""
    kind: Annotated[str, Word(*KINDS)] = "ramp_hold"
    """ramp_hold, approach_retract, or table (from a file)"""
    depth: Annotated[Finite | None, given] = Field(
        default_factory=lambda data: (
            0.01 if data.get("control") == "depth" and data.get("kind") in KINDS[:2] else None
        )
    )
    """prescribed depth; negative is a gap, with attraction: length"""
    load: Annotated[NotNegative | None, given] = None
    """control: load: prescribed mean pressure: pressure"""
    force: Annotated[NotNegative | None, given] = None
    """control: force: force over the cell, per length for a line: force"""
    ramp_time: Optional = Field(default_factory=lambda data: 1.0 if data.get("kind") == "ramp_hold" else None)
    """duration of the ramp: time"""
    start: Annotated[Finite | None, given] = _of_approach(lambda _: 0.0)
    """approach_retract: value at the start, default 0: drive"""
    approach_speed: Optional = _of_approach(_speed_to_the_peak)
    """approach_retract: speed inwards, by default to the peak in 1: drive/time"""
    dwell: Annotated[NotNegative | None, given] = _of_approach(lambda _: 0.0)
    """approach_retract: dwell at the peak, default 0: time"""
    retract_speed: Optional = _of_approach(lambda keys: keys.get("approach_speed"))
    """approach_retract: speed outwards, default approach_speed: drive/time"""
    final: Annotated[Finite | None, given] = _of_approach(lambda keys: keys.get("start"))
    """approach_retract: value at the end, default start: drive"""
    cycles: Annotated[Cycles | None, given] = _of_approach(lambda _: 1)
    """approach_retract: number of cycles, default 1; later ones start at final"""
    file: Annotated[File | None, given] = None
    """kind: table: file with two columns, time and depth, load or force"""
    velocity: Annotated[Finite | None, given] = None
    """velocity of the punch along x: length/time"""
    velocity_file: Annotated[File | None, given] = None
    """file with two columns, time and velocity (length/time)"""
    tangential: Annotated[Tangential | None, given] = None
    """with friction: displacement of the punch, or force, along the surface"""
    creepage: Annotated[Finite | None, given] = None
    """with friction: sliding speed over velocity, default 1; less: it rolls"""

    @property
    def moves(self) -> bool:
        """Whether the punch moves along x."""
        return self.velocity is not None or self.velocity_file is not None

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Times and values between which the prescribed quantity is linear; empty for a table."""
        if self.file is not None:
            return ()
        peak = getattr(self, self.control)
        if self.ramp_time is not None:
            return ((0.0, 0.0), (self.ramp_time, peak))
        assert self.start is not None and self.final is not None  # noqa: PT018
        assert self.approach_speed is not None and self.retract_speed is not None  # noqa: PT018
        found = [(0.0, self.start)]
        for _ in range(self.cycles or 1):
            time, value = found[-1]
            found.append((time + (peak - value) / self.approach_speed, peak))
            if self.dwell:
                found.append((found[-1][0] + self.dwell, peak))
            found.append((found[-1][0] + (peak - self.final) / self.retract_speed, self.final))
        return tuple(found)

    @property
    def duration(self) -> float | None:
        """End of the path; None for a ramp or a table, which rest at their last value."""
        is_sound = self.kind == "approach_retract" and next(self.problems(), None) is None
        return self.corners[-1][0] if is_sound else None

    def problems(self) -> Iterator[Problem]:
        """Reject keys that have no meaning for this control and kind, and missing ones."""
        wrong, table = list(self._without_meaning()), self.kind == "table"
        if table and self.file is None:
            wrong.append(("file", "missing; kind: table needs the name of a file"))
        if not table and self.control != "depth" and getattr(self, self.control) is None:
            meant = {"load": "the mean pressure", "force": "the force over the cell, per length for a line"}
            message = f"missing; control: {self.control} needs a number >= 0, {meant[self.control]}"
            wrong.append((self.control, message))
        yield from (Problem((key,), message, ("control", "kind")) for key, message in wrong)
        if self.kind == "approach_retract" and not wrong:
            yield from self._impossible_legs()
        if self.velocity is not None and self.velocity_file is not None:
            message = "given beside velocity; remove one of the two"
            yield Problem(("velocity_file",), message, ("velocity",))

    def _without_meaning(self) -> Iterator[tuple[str, str]]:
        """Yield the keys that have no meaning for this control and kind, each with a message."""
        table = self.kind == "table"
        for key, kind in _KEYS_OF.items():
            if self.kind != kind and getattr(self, key) is not None:
                of_table = table and key == "ramp_time"
                reason = "the table gives the times" if of_table else f"only for kind: {kind}"
                yield key, f"{reason}; remove it" + ("" if of_table else f" or set kind: {kind}")
        if table and getattr(self, self.control) is not None:
            yield self.control, f"the table gives the {self.control}; remove it"
        for other in CONTROLS:
            if other != self.control and getattr(self, other) is not None:
                yield other, f"only for control: {other}; remove it or set control: {other}"

    def _impossible_legs(self) -> Iterator[Problem]:
        """Reject a peak below an end of the path, and parts of a cycle without duration."""
        peak = getattr(self, self.control)
        for key in ("start", "final"):
            if getattr(self, key) >= peak:
                message = f"got {shown(getattr(self, key))}; must be below {self.control} = {shown(peak)}"
                yield Problem((key,), message, (self.control,))
                return
        times = [time for time, _ in self.corners]
        shortest, index = min((after - before, i) for i, (before, after) in enumerate(pairwise(times)))
        if shortest <= _SHORTEST * times[-1]:
            legs = ("approach_speed", *(["dwell"] if self.dwell else []), "retract_speed")
            key = legs[index % len(legs)]
            message = (
                f"got {shown(getattr(self, key))}: this part of the path lasts {shortest:.3g} of "
                f"{times[-1]:.3g}; must be at least {_SHORTEST:g} of the whole"
            )
            yield Problem((key,), message, (*legs, "start", "final", self.control, "cycles"))


def ending_with(trajectory: Trajectory | None, time: Time) -> Time:
    """Let a time axis without an end of its own end with the trajectory; the end counts as a default."""
    duration = None if trajectory is None else trajectory.duration
    if duration is None or "end" in time.model_fields_set:
        return time
    time = time.model_copy(update={"end": duration})
    time.model_fields_set.discard("end")
    return time


def problems_of_the_motion(trajectory: Trajectory, time: Time, *, pulls: bool) -> Iterator[Problem]:
    """Yield contradictions with the time axis, and tensile loads if the interface does not attract."""
    velocity = "trajectory.velocity" if trajectory.velocity is not None else "trajectory.velocity_file"
    if trajectory.moves and time.integrator == "backward_euler":
        message = "got backward_euler with a moving punch; must be exponential"
        yield Problem(("time", "integrator"), message, (velocity,))
    if time.steady is not None and (not trajectory.moves or trajectory.velocity == 0):
        message = "only for a moving punch; remove it or set trajectory.velocity"
        others = ("trajectory.velocity", "trajectory.velocity_file")
        yield Problem(("time", "steady"), message, others)
    if trajectory.depth is not None and trajectory.depth < 0 and not (pulls and trajectory.start is not None):
        message = (
            f"got {shown(trajectory.depth)}; must be a number >= 0, finite (a negative depth needs "
            "kind: approach_retract and an interface that attracts)"
        )
        yield Problem(("trajectory", "depth"), message, ("trajectory.kind", "interface"))
    for key in ("start", "final"):
        value = getattr(trajectory, key)
        if trajectory.control != "depth" and not pulls and value is not None and value < 0:
            message = f"got {shown(value)}, a pull on the punch; must be >= 0 without adhesion"
            yield Problem(("trajectory", key), message, ("trajectory.control", "interface"))
