"""History under tractions in all directions: creep, rolling, energy; partial slip on a layer that relaxes."""

import math

import numpy as np
import pytest

from gfmdlayer import Layer, LayerStack, Prony, Zener
from gfmdlayer.body.relaxation import VectorSpectrum
from gfmdlayer.friction.problem import FrictionProblem
from gfmdlayer.friction.response import Operator, SharedTransforms, Spent
from gfmdlayer.friction.solver import FrictionSolver
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.history.modes import SCHEMES, Modes
from gfmdlayer.history.traction_modes import TractionModes, VectorModes
from gfmdlayer.interface.friction import ShearBound
from tests.friction.cases import halfspace

SOLID = Zener(G0=1.0, Ginf=10.0, tau=1.0)
HALFSPACE = LayerStack((Layer(math.inf, 0.3, SOLID),))
STACK = LayerStack((Layer(0.05, 0.5, SOLID), Layer(0.1, 0.2, Prony(2.0, [(5.0, 0.3)]))), rigid=True)
GRIDS = {"line": Grid((16,), (1.0,)), "surface": Grid((8, 6), (1.0, 0.7)), "odd": Grid((7, 9), (1.0, 1.0))}


def transformed(fields, grid):
    return np.array([np.fft.rfftn(field.reshape(grid.points)).ravel() for field in fields])


def fields_of(spectra, grid):
    shape, axes = grid.spectral_shape, range(len(grid.points))
    found = [np.fft.irfftn(each.reshape(shape), s=grid.points, axes=axes) for each in spectra]
    return np.array(found).reshape(len(spectra), -1)


def random_tractions(grid):
    return np.random.default_rng(1).standard_normal((1 + len(grid.points), grid.size))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_modes_of_one_component_are_the_normal_ones(scheme):
    q, random = np.array([0.5, 3.0, 40.0]), np.random.default_rng(0)
    spectrum = STACK.spectrum(q)
    one, other = Modes(spectrum, SCHEMES[scheme]), VectorModes(VectorSpectrum.of(spectrum), SCHEMES[scheme])
    for step in (0.0, 0.1, 0.1, 2.0):
        kappa, b = one.terms(step)
        found, found_b = other.terms(step)
        np.testing.assert_allclose(found[:, 0, 0], kappa, rtol=1e-13)
        np.testing.assert_allclose(found_b[:, 0], b, rtol=1e-12, atol=1e-12 * np.abs(kappa).max())
        u, c = random.standard_normal((2, 3)) + 1j * random.standard_normal((2, 3))
        stress = other.curvature_stress(c[:, np.newaxis])[:, 0]
        np.testing.assert_allclose(stress, one.curvature_stress(c), rtol=1e-12)
        one.advance(u, c)
        other.advance(u[:, np.newaxis], c[:, np.newaxis])
        assert other.stored == pytest.approx(one.stored, rel=1e-12)
        assert other.dissipated == pytest.approx(one.dissipated, rel=1e-12)
    assert other.shortest_time == one.shortest_time


def crept(body, grid, steps, *, end=1.0):
    """Put tractions on the surface at t = 0, and hold them."""
    history = TractionModes(grid, body.traction_spectrum(grid.wavenumbers))
    tractions = transformed(random_tractions(grid), grid)
    for step in (0.0, *([end / steps] * steps)):
        history.terms(step)
        history.advance(history.under(tractions))
    return history


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_creep_of_a_halfspace_under_tractions_in_all_directions(grid):
    """All compliances of a homogeneous halfspace are proportional to the creep of its material."""
    # The solver's own operator has the elastic response. The scheme is of second order; the error that is
    # left after extrapolation is of the fourth: (dt/theta)^4 < 1e-6 with the smallest time, tau = 1.
    work = SharedTransforms(Transforms(grid.points), Spent(), 1.0)
    elastic = Operator(grid, halfspace(grid, 1.0, 0.3), work)
    creep = 1 / SOLID.G0 - (1 / SOLID.G0 - 1 / SOLID.Ginf) * math.exp(-SOLID.G0 / (SOLID.tau * SOLID.Ginf))
    expected = creep * elastic(random_tractions(grid))
    found = [fields_of(crept(HALFSPACE, grid, steps).displacement, grid) for steps in (20, 40)]
    off = [np.abs(each - expected).max() / np.abs(expected).max() for each in found]
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.02)
    np.testing.assert_allclose((4 * found[1] - found[0]) / 3, expected, rtol=0, atol=1e-6 * expected.max())


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_work_is_stored_or_turns_into_heat(grid):
    """A sudden load does half of traction times displacement as work, a held one all of it."""
    history = TractionModes(grid, STACK.traction_spectrum(grid.wavenumbers))
    tractions = random_tractions(grid)
    work, last = 0.0, np.zeros_like(tractions)
    for step in (0.0, *([0.05] * 20)):
        history.terms(step)
        history.advance(history.under(transformed(tractions, grid)))
        now = fields_of(history.displacement, grid)
        work += (0.5 if step == 0 else 1.0) * float((tractions * (now - last)).sum(axis=0).mean())
        last = now
    exact = history.stored + history.dissipated
    assert history.dissipated > 0.05 * work
    # Within a step the traction is not quite the held one: its error is of order (dt/tau)^2 of the change.
    assert work == pytest.approx(exact, rel=0.05**2)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_moving_load_meets_the_complex_stiffness(axis):
    """Tractions at rest on a material that moves by V dt a step: each wave sees s = -i q.V, for dt -> 0."""
    # Under held tractions this body creeps no longer than 3 tau = 0.9: the start is forgotten to exp(-24).
    solid = Zener(G0=1.0, Ginf=3.0, tau=0.3)
    body = LayerStack((Layer(0.05, 0.5, solid), Layer(0.1, 0.2, Prony(2.0, [(5.0, 0.1)]))), rigid=True)
    grid, speed = Grid((8, 8), (1.0, 1.0)), 0.4
    velocity = [0.0, 0.0]
    velocity[axis] = speed
    number = [1, 2]
    wave = number[0] * grid.spectral_shape[1] + number[1]
    tractions = transformed(random_tractions(grid), grid)
    spectrum = body.traction_spectrum(grid.wavenumbers)
    s = -1j * 2 * np.pi * number[axis] * speed
    K = spectrum.in_plane.stiffness(s)[number[0], number[1]]
    n = np.array(number) / np.hypot(*number)
    p, tx, ty = tractions[:, wave]
    W, U = np.linalg.solve(K, [p, -1j * (n[0] * tx + n[1] * ty)])
    V = (n[0] * ty - n[1] * tx) / spectrum.across.stiffness(s)[number[0], number[1]]
    expected = np.array([W, 1j * n[0] * U - n[1] * V, 1j * n[1] * U + n[0] * V])
    off = []
    for dt in (0.04, 0.02):
        history = TractionModes(grid, spectrum)
        for _ in range(round(22 / dt)):
            history.carry(*(v * dt for v in velocity))
            history.terms(dt)
            history.advance(history.under(tractions))
        off.append(np.abs(history.displacement[:, wave] - expected).max() / np.abs(expected).max())
    assert off[0] < (np.abs(s) * 0.04) ** 2
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.05)  # of second order


