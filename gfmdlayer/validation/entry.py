"""What users call: wrong, missing and former names of arguments, and signatures that editors show."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from inspect import Parameter, signature
from typing import Any, ParamSpec, TypeVar

from gfmdlayer.errors import warn
from gfmdlayer.validation.problems import ConfigError, nearest

Arguments = ParamSpec("Arguments")
Returned = TypeVar("Returned")


def entry(
    **former: str,
) -> Callable[[Callable[Arguments, Returned]], Callable[Arguments, Returned]]:
    """Mark a function that users call; `former` names of arguments still work, with a FutureWarning.

    An argument that is unknown, missing or given twice is a ConfigError with the names that are allowed.
    """

    def marked(function: Callable[Arguments, Returned]) -> Callable[Arguments, Returned]:
        every = signature(function).parameters
        known = [each for name, each in every.items() if name != "self"]
        names = [each.name for each in known if each.kind is not Parameter.VAR_KEYWORD]
        ordered = [each.name for each in known if each.kind is Parameter.POSITIONAL_OR_KEYWORD]
        required = [each.name for each in known if each.default is Parameter.empty and each.name in names]
        takes_any = len(names) < len(known)
        title, bound = function.__qualname__.removesuffix(".__init__"), len(every) - len(known)

        @wraps(function)
        def called(*values: Arguments.args, **keys: Arguments.kwargs) -> Returned:
            if former and not former.keys().isdisjoint(keys):
                keys = renamed(keys, former, title)  # type: ignore[assignment]
            count = len(values) - bound
            placed = ordered[:count]
            wrong = list(_by_name(keys, [] if takes_any else names, placed, title))
            if count > len(ordered):
                places = f"takes {', '.join(ordered)} in this order, others by name"
                wrong.append(f"{title}: got {count} arguments without a name; {places}")
            wrong += [
                f"{name}: missing; {title} takes {', '.join(names)}"
                for name in required
                if name not in keys and name not in placed
            ]
            if wrong:
                raise ConfigError(wrong)
            return function(*values, **keys)

        called.former = dict(former)  # type: ignore[attr-defined]
        return called

    return marked


def _by_name(
    keys: Mapping[str, object], names: Iterable[str], placed: Iterable[str], title: str
) -> Iterable[str]:
    """Yield what is wrong with arguments that have names; without `names` all are allowed."""
    for name in keys:
        if name in placed:
            yield f"{name}: got two values, one by its place; {title} takes it once"
        elif names and name not in names:
            yield f"{name}: unknown argument; {title} takes {', '.join(names)}{nearest(name, names)}"


def renamed(keys: Mapping[str, Any], former: Mapping[str, str], title: str) -> dict[str, Any]:
    """Return arguments or keys by their names of today, with a FutureWarning for each former name."""
    made = dict(keys)
    for old in former.keys() & keys.keys():
        new = former[old]
        if new in keys:
            raise ConfigError([f"{old}: is the former name of {new}, which is given too; remove it"])
        warn(f"{title}: {old} is called {new} now; the former name works for one more version", FutureWarning)
        made[new] = made.pop(old)
    return made
