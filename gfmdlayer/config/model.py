"""The whole configuration: its sections, its cases, and its text in YAML.

Every `Config` is valid: all values are allowed, none contradicts another, and so for every case of its sweep.
See `gfmdlayer.config.sections` for the keys.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    Field,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from gfmdlayer.body.bodies import BODY
from gfmdlayer.body.continuous import ContinuousLaw
from gfmdlayer.body.layer import Halfspace, Layer, StackedLayers, in_units
from gfmdlayer.body.layers import Layers
from gfmdlayer.body.materials import Law, Temperature, temperature_problems
from gfmdlayer.body.pair import Pair, stacks
from gfmdlayer.body.solid import OneModulus, Solid
from gfmdlayer.config import sections, sweeps
from gfmdlayer.config.bodies import (
    Counterbody,
    in_keys,
    layered,
    problems_of_the_body,
    problems_of_the_counterbody,
)
from gfmdlayer.config.geometries import GEOMETRIES, Geometry
from gfmdlayer.config.measures import ConfigMeasures, in_words
from gfmdlayer.config.sections import Output, problems_of_the_inside
from gfmdlayer.config.trajectory import (
    Trajectory,
    ending_with,
    problems_of_the_friction,
    problems_of_the_motion,
)
from gfmdlayer.contact.solvers import AUTO, SOLVERS, Choice, choose, contrast, finer
from gfmdlayer.interface.adhesion import NO_PERMITTIVITY, Electrostatic
from gfmdlayer.interface.interface import Coulomb, FrictionLaw, Interface
from gfmdlayer.interface.laws import LAWS
from gfmdlayer.made_once import kept_with
from gfmdlayer.punch.shape import Shape
from gfmdlayer.punch.shapes import SHAPES
from gfmdlayer.punch.simple_shapes import Parabola
from gfmdlayer.validation import text
from gfmdlayer.validation.fields import MustBe, given
from gfmdlayer.validation.problems import (
    ConfigError,
    InconsistentError,
    Location,
    Mistake,
    dotted,
    location_of_key,
    set_aside,
    without_last_places,
)
from gfmdlayer.validation.quantities import measured
from gfmdlayer.validation.sections import (
    OneOf,
    OneOrMore,
    Section,
    contradictions,
    described,
    explained,
    plain,
    sections_in,
    texts_in,
)
from gfmdlayer.validation.units import Units

# Whether materials go with the rest of a configuration.


def _problems_of_the_materials(config: Any) -> Iterator[Mistake]:
    """Yield liquids under a load that nothing solid carries, and moduli that no Poisson's ratio converts."""
    control = config.trajectory.control
    if not config.trajectory.places and config.solid.flows:
        laws = ((at, law) for at, law in sections_in(config) if isinstance(law, Law))
        liquids = [dotted(at) for at, law in laws if not law.relaxed]
        reason = "a liquid (G0 = 0) on nothing solid has no equilibrium under it and sinks without end"
        allowed = "must be depth, or give the lowest material G0 > 0, or a base"
        message = f"got {control!r}: {reason}; {allowed}"
        yield Mistake(("trajectory", "control"), message, (*liquids, "halfspace", "layer", "layers", "body"))
    for at, section in sections_in(config):
        if isinstance(section, OneModulus) and not section.material.relaxed:
            message = "got 0: all moduli of this body relax relative to it; must be > 0"
            yield Mistake((*at, "material", "G0"), message, ("body",))
        if isinstance(section, Solid) and not isinstance(section, (Layers, OneModulus)):
            for below, law in sections_in(section):
                if isinstance(law, Law) and (law.moduli or getattr(law, "G", 0.0) is None):
                    message = "its moduli must be shear moduli: only a layer and a halfspace have a poisson"
                    yield Mistake((*at, *below), message, ("body",))


# Whether an interface law goes with the rest of a configuration.


