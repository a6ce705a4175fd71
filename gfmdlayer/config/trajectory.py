"""The prescribed depth, load or force over time; defaults after Eq. (30) of the paper.

    ramp_hold         0 -> depth over ramp_time, then rest
    approach_retract  start -> depth at approach_speed, rest for dwell, -> final at retract_speed; in cycles
    table             linear between the rows of a file

A load or a force may take the place of the depth. A negative depth is a gap between the punch and the surface
at rest; negative loads and forces pull. With friction, `tangential` drives the punch along the surface:

    ramp              0 -> value over ramp_time, from `start` on, then rest
    oscillation       value sin(2 pi (t - start)/period) from `start` on
    table             linear between the rows of a file
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from gfmdlayer.config.sections import AT_ONCE, MOST_ROWS, Time
from gfmdlayer.contact.solvers import AUTO
from gfmdlayer.interface.interface import FrictionLaw
from gfmdlayer.validation.fields import File, Finite, MustBe, NotNegative, Optional, Word, given
from gfmdlayer.validation.problems import Location, Mistake, Reason, dotted, shown
from gfmdlayer.validation.reading import Reading, unread
from gfmdlayer.validation.sections import Section

KINDS = ("ramp_hold", "approach_retract", "table")
CONTROLS = ("depth", "gap", "load", "force")
PLACED = ("depth", "gap")  # which say where the punch is
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


TANGENTIAL_KINDS = ("ramp", "oscillation", "table")
TANGENTIAL_CONTROLS = ("displacement", "force")
_TANGENTIAL_KEYS = {"ramp_time": "ramp", "period": "oscillation", "cycles": "oscillation", "file": "table"}


class Tangential(Section):
    """A displacement of the punch along the surface, or a force on it, over time."""

    control: Annotated[str, Word(*TANGENTIAL_CONTROLS)] = "displacement"
    """prescribed quantity: displacement of the punch, or force on it"""
    kind: Annotated[str, Word(*TANGENTIAL_KINDS)] = "ramp"
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
    reading: Annotated[Reading | None, given] = None
    """how the file is read, where it does not say so"""
    direction: Finite = 0.0
    """angle from the x axis, on a surface: degrees"""

    def problems(self) -> Iterator[Mistake]:
        """Refuse keys that have no meaning for this control and kind, and missing ones."""
        others = ("control", "kind")
        yield from unread(self, "file")
        for key, kind in _TANGENTIAL_KEYS.items():
            if self.kind != kind and getattr(self, key) is not None:
                yield Mistake((key,), f"only for kind: {kind}; remove it or set kind: {kind}", others)
        if self.kind == "table":
            for key in ("start", *TANGENTIAL_CONTROLS):
                if getattr(self, key) is not None:
                    yield Mistake((key,), "the table gives it; remove it", others)
            if self.file is None:
                yield Mistake(("file",), "missing; kind: table needs the name of a file", others)
            return
        if getattr(self, self.control) is None:
            message = f"missing; control: {self.control} with kind: {self.kind} needs a number, finite"
            yield Mistake((self.control,), message, others)
        other = TANGENTIAL_CONTROLS[self.control == TANGENTIAL_CONTROLS[0]]
        if getattr(self, other) is not None:
            message = f"only for control: {other}; remove it or set control: {other}"
            yield Mistake((other,), message, others)


class Creepages(Section):
    """Sliding of the punch over its way along x, or its spin: it turns to the left by an angle per way."""

    x: Annotated[Finite | None, given] = None
    """creepage along x, default 0"""
    y: Annotated[Finite | None, given] = None
    """on a surface: creepage along y, default 0"""
    spin: Finite = 0.0
    """on a surface: angle of turning per way: 1/length"""


_creepages = MustBe("a number, finite, or {x: ..., y: ..., spin: ...}")
Creepage = Annotated[
    Annotated[Finite, _creepages, Tag("<number>")] | Annotated[Creepages, Tag("<one>")],
    Discriminator(lambda value: "<one>" if isinstance(value, (Mapping, Creepages)) else "<number>"),
]


class Trajectory(Section):
    """The prescribed depth of Eq. (30), mean pressure or force over time."""

    control: Annotated[str, Word(*CONTROLS)] = "depth"
    """prescribed: depth, gap (mean gap), load (mean pressure) or force"""
    kind: Annotated[str, Word(*KINDS)] = "ramp_hold"
    """ramp_hold, approach_retract, or table (from a file)"""
    depth: Annotated[Finite | None, given] = Field(
        default_factory=lambda data: (
            0.01 if data.get("control") == "depth" and data.get("kind") in KINDS[:2] else None
        )
    )
    """prescribed depth; negative is a gap, with attraction: length"""
    gap: Optional = None
    """control: gap: mean gap that the ramp reaches from first touch: length"""
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
    """kind: table: file with two columns, time and depth, gap, load or force"""
    reading: Annotated[Reading | None, given] = None
    """how the file is read, where it does not say so"""
    velocity: Annotated[Finite | None, given] = None
    """velocity of the punch along x: length/time"""
    velocity_file: Annotated[File | None, given] = None
    """file with two columns, time and velocity (length/time)"""
    velocity_reading: Annotated[Reading | None, given] = None
    """how that file is read, where it does not say so"""
    tangential: Annotated[Tangential | None, given] = None
    """with friction: displacement of the punch, or force, along the surface"""
    creepage: Annotated[Creepage | None, given] = None
    """with friction: sliding speed over velocity, default 1; or {x, y, spin}"""

    @property
    def rolls(self) -> bool:
        """Whether the punch moves along x with a creepage, or with a force along the surface."""
        return self.moves and (self.creepage is not None or self.tangential is not None)

    @property
    def creepages(self) -> tuple[float, float, float]:
        """Creepage along x and y, and spin, of a punch that moves; it slides with a creepage of 1."""
        given = 1.0 if self.creepage is None else self.creepage
        if not isinstance(given, Creepages):
            return given, 0.0, 0.0
        return given.x or 0.0, given.y or 0.0, given.spin

    @property
    def moves(self) -> bool:
        """Whether the punch moves along x."""
        return self.velocity is not None or self.velocity_file is not None

    @property
    def places(self) -> bool:
        """Whether depth or mean gap is prescribed, and the load follows."""
        return self.control in PLACED

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
        corners = [(0.0, self.start)]
        for _ in range(self.cycles or 1):
            time, value = corners[-1]
            corners.append((time + (peak - value) / self.approach_speed, peak))
            if self.dwell:
                corners.append((corners[-1][0] + self.dwell, peak))
            corners.append((corners[-1][0] + (peak - self.final) / self.retract_speed, self.final))
        return tuple(corners)

    @property
    def duration(self) -> float | None:
        """End of the path; None for a ramp or a table, which rest at their last value."""
        is_sound = self.kind == "approach_retract" and next(self.problems(), None) is None
        return self.corners[-1][0] if is_sound else None

    @property
    def peak_time(self) -> float | None:
        """Time at which the path first reaches its peak; None for a table, and where keys are missing."""
        if self.kind == "table" or next(self.problems(), None) is not None:
            return None
        return self.corners[1][0]

    def problems(self) -> Iterator[Mistake]:
        """Reject keys that have no meaning for this control and kind, and missing ones."""
        yield from unread(self, "file")
        yield from unread(self, "velocity_file", "velocity_reading")
        wrong, table = list(self._without_meaning()), self.kind == "table"
        if table and self.file is None:
            wrong.append(("file", "missing; kind: table needs the name of a file"))
        if not table and self.control != "depth" and getattr(self, self.control) is None:
            meant = {
                "gap": "> 0, the mean gap",
                "load": ">= 0, the mean pressure",
                "force": ">= 0, the force over the cell, per length for a line",
            }
            message = f"missing; control: {self.control} needs a number {meant[self.control]}"
            wrong.append((self.control, message))
        yield from (Mistake((key,), message, ("control", "kind")) for key, message in wrong)
        if self.kind == "approach_retract" and self.control == "gap":
            message = (
                "got approach_retract, whose ends count from the first touch; must be ramp_hold or table"
            )
            yield Mistake(("kind",), f"{message} with control: gap", ("control",), because="open")
        elif self.kind == "approach_retract" and not wrong:
            yield from self._impossible_legs()
        if self.velocity is not None and self.velocity_file is not None:
            message = "given beside velocity; remove one of the two"
            yield Mistake(("velocity_file",), message, ("velocity",), because="physics")

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

    def _impossible_legs(self) -> Iterator[Mistake]:
        """Reject a peak below an end of the path, and parts of a cycle without duration."""
        peak = getattr(self, self.control)
        for key in ("start", "final"):
            if getattr(self, key) >= peak:
                message = f"got {shown(getattr(self, key))}; must be below {self.control} = {shown(peak)}"
                yield Mistake((key,), message, (self.control,))
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
            yield Mistake((key,), message, (*legs, "start", "final", self.control, "cycles"))


def ending_with(trajectory: Trajectory | None, time: Time) -> Time:
    """Let a time axis without an end of its own end with the trajectory, or at the default.

    The end still counts as a default, so that it follows a swept trajectory.
    """
    if "end" in time.model_fields_set:
        return time
    duration = None if trajectory is None else trajectory.duration
    end = Time.model_fields["end"].default if duration is None else duration
    if time.end == end:
        return time
    time = time.model_copy(update={"end": end})
    time.model_fields_set.discard("end")
    return time


def problems_of_the_motion(trajectory: Trajectory, time: Time, *, pulls: bool) -> Iterator[Mistake]:
    """Yield contradictions with the time axis, and tensile loads if the interface does not attract."""
    velocity = "trajectory.velocity" if trajectory.velocity is not None else "trajectory.velocity_file"
    if trajectory.moves and time.integrator == "backward_euler":
        message = "got backward_euler with a moving punch, whose frame it does not know; must be exponential"
        yield Mistake(("time", "integrator"), message, (velocity,), because="open")
    if time.steady is not None and (not trajectory.moves or trajectory.velocity == 0):
        message = "only for a moving punch; remove it or set trajectory.velocity"
        others = ("trajectory.velocity", "trajectory.velocity_file")
        yield Mistake(("time", "steady"), message, others)
    if trajectory.depth is not None and trajectory.depth < 0 and not (pulls and trajectory.start is not None):
        message = (
            f"got {shown(trajectory.depth)}; must be a number >= 0, finite (a negative depth needs "
            "kind: approach_retract and an interface that attracts)"
        )
        yield Mistake(("trajectory", "depth"), message, ("trajectory.kind", "interface"))
    for key in ("start", "final"):
        value = getattr(trajectory, key)
        if not trajectory.places and not pulls and value is not None and value < 0:
            message = f"got {shown(value)}, a pull on the punch; must be >= 0 without adhesion"
            yield Mistake(("trajectory", key), message, ("trajectory.control", "interface"))


_WITH_FRICTION = "add interface: {law: coulomb, coefficient: 0.4}"


def problems_of_the_friction(config: Any) -> Iterator[Mistake]:
    """Yield contradictions between friction at the interface and the other sections of a `Config`."""
    laws = [(at, law) for at, law in config.interface_laws.items() if isinstance(law, FrictionLaw)]
    motion = config.trajectory
    if not laws:
        for key in ("tangential", "creepage"):
            if getattr(motion, key) is not None:
                yield Mistake(
                    ("trajectory", key), f"needs friction; remove it, or {_WITH_FRICTION}", ("interface",)
                )
        if config.time.at_once:
            message = f"got {AT_ONCE}, which needs friction; give a relative change, or {_WITH_FRICTION}"
            yield Mistake(("time", "steady"), message, ("interface",))
        if config.friction:
            yield from _problems_beside(config, ("trajectory", "velocity"), "a moving isolated contact")
        return
    for i, (at, law) in enumerate(laws):
        if any(type(law) is type(earlier) for _, earlier in laws[:i]):
            yield Mistake((*at, "law"), f"got {law.law!r} twice; give it once", ("interface",), chooses=True)
    at = (*laws[0][0], "law")
    yield from _problems_of_the_drive(config)
    yield from _problems_beside(config, at, "friction at the interface")


def _problems_of_the_drive(config: Any) -> Iterator[Mistake]:
    """Yield contradictions between tangential drive, creepage and velocity."""
    motion, drive = config.trajectory, config.trajectory.tangential
    velocity = ("trajectory.velocity", "trajectory.velocity_file")
    if motion.creepage is not None and not motion.moves:
        message = "only for a punch that moves; remove it or set trajectory.velocity"
        yield Mistake(("trajectory", "creepage"), message, velocity)
    yield from _problems_of_the_steps(config)
    given = motion.creepage if isinstance(motion.creepage, Creepages) else None
    if given is not None and len(config.grid.points) == 1:
        for key in ("y", "spin"):
            if getattr(given, key):
                message = f"got {getattr(given, key)!r}; must be 0 on a line, whose only direction is x"
                yield Mistake(("trajectory", "creepage", key), message, ("grid.points",))
    if config.time.at_once and (config.interfaces or config.hardness is not None):
        beside = "an attraction" if config.interfaces else "a hardness"
        message = f"got {AT_ONCE} beside {beside}, whose solver takes steps; must be a relative change"
        yield Mistake(("time", "steady"), message, ("interface",), because="open")
    if config.time.at_once:
        early = any(time < config.time.end for time in config.output.snapshot_times)
        for key, is_given in (("times", config.output.times is not None), ("snapshots", early)):
            if is_given:
                found = shown(getattr(config.output, key))
                message = f"got {found}; the only row is the steady state at time.end"
                yield Mistake(("output", key), f"{message}; remove it", ("time.steady",))
    if drive is None:
        return
    if motion.creepage is not None and drive.control == "force":
        message = "given beside a tangential force, which determines it; remove one of the two"
        keys: list[Location] = (
            [()] if given is None else [(k,) for k in "xy" if getattr(given, k) is not None]
        )
        for below in keys:
            others = ("trajectory.tangential",)
            yield Mistake(("trajectory", "creepage", *below), message, others, because="physics")
    if motion.moves and drive.control == "displacement":
        message = "got displacement with a velocity; must be force, or give trajectory.creepage in its place"
        yield Mistake(("trajectory", "tangential", "control"), message, velocity, because="physics")
    if len(config.grid.points) == 1 and drive.direction != 0:
        message = f"got {drive.direction!r}; must be 0 on a line, whose only direction is x"
        yield Mistake(("trajectory", "tangential", "direction"), message, ("grid.points",))


def _problems_of_the_steps(config: Any) -> Iterator[Mistake]:
    """Yield oscillations and speeds for which a run would take too many steps."""
    motion, drive, time = config.trajectory, config.trajectory.tangential, config.time
    if drive is not None and drive.period is not None:
        cycles = drive.cycles or (time.end - (drive.start or 0.0)) / drive.period
        if cycles > _MOST_CYCLES:
            message = f"got {drive.period!r}, {cycles:.3g} cycles in the run; must be at most {_MOST_CYCLES}"
            yield Mistake(("trajectory", "tangential", "period"), message, ("time.end",))
    if motion.velocity and time.step == "adaptive":
        spacing = min(L / n for L, n in zip(config.grid.period, config.grid.points, strict=True))
        if (steps := time.end * abs(motion.velocity) / spacing) > MOST_ROWS:
            message = (
                "got adaptive; with friction a step moves the punch by one grid point at most, which takes "
                f"{steps:.3g} steps, and the limit is {MOST_ROWS}; set an earlier time.end or fewer "
                "grid.points"
            )
            yield Mistake(("time", "step"), message, ("trajectory.velocity", "time.end", "grid.points"))


def _problems_beside(config: Any, at: Location, words: str) -> Iterator[Mistake]:
    """Yield what friction does not go with, at the place of its law or at the other key."""
    above = None if config.counterbody is None else config.counterbody.body
    directed = config.trajectory.tangential is not None or config.trajectory.moves
    yields_in_the_mean = config.trajectory.control == "gap" and config.solid.mean_stiffness > 0
    refused: dict[Location, tuple[object, str, Reason]] = {
        ("grid", "geometry"): (
            config.grid.geometry == "axisymmetric",
            "got axisymmetric; must be periodic",
            "physics" if directed else "open",
        ),
        ("body",): _without_shear(config.body),
        ("counterbody", "body"): _without_shear(above),
        ("solver", "method"): (
            config.solver.method != AUTO, f"got {config.solver.method}; must be auto", "",
        ),
        ("output", "stiffness"): (
            config.output.stiffness is not None,
            "must be left out: that of points that stick is missing",
            "open",
        ),
        ("trajectory", "control"): (
            yields_in_the_mean,
            "got gap on a body that yields in the mean; must be depth, load or force",
            "open",
        ),
    }  # fmt: skip
    for place, (is_refused, message, because) in refused.items():
        if is_refused:
            law = (dotted(at),)
            yield Mistake(place, f"{message} with {words}", law, because=because)
    if config.hardness is not None and config.trajectory.rolls:
        message = (
            "given with a velocity beside a hardness: surfaces that roll take their imprint along, and here "
            "it stays in the contact; remove it, and the punch slides"
        )
        key = "tangential" if config.trajectory.creepage is None else "creepage"
        yield Mistake(("trajectory", key), message, ("interface",), because="open")


def _without_shear(body: Any) -> tuple[bool, str, Reason]:
    """Return whether a body has no response to shear tractions, what it would have to give, and why."""
    if body is None or hasattr(body, "traction_spectrum"):
        return False, "", ""
    message = (
        f"got kind: {body.kind}, which does not give K(q) as a matrix over the directions; must be layers, "
        "or a body with the method traction_spectrum"
    )
    return True, message, "physics" if body.kind == "table" else "open"
