"""Two deformable bodies: their compliances add, their modes are positive, and known."""

import mpmath as mp
import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import Config, ConfigError, Prony, Zener
from gfmdlayer.body.in_series import in_series
from gfmdlayer.body.layer import Halfspace, Layer
from gfmdlayer.body.layers import LayerStack
from gfmdlayer.body.pair import Pair
from gfmdlayer.body.relaxation import Spectrum

S = (0, 1e-7j, 1e-3 + 1e-3j, 0.01j, 1j, 1, 1e3j + 1, 1e6j, 1e12)


def spectrum(body):
    relaxed, weights, times = body
    return Spectrum(np.array([relaxed]), np.array(weights)[:, None], np.array(times)[:, None])


def exact(body, s):
    relaxed, *modes = body
    cycles = ((mp.mpf(w), mp.mpmathify(s) * mp.mpf(t)) for w, t in zip(*modes, strict=True))
    return mp.mpf(relaxed) + sum(w * x / (1 + x) for w, x in cycles)


def random_pairs(number):
    """Pairs with 1 to 8 modes over 12 decades of times; in a third of them times are shared, or nearly."""
    random, pairs = np.random.default_rng(1), []
    for case in range(number):
        spread, bodies = random.choice([1, 3, 6]), []
        for _ in range(2):
            n, relaxed = random.integers(1, 9), 10.0 ** random.uniform(-2 * spread, 2 * spread)
            weights = relaxed * 10.0 ** random.uniform(-6, random.choice([1, 3]), n)
            bodies.append((relaxed, weights, 10.0 ** random.uniform(-6, 6, n)))
        (_, _, one), (_, _, two) = bodies
        few = (min(one.size, two.size) + 1) // 2
        if case % 3 == 0:
            two[:few] = one[:few] * (1 + random.choice([0, 2.3e-16]))
        pairs.append(tuple(bodies))
    return pairs


def test_modes_of_random_pairs_agree_with_60_digits_and_do_not_depend_on_the_order():
    with mp.workdps(60):
        for one, two in random_pairs(200):
            modes, swapped = in_series(spectrum(one), spectrum(two)), in_series(spectrum(two), spectrum(one))
            assert (modes.weights >= 0).all()
            assert (modes.times > 0).all()
            for s in S:
                first, second = exact(one, s), exact(two, s)
                K = modes.stiffness(s)[0]
                # A sum of 16 positive terms, each found to some roundings.
                assert abs(K / complex(first * second / (first + second)) - 1) < 1e-13
                assert abs(swapped.stiffness(s)[0] / K - 1) < 1e-15 * 8


def test_modes_of_a_known_pair():
    found = in_series(spectrum((2.0, [3.0, 5.0], [0.1, 10.0])), spectrum((4.0, [1.0, 20.0], [0.5, 10.0])))
    order = np.argsort(found.times[:, 0])
    # From the same equations in 60 digits.
    times = [0.109215024730, 0.515803707477, 10, 51.774981267794]
    weights = [1.682536583025, 0.041459623731, 4, 0.085527602768]
    np.testing.assert_allclose(found.times[order, 0], times, rtol=1e-11)
    np.testing.assert_allclose(found.weights[order, 0], weights, rtol=1e-10)


def stacks():
    a = Prony(1.0, [(4.0, 0.1), (5.0, 10.0)])
    b, c = Zener(G0=0.2, Ginf=2.0, tau=1.0), Prony(5.0, [(15.0, 3.0)])
    rigid = LayerStack((Layer(0.3, 0.5, a), Layer(0.2, 0.3, b), Layer(0.5, 0.5, c)), rigid=True)
    base = Prony(8.0, [(2.0, 30.0)])
    on_base = (Layer(0.3, 0.45, a), Layer(0.2, 0.5, b), Layer(0.5, 0.3, c), Layer(np.inf, 0.4, base))
    return rigid, LayerStack(on_base)


