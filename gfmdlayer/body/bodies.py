"""The bodies that `body` chooses from: the table of the package, or a user's own file.

``body: {file: mine.py, k: 5.0}`` runs the Python code in mine.py when the configuration is read, and takes
the one class there that derives from `gfmdlayer.Solid`; the other keys are its fields. The contents of the
file enter the digest, and results keep a copy, as of every file that a configuration names.

The configuration of results may be somebody else's: `code_refused` runs no code that this process has not run
before, for a configuration of the user.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

from pydantic import ConfigDict, GetCoreSchemaHandler, SerializationInfo, ValidationError
from pydantic_core import CoreSchema, core_schema

from gfmdlayer.body.solid import Solid
from gfmdlayer.errors import GfmdlayerError
from gfmdlayer.files.cache import MemoryFile
from gfmdlayer.validation.fields import File
from gfmdlayer.validation.problems import InconsistentError, Mistake
from gfmdlayer.validation.sections import OneOf, Section, explained, keys_of_files, load_table

# The first is meant where `kind` is left out.
BODIES: dict[str, type[Solid]] = load_table(
    "gfmdlayer.body.layers:Layers",
    "gfmdlayer.body.anisotropic:Anisotropic",
    "gfmdlayer.body.lattice:Lattice",
    "gfmdlayer.body.tabulated:Tabulated",
)


class BodyFile(Section):
    """A body in a Python file; its further keys are the fields of the class there."""

    model_config = ConfigDict(extra="allow")

    file: File
    """Python file with one class that derives from gfmdlayer.Solid; its code is run"""
    kind: str = "file"
    """word that the class may have"""


class _OfFile(Section):
    """The key that a body from a file has beside its own, and its way between processes."""

    code: ClassVar[tuple[bytes, str]]  # the arguments of `body_class`

    file: File
    """Python file with the class of the body"""

    def __reduce__(self) -> Any:
        """Take the code along: the file may have changed or gone."""
        return _restored, (*self.code, self.__getstate__())


class _BodyOrFile(OneOf[Any]):
    """Annotation of a field that holds a body, or names a file that defines it."""

    def word(self, value: object) -> str:
        """Return the kind; a mapping that names a file of code needs none, or one that is not known."""
        word = super().word(value)
        named = isinstance(value, Mapping) and "file" in value
        known = isinstance(value, Mapping) and "kind" in value and word in BODIES
        return "file" if isinstance(value, _OfFile) or (named and not known) else word

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate by the class that is chosen."""
        choices: dict[Any, Any] = {
            word: handler.generate_schema(section) for word, section in self.members.items()
        }

        def dumped(body: Solid, info: SerializationInfo) -> dict[str, Any]:
            return body.model_dump(exclude_unset=info.exclude_unset, exclude_none=info.exclude_none)

        written = core_schema.plain_serializer_function_ser_schema(dumped, info_arg=True)
        choices["file"] = core_schema.no_info_plain_validator_function(
            _of_file, serialization=written, json_schema_input_schema=handler.generate_schema(BodyFile)
        )
        return core_schema.tagged_union_schema(choices, self.word)


BODY = _BodyOrFile({**BODIES, "file": BodyFile})


def _of_file(value: Any) -> Solid:
    """Return the body of the class in a file; InconsistentErrors name the file with the line, or the key."""
    if isinstance(value, _OfFile):
        return value  # type: ignore[return-value]
    try:
        path = BodyFile.model_validate({"file": value["file"]} if "file" in value else {}).file
    except ValidationError as error:
        problems = [replace(problem, chooses=True) for problem in explained(error, BodyFile, ())]
        raise InconsistentError(problems) from None
    try:
        if path.suffix != ".py":
            table = f"a table of stiffness is body: {{kind: table, table: {path.name}}}"
            raise ValueError(f"got {path}, which is no code; must be a .py file; {table}")  # noqa: TRY301
        section = body_class(path.read_bytes(), str(path))
    except ValueError as error:
        raise InconsistentError([Mistake(("file",), str(error), chooses=True)]) from None
    data = dict(value)
    for key in keys_of_files(section):  # beside the file of the body
        if key != "file" and isinstance(data.get(key), str):
            data[key] = str(path.parent / data[key])
    try:
        body = section.model_validate(data)
    except ValidationError as error:
        raise InconsistentError(explained(error, section, ())) from None
    return body