def problems_of_the_interface(config: Any) -> Iterator[Mistake]:
    """Yield contradictions between the interface laws of a `Config` and its other sections."""
    if config.interface == ():
        yield Mistake(("interface",), "got an empty list; must have at least one {law: ...}")
    yield from _problems_of_the_hardness(config)
    if not config.interfaces:
        return
    for at, law in config.interface_laws.items():
        if isinstance(law, Electrostatic) and law.permittivity_of_vacuum(config.units) is None:
            yield Mistake((*at, "permittivity"), NO_PERMITTIVITY, ("units",))
    if config.solver.method != AUTO and not (config.friction or SOLVERS[config.solver.method].adhesive):
        able = " or ".join(name for name, declared in SOLVERS.items() if declared.adhesive)
        message = f"got {config.solver.method}, which cannot solve for attraction; must be {able}"
        yield Mistake(("solver", "method"), message, ("interface",))


def _problems_of_the_hardness(config: Any) -> Iterator[Mistake]:
    """Yield contradictions between a hardness and the other sections of a `Config`."""
    laws = config.interface_laws.items()
    at = next((at for at, law in laws if getattr(law, "hardness", None) is not None), None)
    if at is None:
        return
    if config.trajectory.control == "gap":
        message = (
            "got gap beside a hardness: the imprint adds to the gap within a step; must be another control"
        )
        yield Mistake(("trajectory", "control"), message, (dotted((*at, "hardness")),), because="open")
    attracts, method = bool(config.interfaces), config.solver.method
    able = [name for name, other in SOLVERS.items() if other.yields and other.adhesive == attracts]
    if method not in {AUTO, *able} and (SOLVERS[method].adhesive or not attracts):
        reason = "is slow" if SOLVERS[method].yields else "cannot solve"
        message = f"got {method}, which {reason} for a hardness; must be {' or '.join(able)}"
        yield Mistake(("solver", "method"), message, (dotted((*at, "hardness")),))
    control = config.trajectory.control
    prescribed, area = getattr(config.trajectory, control), math.prod(config.grid.period)
    most = config.hardness * (area if control == "force" else 1.0)
    if not config.trajectory.places and prescribed is not None and prescribed >= most:
        key = dotted((*at, "hardness"))
        limit = f"{most:.6g}, the {key} over the whole cell: more has no equilibrium"
        message = f"got {prescribed!r}; must be below {limit}"
        yield Mistake(("trajectory", control), message, (key, "grid.period"))


Name = Annotated[
    str,
    Field(strict=True, pattern=r"^[A-Za-z0-9_][A-Za-z0-9._-]{0,127}$"),
    MustBe(
        "text of at most 128 letters, digits and . _ -, with letters from a to z or A to Z, "
        "not beginning with . or - (it names a folder)"
    ),
]


