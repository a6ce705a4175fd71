"""Sections of a configuration: models of plain data, the choice between several, their keys and errors."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from inspect import CO_VARKEYWORDS, Parameter, Signature, cleandoc, unwrap
from itertools import chain
from keyword import iskeyword
from operator import is_
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, TypeVar, Union, cast, get_args, get_origin

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, core_schema

from gfmdlayer.files.cache import MemoryFile
from gfmdlayer.made_once import kept_with
from gfmdlayer.validation.fields import MustBe, Word, building, dimension, meanings
from gfmdlayer.validation.problems import (
    ConfigError,
    Location,
    Mistake,
    colon_without_space,
    dotted,
    dotted_key,
    nearest,
    shown,
    unknown_key,
    without_last_places,
)
from gfmdlayer.validation.quantities import Written

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass as _ModelMetaclass
else:
    _ModelMetaclass = type(BaseModel)

_SHAPES = {
    **dict.fromkeys(("model_type", "dict_type"), "a mapping of keys to values"),
    **dict.fromkeys(("tuple_type", "list_type"), "a list"),
}

# Tags for the forms of a value (one or several); pydantic adds them to the places of its errors.
FORMS = frozenset({"<one>", "<list>", "<number>", "<file>", "<range>"})

_PLAIN = frozenset({str, int, float, bool, type(None)})

Init = TypeVar("Init", bound=Callable[..., None])


def alone(init: Init) -> Init:
    """Mark an __init__ that pydantic skips when it validates a whole configuration."""
    init.__pydantic_base_init__ = True  # type: ignore[attr-defined]
    return init


class _Shown(_ModelMetaclass):
    """Metaclass that shows editors and `help` the keys of a section, with types and defaults.

    Pydantic's own signature lacks the order of values without a name, and is made only with the first use.
    """

    @property
    def __signature__(self) -> Signature | None:
        cls = cast("type[Section]", self)
        if not unwrap(cls.__init__).__code__.co_flags & CO_VARKEYWORDS:
            return None  # the one of __init__
        ordered, word = cls._in_order(), cls._word()
        fields = {name: field for name, field in cls.fields().items() if name not in (word, *ordered)}
        every = {name: cls.model_fields[name] for name in ordered} | fields
        return Signature(
            [
                Parameter(
                    name,
                    Parameter.POSITIONAL_OR_KEYWORD if name in ordered else Parameter.KEYWORD_ONLY,
                    default=Parameter.empty if field.is_required() else _default(field),
                    annotation=_plain_type(field.annotation),
                )
                for name, field in every.items()
                if name.isidentifier() and not iskeyword(name)  # not from, nor dotted keys of samples
            ]
        )

    @__signature__.setter
    def __signature__(self, _of_pydantic: object) -> None:
        pass

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        """The words of the class; where they have no table of parameters, with one of its keys."""
        words: str | None = vars(self).get("__doc__")
        if words is None or self.__signature__ is None or f"{_PARAMETERS}\n" in words:
            return words
        words = cleandoc(words)
        first = _HEADING.search(words)
        end = first.start() if first else len(words)
        keys = (_row(cast("type[Section]", self), each) for each in self.__signature__.parameters.values())
        parts = words[:end].rstrip(), "\n".join((_PARAMETERS, "----------", *keys)), words[end:]
        return "\n\n".join(filter(None, parts))


_PARAMETERS = "Parameters"
_HEADING = re.compile(r"^[A-Z]\w+\n---+$", re.MULTILINE)  # of a section of a docstring


def _row(section: type[Section], key: Parameter) -> str:
    """Return a key, its type, its default, its meaning and its dimension, as numpydoc has parameters."""
    meaning, unit = dimension(meanings(section).get(key.name, ""))
    if meaning.partition(" ")[0].isalpha():
        meaning = meaning[0].upper() + meaning[1:]
    ending = "" if key.default is Parameter.empty else f", default {key.default!r}"
    if key.default is None or isinstance(key.default, _Made):
        ending = ", optional"
    return f"{key.name} : {_in_words(key.annotation)}{ending}\n    {meaning}{f' [{unit}]' if unit else ''}."


def _in_words(annotation: Any) -> str:
    """Return a type as docstrings name it, such as "float or tuple of float"."""
    if annotation in (Any, Path):
        return "path" if annotation is Path else "object"
    if get_origin(annotation) is Literal:
        return " or ".join(map(str, get_args(annotation)))
    inner = [_in_words(part) for part in get_args(annotation) if part not in (type(None), ...)]
    if not inner:
        return str(annotation.__name__)
    origin, inner = get_origin(annotation), list(dict.fromkeys(inner))
    return (
        " or ".join(inner) if origin in (Union, UnionType) else f"{origin.__name__} of {' to '.join(inner)}"
    )


class _Made:
    """The default of a key that follows from other keys, or is a section."""

    def __repr__(self) -> str:
        return "..."


def _default(field: FieldInfo) -> Any:
    return field.default if field.default_factory is None else _Made()


def _plain_type(annotation: Any) -> Any:
    """Return a type without the notes of its checks."""
    if hasattr(annotation, "__metadata__"):
        return _plain_type(annotation.__origin__)
    if not (parts := get_args(annotation)) or get_origin(annotation) is Literal:
        return annotation
    plainly = tuple(map(_plain_type, parts))
    return Union[plainly] if isinstance(annotation, UnionType) else get_origin(annotation)[plainly]  # noqa: UP007


class Section(BaseModel, metaclass=_Shown):
    """A part of the configuration: immutable, with the listed keys only."""

    # Built when first used: the whole configuration contains a copy of most sections.
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)
    entries: ClassVar[type[Section] | None] = None  # section under each key that the user chooses

    @property
    def in_configurations(self) -> Section:
        """The section as a configuration writes it: itself, where its class is one of the package's."""
        return self

    if not TYPE_CHECKING:  # type checkers see the keys themselves

        @alone
        def __init__(self, *values: Any, **keys: Any) -> None:
            """Make a section from its keys, which may be NumPy's numbers; ConfigError lists every error."""
            self._take(plain(self._named(values, keys)))

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Build the schema, in which fields find the section that they are of."""
        before = building.set(cls)
        try:
            return handler(source)
        finally:
            building.reset(before)

    def _take(self, data: dict[str, Any]) -> None:
        """Validate plain data into this new section."""
        try:
            self.__pydantic_validator__.validate_python(data, self_instance=self)
        except ValidationError as error:
            raise ConfigError(map(str, self.all_problems(data, error))) from None

    @classmethod
    def _in_order(cls) -> tuple[str, ...]:
        """Return the keys whose values need no name in Python, in their order."""
        return ()

    @classmethod
    def _word(cls) -> str:
        """Return the key whose word the class implies, or nothing."""
        return ""

    @classmethod
    def _named(cls, values: Sequence[Any], keys: Mapping[str, Any]) -> dict[str, Any]:
        """Return values by their keys; ConfigError for values without a name, or more than there are."""
        ordered, title = cls._in_order(), cls.__name__
        named = dict(zip(ordered, values, strict=False))
        if twice := [key for key in named if key in keys]:
            raise ConfigError(
                f"{key}: got two values, one by its place; {title} takes each of {', '.join(ordered)} once"
                for key in twice
            )
        if len(values) > len(ordered):
            others = [key for key in cls.fields() if key not in (cls._word(), *ordered)]
            takes = f"takes {', '.join(others)} by name"
            if ordered:
                takes = (
                    f"takes {', '.join(ordered)} in this order{', and ' * bool(others)}{takes * bool(others)}"
                )
            elif len(values) <= len(others):
                takes += f", such as {title}({', '.join(map('{}={!r}'.format, others, values))})"
            got = f"{len(values)} value{'s' * (len(values) > 1)} without a name"
            raise ConfigError([f"{title}: got {got}; {takes}"])
        return named | dict(keys)

    @classmethod
    def all_problems(cls, data: dict[str, Any], error: ValidationError) -> list[Mistake]:  # noqa: ARG003
        """Return the errors that pydantic found in plain data, as problems.

        Parameters
        ----------
        data : dict
            Plain data of this section.
        error : ValidationError
            What pydantic found in them.
        """
        return explained(error, cls, cls.fields())

    def problems(self) -> Iterator[Mistake]:
        """Yield contradictions between the values; locations and keys are relative to this section."""
        return iter(())

    @classmethod
    def fields(cls) -> dict[str, FieldInfo]:
        """Return the fields by the names that users write."""
        return {field.alias or name: field for name, field in cls.model_fields.items()}

    def __getstate__(self) -> dict[Any, Any]:
        """Copy what it holds, of which another thread may derive more while it is pickled."""
        state = super().__getstate__()
        return state | {"__dict__": state["__dict__"].copy()}

    def values_written(self) -> dict[str, Any]:
        """Return the values by the names that users write."""
        return {field.alias or name: vars(self)[name] for name, field in type(self).model_fields.items()}


class Kind(Section):
    """One of several sections of a key; the default of its first field is the word that chooses it."""

    @classmethod
    def _word(cls) -> str:
        """Return the key whose word the class implies."""
        return next(iter(cls.model_fields), "")

    def _take(self, data: dict[str, Any]) -> None:
        """Validate plain data into this new section, with its word, so that a dump contains the word."""
        key, word = next(iter(type(self).model_fields.items()))
        super()._take({key: word.default} | data)


def plain(value: object) -> Any:
    """Return values of Python, NumPy and sections as plain data for YAML."""
    if isinstance(value, Section):
        value = value.in_configurations.model_dump(exclude_unset=True)
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain(entry) for entry in value]
    if isinstance(value, os.PathLike) and not isinstance(value, MemoryFile):
        return os.fspath(value)
    return value.tolist() if hasattr(value, "tolist") else value


Member = TypeVar("Member", bound=Section)
Part = TypeVar("Part", bound=Section)


def load_table(*places: str) -> dict[str, Any]:
    """Import the sections of a table, each "package.module:Class", by the default of their first field."""
    members = {}
    for place in places:
        module, _, name = place.partition(":")
        section = getattr(import_module(module), name)
        members[next(iter(section.model_fields.values())).default] = section
    return members


class OneOf(Generic[Member]):
    """Annotation of a field with one of several sections: word -> section; the first is the default."""

    def __init__(self, members: Mapping[str, type[Member]]) -> None:
        self.members = members
        self._default, first = next(iter(members.items()))
        self.key = next(iter(first.model_fields))

    def word(self, value: object) -> str:
        """Return the word that chooses the section."""
        if isinstance(value, Section):
            return str(getattr(value, self.key))
        return str(value.get(self.key, self._default)) if isinstance(value, Mapping) else self._default

    def __get_pydantic_core_schema__(self, _source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate with the chosen section."""
        choices: dict[Any, Any] = {
            word: handler.generate_schema(section) for word, section in self.members.items()
        }
        return core_schema.tagged_union_schema(choices, self.word)


