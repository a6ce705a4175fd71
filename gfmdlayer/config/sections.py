"""The sections grid, time, solver and output of a configuration; the defaults are the paper's case.

Lengths are in units of the period, moduli in units of G0 and times in units of tau; or use any other units,
but the same everywhere. Symbols and defaults follow Petrenko et al., Mater. Phys. Mech.
52 (2024), Eq. (5) for the Zener material and Eq. (30) for the time axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    FieldSerializationInfo,
    GetJsonSchemaHandler,
    Tag,
    ValidationInfo,
    field_serializer,
    field_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from gfmdlayer.body.layers import Layers, thicknesses
from gfmdlayer.body.pair import downwards, stacks
from gfmdlayer.body.solid import Boundary, LayerDepth, between_faces, beyond, places
from gfmdlayer.config.geometries import GEOMETRIES
from gfmdlayer.config.sweeps import Spaced
from gfmdlayer.contact.solvers import AUTO, SOLVERS
from gfmdlayer.made_once import kept_with
from gfmdlayer.punch.shape import Cell
from gfmdlayer.validation.fields import (
    MANY,
    Count,
    Extended,
    MustBe,
    NotNegative,
    Optional,
    Positive,
    Switch,
    Word,
    given,
    sequence,
    strict,
)
from gfmdlayer.validation.problems import Mistake, Reason, not_increasing, shown
from gfmdlayer.validation.quantities import in_the_run
from gfmdlayer.validation.sections import Section

if TYPE_CHECKING:
    from gfmdlayer.body.solid import Solid

Points = Annotated[
    int, Field(strict=True, ge=8, lt=MANY), MustBe("a whole number >= 8 and < 2^31, or two of them, [nx, ny]")
]
Length = Annotated[float, strict, Field(gt=0), MustBe("a number > 0, finite, or two of them, [Lx, Ly]")]
_Side = Annotated[str, Word("periodic", "isolated", more=", or two of these words, [along x, along y]")]
Tolerance = Annotated[float, strict, Field(ge=1e-13, lt=1), MustBe("a number >= 1e-13 and < 1")]
Step = Annotated[
    Annotated[float, strict, Field(gt=0)] | Literal["adaptive"],
    MustBe("a number > 0, finite, or the word adaptive", ("adaptive",)),
]
AT_ONCE = "at_once"
Steady = Annotated[
    Annotated[float, strict, Field(gt=0)] | Literal["at_once"],
    MustBe(f"a number > 0, finite, or the word {AT_ONCE}", (AT_ONCE,)),
]


class GridKeys(Section):
    """The periodic cell: `points` n or (nx, ny), `period` L or (Lx, Ly); or an isolated contact."""

    geometry: Annotated[Annotated[str, Word(*GEOMETRIES)] | None, given] = None
    """periodic (default), or axisymmetric: one isolated indenter"""
    points: Annotated[tuple[Points, ...], BeforeValidator(sequence)] = Field(
        default_factory=lambda data: (GEOMETRIES[data.get("geometry") or "periodic"].points,)
    )
    """number of points, or [nx, ny]; axisymmetric: points of the profiles"""
    period: Annotated[tuple[Length, ...], BeforeValidator(sequence), Field(validate_default=True)] = (1.0,)
    """period L of the cell, or [Lx, Ly]: length"""
    boundary: Annotated[Annotated[tuple[_Side, ...], BeforeValidator(sequence)] | None, given] = None
    """periodic (default), or isolated: without images; or [along x, along y]"""
    datum: Optional = None
    """one isolated axis: distance where the surface counts as at rest: length"""
    extent: Optional = None
    """axisymmetric: profiles are written up to this radius: length"""

    @field_validator("points", "period", "boundary")
    @classmethod
    def _one_or_two(cls, values: tuple[Any, ...]) -> tuple[Any, ...]:
        if values is not None and len(values) not in {1, 2}:
            raise ValueError(f"got {len(values)} values; must be one, or two for a surface in two directions")
        return values

    @field_validator("boundary")
    @classmethod
    def _one_word_for_both(cls, words: tuple[str, ...]) -> tuple[str, ...]:
        return words[:1] if words and len(set(words)) == 1 else words

    @field_validator("period")
    @classmethod
    def _for_each_direction(cls, period: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        return period * len(info.data.get("points", period)) if len(period) == 1 else period

    @field_serializer("points", "period", "boundary")
    def _number_where_one_will_do(self, values: tuple[Any, ...], info: FieldSerializationInfo) -> object:
        if values is None:
            return None
        same = len(values) == 1 or (info.field_name == "period" and len(set(values)) == 1)
        return values[0] if same else values

    @property
    def isolated(self) -> bool:
        """Whether the contact in the cell has no periodic images along an axis."""
        return "isolated" in (self.boundary or ())

    @property
    def ends_along_x(self) -> bool:
        """Whether material that moves along x enters the cell at rest."""
        return self.isolated and self.without_images.isolated[0]

    @property
    def without_images(self) -> Boundary:
        """The isolated axes and the datum."""
        words = self.boundary or ()
        every = words * len(self.points) if len(words) == 1 else words
        return Boundary(tuple(word == "isolated" for word in every), self.datum)

    @property
    def cell(self) -> Cell:
        """The cell, for shapes of the punch."""
        return Cell(self.points, self.period)

    def problems(self) -> Iterator[Mistake]:
        """Refuse periods that do not match the directions, and more points than FFTW counts."""
        if len(self.period) != len(self.points):
            message = (
                f"got {len(self.period)} lengths for {len(self.points)} "
                f"direction{'s' * (len(self.points) > 1)} of points; must be one number, or one for each "
                "direction"
            )
            yield Mistake(("period",), message, ("points",))
        if self.boundary is not None and len(self.boundary) > len(self.points):
            message = (
                f"got {len(self.boundary)} words for one direction of points; must be periodic or isolated"
            )
            yield Mistake(("boundary",), message, ("points",))
        if math.prod(self.points) >= MANY:
            total = f"{math.prod(self.points):.3g} points"
            yield Mistake(("points",), f"got {shown(self.points)}, {total}; must be fewer than 2^31 in all")


class Time(Section):
    """The time axis from 0 to `end`."""

    end: Positive = 8.0
    """end of the run; default: the end of the approach_retract path: time"""
    step: Step = "adaptive"
    """time step; adaptive, the default: steps to the tolerance below: time"""
    integrator: Annotated[str, Word("backward_euler", "exponential")] = "exponential"
    """exponential (second order), or backward_euler as in the paper"""
    tolerance: Optional = Field(default_factory=lambda data: 1e-4 if data.get("step") == "adaptive" else None)
    """relative error of adaptive steps, default 1e-4"""
    steady: Annotated[Steady | None, given] = None
    """moving punch: ends below this relative change; at_once with friction"""

    @property
    def at_once(self) -> bool:
        """Whether the run is one step of the steady state."""
        return self.steady == AT_ONCE

    def problems(self) -> Iterator[Mistake]:
        """Refuse an integrator that cannot adapt its steps, and steps that do not end at `end`."""
        if self.step == "adaptive":
            if self.integrator == "backward_euler" and "step" not in self.model_fields_set:
                message = "missing; must be a number > 0: the steps of backward_euler are equal"
                yield Mistake(("step",), message, ("integrator",))
            elif self.integrator == "backward_euler":
                allowed = "must be exponential, which estimates its error"
                message = f"got backward_euler with step: adaptive; {allowed}"
                yield Mistake(("integrator",), message, ("step",), because="physics")
            return
        if self.tolerance is not None:
            message = "only for adaptive steps; remove it or set time.step: adaptive"
            yield Mistake(("tolerance",), message, ("step",))
        if self.step > self.end:
            message = f"got {self.step!r}, beyond time.end = {self.end!r}; must be a number <= time.end"
            yield Mistake(("step",), message, ("end",))
        elif message := self.misses(self.end):
            yield Mistake(("end",), message, ("step", "integrator"))

    def misses(self, time: float) -> str:
        """Return a message if no step ends at a time; backward Euler's steps are equal, as in the paper."""
        if self.integrator != "backward_euler" or self.step == "adaptive" or whole_steps(time, self.step):
            return ""
        allowed = f"must be a whole number of steps of {self.step!r}, or set time.integrator: exponential"
        return f"got {time!r}; {allowed}"


