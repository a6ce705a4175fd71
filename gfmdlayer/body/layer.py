"""A layer, and the halfspace below: keys of the configuration, of which `layers` makes a body.

A material may stand in a file of its own, as fit-material and fit-indentation write it. The configuration
takes the material itself, so that results, digests and the stored configuration depend on the contents of
the file and not on its name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, NoReturn, cast

from pydantic import Field, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema, core_schema

from gfmdlayer.body.laws import LAWS
from gfmdlayer.body.materials import Law, Material, Zener
from gfmdlayer.validation import text
from gfmdlayer.validation.fields import Extended, File, MustBe, given, strict
from gfmdlayer.validation.problems import InconsistentError, Mistake
from gfmdlayer.validation.sections import OneOf, Section, alone, contradictions, explained, plain


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
        """Take a law, of any class, as it is; replace a file by the law in it."""
        schema = super().__get_pydantic_core_schema__(source, handler)
        return core_schema.no_info_wrap_validator_function(_law, schema)


def _law(value: Any, validated: Any) -> Law:
    """Return a law, or the law in a file."""
    law = value if isinstance(value, Law) else validated(value)
    return read_material(law.file) if isinstance(law, MaterialFile) else law


MATERIALS = _LawOrFile({**LAWS, "file": MaterialFile})


class _MaterialHolder(Section):
    material: Annotated[Law, OneOf(LAWS)]


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
        law = _MaterialHolder.model_validate({"material": held["material"]}).material
        problems = [problem.within(("material",)) for problem in contradictions(law)]
    except ValidationError as error:
        problems = explained(error, _MaterialHolder, ())
    if problems:
        located = [Mistake((*at, *problem.location[1:]), problem.message) for problem in problems]
        _refuse(f"{document.place(problem.location)}: {problem}" for problem in located)
    return law


def _refuse(messages: Iterable[str]) -> NoReturn:
    raise InconsistentError([Mistake(("file",), message) for message in messages])


Poisson = Annotated[float, strict, Field(gt=-1, le=0.5), MustBe("a number > -1 and <= 0.5")]


class Layer(Section):
    """The viscoelastic layer; thickness 0 leaves only the halfspace, .inf only the layer.

    Parameters
    ----------
    thickness : float
        d >= 0: a length, or inf for a halfspace, which only the lowest may be.
    poisson : float
        nu, in (-1, 0.5].
    material : Law
        Shear response.

    Raises
    ------
    ConfigError
        If a parameter is outside of its bounds.

    Examples
    --------
    >>> gfmdlayer.Layer(thickness=0.1, poisson=0.4, material=gfmdlayer.Zener()).thickness
    0.1
    """

    thickness: Extended = 0.05
    """thickness d; 0: only the halfspace, .inf: only the layer: length"""
    poisson: Poisson = 0.5
    """Poisson's ratio of the layer; 0.5 is incompressible"""
    material: Annotated[Law, MATERIALS] = Field(default_factory=Zener)
    """viscoelastic law: its model, or {file: ...} of fit-material"""

    @alone
    def __init__(self, *values: Any, **keys: Any) -> None:
        """Make a layer from thickness, poisson and material, in this order or by name."""
        parameters = dict(zip(Layer.model_fields, values, strict=False)) | keys
        if len(parameters) < len(values) + len(keys):
            raise TypeError(f"{type(self).__name__} takes each of {', '.join(Layer.model_fields)} once")
        self._take(
            {key: value if isinstance(value, Law) else plain(value) for key, value in parameters.items()}
        )

    def with_law(self, law: Law) -> Layer:
        """Return the layer of another law."""
        return self if law is self.material else self.model_copy(update={"material": law})

    @property
    def series(self) -> Material:
        """The material as a spring beside Maxwell branches; TypeError for a continuous spectrum."""
        if not isinstance(self.material, Material):
            name = type(self.material).__name__
            raise TypeError(
                f"material: got {name}, a law with a continuous spectrum; must be a Prony series, such as "
                "material.prony(shortest, longest).material"
            )
        return cast("Material", self.material)


class StackedLayer(Layer):
    """One of several layers; thickness 0 leaves it out, and .inf makes the last one the halfspace."""

    thickness: Extended
    """thickness d; .inf: the halfspace, for the last one: length"""


StackedLayers = Annotated[tuple[StackedLayer, ...], Field(json_schema_extra={"minItems": 1})]


class Halfspace(Section):
    """The halfspace below: elastic, rigid (shear modulus .inf), absent (0), or of a material."""

    material: Annotated[Annotated[Law, MATERIALS] | None, given] = None
    """viscoelastic law of the base, in place of shear_modulus"""
    shear_modulus: Annotated[Extended | None, given] = Field(
        default_factory=lambda data: 1.0 if data.get("material") is None else None
    )
    """shear modulus of the base; 0: a free layer, .inf: rigid: pressure"""
    poisson: Poisson = 0.5
    """Poisson's ratio of the base"""

    def problems(self) -> Iterator[Mistake]:
        """Refuse a modulus beside a material."""
        if self.material is not None and self.shear_modulus is not None:
            message = "given beside material; remove one of the two"
            yield Mistake(("shear_modulus",), message, ("material",))

    def with_law(self, law: Law) -> Halfspace:
        """Return the halfspace of another law."""
        return self if law is self.material else self.model_copy(update={"material": law})
