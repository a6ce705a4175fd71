"""FFTW's plans, made through ctypes, and the cache of them in a process.

pyfftw brings FFTW but no way into it from nopython code. Its extension module exports the C functions of
FFTW, so plans are made and wisdom is shared through those (FFTW manual, "Guru" and "Wisdom" chapters). It is
loaded as a library, since the package itself imports SciPy's transforms too. FFTW has one wisdom for all
plans of a process: so the cache belongs to the process as well.
"""

from __future__ import annotations

import ctypes
import math
import os
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np

# FFTW's threads sleep between transforms. Those of GNU's OpenMP would turn for milliseconds instead, on the
# cores of the passes in between: at 2048 x 2048 points these gained nothing by a second thread.
_POLICY = "OMP_WAIT_POLICY"


def _library() -> Any:
    """Load pyfftw's extension module as a library."""
    found = find_spec("pyfftw")
    folders = map(Path, (found and found.submodule_search_locations) or ())
    files = [folder / f"pyfftw{suffix}" for folder in folders for suffix in EXTENSION_SUFFIXES]
    file = next((each for each in files if each.exists()), None)
    if file is None:
        raise ImportError("pyfftw is not installed; pip install pyfftw")
    given = os.environ.get(_POLICY)
    os.environ.setdefault(_POLICY, "passive")  # OpenMP reads it when it is loaded
    library = ctypes.CDLL(str(file))
    if given is None:
        del os.environ[_POLICY]
    return library


# Points of a field below which threads are not used: there a transform takes about a millisecond. On busy
# cores they lost up to 1024 x 1024 points and were even at 2048 x 2048; on two idle ones a first solve of
# 512 x 512 is even, and of 2048 x 2048 1.34 times as fast.
WORTH_THREADS = 1 << 18

_MEASURE, _DESTROY_INPUT = 0, 1 << 0  # fftw3.h
_ALIGNED = 64  # bytes
_NEXT = "\n(fftw"  # where the wisdom of the next precision begins

_INT, _POINTER = ctypes.c_int, ctypes.c_void_p
_PLANNER = (_POINTER, [_INT, ctypes.POINTER(_INT), _POINTER, _POINTER, ctypes.c_uint])
_LAYOUT = [_POINTER, ctypes.POINTER(_INT), _INT, _INT]  # array, embedding, stride and distance
_MANY = [_INT, ctypes.POINTER(_INT), _INT, *_LAYOUT, *_LAYOUT]
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "plan_dft_r2c": _PLANNER,
    "plan_dft_c2r": _PLANNER,
    "plan_many_dft_r2c": (_POINTER, [*_MANY, ctypes.c_uint]),
    "plan_many_dft_c2r": (_POINTER, [*_MANY, ctypes.c_uint]),
    "plan_many_dft": (_POINTER, [*_MANY, _INT, ctypes.c_uint]),
    "execute_dft": (None, [_POINTER] * 3),
    "execute_dft_r2c": (None, [_POINTER] * 3),
    "execute_dft_c2r": (None, [_POINTER] * 3),
    "destroy_plan": (None, [_POINTER]),
    "sprint_plan": (_POINTER, [_POINTER]),
    "set_timelimit": (None, [ctypes.c_double]),
    "init_threads": (_INT, []),
    "plan_with_nthreads": (None, [_INT]),
    "import_wisdom_from_string": (_INT, [ctypes.c_char_p]),
    "export_wisdom_to_string": (_POINTER, []),
    "forget_wisdom": (None, []),
}
C: Any = _library()
C.free.restype, C.free.argtypes = None, [_POINTER]
VERSION = (ctypes.c_char * 32).in_dll(C, "fftw_version").value.decode().split("-")[1]  # "fftw-3.3.5-sse2"


def _functions(prefix: str) -> Any:
    """FFTW's functions in one precision, whose names begin alike."""
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(C, f"{prefix}_{name}")
        function.restype, function.argtypes = result, arguments
    return SimpleNamespace(**{name: getattr(C, f"{prefix}_{name}") for name in _SIGNATURES})


DOUBLE, SINGLE = _functions("fftw"), _functions("fftwf")
for _each in (DOUBLE, SINGLE):  # before the first plan, as threads belong to the planner and its wisdom
    _each.init_threads()


def _taken(text: int) -> str:
    """Return a string that FFTW made, and free it."""
    try:
        return ctypes.string_at(text).decode()
    finally:
        C.free(text)


