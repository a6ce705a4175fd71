"""The temperature of the body, and whether the laws of its materials have a shift for it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import ConfigDict

from gfmdlayer.body.materials import Law, Material
from gfmdlayer.body.shifts import Celsius, Shift
from gfmdlayer.validation.fields import File, given
from gfmdlayer.validation.problems import Location, Problem, dotted
from gfmdlayer.validation.sections import Section, sections_in

_MOTION = ("trajectory.velocity", "trajectory.velocity_file")


class Temperature(Section):
    """Temperature of the whole body, which shifts the relaxation times of materials with a `shift`."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    value: Annotated[Celsius | None, given] = None
    """temperature at all times: degrees Celsius"""
    file: Annotated[File | None, given] = None
    """two columns, time and temperature in degrees Celsius; in place of value"""

    def problems(self) -> Iterator[Problem]:
        """Refuse both and neither."""
        if self.value is None and self.file is None:
            yield Problem((), "has neither value nor file; must be {value: ...} or {file: ...}")
        if self.value is not None and self.file is not None:
            yield Problem(("file",), "given beside value; remove one of the two", ("value",))


def shifts(config: Section) -> dict[Location, Shift | None]:
    """Return the shifts of all materials of a configuration that relax, by the location of the material."""
    laws = ((at, law) for at, law in sections_in(config) if isinstance(law, Law))
    return {at: law.shift for at, law in laws if not (isinstance(law, Material) and law.elastic)}


def temperature_problems(
    config: Section, temperature: Temperature | None, *, moves: bool, layered: bool
) -> Iterator[Problem]:
    """Yield why a temperature and the shifts of materials do not go together."""
    if temperature is None:
        for at, law in sections_in(config):
            if isinstance(law, Law) and law.shift is not None:
                message = "only with a temperature; remove it or set temperature"
                yield Problem((*at, "shift"), message, ("temperature",))
        return
    found = shifts(config)
    others = tuple(dotted(at) for at in found)
    if not any(found.values()):
        message = "no material that relaxes has a shift; remove it or give a shift"
        yield Problem(("temperature",), message, others)
    elif not all(found.values()):
        at = next(at for at, shift in found.items() if shift is None)
        message = "missing; all materials that relax must have a shift, or none"
        yield Problem((*at, "shift"), message, others)
    elif (moves or not layered) and len(set(found.values())) > 1:
        at = next(at for at, shift in found.items() if shift != next(iter(found.values())))
        where = "where the punch moves" if layered else "in a body that is not made of layers"
        message = f"differs from the shifts of other materials; must be the same {where}"
        yield Problem((*at, "shift"), message, (*others, *(_MOTION if layered else ("body",))))
    if temperature.value is not None:
        for at, shift in found.items():
            if shift is not None and (refused := shift.refused(temperature.value)):
                yield Problem(("temperature", "value"), refused, (f"{dotted(at)}.shift",))
    if temperature.file is not None and moves:
        message = "given with a moving punch; must be a constant temperature.value"
        yield Problem(("temperature", "file"), message, _MOTION)
