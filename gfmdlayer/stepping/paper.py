"""The paper's integrator with an account of its energy, which stress and displacement alone do not give."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gfmdlayer.stepping.modes import Modes
from gfmdlayer.stepping.third_order import ThirdOrder

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]


class Paper:
    """Eq. (24) by backward Euler; the relaxing modes, whose stress is the same, are carried along.

    Parameters
    ----------
    third_order : ThirdOrder
        Gives slopes and intercepts.
    modes : Modes
        Of the same body, by backward Euler; knows the energy.
    """

    def __init__(self, third_order: ThirdOrder, modes: Modes) -> None:
        self._third_order, self._modes = third_order, modes

    @property
    def stored(self) -> float:
        """Elastic energy after the last step."""
        return self._modes.stored

    @property
    def dissipated(self) -> float:
        """Heat since the beginning."""
        return self._modes.dissipated

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b at the end of the next step (lines 5 and 6)."""
        self._modes.prepare(step)
        return self._third_order.terms(step)

    def advance(self, spectrum: ComplexArray) -> None:
        """Carry the history on with the accepted displacement (lines 8 and 9)."""
        self._third_order.advance(spectrum)
        self._modes.advance(spectrum)