def test_a_carried_surface_is_the_surface_elsewhere():
    grid = GRIDS["surface"]
    history = crept(STACK, grid, 3)
    before = fields_of(history.displacement, grid).reshape(3, *grid.points)
    history.carry(2 * grid.period[0] / grid.points[0], -grid.period[1] / grid.points[1])
    after = fields_of(history.displacement, grid).reshape(3, *grid.points)
    expected = np.roll(before, (-2, 1), axis=(1, 2))
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-14 * np.abs(before).max())


def test_a_restored_history_continues_bit_for_bit():
    grid = GRIDS["surface"]
    one = crept(STACK, grid, 3)
    other = TractionModes(grid, STACK.traction_spectrum(grid.wavenumbers))
    other.restore({name: np.copy(value) for name, value in one.state().items()})
    tractions = transformed(random_tractions(grid), grid)
    for history in (one, other):
        history.terms(0.3)
        history.advance(history.under(2 * tractions))
    np.testing.assert_array_equal(one.displacement, other.displacement)
    assert (one.stored, one.dissipated) == (other.stored, other.dissipated)


def displaced(t):
    return float(np.interp(t, [0, 2, 4, 8], [0, 0, 0.004, -0.004]))


def test_partial_slip_on_a_relaxing_layer():
    """A punch is pressed on a layer on a halfspace, and moved to and fro: a dense solution of 1024 points."""
    # Here 30 points are in contact. The width of the stick zone, and with it force and heat, is known to half
    # of one; the depth to second order. The work of the punch is stored, relaxed, or slipped, to (dt/tau)^2.
    grid, dt, mu = Grid((256,), (1.0,)), 0.05, 0.4
    body = LayerStack((Layer(0.05, 0.5, SOLID), Layer(math.inf, 0.3, Prony(1.0))))
    history = TractionModes(grid, body.traction_spectrum(grid.wavenumbers))
    transforms = Transforms(grid.points)
    solver, heights = FrictionSolver(grid, transforms), grid.coordinates[0] ** 2 / (2 * 0.25)
    start, heat, work, found = None, 0.0, 0.0, {}
    last = np.zeros(3)  # pressure, shear traction, depth
    for i in range(1, round(8 / dt) + 1):
        t, before = i * dt, fields_of(history.displacement, grid)
        response, offset = history.terms(dt)
        load = 0.02 * min(t, 1.0)
        problem = FrictionProblem(
            response, heights, ShearBound(mu), load=load, path=np.array([displaced(t) - displaced(t - dt)]),
            offset=fields_of(offset, grid), before=before[1:],
        )  # fmt: skip
        solution = solver.solve(problem, start)
        assert solution.converged, f"t = {t}: {solution.reason}"
        start = solution.tractions
        heat -= float((solution.traction * solution.slip).sum(axis=0).mean())
        history.advance(history.under(transformed(solution.tractions, grid)))
        now = np.array([load, solution.traction.mean(), solution.depth])
        mean = 0.5 * (last + now)
        work += mean[0] * (now[2] - last[2]) + mean[1] * (displaced(t) - displaced(t - dt))
        last = now
        found[round(t, 6)] = (solution.traction.mean() / (mu * load), solution.depth, heat)
    assert work == pytest.approx(history.stored + history.dissipated + heat, rel=dt**2)
    force, depth, heat_of_slip = zip(*(found[t] for t in (1, 2, 2.1, 4.2, 5, 8)), strict=True)
    np.testing.assert_allclose(force, [0, 0, 0.3577, 0.1278, -1, -1], atol=0.5 / 30)
    np.testing.assert_allclose(force[:2], 0.0, atol=1e-6)  # tolerance of the solver: 1e-7, over mu
    known = np.delete(depth, 4)
    np.testing.assert_allclose(known, [0.006499, 0.00721, 0.007265, 0.007981, 0.008433], rtol=1 / 30**2)
    assert heat_of_slip[1] < 1e-9
    assert heat_of_slip[3] == pytest.approx(2.242e-5, rel=0.5 / 30)