def held_by(field: FieldInfo) -> OneOf[Any] | type[Section] | None:
    """Return the section of a field (alone, in a list or as plain data), or the choice of several."""
    of_members = (getattr(part, "__metadata__", ()) for part in get_args(field.annotation))
    for note in chain(field.metadata, *of_members):
        if isinstance(note, OneOf):
            return note
        if section := getattr(note, "section", None):
            return section  # type: ignore[no-any-return]
    return next((kind for kind in types_in(field.annotation) if issubclass(kind, Section)), None)


def described(section: type[Section], key: str) -> tuple[str, str]:
    """Return the meaning and dimension of a dotted key, in the first kind of section that has the key."""
    kinds, words = [section], ""
    for part in (part for part in key.split(".") if not part.isdigit()):
        fields = [
            (kind, field)
            for kind in kinds
            for name, field in kind.model_fields.items()
            if part == (field.alias or name)
        ]
        words = meanings(fields[0][0]).get(part, "") if fields else ""
        choices = [held_by(field) for _, field in fields]
        below = [list(one.members.values()) if isinstance(one, OneOf) else [one] for one in choices if one]
        kinds = [kind for several in below for kind in several]
    return dimension(words)


def sections_in(section: Section, at: Location = ()) -> Iterator[tuple[Location, Section]]:
    """Yield a section and all sections below it, with their locations, in the order of the model."""
    waiting = [(at, section)]
    while waiting:
        at, section = waiting.pop()
        yield at, section
        waiting += [((*at, *place), part) for place, part in _below(section)]


