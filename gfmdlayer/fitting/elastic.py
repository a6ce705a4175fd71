"""Curves on an elastic body: responses without steps in time, and adhesion with its jumps.

The only history of an elastic body is whether the indenter touches. Without adhesion the response at a row
follows from the prescribed value there (`gfmdlayer.indentation.equilibrium`). With adhesion contact begins at
the first touch and ends below a least prescribed value; at both the force jumps. The sum of squares would
jump with it whenever a jump passes a row. So a fit takes the rows in contact from the measurement: in each
approach and each retraction, the rows whose residuals are smaller in contact. The response at these rows is
computed in contact; beyond the end of the stable contacts it is the response of the last one. So the residual
is continuous in the parameters. Rows next to the end of contact, where its place is uncertain and the force
may fall vertically, do not count. The places of the jumps are data of their own: the prescribed value half
way between the rows on both sides, with the error

    spread^2 = spacing^2 (1/12 + 26 (noise/jump)^4)

The first term is the uniform distribution between two rows, the second the variance of a change point in
noise (Yao, Ann. Stat. 15 (1987) 1321). Far from it, each row on the wrong side adds (jump/noise)^2: from the
distance (jump/noise)^2 spread^2/(2 spacing) on, the square of the residual grows linearly. The error of the
prescribed value is common to jumps and rows, and enters the covariance of all residuals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal, NamedTuple, Protocol

import numpy as np
from pydantic import ValidationError
from scipy.optimize import brentq

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.body.body import Body
from gfmdlayer.config import ConfigError
from gfmdlayer.fitting.force_curve import Correction, ForceCurve, Pieces, Setup, noise_of
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.indentation.equilibrium import (
    BY_DEPTH,
    BY_FORCE,
    Control,
    EdgeAdhesion,
    Equilibria,
    StableContacts,
    WaveNodes,
    by_base,
    equilibria,
    find_nodes,
    halfspace,
    touches,
)
from gfmdlayer.validation.fields import Positive
from gfmdlayer.validation.sections import Kind, OneOf, Section

CHANGE = 26.0  # variance of a change point, over the fourth power of noise/jump and the square of the spacing
LEAST_JUMP = 0.5  # of the noise: a smaller jump is not seen
NEAR = 3.0  # spreads of a jump before which rows in contact do not count
WIDER_ELASTIC = 1.5  # factor by which the nodes are extended when a contact grows beyond them
KEPT_TABLES = 3
FAR = 1e8  # see `gfmdlayer.indentation.solve`
MOST_PHASE = 300.0  # contact radius times the last wavenumber of the layers: some twelve thicknesses
WIDER_BEGIN = 3.0  # the same at the begin of a search, less so that the begin is never refused in it


class JKR(Kind):
    """Adhesion of short range: Johnson, Kendall and Roberts."""

    model: Literal["jkr"] = "jkr"
    """adhesion at the edge of the contact"""
    work: Positive
    """work of adhesion: pressure length"""


class DMT(Kind):
    """Adhesion of long range: Derjaguin, Muller and Toporov."""

    model: Literal["dmt"] = "dmt"
    """a constant attraction, which does not deform the body"""
    force: Positive
    """attraction: force"""


class _AdhesionHolder(Section):
    adhesion: Annotated[JKR | DMT, OneOf({"jkr": JKR, "dmt": DMT})]


NO_ADHESION, CHOOSE = "none", "choose"
KINDS: Mapping[str, str] = {"jkr": "work", "dmt": "force"}  # and their parameters


def read_adhesion(data: object) -> dict[str, str | float]:
    """Return the section `adhesion` of a model; ConfigError with every error."""
    try:
        return dict(_AdhesionHolder.model_validate({"adhesion": data}).adhesion.model_dump())
    except ValidationError as error:
        problems = _AdhesionHolder.all_problems({"adhesion": data}, error)
        raise ConfigError(map(str, problems)) from None


def adhesion_of(section: Mapping[str, str | float] | None) -> EdgeAdhesion:
    """Return the adhesion that a section `adhesion` describes."""
    return EdgeAdhesion(**{key: float(value) for key, value in (section or {}).items() if key != "model"})


class Jump(NamedTuple):
    """A place where a measured force jumps, between two rows."""

    row: int  # the row after it
    begins: bool  # whether contact begins there
    spread: float  # standard deviation of the prescribed value there, without the error of that value
    certain: float  # that of a jump that is certainly between the two rows
    bound: float  # number of spreads from which the square of the residual grows linearly


@dataclass(frozen=True)
class Contacts:
    """The stable contacts of a body: of a prescribed position, and of a prescribed force."""

    equilibria: Equilibria
    control: Control  # of the position
    adhesion: EdgeAdhesion

    @cached_property
    def position(self) -> StableContacts:
        """The contacts under a prescribed depth or base."""
        return self.equilibria.branch(self.control, self.adhesion)

    @cached_property
    def force(self) -> StableContacts:
        """The contacts under a prescribed force."""
        return self.equilibria.branch(BY_FORCE, self.adhesion)

    @property
    def jumps(self) -> list[float]:
        """The forces where contact begins and ends under a prescribed position."""
        return self.position(np.array([0.0, self.position.end]))[1].tolist()  # type: ignore[no-any-return]

    def end(self, time: float) -> float:  # noqa: ARG002
        """Return the prescribed position at which contact is lost, at any time."""
        return self.position.end

    def of(self, value: FloatArray, by_force: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return depth and force in contact at prescribed values, each of the shape of `value`."""
        depth, force = np.zeros(value.size), np.zeros(value.size)
        for name, rows in (("position", ~by_force), ("force", by_force)):
            if rows.any():
                depth[rows], force[rows], _ = getattr(self, name)(value[rows])
        return depth, force

    def touching(self, value: FloatArray, by_force: BoolArray) -> BoolArray:
        """Whether there is contact at successive values."""
        end = self.force.end if by_force.any() else 0.0
        return touches(value, np.where(by_force, end, 0.0 if by_force.all() else self.position.end))


