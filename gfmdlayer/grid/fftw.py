"""FFTW's plans, made through ctypes, and the cache of them in a process.

pyfftw brings FFTW but no way into it from nopython code, so plans are made through the C functions of FFTW
(FFTW manual, "Guru" chapter), of this or of a user's own build (`library`).

FFTW chooses its algorithm by an estimate of the operations (FFTW_ESTIMATE), not by a stopwatch: the bits of a
transform then follow from its shape, its precision, its threads and the processor.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any

import numpy as np

from gfmdlayer.grid.library import FftwAxis, FftwError, cores, library

# Points of a field below which threads are not used: there a transform takes about a millisecond. On busy
# cores they lost up to 1024 x 1024 points and were even at 2048 x 2048; on two idle ones a first solve of
# 512 x 512 is .88 times as fast, of 1024 x 1024 even, and of 2048 x 2048 1.16 times as fast.
WORTH_THREADS = 1 << 18
# Points of a surface from which two threads have been measured not to lose on busy cores either.
ALWAYS_WORTH_THREADS = 1 << 22


def threads_for(shape: tuple[int, ...], asked: int | None) -> int:
    """Return the threads for fields of a shape: as asked, or two for a surface where they do not lose."""
    if asked is not None:
        return asked
    large = len(shape) == 2 and math.prod(shape) >= ALWAYS_WORTH_THREADS
    return 2 if large and library().threads and len(cores()) > 1 else 1


_ESTIMATE, _DESTROY_INPUT = 1 << 6, 1 << 0  # fftw3.h
ALIGNED = 64  # bytes

_INT, _POINTER = ctypes.c_int, ctypes.c_void_p

# Fields are made anew in each step. Memory of some megabytes would go back to the system each time, and come
# again page by page, empty: a seventh of a step of 512 x 512 points. The options stand in malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = (-1, 1 << 28), (-3, 1 << 25)  # bytes; the second is the largest allowed


def _keep_freed_memory() -> None:
    """Let the C library keep freed memory for the next step, where it can."""
    with suppress(AttributeError):
        set_option = ctypes.CDLL(None).mallopt
        for option, size in (_TRIM_THRESHOLD, _MMAP_THRESHOLD):
            set_option(option, size)


_keep_freed_memory()


DOUBLE, SINGLE = library().double, library().single
if library().threads:
    for _each in (DOUBLE, SINGLE):  # before the first plan, as threads belong to the planner
        _each.init_threads()


# Plans are made once in a process, and live as long as it.


@cache
def whole_plans(shape: tuple[int, ...], threads: int, single: bool) -> tuple[int, int]:
    """Plans of a forward and a backward transform."""
    size, modes = math.prod(shape), math.prod(shape[:-1]) * (shape[-1] // 2 + 1)
    field, spectrum = aligned(size, single), aligned(2 * modes, single)
    axes, places = (len(shape), (_INT * len(shape))(*shape)), (field.ctypes.data, spectrum.ctypes.data)
    with _planning(single, threads if size >= WORTH_THREADS else 1) as fftw:
        return (
            _made(fftw.plan_dft_r2c(*axes, *places, _ESTIMATE)),
            _made(fftw.plan_dft_c2r(*axes, *places[::-1], _ESTIMATE | _DESTROY_INPUT)),
        )


@cache
def row_plans(shape: tuple[int, int], threads: int, single: bool) -> tuple[int, int]:
    """Plans of a forward and a backward transform along each row."""
    (count, length), modes = shape, shape[1] // 2 + 1
    fields, waves = aligned(count * length, single), aligned(2 * count * modes, single)
    rows, real = (1, (_INT * 1)(length), count), (fields.ctypes.data, None, 1, length)
    spectra = waves.ctypes.data, None, 1, modes
    with _planning(single, threads if count * length >= WORTH_THREADS else 1) as fftw:
        return (
            _made(fftw.plan_many_dft_r2c(*rows, *real, *spectra, _ESTIMATE)),
            _made(fftw.plan_many_dft_c2r(*rows, *spectra, *real, _ESTIMATE | _DESTROY_INPUT)),
        )


@cache
def column_plans(shape: tuple[int, int], block: int, threads: int, single: bool) -> tuple[int, int, int]:
    """Plans of a forward and a backward transform of some columns into a buffer, and of the way back.

    The buffer holds one column after the other.
    """
    count, width = shape
    spectrum, columns = (aligned(2 * count * each, single) for each in (width, block))
    into = (count, width, 1), (block, 1, count), spectrum, columns
    with _planning(single, threads if count * width >= WORTH_THREADS else 1) as fftw:
        forward, backward = (_along(fftw, *into, sign) for sign in (-1, 1))
    with _planning(single, 1) as fftw:
        return forward, backward, _copy(fftw, (count, 1, width), (block, count, 1), columns, spectrum)


@cache
def filter_plans(
    shape: tuple[int, int], block: int, threads: int, single: bool, copied: bool
) -> tuple[int, int, int, int]:
    """Plans of some columns' way into a buffer and back: a copy, both transforms, and a copy.

    The transforms read and write another buffer if the columns are copied, else the spectrum itself.
    """
    count, width = shape
    spectrum, near, far = (aligned(2 * count * each, single) for each in (width, block, block))
    stride, apart, place = (1, count, near) if copied else (width, 1, spectrum)
    with _planning(single, threads if count * width >= WORTH_THREADS else 1) as fftw:
        forward = _along(fftw, (count, stride, 1), (block, apart, count), place, far, -1)
        backward = _along(fftw, (count, 1, stride), (block, count, apart), far, place, 1)
    if not copied:
        return 0, forward, backward, 0
    with _planning(single, 1) as fftw:
        there = _copy(fftw, (count, width, 1), (block, 1, count), spectrum, near)
        return there, forward, backward, _copy(fftw, (count, 1, width), (block, count, 1), near, spectrum)


_Axis = tuple[int, int, int]  # points, and strides of source and target


def _along(fftw: Any, along: _Axis, across: _Axis, source: Any, target: Any, sign: int) -> int:
    """Plan of transforms along an axis."""
    axes = ((FftwAxis * 1)(FftwAxis(*axis)) for axis in (along, across))
    places = source.ctypes.data, target.ctypes.data
    return _made(fftw.plan_guru_dft(1, next(axes), 1, next(axes), *places, sign, _ESTIMATE))


def _copy(fftw: Any, one: _Axis, other: _Axis, source: Any, target: Any) -> int:
    """Plan of a copy over two axes."""
    axes, places = (FftwAxis * 2)(FftwAxis(*one), FftwAxis(*other)), (source.ctypes.data, target.ctypes.data)
    return _made(fftw.plan_guru_dft(0, None, 2, axes, *places, -1, _ESTIMATE))


@contextmanager
def _planning(single: bool, threads: int) -> Iterator[Any]:
    """Plan in the block for a number of threads."""
    fftw = SINGLE if single else DOUBLE
    fftw.forget_wisdom()  # an estimate takes over what another user of FFTW has measured
    if not library().threads:
        if threads > 1:
            raise FftwError(f"{library().place} has been built without threads; must run on one thread")
        yield fftw
        return
    fftw.plan_with_nthreads(threads)
    yield fftw
    fftw.plan_with_nthreads(1)


def _made(plan: int | None) -> int:
    if not plan:
        raise RuntimeError("FFTW has no plan for a transform")
    return plan


def aligned(size: int, single: bool = False) -> Any:
    """Uninitialised flat real numbers, aligned as any plan accepts them."""
    kind = np.float32 if single else np.float64
    count = np.dtype(kind).itemsize * size
    memory = np.empty(count + ALIGNED, np.uint8)
    start = -memory.ctypes.data % ALIGNED
    return memory[start : start + count].view(kind)


FUNCTION = ctypes.CFUNCTYPE(None, _POINTER, _POINTER, _POINTER)


def call(function: int, plan: int, source: int, target: int) -> None:
    """Call a function of FFTW, or one like it, that executes a plan, by addresses."""
    FUNCTION(function)(plan, source, target)


def address(function: Any) -> int:
    """Address of a C function, as compiled code calls it."""
    return int(ctypes.cast(function, _POINTER).value or 0)
