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
from gfmdlayer.body.materials import Law, Material, Zener, contradicting, shear_modulus
from gfmdlayer.validation import text
from gfmdlayer.validation.fields import Extended, File, MustBe, given, strict
from gfmdlayer.validation.problems import ConfigError, InconsistentError, Mistake, shown
from gfmdlayer.validation.quantities import measured
from gfmdlayer.validation.sections import (
    OneOf,
    Section,
    alone,
    contradictions,
    explained,
    plain,
    replaced,
    sections_in,
)
from gfmdlayer.validation.units import OwnUnits, Units


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
    law = value.in_configurations if isinstance(value, Law) else validated(value)
    return read_material(law.file) if isinstance(law, MaterialFile) else law


MATERIALS = _LawOrFile({**LAWS, "file": MaterialFile})


class _MaterialHolder(Section):
    material: Annotated[Law, OneOf(LAWS)]
    units: Units | None = None


def read_material(path: Path) -> Law:
    """Read the material in a YAML file: its only section `layer.material`, or `material`."""
    document = text.read(path.read_bytes(), str(path))
    if document.problems:
        _refuse(f"{place}: {message}" for place, message in document.problems)
    at: tuple[str, ...] = ("material",)
    held = document.data if isinstance(document.data, dict) else {}
    if isinstance(held.get("layer"), dict):
        held, at = held["layer"], ("layer", "material")
    units = document.data.get("units") if isinstance(document.data, dict) else None
    if not isinstance(held.get("material"), dict):
        _refuse([f"{path}:1:1: has no material; must be YAML with a section layer: {{material: ...}}"])
    try:
        with measured(OwnUnits({"units": units})):
            found = _MaterialHolder.model_validate({"material": held["material"], "units": units})
        law = found.material
        problems = [problem.within(("material",)) for problem in contradictions(law)]
    except ValidationError as error:
        problems = explained(error, _MaterialHolder, ())
    if problems:
        located = [
            Mistake((*at, *problem.location[1:]), problem.message)
            if problem.location[0] == "material"
            else problem
            for problem in problems
        ]
        _refuse(f"{document.place(problem.location)}: {problem}" for problem in located)
    return law if found.units is None else law.measured_in(found.units.stress, found.units.time)


def in_units(value: Any, units: Units | None) -> Any:
    """Return a section, or several, with the materials of files in the units of the configuration."""
    parts = value if isinstance(value, tuple) else (value,)
    for i, part in enumerate(parts):
        for at, law in sections_in(part) if isinstance(part, Section) else ():
            if units is None and isinstance(law, Law) and law.units is not None:
                stress, time = law.units
                message = (
                    f"the file has moduli in {stress} and times in {time}, the configuration has no units; "
                    f"give units: {{length: ..., stress: {stress}, time: {time}}}, or remove its units"
                )
                place = (i, *at) if isinstance(value, tuple) else at
                raise InconsistentError([Mistake(place, message, ("units",))])

    def converted(part: Any) -> Any:
        if units is None or not isinstance(part, Law) or part.units is None:
            return part
        return part.in_units(units.stress, units.time)

    found = tuple(replaced(part, converted) if isinstance(part, Section) else part for part in parts)
    return found if isinstance(value, tuple) else found[0]


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
        named = self._named(values, keys)
        if not isinstance(law := named.get("material", {}), Law | Mapping):
            example = "such as Elastic(1.0) or Zener(), or its keys"
            raise ConfigError([f"material: got {shown(law)}; must be a law of a material, {example}"])
        self._take({key: value if isinstance(value, Law) else plain(value) for key, value in named.items()})
        if problems := list(contradictions(self)):  # in a configuration a sweep may replace the values
            raise ConfigError(map(str, problems))
        if self.material.units is not None:
            words = "material: its file has units, which a configuration converts"
            raise ConfigError([f"{words}; give the layer there as a mapping, or remove the units"])

    @classmethod
    def _in_order(cls) -> tuple[str, ...]:
        """Return the keys whose values need no name, in their order."""
        return tuple(Layer.model_fields)

    def problems(self) -> Iterator[Mistake]:
        """Refuse moduli that contradict each other or Poisson's ratio."""
        yield from (problem.within(("material",)) for problem in self.material.moduli_at(self.poisson))

    @property
    def in_shear(self) -> Layer:
        """The layer whose material has shear moduli."""
        return self.with_law(self.material.in_shear(self.poisson))

    def with_law(self, law: Law) -> Layer:
        """Return the layer of another law.

        Parameters
        ----------
        law : Law
            Shear response of the layer.
        """
        return self if law is self.material else self.model_copy(update={"material": law})

    @property
    def series(self) -> Material:
        """The material as a spring beside Maxwell branches; ConfigError for a continuous spectrum."""
        if not isinstance(self.material, Material):
            name = type(self.material).__name__
            allowed = "must be a Prony series, such as material.prony(shortest, longest).material"
            raise ConfigError([f"material: got {name}, a law with a continuous spectrum; {allowed}"])
        return cast("Material", self.material)