def measured_contact(
    value: FloatArray, by_force: BoolArray, worse: FloatArray, unseen: Sequence[float | None] = (None, None)
) -> BoolArray:
    """Return the rows in contact, from the squares of their residuals in contact less those without.

    Each stretch at positive values has contact at its largest value. Between two of these, before the first,
    and after the last, one stretch of rows may be without contact; none where the force is prescribed. Where
    the noise hides a jump there is contact from a value on, `unseen` in approach and in retraction.
    """
    touching = np.ones(value.size, dtype=bool)
    above = np.flatnonzero((value > 0) | by_force)
    if not above.size:
        return ~touching
    stretches = np.split(above, np.flatnonzero(np.diff(above) > 1) + 1)
    peaks = [int(stretch[np.argmax(value[stretch])]) for stretch in stretches]
    valleys = [
        first + int(np.argmin(value[first : max(last, first + 1)]))
        for first, last in zip([0, *peaks], [*peaks, value.size], strict=True)
    ]
    worse = np.where(by_force, -np.inf, worse)
    for valley, peak in zip(valleys, peaks, strict=False):  # approaches
        start = 0 if valley == valleys[0] else valley
        gain = np.concatenate(([0.0], np.cumsum(worse[start:peak])))
        touching[start : start + int(np.argmax(gain))] = False
        if unseen[0] is not None:
            rounding = 1e-12 * float(np.abs(value).max())  # a row at the surface itself is not in contact yet
            touching[start:peak] = (value[start:peak] > unseen[0] + rounding) | by_force[start:peak]
    for peak, valley in zip(peaks, valleys[1:], strict=True):  # retractions
        end = value.size if valley == valleys[-1] else valley
        gain = np.concatenate(([0.0], np.cumsum(worse[peak + 1 : end][::-1])))
        touching[end - int(np.argmax(gain)) : end] = False
        if unseen[1] is not None:
            touching[peak + 1 : end] = (value[peak + 1 : end] >= unseen[1]) | by_force[peak + 1 : end]
    return touching


