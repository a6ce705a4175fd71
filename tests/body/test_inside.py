"""Fields inside a stack: tables, the equations of elasticity, and the memory of each layer."""

import math

import numpy as np
import pytest

from gfmdlayer import Elastic, Layer, LayerStack, Prony, Zener
from gfmdlayer.body.inside import StackFields, TractionFields
from gfmdlayer.body.relaxation import distinct_branches

A, B = Prony(1.0, [(4.0, 0.1), (5.0, 10.0)]), Zener(0.2, 2.0, 1.0)
C, D = Prony(5.0, [(15.0, 3.0)]), Prony(8.0, [(2.0, 30.0)])
STACKS = {
    "H": LayerStack((Layer(0.3, 0.45, A), Layer(0.2, 0.5, B), Layer(0.5, 0.3, C), Layer(math.inf, 0.4, D))),
    "R": LayerStack((Layer(0.3, 0.5, A), Layer(0.2, 0.3, B), Layer(0.5, 0.5, C)), rigid=True),
    "F": LayerStack((Layer(0.3, 0.2, A), Layer(0.2, 0.5, B), Layer(0.5, 0.0, C))),
}


def after(field, time):
    """Strains and forces, (springs, nq), at a time after the surface has moved down by one at t = 0."""
    strains, forces = (each.copy() for each in field.relaxed)
    memory = field.memory
    y = np.exp(-time / memory.times)
    strains[1:, memory.waves] += np.einsum("nsm,nm->sn", memory.strains, y)
    forces[1:, memory.waves] += np.einsum("nsm,nm->sn", memory.forces, y)
    moduli, times = distinct_branches(field.body.present[0].series)
    forces[0] += field.q * field.stiffness[0] * (moduli @ np.exp(-time / times))
    return strains, forces


def at(field, depth, number, strains, forces):
    """W, U, s_zz, S, s_nn, s_tt at a depth, (6, nq)."""
    own = field.layer == number
    T = field.transfer(depth, number)
    return np.concatenate(((T[:2] * strains[own]).sum(axis=1), (T[2:] * forces[own]).sum(axis=1)))


@pytest.mark.parametrize(
    ("name", "q", "time", "depth", "known"),
    [  # of a solution in 40 digits, transformed back to time; the upper side of interfaces
        ("H", 5, 0, 0.3, (
            0.6042193548, -0.5268193687, -34.9657466224, 1.8765533221, 67.1770016143, 14.4950647463)),
        ("H", 5, 0.7, 0.0, (1, 0.1811861993, -36.738172338, 0, -49.1630147762, -38.6555342014)),
        ("H", 5, 0.7, 0.3, (
            0.576537803, -0.5410704506, -21.3161002836, 0.2793226943, 38.5809778489, 7.7691949044)),
        ("H", 5, 0.7, 0.5, (
            0.1219038583, -0.0395003401, -16.820569601, 9.8062843493, -16.0299488028, -16.4252592019)),
        ("H", 5, 0.7, 1.2, (
            0.01103718, -0.0083966253, -1.060641471, 0.8729524319, 0.6852633929, -0.1501512312)),
        ("H", 5, math.inf, 0.1, (
            0.9325780042, -0.1682645284, -5.9623231464, 2.4353037701, -1.8189093309, -3.5015546148)),
        ("R", 1, 0.7, 0.5, (
            0.042690668, -0.1454292534, -15.3092379931, 3.1226388327, -6.1678845201, -6.443136754)),
        ("R", 1, 0.7, 1.0, (0, 0, -12.8102395685, 7.4523950592, -12.8102395685, -12.8102395685)),
        ("F", 1, 0.7, 0.3, (
            0.9975607182, 0.1268443666, -0.9398445874, 1.1428104981, -1.9744017553, -0.5828492685)),
    ],
)  # fmt: skip
def test_fields_are_those_of_a_solution_in_40_digits(name, q, time, depth, known):
    field = StackFields(STACKS[name], np.array([float(q)]))
    number = int(np.searchsorted(field.tops[1:], depth))
    found = at(field, np.asarray(depth), number, *after(field, time))
    np.testing.assert_allclose(found[:, 0], known, rtol=0, atol=1e-10)  # the digits given


def random_stack(draw, case):
    """One to four layers of different laws on a rigid base, on a halfspace, or free."""
    count = int(draw.integers(1, 5))
    thick = [*(10 ** draw.uniform(-1.5, 0, count)).tolist()]
    if case % 3 == 1:
        thick[-1] = math.inf
    layers = []
    for d in thick:
        nu = 0.5 if draw.random() < 0.3 else float(draw.uniform(0, 0.5))
        branches = [tuple(10 ** draw.uniform(-1, 1, 2)) for _ in range(int(draw.integers(0, 4)))]
        layers.append(Layer(d, nu, Prony(float(10 ** draw.uniform(-1, 1)), branches)))
    return LayerStack(tuple(layers), rigid=case % 3 == 0)


