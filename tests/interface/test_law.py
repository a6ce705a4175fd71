"""Interface laws: energy, traction and curvature against each other, works and strengths, sums, voltages."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from gfmdlayer.interface.adhesion import Dugdale, Electrostatic, Exponential, LennardJones, ShortRange
from gfmdlayer.interface.forms import interact
from gfmdlayer.interface.interface import FrictionLaw, HardWall
from gfmdlayer.interface.law import HARD_WALL, Driven, total
from gfmdlayer.interface.laws import LAWS

WORK, RANGE = 1e-3, 4e-3
EXAMPLES = {
    "exponential": Exponential(work=WORK, range=RANGE),
    "hard_wall": HardWall(),
    "dugdale": Dugdale(work=WORK, stress=WORK / RANGE, smoothing=0.5),
    "lennard_jones": LennardJones(work=WORK, separation=RANGE),
    "electrostatic": Electrostatic(voltage=-2.0, insulation=RANGE, permittivity=0.5 * WORK * RANGE),
    "short_range": ShortRange(work=WORK),
}
ADHESIVE = [name for name in EXAMPLES if name not in ("hard_wall", "short_range")]  # across the gap
SUM = total(law.interaction() for law in EXAMPLES.values())
LAWS_AND_SUM = {name: law.interaction() for name, law in EXAMPLES.items()} | {"sum": SUM}

each_law = pytest.mark.parametrize("law", LAWS_AND_SUM.values(), ids=LAWS_AND_SUM.keys())


def test_every_law_of_the_table_is_tested():
    assert EXAMPLES.keys() == {name for name, law in LAWS.items() if not issubclass(law, FrictionLaw)}


@each_law
def test_traction_and_curvature_are_derivatives_of_the_energy(law):
    gap, step = np.linspace(1e-4, 0.02, 201), 1e-7
    # Central differences: truncation (step/width)^2 with the shortest width of 2e-3, 3e-9; rounding of the
    # energy, 1e-16 work/step, and of the traction, beside the largest traction and curvature.
    slope = (law.energy(gap + step) - law.energy(gap - step)) / (2 * step)
    np.testing.assert_allclose(law.traction(gap), slope, rtol=1e-7, atol=1e-8 * max(law.strength, 1))
    slope = (law.traction(gap + step) - law.traction(gap - step)) / (2 * step)
    # The curvature of the cohesive zone has kinks, where a difference is off by one step's change.
    per_step = 12 * law.strength * step / (0.5 * RANGE) ** 2
    np.testing.assert_allclose(law.curvature(gap), slope, rtol=1e-7, atol=max(per_step, 1e-6))


@each_law
def test_laws_attract_and_fade(law):
    gap = np.geomspace(1e-6, 10, 100)
    assert (law.traction(gap) >= 0).all()
    assert (law.energy(gap) <= 0).all()
    assert abs(law.energy(np.array([1e12]))[0]) < 1e-12 * max(law.work, 1)
    # Compiled for a point of a loop they are the same.
    points = np.array([interact(float(g), law.terms) for g in gap])
    arrays = np.stack([law.energy(gap), law.traction(gap), law.curvature(gap)], axis=1)
    np.testing.assert_allclose(points, arrays, rtol=1e-13, atol=1e-300)


@pytest.mark.parametrize("name", ADHESIVE)
def test_the_work_is_the_integral_of_the_traction_and_the_strength_its_maximum(name):
    law = EXAMPLES[name].interaction()
    assert law.work == pytest.approx(WORK, rel=1e-12)
    assert law.energy(np.zeros(1))[0] == pytest.approx(-WORK, rel=1e-12)

    def traction(gap):
        return float(law.traction(np.array([gap]))[0])

    edges = [0.0, 0.75 * RANGE, 1.25 * RANGE, 1.0]
    integral = sum(quad(traction, *pair, epsrel=1e-10, limit=200)[0] for pair in pairwise(edges))
    far = -float(law.energy(np.array([1.0]))[0])
    assert integral + far == pytest.approx(WORK, rel=1e-8)
    # Of 1001 gaps the best misses a flat maximum by up to (spacing/range)^2/2 of its curvature, under 20.
    largest = law.traction(np.linspace(0, 2 * RANGE, 1001)).max()
    assert largest <= law.strength * (1 + 1e-12)
    assert law.strength == pytest.approx(largest, rel=20 * 0.001**2 / 2)
    assert law.range * law.strength == pytest.approx(WORK, rel=1e-12)


def test_the_compiled_exponential_is_the_one_of_numpy():
    # Seven squarings double the rounding of a power series each: 2^7 times 2e-16 at most.
    gap = np.linspace(0, 63.9 * RANGE, 20_001)
    expected = WORK / RANGE * np.exp(-gap / RANGE)
    np.testing.assert_allclose(EXAMPLES["exponential"].traction(gap), expected, rtol=5e-14)
    assert EXAMPLES["exponential"].traction([64 * RANGE, 1.0, math.inf]).tolist() == [0, 0, 0]


def test_dugdales_traction_tends_to_a_step_as_its_end_narrows():
    law = Dugdale(work=WORK, stress=0.25, smoothing=0.01)
    np.testing.assert_array_equal(law.traction([0.0, 0.994 * RANGE, 1.006 * RANGE]), [0.25, 0.25, 0.0])
    assert law.traction(RANGE) == pytest.approx(0.125, rel=1e-12)


def test_the_9_3_law_is_in_equilibrium_at_its_wall():
    law = EXAMPLES["lennard_jones"]
    assert law.traction(0.0) == pytest.approx(0, abs=1e-15)
    # A spring of 16 work/separation^2 there: the slope of (8/3)(x^3 - x^9) is 16.
    assert law.curvature(0.0) == pytest.approx(16 * WORK / RANGE**2, rel=1e-12)
    assert law.traction((3 ** (1 / 6) - 1) * RANGE) == pytest.approx(16 / (9 * math.sqrt(3)) * WORK / RANGE)


def test_the_electrostatic_traction_is_the_stress_of_the_field():
    # eps0 E^2/2 in the gap, E = D/eps0 with the voltage over gap and layers: V = D/eps0 (g + t1/e1 + t2/e2).
    eps0, volts, gap = 8.8541878128e-12, 300.0, 2e-6
    layers = [{"thickness": 1e-6, "permittivity": 3.0}, {"thickness": 5e-6, "permittivity": 2.5}]
    law = Electrostatic(voltage=volts, insulation=layers, permittivity=eps0)
    field = volts / (gap + 1e-6 / 3 + 5e-6 / 2.5)
    assert law.traction(gap) == pytest.approx(0.5 * eps0 * field**2, rel=1e-12)


def test_laws_add_and_the_hard_wall_adds_nothing():
    gap = np.linspace(0, 0.01, 11)
    np.testing.assert_allclose(SUM.traction(gap), sum(law.traction(gap) for law in EXAMPLES.values()))
    assert total([HARD_WALL, HARD_WALL]) is HARD_WALL
    assert not HARD_WALL.attracts
    assert HARD_WALL.range == math.inf
    assert not HARD_WALL.traction(gap).any()


def test_a_voltage_over_time_drives_the_attraction(tmp_path):
    file = tmp_path / "voltage.txt"
    file.write_text("0 0\n1 10\n3 -20\n")
    law = Electrostatic(voltage=file, insulation=0.1, permittivity=1.0).interaction()
    assert isinstance(law, Driven)
    gap = np.array([0.0, 0.05])
    for time, volts in ((0.0, 0.0), (0.5, 5.0), (1.0, 10.0), (2.0, -5.0), (9.0, -20.0)):
        fixed = Electrostatic(voltage=volts, insulation=0.1, permittivity=1.0)
        np.testing.assert_allclose(law.at(time).traction(gap), fixed.traction(gap), rtol=1e-12, atol=0)
    assert not law.at(0.0).attracts
    both = total([law, EXAMPLES["exponential"].interaction()])
    assert both.breakpoints == law.breakpoints == (1.0, 3.0)
    expected = law.at(2.0).traction(gap) + EXAMPLES["exponential"].traction(gap)
    np.testing.assert_allclose(both.at(2.0).traction(gap), expected, rtol=1e-12)
    assert SUM.at(2.0) is SUM
    # Of a law that depends on time the largest is what grids have to resolve.
    assert law.strength == pytest.approx(law.at(9.0).strength)
