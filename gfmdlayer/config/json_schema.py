"""The configuration as a JSON Schema (draft 2020-12), by which editors complete keys and mark mistakes.

It follows from the model and accepts all that the loader accepts. Only the loader checks conditions on
several values (a sphere that ends inside the cell, a snapshot past the end), files, and whole numbers without
a decimal point. YAML's infinity is a number here, so keys without .inf are bounded by the largest finite
number.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from gfmdlayer.config import sweeps
from gfmdlayer.config.model import Config
from gfmdlayer.config.sections import listed
from gfmdlayer.validation.fields import dimension, meanings, sequence, two
from gfmdlayer.validation.sections import Section

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_PLACE, _OWN = "@", "%"  # in dotted keys: the place in a list, and keys of a user's own body
_WITH_UNIT = {"type": "string", "pattern": r"^\s*[-+]?\.?\d.*[^\d\s.eE+-]"}
_IN_CELL = {"minItems": 1, "maxItems": 2}  # one for each direction


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a configuration."""
    schema = Config.model_json_schema(schema_generator=_Generator)
    title = {"$schema": _DIALECT, "title": "gfmdlayer configuration"}
    result: dict[str, Any] = title | _described(schema)
    _require_words(result, result["$defs"])
    _sweep(result)
    return result


class _Generator(GenerateJsonSchema):
    """Adds the conditions of validators, which pydantic cannot know."""

    def field_title_should_be_set(self, schema: Any) -> bool:  # noqa: ARG002
        return False  # keys are their own titles

    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        result = super().model_schema(schema)
        section: type[Section] = schema["cls"]
        for key, words in meanings(section).items():
            if dimension(words)[1] or issubclass(section, sweeps.Ends):
                result["properties"][key] = _or_with_unit(result["properties"][key])
            result["properties"][key]["description"] = words
        return result

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])  # None is internal; a user leaves the key out

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        result = super().default_schema(schema)
        match result.get("default"):
            case None:
                result.pop("default", None)
            case [single]:
                result["default"] = single
        return result

    def float_schema(self, schema: core_schema.FloatSchema) -> JsonSchemaValue:
        result = super().float_schema(schema)
        if schema.get("allow_inf_nan") is False:
            result.setdefault("maximum", sys.float_info.max)
            if "exclusiveMinimum" not in result:
                result.setdefault("minimum", -sys.float_info.max)
        return result

    def function_before_schema(self, schema: core_schema.BeforeValidatorFunctionSchema) -> JsonSchemaValue:
        result = super().function_before_schema(schema)
        if schema["function"]["function"] is sequence:
            return {"anyOf": [result["items"], result | _IN_CELL]}
        if schema["function"]["function"] is listed:
            return {"anyOf": [result, {"enum": result["items"]["anyOf"][-1]["enum"]}]}
        return result

    def function_after_schema(self, schema: core_schema.AfterValidatorFunctionSchema) -> JsonSchemaValue:
        result = super().function_after_schema(schema)
        if schema["function"]["function"] is two:
            return result | {"minItems": 2, "maxItems": 2}
        return result

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        return {"oneOf": [self.generate_inner(member) for member in schema["choices"].values()]}


def _or_with_unit(node: Any) -> Any:
    """Return a schema in which numbers may be texts with a unit."""
    if isinstance(node, list):
        return [_or_with_unit(member) for member in node]
    if not isinstance(node, dict) or any(
        kind.get("type") == "string" and "const" not in kind for kind in node.get("oneOf", ())
    ):
        return node  # or the names of files, which may be any text
    if node.get("type") == "number":
        about = {key: node[key] for key in ("$comment", "default") if key in node}
        return about | {"anyOf": [{key: node[key] for key in node.keys() - about}, _WITH_UNIT]}
    inner = ("anyOf", "oneOf", "items", "prefixItems")
    return {key: _or_with_unit(value) if key in inner else value for key, value in node.items()}


def _require_words(node: Any, sections: Mapping[str, Any]) -> None:
    """Require the word that chooses a section in all of several sections but the first, the default."""
    for inner in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        _require_words(inner, sections)
    for member in node.get("oneOf", ())[1:] if isinstance(node, dict) else ():
        if "$ref" in member:
            section = sections[member["$ref"].rpartition("/")[2]]
            required = section.setdefault("required", [])
            required += [k for k, v in section["properties"].items() if "const" in v and k not in required]


