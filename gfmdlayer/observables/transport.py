"""Columns of seals, switches and joints: flow through the gap, conductance and stiffness of the spots.

They follow from the contact of an accepted step. The ranks of a case bring gap or contact to the first one,
which computes them (`_whole`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gfmdlayer.observables.observable import Column, Observable, Observed, Places, Value, declared
from gfmdlayer.transport import flow_memory

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.config import Config
    from gfmdlayer.config.sections import Conductance, Conductor
    from gfmdlayer.resumable import State
    from gfmdlayer.step import Step

# Cost of a row in FFT pairs: the factors of an open gap; 13 iterations on the spots, of two pairs each.
FLOW_PAIRS, SPOTS_PAIRS = 300.0, 26.0
SPOTS_FIELDS = 12.0  # arrays of the grid
_KIND = len("the throat along x")  # letters of a doubt that say its kind

_FILM = "over the cell; valid while the fluid does not lift the surface"
_PATH = "on the widest path; valid while the fluid does not lift the surface"
_FLOW = "flow per width along {} by a drop of pressure per length along {}, times 12 viscosities"
FLOW = declared(f"""
    flow_xx | {_FLOW.format("x", "x")} | length^3 | {_FILM} | K_{{xx}}
    flow_xy | {_FLOW.format("x", "y")} | length^3 | {_FILM} | K_{{xy}}
    flow_yy | {_FLOW.format("y", "y")} | length^3 | {_FILM} | K_{{yy}}
    hydraulic_gap_x | distance of parallel plates with the same flow along x | length | {_FILM} | h_x
    hydraulic_gap_y | distance of parallel plates with the same flow along y | length | {_FILM} | h_y
    flow_imbalance | difference of the flow between cross-sections, relative | 1 | {_FILM}
    """)
THROATS = declared(f"""
    throat_points_x | points across the throat of the widest path along x; below 6 the flow is only an
      estimate | 1 | {_PATH}
    throat_points_y | points across the throat of the widest path along y; below 6 the flow is only an
      estimate | 1 | {_PATH}
    """)
*CRITICAL_GAPS, BRUGGEMAN = declared(rf"""
    critical_gap_x | largest gap such that points with at least this gap lead through along x | length |
      {_PATH} | u_{{\mathrm{{c}}x}}
    critical_gap_y | largest gap such that points with at least this gap lead through along y | length |
      {_PATH} | u_{{\mathrm{{c}}y}}
    flow_bruggeman | (flow_xx flow_yy)^(1/2) of an isotropic surface by Bruggeman's effective medium,
      estimated | length^3 | from the distribution of the gap; closed from a contact area of 0.42 on
    """)
RADIUS, RESISTANCE = declared(r"""
    spot_radius | radius of one disc of equal resistance, (rho1 + rho2)/(4 R) | length |
      contact area of the step; from the mean potential of the surface | a_\mathrm{eq}
    resistance | resistance of the contact spots and the films | ohm |
      contact area of the step; from the mean potential of the surface | R
    """)
STIFFNESS = declared("""
    storage_stiffness | real part of the dynamic stiffness, in phase | pressure |
      at the contact area of the step; from the mean height of the surface where it is prescribed
    loss_stiffness | imaginary part of the dynamic stiffness, out of phase | pressure |
      at the contact area of the step; from the mean height of the surface where it is prescribed
    """)


class Every(Observable):
    """Measured in every n-th row, at the times of the snapshots and at the end; NaN in the other rows."""

    KEPT = ("rows",)

    def __init__(self, case: Observed, every: int) -> None:
        self._grid, self._every, self._rows = case.grid, every, 0
        self._names = [column.name for column in self.columns(case.config) or ()]
        self._times = (*case.config.output.snapshot_times, case.config.time.end)

    def _due(self, time: float) -> bool:
        self._rows += 1
        counted = (self._rows - 1) % self._every == 0
        return counted or any(math.isclose(time, each, rel_tol=1e-9) for each in self._times)


def _whole(grid: Any, field: NDArray[Any], measured: Callable[[NDArray[Any]], Any]) -> Any:
    """Return a quantity of the whole field, measured on the first rank, to all ranks."""
    ranks = grid.ranks
    whole = ranks.gathered(field.reshape(grid.shape))
    with ranks.agreeing(ArithmeticError), ranks.agreeing(MemoryError):
        value = measured(whole) if ranks.first else None
    return ranks.shared(value)


class SealEstimates(Observable):
    """Cheap estimates of the flow, where `output.observables` names them.

    The cube of a critical gap is 0.35 to 1.7 of the flow over eight decades, and zero exactly where the flow
    is. Bruggeman's estimate is within a third up to a contact area of a quarter, and not near closing.
    """

    COLUMNS = (*CRITICAL_GAPS, BRUGGEMAN)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns that are asked for."""
        return tuple(each for each in cls.COLUMNS if each.name in (config.output.observables or ())) or None

    def __init__(self, case: Observed) -> None:
        self._grid, self._names = case.grid, [each.name for each in self.columns(case.config) or ()]

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the estimates."""
        return dict(_whole(self._grid, step.fields["gap"], self._measured))

    def _measured(self, gap: FloatArray) -> dict[str, float]:
        from gfmdlayer.transport.leakage import bruggeman
        from gfmdlayer.transport.percolation import throats

        row = {}
        if BRUGGEMAN.name in self._names:
            row[BRUGGEMAN.name] = bruggeman(gap)
        if any(each.name in self._names for each in CRITICAL_GAPS):
            narrow = throats(gap, _spacing(self._grid))
            row |= {each.name: throat.gap for each, throat in zip(CRITICAL_GAPS, narrow, strict=True)}
        return {name: row[name] for name in self._names}


class LeakageColumns(Every):
    """Flow tensor of a thin fluid film through the gap, by the Reynolds equation (`output.leakage`).

    The leak rate of a seal of length Lx and width Ly is flow_xx/(12 viscosity) Ly/Lx times the drop of
    pressure. It is zero exactly where contact closes the cell.
    """

    COLUMNS = (*FLOW, *THROATS)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns; a line has no throats."""
        if config.output.leakage is None:
            return None
        return cls.COLUMNS if len(config.grid.points) == 2 else FLOW

    @classmethod
    def cost(cls, config: Config) -> tuple[float, float]:
        """Return the FFT pairs of a row and the bytes of the solver."""
        points, asked = math.prod(config.grid.points), config.output.leakage
        if asked is None or len(config.grid.points) == 1:
            return 0.0, 0.0
        return FLOW_PAIRS / asked.every, flow_memory(points)

    def __init__(self, case: Observed) -> None:
        asked = case.config.output.leakage
        assert asked is not None
        super().__init__(case, asked.every)
        self._said: dict[str, str] = {}

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the flow, and remember why it is not to be trusted."""
        if not self._due(step.time):
            return dict.fromkeys(self._names, math.nan)
        from gfmdlayer.transport.leakage import doubts

        row, narrow = _whole(self._grid, step.fields["gap"], self._measured)
        depth = max(-self._grid.ranks.minimum(float(step.fields["displacement"].min())), 0.0)
        for axis, throat in narrow.items():
            for reason in doubts(axis, throat, depth, step.residual, self._grid.points):
                self._said[reason[:_KIND]] = f"t = {step.time:.6g}: {reason}"
        return dict(row)

    @property
    def warning(self) -> str:  # type: ignore[override]
        """Doubts about the flow, the last of each kind."""
        return "; ".join(self._said.values())

    def state(self) -> State:
        """Return the rows and the doubts so far."""
        return {**super().state(), "said": "\n".join(self._said.values())}

    def restore(self, state: State) -> None:
        """Continue from the rows and the doubts of another run."""
        super().restore(state)
        lines = str(state["said"]).splitlines()
        self._said = {line.partition(": ")[2][:_KIND]: line for line in lines}

    def _measured(self, gap: FloatArray) -> tuple[dict[str, float], dict[str, Any]]:
        from gfmdlayer.transport.leakage import flow_through, numbers_of
        from gfmdlayer.transport.percolation import throats

        row = numbers_of(flow_through(gap, self._grid.period))
        narrow = {} if gap.ndim == 1 else dict(zip("xy", throats(gap, _spacing(self._grid)), strict=True))
        return row | {f"throat_points_{axis}": each.points for axis, each in narrow.items()}, narrow


class OfSpots(Every):
    """Measures the contact spots; the impedances of both sides add, on the whole grid."""

    def __init__(self, case: Observed, every: int, sides: Sequence[tuple[Any, float]]) -> None:
        import numpy as np

        from gfmdlayer.grid.grid import Grid
        from gfmdlayer.transport.spots import Conductors, Spots, impedance, inverse

        super().__init__(case, every)
        self._spots = None
        if case.grid.ranks.first:
            whole = Grid(case.grid.points, case.grid.period)
            Z = np.sum([impedance(whole.wavenumbers, films, base) for films, base in sides], axis=0)
            if case.config.grid.isolated:
                Z = inverse(case.in_cell(Conductors(sides)).stiffness(whole.waves, 0.0))
            self._spots = Spots(Z, _cell(case.grid))

    def _total(self, step: Step) -> float:
        """Return the flow through the spots at a potential of 1."""
        touching = step.fields["touching"]
        return float(_whole(self._grid, touching, lambda contact: self._spots and self._spots.total(contact)))

    def state(self) -> State:
        """Return the rows, and the density from which the next solution starts."""
        density = None if self._spots is None else self._spots.density
        return {**super().state(), **({} if density is None else {"density": density})}

    def restore(self, state: State) -> None:
        """Continue from those of another run."""
        super().restore(state)
        if self._spots is not None and "density" in state:
            self._spots.density = state["density"]


class SpotRadius(OfSpots):
    """Radius of the disc with the resistance of all contact spots, on homogeneous halfspaces.

    It needs no material: charge has no memory, and the resistance follows the contact area of the step.
    """

    COLUMNS = (RADIUS,)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the column where it is asked for."""
        return cls.COLUMNS if RADIUS.name in (config.output.observables or ()) else None

    @classmethod
    def cost(cls, config: Config) -> tuple[float, float]:
        """Return the FFT pairs of a row and the bytes of the solver."""
        return SPOTS_PAIRS, SPOTS_FIELDS * 8.0 * math.prod(config.grid.points)

    def __init__(self, case: Observed) -> None:
        super().__init__(case, 1, [((), 1.0)])

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the radius, S/4 for a conductivity of 1."""
        return {RADIUS.name: self._total(step) / 4}


class ConductanceColumns(OfSpots):
    """Resistance of the contact spots between two conductors (`output.conductance`).

    Constriction and films on both sides, and the films in series over the cell. Without contact it is
    infinite. On a line it is the resistance times the length of the line. Of an isolated contact the cell has
    no share: potentials count from far away, of a line on a halfspace from the distance `grid.datum`.
    """

    COLUMNS = (RESISTANCE,)

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the column where it is asked for."""
        if config.output.conductance is None:
            return None
        units = "ohm" if len(config.grid.points) == 2 else "ohm length"
        return (replace(RESISTANCE, units=units),)

    @classmethod
    def cost(cls, config: Config) -> tuple[float, float]:
        """Return the FFT pairs of a row and the bytes of the solver."""
        asked = config.output.conductance
        every = 1 if asked is None else asked.every
        return SPOTS_PAIRS / every, SPOTS_FIELDS * 8.0 * math.prod(config.grid.points)

    def __init__(self, case: Observed) -> None:
        asked = case.config.output.conductance
        assert asked is not None
        sides = conductors(asked)
        super().__init__(case, asked.every, sides)
        in_series = sum(d / k for films, base in sides if 0 < base < math.inf for d, k in films)
        self._series = 0.0 if case.config.grid.isolated else in_series / math.prod(case.grid.period)

    def measure(self, step: Step) -> Mapping[str, float]:
        """Return the resistance."""
        if not self._due(step.time):
            return {RESISTANCE.name: math.nan}
        total = self._total(step)
        return {RESISTANCE.name: 1 / total + self._series if total > 0 else math.inf}


