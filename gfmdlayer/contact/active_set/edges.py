"""How the contact set changes: the primal-dual step, which on a line goes as far as its edges tell.

What pulls leaves the set and what overlaps joins it. On a line that alone finds an edge slowly. Where the set
ends at a distance delta from the edge of the contact, its pressure and its gap are, to first order in delta
and at a distance s from its end (from p ~ s^(1/2) inside and gap ~ s^(3/2) outside of the true edge:
Johnson, Contact Mechanics, 1985, ch. 4),

    set too large:  p ~ s^(1/2) - (delta/2) s^(-1/2),       which pulls for s < delta/2,
    set too small:  gap ~ s^(3/2) - (3 delta/2) s^(1/2),    which overlaps for s < 3 delta/2,

so that half of what should leave would do so, and half as much again as should would join. Here twice what
pulls leaves, and two thirds of what overlaps join: Newton's step for the edge, cautiously rounded. This holds
for the pressure that closes the gaps; one that is still on its way there looks the same from afar. And it
holds for an edge that is by itself: near a kink of the punch or another edge such steps may undo each other
for ever, so only so many of them are taken, and then signs alone.
"""

from __future__ import annotations

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.active_set.state import Bank, ContactSet, let_go, list_runs
from gfmdlayer.kernels import kernel

_NEWTON = 8  # rounds: from a contact twice too wide four are enough


@kernel
def update(
    p: FloatArray,
    gap: FloatArray,
    contact: ContactSet,
    bank: Bank,
    shift: float,
    everywhere: bool,
    settled: bool,
    done: int,
) -> bool:
    """Let go what pulls, take in what overlaps; return whether the pressure changed.

    The gap is known ``everywhere``, or near the contact; the pressure may be ``settled``; so many changes of
    the set have been ``done``.
    """
    changed, runs, near, member = False, contact.runs, contact.near, contact.member
    for k in range(1 if everywhere else contact.counts[1]):
        first, end = (0, p.size) if everywhere else (near[k, 0], near[k, 1])
        for i in range(first, end):
            if member[i] == 0.0 and gap[i] < shift:
                member[i] = 1.0
    newton = done < _NEWTON and _is_line(contact)
    known = p.size if everywhere else contact.reach[0]
    for k in range(contact.counts[0]):
        first, end, left, right = runs[k, 0], runs[k, 1], 0, 0
        if newton:
            before = runs[k - 1, 1] if k > 0 else 0
            after = runs[k + 1, 0] if k + 1 < contact.counts[0] else p.size
            _draw_back(member, first, before, -1, known)
            _draw_back(member, end - 1, after - 1, 1, known)
        if newton and settled:
            left, right = _to_leave(p, first, end, 1), _to_leave(p, end - 1, first - 1, -1)
        for i in range(first, end):
            if p[i] < 0.0 or i < first + left or i >= end - right:
                let_go(contact, bank, p, i)
                changed = True
    list_runs(contact)
    return changed


@kernel
def motion(contact: ContactSet, direction: FloatArray) -> float:
    """Largest change of the pressure along a direction, where edges are gone by: on a line."""
    found = 0.0
    for k in range(contact.counts[0] if _is_line(contact) else 0):
        for i in range(contact.runs[k, 0], contact.runs[k, 1]):
            found = max(found, abs(direction[i]))
    return found


@kernel
def _is_line(contact: ContactSet) -> bool:
    """Whether the surface is a line, whose contacts end at points."""
    return contact.reach[1] == contact.member.size


@kernel
def _draw_back(member: FloatArray, last: int, limit: int, towards: int, known: int) -> None:
    """Of the points beyond the last one of a stretch that have joined it, keep two thirds.

    All of them where they reach the next stretch, or as far as the gap is known.
    """
    i = last
    while i != limit and member[i + towards] > 0.0:
        i += towards
    joined = abs(i - last)
    if i != limit and joined < known:
        for _ in range(joined // 3):
            member[i] = 0.0
            i -= towards


@kernel
def _to_leave(p: FloatArray, first: int, end: int, towards: int) -> int:
    """How many points are to leave at an end of a stretch: twice those that pull from there on.

    But less than half of those that press next to them, which may have another such neighbour.
    """
    i = first
    while i != end and p[i] < 0.0:
        i += towards
    pulling = abs(i - first)
    while i != end and p[i] >= 0.0:
        i += towards
    pressing = abs(i - first) - pulling
    return pulling + max(min(pulling - 1, (pressing - 1) // 2), 0)
