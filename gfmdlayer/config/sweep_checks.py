"""Checks of a sweep: its keys, its values, and the cases that they make."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from gfmdlayer.config.sweeps import LISTS, SAMPLED, UNSWEPT, Axis, Row, axes, count, keys_of
from gfmdlayer.validation.problems import Location, Problem, location_of_key, not_in_list, shown, unknown_key

MAX_CASES = 1_000_000
MAX_CHECKED_PRODUCT = 10_000  # beyond it, one value is varied at a time; 10 000 cases take about a second

MAX_CHECKED_VALUES = 5_000  # of a key; of more of them some, and the others when their cases are run

Validate = Callable[[Row], list[Problem]]


def conflicts(
    sweep: Mapping[str, Any], keys: Sequence[str], unswept: Sequence[Problem], validate: Validate
) -> Iterator[Problem]:
    """Yield the problems of a sweep.

    Parameters
    ----------
    sweep : mapping
        The sweep of a configuration.
    keys : sequence of str
        Dotted keys that can be swept.
    unswept : sequence of Problem
        Problems of the configuration with its own values of the swept keys.
    validate : callable
        Dotted key -> value, to the problems of the case made with these values.
    """
    wrong = list(_keys(sweep, keys)) or list(_lists(sweep))
    if not wrong and (size := count(sweep)) > MAX_CASES:
        wrong = [Problem(("sweep",), f"got a product of {size} cases; must be at most {MAX_CASES}")]
    if wrong:  # the loader sets these keys aside and asks for the rest
        yield from wrong
        return
    factors = axes(sweep)
    found = {problem.location: problem for axis in factors for problem in _values(axis)}
    yield from found.values()
    left = {
        axis: [i for i, row in enumerate(axis.rows) if not any(axis.place(key, i) in found for key in row)]
        for axis in factors
    }
    usable = {axis: places for axis, places in left.items() if places}
    if usable:
        everywhere = [
            p for p in unswept if not any(_rests_on(p, key) for axis in usable for key in axis.rows[0])
        ]
        yield from everywhere
        yield from _of_cases(usable, lambda case: [p for p in validate(case) if p not in everywhere])


def _keys(sweep: Mapping[str, Any], keys: Sequence[str]) -> Iterator[Problem]:
    """Yield unknown keys, keys swept twice, and lists of combinations beside each other."""
    lists = [name for name in LISTS if name in sweep]
    for name in lists[1:]:
        message = f"given beside {lists[0]}; must be one of {', '.join(LISTS)}"
        yield Problem(("sweep", name), message, at_key=True)
    for name in lists:
        if not keys_of(sweep[name]):
            values = "{from: ..., to: ...}" if name in SAMPLED else "a list of values"
            yield Problem(("sweep", name), f"got no keys; must hold dotted keys, each with {values}")
    seen: list[str] = []
    listed = [(("sweep", name, key), key) for name in lists for key in keys_of(sweep[name])]
    for location, key in [*listed, *((("sweep", key), key) for key in sweep if key not in LISTS)]:
        same = next((other for other in seen if f"{key}.".startswith(f"{other}.")), None) or next(
            (other for other in seen if other.startswith(f"{key}.")), None
        )
        values = _value(sweep, location)
        nested = values and isinstance(values, Mapping) and location[1] not in SAMPLED
        if nested and (key in keys or not _is_range(values)):
            yield Problem(location, _nested(key, values, keys), at_key=True)
        elif key not in keys:
            yield Problem(location, _not_swept(key, keys, location), at_key=True)
        elif same is not None:
            yield Problem(location, f"swept beside {same}; must be given once", at_key=True)
        else:
            seen.append(key)


def _value(sweep: Mapping[str, Any], location: Location) -> Any:
    for part in location[1:]:
        sweep = sweep[str(part)]
    return sweep


def _is_range(values: Mapping[str, Any]) -> bool:
    return not {"from", "to"}.isdisjoint(values)


def _nested(key: str, values: Mapping[str, Any], keys: Sequence[str]) -> str:
    """Return the message for a range, or for keys in a mapping, with the dotted keys that are meant."""
    if _is_range(values):
        return f"got a range; must be a list of values, or be under one of {', '.join(SAMPLED)}"
    names, inner = [], [(key, values)]
    for head, mapping in inner:
        for name, value in mapping.items():
            inner += [(f"{head}.{name}", value)] if isinstance(value, Mapping) else []
            names += [] if isinstance(value, Mapping) else [f"{head}.{name}"]
    meant = [name if name in keys else next(iter(get_close_matches(name, keys, n=1)), name) for name in names]
    hint = " and ".join(name for name in dict.fromkeys(meant) if name != key)
    return "got a mapping; must be a list under each dotted key" + (hint and f"; did you mean {hint}?")


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
    """Return why a part of a key names no entry of a list; nothing if all do."""
    parts = key.split(".")
    for depth in range(1, len(parts)):
        head = ".".join(parts[:depth])
        inside = (name.removeprefix(f"{head}.") for name in keys if name.startswith(f"{head}."))
        places = {name.partition(".")[0] for name in inside}
        wrong = not_in_list(location_of_key(parts[depth])[0], len(places), head)
        if places and wrong and all(place.isdigit() for place in places):
            return wrong
    return ""


def _lists(sweep: Mapping[str, Any]) -> Iterator[Problem]:
    """Yield values that are no list or no list of the right length, and impossible numbers of samples."""
    zipped = {("sweep", "zip", key): values for key, values in sweep.get("zip", {}).items()}
    for location, values in (zipped | {("sweep", k): v for k, v in sweep.items() if k not in LISTS}).items():
        if not isinstance(values, list | tuple):
            yield Problem(location, f"got {shown(values)}; must be a list")
        elif not values:
            yield Problem(location, "got an empty list; must be a list of at least one value")
    lists = {
        location[-1]: values for location, values in zipped.items() if isinstance(values, list) and values
    }
    first = next(iter(lists), "")
    for key, values in lists.items():
        if len(values) != len(lists[first]):
            message = f"got {len(values)} values beside {len(lists[first])} of {first}; must be as many"
            yield Problem(("sweep", "zip", key), message)
    number = sweep.get("sobol", {}).get("samples", 1)
    if number & (number - 1):
        below = 1 << (number.bit_length() - 1)
        message = (
            f"got {number}; must be a power of two, such as {below} or {2 * below} (others lose balance)"
        )
        yield Problem(("sweep", "sobol", "samples"), message)


def _values(axis: Axis) -> Iterator[Problem]:
    """Yield empty values and values given twice."""
    seen: dict[object, int] = {}
    for i, row in enumerate(axis.rows):
        nothing = [key for key, value in row.items() if value is None]
        for key in nothing:
            yield Problem(axis.place(key, i), "got nothing (null); must have a value")
        before = seen.setdefault(_hashable(list(row.values())), i)
        if before != i and not nothing and not axis.sampled:
            key, value = next(iter(row.items()))
            if axis.location == ("sweep",):
                yield Problem(
                    axis.place(key, i), f"got {shown(value)} a second time; must be different values"
                )
            else:
                message = f"the combination at [{before}] a second time; must be different ones"
                yield Problem(axis.place(key, i), message, (".".join(map(str, axis.location)),))


def _hashable(value: object) -> object:
    if isinstance(value, Mapping):
        return tuple((key, _hashable(entry)) for key, entry in sorted(value.items()))
    return tuple(map(_hashable, value)) if isinstance(value, list | tuple) else value


def _rests_on(problem: Problem, key: str) -> bool:
    """Whether a problem depends on a swept key."""
    return any(f"{name}.".startswith(f"{key}.") for name in (problem.key, *problem.others))


def _of_cases(left: Mapping[Axis, Sequence[int]], validate: Validate) -> list[Problem]:
    """Return the problems of the cases: those that differ from the first in one value, then all of them.

    Only the cases run, so a value of the configuration itself that no case has is not refused. Each problem
    is at the swept value that it comes from; of drawn values the first is returned.
    """
    factors, places = list(left), list(left.values())

    def problems_of(at: Sequence[int]) -> list[Problem]:
        rows = [axis.rows[i] for axis, i in zip(factors, at, strict=True)]
        return validate({key: value for row in rows for key, value in row.items()})

    first = tuple(indices[0] for indices in places)
    known = problems_of(first)
    found = [_at_value(problem, factors, first, 0) for problem in known]
    for n, indices in enumerate(places):
        for i in indices[1 :: -(-len(indices) // MAX_CHECKED_VALUES)]:
            at = (*first[:n], i, *first[n + 1 :])
            found += [_at_value(p, factors, at, n) for p in problems_of(at) if p not in known]
    if not found and math.prod(map(len, places)) <= MAX_CHECKED_PRODUCT:
        every = itertools.product(*places)
        found = [_at_value(problem, factors, at, 0) for at in every for problem in problems_of(at)]
    drawn = {axis.location for axis in factors if axis.sampled}
    once = {p.location if p.location[:-1] in drawn else p: p for p in reversed(found)}
    return list(reversed(once.values()))


def _at_value(problem: Problem, factors: Sequence[Axis], at: Sequence[int], varied: int) -> Problem:
    """Return a case's problem at the swept value on which it depends first, or else at the varied one."""
    names = (problem.key, *problem.others)
    swept = [(n, key) for n, axis in enumerate(factors) for key in axis.rows[0]]
    touched = ((n, key) for name in names for n, key in swept if f"{name}.".startswith(f"{key}."))
    n, key = next(touched, (varied, next(iter(factors[varied].rows[0]))))
    message = (
        problem.message if key == problem.key else f"with {shown(factors[n].rows[at[n]][key])}, {problem}"
    )
    return Problem(factors[n].place(key, at[n]), message, names)
