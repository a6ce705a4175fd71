"""How the contact set changes: towards the edges of the contact on a line, point by point on a surface."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from gfmdlayer.contact.active_set.edges import motion, update
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.contact.active_set.state import ContactSet, list_near, list_runs, make_bank, make_contact
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms

Floats = NDArray[np.float64]
N = 1024


def listed(member: Floats, shape: tuple[int, ...] | None = None) -> ContactSet:
    contact = make_contact(shape or member.shape)
    contact.member[:] = np.ravel(member)
    list_runs(contact)
    list_near(contact)
    return contact


@pytest.fixture(scope="module")
def halfspace() -> tuple[Floats, Floats, Floats]:
    """Compliance, gap without pressure, and the contact, found by one method for all that follows."""
    grid = Grid((N,), (1.0,))
    h = 2 * grid.coordinates[0] ** 2 - 0.02
    kappa = grid.wavenumbers.copy()
    problem = Problem(kappa, np.zeros(kappa.size, complex), h)
    found = ActiveSet(Transforms((N,)), 1e-12).solve(problem, np.zeros(N))
    assert found.converged
    columns = np.fft.irfft(np.divide(1.0, kappa, out=np.zeros_like(kappa), where=kappa > 0), N)
    distance = np.arange(N)
    return columns[np.abs(distance[:, None] - distance)], h, (found.pressure > 0).astype(float)


def solved_on(member: Floats, compliance: Floats, gap0: Floats) -> tuple[Floats, Floats]:
    """Pressure that closes the gaps of a set, whatever its sign, and the gaps elsewhere."""
    inside = np.flatnonzero(member)
    p = np.zeros(N)
    p[inside] = np.linalg.solve(compliance[np.ix_(inside, inside)], -gap0[inside])
    gap = gap0 + compliance @ p
    gap[inside] = 0.0
    return p, gap


@pytest.mark.parametrize("off", [-40, -16, -7, -3, 3, 7, 16, 40, 100])
def test_edges_are_gone_to_as_by_newtons_method(off: int, halfspace) -> None:  # type: ignore[no-untyped-def]
    # The distance that is left is of second order in `off`, beside what rounding to points leaves. Signs
    # alone leave half of it, a quarter where the set is off by more than the contact.
    compliance, gap0, true = halfspace
    first, last = np.flatnonzero(true)[[0, -1]]
    member = np.zeros(N)
    member[first - off : last + off + 1] = 1.0
    p, gap = solved_on(member, compliance, gap0)
    contact, by_signs = listed(member), np.count_nonzero((p > 0) | (gap < 0))
    assert update(p, gap, contact, make_bank(N), 0.0, True, True, 0) == (off > 0)
    assert contact.counts[0] == 1
    left = np.array([first - contact.runs[0, 0], contact.runs[0, 1] - 1 - last])
    assert left[0] == left[1]
    # Of second order, and half of what signs leave at the worst, beside a point.
    half_width = (last - first) / 2
    assert abs(left[0]) <= min(off**2 / half_width + 2, 0.25 * abs(off) + 1)
    if abs(off) > 3:
        assert abs(by_signs - true.sum()) / 2 > 0.25 * abs(off) + (abs(off) > 7)


def test_what_pulls_amid_the_contact_leaves_by_itself() -> None:
    member, p, gap = np.zeros(N), np.zeros(N), np.ones(N)
    member[400:500] = p[400:500] = 1.0
    gap[400:500] = 0.0
    p[450:453] = -1.0
    contact = listed(member)
    assert update(p, gap, contact, make_bank(N), 0.0, True, True, 0)
    assert contact.counts[0] == 2
    assert contact.runs[:2].tolist() == [[400, 450], [453, 500]]


@pytest.mark.parametrize(
    ("pressure", "expected"),
    [
        ([-1, -1, -1, 1, 1, 1, -1, -1, -1, -1], [[404, 405]]),
        ([-1, -1, 9, -1, -1, -1, -1, 9, -1, -1], [[402, 403], [407, 408]]),
        ([-1] * 10, []),
    ],
)
def test_what_presses_between_two_edges_does_not_leave_altogether(
    pressure: list[int], expected: list[list[int]]
) -> None:
    member, p, gap = np.zeros(N), np.zeros(N), np.ones(N)
    member[400:410], gap[400:410], p[400:410] = 1.0, 0.0, pressure
    contact = listed(member)
    update(p, gap, contact, make_bank(N), 0.0, True, True, 0)
    assert contact.runs[: contact.counts[0]].tolist() == expected


@pytest.mark.parametrize(("settled", "done", "stays"), [(True, 0, 91), (False, 0, 95), (True, 100, 95)])
def test_signs_alone_count_where_the_pressure_is_not_known_or_after_many_changes(
    settled: bool, done: int, stays: int
) -> None:
    member, p, gap = np.zeros(N), np.zeros(N), np.ones(N)
    member[400:500], gap[400:500], p[400:500] = 1.0, 0.0, 1.0
    p[400:405] = -1.0
    contact = listed(member)
    update(p, gap, contact, make_bank(N), 0.0, True, settled, done)
    assert contact.counts[2] == stays


def test_edges_that_are_not_by_themselves_need_no_safeguard(monkeypatch: pytest.MonkeyPatch) -> None:
    # Up to four asperities, cut off by a plateau, from any start. Steps to their edges that were not bounded
    # undid each other for ever in one of two hundred.
    monkeypatch.setattr(ActiveSet, "_save", None)
    transforms = {n: Transforms((n,)) for n in (64, 128, 256, 512)}
    for seed in range(400):
        rng = np.random.default_rng(seed)
        n = int(rng.choice(list(transforms)))
        grid = Grid((n,), (1.0,))
        x, count = grid.coordinates[0], rng.integers(1, 5)
        centre, height = rng.uniform(-0.4, 0.4, count), rng.uniform(0, 0.01, count)
        bends = 10 ** rng.uniform(0, 4, count)
        h = np.min(bends[:, None] * (x - centre[:, None]) ** 2 + height[:, None], axis=0)
        h = np.minimum(h, h.min() + 10 ** rng.uniform(-2, 0)) - h.min()
        loads = rng.random() < 0.5
        h -= 0.0 if loads else 10 ** rng.uniform(-4, -1)
        start = (np.abs(x - rng.uniform(-0.2, 0.2)) < rng.uniform(0.05, 0.5)).astype(float)
        load = 10 ** rng.uniform(-4, -1) if loads else None
        if load is None and h.mean() <= 0:
            continue  # more than the cell holds
        problem = Problem(grid.wavenumbers.copy(), np.zeros(n // 2 + 1, complex), h, load)
        assert ActiveSet(transforms[n], 1e-8).solve(problem, start).converged, seed


@pytest.mark.parametrize(
    ("overlapping", "everywhere", "expected"),
    [
        (slice(500, 509), True, [[400, 506]]),  # two thirds of nine
        (slice(500, 501), True, [[400, 501]]),
        (slice(500, 600), True, [[400, 700]]),  # up to the next stretch: all of it
        (slice(500, 516), False, [[400, 516], [600, 700]]),  # as far as the gap is known: all of it
        (slice(550, 559), True, [[400, 500], [550, 559], [600, 700]]),  # by itself: all of it
    ],
)
def test_two_thirds_of_what_overlaps_at_an_edge_join(
    overlapping: slice, everywhere: bool, expected: list[list[int]]
) -> None:
    member, gap = np.zeros(N), np.ones(N)
    member[400:500] = member[600:700] = 1.0
    gap[member > 0] = 0.0
    gap[overlapping] = -1.0
    if len(expected) == 1 and expected[0][1] < 600:
        member[600:700] = 0.0
    contact = listed(member)
    assert not update(member.copy(), gap, contact, make_bank(N), 0.0, everywhere, True, 0)
    assert contact.runs[: contact.counts[0]].tolist() == expected


def test_on_a_surface_points_are_taken_by_their_sign() -> None:
    shape = (32, 32)
    member, p, gap = np.zeros(shape), np.zeros(shape), np.ones(shape)
    member[10:20, 10:20] = p[10:20, 10:20] = 1.0
    gap[10:20, 10:20] = 0.0
    p[10:20, 10:13], gap[10:20, 20:23] = -1.0, -1.0
    contact = listed(member, shape)
    assert update(np.ravel(p), np.ravel(gap), contact, make_bank(member.size), 0.0, True, True, 0)
    expected = np.zeros(shape)
    expected[10:20, 13:23] = 1.0
    np.testing.assert_array_equal(contact.member.reshape(shape), expected)
    assert motion(contact, np.ones(member.size)) == 0.0


def test_a_contact_that_begins_far_too_wide_takes_few_iterations() -> None:
    # A parabola pressed in at once begins with the overlap, twice as wide as the contact: by signs alone that
    # took ten changes of the set, of two iterations each.
    grid = Grid((1 << 14,), (1.0,))
    h = 2 * grid.coordinates[0] ** 2 - 0.005
    kappa = grid.wavenumbers.copy()
    found = ActiveSet(Transforms(grid.shape)).solve(
        Problem(kappa, np.zeros(kappa.size, complex), h), np.zeros(1 << 14)
    )
    assert found.converged
    assert found.iterations <= 17
