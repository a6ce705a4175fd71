"""Columns of the largest stresses below the surface, and at the interfaces of the layers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gfmdlayer.body.layers import interfaces
from gfmdlayer.body.pair import downwards, stacks
from gfmdlayer.body.solid import DEPTH_PAIRS
from gfmdlayer.observables.observable import Column, Observed, Places, Value, declared
from gfmdlayer.observables.transport import Every

if TYPE_CHECKING:
    from gfmdlayer.config import Config
    from gfmdlayer.step import Step

LARGEST = declared(r"""
    largest_von_mises | largest von Mises stress | pressure | over the depths of output.inside |
      \max\,\sigma_\mathrm{Mises}
    largest_von_mises_x | place of the largest von Mises stress: x | length | over the depths of output.inside
    largest_von_mises_y | place of the largest von Mises stress: y | length | over the depths of output.inside
    largest_von_mises_z | place of the largest von Mises stress: z | length | over the depths of output.inside
    largest_shear_stress | largest shear stress on any plane | pressure | over the depths of output.inside |
      \max\,\tau_\mathrm{max}
    interface_peel | largest tension | pressure | over each interface, the bond to a rigid base included
    interface_shear | largest shear stress | pressure | over each interface, the bond to a rigid base included
    """)
VON_MISES, *PLACE, SHEAR, PEEL, PLANE_SHEAR = LARGEST


class InsideColumns(Every):
    """Largest von Mises and shear stress, and largest peel and shear stress at each interface.

    They are the largest at the points of the grid, at the depths of the configuration. Peel is tension across
    the interface; where it is negative, the interface is everywhere in compression.
    """

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns where they are asked for."""
        asked = config.output.inside
        if asked is None or asked.every is None:
            return None
        place = [column for column in PLACE if column.name[-1] != "y" or len(config.grid.points) == 2]
        columns = (VON_MISES, *place, SHEAR)
        if not (found := downwards(*map(interfaces, stacks(config.solid)))):
            return columns
        numbers = tuple(float(place.layer) for place in found)  # the same in cases of other thicknesses
        meaning = "number of the interface, from the surface; of a counterbody -1, -2, ..."
        along = Places("interface", meaning, "1", numbers)
        return *columns, replace(PEEL, along=along), replace(PLANE_SHEAR, along=along)

    @classmethod
    def cost(cls, config: Config) -> tuple[float, float]:
        """Return the work of a row in FFT pairs; its memory is that of a snapshot (`footprint`)."""
        asked = config.output.inside
        assert asked is not None
        assert asked.every is not None
        count = len(asked.places(config.solid, config.grid.period))
        count += len(downwards(*map(interfaces, stacks(config.solid))))
        return DEPTH_PAIRS * count / asked.every, 0.0

    def __init__(self, case: Observed) -> None:
        config = case.config
        asked = config.output.inside
        assert asked is not None
        assert asked.every is not None
        super().__init__(case, asked.every)
        self._interior = case.interior
        self._interfaces = downwards(*map(interfaces, stacks(config.solid)))

    def measure(self, step: Step) -> Mapping[str, Value]:
        """Return the largest stresses."""
        import numpy as np

        if not self._due(step.time):
            nothing = np.full(len(self._interfaces), math.nan)
            return {name: nothing if name.startswith("interface") else math.nan for name in self._names}
        from gfmdlayer.history.inside import STRESSES, largest_shear, shear_on_plane, von_mises

        interior, springs, ranks = self._interior, step.fields["springs"], self._grid.ranks
        largest, at, shear = -1.0, (0.0,) * (len(self._grid.points) + 1), 0.0
        for place in interior.places:
            stress = interior.at(springs, place, STRESSES)
            equivalent = von_mises(stress)
            shear = max(shear, float(largest_shear(stress, equivalent).max()))
            number = int(np.argmax(equivalent))
            if (found := float(equivalent.flat[number])) > largest:
                index = np.unravel_index(number, equivalent.shape)
                along = zip(self._grid.coordinates, index, strict=True)
                largest, at = found, (*(float(x[i]) for x, i in along), place.depth)
        # Of equal values the place at the least depth counts, and there the first one: all of one rank.
        largest, at = max(ranks.all_of((largest, at)), key=lambda each: (each[0], -abs(each[1][-1])))
        row: dict[str, Any] = {VON_MISES.name: largest, SHEAR.name: ranks.maximum(shear)}
        for axis, x in zip("xyz" if len(at) == 3 else "xz", at, strict=True):
            row[f"largest_von_mises_{axis}"] = x if largest > 0 else math.nan
        if self._interfaces:
            fields = [interior.at(springs, place, ("zz", "xz", "yz")) for place in self._interfaces]
            row["interface_peel"] = ranks.maximum(np.array([each["zz"].max() for each in fields]))
            row["interface_shear"] = ranks.maximum(np.array([shear_on_plane(each).max() for each in fields]))
        return {name: row[name] for name in self._names}
