"""Two bodies under shared tractions: the joined network, and two single bodies marched one by one."""

import math
from dataclasses import replace

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import Layer, LayerStack, Prony
from gfmdlayer.friction.problem import FrictionProblem
from gfmdlayer.friction.response import Response
from gfmdlayer.grid.grid import Grid
from gfmdlayer.history.modes import backward_euler
from gfmdlayer.history.traction_modes import TractionModes
from gfmdlayer.history.traction_pair import TractionPair
from gfmdlayer.interface.friction import ShearBound
from tests.friction.reference import solve_densely


def _random_stack(rng):
    """Up to two layers with one or two branches on a halfspace with as many."""
    layers = []
    for i in range(rng.integers(1, 4)):
        branches = [(10 ** rng.uniform(-1, 1), 10 ** rng.uniform(-2, 2)) for _ in range(rng.integers(1, 3))]
        thickness = math.inf if i == 0 else rng.uniform(0.05, 0.5)
        layers.insert(0, Layer(thickness, rng.uniform(0, 0.5), Prony(10 ** rng.uniform(-1, 1), branches)))
    return LayerStack(tuple(layers))


@pytest.mark.parametrize("seed", range(50))
def test_the_response_of_a_pair_is_that_of_the_joined_network(seed):
    """Both springs in one network, body 1 eliminated; at s = 1/dt, to which backward Euler is equal."""
    rng, grid = np.random.default_rng(seed), Grid((9,), (2.0,))
    step, q = 10 ** rng.uniform(-2, 2), grid.waves
    spectra = [_random_stack(rng).traction_spectrum(q) for _ in range(2)]
    pair = TractionPair(tuple(TractionModes(grid, each, backward_euler) for each in spectra), 1.0)
    response, _ = pair.terms(step)
    first, second = (each.in_plane.stiffness(np.full(q.shape, 1 / step))[1:] for each in spectra)
    mirrored = second * np.array([[1, -1], [-1, 1]])  # it acts on x - x_1
    eliminated = np.linalg.solve(first + mirrored, mirrored)
    joined = np.linalg.inv(mirrored - mirrored @ eliminated)
    found = np.array([[response.normal, response.coupling], [response.coupling, response.along]])[..., 1:]
    scale = np.abs(joined).max(axis=(1, 2))
    assert (np.abs(np.moveaxis(found, -1, 0) - joined).max(axis=(1, 2)) <= 2e-13 * scale).all()


# A layer (thickness, Poisson's ratio, G0, Ginf, tau) on a rigid base, and the one above it.
BODY, COUNTERBODY = (0.1, 0.4, 1.0, 4.0, 0.3), (0.06, 0.2, 2.0, 3.0, 0.1)
POINTS, STEP, STEPS, RADIUS = 33, 0.1, 6, 4.0  # a spacing a step


class _OneBody:
    """A layer of one Zener material on a rigid base: sigma = K (G0 u + (Ginf - G0) y) with K for G = 1."""

    def __init__(self, layer, grid, spacings):
        thickness, poisson, self.G0, self.Ginf, tau = layer
        plain = gfmdlayer.bonded_layer(thickness, 1.0, poisson=poisson).traction_spectrum(grid.waves)
        self.unit = Response.of_stiffness(plain.in_plane.relaxed, plain.across.relaxed)
        self.decay = math.exp(-STEP / tau)
        self.gain = (1 - self.decay) * tau / STEP  # y' + y/tau = u', u linear over the step
        self.modulus = self.G0 + (self.Ginf - self.G0) * self.gain
        self.u, self.y, self.spacings = np.zeros((2, POINTS)), np.zeros((2, POINTS)), spacings

    def begin(self):
        """Carry the material, and return displacements at the end of the step without tractions."""
        self.u, self.y = (np.roll(field, -self.spacings, axis=1) for field in (self.u, self.y))
        past = self.decay * self.y - self.gain * self.u
        return -(self.Ginf - self.G0) / self.modulus * past

    def end(self, rest, p, t):
        of_p, of_t, C = np.fft.rfft(p), np.fft.rfft(t), self.unit
        W = np.fft.irfft(C.normal * of_p - 1j * C.coupling * of_t, POINTS)
        u = np.fft.irfft(1j * C.coupling * of_p + C.along * of_t, POINTS)
        new = rest + np.stack((W, u)) / self.modulus
        self.y = self.decay * self.y + self.gain * (new - self.u)
        self.u = new


