"""How compiled kernels are made: one set of options, and a cache that notices a change in any source.

Numba keeps compiled code beside the module that defines a function and compares only this module.
A kernel that calls one of another module, or uses a constant of it, would keep the old one after an edit.
Here the cache compares the contents of the module and of all modules of the package that it imports.
"""

from __future__ import annotations

import fcntl
import hashlib
import inspect
import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, cached_property
from pathlib import Path
from typing import Any, TypeVar, overload

import numba as nb
import numpy as np
from llvmlite import ir
from numba._dispatcher import compute_fingerprint
from numba.core import cgutils
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.dispatcher import Dispatcher
from numba.core.runtime.nrt import rtsys
from numba.cpython.unsafe.tuple import tuple_setitem
from numba.extending import intrinsic

from gfmdlayer.files.cache import is_writable, user_cache

# Sums may be reordered and products contracted, which the vector units need; NaN and inf keep their meaning.
# A loop that writes has two compiled forms, the second one for arrays that may overlap. Which of them runs
# can depend on where arrays lie, if they are short (some 32 numbers) or begin at an offset, and then so do
# the last bits of a sum in that loop. Such a sum stands in a loop of its own.
FASTMATH = {"reassoc", "contract"}

# Maxima are kept side by side for this many numbers: vector units compare them at once, while a single one
# would wait for each comparison in turn.
LANES = 256

