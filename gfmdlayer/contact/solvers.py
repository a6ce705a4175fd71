"""The solvers of the contact problem of a step: which there are, what each can do, and what it costs.

The table is plain data that imports no solver: configurations, cost estimates and refusals read it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Literal


@dataclass(frozen=True)
class Declaration:
    """What a solver can do, and what it costs.

    Attributes
    ----------
    place : str
        Module and class, "package.module:Class"; made with transforms, tolerance and maximum of iterations.
    starts_from : {"displacement", "pressure", "gap"}
        Of what the first guess is.
    pairs, power : float
        FFT pairs a step at 4096 points and a residual of 1e-6, and as a power of the points.
    rough : float
        Factor on the pairs where no window holds the contact.
    fields : int
        Real fields alive at once in a run.
    pairs_with : mapping
        `pairs` and `power` where an option of the solver's section has a value, by (option, value).
    adhesive : bool
        Whether it solves problems whose interface attracts.
    nonsymmetric : bool
        Whether it solves problems with a loss stiffness by itself.
    distributed : bool
        Whether it solves on a grid over several ranks; it is then made with the grid too.
    """

    place: str
    starts_from: Literal["displacement", "pressure", "gap"]
    pairs: float
    power: float
    fields: int
    rough: float = 1.0
    adhesive: bool = False
    nonsymmetric: bool = False
    distributed: bool = False
    pairs_with: Mapping[tuple[str, object], tuple[float, float]] = field(default_factory=dict)

    def pairs_per_step(self, points: int, options: Mapping[str, object]) -> float:
        """Estimate the FFT pairs of a time step.

        Parameters
        ----------
        points : int
            Points of the grid.
        options : mapping
            The solver's section of the configuration.

        Returns
        -------
        float
        """
        found = (self.pairs_with[item] for item in options.items() if item in self.pairs_with)
        pairs, power = next(found, (self.pairs, self.power))
        return float(pairs * (points / 4096) ** power)

    def load(self) -> Any:
        """Import the class of the solver."""
        module, _, name = self.place.partition(":")
        return getattr(import_module(module), name)


# Pairs of the default case; fields from the peak of the process at 2^17 to 2^19 points, in one and two
# directions; the factor for rough contact at 256^2 to 2048^2 points. All measured.
SOLVERS: Mapping[str, Declaration] = {
    "active_set": Declaration(
        "gfmdlayer.contact.active_set.solver:ActiveSet", "pressure", 2.7, 0.07, fields=30, rough=12
    ),
    "nested_gradient": Declaration(
        "gfmdlayer.contact.nested.solver:NestedGradient", "pressure", 5, 0.1, fields=30, distributed=True
    ),
    "conjugate_gradient": Declaration(
        "gfmdlayer.contact.conjugate_gradient:ConjugateGradient", "pressure", 34, 0.2, fields=22
    ),
    "fire": Declaration(
        "gfmdlayer.contact.fire:Fire",
        "displacement",
        93,
        0.03,
        fields=35,
        adhesive=True,
        pairs_with={("inertia", "uniform"): (238, 0.3)},
    ),
    "newton": Declaration("gfmdlayer.contact.newton.solver:Newton", "gap", 36, 0.4, fields=42, adhesive=True),
}
