"""The FFTW library of a process: the one that pyfftw brings, or a user's own.

pyfftw's extension module exports the C functions of FFTW in both precisions. It is loaded as a library, since
the package itself imports SciPy's transforms too. The environment variable GFMDLAYER_FFTW names a folder with
another build, for example one for the vector units of the processor: libfftw3 and libfftw3f, and beside them
libfftw3_omp and libfftw3f_omp, or libfftw3_threads and libfftw3f_threads, for several threads.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from gfmdlayer.errors import GfmdlayerError

VARIABLE = "GFMDLAYER_FFTW"
PRECISIONS = ("fftw", "fftwf")  # double and single: how the names of the functions begin

_INT, _UNSIGNED, _POINTER = ctypes.c_int, ctypes.c_uint, ctypes.c_void_p


class FftwAxis(ctypes.Structure):
    """fftw_iodim: points and both strides of an axis."""

    _fields_ = (("n", _INT), ("input", _INT), ("output", _INT))


_PLANNER = (_POINTER, [_INT, ctypes.POINTER(_INT), _POINTER, _POINTER, _UNSIGNED])
_LAYOUT = [_POINTER, ctypes.POINTER(_INT), _INT, _INT]  # array, embedding, stride and distance
_MANY = [_INT, ctypes.POINTER(_INT), _INT, *_LAYOUT, *_LAYOUT]
_AXES = [_INT, ctypes.POINTER(FftwAxis)]
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "plan_dft_r2c": _PLANNER,
    "plan_dft_c2r": _PLANNER,
    "plan_many_dft_r2c": (_POINTER, [*_MANY, _UNSIGNED]),
    "plan_many_dft_c2r": (_POINTER, [*_MANY, _UNSIGNED]),
    "plan_guru_dft": (_POINTER, [*_AXES, *_AXES, _POINTER, _POINTER, _INT, _UNSIGNED]),
    "execute_dft": (None, [_POINTER] * 3),
    "execute_dft_r2c": (None, [_POINTER] * 3),
    "execute_dft_c2r": (None, [_POINTER] * 3),
    "forget_wisdom": (None, []),
}
_OF_THREADS: dict[str, tuple[Any, list[Any]]] = {
    "init_threads": (_INT, []),
    "plan_with_nthreads": (None, [_INT]),
}

# What OpenMP reads when it is loaded. FFTW's threads sleep between transforms: they would turn for
# milliseconds instead, on the cores of the passes in between, which at 2048 x 2048 points gained nothing by a
# second thread. It never allows more threads later: two, where the other libraries of the process have one.
_POLICY, _THREADS = "OMP_WAIT_POLICY", "OMP_NUM_THREADS"


class FftwError(GfmdlayerError, ImportError):
    """The FFTW library cannot be used; the message names the folder, what it lacks, and the remedy."""


class Library(NamedTuple):
    """FFTW's functions by their names without the prefix of the precision."""

    double: Any
    single: Any
    threads: bool  # whether transforms may use several threads
    version: str  # as the library tells it, with the vector units that it knows
    place: str  # file of a user's own library; empty for the one in pyfftw


@cache
def library() -> Library:
    """Return the library of this process, loaded at the first call."""
    return own() or _of_pyfftw()


@cache
def own() -> Library | None:
    """Return the library that the user names, if one is named."""
    folder = os.environ.get(VARIABLE)
    return own_library(Path(folder)) if folder else None


