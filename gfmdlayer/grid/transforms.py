"""Real Fourier transforms of fields on the grid, by FFTW, from Python and from nopython code.

Convention, stated here once: ``forward`` is the unnormalised real-to-complex transform U_k = sum_j u_j exp(-i
q_k x_j) (counted from the first grid point), ``backward`` its unnormalised inverse, so that
backward(forward(u)) = n u; the caller multiplies by 1/n. ``backward`` destroys its input.

Plans and functions reach compiled kernels as addresses, plain integers, which a cached kernel accepts.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.grid.fftw import DOUBLE, SINGLE, PlanPair, address, aligned, export_wisdom, plan_pair
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.resumable import State


class Plans(NamedTuple):
    """Addresses of FFTW's plans and of the functions that execute them, for nopython code."""

    forward_plan: int
    backward_plan: int
    execute_forward: int
    execute_backward: int


@intrinsic
def execute(
    _context: Any, _function: Any, _plan: Any, source: Any, target: Any
) -> tuple[Any, Any]:  # numba's own types, which carry no annotations
    """Call ``void function(plan, source, target)`` by address."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = cgutils.voidptr_t
        function_type = ir.FunctionType(ir.VoidType(), [pointer, pointer, pointer])
        callee = builder.inttoptr(arguments[0], function_type.as_pointer())
        data = [
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(signature.args[2:], arguments[2:], strict=True)
        ]
        builder.call(
            callee,
            [builder.inttoptr(arguments[1], pointer), *(builder.bitcast(each, pointer) for each in data)],
        )
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, source, target), codegen


@nb.njit(inline="always")
def forward(plans: Plans, field: FloatArray, spectrum: ComplexArray) -> None:
    """Transform ``field`` into ``spectrum``, real-to-complex, both flat and from `Transforms`."""
    execute(plans.execute_forward, plans.forward_plan, field, spectrum)  # type: ignore[call-arg]


@nb.njit(inline="always")
def backward(plans: Plans, spectrum: ComplexArray, field: FloatArray) -> None:
    """Unnormalised complex-to-real transform of ``spectrum``, which is destroyed, into ``field``."""
    execute(plans.execute_backward, plans.backward_plan, spectrum, field)  # type: ignore[call-arg]


class Transforms:
    """Forward and backward plans for one shape, and the aligned arrays that they accept."""

    ranks: Ranks = ALONE

    def __init__(
        self,
        shape: tuple[int, ...],
        wisdom: str | None = None,
        time_limit: float = 10.0,
        threads: int = 1,
        single: bool = False,
    ) -> None:
        # Planning measures (FFTW_MEASURE), which at 2^14 points runs 1.6 times faster than the estimate, for
        # at most `time_limit` seconds. Two measured plans may round differently; plans made from the same
        # wisdom do not. A run that has to reproduce the bits of another one takes its `wisdom`; wisdom that
        # does not fit this FFTW is ignored. Transforms of `fftw.WORTH_THREADS` points or more use the
        # threads, of which OpenMP starts no more than OMP_NUM_THREADS allowed when the process began.
        self.shape, self.threads, self.single = shape, threads, single
        self.size, self.spectral_shape = math.prod(shape), (*shape[:-1], shape[-1] // 2 + 1)
        self._wisdom, self._time_limit = wisdom, time_limit
        self._fftw = SINGLE if single else DOUBLE
        self._plan()

    def _plan(self) -> None:
        self._pair = plan_pair(
            PlanPair, self.shape, self._wisdom, self._time_limit, self.threads, self.single
        )
        functions = address(self._fftw.execute_dft_r2c), address(self._fftw.execute_dft_c2r)
        self.plans = Plans(self._pair.forward, self._pair.backward, *functions)

    def for_window(self, divisor: int) -> Transforms:
        """Transforms of a window with 1/divisor of the points of each axis, from the same wisdom."""
        return self.of_shape(tuple(points // divisor for points in self.shape))

    def of_shape(self, shape: tuple[int, ...], *, single: bool = False, measured: bool = True) -> Transforms:
        """Transforms of another shape or precision, from the same wisdom; the rest is measured or not."""
        # A run repeats its bits only if its wisdom has all plans that are measured (`wisdom.planned`).
        return Transforms(shape, self._wisdom, self._time_limit if measured else 0.0, self.threads, single)

    @property
    def wisdom(self) -> str:
        """FFTW's accumulated wisdom; equal wisdom gives equal plans and equal bits."""
        return export_wisdom()

    @property
    def description(self) -> str:
        """Both plans as FFTW prints them."""
        return self._pair.description

    def state(self) -> State:
        """Return the plans' description and the wisdom that they were made from."""
        return {"plans": self.description, "wisdom": self.wisdom}

    def restore(self, state: State) -> None:
        """Use the same plans; ValueError if this FFTW, on this processor, does not make them."""
        self._wisdom = str(state["wisdom"])  # of the windows too
        if self.description == str(state["plans"]):
            return
        self._plan()
        if self.description != str(state["plans"]):
            raise ValueError("FFTW plans the transforms in another way here")

    def empty_field(self) -> Any:
        """Uninitialised flat field, aligned as the plans need it."""
        return aligned(math.prod(self.shape), self.single)

    def empty_spectrum(self) -> Any:
        """Uninitialised flat spectrum, aligned as the plans need it."""
        kind = np.complex64 if self.single else np.complex128
        return aligned(2 * math.prod(self.spectral_shape), self.single).view(kind)

    def forward(self, field: npt.ArrayLike) -> ComplexArray:
        """Return the unnormalised transform of a field of any layout, as a new flat spectrum."""
        source, spectrum = self.empty_field(), self.empty_spectrum()
        source[:] = np.ravel(field)
        self.transform(source, spectrum)
        return np.asarray(spectrum)

    def backward(self, spectrum: npt.ArrayLike) -> FloatArray:
        """Return the unnormalised inverse transform of a spectrum of any layout, as a new flat field."""
        source, field = self.empty_spectrum(), self.empty_field()
        source[:] = np.ravel(spectrum)
        self.transform_back(source, field)
        return np.asarray(field)

    def transform(self, field: Any, spectrum: Any) -> None:
        """Write the transform of a field; both flat, from `empty_field` and `empty_spectrum`."""
        self._fftw.execute_dft_r2c(self._pair.forward, field.ctypes.data, spectrum.ctypes.data)

    def transform_back(self, spectrum: Any, field: Any) -> None:
        """Write the inverse transform of a spectrum, which is destroyed; both flat."""
        self._fftw.execute_dft_c2r(self._pair.backward, spectrum.ctypes.data, field.ctypes.data)

    def truncated(self, spectrum: npt.NDArray[Any], coarser: Transforms) -> npt.NDArray[Any]:
        """Return the modes that a coarser grid of the same cell has too, as a new flat spectrum."""
        # It is complex of a field, or real of an even function of the wavevector.
        return truncated(spectrum, self.shape, coarser.shape)


def truncated(
    spectrum: npt.NDArray[Any], shape: tuple[int, ...], coarser: tuple[int, ...]
) -> npt.NDArray[Any]:
    """`Transforms.truncated`, between two shapes."""
    modes = spectrum.reshape(*shape[:-1], -1)[..., : coarser[-1] // 2 + 1]
    for axis, points in enumerate(coarser[:-1]):
        ends = (points + 1) // 2, modes.shape[axis] - points // 2
        positive, _, negative = np.split(modes, ends, axis)
        modes = np.concatenate((positive, negative), axis)
    return modes.flatten() if len(shape) == 1 else np.ravel(modes)
