"""The section of the configuration on what is prescribed over time; defaults after Eq. (30) of the paper.

    ramp_hold         0 -> depth over ramp_time, then rest
    approach_retract  start -> depth at approach_speed, rest for dwell, -> final at retract_speed; in cycles
    table             linear between the rows of a file

Likewise for a load or a force in place of the depth. Depths below zero are heights of the punch above the
height at which it touches the surface at rest; loads and forces below zero pull.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Annotated, Any

from pydantic import Field

from gfmdlayer.config.sections import Time
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
# Times closer than this part of the run count as one (`history.time_points`): each leg has to last longer.
_SHORTEST = 1e-9

Cycles = Annotated[
    int, Field(strict=True, ge=1, le=_MOST_CYCLES), MustBe(f"a whole number from 1 to {_MOST_CYCLES}")
]


def _of_approach(default: Callable[[Mapping[str, Any]], object]) -> Any:
    """Make a default that only kind: approach_retract has, from the keys before."""
    return Field(
        default_factory=lambda data: default(data) if data.get("kind") == "approach_retract" else None
    )


def _speed_to_the_peak(keys: Mapping[str, Any]) -> float | None:
    """The speed that reaches the peak in a time of one, as the ramp does."""
    start, peak = keys.get("start"), keys.get(keys.get("control", ""))
    return peak - start if start is not None and peak is not None and start < peak else None


class Trajectory(Section):
    """What is prescribed over time: the depth of Eq. (30), likewise a mean pressure or a force, or a table."""

    control: Annotated[str, Word(*CONTROLS)] = "depth"
    """what is prescribed: depth, load (mean pressure) or force"""
    kind: Annotated[str, Word(*KINDS)] = "ramp_hold"
    """ramp_hold, approach_retract, or table: from a file"""
    depth: Annotated[Finite | None, given] = Field(
        default_factory=lambda data: (
            0.01 if data.get("control") == "depth" and data.get("kind") in KINDS[:2] else None
        )
    )
    """depth that is reached and held; < 0 above what attracts: length"""
    load: Annotated[NotNegative | None, given] = None
    """mean pressure that is reached and held, for control by load: pressure"""
    force: Annotated[NotNegative | None, given] = None
    """force over the cell, of a line per length, for control by force: force"""
    ramp_time: Optional = Field(default_factory=lambda data: 1.0 if data.get("kind") == "ramp_hold" else None)
    """duration of the ramp: time"""
    start: Annotated[Finite | None, given] = _of_approach(lambda _: 0.0)
    """approach_retract: where it begins, 0 by default: drive"""
    approach_speed: Optional = _of_approach(_speed_to_the_peak)
    """approach_retract: speed inwards, by default in a time of 1: drive/time"""
    dwell: Annotated[NotNegative | None, given] = _of_approach(lambda _: 0.0)
    """approach_retract: dwell at the largest depth or load, 0 by default: time"""
    retract_speed: Optional = _of_approach(lambda keys: keys.get("approach_speed"))
    """approach_retract: speed outwards, by default that inwards: drive/time"""
    final: Annotated[Finite | None, given] = _of_approach(lambda keys: keys.get("start"))
    """approach_retract: where it ends, by default where it begins: drive"""
    cycles: Annotated[Cycles | None, given] = _of_approach(lambda _: 1)
    """approach_retract: cycles, 1 by default; later ones begin at final"""
    file: Annotated[File | None, given] = None
    """two columns, time and depth, load or force; for kind: table"""
    velocity: Annotated[Finite | None, given] = None
    """velocity of the punch along x: length/time"""
    velocity_file: Annotated[File | None, given] = None
    """two columns, time and velocity (length/time); in place of velocity"""

    @property
    def moves(self) -> bool:
        """Whether the punch moves along x."""
        return self.velocity is not None or self.velocity_file is not None

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Times and values between which the prescribed quantity is linear; none of a table, of a file."""
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
        """Time at which the trajectory ends; None where it rests at its last value, as a ramp or a table."""
        is_sound = self.kind == "approach_retract" and next(self.problems(), None) is None
        return self.corners[-1][0] if is_sound else None

    def problems(self) -> Iterator[Problem]:
        """Refuse keys without meaning for this control and kind, and the lack of those that are needed."""
        wrong, table = list(self._without_meaning()), self.kind == "table"
        if table and self.file is None:
            wrong.append(("file", "missing; kind: table must be given the name of a file"))
        if not table and self.control != "depth" and getattr(self, self.control) is None:
            meant = {"load": "the mean pressure", "force": "the force over the cell, of a line per length"}
            message = f"missing; control: {self.control} must be given a number >= 0, {meant[self.control]}"
            wrong.append((self.control, message))
        yield from (Problem((key,), message, ("control", "kind")) for key, message in wrong)
        if self.kind == "approach_retract" and not wrong:
            yield from self._impossible_legs()
        if self.velocity is not None and self.velocity_file is not None:
            message = "given, but velocity is a number; must be left out, or velocity be left out"
            yield Problem(("velocity_file",), message, ("velocity",))

    def _without_meaning(self) -> Iterator[tuple[str, str]]:
        """Yield keys that this control and kind have no use for, and why."""
        table = self.kind == "table"
        for key, kind in _KEYS_OF.items():
            if self.kind != kind and getattr(self, key) is not None:
                message = f"given, but kind is {self.kind}; must be left out, or kind be {kind}"
                sets = "given, but the table sets the times; must be left out"
                yield key, sets if table and key == "ramp_time" else message
        if table and getattr(self, self.control) is not None:
            yield self.control, "given, but the table sets it; must be left out"
        for other in CONTROLS:
            if other != self.control and getattr(self, other) is not None:
                message = f"given, but control is {self.control}; must be left out, or control be {other}"
                yield other, message

    def _impossible_legs(self) -> Iterator[Problem]:
        """Refuse a peak that is no peak, and legs that last no time beside the others."""
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
                f"got {shown(getattr(self, key))}: this leg lasts {shortest:.3g} of {times[-1]:.3g}; must be "
                f"at least {_SHORTEST:g} of the whole"
            )
            yield Problem((key,), message, (*legs, "start", "final", self.control, "cycles"))


