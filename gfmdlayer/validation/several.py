"""The choice between several sections, one or a list of them."""

from __future__ import annotations

from typing import Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from gfmdlayer.validation.sections import Member, OneOf


class OneOrMore(OneOf[Member]):
    """Annotation of a field that holds one of several sections, or a list of such."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate one by the section that is chosen, or each of a list."""
        one = super().__get_pydantic_core_schema__(source, handler)
        at_least_one = {"pydantic_js_updates": {"minItems": 1}}
        several = core_schema.tuple_schema([one], variadic_item_index=0, metadata=at_least_one)
        forms: dict[Any, Any] = {"<one>": one, "<list>": several}
        return core_schema.tagged_union_schema(
            forms, lambda value: "<list>" if isinstance(value, list | tuple) else "<one>"
        )