@pytest.mark.parametrize(
    ("trajectory", "ratio", "path"),
    [({"creepage": 0.02}, None, 0.02), ({}, 0.0, 1.0), ({}, 2.0, -1.0)],
    ids=["rolling", "sliding", "both"],
)
def test_a_run_of_two_bodies_is_two_single_bodies_marched_one_by_one(trajectory, ratio, path):
    """Each with its own memory in real space, moved by whole spacings; the contact by a dense solver."""
    velocity, coefficient = 1 / POINTS / STEP, 0.3
    depths = np.minimum(np.arange(STEPS + 1) * STEP / 0.2, 1.0) * 0.006

    def layer(given):
        material = dict(zip(("G0", "Ginf", "tau"), given[2:], strict=True)) | {"model": "zener"}
        base = {"halfspace": {"shear_modulus": math.inf}}
        return {"layer": {"thickness": given[0], "poisson": given[1], "material": material}} | base

    ratios = {} if ratio is None else {"velocity_ratio": ratio}
    found = gfmdlayer.run(
        {
            "name": "pair",
            "grid": {"points": POINTS, "period": 1.0},
            **layer(BODY),
            "counterbody": layer(COUNTERBODY) | ratios,
            "punch": {"shape": "parabola", "radius": RADIUS},
            "interface": {"law": "coulomb", "coefficient": coefficient},
            "trajectory": {"depth": depths[-1], "ramp_time": 0.2, "velocity": velocity} | trajectory,
            "time": {"end": STEPS * STEP, "step": STEP},
            "solver": {"tolerance": 1e-11},
            "output": {"snapshots": [n * STEP for n in range(1, STEPS + 1)]},
        }
    )
    grid = Grid((POINTS,), (1.0,))
    heights = grid.coordinates[0] ** 2 / (2 * RADIUS)
    one, two = _OneBody(BODY, grid, 1), _OneBody(COUNTERBODY, grid, 1 if ratio is None else int(ratio))
    C1, C2, k1, k2 = one.unit, two.unit, one.modulus, two.modulus
    response = Response(
        C1.normal / k1 + C2.normal / k2,
        C1.coupling / k1 - C2.coupling / k2,
        C1.along / k1 + C2.along / k2,
        C1.across / k1 + C2.across / k2,
    )
    problem = FrictionProblem(response, heights, ShearBound(coefficient))
    tractions = np.zeros((2, POINTS))
    for n in range(1, STEPS + 1):
        rest = one.begin(), two.begin()
        between = rest[0] + np.array([[1.0], [-1.0]]) * rest[1]
        here = replace(problem, offset=between, before=(one.u - two.u)[1:])
        p, t, stick, _ = solve_densely(grid, here, depths[n], [path * velocity * STEP], tractions)
        one.end(rest[0], p, t[0])
        two.end(rest[1], p, -t[0])
        tractions = np.vstack((p, t))
        snapshot = found.isel(snapshot=n - 1)
        for name, values, scale in (
            ("pressure", p, p.max()),
            ("shear_x", t[0], p.max()),
            ("displacement_body", -one.u[0], depths[-1]),
            ("displacement_counterbody", -two.u[0], depths[-1]),
        ):
            np.testing.assert_allclose(snapshot[name], values, atol=1e-8 * scale)
    assert (p > 0).sum() > 8
    assert 0 < np.count_nonzero(stick[p > 0]) < (p > 0).sum() or path != 0.02  # rolling slips in part
