"""The flow tensor of a gap: closed forms, symmetries, conservation of mass, published percolation."""

import math
from collections import deque

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.transport.leakage import bruggeman, flow_through
from gfmdlayer.transport.percolation import clusters, throats

CELL = (1.0, 1.0)


def rough_gap(n, pressure, seed=1):
    """Return the gap of a self-affine punch on a halfspace of E* = 4, and the contact area."""
    punch = gfmdlayer.SelfAffine(hurst=0.8, roll_off=1 / 4, short_cutoff=1 / 32, rms_slope=0.1, seed=seed)
    found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), punch, mean_pressure=pressure, points=(n, n))
    return found.gap.to_numpy(), float(found.contact_area)


def wave(n, e=0.7):
    """Ridges 1 + e cos 2 pi x."""
    return np.repeat(1 + e * np.cos(2 * np.pi * np.arange(n) / n)[:, None], n, axis=1)


@pytest.mark.parametrize("mean", ["harmonic", "linear"])
def test_between_plates_the_flow_is_the_cube_of_their_distance(mean):
    found = flow_through(np.full((32, 48), 0.3), (2.0, 1.0), mean)
    np.testing.assert_allclose(found.tensor, 0.027 * np.eye(2), rtol=1e-13, atol=1e-16)


def test_across_ridges_and_along_them_the_flow_has_closed_forms():
    """(1 - e^2)^(5/2)/(1 + e^2/2) and 1 + 3 e^2/2; the trapezoidal rule of g^-3 converges geometrically."""
    e, exact = 0.7, ((1 - 0.49) ** 2.5 / (1 + 0.245), 1 + 1.5 * 0.49)
    found = flow_through(wave(64, e), CELL)
    np.testing.assert_allclose(found.tensor.diagonal(), exact, rtol=1e-12)
    np.testing.assert_allclose(flow_through(wave(64, e)[:, 0], (1.0,)).tensor, np.diag(exact), rtol=1e-12)
    # The linear mean is of second order: at 128 points a quarter of the error at 64.
    off = [flow_through(wave(n, e), CELL, "linear").tensor[0, 0] / exact[0] - 1 for n in (64, 128)]
    assert 0 < off[1] < 2e-3
    assert off[0] / off[1] == pytest.approx(4, rel=0.05)


def test_a_line_with_contact_is_closed_across_and_open_along():
    gap = np.maximum(np.cos(4 * np.pi * np.arange(64) / 64), 0) ** 1.5
    np.testing.assert_allclose(flow_through(gap, (1.0,)).tensor, np.diag([0.0, (gap**3).mean()]))
    channels = flow_through(np.repeat(gap[:, None], 64, axis=1), CELL)
    assert channels.tensor[0, 0] == channels.tensor[0, 1] == 0.0
    assert channels.tensor[1, 1] == pytest.approx((gap**3).mean(), rel=1e-12)


def test_a_checkerboard_conducts_the_geometric_mean():
    """Keller's theorem; the singular corners leave a first-order error of 5.8 % with the harmonic mean."""
    x = np.arange(128) // 64
    found = flow_through(np.where((x[:, None] + x) % 2, 1.0, 0.4), CELL).tensor
    assert found[0, 0] == pytest.approx(0.4**1.5, rel=0.07)
    assert found[0, 0] == pytest.approx(found[1, 1], rel=1e-9)


def test_a_diagonal_channel_has_four_equal_components():
    x = np.arange(64) / 64
    found = flow_through(np.maximum(np.cos(2 * np.pi * (x[:, None] - x)), 0) ** 1.5, CELL).tensor
    np.testing.assert_allclose(found, found[0, 0] * np.ones((2, 2)), rtol=1e-11)
    assert found[0, 0] > 0


def test_mass_is_conserved_and_the_mean_of_the_flow_is_the_tensor():
    gap, _ = rough_gap(128, 0.04)
    found = flow_through(gap, CELL)
    assert (found.imbalance < 1e-9).all()  # rounding over conductances of nine decades
    np.testing.assert_allclose(found.flow.mean(axis=(2, 3)).T, found.tensor, rtol=1e-8)
    assert found.tensor[0, 1] == pytest.approx(found.tensor[1, 0], rel=1e-8)
    # Nothing flows into a point that does not flow out of it; nothing flows in contact.
    assert (found.flow[:, :, gap == 0] == 0).all()
    assert np.isnan(found.pressure[:, gap == 0]).all()
    # The pressure falls by 1 across the cell: along x from one end to the other, but for the last spacing.
    assert np.nanmax(found.pressure[0]) - np.nanmin(found.pressure[0]) > 1 - 2 / 128


def test_shifts_tiles_and_a_quarter_turn_leave_the_tensor():
    gap, _ = rough_gap(128, 0.03)
    K = flow_through(gap, CELL).tensor
    # The conductances span nine decades: 1e-15 of the largest is 1e-8 of the sums at most.
    np.testing.assert_allclose(flow_through(np.roll(gap, (13, 40), (0, 1)), CELL).tensor, K, rtol=1e-8)
    np.testing.assert_allclose(flow_through(np.tile(gap, (1, 2)), (1.0, 2.0)).tensor, K, rtol=1e-8)
    turned = flow_through(np.rot90(gap), CELL).tensor
    np.testing.assert_allclose(turned, [[K[1, 1], -K[0, 1]], [-K[0, 1], K[0, 0]]], rtol=1e-8)
    # In a cell twice as long the same gap has half of the drop per length along x.
    wide = flow_through(np.repeat(wave(64), 2, axis=1), (3.0, 2.0)).tensor
    np.testing.assert_allclose(wide, flow_through(wave(64), CELL).tensor, rtol=1e-12, atol=1e-16)


