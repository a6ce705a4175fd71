"""Contacts of an elastic body, with and without adhesion: depth and force over the contact radius.

An elastic body has no history: at a contact radius a, with a work of adhesion w (JKR),

    depth(a) = depth_0 - s,   force(a) = force_0 - k s,   s = (4 pi a w/k')^(1/2) = (pi a w/D)^(1/2)/e

depth_0 and force_0 belong to the contact without adhesion, k is the stiffness of a bonded flat punch of
radius a, and e is chi(a) under it at unit depth (chi and D of `march`). With DMT's constant attraction A,
depth(a) = depth_0 and force(a) = force_0 - A. Beyond the rim of an indenter the depth grows at a constant a.

One integral equation with two right-hand sides gives all four functions. Chebyshev polynomials of a
interpolate their ratios to the functions of a halfspace, which are exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import brentq

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.indentation.compliance import find_features, gauss_rule, panels
from gfmdlayer.punch.revolution import Revolution, abel_transforms

_ORDER = 12  # of Gauss's rule and of the polynomials, plus a part of the phase: their error is below 1e-6
_PER_PHASE = 0.6
_RADII = 401  # at which stability is searched, denser towards 0
_ITERATIONS = 12
_START = 1e-7  # in t, for the slope at a kink
# Parts of the largest C: a body without layers; at the last node; changes over the nodes of the first panel.
_NOTHING, _BEYOND, _BEGINS, _FIRST = 1e-8, 1e-6, 0.7, 10
_MATTERS = 1e-4  # part of the largest compliance, up to which polynomials must resolve it
_MOST_KNOTS = 8  # of a profile whose kinks are resolved
_PRECISE = 1e-13
_CLOSE = 1e-8  # of the reach, of the radius where contact is lost: its value is stationary


class EdgeAdhesion(NamedTuple):
    """Adhesion of an elastic contact: JKR's work, or DMT's force, or neither."""

    work: float = 0.0  # energy per area
    force: float = 0.0  # attraction of a contact of any size


class Control(NamedTuple):
    """The prescribed quantity: depth_share depth + compliance force."""

    depth_share: float
    compliance: float


BY_DEPTH, BY_FORCE = Control(1.0, 0.0), Control(0.0, 1.0)


def by_base(stiffness: float) -> Control:
    """Return the control of the base of a cantilever, or of the depth where it is infinitely stiff."""
    return Control(1.0, 1 / stiffness)


class _Values(NamedTuple):
    """Functions of the contact radius, each of shape (na,), and their derivatives."""

    a: FloatArray
    depth: FloatArray  # without adhesion
    force: FloatArray
    stiffness: FloatArray
    lift: FloatArray  # s for the work 1
    depth_slope: FloatArray
    stiffness_slope: FloatArray
    lift_slope: FloatArray

    def under(self, control: Control, adhesion: EdgeAdhesion) -> tuple[FloatArray, FloatArray]:
        """Return the prescribed quantity, and its derivative to the radius."""
        root = math.sqrt(adhesion.work)
        share = control.depth_share + control.compliance * self.stiffness
        value = control.depth_share * self.depth + control.compliance * (self.force - adhesion.force)
        slope = share * (self.depth_slope - root * self.lift_slope)
        bent = control.compliance * root * self.stiffness_slope * self.lift
        return value - root * share * self.lift, slope - bent


class _Panel(NamedTuple):
    """Radii from a kink of the profile on: a = begin + width t^2, or t in place of t^2 from the centre on."""

    begin: float
    width: float
    # (order, 4): depth and force (see `Equilibria.relative`), logarithms of stiffness and of e, less the
    # halfspace's
    coefficients: FloatArray
    derivatives: FloatArray  # (order - 1, 4), to t

    def at(self, a: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the four functions at radii, and their derivatives; each of shape (4, na)."""
        part = np.clip((a - self.begin) / self.width, 0.0, 1.0)
        t = np.maximum(np.sqrt(part), _START) if self.begin else part
        slope = 1 / (2 * t * self.width) if self.begin else np.full(a.size, 1 / self.width)
        basis = chebyshev.chebvander(2 * t - 1, self.coefficients.shape[0] - 1)
        derivative = basis[:, : self.derivatives.shape[0]] @ self.derivatives
        return (basis @ self.coefficients).T, slope * derivative.T