class Config(Section):
    """A whole configuration; every key but `name` has a default, the paper's own value.

    Without `units` lengths are in L, moduli in G0 and times in tau, or in any units. A configuration with a
    sweep is sound when its cases are: its own value of a swept key is not run.

    Examples
    --------
    >>> config = gfmdlayer.Config(name="thin", layer={"thickness": 0.01}, grid={"points": 512})
    >>> config.with_values({"layer.thickness": 0.02}).layer.thickness
    0.02
    """

    name: Name
    """name of the results folder"""
    units: Annotated[Units | None, given] = None
    """of all numbers; files are converted: {length: m, stress: Pa, time: s}"""
    grid: sections.GridKeys = Field(default_factory=sections.GridKeys)
    """the periodic cell and its points"""
    body: Annotated[Solid | None, BODY, given] = None
    """the body; layers, by the three keys below, or {file: mine.py, ...}"""
    layers: Annotated[StackedLayers | None, given] = None
    """layers from the surface downwards, in place of layer"""
    layer: Annotated[Layer | None, given] = Field(
        default_factory=lambda data: Layer() if data.get("layers") is None and layered(data) else None
    )
    """the viscoelastic layer"""
    halfspace: Annotated[Halfspace | None, given] = Field(
        default_factory=lambda data: Halfspace() if layered(data) else None
    )
    """the base under the layers"""
    counterbody: Annotated[Counterbody | None, given] = None
    """the punch deforms too: its layers and halfspace; default: rigid"""
    temperature: Annotated[Temperature | None, given] = None
    """temperature of the body over time, for materials with a shift"""
    punch: Annotated[Shape, OneOf(SHAPES)] = Field(default_factory=Parabola)
    """the rigid punch; its shape"""
    interface: Annotated[Interface | tuple[Interface, ...] | None, OneOrMore(LAWS), given] = None
    """attraction or friction, besides the hard wall: one law or several"""
    trajectory: Trajectory = Field(default_factory=Trajectory)
    """prescribed depth, load or force over time"""
    time: sections.Time = Field(default_factory=sections.Time, validate_default=True)
    """time axis and steps"""
    solver: sections.SolverKeys = Field(default_factory=sections.SolverKeys)
    """solver of the contact problem in each step"""
    output: Output = Field(default_factory=Output)
    """output besides the curves"""
    sweep: Annotated[dict[str, Any], sweeps.PlainSweep()] = Field(default_factory=dict)
    """dotted keys with values; the cases are all combinations"""

    @field_validator("time")
    @classmethod
    def _to_the_end_of_the_trajectory(cls, time: sections.Time, info: ValidationInfo) -> sections.Time:
        return ending_with(info.data.get("trajectory"), time)

    @field_validator("sweep", mode="before")
    @classmethod
    def _sweep_in_units(cls, sweep: Any, info: ValidationInfo) -> Any:
        """Convert swept numbers with units: they are coordinates of the results."""

        def dimension(key: str) -> str:
            head, _, own = key.partition(".")
            body = info.data.get(head)
            known = described(cls, key)[1]  # but of a body of the user
            return known if known or not isinstance(body, Solid) else described(type(body), own)[1]

        return sweeps.with_numbers(sweep, cache(dimension)) if isinstance(sweep, Mapping) else sweep

    @field_validator("layers", "layer", "halfspace", "counterbody")
    @classmethod
    def _in_own_units(cls, value: Any, info: ValidationInfo) -> Any:
        """Convert the materials of files into the units of the configuration."""
        return in_units(value, info.data["units"]) if "units" in info.data else value

    @model_validator(mode="wrap")
    @classmethod
    def _measured(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Let texts mean what they do in this configuration."""
        if not isinstance(data, Mapping):
            return handler(data)
        with measured(ConfigMeasures(data)):
            return handler(data)

    @model_validator(mode="after")
    def _sound(self) -> Self:
        mistakes = contradictions(self)
        if self.sweep:
            keys = sweeps.sweepable(self)
            mistakes = sweeps.conflicts(self.sweep, keys, list(mistakes), self._problems_with)
        if listed := list(mistakes):
            raise InconsistentError(listed)
        return self

    def problems(self) -> Iterator[Mistake]:
        """Yield contradictions between sections."""
        yield from problems_of_the_body(self.body, self.layers, self.layer, self.halfspace)
        yield from temperature_problems(self, self.temperature, self._with_one_reduced_time)
        yield from _problems_of_the_materials(self)
        yield from self.geometry.problems(self)
        second = None if self.counterbody is None else self.counterbody.body
        for at, body in ((("body",), self.body), (("counterbody", "body"), second)):
            if isinstance(body, Solid) and self.geometry.on_grid:
                mistakes = body.problems_on_grid(self.grid.points, self.grid.period)
                yield from (problem.within(at, "grid.points", "grid.period") for problem in mistakes)
        yield from problems_of_the_counterbody(self)
        yield from problems_of_the_interface(self)
        yield from problems_of_the_friction(self)
        yield from problems_of_the_motion(self.trajectory, self.time, pulls=bool(self.interfaces))
        yield from self._problems_of_the_output()

    def _problems_of_the_output(self) -> Iterator[Mistake]:
        time, output = self.time, self.output
        yield from (mistake.within(("output",), "time.end") for mistake in output.problems_until(time.end))
        if output.times is not None and time.step != "adaptive":
            message = "fixed steps write every row; remove it or set time.step: adaptive"
            yield Mistake(("output", "times"), message, ("time.step",))
        for i, snapshot in enumerate(output.snapshot_times):
            if message := time.misses(snapshot):
                yield Mistake(("output", "snapshots", i), message, ("time.step", "time.integrator"))
        if self.geometry.on_grid:
            yield from problems_of_the_inside(self)
            yield from self._problems_of_transport()

    def _problems_of_transport(self) -> Iterator[Mistake]:
        output = self.output
        if len(self.grid.points) == 1:
            for i, name in enumerate(output.observables or ()):
                message = f"got {name!r}, which a line does not have; remove it"
                also = " (output.leakage has the flow of a line in closed form)" * (name != "spot_radius")
                yield Mistake(("output", "observables", i), message + also, ("grid.points",))
        if output.stiffness is None:
            return
        at = ("output", "stiffness")
        if self.trajectory.moves:
            message = "only for a punch that does not move along x, whose contact is carried along; remove it"
            yield Mistake(at, message, ("trajectory",), because="open")

    @property
    def _with_one_reduced_time(self) -> Mapping[str, str]:
        """The keys for which layers cannot have reduced times of their own, and what they describe."""
        every = {
            "trajectory": self.trajectory.moves and "a moving punch",
            "body": not stacks(self.solid) and "a body that is not made of layers",
            "grid.geometry": not self.geometry.on_grid and "an axisymmetric indenter",
            "grid.boundary": self.grid.isolated and "an isolated contact",
            "interface": bool(self.friction) and "friction",
            "output.stiffness": self.output.stiffness is not None and "the dynamic stiffness",
        }
        return {key: words for key, words in every.items() if words}

    @property
    def plainly_possible(self) -> bool:
        """Whether the depth is well below the mean height of a punch that is known in closed form."""
        return self.geometry.plainly_possible(self)

    @property
    def geometry(self) -> Geometry:
        """The geometry of the contact, of `grid.geometry`."""
        return GEOMETRIES[self.grid.geometry or "periodic"]

    @property
    def solid(self) -> Solid:
        """The body: layers, or another one; with the counterbody, where that deforms."""
        return _solid(self)

    @property
    def velocity_ratio(self) -> float:
        """Velocity of the contact along the counterbody over the one along the body."""
        if self.counterbody is None:
            return 0.0
        given = self.counterbody.velocity_ratio
        return given if given is not None else float(bool(self.friction) and self.trajectory.rolls)

    @property
    def creepages(self) -> tuple[float, float, float]:
        """Creepage along x and y, and spin; of bodies that slide the difference of their velocities."""
        given = self.trajectory.creepages
        return given if self.trajectory.creepage is not None else (1 - self.velocity_ratio, 0.0, 0.0)

    @property
    def two_bodies(self) -> bool:
        """Whether a case on a periodic grid follows a body and a counterbody, each with its history."""
        of_one = self.counterbody is None or self.grid.isolated or not self.geometry.on_grid
        return not of_one and isinstance(self.solid, Pair)

    @property
    def refines(self) -> bool:
        """Whether the grid may have more points: those of a lattice are its atoms."""
        every = (self.body, None if self.counterbody is None else self.counterbody.body)
        bodies, more = (body for body in every if isinstance(body, Solid)), [2 * n for n in self.grid.points]
        return not any(any(body.problems_on_grid(more, self.grid.period)) for body in bodies)

    @property
    def laws(self) -> tuple[Law, ...]:
        """The material laws of the body."""
        return self.solid.laws

    @property
    def interfaces(self) -> tuple[Interface, ...]:
        """The interface laws that attract; they add. Empty for the hard wall."""
        return _laws(self)[0]

    @property
    def friction(self) -> tuple[FrictionLaw, ...]:
        """The laws of friction, of which the smaller traction counts; empty without friction.

        An isolated contact that moves without a law has the coefficient 0.
        """
        return _laws(self)[1]

    @property
    def interface_laws(self) -> dict[Location, Interface]:
        """The laws of the interface by their locations."""
        if isinstance(self.interface, tuple):
            return {("interface", i): law for i, law in enumerate(self.interface)}
        return {} if self.interface is None else {("interface",): self.interface}

    @property
    def hardness(self) -> float | None:
        """The pressure at which the surfaces yield, the least one given; None where they do not."""
        hardnesses = (getattr(law, "hardness", None) for law in self.interface_laws.values())
        return min((value for value in hardnesses if value is not None), default=None)

    @property
    def contact_solver(self) -> Choice:
        """The solver for `solver.method`, and the reason."""
        return self.solver_where(bool(self.interfaces))

    def solver_where(self, attracts: bool) -> Choice:
        """The solver where the interface attracts, or does not.

        Parameters
        ----------
        attracts : bool
            Whether the interface attracts at the time.
        """
        if self.friction:
            return Choice("friction", "one Newton method for pressure and shear traction")
        axes, rough = len(self.grid.points), self.punch.rough
        yields = self.hardness is not None
        return choose(self.solver.method, axes=axes, rough=rough, attracts=attracts, yields=yields)

    @property
    def punch_in_units(self) -> Shape:
        """The punch; lengths of its file are converted into the unit of length, where there is one."""
        return self.punch.with_length(None if self.units is None else self.units.length)

    @property
    def contrast(self) -> float:
        """Roughly the largest glassy over relaxed modulus in times up to the end of the run."""
        return contrast(self.solid.roughly(self.time.end))

    @property
    def finer_tolerance(self) -> float:
        """Residual that the solver aims at: a finer one than the given where adaptive steps need it."""
        tolerance, of_steps, end = self.solver.tolerance, self.time.tolerance, self.time.end
        if self.interfaces or of_steps is None:
            return (
                tolerance  # with an interface that attracts, `newton` ends near 1e-8, and steps are not many
            )
        # Without a glassy modulus the series that replaces a law reaches down to about this part of the run.
        unlimited = (law.relaxation_modulus for law in self.laws if math.isinf(law.glassy))
        stiffened = max((float(G(of_steps * end) / G(end)) for G in unlimited), default=1.0)
        return finer(tolerance, of_steps, self.contrast, stiffened)

    @property
    def forces_per_length(self) -> bool:
        """Whether forces are per length, on a line."""
        return len(self.grid.points) == 1 and self.geometry.on_grid

    def unit(self, words: str) -> str:
        """Return the label of a unit from its dimension in words, see `unit_label`.

        Parameters
        ----------
        words : str
            Dimension, such as pressure or length / time.
        """
        return unit_label(words, self.units, self.trajectory.control, is_line=self.forces_per_length)

    def with_values(self, values: Mapping[str, object]) -> Config:
        """Return the case in which the dotted keys have these values; it has no sweep.

        Parameters
        ----------
        values : mapping of str to object
            Values by dotted keys, such as layer.thickness.
        """
        if not values and not self.sweep:
            return self
        values = plain(values)
        if (known := _known_cases(self).pop(_key(values), None)) is not None:
            return known
        data = self._case_data(values)
        try:
            return Config.model_validate(data)
        except ValidationError as error:
            raise ConfigError(map(str, self.all_problems(plain(data), error))) from None

    def _case_data(self, values: Mapping[str, object]) -> dict[str, Any]:
        """Return the given keys of a case; sections without a changed key are not validated again."""
        data = {key: getattr(self, key) for key in self.model_fields_set - {"sweep"}}
        changed = {key.partition(".")[0] for key in values}
        for head in (changed | _resting(self, changed)) & data.keys():
            data[head] = plain(data[head])
        return sweeps.assigned(data, values)

    def _problems_with(self, values: Mapping[str, object]) -> list[Mistake]:
        data, known = self._case_data(values), _known_cases(self)
        try:
            case = Config.model_validate(data)
        except ValidationError as error:
            return explain(error)
        if len(known) < _CASES:
            known[_key(values)] = case
        return []

    @classmethod
    def _named(cls, values: Sequence[Any], keys: Mapping[str, Any]) -> dict[str, Any]:
        """Return the keys, with those of a body that was made in Python."""
        return in_keys(super()._named(values, keys))

    @classmethod
    def all_problems(cls, data: dict[str, Any], error: ValidationError) -> list[Mistake]:
        """Return the problems that pydantic found in plain data, and the contradictions that they hide.

        Contradictions between sections are looked for only where all values are allowed: without the refused
        values the data are validated once more.
        """
        found = explain(error)
        wrong = [f"{problem.key}." for problem in found]
        refused = [
            problem  # not those that rest on another one
            for problem in found
            if not any(key.startswith(f"{other}.") for key in wrong for other in problem.others)
        ]
        rest = copy.deepcopy(data)
        aside = [set_aside(rest, _without_meaning(p)) for p in refused]
        hidden = (p for p in problems({"name": "unnamed"} | rest) if not sweeps.rests_on(p, aside))
        return [_as_written(data, problem) for problem in (*refused, *hidden)]

    def dump(self) -> str:
        """Return the configuration as YAML with every default written out, which `load` reads back.

        A default that follows from a swept key differs between the cases, and is left out.
        """
        if not self.sweep:
            held = ((key, getattr(self, key)) for key in type(self).model_fields if key != "sweep")
            return "".join(_entry(self, key, value) for key, value in held if value is not None)
        data = self.model_dump(exclude_none=True)
        swept = {location_of_key(key) for key in sweeps.swept_keys(self.sweep)}
        for at, section in sections_in(self):
            if not at or all(at != location[: len(at)] for location in swept):
                continue
            own: Any = data
            for part in at:
                own = own[part]
            for key, field in type(section).model_fields.items():
                if field.default_factory_takes_validated_data and key not in section.model_fields_set:
                    own.pop(key, None)
        for head in {key.partition(".")[0] for key in sweeps.swept_keys(self.sweep)}:
            if head == "trajectory" and "end" not in self.time.model_fields_set:
                data["time"].pop("end", None)
            if head == "interface" and "method" not in self.solver.model_fields_set:
                data["solver"].pop("method", None)
        return text.written(data)


def _resting(config: Config, changed: set[str]) -> set[str]:
    """Return the sections whose texts mean something else where other sections have changed."""
    return {
        head
        for head, others in _RESTS_ON.items()
        if not others.isdisjoint(changed) and _has_texts(getattr(config, head))
    }


@kept_with  # most sections belong to all cases of a sweep
def _has_texts(section: Section) -> bool:
    return any(texts_in(section))


# A force is per length on a line; peak and end are those of the run.
_RESTS_ON = {"trajectory": {"grid"}, "output": {"trajectory", "time"}}
_CASES = 2_000  # of a sweep that are kept between the check of the sweep and their run


@kept_with
def _known_cases(_sweep: Config) -> dict[str, Config]:
    """Return the cases of a sweep that have been validated with it, by their values."""
    return {}


def _key(values: Mapping[str, object]) -> str:
    return repr(sorted(values.items()))


def _entry(config: Config, key: str, value: object) -> str:
    """Return a key of a configuration as YAML."""
    if isinstance(value, Section):
        return _entry_of(value)(key)
    return text.written(config.model_dump(include={key}, exclude_none=True))


@kept_with
def _entry_of(section: Section) -> Callable[[str], str]:
    """Return the YAML of a section under a key; most sections belong to all cases of a sweep."""
    data = section.model_dump(exclude_none=True)
    return cache(lambda key: text.written({key: data}))


@kept_with
def _laws(config: Config) -> tuple[tuple[Interface, ...], tuple[FrictionLaw, ...]]:
    """Return the laws of the interface that attract, and those of friction."""
    every = config.interface_laws.values()
    attracting = tuple(law for law in every if law.attracts)
    friction = tuple(law for law in every if isinstance(law, FrictionLaw))
    if not friction and config.grid.isolated and config.trajectory.moves:
        # Material that enters an isolated cell is at rest: followed by its tractions, here without shear.
        friction = (Coulomb(coefficient=0.0),)
    return attracting, friction


@kept_with
def _solid(config: Config) -> Solid:
    own: Solid
    if config.body is not None and not isinstance(config.body, Layers):
        own = config.body.in_units(config.units)
    else:
        assert config.halfspace is not None
        own = Layers.of(config.layers or (() if config.layer is None else (config.layer,)), config.halfspace)
    second = None if config.counterbody is None else config.counterbody.solid
    return own if second is None else Pair(own, second.in_units(config.units))


def unit_label(words: str, units: Units | None, control: str, *, is_line: bool) -> str:
    """Return the label of a unit from its dimension in words, see `in_words`."""
    words = in_words(words, control, is_line=is_line)
    return words if units is None else units.label(words)


def digest(config: Config) -> str:
    """Return a hash of all input of a case's results: without name and sweep, files by their contents."""
    return _hash(config, {"name": True, "sweep": True, "output": {"keep_state"}})


def stem(config: Config) -> str:
    """Return the hash without the end, the snapshots and the rows: equal for runs that may begin alike.

    A continuous law is replaced by a series for the times up to the end, which counts then.
    """
    kept = {"snapshots"} if config.output.snapshots == "every" else set()
    times = {"keep_state", "times", "snapshots"} - kept
    left_out: dict[str, Any] = {"name": True, "sweep": True, "output": times}
    if not any(isinstance(section, ContinuousLaw) for _, section in sections_in(config)):
        left_out["time"] = {"end"}
    return _hash(config, left_out)


def _hash(config: Config, left_out: dict[str, Any]) -> str:
    laws = config.interfaces or config.friction or config.hardness is not None
    if not laws:  # a given hard wall is the default one
        left_out = left_out | {"interface": True}
    if isinstance(config.body, Layers):  # by the keys beside it
        left_out = left_out | {"body": True}
    data = config.model_dump(exclude=left_out, exclude_none=True)
    data["solver"]["method"] = config.contact_solver.method
    for key, times in (("snapshots", config.output.snapshot_times), ("times", config.output.row_times)):
        if isinstance(data["output"].get(key), dict):  # a range counts as the list of its times
            data["output"][key] = times

    def contents(value: object) -> str:
        if isinstance(value, Path):
            held = value.read_bytes()
            # Before tables had units, those in headings were not converted: such results are others.
            headed = config.units is not None and value.suffix.lower() not in _NO_TABLES
            converted = b" converted" if headed and _LETTER.search(held) else b""
            return hashlib.sha256(held + converted).hexdigest()
        raise TypeError(f"{type(value).__name__} is no part of a configuration")

    canonical = json.dumps(data, sort_keys=True, separators=(",", ":"), default=contents)
    return hashlib.sha256(canonical.encode()).hexdigest()


_NO_TABLES = {".npy", ".h5", ".hdf5", ".nc", ".py", ".bin"}
_LETTER = re.compile(rb"[A-DF-Za-df-z]")  # other than those of numbers such as 1e-3


def problems(data: Mapping[str, Any]) -> list[Mistake]:
    """Return the problems of plain nested data as a configuration."""
    try:
        Config.model_validate(data)
    except ValidationError as error:
        return explain(error)
    return []


def explain(error: ValidationError) -> list[Mistake]:
    """Return the errors that pydantic found in a configuration, as problems."""
    return explained(error, Config, _known_keys())


@cache
def _known_keys() -> list[str]:
    return ["name", *sweeps.leaves(Config(name="defaults"))]


def _without_meaning(problem: Mistake) -> Location:
    """Return the location of what has no meaning without a refused value; a sweep keeps its other keys."""
    above = without_last_places(problem.location)[:-1]
    return above if problem.chooses and above and above[0] != "sweep" else problem.location


def _as_written(data: Any, problem: Mistake) -> Mistake:
    """Return the problem without the index that pydantic counts where the user wrote a single value."""
    *path, last = problem.location
    for part in path:
        try:
            data = data[part]
        except (TypeError, KeyError, IndexError):
            data = None
    if isinstance(last, int) and not isinstance(data, list):
        return replace(problem, location=tuple(path))
    return problem
