"""The kinds of values that a key may take, each with the message for other values."""

from __future__ import annotations

import ast
import inspect
import math
import re
import textwrap
from contextvars import ContextVar
from copy import copy
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    ValidationError,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from gfmdlayer.validation import quantities
from gfmdlayer.validation.problems import A_NUMBER, nearest, shown
from gfmdlayer.validation.quantities import Written

# Products and quotients of a few numbers of this size do not leave the range of double precision.
SMALLEST, LARGEST = 1e-30, 1e30
MANY = 2**31  # points; FFTW counts in 32 bits and cannot transform as many

# The section whose schema is built: its fields find their dimension by it.
building: ContextVar[type[BaseModel] | None] = ContextVar("building", default=None)


@dataclass(frozen=True)
class MustBe:
    """Annotation of a field: whatever its type refuses is reported as "must be ALLOWED".

    Numbers with a fraction are also refused where they are too large or too small to compute with. A field
    with a dimension takes a text with a unit, which becomes a `Written`.
    """

    allowed: str  # the values allowed, continuing "must be ..."
    words: tuple[str, ...] = ()  # the allowed words, where the field takes words
    any_size: bool = False  # of numbers that are compared only
    field: tuple[type[BaseModel] | None, str] = (None, "")  # section and key, which have the dimension

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Wrap the type's own validation."""
        own = copy(self)
        object.__setattr__(own, "field", (building.get(), handler.field_name or ""))
        as_it_is = core_schema.simple_ser_schema("any")  # a number that keeps its text
        return core_schema.no_info_wrap_validator_function(
            own.validate, handler(source), serialization=as_it_is
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Leave the allowed values for `gfmdlayer.config.json_schema`."""
        return handler(schema) | {"$comment": self.allowed}

    def validate(self, value: Any, inner: core_schema.ValidatorFunctionWrapHandler) -> Any:
        """Validate by the type, and report an error in the field's words."""
        if value.__class__ is Written:
            counts_again = quantities.around() and dimension_of(*self.field)  # in other units, it may be
            return Written(self.validate(value.text if counts_again else float(value), inner), value.text)
        try:
            taken = inner(value)
        except (ValidationError, OverflowError) as error:
            taken = self._of_text(value, inner, error)
        sized = isinstance(taken, float) and taken not in {0.0, math.inf} and not self.any_size
        if sized and not SMALLEST <= abs(taken) <= LARGEST:
            limits = f"the size must be from {SMALLEST:g} to {LARGEST:g}; choose other units"
            raise PydanticCustomError("must_be", f"got {shown(value)}; {limits}")
        return taken

    def _of_text(self, value: Any, inner: core_schema.ValidatorFunctionWrapHandler, error: Exception) -> Any:
        """Return the number of a text that the type refused; raise the error of any other value."""
        if isinstance(value, str) and (number := self.number(value)) is not None:
            try:
                return Written(inner(number), value)
            except (ValidationError, OverflowError):
                message = f"got {shown(value)}, which is {number:g}; must be {self.allowed}"
                raise PydanticCustomError("must_be", message) from None
        entries = isinstance(value, (list, tuple)) and isinstance(error, ValidationError) and error.errors()
        if any(entry["type"] == "quantity" for entry in entries or ()):
            raise error  # of an entry, at its own place
        message = f"got {shown(value)}; must be {self.allowed}{self._hint(value)}"
        raise PydanticCustomError("must_be", message) from None

    def number(self, text: str) -> float | None:
        """Return the number that a text stands for, if any."""
        words = dimension_of(*self.field)
        return quantities.number(text, words, self.allowed) if words else None

    def _hint(self, value: object) -> str:
        """Return "; did you mean ...?" for the nearest word, or how to write what begins as a number."""
        if not isinstance(value, str):
            return ""
        if (hint := nearest(value, self.words)) or "number" not in self.allowed:
            return hint
        return f"; {A_NUMBER}" if re.match(r"\s*[-+]?\.?\d", value) else ""


class Word(MustBe):
    """Annotation of a field that takes one of several words."""

    def __init__(self, *words: str, more: str = "") -> None:
        choice = " or ".join(words) if len(words) == 2 else "one of " + ", ".join(words)
        super().__init__(choice + more, words)

    def __get_pydantic_core_schema__(self, _source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        """Take the words and nothing else."""
        schema = core_schema.literal_schema([*self.words])
        return core_schema.no_info_wrap_validator_function(self.validate, schema)


def sequence(value: object) -> object:
    """Take a single value for a list of one."""
    return tuple(value) if isinstance(value, (list, tuple)) else (value,)


def two(values: tuple[float, ...]) -> tuple[float, ...]:
    """Take one value for each of two directions."""
    if len(values) != 2:
        raise ValueError(f"got {len(values)} values; must be one number, or two, one for each direction")
    return values


def _readable(path: Path) -> Path:
    """Reject a file that cannot be opened, before the run starts."""
    path = path.absolute()
    try:
        if path.is_file():
            path.open("rb").close()
            return path
        wrong = "is not a regular file" if path.exists() else "does not exist"
    except OSError as error:
        wrong = f"cannot be read ({error.strerror})"
    allowed = "must be the name of a readable file, relative to the configuration's folder"
    raise ValueError(f"{path} {wrong}; {allowed}")


def _not_null(value: object) -> object:
    # None in the model marks a key without meaning; a file leaves the key out.
    if value is None:
        raise ValueError("got nothing (null); give a value or remove the key")
    return value


given = AfterValidator(_not_null)
strict = Field(strict=True, allow_inf_nan=False)
number_or_list = Discriminator(lambda value: "list" if isinstance(value, (list, tuple)) else "number")

Finite = Annotated[float, strict, MustBe("a number, finite")]
Positive = Annotated[float, strict, Field(gt=0), MustBe("a number > 0, finite")]
NotNegative = Annotated[float, strict, Field(ge=0), MustBe("a number >= 0, finite")]
Extended = Annotated[float, Field(strict=True, ge=0), MustBe("a number >= 0 or .inf")]
Fraction = Annotated[float, strict, Field(ge=0, le=1), MustBe("a number from 0 to 1")]
Count = Annotated[int, Field(strict=True, ge=1, lt=MANY), MustBe("a whole number >= 1 and < 2^31")]
Seed = Annotated[int, Field(strict=True, ge=0), MustBe("a whole number >= 0")]
Switch = Annotated[bool, Field(strict=True), MustBe("true or false")]
File = Annotated[Path, MustBe("the name of a file"), AfterValidator(_readable)]
Optional = Annotated[Positive | None, given]

_length = MustBe("a number > 0, or two of them, one for each direction")
_extent = Annotated[float, Field(strict=True, gt=0), MustBe("a number > 0 or .inf")]
_one = Annotated[float, strict, Field(gt=0), _length, Tag("number")]
Lengths = Annotated[_one | Annotated[tuple[_extent, ...], AfterValidator(two), Tag("list")], number_or_list]
Amplitudes = Annotated[
    _one | Annotated[tuple[NotNegative, ...], AfterValidator(two), Tag("list")], number_or_list
]


# The meaning of each key is the string below its field. It ends with the dimension of a number, if the number
# has one: "radius of curvature: length". The strings are read from the source only for documentation: no run
# needs them, and reading them takes about as long as building all sections.

_DIMENSION = re.compile(
    r": ((?:length|pressure|time|force|drive|V|ohm|J|mol|kelvin|degrees|Celsius|\d|[/^ ])+)$", re.MULTILINE
)


def dimension(words: str) -> tuple[str, str]:
    """Split the words of a key into its meaning and its dimension, which is empty where it has none."""
    match = _DIMENSION.search(words)
    return (words[: match.start()], match[1]) if match else (words, "")


def dimension_of(section: type[BaseModel] | None, key: str) -> str:
    """Return the dimension of a field of a section in words, empty where it has none."""
    if section is None or (field := section.model_fields.get(key)) is None:
        return ""
    return dimension(meanings(section).get(field.alias or key, ""))[1]


@cache
def meanings(section: type[BaseModel]) -> dict[str, str]:
    """Return the meanings of the fields of a section, by the names that users write."""
    written: dict[str, str] = {}
    for base in reversed(section.__mro__):
        own = set(vars(base).get("__annotations__", ())) & set(section.model_fields)
        written = {name: words for name, words in written.items() if name not in own}
        written |= {name: words for name, words in (_written(base) if own else {}).items() if name in own}
    return {section.model_fields[name].alias or name: words for name, words in written.items()}


def _written(section: type) -> dict[str, str]:
    """Return the strings below the annotated names of a class, where its source is at hand."""
    try:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(section))).body
    except OSError:  # typed into a session
        return {}
    return {
        field.target.id: inspect.cleandoc(below.value.value)
        for field, below in pairwise(tree.body if isinstance(tree, ast.ClassDef) else ())
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        if isinstance(below.value.value, str)
    }