@dataclass(frozen=True)
class Equilibria:
    """The contacts of an elastic body and an indenter, up to a radius."""

    local: float  # D
    profile: Revolution
    reach: float
    panels: tuple[_Panel, ...]
    relative: bool  # depth and force: logarithms of their ratios, or differences where a halfspace's are zero

    def at(self, a: FloatArray) -> _Values:
        """Return the functions at radii within the reach."""
        values, slopes = self.panels[0].at(a)
        for panel in self.panels[1:]:
            beyond = a > panel.begin
            values[:, beyond], slopes[:, beyond] = panel.at(a[beyond])
        H, slope, integral = abel_transforms(self.profile, a)
        own = a * H - integral  # D/4 of the halfspace's force, whose derivative is a times the slope of H
        if self.relative:
            ratio = np.exp(values[0])
            depth, depth_slope = H * ratio, ratio * (slope + H * slopes[0])
            force = own * np.exp(values[1])
        else:
            depth, depth_slope, force = H + values[0], slope + slopes[0], own + values[1]
        radius = np.maximum(a, 1e-300)
        k = 4 * a / self.local * np.exp(values[2])
        lift = np.sqrt(math.pi * a * self.local) * np.exp(-values[3])
        stiffness_slope, lift_slope = k * (1 / radius + slopes[2]), lift * (0.5 / radius - slopes[3])
        force *= 4 / self.local
        return _Values(a, depth, force, k, lift, depth_slope, stiffness_slope, lift_slope)

    @cached_property
    def _grid(self) -> _Values:
        return self.at(self.reach * np.linspace(0.0, 1.0, _RADII) ** 2)

    def largest(self, control: Control, adhesion: EdgeAdhesion) -> float:
        """Return the prescribed value at the reach; infinite at a rim."""
        return math.inf if self.reach >= self.profile.rim else float(self._under(control, adhesion)[0][-1])

    def _under(self, control: Control, adhesion: EdgeAdhesion) -> tuple[FloatArray, FloatArray]:
        return self._grid.under(control, adhesion)

    def branch(self, control: Control, adhesion: EdgeAdhesion) -> StableContacts:
        """Return the stable contacts under a control."""
        values = self._under(control, adhesion)[0]
        least = int(np.argmin(values))
        lost = float(self._grid.a[least])
        if 0 < least < _RADII - 1:
            ends = float(self._grid.a[least - 1]), float(self._grid.a[least + 1])

            def slope(a: float) -> float:
                return float(self.at(np.array([a])).under(control, adhesion)[1][0])

            if slope(ends[0]) < 0 < slope(ends[1]):
                lost = float(brentq(slope, *ends, xtol=_CLOSE * self.reach))
        end = float(self.at(np.array([lost])).under(control, adhesion)[0][0])
        stable = np.minimum.accumulate(values[::-1])[::-1]  # the largest radius at a value is taken
        return StableContacts(self, control, adhesion, lost, end, np.maximum(stable, end))


