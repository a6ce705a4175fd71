"""Energy balance: work = stored + dissipated + interface + plastic + slip + lost, per area of the surface.

The work is the integral of the mean pressure over the depth and, for a punch that moves along the surface, of
the mean tangential stress over the position; with friction at the interface also of the mean shear traction
over the displacement of the punch along the surface, and with a spin of its moment over the angle; the heat
of slip is subtracted. It does not use the
modes, from which stored and dissipated energy follow. The energy of the interface is the mean of its law over
the gap, zero for the hard wall. So the residual of the balance is an error of the time integration: of second
order in dt with the exponential scheme and of first order with backward Euler. A residual above the limit is
a warning: three times the tolerance of adaptive steps, a hundredth with fixed ones.

The work of a step follows from pressure and displacement of each point and the energy of the interface,
exactly for an elastic body (`history.path_work`): the residual is an error of the relaxation. Adaptive steps
see it, and are chosen so that the balance closes (`history.adaptive_steps`). For the tangential stress the
curve is a parabola through three rows.

An instability leads from an equilibrium that ends to another one at the same position of the punch. The
difference of their energies, elastic and of the interface, goes into waves and heat: it is lost. A step over
an instability has work before the jump and behind it (`observables.adhesion`); the loss is this work less the
gain of the energies. Its error is the error of the work, of higher than first order in the step. If the end
of the branch is not known, the loss is the solver's, with the work of the trapezoidal rule, and the work
follows from the balance; the error is at most `adhesion.across`, of first order in the step. In both cases
the balance of the step closes by construction: the residual checks only the steps between the jumps.

A voltage that changes does work too. The energy of the interface includes the field and its source,
w(g, t) = -C(g) V(t)^2/2 per area (`interface.adhesion`), and at a fixed gap it changes by -C V dV: a
rising voltage takes energy out of this balance, into the source. Over a step this is the mean of the change
of w at the gap before and at the gap after it, where a step leads over an instability; elsewhere the work on
the surface and the change of w have it exactly.

A load that has pulled the punch off does work on a free punch. This work is not computed: the change of the
energies counts as work, there and where the punch comes back.

A punch that is pressed in at once, in the first step, has done the work that is stored after it: without
friction at the interface the energy of an elastic contact does not depend on the path to it.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING

from gfmdlayer.observables.adhesion import PathPoint, Point, across, work_over_fold
from gfmdlayer.observables.observable import Column, Observable, Observed, declared, rounded_down
from gfmdlayer.resumable import State

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.config import Config
    from gfmdlayer.step import Step


UNBALANCED = "UNBALANCED"  # with this word the warning begins
# Largest residual over the work: in tolerances of adaptive steps, beside what the solver leaves open in its
# own; or with fixed steps.
TOLERANCES, _OF_SOLVER, _CLOSED = 3, 10, 0.01
_SURE = 0.5  # part of the step or tolerance that would just do
_OF_A_SWING = 40  # steps, of which errors fall with the step: fewer draw another motion


class EnergyBalance(Observable):
    """Work, stored and dissipated energy, and the residual of their balance."""

    COLUMNS = declared("""
        work | work done by the punch, and by a changing voltage, per area | pressure length |
          from the beginning of the run
        stored | elastic energy stored per area | pressure length | from the body at rest
        dissipated | energy dissipated per area | pressure length | from the beginning of the run
        energy_residual | work - stored - dissipated - energy of the interface - plastic work - heat of slip
          - lost in instabilities, per area | pressure length | from the beginning of the run
        """)
    FURTHER = declared("""
        lost | energy lost in instabilities per area | pressure length | from the beginning of the run
        """)
    KEPT = "work", "lost", "energies", "attraction", "strength", "torn", "largest", "open"

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the balance, with the loss where the interface attracts."""
        return (*cls.FURTHER, *cls.COLUMNS) if config.interfaces else cls.COLUMNS

    def __init__(self, case: Observed) -> None:
        self._work, self._lost, self._sums = 0.0, 0.0, case.grid.sums
        self._interface, self._has_losses = case.drives.interface, bool(case.config.interfaces)
        self._by_depth = case.config.trajectory.places
        self._torn = False  # whether a load has pulled the punch off
        self._energies = self._attraction = self._strength = 0.0  # of the last row
        self._largest = self._open = 0.0  # work or energy; residual
        self._time, self._solver_tolerance = case.config.time, case.config.solver.tolerance
        self._grid_limits = case.config.trajectory.moves and case.config.refines
        self._longest = max(stop.step for stop in case.drives.landings)  # step, of fixed ones
        swing = case.config.trajectory.tangential
        self._turns = math.inf if swing is None or swing.period is None else swing.period / _OF_A_SWING
        *_, self._spin = case.config.creepages
        self._field: tuple[float, FloatArray] | None = None  # time and gap, where the interface changes
        self._rows: deque[PathPoint] = deque(maxlen=2)  # of the way up to here
        # Positions and tangential stresses; displacements of the punch and shear tractions, along each axis.
        self._tangential: deque[tuple[Point, ...]] = deque(maxlen=2)

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the balance; position and tangential force are read from the row, if it has them."""
        stored, dissipated, attraction = step.energy.stored, step.energy.dissipated, self._of_interface(step)
        # Other parts of the energy of the contact.
        others = attraction + float(step.row.get("plastic_work", 0.0)) + float(step.row.get("slip_heat", 0.0))
        energies = stored + dissipated + others
        swept = step.swept[-1] if step.swept else 0.0
        now = PathPoint(step.time, step.depth, step.mean_pressure, step.prescribed, swept, step.margin)
        tangential = _tangential(step, self._spin)
        # Pressed in, pulled off or back: the path is not known.
        if step.detached != self._torn or not self._rows:
            self._work += energies - self._energies
            self._rows.clear()
        else:
            gained = energies - self._energies, attraction - self._attraction
            self._work += self._work_of_step(step, now, tangential, *gained)
        residual = self._work - stored - dissipated - others - self._lost
        self._largest = max(self._largest, abs(self._work), stored + dissipated)
        self._open = max(self._open, abs(residual))
        self._torn, self._energies, self._attraction = step.detached, energies, attraction
        self._strength = step.interface.strength
        self._rows.append(now)
        self._tangential.append(tangential)
        if self._interface.breakpoints:  # it depends on time
            self._field = step.time, step.fields["distance"]
        return ({"lost": self._lost} if self._has_losses else {}) | {
            "work": self._work,
            "stored": stored,
            "dissipated": dissipated,
            "energy_residual": residual,
        }

    def _work_of_step(
        self, step: Step, now: PathPoint, tangential: tuple[Point, ...], gained: float, attraction: float
    ) -> float:
        """Work over a step in which the energies grow by `gained`, plus the loss."""
        # `attraction` is the growth of the energy of the interface.
        released, over = step.released_energy if self._has_losses else 0.0, None
        along = sum(_area(*curve) for curve in zip(*self._tangential, tangential, strict=True))
        if released == 0:
            return self._on_the_surface(step, now, attraction) + along
        over = work_over_fold(*self._rows, now, depth_given=self._by_depth)
        last = self._rows[-1].point, now.point
        normal, part = over or (_area(*last), 0.5)
        work = normal + along
        if self._field is not None:
            work += self._work_of_the_field(*self._field, step, part)
        self._rows.clear()  # no parabola through a jump
        lost = released if over is None else work - gained
        lost = lost if 0 < lost < released + across(*last) else released
        self._lost += lost
        return gained + lost

    def _on_the_surface(self, step: Step, now: PathPoint, attraction: float) -> float:
        """Work of a step: of the pressure on the surface, of yielding, and of the interface."""
        import numpy as np

        from gfmdlayer.history.path_work import work_of_step

        rows, known = np.array([self._rows[0], self._rows[-1]]), min(len(self._rows), len(step.swept))
        since_first = step.swept[0] if step.swept else 0.0
        if now.prescribed == self._rows[-1].prescribed:
            if step.interface.strength == self._strength:  # the drive rests, and all the work is in the rows
                return float(work_of_step(rows, known, np.array(now), since_first))
            now = now._replace(prescribed=math.nan)  # a voltage changes: the drive does not rest
        return float(work_of_step(rows, known, np.array(now), since_first)) + step.plastic_work + attraction

    @property
    def warning(self) -> str:  # type: ignore[override]
        """Say that the balance is open, and the steps that would close it."""
        part = self._open / self._largest if self._largest else 0.0
        if self._time.tolerance is not None:
            said = unbalanced(part, self._time.tolerance, _OF_SOLVER * self._solver_tolerance)
        else:
            assert not isinstance(self._time.step, str)
            euler = self._time.integrator == "backward_euler"
            step = min(self._time.step, self._longest)
            said = unbalanced(part, step=step, euler=euler, turns=self._turns)
        # The shortest wave of the grid relaxes under a punch that moves, but has no slope along x.
        return f"{said}, or more grid.points, or both" if said and self._grid_limits else said

    def _of_interface(self, step: Step) -> float:
        """Energy of the interface per area."""
        interface = step.interface
        if interface.attracts and "interface_energy" not in step.row:  # given in place of the configuration's
            return self._sums.mean(interface.energy(step.fields["distance"]))
        return float(step.row.get("interface_energy", 0.0))

    def _work_of_the_field(self, time: float, before: FloatArray, step: Step, part: float) -> float:
        """Change of the energy of the interface since `time` by its explicit time dependence.

        It is a mean over the gap before, with the weight `part`, and the gap after.
        """
        law, last = step.interface, self._interface.at(time)
        gaps = (part, before), (1 - part, step.fields["distance"])
        return sum(share * self._sums.mean(law.energy(gap) - last.energy(gap)) for share, gap in gaps)

    def state(self) -> State:
        """Return work and loss, and the last points of both curves."""
        curves = {"normal": list(self._rows), "tangential": list(self._tangential)}
        field = {} if self._field is None else {"field_time": self._field[0], "field_gap": self._field[1]}
        return {**super().state(), **curves, **field}

    def restore(self, state: State) -> None:
        """Continue from the work and the points of another run."""
        super().restore(state)
        self._rows.clear()
        self._tangential.clear()
        self._rows.extend(PathPoint(*values) for values in state["normal"].tolist())
        self._tangential.extend(tuple(map(tuple, points)) for points in state["tangential"].tolist())
        if "field_time" in state:
            self._field = float(state["field_time"]), state["field_gap"]


def unbalanced(
    part: float,
    tolerance: float = 0.0,
    of_solver: float = 0.0,
    *,
    step: float = 0.0,
    euler: bool = False,
    turns: float = math.inf,
    section: str = "time.",
) -> str:
    """Say that energies miss a part of the work, and the tolerance or the equal step that would close it."""
    # `turns` is the longest step that draws an oscillation.
    limit = _CLOSED if step else TOLERANCES * (tolerance + of_solver)
    if part <= limit:
        return ""
    # Of second order only if steps are short beside the ramps; errors scatter, but for backward Euler's.
    shorter = rounded_down(min(_SURE * (step or tolerance) * limit / part, turns))
    if euler:  # the end and the snapshots are a whole number of steps
        tens = itertools.product((1.0, 2.0, 4.0, 5.0, 8.0), (10.0**k for k in range(12)))
        least = max(part / limit / _SURE, step / turns)
        shorter = f"{step / min(parts for each in tens if (parts := math.prod(each)) >= least):.15g}"
    remedy = f"{section}{'step' if step else 'tolerance'} {shorter}"
    return f"{UNBALANCED}: the energies miss {part:.2g} of the work, more than {limit:.2g}; use {remedy}"


_NAMES = "body", "counterbody"


class Bodies(Observable):
    """Stored and dissipated energy of each of two deformable bodies, and the friction by the loss of each.

    The balance has the sums of the energies. In a steady state the parts of the friction add up to that of
    the motion, without the heat of slip; before, a part may be that of a body which still takes up energy.
    """

    COLUMNS = declared("""
        stored_body | elastic energy stored in the body, per area | pressure length | from the body at rest
        stored_counterbody | elastic energy stored in the counterbody, per area | pressure length |
          from the body at rest
        dissipated_body | energy dissipated in the body, per area | pressure length |
          from the beginning of the run
        dissipated_counterbody | energy dissipated in the counterbody, per area | pressure length |
          from the beginning of the run
        """)
    FURTHER = declared(r"""
        friction_body | friction by the loss of the body: its heat per distance / normal force | 1 |
          over the last step | \mu_\mathrm{body}
        friction_counterbody | friction by the loss of the counterbody: its heat per distance / normal force |
          1 | over the last step; the distance is that along the body | \mu_\mathrm{counterbody}
        """)
    KEPT = "position", "dissipated"

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns of a case with a deformable counterbody, with the losses where it moves."""
        if not config.two_bodies:
            return None
        marches = config.trajectory.moves and not config.time.at_once
        return cls.COLUMNS + cls.FURTHER if marches else cls.COLUMNS

    def __init__(self, case: Observed) -> None:
        self._moves = self.columns(case.config) != self.COLUMNS
        self._position, self._dissipated = math.nan, [0.0, 0.0]  # of the last row

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the energies, and the losses over the way since the last row."""
        own = [*zip(_NAMES, step.bodies, strict=True)]
        row = {f"stored_{name}": body.stored for name, body in own}
        row |= {f"dissipated_{name}": body.dissipated for name, body in own}
        if not self._moves:
            return row
        position, mean = float(step.row["position"]), step.mean_pressure
        way = position - self._position
        for i, (name, body) in enumerate(own):
            lost = body.dissipated - self._dissipated[i]
            row[f"friction_{name}"] = lost / (way * mean) if way and mean else math.nan
        self._position, self._dissipated = position, [body.dissipated for _, body in own]
        return row


def _tangential(step: Step, spin: float) -> tuple[Point, ...]:
    """Return each displacement along the surface with the mean tangential stress that does work on it.

    With a spin also the angle of the punch, with the moment.
    """
    position, force = (float(step.row.get(name, 0.0)) for name in ("position", "tangential_force"))
    by_loss = force - step.shear_force + step.stretch
    turned = [(spin * position, step.spin_moment)] if spin else []
    return (position, by_loss), *zip(step.moved, step.mean_shear, strict=True), *turned


def _area(*points: Point) -> float:
    """Area under y(x) between the last two points, by a parabola if the third lies in the same direction."""
    *earlier, (x0, y0), (x1, y1) = points
    width, slope = x1 - x0, 0.0
    area = width * (y0 + y1) / 2
    for x, y in earlier:
        if (x0 - x) * width > 0:
            slope = ((y1 - y0) / width - (y0 - y) / (x0 - x)) / (x1 - x)
    return area - slope * width**3 / 6