def jumps_between(
    touching: BoolArray, by_force: BoolArray, used: BoolArray, value: FloatArray, sizes: Sequence[float]
) -> list[Jump]:
    """Return the jumps between rows of a prescribed position.

    `sizes`: the jumps where contact begins and where it ends, over the noise of the force.
    """
    jumps = []
    for row in np.flatnonzero(touching[1:] != touching[:-1]) + 1:
        pair = slice(row - 1, row + 1)
        jump = sizes[0] if touching[row] else sizes[1]
        if by_force[pair].any() or not used[pair].all() or jump < LEAST_JUMP:
            continue
        spacing = abs(float(value[row] - value[row - 1]))
        certain = spacing / 12**0.5
        spread = spacing * (1 / 12 + CHANGE / jump**4) ** 0.5
        if certain > 0:
            bound = jump**2 * spread / (2 * spacing)
            jumps.append(Jump(int(row), bool(touching[row]), spread, certain, bound))
    return jumps


class Jumping(Protocol):
    """A contact that jumps: `Contacts`, or the response of a body that relaxes."""

    @property
    def jumps(self) -> list[float]:
        """The forces where contact begins, and before it is lost."""

    def end(self, time: float) -> float:
        """Return the prescribed position at which contact is lost, of several the one next to a time."""


class Touch:
    """The rows of a curve in contact, and the places of its jumps, as measured where there is adhesion."""

    def __init__(self, rows: int) -> None:
        self.touching: BoolArray | None = None  # None: by the model
        self.jumps: list[Jump] = []
        self.uncertain = np.zeros(rows, dtype=bool)  # rows in contact next to its end

    def find(
        self, curve: ForceCurve, used: BoolArray, contacts: Jumping, pieces: Pieces, own: float,
        worse: FloatArray, error: Callable[[int], float],
    ) -> None:  # fmt: skip
        """Take rows and jumps from the measurement.

        `own` measured forces are one of the model; `worse` are squares of residuals in contact less those
        without, `error` is the standard error of the prescribed value before a row.
        """
        value, by_force = pieces.at(curve.time)
        noise = max(curve.noise or noise_of(curve.force), 1e-12 * float(np.ptp(curve.force)))
        sizes = [abs(own * force) / noise for force in contacts.jumps]
        ends = (0.0, contacts.end(math.inf))
        hidden = [end if size < LEAST_JUMP else None for end, size in zip(ends, sizes, strict=True)]
        self.touching = measured_contact(value, by_force, worse, hidden)
        self.jumps = []
        for jump in jumps_between(self.touching, by_force, used, value, sizes):
            pair = slice(jump.row - 1, jump.row + 1)
            whole = math.hypot(jump.spread, error(jump.row))
            self.jumps.append(jump._replace(bound=jump.bound * whole / jump.spread))
            if not jump.begins:
                falls = np.diff(value[: jump.row]) < 0
                before = slice(int(np.flatnonzero(~falls)[-1]) + 1 if not falls.all() else 0, jump.row)
                near = value[before] < value[pair].mean() + NEAR * whole
                self.uncertain[before] |= self.touching[before] & near

    def places(self, curve: ForceCurve, contacts: Jumping, pieces: Pieces) -> FloatArray:
        """Return the places of the jumps, predicted less measured, over their errors; shape (jumps,)."""
        residuals = []
        for jump in self.jumps:
            times = curve.time[jump.row - 1 : jump.row + 1]
            end = 0.0 if jump.begins else contacts.end(float(times.mean()))
            away = (end - float(np.mean(pieces.at(times)[0]))) / jump.spread
            # Each further row adds the square of the jump over the noise.
            far = max(abs(away) - jump.bound, 0.0)
            residuals.append(math.copysign(math.sqrt(max(away**2 - far**2, 0.0)), away))
        return np.array(residuals)

    @property
    def doubt(self) -> float:
        """Twice the logarithm of the part that one row has in the distributions of the jumps."""
        return 2 * sum(math.log(jump.spread / jump.certain) for jump in self.jumps)


