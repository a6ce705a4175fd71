"""The solver that `solver.method: auto` takes: the one rule, by the configuration alone.

It is known before a run and the same in all of its steps, so that a run is resumed by the solver that began
it. Results carry the digest of the solver that is taken, not of the word `auto`.

Measured (docs/theory/ablation.md): on a rough surface in two directions, where no window holds the contact,
nested gradients take a quarter to a third of the active set's FFT pairs in time steps, and a fifth to an
eighth in a first solve. One contact is solved by the active set in a window: in a third of the time that
nested gradients take where it is small, in 0.8 to 0.95 of it where it is wide. Lines keep the active set; a
moving punch changes nothing in the rule.

And the tolerance to which that solver is asked to go, see `tightened`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from gfmdlayer.body.materials import Law

from gfmdlayer.contact.solvers import SOLVERS

AUTO = "auto"
_CONTRAST = 1e5  # of moduli, above which adaptive steps take more than the given tolerance
_FINEST = 1e-12  # residual that rounding leaves within reach


class Choice(NamedTuple):
    """A solver of `solvers.SOLVERS`, and why it was taken."""

    method: str
    reason: str


def choose(method: str, *, axes: int, rough: bool, attracts: bool) -> Choice:
    """Return the solver of a case.

    Parameters
    ----------
    method : str
        As configured.
    axes : int
        Directions of the surface, 1 or 2.
    rough : bool
        Whether the punch touches in many patches.
    attracts : bool
        Whether the interface does.

    Returns
    -------
    Choice
    """
    if attracts and (method == AUTO or not SOLVERS[method].adhesive):
        return Choice("newton", "the interface attracts")
    if method != AUTO:
        return Choice(method, "as configured")
    if axes == 2 and rough:
        return Choice("nested_gradient", "a rough surface in two directions")
    return Choice("active_set", "a line" if axes == 1 else "a smooth punch, whose contact a window holds")


def contrast(laws: Iterable[Law], end: float) -> float:
    """Return roughly the largest glassy over relaxed modulus in times up to the end of a run.

    Laws that relax to zero are left out.
    """
    every = (law.roughly(end) for law in laws)
    return max((1 + sum(G for G, _ in branches) / G0 for G0, branches in every if G0 > 0), default=1.0)


def finer(tolerance: float, of_steps: float | None, stiffened: float, *, attracts: bool) -> float:
    """Return the tolerance to which contact is solved: a finer one where adaptive steps need it.

    Parameters
    ----------
    tolerance, of_steps : float
        As configured; the latter None where steps are fixed.
    stiffened : float
        Glassy over relaxed modulus.
    attracts : bool
        Whether the interface does: `newton` then ends near 1e-8, and steps are not many.

    Returns
    -------
    float
    """
    if attracts or of_steps is None or stiffened <= _CONTRAST:
        return tolerance
    return min(tolerance, max(of_steps / stiffened, _FINEST))
