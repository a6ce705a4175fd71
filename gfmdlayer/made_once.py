"""What cases share: results of a function for its last arguments, kept while they are small.

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

BYTES = 1 << 22  # of a result that is kept; a field of 256 x 256 points takes an eighth of it

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


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
