"""How compiled kernels are made: one set of options, and a cache that notices a change in any source.

Numba keeps compiled code beside the module that defines a function and compares only this module.
A kernel that calls one of another module, or uses a constant of it, would keep the old one after an edit.
Here the cache compares the contents of the module and of all modules of the package that it imports.

Numba also turns each function into machine code as soon as another one calls it, and all functions of one
name in a process then run the code that was loaded first: the last bits of a result could depend on what the
process had compiled. Here an inner kernel becomes machine code only as a part of the kernels that call it,
and each of these keeps its own copy.
"""

from __future__ import annotations

import fcntl
import gc
import hashlib
import inspect
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar, overload

import numba as nb
from llvmlite.binding import Linkage
from numba.core import cgutils, ir
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.runtime.nrt import rtsys
from numba.core.typed_passes import NopythonTypeInference
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

# The first and the last version of Numba whose compiler is known to take other kinds of libraries, which are
# no part of its interface. With others, inner kernels are compiled like all functions.
_KNOWN = (0, 60), (0, 68)
_OWN_LIBRARIES = _KNOWN[0] <= nb.version_info.short <= _KNOWN[1]

_PACKAGE = Path(__file__).parent
_IMPORT = re.compile(rb"^from gfmdlayer((?:\.\w+)*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)

Function = TypeVar("Function", bound=Callable[..., Any])


@overload
def kernel(function: Function) -> Function: ...
@overload
def kernel(*, reorder: bool = False, inner: bool = False) -> Callable[[Function], Function]: ...
def kernel(function: Any = None, *, reorder: bool = False, inner: bool = False) -> Any:
    """Compile a function by Numba at its first call, without the interpreter's lock, cached on the disk.

    `reorder` allows to reorder sums (`FASTMATH`), as vector units need it, and gives a division by zero its
    limit, as the check of each would keep loops from them. An `inner` kernel is called only by other kernels:
    it has no entry for Python and no machine code of its own, which take longer to compile than a short
    kernel where many arrays come in groups.
    """
    if function is None:
        return lambda decorated: _compiled(decorated, reorder, inner)
    return _compiled(function, reorder, inner)


def _compiled(function: Any, reorder: bool, inner: bool) -> Any:
    fastmath = FASTMATH if reorder else False
    options: dict[str, Any] = {"nogil": True, "fastmath": fastmath, "no_cpython_wrapper": inner}
    options["error_model"] = "numpy" if reorder else "python"
    options["no_cfunc_wrapper"] = True  # `call_at` uses the kernel itself
    if _OWN_LIBRARIES:
        options["pipeline_class"] = _Inner if inner else _Outer
    dispatcher = nb.njit(**options)(function)
    cached = not (inner and _OWN_LIBRARIES)
    if isinstance(dispatcher, Dispatcher) and cached:  # not where Numba is switched off
        _choose_place()
        with suppress(RuntimeError):  # there is no place: each process compiles
            dispatcher._cache = _SourceCache(function)  # type: ignore[attr-defined]  # as cache=True does
    return dispatcher


class _OuterCode(JITCodeLibrary):
    """Code of a kernel with its own copies of the kernels that it calls."""

    def _optimize_functions(self, module: Any) -> None:
        """Leave the entry for Python as it is until the whole is optimised."""
        if module.name == "wrapper":
            module.data_layout = self._codegen._data_layout
        else:
            super()._optimize_functions(module)  # type: ignore[no-untyped-call]

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr:
                function.linkage = Linkage.internal
        super()._optimize_final_module()  # type: ignore[no-untyped-call]


class _InnerCode(JITCodeLibrary):
    """Code that becomes machine code only as a part of the kernels that call it."""

    def _optimize_functions(self, module: Any) -> None:
        """Leave that to the kernels that call this one."""
        module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Join the code of all inner kernels that this one calls."""
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, _name: str) -> int:
        """Return no address."""
        self._ensure_finalized()  # type: ignore[no-untyped-call]
        return 0

    @property
    def codegen(self) -> Any:
        """Return a generator of code for which the kernel has no constants to be set in machine code."""
        return SimpleNamespace(set_env=lambda *_: None)


# Expressions whose arrays are views of others, if these are not an index.
_VIEWS = {"build_tuple", "cast", "exhaust_iter", "getattr", "getitem", "getiter", "iternext", "pair_first"}
_VIEWS |= {"pair_second", "phi", "static_getitem"}


@register_pass(mutates_CFG=False, analysis_only=True)  # type: ignore[no-untyped-call]
class _Borrowing(AnalysisPass):
    """Does not count who holds an array in a kernel that makes no array and returns none.

    To count took as long as the numbers of short rows, and an eleventh of the time to compile.
    """

    _name = "borrowing"

    def __init__(self) -> None:  # abstract in the base class
        super().__init__()  # type: ignore[no-untyped-call]

    def run_pass(self, state: Any) -> bool:
        """Find what makes an array: a call, an operation of arrays, an array as an index."""
        kinds = state.typemap

        def holds(kind: Any) -> bool:
            return bool(state.targetctx.data_model_manager[kind].contains_nrt_meminfo())

        def makes(line: Any) -> bool:
            found = line.value
            if not isinstance(found, ir.Expr) or not holds(kinds[line.target.name]):
                return False
            if found.op == "call":
                return not isinstance(kinds[found.func.name], nb.types.NamedTupleClass)
            return found.op not in _VIEWS or (found.op == "getitem" and holds(kinds[found.index.name]))

        lines = (line for block in state.func_ir.blocks.values() for line in block.find_insts(ir.Assign))
        if not (holds(state.return_type) or any(map(makes, lines))):
            state.targetctx = state.targetctx.subtarget(enable_nrt=False)
        return False


class _Outer(CompilerBase):
    """Numba's compiler with another kind of library."""

    _library: type[JITCodeLibrary] = _OuterCode

    def compile_extra(self, function: Any) -> Any:
        """Compile without Python's search for cycles, which took a seventh of the time."""
        searching = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(function)  # type: ignore[no-untyped-call]
        finally:
            if searching:
                gc.enable()

    def define_pipelines(self) -> list[Any]:
        """Begin the code, and return Numba's passes and `_Borrowing`."""
        state = self.state
        state.library = self._library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        passes = DefaultPassBuilder.define_nopython_pipeline(state)  # type: ignore[no-untyped-call]
        passes.add_pass_after(_Borrowing, NopythonTypeInference)
        passes.finalize()
        return [passes]


class _Inner(_Outer):
    _library = _InnerCode


def call_at(called: Any) -> Any:
    """Return a function, for kernels, that calls another kernel at an address with a tuple of arguments.

    Then its code is not compiled once more as a part of the caller. `address_of` gives the address.
    """
    if not _OWN_LIBRARIES:
        return kernel(inner=True)(lambda _address, arguments: called(*arguments))

    @intrinsic
    def call(context: Any, address: Any, arguments: Any) -> tuple[Any, Any]:
        if tuple(map(nb.types.unliteral, arguments)) not in called.overloads:
            raise nb.TypingError(f"no address was taken for arguments of the types {arguments}")
        found = context.resolve_function_type(nb.typeof(called), tuple(arguments), {})  # type: ignore[no-untyped-call]
        kinds = found.return_type, tuple(arguments)

        def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            convention = context.call_conv
            function = builder.inttoptr(values[0], convention.get_function_type(*kinds).as_pointer())
            each = cgutils.unpack_tuple(builder, values[1], len(kinds[1]))  # type: ignore[no-untyped-call]
            status, result = convention.call_function(builder, function, *kinds, each)
            with cgutils.if_unlikely(builder, status.is_error):  # type: ignore[no-untyped-call]
                convention.return_status_propagate(builder, status)
            return result

        return found.return_type(address, arguments), generate

    return call


def address_of(called: Any, *arguments: Any) -> int:
    """Return the address of a kernel for arguments of these types, compiled or from the cache."""
    if not _OWN_LIBRARIES:
        return 1  # `call_at` needs none
    kinds = tuple(map(nb.typeof, arguments))
    called.compile(kinds)
    found = called.overloads[kinds]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))