class StiffnessColumns(Every):
    """Dynamic stiffness of the contact, force over depth, at a frozen contact area (`output.stiffness`).

    Storage and loss at each frequency, for amplitudes that leave the contact area as it is; an attraction
    adds the change of its traction out of contact. It is no slope of force over depth during the run, which
    depends on the rate.
    """

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:
        """Return the columns over the frequencies."""
        asked = config.output.stiffness
        if asked is None:
            return None
        along = Places("frequency", "frequency, cycles per time", "1 / time", asked.frequencies)
        units = "force / length" if len(config.grid.points) == 2 else "pressure"
        return tuple(replace(column, units=units, along=along) for column in STIFFNESS)

    @classmethod
    def cost(cls, config: Config) -> tuple[float, float]:
        """Return the FFT pairs of a row and the bytes of the solver."""
        asked = config.output.stiffness
        assert asked is not None
        number, points = len(asked.frequencies), math.prod(config.grid.points)
        return 2 * SPOTS_PAIRS * number / asked.every, 2 * SPOTS_FIELDS * 8.0 * points

    def __init__(self, case: Observed) -> None:
        asked = case.config.output.stiffness
        assert asked is not None
        super().__init__(case, asked.every)
        self._frequencies, self._body = asked.frequencies, case.in_cell(case.body)
        self._reduced_time = case.drives.reduced_time

    def measure(self, step: Step) -> Mapping[str, Value]:
        """Return storage and loss stiffness at each frequency."""
        import numpy as np

        total = np.full(len(self._frequencies), complex(math.nan, math.nan))
        if self._due(step.time):
            reduced = self._reduced_time
            factor = 1.0 if reduced is None else reduced.factor(step.time)
            touching, law = step.fields["touching"], step.interface
            # NaN marks the points in contact, so that one field reaches the first rank.
            curvature = np.zeros(touching.size)
            if law.attracts:
                curvature = law.curvature(step.fields["gap"])
            field = np.where(touching, np.nan, curvature)
            total = _whole(self._grid, field, lambda whole: self._measured(whole, factor))
        return {"storage_stiffness": total.real.copy(), "loss_stiffness": total.imag.copy()}

    def _measured(self, curvature: NDArray[Any], factor: float) -> NDArray[Any]:
        """Return K* from the curvature of the interface, NaN in contact, at all frequencies.

        Without attraction one solution does where K(q, s) is proportional to K(q, 0).
        """
        import numpy as np

        from gfmdlayer.grid.grid import Grid
        from gfmdlayer.transport.spots import Spots, attracted, inverse

        contact = np.isnan(curvature)
        attracts = bool(np.nan_to_num(curvature).any())
        waves = Grid(self._grid.points, self._grid.period).waves
        body, before, totals = self._body, None, []
        for frequency in self._frequencies:
            s = 2j * math.pi * frequency * factor
            K = body.spectrum(waves).glassy if math.isinf(frequency) else np.asarray(body.stiffness(waves, s))
            K = K if np.any(K.imag) else np.ascontiguousarray(K.real)
            if attracts:
                totals.append(complex(attracted(K, curvature, contact, _cell(self._grid))))
                continue
            if before is not None:
                ratio = (K / np.where(before[0] == 0, 1.0, before[0])).ravel()[1:]
                if np.ptp(ratio.real) + np.ptp(ratio.imag) <= 1e-12 * abs(ratio[0]):
                    totals.append(before[1] * ratio[0])
                    continue
            total = complex(Spots(inverse(K), _cell(self._grid)).total(contact))
            before = before or (K, total)
            totals.append(total)
        return np.array(totals)


def _spacing(grid: Any) -> tuple[float, float]:
    x, y = (length / n for length, n in zip(grid.period, grid.points, strict=True))
    return x, y


def _cell(grid: Any) -> float:
    return float(math.prod(grid.period) / math.prod(grid.points))


def conductors(asked: Conductance) -> list[tuple[tuple[tuple[float, float], ...], float]]:
    """Return films and base of both conductors."""
    return [_conductor(each) for each in (asked.body, asked.punch)]


def _conductor(side: Conductor) -> tuple[tuple[tuple[float, float], ...], float]:
    """Return films (thickness, conductivity) and the conductivity of the base."""
    films = tuple((each.thickness, 1 / each.resistivity) for each in side.films)
    return films, math.inf if side.resistivity == 0 else 1 / side.resistivity