_PACKAGE = Path(__file__).parent
_BEGUN = time.time()
_IMPORT = re.compile(rb"^from gfmdlayer((?:\.\w+)*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)

Function = TypeVar("Function", bound=Callable[..., Any])

# NUMBA_DISABLE_JIT=1 leaves kernels to Python, for debuggers and coverage, a thousand times slower.
IN_PYTHON = bool(nb.config.DISABLE_JIT)  # type: ignore[attr-defined]


def primitive(in_python: Callable[..., Any], *, constants: bool = False) -> Callable[[Any], Any]:
    """Make a function an intrinsic of kernels, `constants` in its types if wanted; another for Python."""
    return lambda typed: in_python if IN_PYTHON else intrinsic(prefer_literal=constants)(typed)


@overload
def kernel(function: Function) -> Function: ...
@overload
def kernel(
    *, reorder: bool = False, inner: bool = False, borrows: bool = False
) -> Callable[[Function], Function]: ...
def kernel(function: Any = None, *, reorder: bool = False, inner: bool = False, borrows: bool = False) -> Any:
    """Compile a function by Numba at its first call, without the interpreter's lock, cached on the disk.

    `reorder` allows to reorder sums (`FASTMATH`), as vector units need it, and gives a division by zero its
    limit, as the check of each would keep loops from them. An `inner` kernel is called only by other kernels:
    it has no entry for Python, which takes longer to compile than a short kernel where many arrays come in
    groups. One that `borrows` makes no array, and returns none to a kernel that does not: references to its
    arrays are not counted, which would take a third of a small step.
    """
    if function is None:
        return lambda decorated: _compiled(decorated, reorder, inner, borrows)
    return _compiled(function, reorder, inner, borrows)


def _compiled(function: Any, reorder: bool, inner: bool, borrows: bool) -> Any:
    options: dict[str, Any] = {"nogil": True, "no_cpython_wrapper": inner, "no_cfunc_wrapper": True}
    options["_nrt"] = not borrows
    if reorder:
        options |= {"fastmath": FASTMATH, "error_model": "numpy"}
    dispatcher = nb.njit(**options)(function)
    if isinstance(dispatcher, Dispatcher):  # not where Python runs it
        dispatcher._cache = _LateCache(function)  # type: ignore[attr-defined]  # as cache=True does
    return dispatcher


def c_function(function: Callable[..., None], *arguments: Any) -> Any:
    """Return a function of C without a result, which lives as long as the process; cached as kernels are."""
    from numba.core.ccallback import CFunc  # loads all that Numba compiles with

    made: Any = CFunc(function, (arguments, nb.types.void), {}, {})
    made._cache = _LateCache(function)
    made.compile()
    return made


def in_python(called: Function) -> Function:
    """Return the Python function of a kernel, for a call by Python that needs no compilation."""
    return getattr(called, "py_func", called)


class _InPython(np.record):  # type: ignore[misc]  # not final at run time
    """A record whose fields are attributes for Python too, also those named as methods of NumPy."""

    def __getattribute__(self, name: str) -> Any:
        names = super().__getattribute__("dtype").names
        return self[name] if name in names else super().__getattribute__(name)

    def __setattr__(self, name: str, value: Any) -> None:
        self[name] = value


def record_type(fields: list[Any]) -> np.dtype[np.void]:
    """Return the type of a record whose fields are attributes in kernels."""
    return np.dtype((_InPython, fields) if IN_PYTHON else fields)


@cache
def _choose_place() -> None:
    """Keep compiled code beside the sources, or among the user's caches where it cannot be kept there."""
    if not (nb.config.CACHE_DIR or is_writable(_PACKAGE / "__pycache__")):  # type: ignore[attr-defined]
        nb.config.CACHE_DIR = str(user_cache() / "kernels")  # type: ignore[attr-defined]


class _LateCache:
    """The cache of a kernel, made at its first call: a process calls few of the kernels that it imports."""

    def __init__(self, function: Any) -> None:
        self._function = function

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    @cached_property
    def _cache(self) -> Any:
        _choose_place()
        try:
            return _SourceCache(self._function)
        except RuntimeError:  # there is no place, or the sources have changed: each process compiles
            return NullCache()


class _SourceCache(FunctionCache):
    """Numba's cache, with the contents of all sources in place of the age of one."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        stamp = source_digest(Path(inspect.getfile(function)))
        place = self._cache_path, self._impl.filename_base
        self._cache_file = IndexDataCacheFile(*place, stamp)  # type: ignore[no-untyped-call]
        # Compared before the index is read, which may name types that are gone from the sources.
        self._cache_file._version = f"{nb.__version__} {stamp}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a compiled kernel, without all that Numba imports to compile one: a fifth of a second."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]


_compiling = 0  # blocks of `compiling` in this process, within each other or left open by a failure


@contextmanager
def compiling() -> Iterator[None]:
    """Let one process at a time compile; those that wait then find the kernels in the cache.

    A process does not wait for itself: blocks may stand within each other.
    """
    global _compiling
    with ExitStack() as stack:
        _compiling += 1
        stack.callback(_end_compiling)
        if _compiling > 1:
            yield
            return
        _choose_place()
        with suppress(OSError):  # on a file system without locks all may compile
            place = Path(nb.config.CACHE_DIR or _PACKAGE / "__pycache__")  # type: ignore[attr-defined]
            file = stack.enter_context((place / "compiling.lock").open("w"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _end_compiling() -> None:
    global _compiling
    _compiling -= 1


def announce(called: Any, seconds: float) -> None:
    """Say that a kernel will be compiled, where the cache does not have it, on a terminal or in a notebook.

    The runs of a configuration have a display of their own.
    """
    shown = sys.stderr.isatty() or "ipykernel" in sys.modules
    if not shown or not isinstance(called, Dispatcher) or called.signatures:  # compiled in this process
        return
    file = getattr(called._cache, "_cache_file", None)  # type: ignore[attr-defined]
    if file is None or not file._load_index():
        words = f"compiling kernels, once per machine (about {seconds:.0f} s)"
        print(f"gfmdlayer: {words}", file=sys.stderr, flush=True)  # noqa: T201


@cache
def source_digest(module: Path) -> str:
    """SHA-256 of a module's source and of those of the package that it imports, directly or not."""
    found: set[Path] = set()
    waiting = [module]
    while waiting:
        path = waiting.pop()
        if path not in found and path.exists():
            found.add(path)
            waiting += _imported(path)
    digest = hashlib.sha256()
    for path in sorted(found):
        digest.update(_contents(path))
    return digest.hexdigest()


@cache
def _contents(path: Path) -> bytes:
    if path.stat().st_mtime > _BEGUN:  # this process may have imported what it contained before
        raise RuntimeError(f"{path} has changed")
    return path.read_bytes()


@cache
def _imported(path: Path) -> tuple[Path, ...]:
    """Files of the package's modules that a file imports at its top level."""
    found = []
    for dotted, names in _IMPORT.findall(_contents(path)):
        module = _PACKAGE.joinpath(*dotted.decode().split(".")[1:])
        found.append(module.with_suffix(".py"))
        found += [module / f"{name}.py" for name in re.findall(r"\w+", names.decode())]
    return tuple(found)


def by_address(called: Any, *results: Any) -> Any:
    """Return a function, for kernels, that calls a kernel at an address with a tuple of arguments.

    Numba would compile the code of a called kernel once more as a part of each caller. `address_of` gives the
    address. Where the types of its `results` are given, other kernels of these types may be called too.
    """

    @primitive(lambda address, arguments: _in_python[address](*arguments))
    def call(_context: Any, _address: Any, arguments: Any) -> tuple[Any, Any]:
        kinds = tuple(map(nb.types.unliteral, arguments))
        if not (results or kinds in called.overloads):
            raise nb.TypingError(f"no address was taken of {called.__name__} for the types {kinds}")
        tuple_of: Any = nb.types.Tuple
        result = tuple_of(results) if results else called.overloads[kinds].signature.return_type

        def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            own = cgutils.unpack_tuple(builder, values[1], len(kinds))  # type: ignore[no-untyped-call]
            every = zip(own, arguments, kinds, strict=True)
            own = [context.cast(builder, value, given, wanted) for value, given, wanted in every]
            convention = context.call_conv
            function = builder.inttoptr(values[0], convention.get_function_type(result, kinds).as_pointer())
            status, returned = convention.call_function(builder, function, result, kinds, own)
            with cgutils.if_unlikely(builder, status.is_error):  # type: ignore[no-untyped-call]
                convention.return_status_propagate(builder, status)
            return returned

        return result(nb.types.int64, arguments), generate

    return call


def address_of(called: Any, *arguments: Any) -> int:
    """Return the address of a kernel for arguments of these types, compiled or from the cache."""
    if IN_PYTHON:
        _in_python[id(called)] = called
        return id(called)
    key = called, types_of(*arguments)
    if key not in _addresses:
        kinds = tuple(map(nb.typeof, arguments))
        called.compile(kinds)
        overload = called.overloads[kinds]
        _addresses[key] = int(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))
    return _addresses[key]