_ROW = nb.types.Array(nb.types.float64, 1, "C")


def _filled(_context: Any, _count: Any, _value: Any) -> tuple[Any, Any]:
    """Return a number of copies of a value, for kernels; numpy's ways compile several functions of Numba."""

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        from numba.np.arrayobj import _empty_nd_impl  # loads all that Numba knows of arrays

        size, number = values
        row = _empty_nd_impl(context, builder, _ROW, [size])  # type: ignore[no-untyped-call]
        with cgutils.for_range(builder, size) as loop:
            builder.store(number, builder.gep(row.data, [loop.index]))
        return row._getvalue()

    return _ROW(nb.types.intp, nb.types.float64), generate


filled: Any = intrinsic(_filled)


@cache
def _choose_place() -> None:
    """Keep compiled code beside the sources, or among the user's caches where it cannot be kept there."""
    if not (nb.config.CACHE_DIR or is_writable(_PACKAGE / "__pycache__")):  # type: ignore[attr-defined]
        nb.config.CACHE_DIR = str(user_cache() / "kernels")  # type: ignore[attr-defined]


class _Stored(CompileResultCacheImpl):
    """What is kept of a kernel on the disk."""

    def reduce(self, compiled: Any) -> tuple[Any, ...]:
        """Leave out the text of the types, and the environments of inner functions without objects of Python.

        An environment names the module of its function, which would be imported, and SciPy with it.
        """
        *code, _types, begins, environments = super().reduce(compiled)  # type: ignore[no-untyped-call]
        return *code, "", begins, tuple(each for each in environments if each.consts)


