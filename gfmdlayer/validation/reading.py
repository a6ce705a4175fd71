"""The section `reading`: what a user says about a file of a table that the file does not say itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from gfmdlayer.files.headings import dimension_of, is_known, quantities_named
from gfmdlayer.files.units import unit_of
from gfmdlayer.validation.fields import MustBe, Word, given
from gfmdlayer.validation.problems import Mistake, shown
from gfmdlayer.validation.sections import Section

if TYPE_CHECKING:
    from gfmdlayer.files.tables import Answers


class _UnitsOfColumns:
    """Annotation of a field with a mapping of quantities to units, which is kept as pairs."""

    def __get_pydantic_core_schema__(self, _source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        """Take a mapping."""
        back = core_schema.plain_serializer_function_ser_schema(dict)
        return core_schema.no_info_plain_validator_function(_pairs, serialization=back)

    def __get_pydantic_json_schema__(
        self, _schema: CoreSchema, _handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe a mapping to texts."""
        return {"type": "object", "minProperties": 1, "additionalProperties": {"type": "string"}}


def _pairs(value: object) -> tuple[tuple[str, str], ...]:
    """Return a mapping of quantities to units as pairs; ValueError for unknown ones."""
    if not isinstance(value, Mapping) or not value:
        raise ValueError(
            f"got {shown(value)}; must be units by the name of a quantity, such as {{depth: nm}}"
        )
    for name, text in value.items():
        if not isinstance(name, str) or not (quantities := quantities_named(name)):
            raise ValueError(
                f"got {shown(name)}; must be the name of a quantity, such as time, depth or force"
            )
        if not isinstance(text, str):
            raise ValueError(f"{name}: got {shown(text)}; must be the name of a unit")  # noqa: TRY004
        unit = unit_of(text)
        if unit is None or unit.dimension not in {dimension_of(each).dimension for each in quantities}:
            raise ValueError(f"{name}: got {shown(text)}; is not a unit of it")
    return tuple(value.items())


def _name(value: str) -> str:
    if value == "-" or is_known(value):
        return value
    raise ValueError(f'got {shown(value)}; is not the name of a quantity, with or without a unit, or "-"')


_decimal = Word(".", ",")
_column = MustBe('a name, such as "depth [nm]", or "-" for a column that is not read')


class Reading(Section):
    """What a file of a table does not say itself, or not certainly."""

    decimal: Annotated[Annotated[str, _decimal] | None, given] = None
    """decimal mark of the file, where 1,234 may be either"""
    units: Annotated[tuple[tuple[str, str], ...] | None, _UnitsOfColumns(), given] = None
    """units of columns whose headings have none: {depth: nm}; must be units by the names of quantities"""
    columns: Annotated[tuple[Annotated[str, _column, AfterValidator(_name)], ...] | None, given] = None
    """names of all columns in place of the headings; "-" for one that is not read"""
    table: Annotated[
        Annotated[int, Field(strict=True, ge=1), MustBe("a whole number >= 1")] | None, given
    ] = None
    """number of the table, from 1, in a file with several"""


def answers(reading: Reading | None, key: str = "reading") -> Answers:
    """Return a reading as the reader of tables takes it; `key` names it in messages."""
    from gfmdlayer.files.tables import Answers

    if reading is None:
        return Answers(key=key)
    return Answers(reading.decimal, reading.units or (), reading.columns or (), table=reading.table, key=key)


def unread(section: Section, key: str, reading: str = "reading") -> Iterator[Mistake]:
    """Refuse a reading beside a key that names no file."""
    if getattr(section, reading) is not None and not isinstance(getattr(section, key), Path):
        yield Mistake((reading,), f"only for a file; remove it, or give {key} as the name of a file", (key,))
