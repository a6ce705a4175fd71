"""The solvers of the contact problem of a step: their abilities, their cost, and the choice of one.

The table is plain data that imports no solver: configurations, cost estimates and refusals read it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

if TYPE_CHECKING:
    from gfmdlayer.body.solid import Relaxation


@dataclass(frozen=True)
class Declaration:
    """The abilities of a solver, and its cost."""

    place: str  # module and class, "package.module:Class"; made with transforms
    starts_from: Literal["displacement", "pressure", "gap"]  # field of the first guess
    pairs: float  # FFT pairs a step at 4096 points and a residual of 1e-6
    power: float  # of the points, to which the pairs are proportional
    fields: int  # real fields alive at once in a run
    rough: float = 1.0  # factor on the pairs where no window holds the contact
    adhesive: bool = False  # whether it solves problems whose interface attracts
    nonsymmetric: bool = False  # whether it solves problems with a loss stiffness by itself
    distributed: bool = False  # whether it solves on a grid over ranks; it is then made with the grid too
    yields: bool = False  # whether it solves problems whose pressures end at a hardness
    # `pairs` and `power` where an option of the solver's section has a value, by (option, value)
    pairs_with: Mapping[tuple[str, object], tuple[float, float]] = field(default_factory=dict)

    def pairs_per_step(self, points: int, options: Mapping[str, object]) -> float:
        """Estimate the FFT pairs of a time step; `options` is the solver's section of the configuration."""
        listed = (self.pairs_with[item] for item in options.items() if item in self.pairs_with)
        pairs, power = next(listed, (self.pairs, self.power))
        return float(pairs * (points / 4096) ** power)

    def load(self) -> Any:
        """Import the class of the solver."""
        module, _, name = self.place.partition(":")
        return getattr(import_module(module), name)


# Pairs of the default case; fields from the peak of the process at 2^17 to 2^19 points, in one and two
# directions; the factor for rough contact at 256^2 to 2048^2 points. All measured.
SOLVERS: Mapping[str, Declaration] = {
    "active_set": Declaration(
        "gfmdlayer.contact.active_set.solver:ActiveSet", "pressure", 2.7, 0.07, fields=28, rough=12
    ),
    "nested_gradient": Declaration(
        "gfmdlayer.contact.nested.solver:NestedGradient",
        "pressure",
        5,
        0.1,
        fields=28,
        distributed=True,
        yields=True,
    ),
    "conjugate_gradient": Declaration(
        "gfmdlayer.contact.bounded:ConjugateGradient", "pressure", 34, 0.2, fields=20
    ),
    "fire": Declaration(
        "gfmdlayer.contact.fire:Fire",
        "displacement",
        60,
        0.03,
        fields=34,
        adhesive=True,
        pairs_with={("inertia", "uniform"): (238, 0.3)},
    ),
    "newton": Declaration(
        "gfmdlayer.contact.newton.solver:Newton",
        "gap",
        36,
        0.4,
        fields=50,  # with pressure and gap of two rows, for the work
        adhesive=True,
        distributed=True,
        yields=True,
    ),
}


# The solver with friction, which no keyword chooses; pairs of a step with slip, each component counted.
FRICTIONAL = Declaration(
    "gfmdlayer.friction.solver:FrictionSolver", "pressure", 25, 0.08, fields=80, rough=3.5
)
IN_ROUNDS = replace(FRICTIONAL, pairs=60, power=0.14, fields=130)  # with the solver of a normal contact

STEADY_ROLLING = replace(FRICTIONAL, pairs=150, power=0.08, fields=140)  # the one step of the state

# The solver that `solver.method: auto` takes. It follows only from the configuration: the solver that began a
# run resumes it. Results carry the digest of the solver that is taken, not of the word `auto`.
#
# Measured (docs/theory/ablation.md): on a rough surface in two directions, where no window holds the contact,
# nested gradients take a quarter to a third of the active set's FFT pairs in time steps, and a fifth to an
# eighth in a first solve. One contact is solved by the active set in a window: in a third of the time that
# nested gradients take where it is small, in 0.8 to 0.95 of it where it is wide. Lines keep the active set; a
# moving punch changes nothing in the rule.
#
# Last, the tolerance of this solver, see `problem.solve_finer`.

AUTO = "auto"
# Tolerance of the solver times the contrast of moduli, in tolerances of adaptive steps, above which they need
# a tighter one: a step that is shortened for the noise of the solver finds more of it, and runs do not end.
# Measured for Prony series with moduli that fall as tau^-0.5 to tau^-0.9 over five or six decades: from 230
# on under a load, never up to 100. For laws without a glassy modulus, exponents 0.3 to 0.8: from 16 on, and
# from 6 under a load. Where it is tighter, the steps take no more time.
_NOISE, _NOISE_UNLIMITED = 10.0, 1.0
_REACH = 10  # the series of such a law reaches below the shortest step that its own contrast is taken for
_FINEST = 1e-12  # residual that rounding leaves within reach


class Choice(NamedTuple):
    """A solver of `solvers.SOLVERS`, and why it was taken."""

    method: str
    reason: str


def choose(method: str, *, axes: int, rough: bool, attracts: bool, yields: bool = False) -> Choice:
    """Return the solver for a surface of one or two axes, with a rough punch, attracting, yielding or not."""
    if attracts and (method == AUTO or not SOLVERS[method].adhesive):
        return Choice("newton", "the interface attracts")
    if method != AUTO:
        return Choice(method, "as configured")
    if yields:
        return Choice("nested_gradient", "contact pressures end at a hardness")
    if axes == 2 and rough:
        return Choice("nested_gradient", "a rough surface in two directions")
    return Choice("active_set", "a line" if axes == 1 else "a smooth punch, whose contact a window holds")


def contrast(materials: Iterable[Relaxation]) -> float:
    """Return the largest glassy over relaxed modulus of materials; those that relax to zero are left out."""
    return max((1 + sum(G for G, _ in branches) / G0 for G0, branches in materials if G0 > 0), default=1.0)


def finer(tolerance: float, of_steps: float, contrast: float, unlimited: float) -> float:
    """Return the tolerance of the solver: tighter for adaptive steps on bodies of large glassy contrast."""
    # `of_steps` is their tolerance; `contrast` the glassy over the relaxed modulus, and `unlimited` that of
    # laws without a glassy modulus, over the times of their series.
    if tolerance * contrast <= _NOISE * of_steps and tolerance * unlimited <= _NOISE_UNLIMITED * of_steps:
        return tolerance
    return min(tolerance, max(of_steps / max(contrast, _REACH * unlimited), _FINEST))
