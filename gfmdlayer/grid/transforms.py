"""Real Fourier transforms of fields on the grid, by FFTW, from Python and from nopython code.

Convention, stated here once: ``forward`` is the unnormalised real-to-complex transform U_k = sum_j u_j exp(-i
q_k x_j) (counted from the first grid point), ``backward`` its unnormalised inverse, so that
backward(forward(u)) = n u; the caller multiplies by 1/n. ``backward`` destroys its input.

Plans and functions reach compiled kernels as addresses, plain integers, which a cached kernel accepts.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba.core import cgutils, types

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.grid.fftw import (
    ALIGNED,
    DOUBLE,
    FUNCTION,
    SINGLE,
    address,
    aligned,
    call,
    column_plans,
    filter_plans,
    row_plans,
    whole_plans,
)
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.kernels import IN_PYTHON, c_function, kernel, primitive
from gfmdlayer.made_once import made_once


class Plans(NamedTuple):
    """Addresses of FFTW's plans and of the functions that execute them, for nopython code."""

    forward_plan: int
    backward_plan: int
    execute_forward: int
    execute_backward: int


def _execute_in_python(function: int, plan: int, source: Any, target: Any) -> None:
    # Addresses in arrays are numbers of NumPy, which ctypes does not take.
    places = (each.ctypes.data if isinstance(each, np.ndarray) else int(each) for each in (source, target))
    call(int(function), int(plan), *places)


