"""A sweep: its keys, and the cases that it stands for.

    layer.thickness: [0.1, 0.2]                          each value of a key with each of the other keys
    punch.radius: {from: 0.1, to: 10, points: 5, spacing: log}     a list by a formula, here and in zip
    zip: {layer.thickness: [...], punch.radius: [...]}   first with first, second with second, ...
    latin_hypercube: {samples: 100, seed: 7, layer.thickness: {from: 0.01, to: 1, scale: log}, ...}
    sobol: {samples: 128, seed: 7, ...}                  likewise, by a scrambled Sobol sequence

At most one of the last three makes a list of combinations; each of these meets every product of the keys
beside it.  Samples are those of scipy.stats.qmc; scipy is imported only where there are any.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, lru_cache, partial
from itertools import chain, product
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    SerializerFunctionWrapHandler,
    Tag,
    ValidationInfo,
    field_validator,
    model_serializer,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from gfmdlayer.body.materials import Law
from gfmdlayer.body.solid import Solid
from gfmdlayer.interface.interface import Interface
from gfmdlayer.punch.shape import Shape
from gfmdlayer.validation import quantities
from gfmdlayer.validation.fields import MANY, Count, Finite, MustBe, Seed, Word, given
from gfmdlayer.validation.problems import (
    ConfigError,
    InconsistentError,
    Location,
    Mistake,
    dotted_key,
    location_of_key,
    not_in_list,
    set_aside,
    shown,
    unknown_key,
)
from gfmdlayer.validation.quantities import Written
from gfmdlayer.validation.sections import Section, sections_in

SAMPLED = ("latin_hypercube", "sobol")
LISTS = ("zip", *SAMPLED)
MAX_CASES = 1_000_000
UNSWEPT = frozenset({"name", "units", "sweep"})  # keys and sections that are the same in all cases

# Samples are rounded to so many digits: the last digits differ between mathematical libraries, and a sweep
# that continues on another machine must find its cases again.
_DIGITS = 12

Row = dict[str, object]


def _has_logarithm(scale: str, info: ValidationInfo) -> str:
    if scale == "log" and info.data.get("from_", 1.0) <= 0:
        raise ValueError(f"got log with from = {shown(info.data['from_'])}; must be linear, or set from > 0")
    return scale


Scale = Annotated[str, Word("linear", "log"), AfterValidator(_has_logarithm)]


class Ends(Section):
    """Both ends of a range."""

    from_: Finite = Field(alias="from")
    """start of the range"""
    to: Finite
    """end of the range"""

    @field_validator("to")
    @classmethod
    def _beyond(cls, to: float, info: ValidationInfo) -> float:
        if "from_" in info.data and to <= info.data["from_"]:
            raise ValueError(f"got {shown(to)}; must be a number > from = {shown(info.data['from_'])}")
        return to

    @model_serializer(mode="wrap")
    def _written(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Dump the keys as users write them."""
        return {{"from_": "from"}.get(key, key): value for key, value in handler(self).items()}

    def between(self, part: float, scale: str) -> float:
        """Return the value at a part of the way, in [0, 1], on a linear or a log scale."""
        if scale == "log":
            value = self.from_ * math.exp(part * math.log(self.to / self.from_))
        else:
            value = self.from_ + part * (self.to - self.from_)
        return min(max(float(f"{value:.{_DIGITS}g}"), self.from_), self.to)


class Range(Ends):
    """Range of the samples of a key, spread evenly or evenly in the logarithm."""

    scale: Scale = "linear"
    """spread evenly, or evenly in the logarithm"""

    def at(self, part: float) -> float:
        """Return the value at a part of the way, in [0, 1]."""
        return self.between(part, self.scale)


class Spaced(Ends):
    """Values of a key by a formula, both ends included, equally spaced or equally in the logarithm."""

    points: Annotated[
        int, Field(strict=True, ge=2, le=MAX_CASES), MustBe(f"a whole number from 2 to {MAX_CASES}")
    ]
    """number of values"""
    spacing: Scale = "linear"
    """equally spaced, or equally in the logarithm"""

    def values(self) -> list[float]:
        """Return the values; numbers of points have to be whole ones."""
        spaced = (self.between(i / (self.points - 1), self.spacing) for i in range(self.points))
        return [int(value) if value.is_integer() and abs(value) < MANY else value for value in spaced]