class StackedLayer(Layer):
    """One of several layers; thickness 0 leaves it out, and .inf makes the last one the halfspace."""

    thickness: Extended
    """thickness d; .inf: the halfspace, for the last one: length"""


StackedLayers = Annotated[tuple[StackedLayer, ...], Field(json_schema_extra={"minItems": 1})]


class Halfspace(Section):
    """The halfspace below layers: elastic, rigid (shear modulus .inf), absent (0), or of a material.

    As a body on its own it is `halfspace`.

    Examples
    --------
    >>> base = gfmdlayer.Halfspace(young_modulus=3.0, poisson=0.5)
    >>> gfmdlayer.Config(name="a", halfspace=base).solid.base.shear_modulus
    1.0
    """

    material: Annotated[Annotated[Law, MATERIALS] | None, given] = None
    """viscoelastic law of the base, in place of shear_modulus"""
    young_modulus: Annotated[Extended | None, given] = None
    """Young's modulus of the base, in place of shear_modulus: pressure"""
    bulk_modulus: Annotated[Extended | None, given] = None
    """bulk modulus of the base, in place of shear_modulus: pressure"""
    shear_modulus: Annotated[Extended | None, given] = Field(
        default_factory=lambda data: (
            1.0
            if all(data.get(key) is None for key in ("material", "young_modulus", "bulk_modulus"))
            else None
        )
    )
    """shear modulus of the base; 0: a free layer, .inf: rigid: pressure"""
    poisson: Poisson = 0.5
    """Poisson's ratio of the base"""

    @property
    def _moduli(self) -> dict[str, float]:
        keys = ("shear_modulus", "young_modulus", "bulk_modulus")
        return {key: vars(self)[key] for key in keys if vars(self)[key] is not None}

    def problems(self) -> Iterator[Mistake]:
        """Refuse a modulus beside a material, and moduli that contradict each other."""
        if self.material is not None:
            message = "given beside material; remove one of the two"
            yield from (Mistake((key,), message, ("material",)) for key in self._moduli)
            yield from (problem.within(("material",)) for problem in self.material.moduli_at(self.poisson))
        else:
            yield from contradicting(self._moduli, self.poisson)

    @property
    def in_shear(self) -> Halfspace:
        """The halfspace by a shear modulus, or by a material that has shear moduli."""
        if self.material is not None:
            return self.with_law(self.material.in_shear(self.poisson))
        if self.young_modulus is None and self.bulk_modulus is None:
            return self
        others = {"young_modulus": None, "bulk_modulus": None}
        return self.model_copy(update={"shear_modulus": shear_modulus(self._moduli, self.poisson)} | others)

    def with_law(self, law: Law) -> Halfspace:
        """Return the halfspace of another law.

        Parameters
        ----------
        law : Law
            Shear response of the halfspace.
        """
        return self if law is self.material else self.model_copy(update={"material": law})