class _SourceCache(FunctionCache):
    """Numba's cache, with the contents of all sources in place of the age of one."""

    _impl_class = _Stored if _OWN_LIBRARIES else CompileResultCacheImpl

    def __init__(self, function: Any) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        stamp = source_digest(Path(inspect.getfile(function)))
        place = self._cache_path, self._impl.filename_base
        self._cache_file = IndexDataCacheFile(*place, stamp)  # type: ignore[no-untyped-call]
        # Compared before the index is read, which may name types that are gone from the sources.
        self._cache_file._version = f"{nb.__version__} {stamp}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a kernel without all that Numba knows of functions; the compiler loads it when it needs it.

        With what `_Stored` leaves out, this took a quarter of the time to the first step.
        """
        if not _OWN_LIBRARIES:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]


@contextmanager
def compiling() -> Iterator[None]:
    """Let one process at a time compile; those that wait then find the kernels in the cache."""
    with ExitStack() as stack:
        with suppress(OSError):  # on a file system without locks all may compile
            place = Path(nb.config.CACHE_DIR or _PACKAGE / "__pycache__")  # type: ignore[attr-defined]
            file = stack.enter_context((place / "compiling.lock").open("w"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


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


@kernel(inner=True)
def summed(x: Any) -> Any:
    """Sum of an array in its order; Numba's own method takes a fifth of a second to compile."""
    total = 0.0
    for i in range(x.size):
        total += x[i]
    return total


@kernel(inner=True)
def maximum(lanes: Any) -> Any:
    """Largest number of an array without NaN; Numba's own method takes most of a second to compile."""
    found = lanes[0]
    for i in range(lanes.size):
        found = lanes[i] if lanes[i] > found else found
    return found


@kernel(inner=True)
def minimum(lanes: Any) -> Any:
    """Smallest number of an array without NaN."""
    found = lanes[0]
    for i in range(lanes.size):
        found = lanes[i] if lanes[i] < found else found
    return found