class SolverKeys(Section):
    """Solver of the contact problem of each step; `inertia` is for fire only."""

    method: Annotated[str, Word(AUTO, *SOLVERS)] = AUTO
    """auto, or a solver; newton or fire if an interface attracts"""
    tolerance: Tolerance = 1e-6
    """largest residual of a step, relative to pressure and depth"""
    inertia: Annotated[Annotated[str, Word("mass_weighted", "uniform")] | None, given] = Field(
        default_factory=lambda data: "mass_weighted" if data.get("method") == "fire" else None
    )
    """fire: inertia of the modes, mass_weighted (default) or uniform"""
    max_iterations: Count = 20000
    """a case fails after this many iterations in one step"""

    def problems(self) -> Iterator[Mistake]:
        """Reject an inertia for solvers without one."""
        if self.inertia is not None and self.method != "fire":
            message = "only for method: fire; remove it or set method: fire"
            yield Mistake(("inertia",), message, ("method",))


def whole_steps(time: float, step: float) -> bool:
    """Whether a time is a whole number of steps, within a millionth of one."""
    return abs(time / step - round(time / step)) <= 1e-6


# The section of the configuration that lists the output of a run.

_words = "start", "peak", "end"


class _Moment(MustBe):
    """Annotation of a time that may be a word, which the configuration around it knows."""

    def number(self, text: str) -> float | None:
        """Return the time of a word, or of a number with a unit."""
        return in_the_run(text) if text in self.words else super().number(text)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Add the words."""
        node = super().__get_pydantic_json_schema__(schema, handler)
        return {"$comment": node.pop("$comment"), "anyOf": [node, {"enum": [*self.words]}]}


Moment = Annotated[
    float, strict, Field(ge=0), _Moment(f"a number >= 0, finite, or one of {', '.join(_words)}", _words)
]


class MomentsBetween(Spaced):
    """Times by a formula, both ends included, equally spaced or equally in the logarithm."""

    from_: Moment = Field(alias="from")
    """first time, or start, peak, end: time"""
    to: Moment
    """last time, or start, peak, end: time"""

    @property
    def moments(self) -> tuple[float, ...]:
        """The times; both ends are exact."""
        return _moments(self)


@kept_with
def _moments(given: MomentsBetween) -> tuple[float, ...]:
    return (float(given.from_), *map(float, given.values()[1:-1]), float(given.to))


def listed(value: object) -> object:
    """Take a word alone for a list of one."""
    return (value,) if isinstance(value, str) and value in _words else value


def _form(value: object) -> str:
    if isinstance(listed(value), (list, tuple)):
        return "<list>"
    return "<range>" if isinstance(value, (Mapping, MomentsBetween)) else "<one>"


Spacing = Annotated[
    float,
    strict,
    Field(gt=0),
    MustBe(f"a number > 0, a list of times, one of {', '.join(_words)}, or {{from, to, points, spacing}}"),
]
_List = Annotated[tuple[Moment, ...], BeforeValidator(listed), Tag("<list>")]
_Range = Annotated[MomentsBetween, Tag("<range>")]
Rows = Annotated[Annotated[Spacing, Tag("<one>")] | _List | _Range, Discriminator(_form)]
Bins = Annotated[int, Field(strict=True, ge=1, le=1000), MustBe("a whole number from 1 to 1000")]
_every = MustBe(
    f"a list of times, one of {', '.join(_words)}, {{from, to, points, spacing}}, or the word every",
    ("every", *_words),
)
Snapshots = Annotated[
    _List | _Range | Annotated[Literal["every"], _every, Tag("<one>")], Discriminator(_form)
]
Frequencies = Annotated[
    tuple[Extended, ...],
    Field(min_length=1, max_length=100),
    MustBe("a list of 1 to 100 numbers >= 0 or .inf"),
]
SURFACE_ESTIMATES = ("critical_gap_x", "critical_gap_y", "flow_bruggeman", "spot_radius")
MOST_ROWS = 1_000_000  # of a case


class Histogram(Section):
    """Bins of a distribution: `bins` equal bins from 0 to `max`, or on a log scale from `min` to `max`.

    One further bin at each end counts the values beyond.
    """

    max: Positive
    """end of the last bin"""
    bins: Bins = 50
    """number of bins"""
    scale: Annotated[str, Word("linear", "log")] = "linear"
    """linear: bins start at 0; log: at min"""
    min: Optional = None
    """scale: log: start of the first bin"""

    def problems(self) -> Iterator[Mistake]:
        """Reject a start that does not fit the scale or the end."""
        wrong = ""
        if self.scale == "linear" and self.min is not None:
            wrong = "only for scale: log; remove it or set scale: log"
        elif self.scale == "log" and self.min is None:
            wrong = "missing; scale: log needs a number > 0 and < max"
        elif self.min is not None and self.min >= self.max:
            wrong = f"got {self.min!r}; must be a number > 0 and < max = {self.max!r}"
        if wrong:
            yield Mistake(("min",), wrong, ("scale", "max"))


class PressureHistogram(Histogram):
    """Bins of the contact pressure."""

    max: Positive
    """end of the last bin: pressure"""
    min: Optional = None
    """scale: log: start of the first bin: pressure"""


class GapHistogram(Histogram):
    """Bins of the gap."""

    max: Positive
    """end of the last bin: length"""
    min: Optional = None
    """scale: log: start of the first bin: length"""


class Histograms(Section):
    """Distributions over the surface, written with each row."""

    pressure: Annotated[PressureHistogram | None, given] = None
    """distribution of the contact pressure: {max: ..., bins: ...}"""
    gap: Annotated[GapHistogram | None, given] = None
    """distribution of the gap: {max: ..., bins: ..., scale: ..., min: ...}"""


class Leakage(Section):
    """The flow tensor of the gap as columns, in every n-th row, at the snapshots and at the end; else NaN."""

    every: Count = 1
    """accepted steps from one flow to the next"""


Resistivity = Annotated[float, Field(strict=True, ge=0), MustBe("a number >= 0 or .inf")]


class Film(Section):
    """A film on a conductor."""

    thickness: Positive
    """thickness of the film: length"""
    resistivity: Positive
    """resistivity of the film: ohm length"""


class Conductor(Section):
    """One of the two conductors: films, the uppermost first, on a halfspace of a resistivity.

    With the resistivity .inf the back is insulated; with 0 it is a perfect conductor.
    """

    resistivity: Resistivity = 0.0
    """resistivity; 0: a perfect conductor, .inf: an insulated back: ohm length"""
    films: tuple[Film, ...] = ()
    """films from the contact inwards: [{thickness: ..., resistivity: ...}]"""


class Conductance(Section):
    """The resistance of the contact spots as a column: constriction, and the films in series.

    The two conductors are the body and the punch. Thermal conductors follow the same equations.
    """

    body: Conductor = Field(default_factory=Conductor)
    """the conductor below the contact"""
    punch: Conductor = Field(default_factory=Conductor)
    """the conductor above it"""
    every: Count = 1
    """accepted steps from one resistance to the next"""

    def problems(self) -> Iterator[Mistake]:
        """Refuse two perfect conductors without a film."""
        if all(side.resistivity == 0 and not side.films for side in (self.body, self.punch)):
            message = "two perfect conductors have no resistance; give body or punch a resistivity or a film"
            yield Mistake(("body",), message, ("punch",))


class Stiffness(Section):
    """The dynamic stiffness of the contact at a frozen contact area, at some frequencies, as columns."""

    frequencies: Frequencies
    """frequencies, cycles per time; 0: relaxed, .inf: glassy: 1 / time"""
    every: Count = 1
    """accepted steps from one stiffness to the next"""


MOST_DEPTHS = 10_000
_WITHOUT_LAYERS = 0.25  # of the shortest period: depth in a halfspace without layers

Depths = Annotated[
    tuple[NotNegative, ...],
    Field(min_length=1, max_length=MOST_DEPTHS),
    MustBe(f"a list of 1 to {MOST_DEPTHS} numbers >= 0"),
]
PerLayer = Annotated[int, Field(strict=True, ge=2, le=1000), MustBe("a whole number from 2 to 1000")]


class Inside(Section):
    """Displacements and stresses below the surface at the snapshots, at `depths` or `points` in each layer.

    With `every` also columns of the rows: the largest stresses at these depths, and at the interfaces.
    """

    depths: Annotated[Depths | None, given] = None
    """depths below the surface, increasing; an interface has both sides: length"""
    points: Annotated[PerLayer | None, given] = None
    """in place of depths: depths in each layer, from face to face"""
    times: Annotated[tuple[Moment, ...] | None, given] = None
    """the snapshots with fields below the surface; default: all: time"""
    every: Annotated[Count | None, given] = None
    """columns of the largest stresses, in every n-th row; default: none"""

    def problems(self) -> Iterator[Mistake]:
        """Require one of depths and points, and numbers that increase."""
        if (self.depths is None) == (self.points is None):
            has_depths = self.depths is not None
            wrong = "given beside points; remove one" if has_depths else "missing; give depths or points"
            yield Mistake(("depths",), wrong, ("points",))
        for key, values in (("depths", self.depths), ("times", self.times)):
            yield from not_increasing((key,), values or (), key, key)

    def places(self, solid: Solid, period: Sequence[float]) -> list[LayerDepth]:
        """Return the places in a body of layers and its counterbody; a depth at an interface has two."""

        def own(body: Layers) -> list[LayerDepth]:
            layers, depths = thicknesses(body), self.depths
            if depths is None:
                assert self.points is not None
                depths = tuple(between_faces(layers, self.points, _WITHOUT_LAYERS * min(period)))
            return places(layers, depths)

        return downwards(*map(own, stacks(solid)))

    def wants(self, time: float) -> bool:
        """Whether the snapshot at a time has fields below the surface."""
        return self.times is None or any(math.isclose(time, own, rel_tol=1e-9) for own in self.times)


class Output(Section):
    """Output besides the curves: snapshots of the surface, times of the rows, patches, distributions.

    Times may be the words `start`, `peak` (the first of the trajectory, not of a table) and `end` of the run.
    """

    snapshots: Snapshots = ()
    """times of the surface, or {from, to, points}; every: each step: time"""
    times: Annotated[Rows | None, given] = None
    """adaptive steps: times of rows, a spacing or {from, to, points}: time"""
    patches: Switch = False
    """count the connected patches of contact"""
    histograms: Histograms = Field(default_factory=Histograms)
    """distributions written with each row"""
    observables: Annotated[tuple[Annotated[str, Word(*SURFACE_ESTIMATES)], ...] | None, given] = None
    """cheap columns of a seal or a conductor, on a surface in two directions"""
    leakage: Annotated[Leakage | None, given] = None
    """flow through the gap as columns: {every: 10}"""
    conductance: Annotated[Conductance | None, given] = None
    """resistance of the contact: {body: {resistivity: ...}}"""
    stiffness: Annotated[Stiffness | None, given] = None
    """dynamic stiffness of the contact: {frequencies: [...]}"""
    inside: Annotated[Inside | None, given] = None
    """stresses below the surface: {depths: [...]} or {points: ...}"""
    keep_state: Switch = False
    """keep the final state, so that a later time.end continues from it"""

    @property
    def snapshot_times(self) -> tuple[float, ...]:
        """The times of the snapshots that a run must land on."""
        return () if self.snapshots == "every" else self._moments["snapshots"]

    @property
    def row_times(self) -> float | tuple[float, ...] | None:
        """The spacing or the times of the rows that a run must land on, where they are given."""
        return self.times if isinstance(self.times, float | None) else self._moments["times"]

    @property
    def _moments(self) -> dict[str, tuple[float, ...]]:
        """The lists of times by their keys."""
        every = {"snapshots": self.snapshots, "times": self.times}
        spaced = {key: each.moments for key, each in every.items() if isinstance(each, MomentsBetween)}
        return spaced | {key: each for key, each in every.items() if isinstance(each, tuple)}

    def problems(self) -> Iterator[Mistake]:
        """Refuse times or frequencies that do not increase, and observables named twice."""
        for i, name in enumerate(names := self.observables or ()):
            if name in names[:i]:
                yield Mistake(("observables", i), f"got {name!r} twice; name it once", ("observables",))
        frequencies = () if self.stiffness is None else self.stiffness.frequencies
        yield from not_increasing(("stiffness", "frequencies"), frequencies, "frequencies", "stiffness")
        for key, times in self._moments.items():
            yield from not_increasing((key,), times, "times", key)

    def problems_until(self, end: float) -> Iterator[Mistake]:
        """Refuse times past the end of the run, and too many rows."""
        for key, times in self._moments.items():
            spaced = isinstance(getattr(self, key), MomentsBetween)
            for i, time in enumerate(times):
                if time > end and (not spaced or i == len(times) - 1):
                    message = f"got {shown(time)}, past the end; must be a number <= time.end = {end!r}"
                    yield Mistake((key, "to" if spaced else i), message)
        if isinstance(self.times, float) and not 0 < self.times <= end:
            message = f"got a spacing of {self.times!r}; must be a number > 0 and <= time.end = {end!r}"
            yield Mistake(("times",), message)
        elif isinstance(self.times, float) and end / self.times > MOST_ROWS:
            rows = f"{end / self.times:.3g} rows"
            message = f"got {self.times!r}, which gives {rows}; must be >= {end / MOST_ROWS!r}"
            yield Mistake(("times",), message)


def problems_of_the_inside(config: Any) -> Iterator[Mistake]:
    """Refuse fields below the surface where they are not known, depths below the body, and other times."""
    inside: Inside | None = config.output.inside
    if inside is None:
        return
    at = ("output", "inside")
    bodies = stacks(config.solid)
    if not bodies:
        own, other = (getattr(each, "body", None) for each in (config, config.counterbody))
        kind = next(each.kind for each in (own, other) if not isinstance(each, Layers | None))
        message = f"not available with kind: {kind}, of which the surface alone is known; must be layers"
        because: Reason = "open" if kind == "anisotropic" else "physics"
        yield Mistake(at, message, ("body", "counterbody"), because=because)
        return
    if config.grid.isolated:
        message = (
            "not available with boundary: isolated: the stress inside without images is missing; remove it"
        )
        yield Mistake(at, message, ("grid.boundary",), because="open")
    for body, name in zip(bodies, ("body", "counterbody"), strict=False):
        if inside.depths is not None and (below := beyond(thicknesses(body), inside.depths)) is not None:
            i, whole = below
            message = f"got {inside.depths[i]!r}; must be at most {whole:g}, the thickness of the {name}"
            others = ("layer.thickness", "layers", "halfspace", "counterbody")
            yield Mistake((*at, "depths", i), message, others)
    snapshots = config.output.snapshots
    if not snapshots and inside.every is None:
        message = "there is no snapshot with fields; set output.snapshots, or every for columns"
        yield Mistake(at, message, ("output.snapshots",))
    for i, time in enumerate(inside.times or ()):
        known = config.output.snapshot_times
        if not any(math.isclose(time, own, rel_tol=1e-9) for own in known):
            message = f"got {time!r}; must be one of output.snapshots"
            yield Mistake((*at, "times", i), message, ("output.snapshots",))
