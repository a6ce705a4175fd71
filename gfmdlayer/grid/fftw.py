"""FFTW's plans, made through ctypes, and the cache of them in a process.

pyfftw brings FFTW but no way into it from nopython code. Its extension module exports the C functions of the
library that it loaded, so plans are made and wisdom is shared through those (FFTW manual, "Guru" and "Wisdom"
chapters). FFTW has one wisdom for all plans of a process: so the cache belongs to the process as well.
"""

from __future__ import annotations

import ctypes
import math
import weakref
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyfftw

# Points of a field below which threads are not used: there a transform takes about a millisecond. On busy
# cores they lost up to 1024 x 1024 points and were even at 2048 x 2048; on idle ones they are not measured.
WORTH_THREADS = 1 << 18

_MEASURE, _DESTROY_INPUT = 0, 1 << 0  # fftw3.h
_NEXT = "\n(fftw"  # where the wisdom of the next precision begins

_INT, _POINTER = ctypes.c_int, ctypes.c_void_p
_PLANNER = (_POINTER, [_INT, ctypes.POINTER(_INT), _POINTER, _POINTER, ctypes.c_uint])
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "plan_dft_r2c": _PLANNER,
    "plan_dft_c2r": _PLANNER,
    "execute_dft_r2c": (None, [_POINTER] * 3),
    "execute_dft_c2r": (None, [_POINTER] * 3),
    "destroy_plan": (None, [_POINTER]),
    "sprint_plan": (_POINTER, [_POINTER]),
    "set_timelimit": (None, [ctypes.c_double]),
    "init_threads": (_INT, []),
    "plan_with_nthreads": (None, [_INT]),
}
C: Any = ctypes.CDLL(pyfftw.pyfftw.__file__)
C.free.restype, C.free.argtypes = None, [_POINTER]


def _functions(prefix: str) -> Any:
    """FFTW's functions in one precision, whose names begin alike."""
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(C, f"{prefix}_{name}")
        function.restype, function.argtypes = result, arguments
    return SimpleNamespace(**{name: getattr(C, f"{prefix}_{name}") for name in _SIGNATURES})


DOUBLE, SINGLE = _functions("fftw"), _functions("fftwf")


class PlanPair:
    """A forward and a backward plan, destroyed when neither the cache nor a `Transforms` holds them.

    Parameters
    ----------
    shape : tuple of int
        Shape of the fields.
    time_limit : float
        Seconds that measuring may take.
    threads : int
        Threads of a transform of `WORTH_THREADS` points or more.
    single : bool
        Whether in single precision.

    Raises
    ------
    RuntimeError
        If FFTW makes no plan.
    """

    def __init__(self, shape: tuple[int, ...], time_limit: float, threads: int, single: bool) -> None:
        size, modes = math.prod(shape), math.prod(shape[:-1]) * (shape[-1] // 2 + 1)
        field, spectrum = aligned(size, single), aligned(2 * modes, single)  # measured on
        fftw = self._functions = SINGLE if single else DOUBLE
        axes = len(shape), (_INT * len(shape))(*shape)
        fftw.set_timelimit(time_limit)
        if threads > 1 and size >= WORTH_THREADS and fftw.init_threads():
            fftw.plan_with_nthreads(threads)
        self.forward = fftw.plan_dft_r2c(*axes, field.ctypes.data, spectrum.ctypes.data, _MEASURE)
        self.backward = fftw.plan_dft_c2r(
            *axes, spectrum.ctypes.data, field.ctypes.data, _MEASURE | _DESTROY_INPUT
        )
        if threads > 1:
            fftw.plan_with_nthreads(1)
        for plan in filter(None, (self.forward, self.backward)):
            weakref.finalize(self, fftw.destroy_plan, plan)
        if not (self.forward and self.backward):
            raise RuntimeError(f"FFTW has no plan for fields of shape {shape}")

    @property
    def description(self) -> str:
        """Both plans as FFTW prints them: how they split the transform, and by which codelets."""
        return "\n".join(self._described(plan) for plan in (self.forward, self.backward))

    def _described(self, plan: int) -> str:
        text = self._functions.sprint_plan(plan)
        try:
            return ctypes.string_at(text).decode()
        finally:
            C.free(text)


class _Cache:
    """The plans of this process, and the wisdom that they were made from."""

    def __init__(self) -> None:
        self.wisdom: str | None = None
        self.pairs: dict[tuple[tuple[int, ...], float, int, bool], PlanPair] = {}


_cache = _Cache()


def plan_pair(
    shape: tuple[int, ...], wisdom: str | None, time_limit: float, threads: int, single: bool
) -> PlanPair:
    """Plans of a shape, from the cache if they were made from the same wisdom before.

    Parameters
    ----------
    shape, time_limit, threads, single
        As in `PlanPair`.
    wisdom : str, optional
        Wisdom that FFTW imports first.

    Returns
    -------
    PlanPair
        Planning takes as long as a time step, and importing wisdom takes longer than planning.
    """
    if wisdom and wisdom != _cache.wisdom:
        forget_wisdom()  # FFTW ignores imported wisdom that it ranks below its own
        double, begin, single_too = wisdom.partition(_NEXT)
        pyfftw.import_wisdom((double.encode(), (begin + single_too).lstrip().encode(), b""))
    _cache.wisdom = wisdom
    key = shape, time_limit, threads, single
    if key not in _cache.pairs:
        _cache.pairs[key] = PlanPair(*key)
    return _cache.pairs[key]


def export_wisdom() -> str:
    """FFTW's accumulated wisdom in double precision, followed by that in single precision."""
    double, single, _ = pyfftw.export_wisdom()
    return str(double.decode().rstrip() + "\n" + single.decode())


def forget_wisdom() -> None:
    """Discard all wisdom, imported or measured, and the plans in the cache."""
    pyfftw.forget_wisdom()
    _cache.wisdom = None
    _cache.pairs.clear()


def aligned(size: int, single: bool = False) -> Any:
    """Uninitialised flat real numbers, aligned as any plan accepts them."""
    return pyfftw.empty_aligned(size, np.float32 if single else np.float64, n=64)


def address(function: Any) -> int:
    """Address of a C function, as compiled code calls it."""
    return int(ctypes.cast(function, _POINTER).value or 0)