def test_closed_contact_does_not_leak_at_all():
    gap, _ = rough_gap(128, 0.15)
    assert (gap > 0).any()
    found = flow_through(gap, CELL)
    assert (found.tensor == 0).all()
    assert (found.imbalance == 0).all()
    assert bruggeman(gap) >= 0


# Fine-grid values, extrapolated from 1024 and 2048 points, and the errors of the harmonic mean in percent.
@pytest.mark.parametrize(
    ("pressure", "n", "K"),
    [
        (0.02, 256, 1.9635e-9),
        (0.04, 256, 1.8601e-10),
        pytest.param(0.02, 512, 1.9815e-9, marks=pytest.mark.slow),
        pytest.param(0.04, 512, 1.9012e-10, marks=pytest.mark.slow),
    ],
)
def test_the_rough_contact_leaks_as_recorded(pressure, n, K):
    gap, _ = rough_gap(n, pressure)
    found = flow_through(gap, CELL).tensor[0, 0]
    assert found == pytest.approx(K, rel=1e-3)
    fine = {0.02: 1.988e-9, 0.04: 1.9156e-10}[pressure]
    assert -0.03 < found / fine - 1 < 0  # coarse throats conduct too little with the harmonic mean
    linear = flow_through(gap, CELL, "linear").tensor[0, 0]
    assert found < fine < linear * 1.001


def test_the_harmonic_mean_is_the_most_accurate_at_a_coarse_throat():
    """(0.5 cos 2 pi y - 0.25 cos 2 pi x - 0.15)^1.5, 13 points in the throat; 1.9843e-5 by 1024 points."""
    x = (np.arange(64) + 0.3) / 64
    height = 0.15 - 0.3 + 0.5 * np.cos(2 * np.pi * x) - 0.25 * np.cos(2 * np.pi * x)[:, None]
    gap = np.maximum(height, 0) ** 1.5
    off = [abs(flow_through(gap, CELL, each).tensor[0, 0] / 1.9843e-5 - 1) for each in ("harmonic", "linear")]
    assert off[0] < 0.003 < off[1]


def test_critical_gap_and_bruggeman_estimate_the_flow():
    gap, area = rough_gap(128, 0.02)
    K = flow_through(gap, CELL).tensor
    for axis, throat in enumerate(throats(gap, (1 / 128, 1 / 128))):
        assert 0.35 < K[axis, axis] / throat.gap**3 < 1.7  # over eight decades at 512 points
    assert bruggeman(gap) == pytest.approx(
        math.sqrt(K[0, 0] * K[1, 1]), rel=0.25
    )  # 20 % up to an area of 0.16
    assert area < 0.16
    assert bruggeman(np.full((8, 8), 0.5)) == pytest.approx(0.125, rel=1e-9)
    assert bruggeman(np.where(np.arange(64).reshape(8, 8) < 28, 0.0, 1.0)) == 0.0  # 0.4375 closed


@pytest.mark.slow
def test_ten_rough_surfaces_close_at_the_published_area():
    """0.42: Dapp et al., Phys. Rev. Lett. 108 (2012) 244301; five seeds, along x and along y."""
    areas = []
    for seed in range(1, 6):
        for axis in (0, 1):
            low, high = 0.03, 0.16
            while high / low > 1.01:
                pressure = math.sqrt(low * high)
                gap, area = rough_gap(256, pressure, seed)
                is_open = throats(gap, (1.0, 1.0))[axis].gap > 0
                low, high = (pressure, high) if is_open else (low, pressure)
            areas.append(area)
    assert np.mean(areas) == pytest.approx(0.42, abs=0.03)
    assert 0.01 < np.std(areas) < 0.05


def test_multigrid_agrees_with_the_factors(monkeypatch):
    pytest.importorskip("pyamg")
    gap, _ = rough_gap(128, 0.04)
    K = flow_through(gap, CELL).tensor
    monkeypatch.setattr("gfmdlayer.transport.leakage.LARGEST_DIRECT", 0)
    np.testing.assert_allclose(flow_through(gap, CELL).tensor, K, rtol=1e-9)


# --- clusters that wind around the cell, and the narrowest place ---


def found_by_search(is_open):
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


def test_clusters_and_windings_are_those_of_a_breadth_first_search():
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


def test_a_path_that_touches_both_sides_but_does_not_close_leads_nowhere():
    is_open = np.zeros((8, 8), dtype=bool)
    is_open[:, 2] = True
    assert clusters(is_open).winds[0, :, 2].all()
    is_open[4:, 2], is_open[4:, 4] = False, True
    is_open[4, 2:5] = True  # both sides of the cell are touched, at 2 and at 4
    assert not clusters(is_open).winds.any()


def test_contact_closes_diagonally():
    wall = np.add.outer(np.arange(8), np.arange(8)) % 8 == 0
    # The diagonal wall leaves a band that winds along the diagonal only: along x and y together.
    assert clusters(~wall).winds[:, ~wall].all()
    wall[:, 3] = True
    assert not clusters(~wall).winds.any()


@pytest.mark.parametrize("across", [6, 13])
def test_the_critical_gap_is_that_of_the_saddle_and_the_width_that_of_the_channel(across):
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


def test_critical_gaps_are_the_largest_levels_at_which_a_path_leads_through():
    rng = np.random.default_rng(2)
    for _ in range(50):
        gap = np.maximum(rng.normal(0.3, 1.0, (13, 17)), 0.0)
        for axis, throat in enumerate(throats(gap, (1.0, 1.0))):
            levels = np.unique(gap[gap > 0])
            leads = [bool(clusters(gap >= level).winds[axis].any()) for level in levels]
            assert throat.gap == (levels[leads].max() if any(leads) else 0.0)