@primitive(_execute_in_python)
def execute(
    _context: Any, _function: Any, _plan: Any, source: Any, target: Any
) -> tuple[Any, Any]:  # numba's own types, which carry no annotations
    """Call ``void function(plan, source, target)`` by address; source and target are arrays or addresses."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = cgutils.voidptr_t
        function_type = ir.FunctionType(ir.VoidType(), [pointer, pointer, pointer])
        callee = builder.inttoptr(arguments[0], function_type.as_pointer())
        places = [
            builder.inttoptr(value, pointer)
            if isinstance(kind, types.Integer)
            else builder.bitcast(context.make_array(kind)(context, builder, value).data, pointer)
            for kind, value in zip(signature.args[2:], arguments[2:], strict=True)
        ]
        builder.call(callee, [builder.inttoptr(arguments[1], pointer), *places])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, source, target), codegen


@kernel(borrows=True)
def _execute(function: int, plan: int, source: Any, target: Any) -> None:
    """`execute` for Python: a tenth of the time of a call through ctypes."""
    execute(function, plan, source, target)


@nb.njit(inline="always")
def forward(plans: Plans, field: FloatArray, spectrum: ComplexArray) -> None:
    """Transform ``field`` into ``spectrum``, real-to-complex, both flat and from `Transforms`."""
    execute(plans.execute_forward, plans.forward_plan, field, spectrum)


@nb.njit(inline="always")
def backward(plans: Plans, spectrum: ComplexArray, field: FloatArray) -> None:
    """Unnormalised complex-to-real transform of ``spectrum``, which is destroyed, into ``field``."""
    execute(plans.execute_backward, plans.backward_plan, spectrum, field)


# Of more points than this, surfaces are transformed along the rows and then along blocks of columns. FFTW's
# estimate would transform column by column in place, which costs twice its best way at 1024 x 1024.
BY_BLOCKS = 1 << 18
_COLUMNS = 16  # of a block, for a thread


class Columns:
    """Transforms of the columns of a spectrum in place, a block of them into a buffer and back.

    Rows may be given, with their plans: then they are transformed before, or after on the way back. `forward`
    and `backward` are addresses of work for the functions of `by_blocks`.
    """

    def __init__(
        self, shape: tuple[int, ...], threads: int, single: bool, rows: tuple[int, int] = (0, 0)
    ) -> None:
        count, width = shape
        fftw, block = SINGLE if single else DOUBLE, min(_COLUMNS * threads, width)
        whole, rest = (
            column_plans((count, width), number, threads, single) if number else (0, 0, 0)
            for number in (block, width % block)
        )
        self._buffer = aligned(2 * count * block, single)
        of_blocks = self._buffer.ctypes.data, width // block, block * (8 if single else 16)
        self._work = [
            np.array([function, plan, address(fftw.execute_dft), *of_blocks, *plans], dtype=np.int64)
            for function, plan, plans in (
                (address(fftw.execute_dft_r2c), rows[0], (whole[0], whole[2], rest[0], rest[2])),
                (address(fftw.execute_dft_c2r), rows[1], (whole[1], whole[2], rest[1], rest[2])),
            )
        ]
        self.forward, self.backward = (work.ctypes.data for work in self._work)


@nb.njit(inline="always")
def _transform_columns(work: Any, spectrum: int) -> None:
    _, _, function, buffer, blocks, size, there, back, rest_there, rest_back = work
    for _ in range(blocks):
        execute(function, there, spectrum, buffer)
        execute(function, back, buffer, spectrum)
        spectrum += size
    if rest_there:
        execute(function, rest_there, spectrum, buffer)
        execute(function, rest_back, buffer, spectrum)


def _forward_by_blocks(place: Any, field: int, spectrum: int) -> None:
    work = place[0]
    if work[1]:
        execute(work[0], work[1], field, spectrum)
    _transform_columns(work, spectrum)


def _backward_by_blocks(place: Any, spectrum: int, field: int) -> None:
    work = place[0]
    _transform_columns(work, spectrum)
    if work[1]:
        execute(work[0], work[1], spectrum, field)


@cache
def _of_c() -> tuple[Any, Any]:
    """Return both as functions of C, which live as long as the process."""
    if IN_PYTHON:
        return _called_in_python(_forward_by_blocks), _called_in_python(_backward_by_blocks)
    integers = types.UniTuple(types.int64, 10)  # type: ignore[no-untyped-call]
    given = types.CPointer(integers), types.int64, types.int64  # type: ignore[no-untyped-call]
    return c_function(_forward_by_blocks, *given), c_function(_backward_by_blocks, *given)


def _called_in_python(own: Callable[..., None]) -> Any:
    work = ctypes.c_int64 * 10
    return FUNCTION(lambda place, *fields: own([work.from_address(place or 0)], *fields))


def by_blocks() -> tuple[int, int]:
    """Addresses of the functions of a forward and a backward transform for the work of `Columns`."""
    functions = (each if IN_PYTHON else each.ctypes for each in _of_c())
    forward, backward = map(address, functions)
    return forward, backward


class Filter:
    """Multiplies the modes of fields by real factors, one a mode."""

    def __init__(self, transforms: Transforms, factors: npt.NDArray[Any]) -> None:
        self._transforms, self._factors = transforms, factors
        self._spectrum = transforms.empty_spectrum()

    def __call__(self, field: Any, target: Any) -> None:
        """Write the field of the multiplied modes; both flat, from `Transforms.empty_field`."""
        self._transforms.transform(field, self._spectrum)
        _multiply(self._factors, self._spectrum)
        self._transforms.transform_back(self._spectrum, target)


@kernel(reorder=True, borrows=True)
def _multiply(factors: Any, spectrum: Any) -> None:
    """Multiply a spectrum by the factors of its modes."""
    for k in range(spectrum.size):
        spectrum[k] *= factors[k]


class SurfaceFilter(Filter):
    """A filter that reads and writes the columns of a spectrum once: there, factors and back in a buffer."""

    def __init__(self, transforms: Transforms, factors: npt.NDArray[Any]) -> None:
        super().__init__(transforms, factors)
        threads, single = transforms.threads, transforms.single
        count, width = transforms.spectral_shape
        fftw, block = SINGLE if single else DOUBLE, min(_COLUMNS * threads, width)
        # From one row to the next it is farther than a page of large surfaces: copies go there less often.
        copied = transforms.size > BY_BLOCKS
        self._whole, self._rest = (
            filter_plans((count, width), number, threads, single, copied) if number else (0, 0, 0, 0)
            for number in (block, width % block)
        )
        self._rows = row_plans(transforms.shape, threads, single)
        self._functions = (
            address(fftw.execute_dft_r2c), address(fftw.execute_dft), address(fftw.execute_dft_c2r)
        )  # fmt: skip
        self._factors = np.ascontiguousarray(factors.reshape(count, width).T).ravel()  # as in the buffer
        self._near, self._far = (
            aligned(2 * count * block, single).view(self._spectrum.dtype) for _ in range(2)
        )

    def __call__(self, field: Any, target: Any) -> None:
        """Write the field of the multiplied modes; both flat, from `Transforms.empty_field`."""
        plans = self._functions, self._rows, self._whole, self._rest
        count, buffers = self._transforms.spectral_shape[0], (self._near, self._far)
        _filter_surface(*plans, count, self._factors, *buffers, field, self._spectrum, target)


@kernel(reorder=True, borrows=True)
def _filter_surface(
    functions: tuple[int, int, int], rows: tuple[int, int], whole: tuple[int, int, int, int],
    rest: tuple[int, int, int, int], count: int, factors: Any, near: Any, far: Any, field: Any, spectrum: Any,
    target: Any,
) -> None:  # fmt: skip
    execute(functions[0], rows[0], field, spectrum)
    for begin in range(0, factors.size, far.size):
        some, columns = factors[begin : begin + far.size], spectrum[begin // count :]
        plans = whole if some.size == far.size else rest
        place = columns
        if plans[0]:
            execute(functions[1], plans[0], columns, near)
            place = near
        execute(functions[1], plans[1], place, far)
        for k in range(some.size):
            far[k] *= some[k]
        execute(functions[1], plans[2], far, place)
        if plans[3]:
            execute(functions[1], plans[3], near, columns)
    execute(functions[2], rows[1], spectrum, target)


class Transforms:
    """Forward and backward plans for one shape, and the aligned arrays that they accept."""

    ranks: Ranks = ALONE

    def __init__(self, shape: tuple[int, ...], *, threads: int = 1, single: bool = False) -> None:
        # Transforms of `fftw.WORTH_THREADS` points or more use the threads, of which OpenMP starts no more
        # than OMP_NUM_THREADS allowed, or two, when the process began.
        self.shape, self.threads, self.single = shape, threads, single
        self.points = shape  # along each axis, of all processes
        self.size, self.spectral_shape = math.prod(shape), (*shape[:-1], shape[-1] // 2 + 1)
        self.by_blocks = len(shape) == 2 and self.size > BY_BLOCKS
        if self.by_blocks:
            self._columns = Columns(self.spectral_shape, threads, single, row_plans(shape, threads, single))
            self.plans = Plans(self._columns.forward, self._columns.backward, *by_blocks())
        else:
            fftw = SINGLE if single else DOUBLE
            functions = address(fftw.execute_dft_r2c), address(fftw.execute_dft_c2r)
            self.plans = Plans(*whole_plans(shape, threads, single), *functions)

    def for_window(self, divisor: int) -> Transforms:
        """Transforms of a window with 1/divisor of the points of each axis."""
        return self.of_shape(tuple(points // divisor for points in self.shape))

    def of_shape(self, shape: tuple[int, ...], *, single: bool = False) -> Transforms:
        """Transforms of another shape or precision, with as many threads."""
        return shared_transforms(shape, self.threads, single)

    def empty_field(self) -> Any:
        """Uninitialised flat field, aligned as the plans need it."""
        return aligned(math.prod(self.shape), self.single)

    def empty_spectrum(self) -> Any:
        """Uninitialised flat spectrum, aligned as the plans need it."""
        kind = np.complex64 if self.single else np.complex128
        return aligned(2 * math.prod(self.spectral_shape), self.single).view(kind)

    def reserved(self, fields: int, spectra: int) -> Reserve:
        """Return so many empty fields and spectra in one piece of memory."""
        return Reserve(self, fields, spectra)

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
        _execute(self.plans.execute_forward, self.plans.forward_plan, field, spectrum)

    def transform_back(self, spectrum: Any, field: Any) -> None:
        """Write the inverse transform of a spectrum, which is destroyed; both flat."""
        _execute(self.plans.execute_backward, self.plans.backward_plan, spectrum, field)

    def filter(self, factors: npt.NDArray[Any]) -> Filter:
        """Return what multiplies the modes of a field by factors, of the precision of the transforms."""
        return (SurfaceFilter if len(self.shape) == 2 else Filter)(self, factors)

    def truncated(self, spectrum: npt.NDArray[Any], coarser: Transforms) -> npt.NDArray[Any]:
        """Return the modes that a coarser grid of the same cell has too, as a new flat spectrum."""
        # It is complex of a field, or real of an even function of the wavevector.
        return truncated(spectrum, self.shape, coarser.shape)


class Reserve:
    """Uninitialised fields and spectra of some transforms, cut from one piece of memory."""

    def __init__(self, transforms: Transforms, fields: int, spectra: int) -> None:
        self.shape, self._spectral = transforms.shape, 2 * math.prod(transforms.spectral_shape)
        self._size, self._kind = math.prod(self.shape), np.complex64 if transforms.single else np.complex128
        # Each begins as far from a multiple of `ALIGNED` as the first, and not a power of two after another.
        self._spaces = [-(-size // ALIGNED) * ALIGNED + ALIGNED for size in (self._size, self._spectral)]
        self._left = aligned(fields * self._spaces[0] + spectra * self._spaces[1], transforms.single)

    def empty_field(self) -> Any:
        """Return the next field."""
        field, self._left = self._left[: self._size], self._left[self._spaces[0] :]
        return field

    def empty_spectrum(self) -> Any:
        """Return the next spectrum."""
        spectrum, self._left = self._left[: self._spectral], self._left[self._spaces[1] :]
        return spectrum.view(self._kind)


@made_once(lambda transforms: math.inf if transforms.by_blocks else 0.0, count=64)
def shared_transforms(shape: tuple[int, ...], threads: int = 1, single: bool = False) -> Transforms:
    """Return the transforms of a shape, made once unless they have a work array, as those by blocks do."""
    return Transforms(shape, threads=threads, single=single)


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
