"""The response of a body under a prescribed quantity in steps of time.

A fit chooses the times of the solution once, so that the response depends smoothly on the parameters:
between two corners of the prescribed quantity the times are fixed fractions of the piece, or of its rest
after first contact. They are denser where the response bends, which evens out the errors of interpolation
(de Boor 1973) and of the solution.

The base of a cantilever is at depth + F/k. With F = 4 X(0), the spring is a further compliance
of the body at q = 0, and the base takes the place of the depth.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.fitting.force_curve import Correction, ForceCurve, Pieces, Setup
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.indentation.compliance import Compliance
from gfmdlayer.indentation.solve import (
    Edge,
    History,
    LeftGridError,
    Space,
    find_space,
    halved,
    make_space,
    on_halved_steps,
    on_steps,
)

STEPS = 48  # of a mesh, STICKING with adhesion; each piece has at least FEWEST
STICKING = 56
FEWEST = 2
TRIAL = 10  # even steps in each piece for the first solution, which shows where the response bends
PER_DECADE = 4  # further ones after each breakpoint, down to a part of the spacing of rows: fast relaxation
SHORTEST = 0.1  # of the spacing of rows
WIDER = 1.3  # factor by which the nodes are extended when a contact grows beyond them
LOCATED = 3e-4  # part of a step within which the loss of a contact with adhesion is located
KEPT = 8  # compliances and responses: as many as the derivatives to all parameters of one body need
SNAP = 1e-3, 0.1, 0.4  # further times in the first step, where the depth jumps at first contact
EVEN = 0.3  # fraction of the steps that is spread evenly over the time


class SteppedResponse(NamedTuple):
    """The response at the times of a mesh, from the first contact on, and the losses of contact."""

    time: FloatArray
    force: FloatArray
    depth: FloatArray
    lost: FloatArray  # (losses, 4): time, force before it and a row before it, prescribed position

    @property
    def jumps(self) -> list[float]:
        """The forces where contact begins, which is below noise, and where it is lost, as rows see it."""
        return [0.0, float(self.lost[-1, 2] if self.lost.size else self.force.min(initial=0.0))]

    def end(self, time: float) -> float:
        """Return the prescribed position at the loss of contact next to a time; far away without one."""
        if not self.lost.size:
            return -float(self.depth.max(initial=0.0))
        return float(self.lost[np.argmin(np.abs(self.lost[:, 0] - min(time, self.time[-1]))), 3])


class SteppedContact:
    """Responses of the bodies of one curve; times and nodes stay until the contact leaves the nodes."""

    def __init__(self, curve: ForceCurve) -> None:
        self.changes = 0  # of times and nodes
        self._curve = curve
        self._parts: list[FloatArray] | None = None
        self._space: Space | None = None
        self._made: list[tuple[Setup, Space, Compliance]] = []  # the last ones
        self._courses: list[tuple[tuple[object, ...], Pieces, SteppedResponse]] = []  # the last ones

    def adapt(self, setup: Setup, at: Correction, pieces: Pieces) -> None:
        """Choose the times by the bends of the response, and the nodes by the lengths of the body."""
        self._space, self.changes = None, self.changes + 1
        self._parts = self._trial(pieces)
        times, force, depth, *_ = (each[_snaps(at, pieces) :] for each in self.course(setup, at, pieces))
        if times.size > 2 and np.ptp(force) > 0:
            steps = STICKING if at.adhesion.work else STEPS
            self._parts = _graded(times, force, depth, pieces, setup.onset, steps)

    def response(
        self,
        setup: Setup,
        at: Correction,
        pieces: Pieces,
        touching: BoolArray | None = None,
        rough: bool = False,
    ) -> tuple[FloatArray, FloatArray]:
        """Return force and depth of the indenter at the rows; `rough` for differences, see `course`.

        In rows `touching` after a loss of contact the force is that a row before it; in others it is zero.
        """
        rows = self._curve.time
        times, force, depth, lost = self.course(setup, at, pieces, rough)
        value, by_force = pieces.at(rows)
        sticks = at.adhesion.work > 0
        forces = np.where(by_force, value if sticks else np.maximum(value, 0.0), 0.0)
        depths = np.zeros(rows.size)
        edges = [times[0], *(time for time in pieces.breakpoints if time > times[0])]
        for first, last in pairwise(edges):
            inside = (rows >= first) & (rows <= last)
            nodes = (times >= first) & (times <= last)
            nodes[0] &= not _snaps(at, pieces)
            # The prescribed quantity needs no interpolation.
            if (free := inside & ~by_force).any():
                if sticks:
                    within = lost[(lost[:, 0] > first) & (lost[:, 0] <= last)]
                    forces[free] = _with_losses(times[nodes], force[nodes], rows[free], within)
                else:
                    forces[free] = _until_it_opens(times[nodes], force[nodes], rows[free], setup.onset)
            if (held := inside & by_force).any():
                power = 1.0 if sticks else setup.onset
                depths[held] = _as_power(times[nodes], depth[nodes], rows[held], power)
        if touching is not None:
            after = np.searchsorted(lost[:, 0], rows, side="left")
            before = np.append(0.0, lost[:, 2])[after]
            forces = np.where(
                by_force, forces, np.where(touching, np.where(forces == 0, before, forces), 0.0)
            )
        away = forces / at.stiffness if self._curve.by_base else 0.0
        return forces, np.where(by_force, depths, value - away)

    def course(self, setup: Setup, at: Correction, pieces: Pieces, rough: bool = False) -> SteppedResponse:
        """Return the response from the first contact on.

        A `rough` one has an error of second order in the step, of which differences are nearly free.
        """
        key = setup, self._parts, at, rough
        for (*same, known, exact), there, course in self._courses:
            equal = same[0] is setup and same[1] is self._parts and (known, exact) == (at, rough)
            if equal and all(map(np.array_equal, there, pieces)):
                return course
        response = self._course(setup, at, pieces, rough)
        self._courses = [(key, pieces, response), *self._courses[: 2 * KEPT - 1]]
        return response

    def _course(self, setup: Setup, at: Correction, pieces: Pieces, rough: bool) -> SteppedResponse:
        times = _mesh(pieces, self._parts or self._trial(pieces))
        if _snaps(at, pieces):
            times = np.insert(times, 1, times[0] + np.array(SNAP) * (times[1] - times[0]))
        both = halved(times)
        history = History(both, *pieces.at(both))
        if not history.value.max() > 0:
            return SteppedResponse(times, np.zeros(times.size), np.zeros(times.size), np.zeros((0, 4)))
        edge = Edge(at.adhesion.work)
        while True:
            space = self._space = self._space or self._find_space(setup, at, pieces, edge)
            try:
                made = self._compliance(setup, space)
                if self._curve.by_base:
                    space, made = with_spring(space, made, at.stiffness)
                if rough:
                    solution = on_steps(made, space, setup.profile, history, times, edge, None, LOCATED)
                else:
                    solution = on_halved_steps(
                        made, space, setup.profile, history, times, None, edge, LOCATED
                    )
            except LeftGridError:
                reach = min(WIDER * self._space.nodes.reach, setup.profile.rim)
                self._space, self.changes = make_space(self._space.features, reach), self.changes + 1
            except ArithmeticError as error:
                raise FitError(f"curve {self._curve.name}: {error}") from error
            else:
                force, depth = (each if rough else each[::2] for each in (solution.force, solution.depth))
                depth = depth - force / at.stiffness if self._curve.by_base else depth
                lost = np.zeros((0, 2)) if solution.lost is None else solution.lost
                # The contact shrinks fast before it is lost: rows see the jump from the force a row before.
                seen = lost[:, 0] - np.median(np.diff(self._curve.time))
                seen = _with_losses(times, force, seen, lost)
                return SteppedResponse(
                    times, force, depth, np.column_stack((lost, seen, pieces.at(lost[:, 0])[0]))
                )

    def _trial(self, pieces: Pieces) -> list[FloatArray]:
        """Return fractions of the pieces, even ones and after each breakpoint short ones.

        A relaxation that is fast beside a piece bends the response after its beginning only.
        """
        first, begin = pieces.first_contact
        shortest, parts = SHORTEST * float(np.min(np.diff(self._curve.time))), []
        for piece, (start, end) in enumerate(zip(pieces.begin.tolist(), pieces.end.tolist(), strict=True)):
            start = begin if piece == first else start
            fractions = np.linspace(0, 1, TRIAL + 1)
            if piece == first or np.isclose(start, pieces.breakpoints).any():
                least = min(shortest / max(end - start, shortest), fractions[1])
                count = math.floor(PER_DECADE * math.log10(fractions[1] / least))
                short = np.geomspace(least, fractions[1], count, endpoint=False)
                fractions = np.concatenate((fractions[:1], short, fractions[1:]))
            parts.append(fractions)
        return parts

    def _compliance(self, setup: Setup, space: Space) -> Compliance:
        for known, nodes, made in self._made:
            if known is setup and nodes is space:
                return made
        made = space.compliance(setup.body)
        self._made = [(setup, space, made), *self._made[: KEPT - 1]]
        return made

    def _find_space(self, setup: Setup, at: Correction, pieces: Pieces, edge: Edge) -> Space:
        """Return the nodes for the largest contact of each prescribed quantity."""
        found = []
        for by_force in (False, True):
            largest = max(pieces.largest(by_force), 0.0)
            if not by_force and self._curve.by_base:
                largest = min(largest, float(np.max(self._curve.depth)) - at.contact_point)
            if largest > 0:
                ends = History(np.array([0.0, 1.0]), np.array([0.0, largest]), by_force)
                found.append(find_space(setup.body, setup.profile, ends, adhesion=edge))
        if not found:
            none = History(np.array([0.0, 1.0]), np.zeros(2))
            return find_space(setup.body, setup.profile, none)
        return max(found, key=lambda space: space.nodes.reach)


def with_spring(space: Space, body: Compliance, stiffness: float) -> tuple[Space, Compliance]:
    """Return a space with the node q = 0, and the body with a spring of this stiffness there.

    (2/pi) C X(0) = F/stiffness for the weight 1, with F = 4 X(0).
    """
    cosines = np.column_stack((space.nodes.cosines, np.ones(space.nodes.cosines.shape[0])))
    q, weights = np.append(space.q, 0.0), np.append(space.weights, 1.0)
    rigid = np.zeros((body.modes.shape[0], 1))
    with_spring = body._replace(
        q=q,
        weights=weights,
        instant=np.append(body.instant, 2 * math.pi / stiffness),
        modes=np.hstack((body.modes, rigid)),
        times=np.hstack((body.times, rigid + 1.0)),
    )
    return space._replace(q=q, weights=weights, nodes=space.nodes._replace(cosines=cosines)), with_spring


def _snaps(at: Correction, pieces: Pieces) -> bool:
    """Whether the depth jumps from zero where contact begins."""
    return at.adhesion.work > 0 and bool(pieces.by_force[pieces.first_contact[0]])


def _mesh(pieces: Pieces, parts: list[FloatArray]) -> FloatArray:
    """Return the times of a mesh, from the first contact on."""
    first, begin = pieces.first_contact
    times = []
    for piece in range(first, len(parts)):
        end = pieces.end[piece]
        times.append(begin + (end - begin) * parts[piece][:-1])
        begin = end
    return np.append(np.concatenate(times), pieces.end[-1])


def _as_power(times: FloatArray, values: FloatArray, rows: FloatArray, power: float) -> FloatArray:
    """Interpolate values^power, which is smooth where the contact begins."""
    raised = np.maximum(values, 0.0) ** power
    if times.size < 2 or not rows.size:
        return np.full(rows.size, values[0] if values.size else 0.0)
    return np.asarray(np.maximum(PchipInterpolator(times, raised)(rows), 0.0) ** (1 / power))


def _with_losses(times: FloatArray, force: FloatArray, rows: FloatArray, lost: FloatArray) -> FloatArray:
    """Interpolate a force with adhesion up to each loss of contact, and between it and the next contact."""
    values, begin = np.zeros(rows.size), -math.inf
    for end, last in [*lost[:, :2].tolist(), [math.inf, 0.0]]:
        nodes = (times > begin) & (times < end)
        x, y = times[nodes], force[nodes]
        if math.isfinite(begin):  # free until the next contact
            touched = int(np.argmax(y != 0)) if (y != 0).any() else y.size
            x, y = x[max(touched - 1, 0) :], y[max(touched - 1, 0) :]
        if math.isfinite(end):
            x, y = np.append(x, end), np.append(y, last)
        inside = (rows > begin) & (rows <= end) & (rows >= x[0] if x.size else False)
        if inside.any():
            values[inside] = PchipInterpolator(x, y)(rows[inside]) if x.size > 1 else y[0]
        begin = end
    return values


def _until_it_opens(times: FloatArray, force: FloatArray, rows: FloatArray, power: float) -> FloatArray:
    """Interpolate F^(1/power), which is smooth where the contact begins, until the contact opens.

    From the last two times in contact, it is extended linearly to zero, at most to the next time. So the
    result stays continuous when a further time gets a small contact force.
    """
    root = np.maximum(force, 0.0) ** (1 / power)
    touching = np.flatnonzero(root > 0)
    if touching.size < 2:
        return np.asarray(np.interp(rows, times, force)) if times.size else np.zeros(rows.size)
    last = int(touching[-1])
    if last < times.size - 1 and root[last] < root[last - 1]:
        pace = (root[last - 1] - root[last]) / (times[last] - times[last - 1])
        leaves = min(times[last] + root[last] / pace, times[last + 1])
        times, root = np.append(times[: last + 1], leaves), np.append(root[: last + 1], 0.0)
    inside = rows <= times[-1]
    values = np.zeros(rows.size)
    values[inside] = np.maximum(PchipInterpolator(times, root)(rows[inside]), 0.0) ** power
    return values


def _graded(
    times: FloatArray, force: FloatArray, depth: FloatArray, pieces: Pieces, power: float, most: int
) -> list[FloatArray]:
    """Return the fractions of each piece at which the error of interpolation is even."""
    first, begin = pieces.first_contact
    by_force = pieces.at(times[1:])[1]
    straight = np.maximum(force, 0.0) ** (1 / power), np.maximum(depth, 0.0) ** power
    slopes = [np.diff(each) / np.diff(times) / max(float(np.ptp(each)), 1e-300) for each in straight]
    slope = np.where(by_force, slopes[1], slopes[0])
    bend = np.abs(np.diff(slope)) / (times[2:] - times[:-2])
    bend[np.isin(times[1:-1], pieces.end)] = 0.0  # a corner of the prescribed quantity is a node
    bend = np.concatenate((bend[:1], bend, bend[-1:]))
    density = np.sqrt(np.maximum(bend[1:], bend[:-1]))
    density += EVEN * np.sum(density * np.diff(times)) / np.ptp(times) + 1e-300
    level = np.concatenate(([0.0], np.cumsum(density * np.diff(times))))
    parts = [np.linspace(0, 1, FEWEST + 1)] * pieces.end.size
    for piece in range(first, len(parts)):
        end = pieces.end[piece]
        low, high = np.interp([begin, end], times, level)
        steps = max(FEWEST, round(most * (high - low) / level[-1]))
        inner = np.interp(np.linspace(low, high, steps + 1), level, times)
        parts[piece] = np.clip((inner - begin) / (end - begin), 0.0, 1.0)
        parts[piece][[0, -1]] = 0.0, 1.0
        begin = end
    return parts
