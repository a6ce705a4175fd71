"""The layers and the halfspace of a configuration."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NoReturn

from pydantic import Field, GetCoreSchemaHandler, PrivateAttr, ValidationError
from pydantic_core import CoreSchema, core_schema

from gfmdlayer.body.laws import LAWS
from gfmdlayer.body.materials import Law, Material, Zener
from gfmdlayer.body.solid import Solid
from gfmdlayer.validation import text
from gfmdlayer.validation.fields import Extended, File, MustBe, given, strict
from gfmdlayer.validation.problems import InconsistentError, Location, Problem
from gfmdlayer.validation.sections import OneOf, Section, contradictions, explained

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gfmdlayer.body.body import Body
    from gfmdlayer.body.relaxation import Spectrum
    from gfmdlayer.body.wavevectors import Wavevectors


# A material in a file of its own, as fit-material and fit-indentation write it.
#
# The configuration takes the material itself, so that results, digests and the stored configuration depend on
# the contents of the file and not on its name.


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


Poisson = Annotated[float, strict, Field(gt=-1, le=0.5), MustBe("a number > -1 and <= 0.5")]


class Layer(Section):
    """The viscoelastic layer; thickness 0 leaves only the halfspace, .inf only the layer."""

    thickness: Extended = 0.05
    """thickness d; 0: only the halfspace, .inf: only the layer: length"""
    poisson: Poisson = 0.5
    """Poisson's ratio of the layer; 0.5 is incompressible"""
    material: Annotated[Law, MATERIALS] = Field(default_factory=Zener)
    """viscoelastic law: its model, or {file: ...} of fit-material"""


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

    def problems(self) -> Iterator[Problem]:
        """Refuse a modulus beside a material."""
        if self.material is not None and self.shear_modulus is not None:
            message = "given beside material; remove one of the two"
            yield Problem(("shear_modulus",), message, ("material",))


def layered(data: Mapping[str, Any]) -> bool:
    """Whether the body of a configuration is made of layers, which is the default."""
    return isinstance(data.get("body"), Layers | None)


def problems_of_the_body(
    body: Solid | None,
    layers: tuple[StackedLayer, ...] | None,
    layer: Layer | None,
    halfspace: Halfspace | None,
) -> Iterator[Problem]:
    """Yield contradictions between the keys of the body, and between layers and halfspace."""
    if not layered({"body": body}):
        assert body is not None
        for key, value in (("layers", layers), ("layer", layer), ("halfspace", halfspace)):
            if value is not None:
                other = f"{{kind: {body.kind}}}; remove it or set body: {{kind: layers}}"
                message = f"not available with body: {other}"
                yield Problem((key,), message, ("body",), at_key=True)
        return
    assert halfspace is not None
    if layers is not None and layer is not None:
        yield Problem(("layers",), "given beside layer; remove one of the two", ("layer",), at_key=True)
        return
    every = layers or (() if layer is None else (layer,))
    if not every:
        yield Problem(("layers",), "got an empty list; must have at least one {thickness: ...}")
        return
    for i, above in enumerate(every[:-1]):
        if math.isinf(above.thickness):
            message = "got .inf above another layer; must be finite: only the last can be a halfspace"
            yield Problem(("layers", i, "thickness"), message, ("layers",))
    modulus = halfspace.shear_modulus
    if modulus in {0, math.inf} and not any(each.thickness for each in every):
        nothing = "halfspace without stiffness: the body carries no load"
        base = "rigid halfspace: the body cannot deform" if modulus else nothing
        allowed = "must be > 0, or halfspace.shear_modulus a number > 0 and finite"
        at: Location = ("layer", "thickness") if layers is None else ("layers", 0, "thickness")
        yield Problem(at, f"got 0 on a {base}; {allowed}", ("halfspace.shear_modulus", "layers"))


class Compound(Solid):
    """A body of several parts: it is one in the sense of `Body` where their laws are series."""

    def stiffness(self, waves: Wavevectors | ArrayLike, s: ArrayLike) -> NDArray[Any]:
        """Return K(q, s) of parts whose laws are series."""
        return self._as_given.stiffness(waves, s)

    def spectrum(self, waves: Wavevectors | ArrayLike) -> Spectrum:
        """Return the relaxing modes of parts whose laws are series."""
        return self._as_given.spectrum(waves)

    @property
    def _as_given(self) -> Body:
        return self.with_series([law for law in self.laws if isinstance(law, Material)], 0.0)