def _form(values: object) -> str:
    return "<range>" if isinstance(values, Mapping) and not _ENDS.isdisjoint(values) else "<list>"


_ENDS = {"from", "to", "spacing"}
_Values = Annotated[
    Annotated[Spaced, AfterValidator(Spaced.values), Tag("<range>")] | Annotated[Any, Tag("<list>")],
    Discriminator(_form),
]


class Zip(Section):
    """Keys with lists of equal length."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, _Values]
    entries = Spaced


class Samples(Section):
    """Number of samples, seed, and keys with their ranges."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Range]
    entries = Range

    samples: Count
    """number of samples"""
    seed: Seed = 0
    """seed of the random numbers; the same seed gives the same samples"""


_Samples = Annotated[Samples | None, given]


class Sweep(Section):
    """The form of a sweep; the functions below check its keys and values."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, _Values]
    entries = Spaced

    zip: Annotated[Zip | None, given] = None
    """dotted keys with lists of equal length: first with first, second with second"""
    latin_hypercube: _Samples = None
    """number of samples, and dotted keys with ranges"""
    sobol: _Samples = None
    """number of samples, a power of two, and dotted keys with ranges"""


class PlainSweep:
    """Annotation of a mapping with the form of a `Sweep` that stays plain data."""

    section = Sweep

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate the form, then return plain data with the defaults."""
        as_it_is = core_schema.simple_ser_schema("any")
        shape = handler.generate_schema(Sweep)
        return core_schema.no_info_after_validator_function(_plain, shape, serialization=as_it_is)


def _plain(sweep: Sweep) -> dict[str, Any]:
    dumped = sweep.model_dump(by_alias=True)
    return {key: value for key, value in dumped.items() if value is not None or key not in LISTS}


def with_numbers(sweep: Mapping[str, Any], dimension: Callable[[str], str]) -> dict[str, Any]:
    """Return a sweep in which texts with units are numbers, by the dimension of each key in words.

    A refused text stays, and the cases refuse it; InconsistentError for the ends of ranges.
    """
    mistakes: list[Mistake] = []

    def number(value: object, key: str, at: Location = ()) -> object:
        if isinstance(value, list | tuple):
            return [number(each, key) for each in value]
        text = value.text if isinstance(value, Written) else value
        if not isinstance(text, str):
            return value
        try:
            found = quantities.number(text, words, "a number") if (words := dimension(key)) else None
        except PydanticCustomError as error:
            mistakes.extend([Mistake(at, str(error), ("units",))] if at else [])
            return text
        return text if found is None else Written(found, text)

    def entry(values: object, *at: str) -> object:
        if isinstance(values, Mapping):
            ends = {end: number(values[end], at[-1], (*at, end)) for end in ("from", "to") if end in values}
            return {**values, **ends}
        return number(values, at[-1])

    found = {
        name: {key: entry(values, name, key) for key, values in held.items()}
        if name in LISTS and isinstance(held, Mapping)
        else entry(held, name)
        for name, held in sweep.items()
    }
    if mistakes:
        raise InconsistentError(mistakes)
    return found


@dataclass(frozen=True, eq=False)
class Axis:
    """One factor of the product: a swept key with its values, or a list of combinations."""

    rows: Sequence[Row]  # dotted keys and their values, in each place of the axis
    location: Location  # of the keys in the configuration
    sampled: bool = False  # whether the values are samples, which the configuration does not contain

    def place(self, key: str, index: int) -> Location:
        """Return the location of a key's value in a row."""
        return (*self.location, key) if self.sampled else (*self.location, key, index)


def axes(sweep: Mapping[str, Any]) -> list[Axis]:
    """Return the factors of a sweep, the list of combinations first."""
    factors: list[Axis] = []
    for name, entry in sweep.items():
        if name == "zip":
            rows = [dict(zip(entry, values, strict=True)) for values in zip(*entry.values(), strict=True)]
            factors.insert(0, Axis(rows, ("sweep", name)))
        elif name in SAMPLED:
            factors.insert(0, Axis(_samples(name, entry), ("sweep", name), sampled=True))
        else:
            factors.append(Axis([{name: value} for value in entry], ("sweep",)))
    return factors


