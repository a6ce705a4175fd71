"""All errors of a configuration at once, also those that others hide.

A rejected value is removed and the rest is validated again, so that hidden errors are in the same report;
errors that depend on a removed value are left out.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from gfmdlayer.config.sweeps import unswept
from gfmdlayer.validation.problems import Location, Problem, dotted_key, without_last_places

# Young's moduli, and the shear moduli that a configuration takes instead.
_YOUNGS = {
    "E0": ("G0",),
    "Einf": ("Ginf",),
    "E": ("G", "shear_modulus"),
    "youngs_modulus": ("shear_modulus",),
}


def with_hidden(
    data: dict[str, Any], found: list[Problem], validate: Callable[[dict[str, Any]], list[Problem]]
) -> list[Problem]:
    """Return the problems `found` in plain data and the problems that they hide."""
    rest = copy.deepcopy(data)
    new = found
    aside: list[str] = []
    while new:
        removed = [_set_aside(rest, p.location[:-1] if p.chooses else p.location) for p in new]
        aside += removed + [unswept(key) for key in removed]
        new = [p for p in validate({"name": "unnamed"} | rest) if not any(_rests_on(p, key) for key in aside)]
        found = found + new
    return [_as_written(data, _in_shear_moduli(data, problem)) for problem in found]


def _set_aside(data: Any, location: Location) -> str:
    """Remove the value at a location, or the section that should hold it; return its dotted key."""
    path = without_last_places(location)
    holder = data
    for depth, part in enumerate(path):
        if isinstance(part, int) and isinstance(holder, list) and part < len(holder):
            holder = holder[part]
            continue
        if not isinstance(holder, dict) or part not in holder:
            return _set_aside(data, path[:depth]) if depth else str(part)
        if depth == len(path) - 1 or not isinstance(holder[part], dict | list):
            del holder[part]
            return dotted_key(path[: depth + 1])
        holder = holder[part]
    return ""


def _rests_on(problem: Problem, key: str) -> bool:
    in_a_list = any(part.isdigit() for part in problem.key.split("."))  # and known only with the list
    own = problem.key if problem.at_key and not in_a_list else unswept(problem.key)
    names = (own, problem.key, *problem.others)
    return any(f"{name}.".startswith(f"{key}.") or f"{key}.".startswith(f"{name}.") for name in names)


def _as_written(data: Any, problem: Problem) -> Problem:
    """Return the problem without the index that pydantic counts where the user wrote a single value."""
    *path, last = problem.location
    if isinstance(last, int) and not isinstance(_value(data, path), list):
        return replace(problem, location=tuple(path))
    return problem


def _value(data: Any, location: Iterable[str | int]) -> Any:
    """Return the value at a location of plain data; None where there is none."""
    for part in location:
        if isinstance(data, dict):
            data = data.get(part)
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
        else:
            return None
    return data


def _in_shear_moduli(data: Any, problem: Problem) -> Problem:
    """Answer a Young's modulus with the shear modulus, by the Poisson's ratio of its layer or halfspace."""
    names = _YOUNGS.get(str(problem.location[-1]))
    if names is None or not problem.at_key:
        return problem
    unknown, allowed = problem.message.split("; ")[:2]
    shear = next((name for name in names if re.search(rf"\b{name}\b", allowed)), None)
    hint = "moduli are shear moduli, G = E/(2 (1 + nu))"
    above = (_value(data, problem.location[:depth]) for depth in range(len(problem.location) - 1, 0, -1))
    poisson = next((held["poisson"] for held in above if isinstance(held, dict) and "poisson" in held), 0.5)
    modulus = _value(data, problem.location)
    known = all(isinstance(x, int | float) and not isinstance(x, bool) for x in (modulus, poisson))
    if known and poisson > -1 and shear is not None:
        hint += f"; did you mean {shear}: {modulus / (2 * (1 + poisson)):.6g}, for poisson {poisson:g}?"
    return replace(problem, message=f"{unknown}; {allowed}; {hint}")