class Layers(Compound):
    """Layers on a halfspace, by the keys layer, layers and halfspace of the configuration."""

    isolated: ClassVar[bool] = True

    kind: Literal["layers"] = "layers"
    """layers on a halfspace: the keys layer, layers and halfspace beside body"""

    _layers: tuple[Layer, ...] = ()
    _base: Halfspace = PrivateAttr()  # both are set by `of`

    @classmethod
    def of(cls, layers: tuple[Layer, ...], base: Halfspace) -> Layers:
        """Return the body of these layers, from the surface down."""
        made = cls.model_construct()  # nothing to validate
        made._layers, made._base = layers, base
        return made

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The layers from the surface down."""
        return self._layers

    @property
    def base(self) -> Halfspace:
        """The halfspace below them."""
        return self._base

    @property
    def laws(self) -> tuple[Law, ...]:
        """The laws of the layers from the surface down, and of the halfspace where it has one."""
        base = self._base.material
        return (*(layer.material for layer in self._layers), *(() if base is None else (base,)))

    def with_series(self, materials: Sequence[Material], accuracy: float) -> Body:
        """Return the layers on their base; a stack merges its modes to the accuracy."""
        from gfmdlayer.body import stack
        from gfmdlayer.body.body import layered_body

        base = self._base
        given = zip(self._layers, materials, strict=False)  # the last is the halfspace's, where it has one
        layers = [stack.Layer(each.thickness, each.poisson, material) for each, material in given]
        below = materials[-1] if base.shear_modulus is None else base.shear_modulus
        return layered_body(layers, below, base.poisson, accuracy=accuracy)

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0) by the units of the layers' laws; 0 where the mean height of the surface stays."""
        rigid = self._base.shear_modulus == math.inf and math.isfinite(self._layers[-1].thickness)
        compliances = [
            layer.thickness * (1 - 2 * layer.poisson) / (2 * (1 - layer.poisson) * layer.material.unit)
            for layer in self._layers
            if layer.poisson < 0.5
        ]
        return 1 / sum(compliances) if rigid and any(compliances) else 0.0

    @property
    def moduli(self) -> tuple[float, ...]:
        """Finite moduli of the layers and the halfspace."""
        base = self._base.shear_modulus
        return (*super().moduli, *((base,) if base and math.isfinite(base) else ()))

    @property
    def thicknesses(self) -> tuple[float, ...]:
        """Thicknesses of the layers from the surface down."""
        return tuple(layer.thickness for layer in self._layers)

    @property
    def rigid_below(self) -> float:
        """Depth of a rigid base."""
        return sum(self.thicknesses) if self._base.shear_modulus == math.inf else math.inf

    @property
    def contact_modulus(self) -> float | None:
        """E* = 2 G/(1 - nu) of the uppermost material; where it relaxes to zero, by the unit of its law."""
        for layer in self._layers:
            if layer.thickness > 0:
                return 2 * layer.material.unit / (1 - layer.poisson)
        base = self._base
        modulus = base.shear_modulus if base.material is None else base.material.unit
        assert modulus is not None
        return 2 * modulus / (1 - base.poisson)

    @property
    def merges(self) -> bool:
        """Whether the body is a stack, whose modes are merged."""
        return (
            len(self._layers) > 1
            or isinstance(self._layers[0], StackedLayer)
            or self._base.material is not None
        )

    def problems_isolated(self) -> Iterator[Problem]:
        """Refuse layers without a base."""
        if self._base.shear_modulus == 0 and math.isfinite(sum(self.thicknesses)):
            message = "got 0: a layer without a base does not support an isolated load; must be > 0"
            yield Problem(("halfspace", "shear_modulus"), message, ("layer.thickness", "layers"))


def thicknesses(solid: Solid) -> list[float]:
    """Return the thicknesses of the layers that a body has, from the surface down; inf: a halfspace."""
    assert isinstance(solid, Layers)
    found: list[float] = []
    for each in solid.thicknesses:
        if each > 0:
            found.append(each)
        if math.isinf(each):
            return found
    return [*found, math.inf] if solid.base.shear_modulus not in (0, math.inf) else found


def interfaces(solid: Solid) -> list[float]:
    """Return the depths of the interfaces between layers, and of the bond to a rigid base."""
    layers = thicknesses(solid)
    assert isinstance(solid, Layers)
    bonded = layers if solid.base.shear_modulus == math.inf else layers[:-1]
    return [depth for depth in accumulate(bonded) if math.isfinite(depth)]