def test_two_stacks_face_to_face():
    rigid, on_base = stacks()
    found = Pair(rigid, on_base).spectrum([1.0, 10.0])
    # From a solution of all layers of both stacks at once, in 60 digits.
    K = {
        0: (1.99021638875, 8.78956849118),
        1j: (8.8588028052 + 3.3001763234j, 52.6156086260 + 9.0257616266j),
        1e9: (11.0968394147, 87.8628328200),
    }
    for s, known in K.items():
        np.testing.assert_allclose(found.stiffness(s), known, rtol=2e-10)


def test_a_body_of_fixed_mean_adds_no_compliance_to_the_mean():
    rigid_base = gfmdlayer.bonded_layer(0.1, Zener(), poisson=0.3)
    half = gfmdlayer.halfspace(Zener(tau=3.0))
    pair, q = Pair(half, rigid_base), np.array([0.0, 1.0])
    assert pair.mean_stiffness == rigid_base.mean_stiffness == pair.spectrum(q).relaxed[0] > 0
    np.testing.assert_allclose(pair.spectrum(q).stiffness(1j), pair.stiffness(q, 1j), rtol=1e-14)
    for s in (0.0, 1e300):  # relaxed and glassy
        parts = pair.stiffness(q, s) / rigid_base.stiffness(q, s)
        np.testing.assert_allclose(pair.part_of_second(q, glassy=s > 0), parts, rtol=1e-14)
        assert parts[0] == 1.0
    assert Pair(half, half).mean_stiffness == Pair(half, half).spectrum(q).relaxed[0] == 0


def test_deep_bodies_keep_one_time_at_all_waves():
    """So that histories of large surfaces store one number a wave and mode."""
    layer = gfmdlayer.bonded_layer(0.3, Zener(tau=0.5), halfspace=5.0)
    q = np.hypot(*np.meshgrid(np.arange(200.0), np.arange(100.0)))
    found = Pair(layer, gfmdlayer.halfspace(Zener())).spectrum(q)
    deep = 0.3 * q > 30
    constant = [np.ptp(times[deep]) == 0 for times in found.times if (times[deep] != 1).any()]
    assert len(constant) == sum(constant) == 2


TWO = {
    "name": "two", "grid": {"points": 256}, "layer": {"thickness": 0.1, "material": {"tau": 0.5}},
    "halfspace": {"shear_modulus": float("inf")},
    "trajectory": {"control": "load", "kind": "ramp_hold", "load": 0.01, "ramp_time": 0.5},
    "time": {"end": 2.0, "step": 0.1, "integrator": "exponential"}, "output": {"snapshots": [2.0]},
}  # fmt: skip


def run(**keys):
    return gfmdlayer.run(TWO | keys)


def test_a_rigid_counterbody_changes_no_bit():
    one, two = run(), run(counterbody={"halfspace": {"shear_modulus": float("inf")}})
    for name in ("depth", "pressure", "stored", "dissipated"):
        assert one[name].values.tobytes() == two[name].values.tobytes()


def test_two_equal_layers_deform_like_one_of_half_the_moduli():
    """Equal bodies share the deformation, so each sees a rigid punch of half the height."""
    layer, rigid = {"thickness": 0.1, "material": {"tau": 0.5}}, {"shear_modulus": float("inf")}
    two = run(layer=layer, counterbody={"layer": layer, "halfspace": rigid})
    one = run(layer=layer | {"material": {"G0": 0.5, "Ginf": 5.0, "tau": 0.5}})
    # Both to the solver's tolerance of 1e-6, times the contrast of 10.
    np.testing.assert_allclose(two["depth"], one["depth"], rtol=1e-5, atol=1e-7)
    for name, scale in (("pressure", one["pressure"].max()), ("stored", one["work"].max())):
        np.testing.assert_allclose(two[name], one[name], atol=1e-5 * float(scale))