@kept_with  # this function is called often
def _below(section: Section) -> list[tuple[Location, Section]]:
    """Return the sections right below a section, the last first."""
    below: list[tuple[Location, Section]] = []
    for key, value in vars(section).items():
        if value.__class__ in _PLAIN:  # most values
            continue
        if isinstance(value, Section):
            below.append(((key,), value))
        elif isinstance(value, tuple):
            below += [((key, i), part) for i, part in enumerate(value) if isinstance(part, Section)]
    return below[::-1]


def texts_in(value: object, at: Location = ()) -> Iterator[tuple[Location, Written]]:
    """Yield the numbers in a section, or in plain data, that were written as texts, with their locations."""
    if isinstance(value, Written):
        yield at, value
    elif isinstance(value, list | tuple):
        for i, each in enumerate(value):
            yield from texts_in(each, (*at, i))
    elif isinstance(value, Mapping | Section):
        held = value if isinstance(value, Mapping) else value.values_written()
        for key, each in held.items():
            yield from texts_in(each, (*at, key))


def replaced(section: Part, change: Callable[[Any], Any]) -> Part:
    """Return a section in which `change` replaces values at any depth; it returns all others themselves."""

    def new(value: Any) -> Any:
        if (changed := change(value)) is not value:
            return changed
        if isinstance(value, tuple):
            parts = tuple(map(new, value))
            return value if all(map(is_, parts, value)) else parts
        return replaced(value, change) if isinstance(value, Section) else value

    update = {key: changed for key, value in vars(section).items() if (changed := new(value)) is not value}
    return section.model_copy(update=update) if update else section


