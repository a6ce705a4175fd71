"""Friction: the tangential force on a punch that moves or slips, by parts, and the slip at the interface.

Without friction at the interface the pressure p is normal to the surface, and where p is not even about a
slope of the surface it pulls along x by p du/dx. The mean of p du/dx over the surface is the tangential
stress against the motion; times the velocity it is the power that the body turns into heat. A punch that
rolls without friction meets the same resistance as one that slides: the normal contact is the same. Of two
deformable bodies each counts with the velocity of the contact along it: u = u_1 + u_2 v_2/v_1.

With friction at the interface the mean of the shear traction t of the punch on the body adds to the
tangential force. Under a moving punch t moves with the surface, which stretches by dv/dx, v the displacement
along it: the body takes the mean of p du/dx less that of t dv/dx, and the rest is heat of slip. So

    tangential force    mean of t, and loss of the body: what friction and hysteresis would be alone, added
    drag force          mean of t + p du/dx: on the punch; of one that slides, its work per distance

Their difference, t dv/dx, is slip by the stretch of the surface. The heat of a step of slip s is -t.s, with
the mean of t at the beginning and at the end of the step, and with that at the end alone where t turns in it.

With P and U the transforms of p and u, the mean is sum_q w q Im(P conj(U)), w the weights of Parseval's sum.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from gfmdlayer.observables.observable import Column, Observable, Observed, declared, rounded_down

if TYPE_CHECKING:
    from gfmdlayer.arrays import ComplexArray, FloatArray
    from gfmdlayer.config import Config
    from gfmdlayer.step import Step


# Change of the traction over itself, in steps with slip, beyond which the heat of slip is rough: its measured
# error is a quarter of that at most, and less where errors of successive steps cancel, as in steady sliding.
_CHANGES = 0.7


def direction(config: Config) -> FloatArray:
    """Return the unit vector of the tangential drive; that of the motion is along x."""
    import numpy as np

    drive = config.trajectory.tangential
    angle = math.radians(0.0 if drive is None else drive.direction)
    return np.array([math.cos(angle), math.sin(angle)])[: len(config.grid.points)]


def _carries(mean: float, step: Step) -> bool:
    """Whether a contact carries a mean pressure, or a pull beside an attraction."""
    return mean > 0 or (mean < 0 and step.interface.attracts and step.contact_area > 0)


def _over_normal(force: float, mean: float, step: Step) -> float:
    """Return a tangential force over the normal one."""
    return force / mean if _carries(mean, step) else math.nan


class FrictionColumns(Observable):
    """Position, mean tangential stress, its ratio to the mean pressure, and the centre of pressure.

    Position and centre are those of a punch that moves at a velocity. The fields are on coordinates that move
    with the punch. The centre is found on the circle of one period. Friction and centre are NaN without
    contact. Where an attraction pulls more than the punch presses, friction is negative: the tangential
    force over a normal force that pulls; it has a pole where this changes its sign.
    """

    COLUMNS = declared(r"""
        position | position of the punch along x | length | from its place at t = 0
        tangential_force | mean tangential stress against the motion | pressure | mean over the whole cell of
          the shear traction, and loss of the body per distance and area | \bar{t}
        friction | tangential force / normal force | 1 | of the whole cell, negative where this pulls | \mu
        contact_centre | centre of pressure along x, from the middle of the punch | length |
          from the middle of the punch
        """)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns where the punch moves along the surface, or the surfaces have friction."""
        position, force, friction, centre = cls.COLUMNS
        if config.trajectory.moves:
            return position, force, friction, centre
        return (force, friction) if config.friction else None

    def __init__(self, case: Observed) -> None:
        import numpy as np

        from gfmdlayer.time_functions import distance

        grid = case.grid
        self._sums = grid.sums
        if (velocity := case.drives.velocity) is None:
            self._position = None
            return
        self._position = partial(distance, velocity)
        self._transforms, self._period = case.transforms, grid.period[0]
        one, other = grid.wavenumbers_x
        # The grid does not distinguish the shortest wave from its opposite; their mean has no slope there.
        self._slope = np.ravel(grid.parseval_weights * (one + other) / 2)
        x = np.meshgrid(*grid.coordinates, indexing="ij", sparse=True)[0]
        phase = np.exp(2j * np.pi / self._period * x)
        self._phase = np.ravel(np.broadcast_to(phase, grid.shape))

    @property
    def waves(self) -> tuple[FloatArray, ComplexArray]:
        """Wavenumbers times Parseval's weights, and the place of each point on a circle."""
        return self._slope, self._phase

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return position, tangential stress, friction and centre of pressure."""
        pressure = step.fields["pressure"]
        mean, shear = self._sums.mean(pressure), step.shear_force - step.stretch
        if self._position is None:
            return {"tangential_force": shear, "friction": _over_normal(shear, mean, step)}
        p = self._transforms.forward(pressure)
        u = step.fields["carried"]
        force = self._sums.total(float((self._slope * (p.imag * u.real - p.real * u.imag)).sum())) + shear
        turned = self._sums.total((self._phase * pressure).sum(keepdims=True))[0]
        angle = cmath.phase(-turned if mean < 0 else turned)
        return {
            "position": self._position(step.time),
            "tangential_force": force,
            "friction": _over_normal(force, mean, step),
            "contact_centre": angle * self._period / (2 * math.pi) if _carries(mean, step) else math.nan,
        }


class Slip(Observable):
    """Friction by parts, stick, heat of slip, and the displacement of the punch along the surface.

    Attributes: `first_slip`, `full_slip` and `restick`, the times at which slip first begins in the contact,
    at which no point sticks any more, and at which one sticks again; NaN where that does not happen.
    """

    COLUMNS = declared(r"""
        interface_friction | shear traction / pressure, of their means | 1 | of the whole cell |
          \mu_\mathrm{interface}
        hysteresis_friction | tangential force by the loss of the body / normal force | 1 |
          loss of the body per distance and area, over mean pressure | \mu_\mathrm{hysteresis}
        stick_area | part of the surface that sticks to the punch | 1 | over the cell |
          \tilde{a}_\mathrm{stick}
        slip_heat | heat of slip per area | pressure length | from the beginning of the run |
          w_\mathrm{slip}
        tangential_displacement | displacement of the punch along the surface, of its rolling the sliding
          part | length | from the beginning of the run | D
        creepage | sliding speed of the punch over its velocity | 1 | over the step | \xi
        lateral_creepage | sliding speed of the punch along y over its velocity | 1 | over the step | \xi_y
        spin_moment | moment of the shear traction on the body, to the left | pressure length |
          mean over the whole cell, about the middle of the punch | \bar{m}
        drag_force | mean tangential stress on the moving punch | pressure | mean over the whole cell of the
          shear traction and of pressure times slope of the surface; work per distance where it slides |
          \bar{t}_\mathrm{drag}
        transverse_force | mean shear traction across the tangential drive | pressure |
          mean over the whole cell, to the left of the drive | \bar{t}_\perp
        """)
    NUMBERS = declared("""
        first_slip | time at which slip begins | time | the first row in which it is so
        full_slip | time at which no point sticks any more | time | the first row in which it is so
        restick | time at which a point sticks again after full slip | time |
          the first row in which it is so
        """)
    KEPT = "heat", "change", "times"

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case with friction at the interface."""
        if not config.friction:
            return None
        left_out = set() if config.trajectory.moves else {"hysteresis_friction", "creepage", "drag_force"}
        left_out |= {"transverse_force"} if len(config.grid.points) == 1 else set()
        if len(config.grid.points) == 1 or not config.trajectory.rolls:
            left_out |= {"lateral_creepage", "spin_moment"}
        return tuple(column for column in cls.COLUMNS if column.name not in left_out)

    def __init__(self, case: Observed) -> None:
        self._names = [column.name for column in self.columns(case.config) or ()]
        self._direction, self._time = direction(case.config), case.config.time
        alone = case.config.grid.ends_along_x and case.config.trajectory.moves
        self._by_spacings = alone or self._time.at_once
        self._ranks = case.grid.ranks
        self._heat = self._change = 0.0
        self._times = [math.nan] * len(self.NUMBERS)

    @property
    def attributes(self) -> Mapping[str, float]:  # type: ignore[override]
        """Times of the events."""
        return {column.name: time for column, time in zip(self.NUMBERS, self._times, strict=True)}

    @property
    def warning(self) -> str:  # type: ignore[override]
        """Say that tractions change too much in a step for the heat of slip."""
        step = 0.0 if isinstance(self._time.step, str) else self._time.step
        if not (step or self._by_spacings) or self._change <= _CHANGES * self._heat:
            return ""
        part = self._change / self._heat if self._heat else math.inf
        if self._by_spacings:
            remedy = "more grid.points: a step moves by whole spacings"
        else:
            remedy = f"time.step {rounded_down(0.5 * step * (_CHANGES / part if self._heat else 1.0))}"
        changes = f"changes by {part:.2g} of itself, more than {_CHANGES:g}" if self._heat else "turns"
        return f"SLIP HEAT is rough: in steps with slip the traction {changes}; use {remedy}"

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the columns of the case."""
        import numpy as np

        n, mean, force = self._direction, step.mean_pressure, step.shear_force
        touching, stick = step.fields["touching"], step.fields["stick"]
        self._heat += step.slip_heat
        self._change += step.slip_heat_change
        counts = np.array([stick.sum(), (touching & ~stick).sum(), touching.sum(), stick.size])
        *points, size = self._ranks.total(counts).tolist()
        sticks, slips, touches = (count > 0 for count in points)
        sticks_again = sticks and not math.isnan(self._times[1])
        for i, is_now in enumerate((slips, touches and not sticks, sticks_again)):
            if is_now and math.isnan(self._times[i]):
                self._times[i] = step.time
        means = step.mean_shear
        total = float(step.row["tangential_force"])
        values = {
            "interface_friction": _over_normal(force, mean, step),
            "hysteresis_friction": _over_normal(total - force, mean, step),
            "stick_area": points[0] / size,
            "slip_heat": self._heat,
            "tangential_displacement": float(n @ step.moved),
            "creepage": step.path[0] / step.way if step.way else math.nan,
            "lateral_creepage": step.path[-1] / step.way if step.way else math.nan,
            "spin_moment": step.spin_moment,
            "drag_force": total + step.stretch,
            "transverse_force": float(n[0] * means[-1] - n[-1] * means[0]),
        }
        return {name: values[name] for name in self._names}
