"""What cases share: results of a function for its last arguments, or for an object as long as it lives.

The cases of a sweep, and calls in a loop, differ in few values. What depends on other values only is made
once, by a function of these values; its callers do not know. Several threads may call it. They share the
results, so that these never change: arrays are handed out read-only.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from threading import Lock
from typing import Any, ParamSpec, TypeVar
from weakref import ref

BYTES = 1 << 22  # of a result that is kept; a field of 256 x 256 points takes an eighth of it

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Known = TypeVar("Known")


def made_once(
    size: Callable[[Any], float], count: int = 4
) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Keep the last `count` results of a function of hashable values, of at most `BYTES` each by `size`."""

    def decorated(make: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        kept: OrderedDict[Hashable, Result] = OrderedDict()
        lock = Lock()

        @wraps(make)
        def of(*values: Arguments.args, **named: Arguments.kwargs) -> Result:
            key = values, *named.items()
            with lock:
                if key in kept:
                    kept.move_to_end(key)
                    return kept[key]
            result = make(*values, **named)
            if size(result) <= BYTES:
                with lock:
                    kept[key] = result
                    while len(kept) > count:
                        kept.popitem(last=False)
            return result

        return of

    return decorated


def kept_with(make: Callable[[Known], Result]) -> Callable[[Known], Result]:
    """Keep the result of a function of an object that never changes, known by identity, while it lives.

    The result must not refer to the object.
    """
    kept: dict[int, tuple[ref[Known], Result]] = {}

    @wraps(make)
    def of(known: Known) -> Result:
        place = id(known)
        if (found := kept.get(place)) is not None and found[0]() is known:
            return found[1]
        result = make(known)
        kept[place] = ref(known, lambda _: kept.pop(place, None)), result
        return result

    return of