def test_equilibrium_kinematics_and_continuity_at_random_stacks_times_and_depths():
    """The stress is in equilibrium at all times, and follows Hooke's law where nothing or all has relaxed."""
    # Rounding is relative to the largest field in the layer. The memory adds that of the surface's field.
    draw = np.random.default_rng(3)
    q = np.array([0.1, 1.0, 7.0, 40.0])
    for case in range(24):
        body = random_stack(draw, case)
        field, time = StackFields(body, q), float(draw.choice([0.0, 0.3, 5.0, math.inf]))
        springs = after(field, time)
        pressure = np.abs(at(field, np.asarray(0.0), 0, *springs)[2])
        for i, layer in enumerate(body.layers):
            d, nu, top = layer.thickness, layer.poisson, field.tops[i]
            g = layer.material.glassy if time == 0 else layer.material.relaxed
            # The derivative by a complex step has no difference of close numbers.
            depth = top + draw.uniform(0, 1) * min(d, 1.0)
            found = at(field, np.asarray(depth + 1e-30j), i, *springs)
            dW, dU, dszz, dS = found[:4].imag * 1e30
            W, U, szz, S, snn, _ = found.real
            # Even and odd motions of a layer cancel towards its lower face: rounding is relative to the
            # largest field in the layer, at its faces or here.
            faces = [at(field, np.asarray(face), i, *springs) for face in (top, top + min(d, 1.0))]
            largest = np.abs([*faces, found.real])
            stress, moved = largest[:, 2:5].max(axis=(0, 1)), g * q * largest[:, :2].max(axis=(0, 1))
            size = q * np.max([stress, moved, pressure * (time < math.inf)], axis=0)
            wrong = [dszz - q * S, dS + q * snn]
            if time in (0.0, math.inf):
                # Times 1 - 2 nu, so that it also holds for an incompressible layer of no dilatation.
                bulk = (1 - 2 * nu) * (szz - 2 * g * dW) - 2 * nu * g * (dW - q * U)
                hooke = [S - g * (dU + q * W), szz - snn - 2 * g * (dW + q * U), bulk]
                wrong += [q * each for each in hooke]
            assert (np.abs(wrong) <= 1e-12 * size).all()
            if i + 1 < len(body.layers):
                up, low = (at(field, np.asarray(top + d), j, *springs) for j in (i, i + 1))
                # Relative to the largest component, or to the surface's field: a thin plate bends, and its
                # stress along the wave is some 1/(q d)^2 of the pressure.
                for part, first in ((slice(0, 2), 1.0), (slice(2, 4), np.abs(springs[1][0]))):
                    whole = first + np.maximum(np.abs(up), np.abs(low))[2 * (part.start > 0) :].max(axis=0)
                    assert (np.abs(up - low)[part] < 1e-12 * whole).all()


def test_the_force_of_each_spring_is_the_memory_of_its_law():
    """Force = stiffness (G0 e + sum_k G_k y_k), dy_k/dt + y_k/tau_k = de/dt, with the strain e(t) known."""
    draw = np.random.default_rng(5)
    q = np.array([0.3, 3.0, 20.0])
    for case in range(12):
        body = random_stack(draw, case)
        field, t = StackFields(body, q), 0.8
        _, forces = after(field, t)
        memory = field.memory
        for k, i in enumerate(memory.waves):
            theta, e = memory.times[k], memory.strains[k]  # e = e_0 + sum e_k exp(-t/theta_k)
            start = field.relaxed[0][1:, i] + e.sum(axis=1)
            for s, number in enumerate(field.layer[1:]):
                law = body.layers[number].material
                expected = law.relaxed * (field.relaxed[0][1 + s, i] + e[s] @ np.exp(-t / theta))
                for G, tau in law.maxwell_branches:
                    x = t / tau - t / theta
                    mean = np.where(np.abs(x) < 1e-9, 1.0, np.expm1(x) / np.where(x == 0, 1.0, x))
                    integral = np.exp(-t / tau) * t / theta * mean
                    expected += G * (start[s] * np.exp(-t / tau) - e[s] @ integral)
                expected *= field.q[i] * field.stiffness[1 + s, i]
                assert abs(expected - forces[1 + s, i]) < 1e-11 * np.abs(forces[:, i]).max()