_addresses: dict[tuple[Any, bytes], int] = {}
_in_python: dict[int, Callable[..., Any]] = {}  # kernels that Python runs, by the addresses of their objects


def types_of(*arguments: Any) -> bytes:
    """Return Numba's own short form of types, which takes a hundredth of the time of the types themselves."""
    return compute_fingerprint(arguments)


@primitive(np.full, constants=True)
def filled(_context: Any, count: Any, value: Any) -> tuple[Any, Any]:
    """Return a number of copies of a value on the stack of the kernel; the number is a constant."""
    of_row = nb.types.Array(value, 1, "C")

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        from numba.np.arrayobj import make_array, populate_array  # loads all that Numba knows of arrays

        size, width = (
            ir.Constant(ir.IntType(64), number) for number in (count.literal_value, value.bitwidth // 8)
        )
        place = cgutils.alloca_once(builder, values[1].type, size=size)  # type: ignore[no-untyped-call]
        # The compiler must not know it as memory of this kernel alone: the bits of sums are those of loops
        # over arrays that may overlap.
        same = ir.InlineAsm(ir.FunctionType(place.type, [place.type]), "", "=r,0", side_effect=False)
        place = builder.call(same, [place])
        with cgutils.for_range(builder, size) as loop:
            builder.store(values[1], builder.gep(place, [loop.index]))
        row = make_array(of_row)(context, builder)  # type: ignore[no-untyped-call]
        populate_array(  # type: ignore[no-untyped-call]
            row, data=place, shape=[size], strides=[width], itemsize=width, meminfo=None
        )
        return row._getvalue()

    return of_row(count, value), generate


def _with_item(values: tuple[Any, ...], i: int, value: Any) -> tuple[Any, ...]:
    return (*values[:i], value, *values[i + 1 :])


with_item: Any = _with_item if IN_PYTHON else tuple_setitem  # a tuple with another item in one place


@kernel(inner=True, borrows=True)
def summed(x: Any) -> Any:
    """Sum of an array in its order; Numba's own method takes a fifth of a second to compile."""
    total = 0.0
    for i in range(x.size):
        total += x[i]
    return total


@kernel(inner=True, borrows=True)
def maximum(lanes: Any) -> Any:
    """Largest number of an array without NaN; Numba's own method takes most of a second to compile."""
    found = lanes[0]
    for i in range(lanes.size):
        found = lanes[i] if lanes[i] > found else found
    return found


@kernel(inner=True, borrows=True)
def minimum(lanes: Any) -> Any:
    """Smallest number of an array without NaN."""
    found = lanes[0]
    for i in range(lanes.size):
        found = lanes[i] if lanes[i] < found else found
    return found


@primitive(lambda a, b, c: a * b + c)
def _fused(_context: Any, a: Any, b: Any, c: Any) -> tuple[Any, Any]:
    """Return a b + c, rounded once."""
    return a(a, b, c), lambda _context, builder, _signature, values: builder.fma(*values)


@kernel(inner=True, borrows=True)
def product(a: complex, b: complex) -> complex:
    """Product of two complex numbers with the bits of numpy's loops on processors that fuse operations."""
    return complex(
        _fused(a.real, b.real, -(a.imag * b.imag)),
        _fused(a.real, b.imag, a.imag * b.real),
    )


@kernel(inner=True, borrows=True)
def quotient(a: complex, b: complex) -> complex:
    """Quotient of two complex numbers with the bits of numpy's loops (R. L. Smith, 1962)."""
    if abs(b.real) >= abs(b.imag):
        ratio = b.imag / b.real
        scale = 1.0 / (b.real + b.imag * ratio)
        return complex((a.real + a.imag * ratio) * scale, (a.imag - a.real * ratio) * scale)
    ratio = b.real / b.imag
    scale = 1.0 / (b.imag + b.real * ratio)
    return complex((a.real * ratio + a.imag) * scale, (a.imag * ratio - a.real) * scale)