def keys_in_memory(body: Solid) -> dict[str, Any]:
    """Return the keys of a body whose class no file defines; only this process can read them."""
    own = type(body)
    file = MemoryFile(f"{own.__name__}-{id(own):x}.py", f"# {own.__qualname__} of {own.__module__}".encode())
    code = file.contents, str(file)
    if code not in _run:
        _run[code] = _of_code(own, *code)
    return {"file": file, **body.model_dump(exclude_unset=True, exclude={"kind"})}


def is_in_memory(path: Path) -> bool:
    """Whether a file stands for a class that no file defines."""
    return isinstance(path, MemoryFile) and path.suffix == ".py"


def _restored(source: bytes, path: str, state: Any) -> Solid:
    section = body_class(source, path)
    body = section.__new__(section)
    body.__setstate__(state)
    return body


_run: dict[tuple[bytes, str], type[Solid]] = {}  # classes of the files that were run
_refused: ContextVar[bool] = ContextVar("refused", default=False)


@contextmanager
def code_refused(refused: bool = True) -> Iterator[None]:
    """Run no code within the block that was not run before it."""
    before = _refused.set(refused)
    try:
        yield
    finally:
        _refused.reset(before)


class CodeRefusedError(GfmdlayerError, ValueError):
    """A body is code that is not run, because it is named by results."""


def body_class(source: bytes, path: str) -> type[Solid]:
    """Run a file once, and return its one class that derives from `Solid`; a ValueError names file, line."""
    if (source, path) not in _run:
        if _refused.get() and all(known != source for known, _ in _run):
            asked = "which is not run where results are read; to run it, give --trust, in Python trust=True"
            raise CodeRefusedError(f"{path} is code, {asked}")
        _run[source, path] = _class_in(source, path)
    return _run[source, path]


def _class_in(source: bytes, path: str) -> type[Solid]:
    module = ModuleType(f"gfmdlayer_body_{hashlib.sha256(source + path.encode()).hexdigest()[:16]}")
    module.__file__ = path
    sys.modules[module.__name__] = module  # where annotations of the class are resolved
    try:
        exec(compile(source, path, "exec"), vars(module))
    except Exception as error:
        raise ValueError(f"{place_of(error, path)}; must be Python that defines a body") from None
    classes = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Solid) and value.__module__ == module.__name__
    ]
    if len(classes) != 1:
        names = ", ".join(own.__name__ for own in classes) or "none"
        raise ValueError(f"{path}: classes that derive from gfmdlayer.Solid: {names}; must be one")
    (own,) = classes
    if lacking := sorted(own.__abstractmethods__):
        line = inspect.getsourcelines(own)[1]
        raise ValueError(f"{path}:{line}: {own.__name__} lacks {', '.join(lacking)}; must define them")
    return _of_code(own, source, path)


def _of_code(own: type[Solid], source: bytes, path: str) -> type[Solid]:
    members = {"__module__": __name__, "__doc__": own.__doc__, "code": (source, path)}
    return type(own.__name__, (_OfFile, own), members)


def place_of(error: BaseException, path: str) -> str:
    """Return an error with the last line of a file that led to it."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    line = error.lineno if isinstance(error, SyntaxError) else lines[-1] if lines else None
    message = error.msg if isinstance(error, SyntaxError) else error
    place = f"{path}{'' if line is None else f':{line}'}: " if path else ""
    return f"{place}{type(error).__name__}: {message}"
