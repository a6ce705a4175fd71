"""Pull-off from viscoelastic bodies: slow and fast limits, their maximum, the time step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from gfmdlayer.verification.adhesion.elastic import cycle
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ALONE, ELASTIC, RIGID, Recording, run
from gfmdlayer.verification.theory import E_STAR

_WORK, _RANGE, _DEPTH = 2e-4, 4e-4, 2e-3
_RELAXED = "the relaxed elastic body, same grid and law"
_KENDALL = "Kendall, J. Phys. D 4 (1971) 1186"
_GENT = (
    "Schapery, Int. J. Fract. 39 (1989) 163; Afferrante and Violano, J. Mech. Phys. Solids 158 (2022) 104669"
)


def _pulled(
    body: Mapping[str, object],
    speed: float,
    dwell: float = 200.0,
    *,
    tolerance: float = 1e-3,
    points: int = 1024,
) -> Recording:
    """Press a parabola in, rest for the dwell, retract; without a dwell the approach is as fast."""
    approach = 50 * _DEPTH if dwell else speed
    final = -0.02 if speed > 1e-3 else -0.006
    motion = {"kind": "approach_retract", "start": 0.0, "depth": _DEPTH, "final": final,
              "approach_speed": approach, "retract_speed": speed, "dwell": dwell}  # fmt: skip
    law = {"law": "exponential", "work": _WORK, "range": _RANGE}
    values: dict[str, object] = {"grid.points": points, "interface": law, "trajectory": motion}
    time = {"time": {"step": "adaptive", "tolerance": tolerance}}
    return run(ALONE, body, values, time)


def _least(found: Recording) -> float:
    return -float(found["mean_stress"].min())


def rate_dependence(_quick: bool) -> Iterator[Row]:
    """Pull-off of a parabola from a Zener halfspace of Ginf = 10 G0 after full relaxation.

    A slow retraction meets the relaxed body. In a fast one each part of the edge opens as in a glassy body,
    whose energy for the same tension is less by G0/Ginf: the apparent work is w Ginf/G0, until the strength
    w/range caps it. The apparent work is (P/P_relaxed)^(3/2) by JKR's scaling; the scaling neglects the
    cohesive zone, which is longer by Ginf/G0 in the glassy body: 0.05 and 0.15 of the contact for contrasts
    of 2 and 5. Between the limits the heat has its largest value.
    """
    law = {"law": "exponential", "work": _WORK, "range": _RANGE}
    values = {"grid.points": 2048, "interface": law}  # five points in the cohesive zone
    relaxed = run(ALONE, ELASTIC, values, cycle(0.0, _DEPTH, -0.006, 1e-2))
    slow = _pulled({}, 1e-8, points=2048)
    elastic = _least(relaxed)
    yield Row("slow pull-off over the relaxed elastic one", 1.0, _least(slow) / elastic, 0.01, _RELAXED)
    for contrast, bound in ((2.0, 0.1), (5.0, 0.75)):
        fast = _pulled({"layer.material.Ginf": contrast}, 1.0)
        apparent = (_least(fast) / elastic) ** 1.5
        yield Row(f"apparent work over w, fast, Ginf = {contrast:g} G0", contrast, apparent, bound, _GENT)
    pulls = [_least(_pulled({}, speed)) for speed in (1e-5, 1e-4, 1e-3, 1e-2)]
    rising = float(np.min(np.diff([_least(slow), *pulls])))
    yield Row("least growth of the pull-off with the speed, negative part", 0.0, min(rising, 0.0), 0.0, _GENT)
    work = [float(_pulled({}, speed, 0.0).last("work")) for speed in (1e-7, 3e-4, 100.0)]
    ends = max(work[0], work[2]) / work[1]
    yield Row("work of a cycle, slowest or fastest over that between", min(ends, 1.0), ends, 0.0, _GENT)


def size_of_the_step(_quick: bool) -> Iterator[Row]:
    """The pull-off by adaptive steps does not depend on the tolerance.

    A step is as long as the edge takes to open a gap by the part s of the range, s = 0.5, 0.3, 0.14 at
    tolerances of 1e-3, 1e-4, 1e-5. The traction of the opening edge, and so the pull, is in error by a part
    of third order, 0.05 s^3 = 6e-3, 1.3e-3, 1.4e-4. (With u linear over the steps it was 0.1 s^2.)
    """
    found = [_least(_pulled({}, 1e-4, tolerance=tolerance)) for tolerance in (1e-3, 1e-4, 1e-5)]
    for coarse, fine, name, bound in (
        (found[0], found[1], "1e-3 over 1e-4", 7e-3),
        (found[1], found[2], "1e-4 over 1e-5", 1.5e-3),
    ):
        yield Row(f"pull-off, tolerance {name}", 1.0, coarse / fine, bound, "no dependence on the step")


def flat_punch(_quick: bool) -> Iterator[Row]:
    """A flat punch on a Zener halfspace of Ginf = 4 G0 and on thin films: Kendall's limits.

    Strips of half-width a in a period L part at the mean tension sqrt(2 E* w tan(pi a/L)/L), with E* of the
    relaxed body for slow and of the glassy body for fast retraction. The cohesive zone l takes a part of
    the order of l/a of the tension: 2 % in the relaxed, 6 % in the glassy body. Any speed lies between.
    """
    half, law = 0.1, {"law": "exponential", "work": _WORK, "range": 2e-4}
    punch = {"shape": "flat", "width": 2 * half, "edge_radius": 1e-4}
    found = []
    for speed in (1e-7, 1e-3, 10.0):
        motion = {"kind": "approach_retract", "start": -1e-3, "depth": 0.0, "final": -0.05,
                  "approach_speed": 1.0, "retract_speed": speed, "dwell": 100.0}  # fmt: skip
        values: dict[str, object] = {
            "grid.points": 4096,
            "interface": law,
            "punch": punch,
            "layer.material.Ginf": 4.0,
            "trajectory": motion,
            "time": {"step": "adaptive", "tolerance": 1e-3},
        }
        found.append(_least(run(ALONE, values)))
    slow = math.sqrt(2 * E_STAR * _WORK * math.tan(math.pi * half))
    yield Row("slow pull-off of a flat punch", slow, found[0], 0.04 * slow, _KENDALL)
    yield Row("fast pull-off of a flat punch", 2 * slow, found[2], 0.08 * 2 * slow, _KENDALL)
    inside = min(max(found[1], found[0]), found[2])
    yield Row("pull-off between, against the limits", inside, found[1], 0.0, _KENDALL)


def thin_films(quick: bool) -> Iterator[Row]:
    """A flat punch on compressible films on a rigid base: the tension falls as d^(-1/2).

    A film that is thin against the punch stores sigma^2 d/(2 M) per area, with M = 2 G (1 - nu)/(1 - 2 nu),
    and parts at sigma = sqrt(2 M w/d) where this is w. Edges take a part of the order of d/a.
    """
    half, poisson = 0.25, 0.3
    modulus = 2 * (1 - poisson) / (1 - 2 * poisson)
    for thickness in (0.02,) if quick else (0.01, 0.02):
        tension = math.sqrt(2 * modulus * _WORK / thickness)
        values: dict[str, object] = {
            "grid.points": 4096,
            "layer": {"thickness": thickness, "poisson": poisson, "material": {"Ginf": 1.0}},
            "interface": {"law": "exponential", "work": _WORK, "range": 3e-4},
            "punch": {"shape": "flat", "width": 2 * half, "edge_radius": 1e-4},
        }
        found = run(RIGID, values, cycle(-5e-4, 1e-4, -5e-3, 1e-2))
        largest = _least(found) / (2 * half)
        bound = thickness / half
        yield Row(f"tension at pull-off, d = {thickness:g}", tension, largest, bound * tension, _KENDALL)
