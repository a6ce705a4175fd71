"""The relaxing modes and the contact problem in the frame of a moving punch, against their equations."""

import math

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
from gfmdlayer.body.materials import Prony
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.contact.active_set.solver import ActiveSet
from gfmdlayer.contact.bounded import ConjugateGradient
from gfmdlayer.contact.fire import Fire
from gfmdlayer.contact.loss_stiffness import LossStiffnessSolver
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.sums import Sums
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.history.modes import Modes, exponential
from gfmdlayer.history.sliding_modes import SlidingModes, phi_functions
from gfmdlayer.time_functions import Constant, Table, distance


@pytest.mark.parametrize(
    "z", [0, 1e-9, 1e-3 + 1e-3j, 0.7 - 0.7j, 0.99j, 1.01, 1 - 3j, 30j, 50 + 1j, 1e6 + 1e9j]
)
def test_phi_functions_keep_their_digits(z):
    found = phi_functions(np.array([z], dtype=complex))[:, 0]
    for n in range(6):
        with mpmath.workdps(60):
            series = (
                mpmath.nsum(lambda k, n=n: (-mpmath.mpc(z)) ** k / mpmath.factorial(k + n), [0, mpmath.inf])
                if (abs(z) < 2)
                else mpmath.hyp1f1(1, n + 1, -mpmath.mpc(z)) / mpmath.factorial(n)
            )
        # Upwards from |z| = 1 each is a difference of two that are n times larger: 5! rounding errors.
        assert found[n] == pytest.approx(complex(series), rel=1e-13, abs=1e-300 + 1e-13 / max(abs(z), 1.0))


def one_mode(theta, q, velocity):
    spectrum = Spectrum(np.array([0.3]), np.array([[1.7]]), np.array([[theta]]))
    return SlidingModes(spectrum, Sums(np.ones(1)), wavenumbers_x=np.full((2, 1), q), velocity=velocity)


@pytest.mark.parametrize("theta", [1e-3, 0.4, 50.0])
@pytest.mark.parametrize("q", [0.0, 0.3, 8.0, 900.0])
@pytest.mark.parametrize("c", [0.0, 0.3 - 0.2j])
def test_stretch_and_heat_of_a_mode_solve_its_equation(theta, q, c):
    step, v, u_0, u_1 = 0.2, 0.5, 0.6 + 0.1j, 0.2 - 0.4j
    modes = one_mode(theta, q, Constant(v))
    modes.terms(0.0)
    modes.advance(np.array([u_0]))  # y = u_0 at once

    def surface(s):
        return u_0 + (u_1 - u_0) * s + c * (s * s - s), (u_1 - u_0) + c * (2 * s - 1)

    def rate(s, state):
        u, change = surface(s)
        y = state[0]
        motion = change - 1j * q * v * step * u
        return [motion - (step / theta - 1j * q * v * step) * y, 1.7 * step / theta * abs(y) ** 2]

    start = [complex(u_0), 0j]
    exact = solve_ivp(rate, (0, 1), start, rtol=1e-10, atol=1e-13, method="DOP853").y[:, -1]
    # The stress at the end is that of a linear displacement and `curvature_stress`.
    kappa, b = modes.terms(step)
    stress = (kappa + 1j * modes.loss_stiffness) * u_1 - b + modes.curvature_stress(np.array([c]))
    assert stress[0] == pytest.approx(0.3 * u_1 + 1.7 * exact[0], rel=1e-8)
    modes.advance(np.array([u_1]), np.array([c]))
    assert modes.dissipated == pytest.approx(exact[1].real, rel=1e-7, abs=1e-13)
    assert modes.stored == pytest.approx((0.3 * abs(u_1) ** 2 + 1.7 * abs(exact[0]) ** 2) / 2, rel=1e-8)


def test_the_steady_state_is_the_kernel_of_steady_sliding_for_any_step():
    layer, material = LayeredHalfspace(0.05, 0.4, 3.0), Prony(1.0, ((2.0, 0.01), (3.0, 1.0)))
    grid, v = Grid((16,), (1.0,)), 0.7
    q = grid.wavenumbers
    spectrum = relaxation_spectrum(layer, material, q)
    modes = SlidingModes(spectrum, grid.sums, wavenumbers_x=grid.wavenumbers_x, velocity=Constant(v))
    u = np.exp(1j * np.arange(9))
    u[[0, -1]] = u[[0, -1]].real
    for step in (0.0, 1000.0, 3.0, 3.0):
        kappa, b = modes.terms(step)
        stress = (kappa + 1j * modes.loss_stiffness) * u - b
        modes.advance(u)
    expected = layer.stiffness(q, material.laplace(-1j * q * v)) * u
    expected[-1] = expected[-1].real  # two waves that travel either way
    np.testing.assert_allclose(stress, expected, rtol=1e-12)