class ElasticContact:
    """Contacts of the elastic bodies of one curve; nodes and tables serve similar bodies."""

    def __init__(self, curve: ForceCurve) -> None:
        self.changes = 0  # of the nodes
        self._curve = curve
        self._nodes: WaveNodes | None = None
        self._tables: list[tuple[WaveNodes, FloatArray, Equilibria]] = []
        self._known: list[tuple[Setup, Correction, Contacts]] = []  # the last two

    def adapt(self, setup: Setup, at: Correction, pieces: Pieces) -> None:
        """Choose the nodes by the lengths of the body; FitError if the contact is very wide."""
        self._nodes, self._known, self.changes = None, [], self.changes + 1
        self.contacts(setup, at, pieces, WIDER_BEGIN * MOST_PHASE)

    def response(
        self, setup: Setup, at: Correction, pieces: Pieces, touching: BoolArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return force and depth at the rows, in contact where the rows are `touching`."""
        rows, contacts = self._curve.time, self.contacts(setup, at, pieces)
        value, by_force = pieces.at(rows)
        if touching is None:
            times = np.union1d(rows, pieces.end)
            touching = contacts.touching(*pieces.at(times))[np.searchsorted(times, rows)]
        depth, force = contacts.of(value, by_force)
        return np.where(touching, force, 0.0), np.where(touching, depth, np.where(by_force, 0.0, value))

    def contacts(
        self, setup: Setup, at: Correction, pieces: Pieces, most_phase: float = MOST_PHASE
    ) -> Contacts:
        """Return the stable contacts up to the largest prescribed values."""
        for known, same, made in self._known:
            if known is setup and same == at:
                return made
        position = by_base(at.stiffness) if self._curve.by_base else BY_DEPTH
        most = [(control, pieces.largest(control is BY_FORCE)) for control in (position, BY_FORCE)]
        reach = self._nodes.reach if self._nodes else self._first_reach(setup, at.adhesion, most)
        while True:
            try:
                if self._nodes is None or self._nodes.reach != reach:
                    self._nodes = self._find_nodes(setup.body, reach, most_phase)
                solved = self._equilibria(setup)
            except ArithmeticError:  # the lengths of the body have changed much
                self._nodes, self.changes = self._find_nodes(setup.body, reach, most_phase), self.changes + 1
                try:
                    solved = self._equilibria(setup)
                except ArithmeticError as error:
                    raise FitError(f"curve {self._curve.name}: {error}") from error
            if all(solved.largest(control, at.adhesion) >= value for control, value in most):
                break
            reach *= WIDER_ELASTIC
        contacts = Contacts(solved, position, at.adhesion)
        self._known = [(setup, at, contacts), *self._known[:1]]
        return contacts

    def _find_nodes(self, body: Body, reach: float, most_phase: float) -> WaveNodes:
        try:
            nodes = find_nodes(body, reach)
        except ValueError as error:
            raise FitError(f"curve {self._curve.name}: {error}") from error
        if nodes.last * reach > most_phase:
            raise FitError(
                f"curve {self._curve.name}: the contact is more than some twelve times as wide as the "
                "thinnest layer is thick; must be less with adhesion"
            )
        return nodes

    def _equilibria(self, setup: Setup) -> Equilibria:
        assert self._nodes is not None
        local, C = self._nodes.compliance(setup.body)
        for nodes, known, table in self._tables:
            similar = nodes is self._nodes and np.allclose(C, known, rtol=1e-12, atol=1e-14)
            if similar and np.array_equal(np.hstack(table.profile), np.hstack(setup.profile)):
                return replace(table, local=local)
        found = equilibria(local, C, self._nodes, setup.profile)
        self._tables = [(self._nodes, C, found), *self._tables[:KEPT_TABLES]]
        return found

    def _first_reach(
        self, setup: Setup, adhesion: EdgeAdhesion, most: Sequence[tuple[Control, float]]
    ) -> float:
        """Return the contact radius on a halfspace of the surface's material, within a factor of two."""
        reach = float(np.ptp(self._curve.depth))
        while True:
            far = FAR / reach
            local = far / float(setup.body.stiffness(np.array([far]), 0.0)[0])
            half = halfspace(local, setup.profile, reach)
            if half.reach < reach or all(half.largest(control, adhesion) >= value for control, value in most):
                return half.reach
            reach *= 2


def work_for(pull: float, made: Equilibria) -> float:
    """Return JKR's work of adhesion with which a contact is lost at a tensile force."""

    def excess(logarithm: float) -> float:
        end = made.branch(BY_FORCE, EdgeAdhesion(math.exp(logarithm))).end
        return math.log(max(-end / pull, 1e-300))

    # The pull grows with the work by a power between 1/2 (flat punch) and 1 (paraboloid), or around it.
    low = high = 0.0
    while excess(low) > 0:
        low -= 5.0
    while excess(high) < 0:
        high += 5.0
    return math.exp(brentq(excess, low, high, xtol=1e-3)) if low < high else 1.0
