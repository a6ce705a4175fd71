"""Changes of an attracted surface over a step: instabilities, and the change of the drive meanwhile.

Where an interface attracts, the surface may jump into contact or out of it while the punch hardly moves. The
solver finds the energy of a jump (`Solution.released_energy`). Separation may also be fast without a jump: a
gap g changes over one step by a large part of the range of the interface, or of itself where it is wider,

    separation = max |change of g| / max(range, g)

over the points. Shorter steps resolve both (`adaptive_steps`): a fast separation then takes several, and a
jump stays in one step, over which the drive changes little,

    drive = (change of depth, load or strength of the interface) / (range, largest load, largest strength).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.problem import Problem, Solution
from gfmdlayer.grid.sums import Sums
from gfmdlayer.interface.law import Interaction
from gfmdlayer.kernels import LANES, kernel
from gfmdlayer.resumable import State


@dataclass(frozen=True)
class Change:
    """Change over a step under an interface that attracts; the ratios are those of the module's docstring."""

    jumps: bool  # whether an instability released energy
    separation: float
    drive: float


class Changes:
    """Compares each step with the last accepted one, if the interface attracts at any time."""

    def __init__(self, interface: Interaction, sums: Sums) -> None:
        self._interface, self._sums = interface, sums
        self._gap: FloatArray | None = None
        self._drive = 0.0, 0.0  # prescribed depth or load, and strength of the interface
        self._largest = 0.0, 0.0

    def over(
        self, prescribed: float, problem: Problem, solution: Solution, *, lost: bool = False
    ) -> Change | None:
        """Return the change since the last accepted step, if any; `lost`: the punch is pulled off."""
        if self._gap is None:
            return None
        drive, reach = (prescribed, problem.interface.strength), self._interface.range
        scale = self._scales(drive, reach, load=problem.mean_pressure is not None)
        parts = zip(drive, self._drive, scale, strict=True)
        moved = max(abs(now - before) / most if most else 0.0 for now, before, most in parts)
        separation = self._sums.maximum(_separation(self._gap, solution.gap, reach))
        return Change(lost or solution.released_energy > 0, separation, moved)

    def remember(self, prescribed: float, problem: Problem, solution: Solution) -> None:
        """Remember an accepted step, see `over`."""
        if self._interface.attracts:
            now, (load, strength) = problem.interface.strength, self._largest
            self._drive, self._gap = (prescribed, now), solution.gap
            self._largest = max(load, abs(prescribed)), max(strength, now)

    def _scales(self, drive: tuple[float, float], reach: float, *, load: bool) -> tuple[float, float]:
        largest = max(self._largest[0], abs(drive[0])) if load else reach
        return largest, max(self._largest[1], drive[1])

    def state(self) -> State:
        """Return the last accepted step."""
        return {} if self._gap is None else {"gap": self._gap, "drive": self._drive, "largest": self._largest}

    def restore(self, state: State) -> None:
        """Continue after that step."""
        if "gap" in state:
            self._gap = state["gap"]
            (*drive,), (*largest,) = state["drive"].tolist(), state["largest"].tolist()
            self._drive, self._largest = (drive[0], drive[1]), (largest[0], largest[1])


@kernel(reorder=True)
def _separation(before: FloatArray, after: FloatArray, reach: float) -> float:
    """Largest change of a gap, over the larger of the reach and the lesser of the gaps before and after."""
    most = np.zeros(LANES)
    for first in range(0, before.size, LANES):
        old, new = before[first : first + LANES], after[first : first + LANES]
        for i in range(old.size):
            change, gap = abs(new[i] - old[i]), min(old[i], new[i])
            change /= gap if gap > reach else reach
            most[i] = change if change > most[i] else most[i]
    return most.max()  # type: ignore[no-any-return]