@dataclass(frozen=True)
class StableContacts:
    """The stable contacts under a control: from the smallest prescribed value, where contact is lost, on."""

    of: Equilibria
    control: Control
    adhesion: EdgeAdhesion
    radius: float  # where contact is lost
    end: float  # the prescribed value there
    _stable: FloatArray

    def __call__(self, prescribed: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return depth, force and contact radius at prescribed values, at least at the end."""
        contacts, level = self.of, np.maximum(prescribed, self.end)
        # In the root of the value above its end the radius is smooth: the value is stationary there.
        root = np.sqrt(level - self.end)
        a = np.interp(root, np.sqrt(self._stable - self.end), contacts._grid.a)
        a = np.clip(a, self.radius, contacts.reach)
        inside = (level > self.end) & (level < self._stable[-1])
        for _ in range(_ITERATIONS):
            value, slope = contacts.at(a[inside]).under(self.control, self.adhesion)
            own = np.sqrt(np.maximum(value - self.end, 0.0))
            step = 2 * own * (root[inside] - own) / np.where(slope > 0, slope, np.inf)
            moved = np.clip(a[inside] + step, self.radius, contacts.reach)
            done = np.abs(moved - a[inside]).max(initial=0.0) < _PRECISE * contacts.reach
            a[inside] = moved
            if done:
                break
        a[level == self.end] = self.radius
        values = contacts.at(a)
        root_w = math.sqrt(self.adhesion.work)
        depth = values.depth - root_w * values.lift
        force = values.force - self.adhesion.force - root_w * values.stiffness * values.lift
        # Beyond the rim, and within rounding elsewhere, at a constant radius.
        share = self.control.depth_share + self.control.compliance * values.stiffness
        rest = level - self.control.depth_share * depth - self.control.compliance * force
        more = np.divide(rest, share, out=np.zeros_like(rest), where=(share > 0) & (a >= contacts.reach))
        return depth + more, force + values.stiffness * more, a


def touches(prescribed: FloatArray, end: FloatArray) -> BoolArray:
    """Whether there is contact at successive prescribed values: it begins at 0 and is lost below an end."""
    found, now = np.zeros(prescribed.size, dtype=bool), False
    for i, (value, least) in enumerate(zip(prescribed.tolist(), end.tolist(), strict=True)):
        now = value >= least if now else value >= 0
        found[i] = now
    return found


class WaveNodes(NamedTuple):
    """Nodes in q for contacts up to a radius, on bodies of the same lengths."""

    reach: float
    surface: float  # wavenumber beyond all others: the body responds like its surface's material
    q: FloatArray  # (nq,); none for a halfspace
    weights: FloatArray  # (nq,)
    last: float  # C is left out beyond it

    def compliance(self, body: Body) -> tuple[float, FloatArray]:
        """Return D of an elastic body, and C/D at the nodes.

        Raises ArithmeticError if the nodes belong to bodies of much larger or smaller lengths.
        """
        every = np.append(self.q, self.surface)
        q_K = every / body.stiffness(every, 0.0)
        C = q_K[:-1] / q_K[-1] - 1
        if C.size and (largest := np.abs(C).max()) > _NOTHING:
            beyond, begins = abs(C[-1]) / largest, np.ptp(C[:_FIRST]) / largest
            if beyond > _BEYOND or begins > _BEGINS:
                raise ArithmeticError("the nodes do not resolve the body")
        return float(q_K[-1]), C


def find_nodes(body: Body, reach: float) -> WaveNodes:
    """Return the nodes for contacts up to a radius; ValueError if the body does not support a load."""
    features = find_features(body, reach)
    return WaveNodes(reach, features.surface, *panels(features, reach), features.last)


def equilibria(local: float, C: FloatArray, nodes: WaveNodes, profile: Revolution) -> Equilibria:
    """Return the contacts of an elastic body of D = `local`, and of C/D at the nodes."""
    reach = min(nodes.reach, profile.rim)
    if not C.any():
        return halfspace(local, profile, reach)
    phase = nodes.q[np.abs(C) > _MATTERS * np.abs(C).max()].max() * reach
    weighted = 2 / math.pi * nodes.weights * C
    x, w = gauss_rule(_ORDER + math.ceil(phase / 3))
    x, w = (x + 1) / 2, w / 2
    kinks = profile.knots[(profile.knots > 0) & (profile.knots < reach)]
    ends = [0.0, *(kinks.tolist() if kinks.size <= _MOST_KNOTS else []), reach]
    panels, relative = [], bool(abel_transforms(profile, np.array([1e-9 * reach]))[0][0] > 0)
    for begin, end in pairwise(ends):
        order = _ORDER + math.ceil(_PER_PHASE * phase * (end - begin) / reach)
        angles = np.pi * (np.arange(order) + 0.5) / order
        t = (1 - np.cos(angles)) / 2
        places = begin + (end - begin) * (t**2 if begin else t)
        rows = np.array([_solved(nodes.q, weighted, profile, place, x, w) for place in places.tolist()])
        if relative:
            H, _, integral = abel_transforms(profile, places)
            rows[:, 0], rows[:, 1] = np.log1p(rows[:, 0] / H), np.log1p(rows[:, 1] / (places * H - integral))
        basis = chebyshev.chebvander(2 * t - 1, order - 1)
        norms = np.where(np.arange(order) == 0, 1.0, 2.0) / order
        coefficients = norms[:, np.newaxis] * (basis.T @ rows)
        panels.append(_Panel(begin, end - begin, coefficients, chebyshev.chebder(coefficients, scl=2)))
    return Equilibria(local, profile, reach, tuple(panels), relative)


def halfspace(local: float, profile: Revolution, reach: float) -> Equilibria:
    """Return the contacts of a halfspace, (1 - nu)/G = `local`."""
    reach = min(reach, profile.rim)
    return Equilibria(
        local, profile, reach, (_Panel(0.0, reach, np.zeros((1, 4)), np.zeros((0, 4))),), relative=False
    )


def _solved(
    q: FloatArray, C: FloatArray, profile: Revolution, a: float, x: FloatArray, w: FloatArray
) -> tuple[float, float, float, float]:
    """Return depth, force/4, ln k and ln e at a radius, for D = 1, less the values of the halfspace.

    Of chi = depth - H + rest the rest is smooth, also where the profile is not.
    """
    root = np.sqrt(a * w)
    weighted = root[:, np.newaxis] * np.cos(np.outer(a * x, q))
    y, v = _pieces(profile, a, x, w)
    H = abel_transforms(profile, np.append(y, a))[0]
    edge = np.cos(a * q) * C
    loads = np.stack((weighted.T @ root, (v * H[:-1]) @ np.cos(np.outer(y, q))))  # X of 1 and of H
    matrix = np.eye(x.size) + (weighted * C) @ weighted.T
    rest = np.linalg.solve(matrix, -(weighted * C) @ loads.T).T
    ends = -(loads + rest @ weighted) @ edge
    e, h = 1 + ends[0], H[-1] + ends[1]
    unit, pressed = a + rest[0] @ root, float(v @ H[:-1]) + rest[1] @ root
    depth = h / e
    force = depth * unit - pressed - (a * H[-1] - float(v @ H[:-1]))
    return depth - H[-1], force, math.log(unit / a), math.log(e)


def _pieces(profile: Revolution, a: float, x: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights on [0, a], in parts between the kinks of the profile."""
    ends = np.append(profile.knots[profile.knots < a], a)
    if ends.size == 1 or profile.knots.size > _MOST_KNOTS:
        ends = np.array([0.0, a])
    # x^2 resolves the root of the distance from a kink.
    lengths = np.diff(ends)[:, np.newaxis]
    return (ends[:-1, np.newaxis] + lengths * x**2).ravel(), (lengths * 2 * x * w).ravel()
