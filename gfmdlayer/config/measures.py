"""What texts mean in a configuration: numbers with units, and the words start, peak and end for times.

Both depend on other keys, which are validated by themselves when the first text asks for them: numbers alone
cost nothing.
"""

from __future__ import annotations

import re
from functools import cached_property

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from gfmdlayer.config.geometries import GEOMETRIES
from gfmdlayer.config.sections import GridKeys, Time
from gfmdlayer.config.trajectory import Trajectory, ending_with
from gfmdlayer.files.units import Unit
from gfmdlayer.validation.units import OwnUnits


def in_words(dimension: str, control: str, *, is_line: bool) -> str:
    """Return a dimension without the word drive, which is what the trajectory prescribes.

    `control` is its name: a depth, gap, load or force. The force on a line is per length.
    """
    drive = {"depth": "length", "gap": "length", "load": "pressure"}.get(control, "force")
    words = dimension.replace("drive", drive)
    return re.sub(r"^force(?=$|/time)", "force / length", words) if is_line else words


class ConfigMeasures(OwnUnits):
    """The meaning of texts in the plain data of a configuration, or of a case with some valid sections."""

    def unit(self, dimension: str) -> tuple[Unit, str, str] | None:
        """Return the unit, the label and the words of a dimension."""
        if "force" not in dimension and "drive" not in dimension:
            return super().unit(dimension)
        given = self._data.get("trajectory") or {}
        control = given.control if isinstance(given, Trajectory) else given.get("control", "depth")
        return super().unit(in_words(dimension, str(control), is_line=self._is_line))

    def moment(self, word: str) -> float:
        """Return the time of the start, of the (first) peak of the trajectory, or of the end of the run."""
        if word == "start":
            return 0.0
        if self._run is None:
            message = "which follows from trajectory and time, and these are refused"
        else:
            trajectory, time = self._run
            found = time.end if word == "end" else trajectory.peak_time
            if found is not None:
                return found
            # A stored configuration would need the file of the table whenever its results are opened.
            message = (
                "which is in the table of trajectory.file, and results stay when this moves; give the time"
            )
        raise PydanticCustomError("moment", f"got {word!r}, {message}")

    @cached_property
    def _is_line(self) -> bool:
        try:
            grid = GridKeys.model_validate(self._data.get("grid", {}))
        except ValidationError:
            return True
        return len(grid.points) == 1 and GEOMETRIES[grid.geometry or "periodic"].on_grid

    @cached_property
    def _run(self) -> tuple[Trajectory, Time] | None:
        """The trajectory, and the time axis that may end with it."""
        try:
            trajectory = Trajectory.model_validate(self._data.get("trajectory", {}))
            return trajectory, ending_with(trajectory, Time.model_validate(self._data.get("time", {})))
        except ValidationError:
            return None
