"""Curves on an elastic body: responses without steps in time, and adhesion with its jumps.

An elastic body has no history but one: whether the indenter touches. Without adhesion the response at a row
follows from the prescribed value there (`gfmdlayer.indentation.equilibrium`). With adhesion contact begins at
the first touch and ends below a least value of what is prescribed; at both the force jumps. The sum of
squares would jump with it whenever a jump passes a row. So a fit takes the rows in contact from the
measurement: in each approach and each retraction, the rows whose residuals are smaller in contact. In these
rows the response is that of contact, beyond the end of the stable contacts that of the last one; the residual
is continuous in the parameters. Rows next to the end of contact, where its place is uncertain and the force
may fall vertically, do not count. The places of the jumps are data of their own: the prescribed value half
way between the rows on both sides, with the error

    spread^2 = spacing^2 (1/12 + 26 (noise/jump)^4) + error^2 of the prescribed value

The first term is the uniform distribution between two rows, the second that of a change point in noise (Yao,
Ann. Stat. 15 (1987) 1321).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import ValidationError

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.config import ConfigError
from gfmdlayer.indentation.equilibrium import BY_FORCE, Adhesion, Branch, Control, Equilibria, touches
from gfmdlayer.validation.fields import Positive
from gfmdlayer.validation.sections import Kind, OneOf, Section

CHANGE = 26.0  # variance of a change point, over the fourth power of noise/jump and the square of the spacing
LEAST_JUMP = 0.5  # of the noise: a smaller jump is not seen
NEAR = 3.0  # spreads of a jump before which rows in contact do not count


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


class _Holder(Section):
    adhesion: Annotated[JKR | DMT, OneOf({"jkr": JKR, "dmt": DMT})]


NO_ADHESION, CHOOSE = "none", "choose"
KINDS: Mapping[str, str] = {"jkr": "work", "dmt": "force"}  # and their parameters


def read_adhesion(data: object) -> dict[str, str | float]:
    """Return the section `adhesion` of a model; ConfigError with every error."""
    try:
        return dict(_Holder.model_validate({"adhesion": data}).adhesion.model_dump())
    except ValidationError as error:
        found = _Holder.all_problems({"adhesion": data}, error)
        raise ConfigError(map(str, found)) from None


def adhesion_of(section: Mapping[str, str | float] | None) -> Adhesion:
    """Return the adhesion that a section `adhesion` describes."""
    values = {} if section is None else {key: float(section[key]) for key in KINDS.values() if key in section}
    return Adhesion(**values)


class Jump(NamedTuple):
    """A place where a measured force jumps, between two rows."""

    row: int  # the row after it
    begins: bool  # whether contact begins there
    spread: float  # standard deviation of the prescribed value there
    certain: float  # that of a jump that is certainly between the two rows


@dataclass(frozen=True)
class Contacts:
    """The stable contacts of a body: of a prescribed position, and of a prescribed force."""

    equilibria: Equilibria
    control: Control  # of the position
    adhesion: Adhesion

    @cached_property
    def position(self) -> Branch:
        """The contacts under a prescribed depth or base."""
        return self.equilibria.branch(self.control, self.adhesion)

    @cached_property
    def force(self) -> Branch:
        """The contacts under a prescribed force."""
        return self.equilibria.branch(BY_FORCE, self.adhesion)

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
    found = np.ones(value.size, dtype=bool)
    above = np.flatnonzero((value > 0) | by_force)
    if not above.size:
        return ~found
    stretches = np.split(above, np.flatnonzero(np.diff(above) > 1) + 1)
    peaks = [int(each[np.argmax(value[each])]) for each in stretches]
    valleys = [
        first + int(np.argmin(value[first : max(last, first + 1)]))
        for first, last in zip([0, *peaks], [*peaks, value.size], strict=True)
    ]
    worse = np.where(by_force, -np.inf, worse)
    for valley, peak in zip(valleys, peaks, strict=False):  # approaches
        start = 0 if valley == valleys[0] else valley
        gain = np.concatenate(([0.0], np.cumsum(worse[start:peak])))
        found[start : start + int(np.argmax(gain))] = False
        if unseen[0] is not None:
            found[start:peak] = (value[start:peak] >= unseen[0]) | by_force[start:peak]
    for peak, valley in zip(peaks, valleys[1:], strict=True):  # retractions
        end = value.size if valley == valleys[-1] else valley
        gain = np.concatenate(([0.0], np.cumsum(worse[peak + 1 : end][::-1])))
        found[end - int(np.argmax(gain)) : end] = False
        if unseen[1] is not None:
            found[peak + 1 : end] = (value[peak + 1 : end] >= unseen[1]) | by_force[peak + 1 : end]
    return found


def jumps_between(
    touching: BoolArray, by_force: BoolArray, used: BoolArray, value: FloatArray, sizes: Sequence[float]
) -> list[Jump]:
    """Return the jumps between rows of a prescribed position.

    `sizes` are those of the jumps where contact begins and ends, over the noise of the force.
    """
    found = []
    for row in np.flatnonzero(touching[1:] != touching[:-1]) + 1:
        pair = slice(row - 1, row + 1)
        jump = sizes[0] if touching[row] else sizes[1]
        if by_force[pair].any() or not used[pair].all() or jump < LEAST_JUMP:
            continue
        spacing = abs(float(value[row] - value[row - 1]))
        certain = spacing / 12**0.5
        spread = spacing * (1 / 12 + CHANGE / jump**4) ** 0.5
        if certain > 0:
            found.append(Jump(int(row), bool(touching[row]), spread, certain))
    return found
