"""FFTW transforms that nopython code can call, with plans that come out the same every time.

Convention, stated here once: ``forward`` is the unnormalised real-to-complex transform U_k = sum_j u_j exp(-i
q_k x_j) (counted from the first grid point), ``backward`` its unnormalised inverse, so that
backward(forward(u)) = n u. Whoever multiplies in between carries the factor 1/n.  ``backward`` destroys its
input.

pyfftw brings FFTW itself but no way into it from nopython code.  Its extension module resolves the C
functions of the very library that it loaded, so plans are made and wisdom is shared through those (FFTW
manual, "Guru" and "Wisdom" chapters), and the addresses travel as plain integers, which compiled and cached
kernels accept.
"""

from __future__ import annotations

import ctypes
import math
import weakref
from typing import Any, ClassVar, NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt
import pyfftw
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.kernels import kernel
from gfmdlayer.resumable import State

# Points of a field below which threads are not used: there a transform takes about a millisecond. On busy
# cores they lost up to 1024 x 1024 points and were even at 2048 x 2048; on idle ones they are not measured.
WORTH_THREADS = 1 << 18
_MEASURE, _DESTROY_INPUT = 0, 1 << 0  # fftw3.h

_fftw = ctypes.CDLL(pyfftw.pyfftw.__file__)
for _planner in (_fftw.fftw_plan_dft_r2c, _fftw.fftw_plan_dft_c2r):
    _planner.restype = ctypes.c_void_p
    _planner.argtypes = [
        ctypes.c_int,
        ctypes.POINTER(ctypes.c_int),
        ctypes.c_void_p,
        ctypes.c_void_p,
        ctypes.c_uint,
    ]
_fftw.fftw_init_threads.restype = ctypes.c_int
_fftw.fftw_plan_with_nthreads.restype = None
_fftw.fftw_plan_with_nthreads.argtypes = [ctypes.c_int]
_fftw.fftw_destroy_plan.restype = None
_fftw.fftw_destroy_plan.argtypes = [ctypes.c_void_p]
_fftw.fftw_sprint_plan.restype = ctypes.c_void_p
_fftw.fftw_sprint_plan.argtypes = [ctypes.c_void_p]
_fftw.free.restype = None
_fftw.free.argtypes = [ctypes.c_void_p]
_fftw.fftw_set_timelimit.restype = None
_fftw.fftw_set_timelimit.argtypes = [ctypes.c_double]


class Plans(NamedTuple):
    """Addresses of FFTW's plans and of the functions that execute them, as nopython code wants them."""

    forward_plan: int
    backward_plan: int
    execute_forward: int
    execute_backward: int