def contradictions(section: Section) -> Iterator[Mistake]:
    """Yield the problems of a section and of all sections below it."""
    for at, part in sections_in(section):
        for problem in part.problems():
            yield problem.within(at)


def types_in(annotation: Any) -> Iterator[type]:
    """Yield the classes in an annotation, through unions, lists and Annotated."""
    if hasattr(annotation, "__metadata__"):
        annotation = annotation.__origin__
    inner = get_args(annotation)
    if inner:
        for part in inner:
            yield from types_in(part)
    elif isinstance(annotation, type):
        yield annotation


def explained(error: ValidationError, root: type[Section], everywhere: Iterable[str]) -> list[Mistake]:
    """Return the errors that pydantic found in a `root`, as problems; suggest keys from `everywhere`."""
    mistakes: list[Mistake] = []
    for entry in error.errors(include_url=False):
        location, section, chosen_by = _resolved(entry["loc"], root, entry["type"] == "extra_forbidden")
        match entry["type"]:
            case "default_factory_not_called":
                pass  # the value behind this default is reported itself
            case "value_error" if hasattr(entry["ctx"]["error"], "problems"):
                mistakes += [problem.within(location) for problem in entry["ctx"]["error"].problems]
            case "extra_forbidden":
                message = unknown_key(str(location[-1]), section.fields(), everywhere)
                mistakes.append(Mistake(location, message, at_key=True))
            case "missing":
                key = str(location[-1])
                notes = (note.allowed for note in section.fields()[key].metadata if isinstance(note, MustBe))
                allowed = next(notes, None) or meanings(section).get(key, "given")
                mistakes.append(Mistake(location, f"missing; must be {allowed}"))
            case "union_tag_invalid":
                words = Word(*entry["ctx"]["expected_tags"].replace("'", "").split(", "))
                word = entry["ctx"]["tag"]
                message = f"got {shown(word)}; must be {words.allowed}{nearest(word, words.words)}"
                mistakes.append(Mistake((*location, chosen_by), message, chooses=True))
            case "quantity" | "moment" as kind:
                others = {"quantity": ("units",), "moment": ("time", "trajectory")}[kind]
                chooses = _requires(section, location)
                mistakes.append(Mistake(location, entry["msg"], others, chooses=chooses))
            case "must_be" | "value_error":
                message = entry["msg"].removeprefix("Value error, ")
                mistakes.append(Mistake(location, message, chooses=_requires(section, location)))
            case kind:
                allowed, value = _SHAPES.get(kind, entry["msg"]), entry["input"]
                hint = colon_without_space(value) if isinstance(value, str) else ""
                if kind == "model_type":
                    allowed += _form(section, location, value)
                message = f"got {shown(value)}; must be {allowed}{hint}"
                mistakes.append(Mistake(location, message, chooses=_requires(section, location)))
    return list(dict.fromkeys(mistakes))