def test_a_stiff_counterbody_approaches_the_rigid_punch():
    rigid, soft, stiff = (
        float(run(counterbody={"halfspace": {"shear_modulus": G}})["depth"][-1]) for G in (np.inf, 1e3, 1e4)
    )
    # The compliance of the counterbody adds, in proportion to 1/G.
    assert (soft - rigid) / (stiff - rigid) == pytest.approx(10, rel=0.02)


@pytest.mark.parametrize(
    ("counterbody", "keys", "message"),
    [
        ({"halfspace": {"shear_modulus": 0}}, {},
         "counterbody.halfspace.shear_modulus: got 0 without a layer: the counterbody carries no load"),
        ({"layer": {}, "layers": [{"thickness": 1}]}, {},
         "counterbody.layers: given beside layer; remove one of the two"),
        ({"thickness": 1}, {}, "counterbody.thickness: unknown key"),
        ({"layer": {}, "velocity_ratio": 1.0}, {},
         "counterbody.velocity_ratio: only for a punch that moves; remove it or set trajectory.velocity"),
        ({"layer": {}, "velocity_ratio": 1.0}, {"trajectory": {"velocity": 1.0},
         "punch": {"shape": "self_affine", "hurst": 0.8, "rms_slope": 0.1, "short_cutoff": 0.01, "seed": 1}},
         "counterbody.velocity_ratio: got 1.0 with a rough punch, whose heights would pass the contact"),
        ({"layer": {}, "halfspace": {"shear_modulus": 0}}, {"grid": {"geometry": "axisymmetric"}},
         "counterbody.halfspace.shear_modulus: got 0: a layer without a base does not support"),
    ],
)  # fmt: skip
def test_impossible_counterbodies_are_refused(counterbody, keys, message):
    with pytest.raises(ConfigError) as caught:
        Config(**{"name": "bad", "counterbody": counterbody, **keys})
    assert message in str(caught.value)


def test_two_halfspaces_touch_by_the_law_of_hertz():
    """1/E* = 1/E*_1 + 1/E*_2 in a cell of 16 radii, whose images matter by some 2 %."""
    one, two = gfmdlayer.halfspace(1.0, poisson=0.3), gfmdlayer.halfspace(3.0, poisson=0.4)
    E = 1 / ((1 - 0.3) / 2.0 + (1 - 0.4) / 6.0)
    same = gfmdlayer.halfspace(E / 4)  # incompressible: E* = 4 G
    punch = gfmdlayer.Parabola(radius=1.0)
    found, known = (
        gfmdlayer.solve(body, punch, force=0.01, period=2.0, points=(64, 64))
        for body in (Pair(one, two), same)
    )
    np.testing.assert_allclose(found.pressure, known.pressure, atol=1e-6 * float(known.pressure.max()))
    # Halfspaces share the displacement in proportion to their compliances (1 - nu)/G.
    own, size = 0.7 / 1.0, float(abs(found.displacement).max())
    np.testing.assert_allclose(
        found.displacement_body, own / (own + 0.6 / 3.0) * found.displacement, atol=1e-12 * size
    )
    both = found.displacement_body + found.displacement_counterbody
    np.testing.assert_allclose(both, found.displacement, atol=1e-12 * size)


def test_layers_of_a_stack_and_a_counterbody_merge_their_modes_within_the_bound():
    layers = [Layer(0.1, 0.5, Prony(1.0, [(1.0, tau) for tau in np.geomspace(0.01, 100, 12)]))] * 2

    def pair(**keys):
        bases = (Halfspace(shear_modulus=modulus) for modulus in (np.inf, 3.0))
        two = (LayerStack(layers, halfspace=base, **keys) for base in bases)
        return Pair(*two).spectrum(np.linspace(1.0, 60.0, 20))

    found, whole, s = pair(accuracy=1e-4), pair(), 0.3j
    assert 0 < found.error <= 1e-4
    assert np.abs(found.stiffness(s) / whole.stiffness(s) - 1).max() <= found.error
