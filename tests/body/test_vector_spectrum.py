"""Relaxing modes of several components against the network that they come from."""

import numpy as np
import pytest

from gfmdlayer import Layer, LayerStack, Prony, Zener
from gfmdlayer.body.network import vector_spectrum
from gfmdlayer.body.relaxation import VectorSpectrum

FREQUENCIES = (0.0, 0.3, 2j, 1e6)
# Sums of some ten terms of either sign, each to eps.
ROUNDING = 1e-12
NQ, REDUNDANT, INTERNAL = 4, 3, 6


def random_network(components, phases):
    rng = np.random.default_rng(components)
    force = rng.normal(size=(NQ, REDUNDANT, components))
    if phases:  # a displacement along the wave is i times a real one
        force = force * np.exp(1j * rng.uniform(0, 6, components))
    return force, rng.normal(size=(NQ, REDUNDANT, INTERNAL)), 10 ** rng.uniform(-2, 2, INTERNAL)


def is_passive(found):
    """Whether K_0 is Hermitian and not negative, to rounding, and all times are positive."""
    size = ROUNDING * np.abs(found.relaxed).max()
    hermitian = np.abs(found.relaxed - np.swapaxes(found.relaxed, -1, -2).conj()).max() <= size
    return bool(hermitian and np.linalg.eigvalsh(found.relaxed).min() >= -size and (found.times > 0).all())


@pytest.mark.parametrize("phases", [False, True])
@pytest.mark.parametrize("components", [1, 2, 3])
def test_modes_add_up_to_the_response_of_the_network(components, phases):
    g, B, times = random_network(components, phases)
    found = vector_spectrum(g, B, times)
    assert found.vectors.shape == (INTERNAL, NQ, components)
    assert is_passive(found)
    adjoint = np.swapaxes(g, 1, 2).conj()
    for s in FREQUENCIES:
        inner = np.eye(INTERNAL) + np.swapaxes(B, 1, 2) @ B + s * np.diag(times)
        exact = adjoint @ g - adjoint @ B @ np.linalg.solve(inner, np.swapaxes(B, 1, 2) @ g)
        scale = np.abs(adjoint @ g).max()
        np.testing.assert_allclose(found.stiffness(s), exact, rtol=0, atol=ROUNDING * scale)
    np.testing.assert_allclose(found.glassy, adjoint @ g, rtol=0, atol=ROUNDING * scale)


def test_one_component_is_the_scalar_spectrum():
    stack = LayerStack((Layer(0.1, 0.4, Zener()), Layer(0.2, 0.5, Zener(tau=3.0))), rigid=True)
    scalar = stack.spectrum(np.array([[1.0, 5.0, 20.0]]))
    found = VectorSpectrum.of(scalar)
    assert is_passive(found)
    for s in FREQUENCIES:
        np.testing.assert_allclose(found.stiffness(s)[..., 0, 0], scalar.stiffness(s), rtol=ROUNDING)
    s = np.array([[0.1, 1.0, 10.0]])
    np.testing.assert_allclose(found.stiffness(s)[..., 0, 0], scalar.stiffness(s), rtol=ROUNDING)


def test_the_normal_response_of_a_stack_is_that_of_its_network():
    base = Layer(np.inf, 0.3, Prony(2.0, [(1.0, 0.2), (3.0, 5.0)]))
    stack, q = LayerStack((Layer(0.1, 0.5, Zener()), base)), np.array([0.5, 3.0, 10.0])
    network = stack.network(q)
    modes = vector_spectrum(network.force[..., np.newaxis], network.coupling, network.times)
    for s in FREQUENCIES:
        free = network.free * Zener().laplace(s)  # the uppermost layer alone, parallel to the network
        found = modes.stiffness(s)[..., 0, 0] + free
        np.testing.assert_allclose(found, stack.stiffness(q, s), rtol=1e-11)