def test_sliding_modes_agree_with_modes_in_the_frame_of_the_body():
    # In the frame of the body u = U exp(-i q x0); both agree in the limit of small steps.
    theta, q, v, end, errors = 0.4, 3.0, 0.8, 1.0, []
    for count in (50, 100):
        step = end / count
        sliding = one_mode(theta, q, Constant(v))
        spectrum = Spectrum(np.array([0.3]), np.array([[1.7]]), np.array([[theta]]))
        body = Modes(spectrum, exponential)
        for i in range(count + 1):
            time = i * step
            U, phase = np.array([complex(time, 0.5)]), np.exp(-1j * q * v * time)
            dt = step if i else 0.0
            kappa, b = sliding.terms(dt)
            seen = ((kappa + 1j * sliding.loss_stiffness) * U - b) * phase
            sliding.advance(U)
            stiffness, intercept = body.terms(dt)
            expected = stiffness * U * phase - intercept
            body.advance(U * phase)
        errors.append(abs(seen[0] - expected[0]))
    assert errors[1] < 1e-3 * abs(expected[0])
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)  # second order of linear interpolation


def test_a_table_of_velocities_is_integrated_exactly():
    table = Table(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, -2.0]))
    assert [distance(table, t) for t in (0.0, 0.5, 1.0, 2.0, 3.0, 4.0)] == pytest.approx(
        [0, 0.25, 1, 2, 1, -1]
    )


SOLVERS = {"active_set": ActiveSet, "conjugate_gradient": ConjugateGradient, "fire": Fire}


@pytest.mark.parametrize("condition", ["depth", "load"])
@pytest.mark.parametrize(
    ("method", "contrast"),
    [
        *(("active_set", contrast) for contrast in (10.0, 1e3, 1e4)),
        ("conjugate_gradient", 1e3),
        ("fire", 1e2),
    ],
)
def test_contact_with_loss_stiffness_is_solved_for_any_loss(method, condition, contrast):
    # A halfspace of Ginf/G0 = contrast at the speed of most loss for waves of a tenth of the period, where
    # tan delta is (Ginf/G0)^(1/2)/2, up to 50; from nothing, and with several contacts.
    grid, tolerance = Grid((64,), (1.0,)), 1e-9
    q, x = grid.wavenumbers, grid.coordinates[0]
    transforms = Transforms(grid.shape)
    cycles = -1j * q / (20 * np.pi * math.sqrt(contrast))
    stiffness = 2 * q * (1 + (contrast - 1) * cycles / (1 + cycles))
    drag = stiffness.imag * (grid.wavenumbers_x[0] == grid.wavenumbers_x[1])
    h = 2 * x * x - 0.02 + 0.003 * np.sin(12 * np.pi * x)
    load = 0.3 if condition == "load" else None
    problem = Problem(stiffness.real.copy(), np.zeros(33, complex), h, load, loss_stiffness=drag)
    solver = LossStiffnessSolver(SOLVERS[method](transforms), transforms, grid.parseval_weights)
    solution = solver.solve(problem, np.zeros(64), tolerance)
    assert solution.converged
    # The conditions of contact, by numpy: nowhere pulled, pressed only where it touches.
    u, p = solution.displacement, solution.pressure
    spectrum = np.fft.rfft(u)
    force = np.fft.irfft(-(problem.stiffness + 1j * drag) * spectrum, n=64)
    multiplier = load if load is not None else np.mean((p - force)[p > 0])
    scale = p.max()
    np.testing.assert_allclose(p, force + multiplier, atol=2 * tolerance * scale)
    assert (h - u).min() > -1e-14
    assert p.min() >= 0
    assert np.minimum(p / scale, (h - u) / np.ptp(h)).max() < 2 * tolerance
    assert p.mean() == pytest.approx(load, rel=1e-6) if load else abs(u.mean()) < 1e-12
