"""The bodies that `body` chooses from: the table of the package, or a user's own file; the counterbody.

``body: {file: mine.py, k: 5.0}`` runs the Python code in mine.py when the configuration is read, and takes
the one class there that derives from `gfmdlayer.Solid`; the other keys are its fields. The contents of the
file enter the digest, and results keep a copy, as of every file that a configuration names.
"""

from __future__ import annotations

import hashlib
import inspect
import math
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, PrivateAttr, SerializationInfo, ValidationError
from pydantic_core import CoreSchema, core_schema

from gfmdlayer.body.materials import Elastic, Law, Material
from gfmdlayer.body.solid import Relaxation, Solid
from gfmdlayer.config.layers import (
    Compound,
    Halfspace,
    Layer,
    Layers,
    StackedLayers,
    layered,
    problems_of_the_body,
)
from gfmdlayer.validation.fields import File, Finite, given
from gfmdlayer.validation.problems import InconsistentError, Problem
from gfmdlayer.validation.sections import OneOf, Section, explained, keys_of_files, load_table

if TYPE_CHECKING:
    from gfmdlayer.body.body import Body

# The first is meant where `kind` is left out.
BODIES: dict[str, type[Solid]] = load_table(
    "gfmdlayer.config.layers:Layers",
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

    file: File
    """Python file with the class of the body"""

    def __reduce__(self) -> Any:
        """Take the code along: the file may have changed or gone."""
        own = type(self).__mro__[2]
        return _restored, (sys.modules[own.__module__].__loader__, self.__getstate__())


class _BodyOrFile(OneOf[Any]):
    """Annotation of a field that holds a body, or names a file that defines it."""

    def word(self, value: object) -> str:
        """Return the kind; a mapping that names a file needs none."""
        if isinstance(value, _OfFile) or (isinstance(value, Mapping) and "file" in value):
            return "file"
        return super().word(value)

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


def _of_file(given: Any) -> Solid:
    """Return the body of the class in a file; InconsistentErrors name the file with the line, or the key."""
    if isinstance(given, _OfFile):
        return given  # type: ignore[return-value]
    try:
        path = BodyFile.model_validate({"file": given["file"]}).file
    except ValidationError as error:
        found = [replace(problem, chooses=True) for problem in explained(error, BodyFile, ())]
        raise InconsistentError(found) from None
    try:
        section = body_class(path.read_bytes(), str(path))
    except ValueError as error:
        raise InconsistentError([Problem(("file",), str(error), chooses=True)]) from None
    data = dict(given)
    for key in keys_of_files(section):  # beside the file of the body
        if key != "file" and isinstance(data.get(key), str):
            data[key] = str(path.parent / data[key])
    try:
        body = section.model_validate(data)
    except ValidationError as error:
        raise InconsistentError(explained(error, section, ())) from None
    return body


def _restored(source: SimpleNamespace, state: Any) -> Solid:
    section = body_class(source.source, source.path)
    body = section.__new__(section)
    body.__setstate__(state)
    return body


@lru_cache(maxsize=64)
def body_class(source: bytes, path: str) -> type[Solid]:
    """Run a file, and return its one class that derives from `Solid`; a ValueError names file and line."""
    module = ModuleType(f"gfmdlayer_body_{hashlib.sha256(source + path.encode()).hexdigest()[:16]}")
    module.__file__ = path
    module.__loader__ = SimpleNamespace(source=source, path=path)
    sys.modules[module.__name__] = module  # where annotations of the class are resolved
    try:
        exec(compile(source, path, "exec"), vars(module))
    except Exception as error:
        raise ValueError(f"{place_of(error, path)}; must be Python that defines a body") from None
    found = [
        each
        for each in vars(module).values()
        if isinstance(each, type) and issubclass(each, Solid) and each.__module__ == module.__name__
    ]
    if len(found) != 1:
        names = ", ".join(each.__name__ for each in found) or "none"
        raise ValueError(f"{path}: classes that derive from gfmdlayer.Solid: {names}; must be one")
    (own,) = found
    if lacking := sorted(own.__abstractmethods__):
        line = inspect.getsourcelines(own)[1]
        raise ValueError(f"{path}:{line}: {own.__name__} lacks {', '.join(lacking)}; must define them")
    return type(own.__name__, (_OfFile, own), {"__module__": __name__, "__doc__": own.__doc__})


def place_of(error: BaseException, path: str) -> str:
    """Return an error with the last line of a file that led to it."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    line = error.lineno if isinstance(error, SyntaxError) else lines[-1] if lines else None
    message = error.msg if isinstance(error, SyntaxError) else error
    return f"{path}{'' if line is None else f':{line}'}: {type(error).__name__}: {message}"


# The counterbody: the punch has its shape, and it deforms too.


class Counterbody(Section):
    """A second deformable body behind the shape of the punch; by default an elastic halfspace."""

    body: Annotated[Solid | None, BODY, given] = None
    """the counterbody; layers, by the three keys below, or {file: mine.py, ...}"""
    layers: Annotated[StackedLayers | None, given] = None
    """layers of the counterbody, from its surface inwards"""
    layer: Annotated[Layer | None, given] = None
    """the only layer of the counterbody; without it and layers, the halfspace is the counterbody"""
    halfspace: Annotated[Halfspace | None, given] = Field(
        default_factory=lambda data: Halfspace() if layered(data) else None
    )
    """the halfspace behind the layers; shear_modulus .inf without layers: a rigid counterbody"""
    velocity_ratio: Annotated[Finite | None, given] = None
    """velocity of the contact along it, over trajectory.velocity; 0: slides (default), 1: rolls"""

    def problems(self) -> Iterator[Problem]:
        """Yield contradictions between the keys; a halfspace needs no layer, and may be rigid."""
        bare = self.layers is None and self.layer is None
        if bare and self.halfspace is not None and layered({"body": self.body}):
            if self.halfspace.shear_modulus == 0:
                message = "got 0 without a layer: the counterbody carries no load; must be > 0"
                yield Problem(("halfspace", "shear_modulus"), message, ("layer", "layers"))
        else:
            yield from problems_of_the_body(self.body, self.layers, self.layer, self.halfspace)

    @property
    def solid(self) -> Solid | None:
        """The counterbody; None where it is rigid."""
        if not layered({"body": self.body}):
            return self.body
        assert self.halfspace is not None
        base, every = self.halfspace, self.layers or (() if self.layer is None else (self.layer,))
        if every:
            return Layers.of(every, base)
        if base.shear_modulus in (0, math.inf):  # 0 is refused by `problems`
            return None
        material = base.material or Elastic(base.shear_modulus)
        return Layers.of((Layer(thickness=math.inf, poisson=base.poisson, material=material),), Halfspace())


class TwoBodies(Compound):
    """A body and its counterbody: as one body under a rigid punch, see `gfmdlayer.body.pair`."""

    kind: Literal["pair"] = "pair"
    """a body and a counterbody"""

    _bodies: tuple[Solid, Solid] = PrivateAttr()

    @classmethod
    def of(cls, body: Solid, counterbody: Solid) -> TwoBodies:
        """Return the two bodies as one."""
        made = cls()
        made._bodies = body, counterbody
        return made

    @property
    def laws(self) -> tuple[Law, ...]:
        """The laws of the body, and of the counterbody."""
        return tuple(law for each in self._bodies for law in each.laws)

    def with_series(self, materials: Sequence[Material], accuracy: float) -> Body:
        """Return the pair with a series for each law; each body merges its own modes."""
        from gfmdlayer.body.pair import Pair

        first, second = self._bodies
        own = len(first.laws)
        above = second.with_series(materials[own:], accuracy)
        return Pair(first.with_series(materials[:own], accuracy), above)

    @property
    def mean_stiffness(self) -> float:
        """K(q = 0): both in series; a body that holds its mean displacement adds no compliance."""
        found = [each.mean_stiffness for each in self._bodies if each.mean_stiffness]
        return 1 / sum(1 / each for each in found) if found else 0.0

    @property
    def unit(self) -> float:
        """Modulus by which dimensionless pressures are divided, of the body."""
        return self._bodies[0].unit

    @property
    def characteristic_time(self) -> float | None:
        """The relaxation time of the body's first law, else of the counterbody's."""
        found = (each.characteristic_time for each in self._bodies)
        return next((time for time in found if time is not None), None)

    def roughly(self, longest: float) -> tuple[Relaxation, ...]:
        """Return the relaxation of the materials of both bodies; first, for the cost, both together."""
        every = tuple(each for body in self._bodies for each in body.roughly(longest))
        together = sum(relaxed for relaxed, _ in every), tuple(one for _, all_ in every for one in all_)
        return (together, *every)

    @property
    def moduli(self) -> tuple[float, ...]:
        """Finite moduli in both bodies."""
        return tuple(modulus for each in self._bodies for modulus in each.moduli)

    @property
    def thicknesses(self) -> tuple[float, ...]:
        """Thicknesses of the layers of the body, from the surface down."""
        return self._bodies[0].thicknesses

    @property
    def rigid_below(self) -> float:
        """Thickness between two rigid bases; inf where one of the bodies has none."""
        return sum(each.rigid_below for each in self._bodies)

    @property
    def contact_modulus(self) -> float | None:
        """E* of the pair, 1/E* = 1/E*_1 + 1/E*_2; None where a body has none."""
        found = [each.contact_modulus for each in self._bodies]
        if None in found:
            return None
        return 1 / sum(1 / modulus for modulus in found if modulus)

    @property
    def merges(self) -> bool:
        """Whether a body merges its relaxing modes."""
        return any(each.merges for each in self._bodies)

    def problems_isolated(self) -> Iterator[Problem]:
        """Refuse an isolated, axisymmetric indenter."""
        message = "not available with grid.geometry: axisymmetric; remove it or change the geometry"
        yield Problem(("counterbody",), message)


def relaxes(solid: Solid) -> bool:
    """Whether a body has a material that relaxes; one without laws may."""
    return not solid.laws or any(not (isinstance(law, Material) and law.elastic) for law in solid.laws)


def problems_of_the_counterbody(config: Any) -> Iterator[Problem]:
    """Refuse a velocity ratio at rest, and the shape of a counterbody that moves with its material."""
    if config.counterbody is None or not config.counterbody.velocity_ratio:
        return
    at, ratio = ("counterbody", "velocity_ratio"), config.counterbody.velocity_ratio
    if not config.trajectory.moves:
        message = "only for a punch that moves; remove it or set trajectory.velocity"
        yield Problem(at, message, ("trajectory.velocity", "trajectory.velocity_file"))
    if config.punch.rough:
        message = f"got {ratio!r} with a rough punch, whose heights would pass the contact; must be 0"
        yield Problem(at, message, ("punch.shape",))
