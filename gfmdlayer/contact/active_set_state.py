"""What the active-set solver works on: the problem in pressures, the iterate, the directions it keeps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gfmdlayer.contact.grid import FloatArray
from gfmdlayer.contact.transforms import ComplexArray

IndexArray = npt.NDArray[np.int64]


class System(NamedTuple):
    """The problem in pressures, in units of one grid point: gap = gap0 + A p."""

    compliance: FloatArray  # A: 1/kappa, and 0 at q = 0 where the mean of u is fixed or the load is given
    stiffness: FloatArray  # kappa, the preconditioner
    gap0: FloatArray  # gap without pressure
    h: FloatArray
    softest: float  # kappa_1
    load: bool  # whether the mean of p is given, and the gap known up to a shift only


class Iterate(NamedTuple):
    """Pressure, gap and contact set."""

    p: FloatArray
    gap: FloatArray  # kept up in the contact, elsewhere as of the last `spread`
    base: FloatArray  # gap of the pressure with which the present contact set was begun
    spectrum: ComplexArray  # transform of that pressure
    contact: FloatArray  # 1 in the contact set C, 0 elsewhere
    points: IndexArray  # the points of C; the first ``size[0]`` entries count
    size: IndexArray


class Bank(NamedTuple):
    """Directions and what they do; the rows but the first are kept from one step to the next.

    Row 0 is the pressure with which the contact set was begun. What it does is known, base - gap0, and so is
    its transform: of this row only the entries in the contact are written. Rows are longer than the fields,
    so that each begins where FFTW wants it.
    """

    direction: FloatArray
    change: FloatArray  # A direction
    spectrum: ComplexArray  # transform of the direction
    age: IndexArray  # order in which they came, 0 for none
    deflating: npt.NDArray[np.bool_]  # whether the solve is kept conjugate to it
    length: FloatArray  # how far the pressure has gone along it since the present contact set was begun
    gram: FloatArray  # direction_i A direction_j, factored


class Work(NamedTuple):
    """Work arrays."""

    z: FloatArray
    spectrum: ComplexArray
    coefficients: FloatArray
    scales: FloatArray  # of pressure and gap in the residual
    offset: FloatArray  # shift of the gaps under a given load; one entry
