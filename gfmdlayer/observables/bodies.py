"""Energies of each of two deformable bodies; their sums are `stored` and `dissipated` of the balance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from gfmdlayer.observables.observable import AcceptedStep, Column, Observable, Parts

if TYPE_CHECKING:
    from gfmdlayer.config import Config

_UNITS = "pressure length"
_NAMES = "body", "counterbody"


class Bodies(Observable):
    """Stored and dissipated energy of the body and of its counterbody, from their histories."""

    COLUMNS = (
        *(Column(f"stored_{name}", f"elastic energy stored in the {name}, per area", _UNITS,
                 origin="from the body at rest") for name in _NAMES),
        *(Column(f"dissipated_{name}", f"energy dissipated in the {name}, per area", _UNITS,
                 origin="from the beginning of the run") for name in _NAMES),
    )  # fmt: skip

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case with a deformable counterbody."""
        return cls.COLUMNS if config.two_bodies else None

    def __init__(self, case: Parts) -> None:
        self._bodies = case.integrator.bodies

    def measure(self, _step: AcceptedStep) -> Mapping[str, float]:
        """Return the energies."""
        own = [*zip(_NAMES, self._bodies, strict=True)]
        stored = {f"stored_{name}": body.stored for name, body in own}
        return stored | {f"dissipated_{name}": body.dissipated for name, body in own}