def combinations(sweep: Mapping[str, Any]) -> list[Row]:
    """Return the swept keys and their values in each case, the last key running fastest."""
    return [dict(chain(*(row.items() for row in rows))) for rows in product(*(a.rows for a in axes(sweep)))]


def swept_keys(sweep: Mapping[str, Any]) -> list[str]:
    """Return the swept keys in the order of the cases' values."""
    listed = [key for name in LISTS for key in keys_of(sweep.get(name, {}))]
    return listed + [key for key in sweep if key not in LISTS]


def is_listed(sweep: Mapping[str, Any]) -> bool:
    """Whether the cases are a list of combinations rather than a product of values."""
    return any(name in sweep for name in LISTS)


def sampling(sweep: Mapping[str, Any]) -> dict[str, str | int | float]:
    """Return method, number and seed of the samples; empty without samples."""
    name = next((name for name in SAMPLED if name in sweep), "")
    return {"sampling": name} | {key: sweep[name][key] for key in Samples.model_fields} if name else {}


def count(sweep: Mapping[str, Any]) -> int:
    """Return the number of cases, without making any."""
    return math.prod(
        entry["samples"]
        if name in SAMPLED
        else len(next(iter(entry.values()), ()) if name == "zip" else entry)
        for name, entry in sweep.items()
    )


def location_of(sweep: Mapping[str, Any], key: str) -> Location:
    """Return the location of a key: in the sweep if the key or its section is swept, else its own."""
    swept = next((name for name in swept_keys(sweep) if f"{key}.".startswith(f"{name}.")), None)
    if swept is None:
        return location_of_key(key)
    return next((("sweep", name, swept) for name in LISTS if swept in sweep.get(name, ())), ("sweep", swept))


def unswept(key: str) -> str:
    """Remove the sweep's own names before a key: sweep.zip.punch.radius is punch.radius."""
    for head in ("sweep", *LISTS):
        key = key.removeprefix(f"{head}.")
    return key