def ending_with(trajectory: Trajectory | None, time: Time) -> Time:
    """Let a time axis end with a trajectory that has an end, unless it has one of its own."""
    duration = None if trajectory is None else trajectory.duration
    if duration is None or "end" in time.model_fields_set:
        return time
    time = time.model_copy(update={"end": duration})
    time.model_fields_set.discard("end")
    return time


def problems_of_the_motion(trajectory: Trajectory, time: Time, *, pulls: bool) -> Iterator[Problem]:
    """Yield contradictions between a trajectory and the time axis, and loads that nothing carries."""
    velocity = "trajectory.velocity" if trajectory.velocity is not None else "trajectory.velocity_file"
    if trajectory.moves and time.integrator == "backward_euler":
        message = "got backward_euler with a moving punch; must be exponential, which follows it"
        yield Problem(("time", "integrator"), message, (velocity,))
    if time.steady is not None and (not trajectory.moves or trajectory.velocity == 0):
        message = "given, but the punch does not move; must be left out, or trajectory.velocity be a number"
        others = ("trajectory.velocity", "trajectory.velocity_file")
        yield Problem(("time", "steady"), message, others)
    if trajectory.depth is not None and trajectory.depth < 0 and not (pulls and trajectory.start is not None):
        message = (
            f"got {shown(trajectory.depth)}; must be a number >= 0, finite (below zero the punch is out of "
            "contact: only with kind: approach_retract and an interface that attracts)"
        )
        yield Problem(("trajectory", "depth"), message, ("trajectory.kind", "interface"))
    for key in ("start", "final"):
        value = getattr(trajectory, key)
        if trajectory.control != "depth" and not pulls and value is not None and value < 0:
            message = f"got {shown(value)}, a pull on the punch; must be >= 0, there is no adhesion"
            yield Problem(("trajectory", key), message, ("trajectory.control", "interface"))
