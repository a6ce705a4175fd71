"""A material in a file of its own, as fit-material and fit-indentation write it.

The configuration takes the material itself, so that results, digests and the stored configuration depend on
the contents of the file and not on its name.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NoReturn

from pydantic import GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema, core_schema

from gfmdlayer.body.laws import LAWS
from gfmdlayer.body.materials import Law
from gfmdlayer.config import text
from gfmdlayer.validation.fields import File
from gfmdlayer.validation.problems import InconsistentError, Problem
from gfmdlayer.validation.sections import OneOf, Section, contradictions, explained


class MaterialFile(Section):
    """A material in a file of its own."""

    file: File
    """YAML file with the material, as fit-material and fit-indentation write it"""


class _LawOrFile(OneOf[Any]):
    """Annotation of a field with a law, or with a file that contains one."""

    def word(self, value: object) -> str:
        """Return the word of the law; {file: ...} needs none."""
        if isinstance(value, MaterialFile) or (isinstance(value, Mapping) and {*value} == {"file"}):
            return "file"
        return super().word(value)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Replace a file by the law in it."""
        schema = super().__get_pydantic_core_schema__(source, handler)
        return core_schema.no_info_after_validator_function(_read, schema)


MATERIALS = _LawOrFile({**LAWS, "file": MaterialFile})


class _Holder(Section):
    material: Annotated[Law, OneOf(LAWS)]


def _read(given: Law | MaterialFile) -> Law:
    """Return a law, or the law in a file."""
    return given if isinstance(given, Law) else read_material(given.file)


def read_material(path: Path) -> Law:
    """Read the material in a YAML file: its only section `layer.material`, or `material`."""
    document = text.read(path.read_bytes(), str(path))
    if document.problems:
        _refuse(f"{place}: {message}" for place, message in document.problems)
    at: tuple[str, ...] = ("material",)
    held = document.data if isinstance(document.data, dict) else {}
    if isinstance(held.get("layer"), dict):
        held, at = held["layer"], ("layer", "material")
    if not isinstance(held.get("material"), dict):
        _refuse([f"{path}:1:1: has no material; must be YAML with a section layer: {{material: ...}}"])
    try:
        law = _Holder.model_validate({"material": held["material"]}).material
        found = [problem.within(("material",)) for problem in contradictions(law)]
    except ValidationError as error:
        found = explained(error, _Holder, ())
    if found:
        located = [Problem((*at, *problem.location[1:]), problem.message) for problem in found]
        _refuse(f"{document.place(problem.location)}: {problem}" for problem in located)
    return law


def _refuse(messages: Iterable[str]) -> NoReturn:
    raise InconsistentError([Problem(("file",), message) for message in messages])