class PlanPair:
    """A forward and a backward plan, destroyed with the last user; RuntimeError if FFTW makes no plan."""

    def __init__(self, shape: tuple[int, ...], time_limit: float, threads: int, single: bool) -> None:
        size, modes = math.prod(shape), math.prod(shape[:-1]) * (shape[-1] // 2 + 1)
        field, spectrum = aligned(size, single), aligned(2 * modes, single)  # measured on
        fftw = self._functions = SINGLE if single else DOUBLE
        axes = len(shape), (_INT * len(shape))(*shape)
        with _planning(fftw, time_limit, threads if size >= WORTH_THREADS else 1):
            self.forward = fftw.plan_dft_r2c(*axes, field.ctypes.data, spectrum.ctypes.data, _MEASURE)
            self.backward = fftw.plan_dft_c2r(
                *axes, spectrum.ctypes.data, field.ctypes.data, _MEASURE | _DESTROY_INPUT
            )
        self._keep(shape, self.forward, self.backward)

    def _keep(self, shape: tuple[int, ...], *plans: int) -> None:
        for plan in filter(None, plans):
            weakref.finalize(self, self._functions.destroy_plan, plan)
        if not all(plans):
            raise RuntimeError(f"FFTW has no plan for fields of shape {shape}")
        self._plans = plans

    @property
    def description(self) -> str:
        """The plans as FFTW prints them: how they split the transforms, and by which codelets."""
        return "\n".join(_taken(self._functions.sprint_plan(plan)) for plan in self._plans)


class SlabPlans(PlanPair):
    """Plans of a rank that holds some rows of a surface and some columns of its transform."""

    def __init__(self, shape: tuple[int, ...], time_limit: float, threads: int, single: bool) -> None:
        # The shape is (rows, n) and (n, columns), one after the other. `forward` and `backward` act along the
        # rows, `columns_forward` and `columns_backward` along the columns, complex and in place.
        count, length, height, width = shape
        modes = length // 2 + 1
        sizes = count * length, 2 * count * modes, 2 * height * width
        field, waves, spectrum = (aligned(size, single) for size in sizes)
        fftw = self._functions = SINGLE if single else DOUBLE
        real, complex_ = (field.ctypes.data, None, 1, length), (waves.ctypes.data, None, 1, modes)
        columns = (spectrum.ctypes.data, None, width, 1)
        rows, axis = (1, (_INT * 1)(length), count), (1, (_INT * 1)(height), width)
        with _planning(fftw, time_limit, threads if count * length >= WORTH_THREADS else 1):
            self.forward = fftw.plan_many_dft_r2c(*rows, *real, *complex_, _MEASURE)
            self.backward = fftw.plan_many_dft_c2r(*rows, *complex_, *real, _MEASURE | _DESTROY_INPUT)
            self.columns_forward, self.columns_backward = (
                fftw.plan_many_dft(*axis, *columns, *columns, sign, _MEASURE) for sign in (-1, 1)
            )
        self._keep(shape, self.forward, self.columns_forward, self.columns_backward, self.backward)


@contextmanager
def _planning(fftw: Any, time_limit: float, threads: int) -> Iterator[None]:
    """Plan in the block within seconds, for a number of threads."""
    fftw.set_timelimit(time_limit)
    if threads > 1:
        fftw.plan_with_nthreads(threads)
    yield
    if threads > 1:
        fftw.plan_with_nthreads(1)


Made = TypeVar("Made", bound=PlanPair)


# The plans of this process, and the wisdom that they were made from.
_cache: Any = SimpleNamespace(wisdom=None, pairs={})


def plan_pair(
    kind: type[Made],
    shape: tuple[int, ...],
    wisdom: str | None,
    time_limit: float,
    threads: int,
    single: bool,
) -> Made:
    """Plans of a shape, from the cache if they were made from the same wisdom before."""
    if wisdom and wisdom != _cache.wisdom:
        forget_wisdom()  # FFTW ignores imported wisdom that it ranks below its own
        double, begin, single_too = wisdom.partition(_NEXT)
        DOUBLE.import_wisdom_from_string(double.encode())
        SINGLE.import_wisdom_from_string((begin + single_too).lstrip().encode())
    _cache.wisdom = wisdom
    key = kind, shape, time_limit, threads, single
    if key not in _cache.pairs:
        _cache.pairs[key] = kind(*key[1:])
    found: Made = _cache.pairs[key]
    return found


def export_wisdom() -> str:
    """FFTW's accumulated wisdom in double precision, followed by that in single precision."""
    double, single = (_taken(each.export_wisdom_to_string()) for each in (DOUBLE, SINGLE))
    return double.rstrip() + "\n" + single


def forget_wisdom() -> None:
    """Discard all wisdom, imported or measured, and the plans in the cache."""
    DOUBLE.forget_wisdom()
    SINGLE.forget_wisdom()
    _cache.wisdom = None
    _cache.pairs.clear()


def aligned(size: int, single: bool = False) -> Any:
    """Uninitialised flat real numbers, aligned as any plan accepts them."""
    kind = np.float32 if single else np.float64
    count = np.dtype(kind).itemsize * size
    memory = np.empty(count + _ALIGNED, np.uint8)
    start = -memory.ctypes.data % _ALIGNED
    return memory[start : start + count].view(kind)


def address(function: Any) -> int:
    """Address of a C function, as compiled code calls it."""
    return int(ctypes.cast(function, _POINTER).value or 0)