def _described(node: Any) -> Any:
    """Return a schema with the meaning and the allowed values of each key as descriptions."""
    if isinstance(node, list):
        return [_described(item) for item in node]
    if not isinstance(node, dict):
        return node
    result = {key: _described(value) for key, value in node.items() if key not in {"$comment", "title"}}
    meaning = result.get("description", "")
    if isinstance(meaning, str) and (meaning or "$comment" in node):
        allowed = f"must be {node['$comment']}" if isinstance(node.get("$comment"), str) else ""
        summary = " ".join(meaning.partition("\n\n")[0].split())
        result["description"] = "; ".join(filter(None, (summary, allowed)))
    return result


def _keys(schema: Mapping[str, Any], node: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and their schemas, for each possible kind of section."""
    for member in node.get("oneOf", ()):
        yield from _keys(schema, member, prefix)
    if "items" in node:
        yield from _keys(schema, node["items"], f"{prefix}.{_PLACE}")
    if "$ref" in node:
        for key, value in schema["$defs"][node["$ref"].rpartition("/")[2]]["properties"].items():
            yield f"{prefix}.{key}", value
            yield from _keys(schema, value, f"{prefix}.{key}")
        if schema["$defs"][node["$ref"].rpartition("/")[2]].get("additionalProperties") is True:
            yield f"{prefix}.{_OWN}", {"anyOf": [{"type": "number"}, {}]}


def _sweep(schema: Mapping[str, Any]) -> None:
    """Add the keys that may be swept to the sections of a sweep."""
    kinds = {key: {"anyOf": members} for key, members in _swept(schema).items()}
    lists = {key: {"type": "array", "minItems": 1, "items": kind} for key, kind in kinds.items()}
    different = {key: values | {"uniqueItems": True} for key, values in lists.items()}
    # The ends of a range need not satisfy the bounds of the key: no sample may lie there.
    ranges = {key: {"$ref": "#/$defs/Range"} for key, kind in kinds.items() if _takes_numbers(kind)}
    formulas = {
        key: {"$ref": "#/$defs/Spaced", "properties": {"from": kind, "to": kind}}
        for key, kind in kinds.items()
        if _takes_numbers(kind, "number", "integer")
    }
    for swept in (lists, different):
        swept |= {key: {"anyOf": [swept[key], formula]} for key, formula in formulas.items()}
    sweep, samples, zipped = (schema["$defs"][name] for name in ("Sweep", "Samples", "Zip"))
    for section, values in ((zipped, lists), (samples, ranges), (sweep, different)):
        required = len(section.get("required", ()))
        named = {key: value for key, value in values.items() if not {_PLACE, _OWN} & {*key}}
        patterns = {re.escape(key): value for key, value in values.items() if key not in named}
        section |= {
            "properties": section.get("properties", {}) | named,
            "patternProperties": {
                f"^{key.replace(_PLACE, '[0-9]+').replace(_OWN, '.+')}$": value
                for key, value in patterns.items()
            },
            "additionalProperties": False,
            "minProperties": required + 1,
        }
    samples["dependentSchemas"] = {"seed": {"minProperties": len(samples["required"]) + 2}}
    powers = {"enum": [1 << k for k in range(sweeps.MAX_CASES.bit_length())]}
    sweep["properties"]["sobol"]["properties"] = {"samples": powers}
    sweep["allOf"] = [{"not": {"required": list(pair)}} for pair in combinations(sweeps.LISTS, 2)]


def _takes_numbers(node: Mapping[str, Any], *types: str) -> bool:
    """Whether a schema accepts numbers, by default those with a fraction."""
    members = [*node.get("anyOf", ()), *node.get("oneOf", ())]
    return node.get("type") in (types or ("number",)) or any(_takes_numbers(kind, *types) for kind in members)


def _swept(schema: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return the dotted keys that may be swept, each with the schemas of its values."""
    swept: dict[str, list[Any]] = {}
    for head, section in schema["properties"].items():
        if head not in sweeps.UNSWEPT:
            itself = [(head, section)] if "oneOf" in section else []
            for key, values in [*itself, *_keys(schema, section, head)]:
                if values not in swept.setdefault(key, []):
                    swept[key].append(values)
    return swept
