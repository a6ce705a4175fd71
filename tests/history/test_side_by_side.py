"""Two histories side by side: against the modes of the pair, the equations, and the energies of each body."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gfmdlayer
from gfmdlayer.body.in_series import in_series
from gfmdlayer.body.relaxation import Spectrum
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.errors import ErrorControl, NormalMeans
from gfmdlayer.history.modes import Modes, backward_euler, exponential
from gfmdlayer.history.side_by_side import SideBySide
from gfmdlayer.history.sliding_modes import SlidingModes
from gfmdlayer.time_functions import Constant

ONE = Sums(np.ones(1))


def spectrum(relaxed, weights, times):
    return Spectrum(np.array([relaxed]), np.array(weights)[:, None], np.array(times)[:, None])


def bodies():
    return spectrum(2.0, [3.0, 5.0], [0.1, 10.0]), spectrum(4.0, [1.0, 20.0], [0.5, 10.0])


def both(scheme):
    one, two = (Modes(each, scheme, ONE) for each in bodies())
    return SideBySide((one, two), ONE)


def displacement(time):
    return np.array([np.sin(time) ** 2 + 0.3j * time])


def march(history, count):
    """Return -sigma at t = 4; the history advances in equal steps."""
    for i in range(count + 1):
        kappa, b = history.terms(4.0 / count if i else 0.0)
        u = displacement(4.0 * i / count)
        history.advance(u)
    return complex((kappa * u - b)[0])


def test_backward_euler_is_the_step_of_the_modes_of_the_pair():
    """Backward differences commute with the elimination of the displacement between the bodies."""
    pair, two = Modes(in_series(*bodies()), backward_euler), both(backward_euler)
    assert march(two, 80) == pytest.approx(march(pair, 80), rel=1e-13)
    energies = two.stored + two.dissipated, pair.stored + pair.dissipated
    assert energies[0] == pytest.approx(energies[1], rel=1e-12)


def test_the_exponential_scheme_is_of_second_order_and_of_third_with_the_curvature():
    exact = march(Modes(in_series(*bodies()), exponential), 20_000)
    off = [abs(march(both(exponential), count) - exact) for count in (50, 100)]
    assert off[0] / off[1] == pytest.approx(4, rel=0.1)
    curved = []
    for count in (100, 200):
        history = both(exponential)
        curved.append(abs(march(ErrorControl(history, NormalMeans(history, ONE)), count) - exact))
    assert curved[1] < off[1] / 8
    assert curved[0] / curved[1] > 4


@pytest.mark.parametrize("velocities", [(0.8, 0.0), (0.8, -0.4), (0.5, 0.5)])
def test_bodies_that_slide_solve_their_equations(velocities):
    """Y_i' + (1/theta - i q v_i) Y_i = U_i' - i q v_i U_i, equal stresses, U_1 + U_2 = U."""
    q, end = 3.0, 2.0
    single = spectrum(2.0, [3.0], [0.4]), spectrum(1.0, [6.0], [0.9])
    (K1, w1, t1), (K2, w2, t2) = ((s.relaxed[0], s.weights[0, 0], s.times[0, 0]) for s in single)
    v1, v2 = velocities

    def history(count):
        each = [
            Modes(s, exponential, ONE)
            if v == 0
            else SlidingModes(s, ONE, wavenumbers_x=np.full((2, 1), q), velocity=Constant(v))
            for s, v in zip(single, velocities, strict=True)
        ]
        two = SideBySide((each[0], each[1]), ONE, v2 / v1)
        for i in range(count + 1):
            kappa, b = two.terms(end / count if i else 0.0)
            u = displacement(end * i / count)
            two.advance(u)
        assert two.loss_stiffness is not None
        return complex(((kappa + 1j * two.loss_stiffness) * u - b)[0]), two.dissipated

    def rate(time, state):
        Y1, Y2, _ = state
        U, change = displacement(time)[0], (displacement(time + 1e-6) - displacement(time - 1e-6))[0] / 2e-6
        U1 = (K2 * U + w2 * Y2 - w1 * Y1) / (K1 + K2)
        U2 = U - U1
        # Y_i' = U_i' + r_i; of the two, (K1 + w1) U1' + w1 r1 = (K2 + w2) U2' + w2 r2.
        r1, r2 = (-1j * q * v * (u - y) - y / t for v, u, y, t in ((v1, U1, Y1, t1), (v2, U2, Y2, t2)))
        change1 = ((K2 + w2) * change + w2 * r2 - w1 * r1) / (K1 + w1 + K2 + w2)
        heat = w1 / t1 * abs(Y1) ** 2 + w2 / t2 * abs(Y2) ** 2
        return [change1 + r1, change - change1 + r2, heat]

    final = solve_ivp(rate, (0, end), [0j, 0j, 0j], rtol=1e-10, atol=1e-12).y[:, -1]
    U1 = (K2 * displacement(end)[0] + w2 * final[1] - w1 * final[0]) / (K1 + K2)
    stress = K1 * U1 + w1 * final[0]
    found = [history(count) for count in (100, 200)]
    off = [abs(each - stress) for each, _ in found]
    assert off[1] < 1e-4 * abs(stress)
    assert off[0] / off[1] == pytest.approx(4, rel=0.1)
    assert found[1][1] == pytest.approx(final[2].real, rel=1e-4)


def test_steady_sliding_has_the_compliances_of_both_velocities_for_any_step():
    grid, v, ratio = Grid((16,), (1.0,)), 0.7, 0.4
    layers = gfmdlayer.bonded_layer(
        0.05, gfmdlayer.Prony(1.0, [(2.0, 0.01), (3.0, 1.0)]), poisson=0.4, halfspace=3.0
    )
    half = gfmdlayer.halfspace(gfmdlayer.Zener(tau=0.2))
    one, two = (
        SlidingModes(
            body.spectrum(grid.waves), grid.sums, wavenumbers_x=grid.wavenumbers_x, velocity=Constant(speed)
        )
        for body, speed in ((layers, v), (half, ratio * v))
    )
    pair, q = SideBySide((one, two), grid.sums, ratio), grid.wavenumbers
    u = np.exp(1j * np.arange(9))
    u[[0, -1]] = u[[0, -1]].real
    for step in (0.0, 1e6, 3.0, 1e6):
        kappa, b = pair.terms(step)
        assert pair.loss_stiffness is not None
        stress = (kappa + 1j * pair.loss_stiffness) * u - b
        pair.advance(u)
    s = -1j * q[1:-1]
    expected = 1 / (1 / layers.stiffness(q[1:-1], s * v) + 1 / half.stiffness(q[1:-1], s * v * ratio))
    np.testing.assert_allclose(stress[1:-1], expected * u[1:-1], rtol=1e-6)  # after 1e6 relaxation times


RIGID = {"shear_modulus": float("inf")}
ROLLING = {
    "grid": {"points": 256}, "layer": {"thickness": 0.1, "material": {"G0": 1.0, "Ginf": 10.0, "tau": 0.5}},
    "halfspace": RIGID,
    "counterbody": {"layer": {"thickness": 0.07, "material": {"G0": 2.0, "Ginf": 6.0, "tau": 0.1}},
     "halfspace": RIGID},
    "trajectory": {"control": "load", "load": 0.01, "ramp_time": 0.2, "velocity": 0.3},
    "time": {"end": 2.0, "step": "adaptive", "tolerance": 1e-4}, "output": {"snapshots": [2.0]},
}  # fmt: skip


def moving(ratio, **keys):
    config = ROLLING | keys
    return gfmdlayer.run(config, counterbody=config["counterbody"] | {"velocity_ratio": ratio})


@pytest.mark.parametrize("ratio", [0.0, 1.0, -1.0])
def test_energies_of_two_bodies_that_relax_close_the_balance(ratio):
    data = moving(ratio)
    # The error of the work over steps of the tolerance 1e-4.
    assert float(abs(data.energy_residual).max()) < 2e-3 * float(data.work.max())
    for name in ("stored", "dissipated"):
        parts = data[f"{name}_body"] + data[f"{name}_counterbody"]
        np.testing.assert_allclose(parts, data[name], rtol=1e-12)
        assert float(data[f"{name}_counterbody"][-1]) > 0
    parts = data.displacement_body + data.displacement_counterbody
    np.testing.assert_allclose(parts, data.displacement, atol=1e-12)
    resting = (
        ratio == 0
    )  # once its indentation has settled, a body at rest in the contact dissipates nothing more
    late = data.dissipated_counterbody.diff("time")[-5:]
    assert bool((abs(late) < 1e-4 * data.dissipated.diff("time")[-5:]).all()) == resting


def test_a_counterbody_that_slides_acts_like_its_relaxed_self_in_the_end():
    """Its material rests in the contact, of the relaxation times 0.1 and 0.5 of the two bodies."""
    end = {"time": ROLLING["time"] | {"end": 8.0}, "output": {}}
    elastic = {"layer": {"thickness": 0.07, "material": {"model": "elastic", "G": 2.0}}, "halfspace": RIGID}
    crept, known = moving(0.0, **end), moving(0.0, **end, counterbody=elastic)
    for name in ("depth", "friction"):
        assert float(crept[name][-1]) == pytest.approx(float(known[name][-1]), rel=1e-3)
    assert float(crept.depth[10]) < 0.999 * float(known.depth[10])


def test_bodies_may_be_exchanged_with_their_velocities():
    """The signs of pressure and slope stay: each displacement counts out of its own body."""
    one = moving(2.0)
    other = gfmdlayer.run(
        ROLLING,
        layer=ROLLING["counterbody"]["layer"],
        counterbody={"layer": ROLLING["layer"], "halfspace": RIGID, "velocity_ratio": 0.5},
        trajectory=ROLLING["trajectory"] | {"velocity": 0.6},
    )
    np.testing.assert_allclose(other.pressure, one.pressure, atol=1e-5 * float(one.pressure.max()))
    np.testing.assert_allclose(
        other.displacement_body, one.displacement_counterbody, atol=1e-5 * float(one.displacement.max())
    )
    heat = float(one.dissipated_body[-1])
    assert float(other.dissipated_counterbody[-1]) == pytest.approx(heat, rel=1e-4)


def test_equal_bodies_under_attraction_take_the_steps_of_one_of_half_the_moduli():
    layer = {"thickness": 0.1, "material": {"G0": 1.0, "Ginf": 10.0, "tau": 0.5}}
    soft = {"thickness": 0.1, "material": {"G0": 0.5, "Ginf": 5.0, "tau": 0.5}}
    config = {
        "grid": {"points": 256},
        "halfspace": RIGID,
        "interface": {"law": "exponential", "work": 0.002, "range": 0.005},
        "trajectory": {"kind": "approach_retract", "start": -0.01, "depth": 0.005, "approach_speed": 0.02},
        "time": {"step": "adaptive", "tolerance": 1e-3},
    }
    two = gfmdlayer.run(config, layer=layer, counterbody={"layer": layer, "halfspace": RIGID})
    one = gfmdlayer.run(config, layer=soft)
    np.testing.assert_allclose(two.time, one.time, rtol=1e-4)
    np.testing.assert_allclose(two.force, one.force, atol=1e-4 * float(one.force.max()))
    np.testing.assert_allclose(two.stored_body, one.stored / 2, rtol=1e-4, atol=1e-12)