def cores() -> frozenset[int]:
    """Return the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return frozenset(os.sched_getaffinity(0))
    return frozenset(range(os.cpu_count() or 1))


def own_library(folder: Path) -> Library:
    """Load the libraries in a folder."""
    if not folder.is_dir():
        raise FftwError(
            f"{VARIABLE}={folder}: no such folder; must be the folder that holds libfftw3 and libfftw3f, or "
            "unset for the FFTW in pyfftw"
        )
    found, versions = [], []
    for prefix in PRECISIONS:
        name = f"libfftw3{prefix[4:]}"
        file = _file(folder, name)
        if file is None:
            raise FftwError(
                f"{VARIABLE}={folder}: has no {name}; FFTW is needed in double and in single precision "
                "(./configure --enable-shared, and once more with --enable-single)"
            )
        parts = [_load(file)]
        kinds = (_file(folder, f"{name}_{kind}") for kind in ("omp", "threads"))
        parts += [_load(other) for other in kinds if other is not None][:1]
        versions.append(_version(parts[0], prefix, file))
        found.append((_functions(parts, prefix, _SIGNATURES, file), _threads(parts, prefix)))
    (double, first), (single, second) = found
    threads = bool(first and second)
    for functions, own in ((double, first), (single, second)):
        functions.__dict__.update(own if threads else {})
    version = " and ".join(dict.fromkeys(versions))
    return Library(double, single, threads, version, str(_file(folder, "libfftw3")))


def _of_pyfftw() -> Library:
    """Load pyfftw's extension module."""
    spec = find_spec("pyfftw")
    folders = map(Path, (spec and spec.submodule_search_locations) or ())
    files = [folder / f"pyfftw{suffix}" for folder in folders for suffix in EXTENSION_SUFFIXES]
    file = next((candidate for candidate in files if candidate.exists()), None)
    if file is None:
        raise ImportError("pyfftw is not installed; pip install pyfftw")
    module = [_load(file)]
    double, single = (_functions(module, prefix, _SIGNATURES | _OF_THREADS, file) for prefix in PRECISIONS)
    return Library(double, single, True, _version(module[0], "fftw", file), "")


def _file(folder: Path, name: str) -> Path | None:
    """The file of a library, under the names that FFTW's installation gives it, or a wheel."""
    for ending in (".so", ".so.3", ".dylib", ".3.dylib"):
        if (folder / f"{name}{ending}").exists():
            return folder / f"{name}{ending}"
    others = {file.resolve() for file in folder.glob(f"{name}-*.so*")}
    if len(others) > 1:
        names = ", ".join(sorted(file.name for file in others))
        raise FftwError(f"{VARIABLE}={folder}: has several {name}: {names}; must be a folder with one")
    return next(iter(others), None)


def _load(file: Path) -> Any:
    before = {name: os.environ.get(name) for name in (_POLICY, _THREADS)}
    os.environ.setdefault(_POLICY, "passive")
    if before[_THREADS] == "1":
        os.environ[_THREADS] = "2"
    try:
        return ctypes.CDLL(str(file))
    except OSError as error:
        raise FftwError(f"{VARIABLE}: {file} cannot be loaded: {error}") from None
    finally:
        for name, value in before.items():
            if value is not None:
                os.environ[name] = value
            else:
                os.environ.pop(name, None)


def _functions(
    parts: Sequence[Any], prefix: str, signatures: dict[str, tuple[Any, list[Any]]], file: Path
) -> SimpleNamespace:
    """FFTW's functions in one precision."""
    found = SimpleNamespace()
    for name, (result, arguments) in signatures.items():
        function = next((each for part in parts if (each := getattr(part, f"{prefix}_{name}", None))), None)
        if function is None:
            raise FftwError(f"{VARIABLE}: {file} has no function {prefix}_{name}; must be FFTW 3")
        function.restype, function.argtypes = result, arguments
        setattr(found, name, function)
    return found


def _threads(parts: Sequence[Any], prefix: str) -> dict[str, Any]:
    """Return the functions for threads; none where the library has been built without."""
    with_threads = any(hasattr(part, f"{prefix}_init_threads") for part in parts)
    return vars(_functions(parts, prefix, _OF_THREADS, Path())) if with_threads else {}


def _version(part: Any, prefix: str, file: Path) -> str:
    try:
        text = (ctypes.c_char * 0).in_dll(part, f"{prefix}_version")
    except ValueError:
        raise FftwError(f"{VARIABLE}: {file} has no {prefix}_version; must be FFTW 3") from None
    return ctypes.string_at(ctypes.addressof(text)).decode()