@intrinsic
def _execute(
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
    _execute(plans.execute_forward, plans.forward_plan, field, spectrum)  # type: ignore[call-arg]


@nb.njit(inline="always")
def backward(plans: Plans, spectrum: ComplexArray, field: FloatArray) -> None:
    """Unnormalised complex-to-real transform of ``spectrum``, which is destroyed, into ``field``."""
    _execute(plans.execute_backward, plans.backward_plan, spectrum, field)  # type: ignore[call-arg]


class _Pair:
    """A forward and a backward plan, destroyed when they are neither known nor in use any more."""

    def __init__(self, shape: tuple[int, ...], time_limit: float, threads: int) -> None:
        size, modes = math.prod(shape), math.prod(shape[:-1]) * (shape[-1] // 2 + 1)
        field, spectrum = aligned(size), aligned(2 * modes)
        dimensions = (ctypes.c_int * len(shape))(*shape)
        _fftw.fftw_set_timelimit(time_limit)
        if threads > 1 and size >= WORTH_THREADS and _fftw.fftw_init_threads():
            _fftw.fftw_plan_with_nthreads(threads)
        self.forward = _fftw.fftw_plan_dft_r2c(
            len(shape), dimensions, field.ctypes.data, spectrum.ctypes.data, _MEASURE
        )
        self.backward = _fftw.fftw_plan_dft_c2r(
            len(shape), dimensions, spectrum.ctypes.data, field.ctypes.data, _MEASURE | _DESTROY_INPUT
        )
        if threads > 1:
            _fftw.fftw_plan_with_nthreads(1)
        for plan in filter(None, (self.forward, self.backward)):
            weakref.finalize(self, _fftw.fftw_destroy_plan, plan)
        if not (self.forward and self.backward):
            raise RuntimeError(f"FFTW has no plan for fields of shape {shape}")


class _Known:
    """What FFTW was told in this process, which has one wisdom for all transforms, and what came of it."""

    wisdom: str | None = None
    pairs: ClassVar[dict[tuple[tuple[int, ...], float, int], _Pair]] = {}


def forget() -> None:
    """Let FFTW forget what it was told and what it measured."""
    pyfftw.forget_wisdom()
    _Known.wisdom = None
    _Known.pairs.clear()


def _pair(shape: tuple[int, ...], wisdom: str | None, time_limit: float, threads: int) -> _Pair:
    """Plans from some wisdom; those that were made from it before, since to plan takes as long as a step."""
    if wisdom and wisdom != _Known.wisdom:  # to read it takes longer than to plan
        forget()  # FFTW would pass over what it believes to be worse than what it knows
        pyfftw.import_wisdom((wisdom.encode(), b"", b""))
    _Known.wisdom = wisdom
    key = shape, time_limit, threads
    if key not in _Known.pairs:
        _Known.pairs[key] = _Pair(*key)
    return _Known.pairs[key]


class Transforms:
    """Forward and backward plans for one shape, and the aligned arrays that they accept.

    Planning measures (FFTW_MEASURE), which at 2^14 points runs 1.6 times faster than the estimate. Two
    measured plans may round differently; plans made from the same wisdom do not. So the wisdom is kept
    (`wisdom`) and handed to whoever must reproduce the bits.

    Parameters
    ----------
    shape : tuple of int
        Shape of the fields, one or two axes.
    wisdom : str, optional
        What an earlier `Transforms.wisdom` returned. Wisdom that does not fit this FFTW is passed over, and
        the plan is measured.
    time_limit : float
        Seconds that measuring may take before FFTW settles for the best plan so far.
    threads : int
        Threads that a transform may use, where the field has `WORTH_THREADS` points or more. OpenMP runs no
        more of them than OMP_NUM_THREADS said when the process began.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        wisdom: str | None = None,
        time_limit: float = 10.0,
        threads: int = 1,
    ) -> None:
        self.shape = shape
        self.spectral_shape = (*shape[:-1], shape[-1] // 2 + 1)
        self._wisdom, self._time_limit, self._threads = wisdom, time_limit, threads
        self._plan()

    def _plan(self) -> None:
        self._pair = _pair(self.shape, self._wisdom, self._time_limit, self._threads)
        self.plans = Plans(
            self._pair.forward,
            self._pair.backward,
            _address(_fftw.fftw_execute_dft_r2c),
            _address(_fftw.fftw_execute_dft_c2r),
        )

    def shorter(self, part: int) -> Transforms:
        """Those of a part of the surface, one in so many points along each axis; from the same wisdom."""
        shape = tuple(points // part for points in self.shape)
        return Transforms(shape, self._wisdom, self._time_limit, self._threads)

    @property
    def wisdom(self) -> str:
        """FFTW's accumulated wisdom in double precision; equal wisdom gives equal plans and equal bits."""
        return str(pyfftw.export_wisdom()[0].decode())

    @property
    def description(self) -> str:
        """Both plans in FFTW's words: how they split the transform, and by which of its codelets."""
        return "\n".join(_described(plan) for plan in (self._pair.forward, self._pair.backward))

    def state(self) -> State:
        """Return which plans these are, and the wisdom that they came from."""
        return {"plans": self.description, "wisdom": self.wisdom}

    def restore(self, state: State) -> None:
        """Use the same plans.

        Raises
        ------
        ValueError
            Where this FFTW, on this processor, does not make them.
        """
        self._wisdom = str(state["wisdom"])  # of shorter transforms too
        if self.description == str(state["plans"]):
            return
        self._plan()
        if self.description != str(state["plans"]):
            raise ValueError("FFTW plans the transforms in another way here")

    def empty_field(self) -> FloatArray:
        """Uninitialised flat field, aligned as the plans need it."""
        return aligned(math.prod(self.shape))

    def empty_spectrum(self) -> ComplexArray:
        """Uninitialised flat spectrum, aligned as the plans need it."""
        return aligned(2 * math.prod(self.spectral_shape)).view(np.complex128)

    def forward(self, field: npt.ArrayLike) -> ComplexArray:
        """Return the unnormalised transform of a field of any layout, as a new flat spectrum."""
        own, spectrum = self.empty_field(), self.empty_spectrum()
        own[:] = np.ravel(field)
        _execute_forward(self.plans, own, spectrum)
        return spectrum

    def backward(self, spectrum: npt.ArrayLike) -> FloatArray:
        """Return the unnormalised inverse transform of a spectrum of any layout, as a new flat field."""
        own, field = self.empty_spectrum(), self.empty_field()
        own[:] = np.ravel(spectrum)
        _execute_backward(self.plans, own, field)
        return field


def aligned(size: int) -> FloatArray:
    """Numbers, uninitialised, as any plan accepts them."""
    return np.asarray(pyfftw.empty_aligned(size, np.float64, n=64))


def _described(plan: int) -> str:
    text = _fftw.fftw_sprint_plan(plan)
    try:
        return ctypes.string_at(text).decode()
    finally:
        _fftw.free(text)


def _address(function: Any) -> int:
    address = ctypes.cast(function, ctypes.c_void_p).value
    if address is None:
        raise RuntimeError("pyfftw's FFTW does not export its C interface")
    return address


@kernel
def _execute_forward(plans: Plans, field: FloatArray, spectrum: ComplexArray) -> None:
    forward(plans, field, spectrum)


@kernel
def _execute_backward(plans: Plans, spectrum: ComplexArray, field: FloatArray) -> None:
    backward(plans, spectrum, field)
