"""Which clusters wind around a periodic cell, and the gap of the narrowest place."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from gfmdlayer.arrays import BoolArray
from gfmdlayer.transport.percolation import clusters, throats


def found_by_search(is_open: BoolArray) -> set[tuple[frozenset[tuple[int, int]], bool, bool]]:
    """Return the clusters of open points, and whether each winds along x and y, by breadth-first searches."""
    nx, ny = is_open.shape
    waiting, found = {(int(x), int(y)) for x, y in np.argwhere(is_open)}, set()
    while waiting:
        start = waiting.pop()
        cells, queue = {start: (0, 0)}, deque([start])
        winds = [False, False]
        while queue:
            x, y = queue.popleft()
            for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                (cx, px), (cy, py) = divmod(x + dx, nx), divmod(y + dy, ny)
                if not is_open[px, py]:
                    continue
                cell = cells[x, y][0] + cx, cells[x, y][1] + cy
                if (px, py) not in cells:
                    cells[px, py] = cell
                    queue.append((px, py))
                else:
                    winds = [w or a != b for w, a, b in zip(winds, cell, cells[px, py], strict=True)]
        waiting -= cells.keys()
        found.add((frozenset(cells), *winds))
    return found


def test_clusters_and_windings_are_those_of_a_breadth_first_search() -> None:
    rng = np.random.default_rng(1)
    spiral = 0
    for _ in range(2000):
        shape = tuple(rng.integers(3, 12, 2))
        is_open = rng.random(shape) < rng.uniform(0.4, 0.8)
        labels, winds = clusters(is_open)
        found = set()
        for label in np.unique(labels[labels >= 0]):
            points = labels == label
            along = [bool(each[points].all()) for each in winds]
            assert along == [bool(each[points].any()) for each in winds]
            found.add((frozenset((int(x), int(y)) for x, y in np.argwhere(points)), *along))
        assert found == found_by_search(is_open)
        assert not winds[:, ~is_open].any()
        spiral += any(x != y for _, x, y in found)
    assert spiral > 100  # the masks are near the threshold


def test_a_path_that_touches_both_sides_but_does_not_close_leads_nowhere() -> None:
    is_open = np.zeros((8, 8), dtype=bool)
    is_open[:, 2] = True
    assert clusters(is_open).winds[0, :, 2].all()
    is_open[4:, 2], is_open[4:, 4] = False, True
    is_open[4, 2:5] = True  # both sides of the cell are touched, at 2 and at 4
    assert not clusters(is_open).winds.any()


def test_contact_closes_diagonally() -> None:
    wall = np.add.outer(np.arange(8), np.arange(8)) % 8 == 0
    # The diagonal wall leaves a band that winds along the diagonal only: along x and y together.
    assert clusters(~wall).winds[:, ~wall].all()
    wall[:, 3] = True
    assert not clusters(~wall).winds.any()


@pytest.mark.parametrize("across", [6, 13])
def test_the_critical_gap_is_that_of_the_saddle_and_the_width_that_of_the_channel(across: int) -> None:
    """Along x, cos(2 pi y) - cos(2 pi x)/2 + c is narrowest at x = 0, where its gap is c + 1/2 at y = 0."""
    n, level = 128, 0.5 - math.cos(math.pi * across / 128)
    x = np.arange(n) / n
    gap = np.maximum(level + np.cos(2 * np.pi * x) - 0.5 * np.cos(2 * np.pi * x)[:, None], 0.0)
    along, closed = throats(gap, (1 / n, 1 / n))
    assert along.gap == pytest.approx(level + 0.5, abs=1e-12)
    assert along.place == (0, 0)
    assert abs(along.points - across) <= 1  # an edge lies between two points
    assert along.width == pytest.approx(along.points / n)
    assert closed == (0.0, (0, 0), 0.0, 0.0)


def test_critical_gaps_are_the_largest_levels_at_which_a_path_leads_through() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        gap = np.maximum(rng.normal(0.3, 1.0, (13, 17)), 0.0)
        for axis, throat in enumerate(throats(gap, (1.0, 1.0))):
            levels = np.unique(gap[gap > 0])
            leads = [bool(clusters(gap >= level).winds[axis].any()) for level in levels]
            assert throat.gap == (levels[leads].max() if any(leads) else 0.0)
