"""The solver that `solver.method: auto` takes: the one rule, by the configuration alone.

It is known before a run and the same in all of its steps, so that a run is resumed by the solver that began
it. Results carry the digest of the solver that is taken, not of the word `auto`.

Measured (docs/theory/ablation.md): on a rough surface in two directions, where no window holds the contact,
nested gradients take a quarter to a third of the active set's FFT pairs in time steps, and a fifth to an
eighth in a first solve. One contact is solved by the active set in a window: in a third of the time that
nested gradients take where it is small, in 0.8 to 0.95 of it where it is wide. Lines keep the active set; a
moving punch changes nothing in the rule.
"""

from __future__ import annotations

from typing import NamedTuple

from gfmdlayer.contact.solvers import SOLVERS

AUTO = "auto"


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
