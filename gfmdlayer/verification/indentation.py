"""Isolated axisymmetric indentation, against closed forms, published factors and the hereditary integral."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gfmdlayer.body.closed_form import LayeredHalfspace
from gfmdlayer.body.isolated import TOLERANCE
from gfmdlayer.body.layers import ViscoelasticLayer
from gfmdlayer.body.materials import Prony, Zener
from gfmdlayer.indentation.indent import IsolatedIndentation
from gfmdlayer.indentation.solve import Edge, History, follow, on_steps
from gfmdlayer.punch.revolution import Revolution, cone, flat, paraboloid, sphere
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ONE_STEP, run

_ELASTIC, _ZENER = Prony(1.0), Zener(1.0, 10.0, 1.0)
_SNEDDON = "Sneddon (1965)"
_LAYER: dict[str, object] = {"layer": {"thickness": 1.0, "material": {"model": "elastic", "G": 1.0}}}
_SQUARE = 1.2415  # shift of the depth by the images in a square lattice, times E* L/F


def _body(material: Prony | Zener, thickness: float, poisson: float) -> ViscoelasticLayer:
    """Return a layer on a rigid base, or a halfspace."""
    return ViscoelasticLayer(LayeredHalfspace(thickness, poisson, math.inf), material)


def _force(body: ViscoelasticLayer, indenter: Revolution, depth: float) -> float:
    history = History(np.array([0.0, 1.0]), np.array([0.0, depth]))
    return float(follow(body, indenter, history).force[-1])


def indented_halfspace(quick: bool) -> Iterator[Row]:  # noqa: ARG001
    """Cone, sphere and flat punch on an elastic halfspace, by Sneddon's solutions.

    On a halfspace the integral equation is local and its solution exact at the nodes. Only the rounding of
    sums over some hundred nodes remains, 1e-14, far below the bound of 1e-10.
    """
    body, stiff, a = _body(_ELASTIC, math.inf, 0.3), 2 / 0.7, 0.8
    log = math.log((2 + a) / (2 - a))
    cases = (
        ("cone", cone(0.3), math.pi / 2 * 0.3 * a, stiff * a * math.pi / 2 * 0.3 * a),
        ("sphere", sphere(2.0), a / 2 * log, stiff * ((a * a + 4) / 2 * log - 2 * a)),
        ("flat punch", flat(a), 0.1, 2 * stiff * a * 0.1),
    )
    for name, indenter, depth, force in cases:
        yield Row(f"F of a {name}, a = {a:g}", force, _force(body, indenter, depth), 1e-10 * force, _SNEDDON)


def indented_layer(quick: bool) -> Iterator[Row]:  # noqa: ARG001
    """Sphere and flat punch on a bonded layer, over the force on a halfspace.

    The factors are known to the given digits; the bound is half of the last digit.
    """
    source, bound = "dual integral equations, tabulated", 5.1e-5
    for root, factor in ((0.5, 2.1562), (1.0, 5.1154), (1.5, 10.3045)):
        depth = root**2 / 5
        ratio = _force(_body(_ELASTIC, 1.0, 0.5), paraboloid(5.0), depth) / (16 / 3 * 5**0.5 * depth**1.5)
        yield Row(f"F/F_Hertz, nu = .5, (R depth)^(1/2)/d = {root:g}", factor, ratio, bound, source)
    for nu, a, factor in ((0.5, 1.0, 3.6187), (0.5, 3.0, 18.1574), (0.4, 2.0, 5.2985), (0.3, 0.4, 1.4726)):
        ratio = _force(_body(_ELASTIC, 1.0, nu), flat(a), 0.1) * (1 - nu) / (0.4 * a)
        yield Row(f"flat punch, nu = {nu:g}, a/d = {a:g}", factor, ratio, bound, source)


def indented_over_time(quick: bool) -> Iterator[Row]:  # noqa: ARG001
    """A sphere on a Zener layer over a rigid base: the hereditary integral while the contact grows.

    F(t) = Ginf F_el(t) + int G'(t - s) F_el(s) ds with the elastic force of unit modulus, by Gauss's rule in
    s = t y^2. The tolerance of the run is 1e-6. The balance of energy of a whole cycle closes within the
    tolerance of 1e-4 that its run has; work, stored and dissipated energy are found independently.
    """
    indenter, history = sphere(5.0), History(np.array([0.0, 1.0]), np.array([0.0, 0.2]))
    body = _body(_ZENER, 1.0, 0.5)
    run = follow(body, indenter, history, tolerance=1e-6)
    assert run.space is not None
    y, w = np.polynomial.legendre.leggauss(30)
    y, w = (y + 1) / 2, w / 2
    times = np.concatenate(([0.0], y**2, [1.0]))
    force = on_steps(_body(_ELASTIC, 1.0, 0.5), run.space, indenter, history, times).force
    memory = (_ZENER.G0 - _ZENER.Ginf) * np.exp(-(1 - times[1:-1]))
    theory = float(_ZENER.Ginf * force[-1] + w @ (2 * y * memory * force[1:-1]))
    name = "F at the end of a ramp over a rigid base"
    yield Row(name, theory, float(run.force[-1]), 1e-6 * theory, "F = int G dF_el")
    cycle = History(np.array([0.0, 1.0, 4.0, 5.0]), np.array([0.0, 0.2, 0.2, -0.02]))
    columns = IsolatedIndentation(body, indenter, cycle).columns()
    lack = float(np.abs(columns["energy_residual"]).max() / columns["work"].max())
    yield Row("energy balance of ramp, hold and retraction", 0.0, lack, 1e-4, "work = stored + dissipated")


def isolated_and_periodic(quick: bool) -> Iterator[Row]:
    """The depth under a force on a layer: isolated, and in a periodic cell minus its images.

    Images at the distance L shift the depth by -1.2415 F/(E* L), the Madelung sum of a square lattice on the
    base, and by -c1 F/L^2 with the slope c1 of q/K(q) at q = 0. The next images are some (a/L)^2 of the
    first. The grid puts the edge of the contact within a part of a cell, (D/a)^2 of the depth.
    """
    n, L, force, R = (192 if quick else 256), 16.0, 2.0, 5.0
    for base in (math.inf, 3.0):
        body = ViscoelasticLayer(LayeredHalfspace(1.0, 0.5, base, 0.3), _ELASTIC)
        history = History(np.array([0.0, 1.0]), np.array([0.0, force]), by_force=True)
        alone = follow(body, paraboloid(R), history)
        pressed = {"control": "force", "force": force, "ramp_time": 1.0}
        values = {
            "halfspace": {"shear_modulus": base, "poisson": 0.3},
            "punch.radius": R,
            "trajectory": pressed,
        }
        recording = run(ONE_STEP, _LAYER, {"grid": {"points": [n, n], "period": L}}, values)
        q = np.array([1e-4, 2e-4])
        c1 = float(np.diff(q / body.stiffness(q, 0.0))[0] / (q[1] - q[0]))
        depth, a = float(alone.depth[-1]), float(alone.radius[-1])
        theory = depth - _SQUARE * force * 0.7 / (2 * base) / L - c1 * force / L**2
        bound = theory * (L / (n * a)) ** 2 + (a / L) ** 2 * (depth - theory)
        name = f"depth in a cell of 16 d, G_bulk = {base:g}, n = {n}²"
        yield Row(name, theory, recording.last("depth"), bound, "isolated contact, less its images")


def without_images(quick: bool) -> Iterator[Row]:
    """A sphere on a grid with `boundary: isolated`, in a cell of five contact radii, against the indenter.

    The force at the end of a ramp and after a hold, on a Zener layer. The grid puts the edge of the contact
    within a part of a cell, (D/a)^2 of the force, and the response within reach has the tolerance of its fit.
    """
    n, depth = (64 if quick else 128), 0.01
    for nu, base in ((0.5, math.inf), (0.45, 5.0), (0.45, 0.2)):
        body = ViscoelasticLayer(LayeredHalfspace(0.1, nu, base), _ZENER)
        alone = follow(
            body, paraboloid(1.0), History(np.array([0.0, 1.0, 4.0]), np.array([0.0, depth, depth]))
        )
        values: dict[str, object] = {
            "grid": {"points": [n, n], "period": 5 * float(alone.radius.max()), "boundary": "isolated"},
            "layer": {"thickness": 0.1, "poisson": nu, "material": {"model": "zener", "Ginf": 10.0}},
            "halfspace": {"shear_modulus": base},
            "punch.radius": 1.0,
            "trajectory": {"depth": depth, "ramp_time": 1.0},
            "time": {"end": 4.0, "step": "adaptive"},
        }
        computed = run(values)
        for time in (1.0, 4.0):
            theory = float(np.interp(time, alone.time, alone.force))
            bound = ((5 / n) ** 2 + TOLERANCE) * theory
            name = f"F at t = {time:g} without images, nu = {nu:g}, G_bulk = {base:g}, n = {n}²"
            yield Row(name, theory, float(computed.at("force", [time])[0]), bound, "isolated indenter")


def peeled_sphere(quick: bool) -> Iterator[Row]:  # noqa: ARG001
    """An adhesive sphere that is pulled off an elastic halfspace at a prescribed depth.

    Between rows of the curve the force bends by less than 1e-3 of its least value.
    """
    w, R = 1e-3, 1.0
    history = History(np.array([0.0, 1.0, 3.0]), np.array([-0.01, 0.02, -0.05]))
    run = follow(_body(_ELASTIC, math.inf, 0.3), paraboloid(R), history, adhesion=Edge(w))
    theory = -1.5 * math.pi * w * R
    yield Row("pull-off force", theory, float(run.force.min()), 1e-3 * abs(theory), "JKR (1971)")
    E, a = 2 / 0.7, run.radius[run.radius > 0]
    force = 4 / 3 * E * a**3 / R - np.sqrt(8 * np.pi * w * E * a**3)
    off = float(np.abs(run.force[run.radius > 0] - force).max() / abs(theory))
    yield Row("F against a along approach and retraction", 0.0, off, 1e-8, "JKR (1971)")


def peeled_thin_layer(quick: bool) -> Iterator[Row]:
    """An adhesive sphere that is pulled off a bonded layer: the limit of a thin layer, a/d to infinity.

    Without tension, F = pi M a^4/(4 R d) on a compressible layer of oedometric modulus M and
    F = pi G a^6/(32 R d^3) on an incompressible one, the leading terms for a thin layer. A flat punch has
    the stiffness k = pi M a^2/d or 3 pi G a^4/(8 d^3). JKR's energy balance k' D^2/2 = 2 pi a w takes the
    depth D from the first force; the least value of F - k D over a is -2 pi w R or -3 pi w R. The next terms
    are of order d/a: a parabola in d/a through three layers gives the limit. The bound is its difference
    from the line through the last two, which is one order lower.
    """
    w = 1e-3
    for nu, factor in ((0.3, 2.0), (0.5, 3.0)):
        pull_offs = np.array(
            [pull_off(nu, ratio, w) for ratio in ((3, 5, 8, 12) if quick else (4, 8, 12, 16))]
        )
        thin, forces = pull_offs.T
        lower, limit = (np.polynomial.polynomial.polyfit(thin[-k:], forces[-k:], k - 1)[0] for k in (3, 4))
        source = "Reedy (2006)" if nu < 0.5 else "Argatov, Mishuris & Popov (2016)"
        name = f"pull-off/(pi w R) from a thin layer, nu = {nu:g}"
        bound = abs(float(limit - lower)) + 1e-3 * factor
        yield Row(name, factor, float(limit), bound, source)


def pull_off(nu: float, ratio: float, work: float) -> tuple[float, float]:
    """Return d/a and the force over -pi w R where a sphere leaves a layer with G = d = 1, at some a/d."""
    if nu < 0.5:  # R and the depths are those of the thin layer, at its radius at pull-off
        below = math.sqrt(work * (1 - 2 * nu) / (1 - nu))
        radius = ratio**2 / (2 * below)
    else:
        below, radius = math.sqrt(8 * work / 3) / ratio, ratio**3 / math.sqrt(96 * work)
    history = History(np.array([0.0, 1.0, 3.0]), np.array([-0.3, 2.0, -3.0]) * below)
    run = follow(_body(_ELASTIC, 1.0, nu), paraboloid(radius), history, adhesion=Edge(work))
    least = int(run.force.argmin())
    return float(1 / run.radius[least]), float(run.force[least] / (-math.pi * work * radius))