def _resolved(raw: Location, root: type[Section], unknown: bool) -> tuple[Location, type[Section], str]:
    """Return a location without pydantic's names for members of unions, its section, and its choosing key.

    With `unknown` the last part is not a known key.
    """
    location: list[str | int] = []
    holder: type[Section] = root
    held: OneOf[Any] | type[Section] | None = root
    for place, part in enumerate(raw, start=1):
        if isinstance(part, int):
            location.append(part)
        elif part in FORMS and not (unknown and place == len(raw)) and not getattr(held, "entries", None):
            pass
        elif isinstance(held, OneOf):
            held = held.members[part]
        elif held is not None:  # below a value pydantic adds the name of its form: number or list
            location.append(part)
            holder, field = held, held.fields().get(part)
            held = held.entries if field is None else held_by(field)
    return tuple(location), holder, held.key if isinstance(held, OneOf) else ""


def _requires(section: type[Section], location: Location) -> bool:
    field = section.fields().get(dotted_key(without_last_places(location)[-1:]))
    return field is not None and field.is_required()


def _form(section: type[Section], location: Location, value: object) -> str:
    """Return ", such as {...}" with the required keys of the section that a key holds, or of the nearest."""
    field = section.fields().get(dotted_key(without_last_places(location)[-1:]))
    held = section.entries if field is None else held_by(field)
    keys = {}
    if isinstance(held, OneOf):
        word = next(iter(get_close_matches(str(value), held.members, n=1)), next(iter(held.members)))
        keys, held = {held.key: word}, held.members[word]
    if held is not None:
        keys |= {key: "..." for key, field in held.fields().items() if field.is_required()}
    return f", such as {{{', '.join(f'{key}: {word}' for key, word in keys.items())}}}" if keys else ""


class OneOrMore(OneOf[Member]):
    """Annotation of a field with one of several sections, or a list of them."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate one with the chosen section, or each of a list."""
        one = super().__get_pydantic_core_schema__(source, handler)
        at_least_one = {"pydantic_js_updates": {"minItems": 1}}
        several = core_schema.tuple_schema([one], variadic_item_index=0, metadata=at_least_one)
        forms: dict[Any, Any] = {"<one>": one, "<list>": several}
        return core_schema.tagged_union_schema(
            forms, lambda value: "<list>" if isinstance(value, list | tuple) else "<one>"
        )


@kept_with
def files_named(section: Section) -> dict[str, Path]:
    """Return the files that a configuration names, by dotted key."""
    return {
        dotted((*at, key)): value
        for at, part in sections_in(section)
        for key, value in vars(part).items()
        if value.__class__ not in _PLAIN and isinstance(value, Path)
    }


@cache  # found once for each section: laws and bodies stand in many places
def keys_of_files(section: type[Section]) -> tuple[str, ...]:
    """Return the dotted keys below a section that may name a file."""
    keys: list[str] = []
    for key, field in section.fields().items():
        held = held_by(field)
        for member in held.members.values() if isinstance(held, OneOf) else filter(None, [held]):
            keys += (f"{key}.{below}" for below in keys_of_files(member))  # type: ignore[arg-type]
        if Path in types_in(field.annotation):
            keys.append(key)
    return tuple(keys)