def test_the_surface_carries_the_pressure_of_its_displacement_and_no_shear():
    draw = np.random.default_rng(7)
    q = np.array([0.2, 2.0, 30.0])
    for case in range(12):
        body = random_stack(draw, case)
        field, spectrum = StackFields(body, q), body.spectrum(q)
        for t in (0.0, 0.5, math.inf):
            found = at(field, np.asarray(0.0), 0, *after(field, t))
            pressure = spectrum.relaxed + (spectrum.weights * np.exp(-t / spectrum.times)).sum(axis=0)
            size = np.abs(found[2:]).max(axis=0)  # the stress along a bent plate is above the pressure
            assert (np.abs(found[0] - 1) < 1e-12).all()
            assert (np.abs(found[2] + pressure) < 1e-12 * size).all()
            assert (np.abs(found[3]) < 1e-12 * size).all()


def test_layers_that_relax_alike_need_only_displacement_and_pressure():
    law = Zener(G0=1.0, Ginf=4.0, tau=2.0)
    one = LayerStack((Layer(0.1, 0.4, law), Layer(0.3, 0.5, law)), rigid=True)
    field = StackFields(one, np.array([0.5, 5.0]))
    strains, forces = after(field, 1.0)
    K = one.stiffness(field.q, 0.0) * (1 + 3 * math.exp(-0.5))  # pressure at that time: G(t)/G0 times relaxed
    known = field.alike()
    np.testing.assert_allclose(strains, known[0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(forces, known[1] * K, rtol=1e-12, atol=1e-13)
    elastic = LayerStack((Layer(0.1, 0.4, Elastic(2.0)), Layer(0.3, 0.5, Elastic(5.0))))
    assert not StackFields(elastic, field.q).memory.waves.size


# Under pressure and shear traction.


def sheared(field, x, time):
    """Strains and forces, (springs, nq), at a time after the surface has moved by x, (ways, nq), at t = 0."""
    spectrum = field.body.traction_spectrum(field.q)
    modes = spectrum.in_plane if field.in_plane else None
    vectors = modes.vectors if modes else np.sqrt(spectrum.across.weights)[..., np.newaxis]
    times = modes.times if modes else spectrum.across.times
    y = np.einsum("jqw,wq->jq", vectors, x) * np.exp(-time / times)
    every = zip(field.relaxed, field.memory, strict=True)
    return [np.einsum("wsq,wq->sq", now, x) + np.einsum("qsj,jq->sq", past, y) for now, past in every]


def seen(field, depth, number, strains, forces):
    """The fields at a depth: as `at`, and V, Z and s_nt of a motion across, (3, nq)."""
    own, T, moved = field.layer == number, field.transfer(depth, number), 2 if field.in_plane else 1
    return np.concatenate(((T[:moved] * strains[own]).sum(axis=1), (T[moved:] * forces[own]).sum(axis=1)))


@pytest.mark.parametrize("in_plane", [True, False])
def test_under_shear_the_fields_are_in_equilibrium_continuous_and_carry_the_tractions(in_plane):
    """As under pressure; where nothing or all has relaxed Hooke's law holds too.

    A wave that feels only the uppermost layer, q d > 24, is a halfspace's there, up to x exp(-x) = 1e-9.
    A thin incompressible layer on a rigid base resists W by some 1/(q d)^3, and W loses as many digits.
    """
    draw = np.random.default_rng(11)
    q = np.array([0.1, 1.0, 7.0, 40.0])
    for case in range(24):
        body = random_stack(draw, case)
        field, time = (
            TractionFields(body, q, in_plane=in_plane),
            float(draw.choice([0.0, 0.3, 5.0, math.inf])),
        )
        x = draw.uniform(-1, 1, (field.ways, q.size))
        springs, deep = sheared(field, x, time), q * body.layers[0].thickness > 24
        spectrum = body.traction_spectrum(q)
        relaxing = spectrum.in_plane if in_plane else spectrum.across
        vectors = relaxing.vectors if in_plane else np.sqrt(relaxing.weights)[..., np.newaxis]
        relaxed = relaxing.relaxed if in_plane else relaxing.relaxed[:, np.newaxis, np.newaxis]
        y = np.einsum("jqw,wq->jq", vectors, x) * np.exp(-time / relaxing.times)
        tractions = np.einsum("qvw,wq->vq", relaxed, x) + np.einsum("jqw,jq->wq", vectors, y)
        surface = seen(field, 0.0, 0, *springs)
        size = np.abs(surface[field.ways :]).max(axis=0) + np.abs(tractions).max(axis=0)
        lost = 1e-12 + 1e-16 / (q * body.layers[0].thickness) ** 3
        assert (np.abs(surface[: field.ways] - x) < lost).all()
        carried = surface[2:4] if in_plane else surface[1:2]
        assert (np.abs(carried + tractions) < 1e-11 * size).all()
        for i, layer in enumerate(body.layers):
            d, nu, top = layer.thickness, layer.poisson, field.tops[i]
            g = layer.material.glassy if time == 0 else layer.material.relaxed
            found = seen(field, top + draw.uniform(0, 1) * min(d, 1.0) + 1e-30j, i, *springs)
            slope, now = found.imag * 1e30, found.real
            largest = np.abs([*(seen(field, top + z, i, *springs) for z in (0, min(d, 1.0))), now])
            part = q * (largest[:, field.ways :].max(axis=(0, 1)) + size * (time < math.inf))
            part += g * q * q * largest[:, : field.ways].max(axis=(0, 1))
            if in_plane:
                W, U, szz, R, snn, _ = now
                wrong = [slope[2] - q * R, slope[3] + q * snn]
                bulk = (1 - 2 * nu) * (szz - 2 * g * slope[0]) - 2 * nu * g * (slope[0] - q * U)
                hooke = [R - g * (slope[1] + q * W), szz - snn - 2 * g * (slope[0] + q * U), bulk]
            else:
                V, Z, snt = now
                wrong, hooke = [slope[1] + q * snt], [Z - g * slope[0], snt + g * q * V]
            if time in (0.0, math.inf):
                wrong += [q * each for each in hooke]
            exact = ~deep | (time == math.inf) | (i == 0)
            assert (np.abs(wrong)[:, exact] <= 1e-11 * part[exact]).all()
            if i + 1 < len(body.layers):
                up, low = (seen(field, top + d, j, *springs) for j in (i, i + 1))
                ends = field.ways + 2 if in_plane else 2
                for rows in (slice(0, field.ways), slice(field.ways, ends)):
                    whole = np.abs(surface[rows]).max(axis=0) + np.abs([up[rows], low[rows]]).max(axis=(0, 1))
                    if rows.start:  # those of a free stack are far below its parts, a halfspace's at t = 0
                        whole += layer.material.glassy * q * np.abs(surface[: field.ways]).max(axis=0)
                    near = np.where(deep & (time < math.inf), 1e-9, 1e-11)
                    assert (np.abs(up - low)[rows] < near * whole).all()


@pytest.mark.parametrize("in_plane", [True, False])
def test_under_shear_the_force_of_each_spring_is_the_memory_of_its_law(in_plane):
    """At t = 0 those of the glassy moduli, then G0 e + sum_k G_k y_k, dy_k/dt + y_k/tau_k = de/dt."""
    draw = np.random.default_rng(13)
    q, t = np.array([0.3, 3.0, 20.0]), 0.8
    for case in range(12):
        body = random_stack(draw, case)
        field = TractionFields(body, q, in_plane=in_plane)
        x = draw.uniform(-1, 1, (field.ways, q.size))
        glassy = LayerStack(
            tuple(layer.with_law(Elastic(layer.material.glassy)) for layer in body.layers), body.rigid
        )
        of_glass = TractionFields(glassy, q, in_plane=in_plane)
        shallow = q * body.layers[0].thickness <= 24
        start, end = sheared(field, x, 0.0), sheared(of_glass, x, 0.0)
        for one, other in zip(start, end, strict=True):
            assert (np.abs(one - other) < 1e-10 * np.abs(other).max(axis=0))[:, shallow].all()
        # The strains at many times between give the memory by the mean slope in each interval, at whose
        # ends they are exact: an error of 1/n^2.
        times = np.linspace(0.0, t, 801)
        e = np.array([sheared(field, x, time)[0] for time in times])
        forces = sheared(field, x, t)[1]
        for s, number in enumerate(field.layer):
            law, k = body.layers[number].material, field.q * field.stiffness[s]
            expected = law.relaxed * e[-1, s]
            for G, tau in law.maxwell_branches:
                slopes = np.diff(e[:, s], axis=0) / np.diff(times)[:, np.newaxis]
                kept = tau * (np.exp(-(t - times[1:]) / tau) - np.exp(-(t - times[:-1]) / tau))
                expected = expected + G * (np.exp(-t / tau) * e[0, s] + kept @ slopes)
            off = np.abs(k * expected - forces[s])[shallow]
            assert (off < 1e-4 * np.abs(forces).max(axis=0)[shallow]).all()