def as_label(key: str, value: object) -> str:
    """Write a value for labels: fire, 64x128 for a grid, model=zener, G0=1.0 for a mapping."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name}={as_label('', entry)}" for name, entry in value.items())
    if isinstance(value, list | tuple):
        parts = [as_label("", entry) for entry in value]
        return "x".join(parts) if key.startswith("grid.") else f"[{', '.join(parts)}]"
    return str(value).lower() if isinstance(value, bool) else str(value)


def keys_of(listed: Iterable[str]) -> list[str]:
    """Return the swept keys of a list of combinations."""
    return [key for key in listed if key not in Samples.model_fields]


def _samples(method: str, design: Mapping[str, Any]) -> list[Row]:
    ranges = {key: Range.model_validate(design[key]) for key in keys_of(design)}
    points = _points(method, len(ranges), design["samples"], design["seed"])
    every = (zip(ranges.items(), point, strict=True) for point in points)
    return [{key: one.at(part) for (key, one), part in pairs} for pairs in every]


@lru_cache(maxsize=4)
def _points(method: str, dimensions: int, samples: int, seed: int) -> list[list[float]]:
    """Return points of the unit cube, one for each sample; the same seed gives the same points."""
    import numpy as np
    from scipy.stats import qmc

    engine = {"latin_hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}[method]
    points: list[list[float]] = engine(dimensions, seed=np.random.default_rng(seed)).random(samples).tolist()
    return points


def leaves(config: Section) -> list[str]:
    """Return the dotted keys of all values, in the order of the model."""
    return [
        dotted_key((*at, key))
        for at, section in sections_in(config)
        if at
        for key, value in section.values_written().items()
        if not isinstance(value, Section)
    ]


def sweepable(config: Section) -> list[str]:
    """Return the dotted keys that may be swept: the leaves, and sections with several kinds or forms.

    The interface may be swept without one of its own: each case has one.
    """
    forms = (Law, Shape, Interface, Solid, Spaced)
    kinds = [at for at, section in sections_in(config) if isinstance(section, forms)]
    swept = (key for key in leaves(config) if key.partition(".")[0] not in UNSWEPT)
    return list(dict.fromkeys([*swept, *(dotted_key(at) for at in kinds), "interface"]))


def assigned(data: Mapping[str, Any], values: Mapping[str, object]) -> dict[str, Any]:
    """Return a copy of nested `data` with values at dotted keys."""
    result = dict(data)
    for key, value in values.items():
        head, _, tail = key.partition(".")
        inner = result.get(head)
        if not tail:
            result[head] = value
        elif isinstance(inner, list | tuple):
            if wrong := not_in_list(location_of_key(tail)[0], len(inner), head):
                raise ConfigError([f"{key}: {wrong}"])
            entries = {str(i): entry for i, entry in enumerate(inner)}
            result[head] = [*assigned(entries, {tail: value}).values()]
        else:
            result[head] = assigned(inner if isinstance(inner, Mapping) else {}, {tail: value})
    return result


# Checks of a sweep: its keys, its values, and the cases that they make.

MAX_CHECKED_PRODUCT = 10_000  # beyond it, one value is varied at a time; 10 000 cases take about a second
MAX_CHECKED_VALUES = 5_000  # of a key; of more, some are checked now and the others when their cases run

Validate = Callable[[Row], list[Mistake]]


def conflicts(
    sweep: Mapping[str, Any], keys: Sequence[str], unswept: Sequence[Mistake], validate: Validate
) -> Iterator[Mistake]:
    """Yield the problems of a sweep whose cases `validate` checks.

    `keys` can be swept; `unswept` are the problems with the configuration's own values of the swept keys.
    What rests on a refused key of the sweep is left out.
    """
    left: Mapping[str, Any] = sweep
    for check in (partial(_keys, keys=keys), _lists, _size):
        wrong = list(check(left))
        yield from wrong
        left = _without(left, wrong)
    factors = axes(left)
    refused_values = {problem.location: problem for axis in factors for problem in _values(axis)}
    yield from refused_values.values()
    places = {
        axis: [
            i
            for i, row in enumerate(axis.rows)
            if not any(axis.place(key, i) in refused_values for key in row)
        ]
        for axis in factors
    }
    usable = {axis: indices for axis, indices in places.items() if indices}
    swept = [key for axis in usable for key in axis.rows[0]]
    refused = [key for key in swept_keys(sweep) if key not in swept]
    everywhere = [p for p in unswept if not (any(_under(p, key) for key in swept) or rests_on(p, refused))]
    yield from everywhere
    if usable:
        yield from _of_cases(
            usable,
            lambda case: [p for p in validate(case) if p not in everywhere and not rests_on(p, refused)],
        )


def _without(sweep: Mapping[str, Any], wrong: Sequence[Mistake]) -> Mapping[str, Any]:
    """Return a sweep without the places of problems, and without lists that are then incomplete."""
    if not wrong:
        return sweep
    data = {"sweep": copy.deepcopy(dict(sweep))}
    for problem in wrong:
        set_aside(data, problem.location)
    left = data.get("sweep", {})
    incomplete = [name for name in LISTS if name in left and not keys_of(left[name])]
    incomplete += [name for name in SAMPLED if name in left and "samples" not in left[name]]
    return {key: entry for key, entry in left.items() if key not in incomplete}


def _size(sweep: Mapping[str, Any]) -> Iterator[Mistake]:
    """Yield a product of too many cases."""
    if (size := count(sweep)) > MAX_CASES:
        yield Mistake(("sweep",), f"got a product of {size} cases; must be at most {MAX_CASES}")


def _keys(sweep: Mapping[str, Any], keys: Sequence[str]) -> Iterator[Mistake]:
    """Yield unknown keys, keys swept twice, and lists of combinations beside each other."""
    lists = [name for name in LISTS if name in sweep]
    for name in lists[1:]:
        message = f"given beside {lists[0]}; choose one of {', '.join(LISTS)}"
        yield Mistake(("sweep", name), message, at_key=True)
    for name in lists:
        if not keys_of(sweep[name]):
            values = "{from: ..., to: ...}" if name in SAMPLED else "a list of values"
            yield Mistake(("sweep", name), f"got no keys; give dotted keys, each with {values}")
    seen: list[str] = []
    every: list[tuple[Location, str, Any]] = [
        (("sweep", name, key), key, sweep[name][key]) for name in lists for key in keys_of(sweep[name])
    ]
    every += [(("sweep", key), key, values) for key, values in sweep.items() if key not in LISTS]
    for location, key, values in every:
        above = (other for other in seen if f"{key}.".startswith(f"{other}."))
        below = (other for other in seen if other.startswith(f"{key}."))
        same = next(itertools.chain(above, below), None)
        if values and isinstance(values, Mapping) and location[1] not in SAMPLED:
            yield Mistake(location, _nested(key, values, keys), at_key=True)
        elif key not in keys:
            yield Mistake(location, _not_swept(key, keys, location), at_key=True)
        elif same is not None:
            yield Mistake(location, f"already swept by {same}; give one of the two", at_key=True)
        else:
            seen.append(key)


def _nested(key: str, values: Mapping[str, Any], keys: Sequence[str]) -> str:
    """Return the message for a mapping in place of a list, with the dotted keys to use."""
    names, inner = [], [(key, values)]
    for head, mapping in inner:
        for name, value in mapping.items():
            inner += [(f"{head}.{name}", value)] if isinstance(value, Mapping) else []
            names += [] if isinstance(value, Mapping) else [f"{head}.{name}"]
    meant = [name if name in keys else next(iter(get_close_matches(name, keys, n=1)), name) for name in names]
    hint = " and ".join(name for name in dict.fromkeys(meant) if name != key)
    if hint:
        return f"got a mapping; give a list under each dotted key; did you mean {hint}?"
    return "got a mapping; must be a list of values, or {from: ..., to: ..., points: ...}"


def _not_swept(key: str, keys: Sequence[str], location: Location) -> str:
    if key.partition(".")[0] in UNSWEPT:
        return "cannot be swept; allowed: a dotted key such as layer.thickness"
    if wrong := _not_in_its_list(key, keys):
        return wrong
    below = [name for name in keys if name.startswith(f"{key}.")]
    siblings = below or [name for name in keys if name.startswith(key.rpartition(".")[0] + ".")]
    lists = list(LISTS) if len(location) == 2 and "." not in key else []
    return unknown_key(key, siblings or [*keys, *lists], keys)


def _not_in_its_list(key: str, keys: Sequence[str]) -> str:
    """Return a message if a part of a key is beyond its list."""
    parts = key.split(".")
    for depth in range(1, len(parts)):
        head = ".".join(parts[:depth])
        inside = (name.removeprefix(f"{head}.") for name in keys if name.startswith(f"{head}."))
        places = {name.partition(".")[0] for name in inside}
        wrong = not_in_list(location_of_key(parts[depth])[0], len(places), head)
        if places and wrong and all(place.isdigit() for place in places):
            return wrong
    return ""


def _lists(sweep: Mapping[str, Any]) -> Iterator[Mistake]:
    """Yield values that are not lists or have a wrong length, and impossible numbers of samples."""
    zipped = {("sweep", "zip", key): values for key, values in sweep.get("zip", {}).items()}
    for location, values in (zipped | {("sweep", k): v for k, v in sweep.items() if k not in LISTS}).items():
        if not isinstance(values, list | tuple):
            yield Mistake(location, f"got {shown(values)}; must be a list")
        elif not values:
            yield Mistake(location, "got an empty list; must be a list of at least one value")
    lists = {
        location[-1]: values for location, values in zipped.items() if isinstance(values, list) and values
    }
    first = next(iter(lists), "")
    for key, values in lists.items():
        if len(values) != len(lists[first]):
            message = f"got {len(values)} values, but {first} has {len(lists[first])}; give the same number"
            yield Mistake(("sweep", "zip", key), message)
    number = sweep.get("sobol", {}).get("samples", 1)
    if number & (number - 1):
        below = 1 << (number.bit_length() - 1)
        allowed = f"must be a power of two, such as {below} or {2 * below}"
        message = f"got {number}; {allowed} (other numbers cover the ranges unevenly)"
        yield Mistake(("sweep", "sobol", "samples"), message)


def _values(axis: Axis) -> Iterator[Mistake]:
    """Yield empty values and values given twice."""
    seen: dict[object, int] = {}
    for i, row in enumerate(axis.rows):
        nothing = [key for key, value in row.items() if value is None]
        for key in nothing:
            yield Mistake(axis.place(key, i), "got nothing (null); must have a value")
        before = seen.setdefault(_hashable(list(row.values())), i)
        if before != i and not nothing and not axis.sampled:
            key, value = next(iter(row.items()))
            if axis.location == ("sweep",):
                yield Mistake(axis.place(key, i), f"got {shown(value)} twice; give each value once")
            else:
                message = f"the same combination as at [{before}]; give each combination once"
                yield Mistake(axis.place(key, i), message, (".".join(map(str, axis.location)),))


def _hashable(value: object) -> object:
    if isinstance(value, Mapping):
        return tuple((key, _hashable(entry)) for key, entry in sorted(value.items()))
    return tuple(map(_hashable, value)) if isinstance(value, list | tuple) else value


def _under(problem: Mistake, key: str) -> bool:
    """Whether a problem depends on the value of a swept key."""
    return any(f"{name}.".startswith(f"{key}.") for name in (problem.key, *problem.others))


def rests_on(problem: Mistake, refused: Iterable[str]) -> bool:
    """Whether a problem depends on one of the refused keys, by their own names or those of the sweep."""
    in_a_list = any(part.isdigit() for part in problem.key.split("."))  # and known only with the list
    own = problem.key if problem.at_key and not in_a_list else unswept(problem.key)
    names = [f"{name}." for name in (own, problem.key, *problem.others)]
    keys = {f"{key}." for name in refused for key in (name, unswept(name))}
    below = f"{unswept(problem.key)}."  # a swept key of a section that is refused
    return any(name.startswith(key) or key.startswith(name) for name in names for key in keys) or any(
        below.startswith(key) for key in keys
    )


def _of_cases(left: Mapping[Axis, Sequence[int]], validate: Validate) -> list[Mistake]:
    """Return the problems of the cases: those that differ from the first in one value, then all of them.

    Each problem is at the swept value that causes it. Of samples only the first problem is returned.
    """
    factors, places = list(left), list(left.values())

    @cache
    def problems_of(at: tuple[int, ...]) -> list[Mistake]:
        rows = [axis.rows[i] for axis, i in zip(factors, at, strict=True)]
        return validate({key: value for row in rows for key, value in row.items()})

    first = tuple(indices[0] for indices in places)
    known = problems_of(first)
    mistakes = [_at_value(problem, factors, first, 0) for problem in known]
    for n, indices in enumerate(places):
        for i in indices[1 :: -(-len(indices) // MAX_CHECKED_VALUES)]:
            at = (*first[:n], i, *first[n + 1 :])
            mistakes += [_at_value(p, factors, at, n) for p in problems_of(at) if p not in known]
    if not mistakes and math.prod(map(len, places)) <= MAX_CHECKED_PRODUCT:
        every = itertools.product(*places)
        mistakes = [_at_value(problem, factors, at, 0) for at in every for problem in problems_of(at)]
    drawn = {axis.location for axis in factors if axis.sampled}
    once = {p.location if p.location[:-1] in drawn else p: p for p in reversed(mistakes)}
    return list(reversed(once.values()))


def _at_value(problem: Mistake, factors: Sequence[Axis], at: Sequence[int], varied: int) -> Mistake:
    """Return a case's problem at the swept value on which it depends first, or else at the varied one."""
    names = (problem.key, *problem.others)
    swept = [(n, key) for n, axis in enumerate(factors) for key in axis.rows[0]]
    touched = ((n, key) for name in names for n, key in swept if f"{name}.".startswith(f"{key}."))
    n, key = next(touched, (varied, next(iter(factors[varied].rows[0]))))
    value = shown(factors[n].rows[at[n]][key])
    message = problem.message if key == problem.key else f"with {value}, {problem}"
    return Mistake(factors[n].place(key, at[n]), message, names)
