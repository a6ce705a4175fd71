"""Depths below the surface of layers, and the layers that they are in. Imports no numerics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

DEPTH_PAIRS = 7.0  # work of the fields at a depth, in FFT pairs; measured at 512 x 512 points
_SAME = 1e-12  # relative: a depth this close to an interface is on it


class Place(NamedTuple):
    """A depth, and the number of its layer from the surface; a depth at an interface has two places."""

    depth: float
    layer: int


def places(thicknesses: Sequence[float], depths: Sequence[float]) -> list[Place]:
    """Return the places at increasing depths in layers of these thicknesses, at most their sum."""
    faces, last = list(accumulate(thicknesses)), len(thicknesses) - 1
    found = []
    for depth in depths:
        at = next((i for i, face in enumerate(faces) if abs(face - depth) <= _SAME * depth), None)
        if at is None:
            found.append(Place(depth, next(i for i, face in enumerate(faces) if depth < face)))
        else:
            found += [Place(faces[at], number) for number in (at, at + 1) if number <= last]
    return found


def beyond(thicknesses: Sequence[float], depths: Sequence[float]) -> tuple[int, float] | None:
    """Return the number of the first depth below all layers, and their thickness; None without one."""
    whole = sum(thicknesses)
    return next(((i, whole) for i, depth in enumerate(depths) if depth > whole * (1 + _SAME)), None)


def between_faces(thicknesses: Sequence[float], number: int, reach: float) -> list[float]:
    """Return so many depths in each layer, from face to face; in a halfspace down to its top plus `reach`.

    The reach counts only without layers above the halfspace; else it is their thickness.
    """
    found, top = [0.0], 0.0
    for thickness in thicknesses:
        size = thickness if math.isfinite(thickness) else top or reach
        found += [top + size * i / (number - 1) for i in range(1, number)]
        top += size
    return found
