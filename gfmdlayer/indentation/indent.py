"""One isolated indentation: its columns, profiles and warnings; `gfmdlayer.indent` as an xarray.Dataset."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from gfmdlayer.arrays import FloatArray, unmasked
from gfmdlayer.body.body import Body
from gfmdlayer.body.materials import Law, Material
from gfmdlayer.case.model import ConvergenceError
from gfmdlayer.config import ConfigError
from gfmdlayer.config.geometries import FINEST
from gfmdlayer.config.reader import body_of
from gfmdlayer.errors import GfmdlayerError, warn
from gfmdlayer.indentation.compliance import gauss_rule
from gfmdlayer.indentation.march import Marched
from gfmdlayer.indentation.solve import (
    NO_ADHESION,
    Edge,
    History,
    Indentation,
    Space,
    distinct,
    find_space,
    follow,
    in_growing_space,
    jumps,
    on_quartered_steps,
    on_steps,
    work_of,
)
from gfmdlayer.observables import INDENTATION
from gfmdlayer.observables.energy_balance import unbalanced
from gfmdlayer.punch.revolution import OfRevolution, Revolution, abel_transform, heights, of_table
from gfmdlayer.results.names import VARIABLES
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import nearest, shown

if TYPE_CHECKING:
    from gfmdlayer.figures.contact_data import ContactData

# Radial profiles of pressure, displacement and gap from the fields of a run.
#
#     p(r) = (2/pi) [chi(a)/(a^2 - r^2)^(1/2) - int_r^a chi'(x) dx/(x^2 - r^2)^(1/2)],       r < a
#     gap(r) = (2/pi) int_a^r [v(x) - depth + H(x)] dx/(r^2 - x^2)^(1/2),                     r > a
#
# with v = D*chi + (2/pi) int cos(qx) C*X dq, the Abel transform of the displacement of the surface. A
# contact with a sharp rim, or with adhesion, has an infinite pressure at its edge.

_NODES = 48  # of Gauss's rule in each integral
_CENTRE = 1e-6  # part of the reach in place of r = 0, where the pressure under a cone is infinite
_EDGE = 1e-9  # chi(a), relative to its maximum, from which it is not zero


class Profiles(NamedTuple):
    """Radial profiles at the snapshots: fields of shape (times, points)."""

    time: FloatArray  # (times,)
    r: FloatArray  # (points,), distances from the axis
    pressure: FloatArray  # positive where it compresses
    displacement: FloatArray  # positive upward
    gap: FloatArray  # infinite beyond the end of an indenter


def profiles(indentation: Indentation, profile: Revolution, times: FloatArray, r: FloatArray) -> Profiles:
    """Return the profiles of an indentation at ascending times, at which it kept its fields."""
    assert indentation.fields is not None
    assert indentation.space is not None
    pressure, displacement, gap = np.zeros((3, times.size, r.size))
    for k, at in enumerate(np.searchsorted(indentation.time, times)):
        surface = _IndentedSurface(indentation.fields, int(at), k, indentation.space, profile)
        pressure[k] = surface.pressure(r)
        displacement[k], gap[k] = surface.displacement_and_gap(r)
    return Profiles(times, r, pressure, displacement, gap)


class _IndentedSurface:
    """The surface at one time, with the radius and the depth of the fields; the columns are extrapolated."""

    def __init__(self, fields: Marched, at: int, snapshot: int, space: Space, profile: Revolution) -> None:
        nodes = space.nodes
        self._space, self._profile = space, profile
        self._a, self._depth = float(fields.radius[at]), float(fields.depth[at])
        self._x = nodes.spacing * np.arange(fields.chi.shape[1])
        self._chi = CubicSpline(self._x, fields.chi[snapshot])
        self._local = fields.local[snapshot]
        self._coupled = fields.spectrum[snapshot] * space.weights * (2 / math.pi)

    def pressure(self, r: FloatArray) -> FloatArray:
        """Pressure at these distances; zero outside the contact."""
        p = np.zeros(r.size)
        a = self._a
        inside = r < a
        if not inside.any():
            return p
        near = np.maximum(r[inside], _CENTRE * self._space.nodes.reach)
        # x = r cosh t makes the integrand smooth.
        t, w = _gauss(np.zeros(near.size), np.arccosh(np.maximum(a / near, 1.0)))
        p[inside] = -(self._chi(near[:, np.newaxis] * np.cosh(t), 1) * w).sum(axis=1)
        edge = float(self._chi(a))
        if abs(edge) > _EDGE * float(np.abs(self._chi(self._x[self._x < a])).max()):
            p[inside] += edge / np.sqrt((a - near) * (a + near))
        return p * (2 / math.pi)

    def displacement_and_gap(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Upward displacement and gap at these distances; the gap is infinite beyond the indenter's end."""
        h, a = heights(self._profile, r), self._a
        r = np.maximum(r, _CENTRE * self._space.nodes.reach)
        gap, outside = np.zeros(r.size), r > a
        under = outside & np.isfinite(h)
        t, w = _gauss(np.arcsin(a / r[under]), np.full(int(under.sum()), math.pi / 2))
        x = r[under][:, np.newaxis] * np.sin(t)
        gap[under] = ((self._sunk(x) - self._depth + self._H(x)) * w).sum(axis=1) * (2 / math.pi)
        displacement = np.where(np.isfinite(h), h, 0.0) - self._depth - gap
        beyond = outside & ~under
        if beyond.any():
            t, w = _gauss(np.arcsin(a / r[beyond]), np.full(int(beyond.sum()), math.pi / 2))
            sunk = (self._sunk(r[beyond][:, np.newaxis] * np.sin(t)) * w).sum(axis=1)
            t, w = _gauss(np.zeros(int(beyond.sum())), np.arcsin(a / r[beyond]))
            sunk += ((self._depth - self._H(r[beyond][:, np.newaxis] * np.sin(t))) * w).sum(axis=1)
            displacement[beyond], gap[beyond] = -sunk * (2 / math.pi), math.inf
        return displacement, gap

    def _H(self, x: FloatArray) -> FloatArray:
        """Abel transform of the profile."""
        transforms = [abel_transform(self._profile, radius) for radius in x.ravel().tolist()]
        return np.array(transforms).reshape(x.shape)

    def _sunk(self, x: FloatArray) -> FloatArray:
        """Abel transform of the downward displacement outside the contact."""
        local = np.interp(x, self._x, self._local, right=0.0)
        if not self._coupled.size:
            return np.asarray(local)
        return np.asarray(local + np.cos(x[..., np.newaxis] * self._space.q) @ self._coupled)


def _gauss(begin: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights between begin and end, each of shape (points, nodes)."""
    x, w = gauss_rule(_NODES)
    half = (end - begin)[:, np.newaxis] / 2
    return begin[:, np.newaxis] + half * (x + 1), half * w


DEFAULT_TOLERANCE = 1e-4

# Profiles reach to this many times the largest radius of the nodes.
_EXTENT = 2.0

# Negative pressure or gap, relative to the largest pressure or the depth, that is more than rounding.
_NEGATIVE = 1e-6
_CHECKED = 400  # radii at which it is looked for


@dataclass(frozen=True)
class IsolatedIndentation:
    """A rigid indenter of revolution that is pressed into a body."""

    body: Body
    profile: Revolution
    history: History  # prescribed depth or force
    tolerance: float = DEFAULT_TOLERANCE  # error of force, depth and radius, relative to their largest
    step: float | None = None  # largest length of equal steps; None: steps are chosen for the tolerance
    adhesion: Edge = NO_ADHESION
    snapshots: Sequence[float] = ()  # times to land on, at which profiles are kept
    stops: Sequence[float] = ()  # further times to land on
    points: int = 256  # radial points of the profiles
    extent: float | None = None  # radius up to which they reach; None: about twice the largest contact radius

    @cached_property
    def _space(self) -> Space:
        return find_space(self.body, self.profile, self.history, self.tolerance, self.adhesion)

    @cached_property
    def _kept(self) -> FloatArray:
        return distinct(self.snapshots, self.history.time)

    @cached_property
    def radii(self) -> FloatArray:
        """Distances from the axis of the profiles, shape (points,)."""
        extent = _EXTENT * self._space.nodes.reach if self.extent is None else self.extent
        return np.linspace(0.0, extent, self.points)

    @cached_property
    def solved(self) -> Indentation:
        """Force, depth, radius and energies over time; ArithmeticError if the tolerance is not reached."""
        if self.step is not None:
            return self._on_equal_steps(self.step)
        result = follow(
            self.body,
            self.profile,
            self.history,
            tolerance=self.tolerance,
            adhesion=self.adhesion,
            stops=self.stops,
            snapshots=self._kept,
            space=self._space,
        )
        if not result.error <= self.tolerance:
            raise ArithmeticError(
                f"estimated error {result.error:.2e}; the tolerance is {self.tolerance:.2e}"
                + self._jump(result)
            )
        return result

    def _jump(self, result: Indentation) -> str:
        """Say which jump of a contact with adhesion takes longer than the tolerance allows."""
        duration = float(result.time[-1] - result.time[0])
        steps = np.diff(result.time)
        coarse = jumps(result, self.tolerance * duration)
        if not (self.adhesion.work and coarse.size):
            return ""
        at = coarse[steps[coarse].argmax()]
        return (
            f". Contact jumps at t = {result.time[at]:.6g}, and the time is known to {steps[at]:.1e} only; "
            f"try a tolerance of {2 * steps[at] / duration:.1e}"
        )

    def _on_equal_steps(self, step: float) -> Indentation:
        """Take equal steps of at most this length between breakpoints and snapshots, and their halves."""
        knots = np.union1d(self.history.time, self._kept)
        knots = np.union1d(knots, distinct(self.stops, knots))
        parts = [
            np.linspace(begin, end, max(1, math.ceil((end - begin) / (2 * step) - 1e-6)) + 1)[:-1]
            for begin, end in pairwise(knots.tolist())
        ]
        time = np.append(np.concatenate(parts), knots[-1])
        return in_growing_space(
            lambda space: on_quartered_steps(self.body, space, self.profile, self.history, time, self._kept)[
                0
            ],
            self._space,
            self.profile,
            self.tolerance,
        )

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns, each of shape (nt,)."""
        result = self.solved
        work = work_of(result)
        if self.adhesion.work:
            work -= self._work_torn_off(work)
        return {
            "time": result.time,
            "force": result.force,
            "depth": result.depth,
            "contact_radius": result.radius,
            "work": work,
            "stored": result.stored,
            "dissipated": result.dissipated,
            "energy_residual": work - result.stored - result.dissipated - result.parted,
        }

    def _work_torn_off(self, work: FloatArray) -> FloatArray:
        """Work on the way from the contact to the surface, whose depth a torn off indenter has."""
        history, result = self.history, self.solved
        torn = history.by_force_at(result.time[1:]) & (result.radius[:-1] > 0) & (result.radius[1:] == 0)
        return np.concatenate(([0.0], np.cumsum(np.diff(work) * torn)))

    def profiles(self) -> Profiles:
        """Return the profiles at the snapshots."""
        return profiles(self.solved, self.profile, self._kept, self.radii)

    def unbalanced(self, section: str = "") -> str:
        """Say that the energies miss a part of the work; with adhesion they lack what jumps lose."""
        columns = self.columns()
        missed, *energies = (float(np.abs(columns[name]).max()) for name in ("energy_residual", *_ENERGIES))
        if self.adhesion.work or not missed:
            return ""
        part = missed / max(energies)
        if self.step is None:
            return unbalanced(part, self.tolerance, section=section)
        longest = 2 * float(np.diff(columns["time"]).max())  # the rows are half steps
        return unbalanced(part, step=min(self.step, longest), section=section)

    @cached_property
    def warnings(self) -> list[str]:
        """Lines on pressures or gaps below zero, where the contact is not one disc.

        A transform of the pressure that falls from the axis to the edge, and one of the gap that is not
        negative, are enough; where they are not so, the profiles are looked at.
        """
        result = self.solved
        assert result.space is not None
        suspicious = result.rise.max() * result.radius.max() > _NEGATIVE * np.abs(result.force).max()
        if self.adhesion.work or not suspicious:
            return []
        time = result.time[[int(result.rise.argmax())]]
        again = on_steps(self.body, result.space, self.profile, self.history, result.time, snapshots=time)
        near = profiles(again, self.profile, time, np.linspace(0.0, 2 * result.radius.max(), _CHECKED))
        scales = {"pressure": float(near.pressure.max()), "gap": float(np.abs(result.depth).max())}
        return [
            f"{name} below zero at t = {time[0]:.6g}, by {-least / scale:.1e} of the largest: the contact is "
            "not one disc there"
            for name, scale in scales.items()
            if (least := float(getattr(near, name).min())) < -_NEGATIVE * scale
        ]


FIELDS = ("pressure", "displacement", "gap")
_ENERGIES = ("work", "stored", "dissipated")


def _as_series(body: Body, time: FloatArray, tolerance: float) -> Body:
    """Return the body with Prony series for its laws over the times of a history, as `run` has them.

    Liquids are beside springs that their response does not feel, see `Law.prony`.
    """
    laws: tuple[Law, ...] = getattr(body, "laws", ())
    if all(isinstance(law, Material) and law.relaxed for law in laws):
        return body
    shortest, longest = tolerance * float(np.diff(time).min()), float(np.ptp(time))
    series = [law.prony(shortest, longest).material for law in laws]
    made: Body = body.with_series(series, 0.0)  # type: ignore[attr-defined]
    return made


@entry(indenter="punch", work_of_adhesion="work")
def indent(
    body: Body | Mapping[str, Any],
    punch: OfRevolution | Revolution | Mapping[str, Any] | tuple[ArrayLike, ArrayLike],
    time: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    force: ArrayLike | None = None,
    tolerance: float = 1e-4,
    work: float = 0.0,
    edge_speed: float = math.inf,
    edge_exponent: float = 0.6,
    healing_work: float | None = None,
    snapshots: Sequence[float] = (),
    times: Sequence[float] = (),
) -> ContactData:
    """Press a rigid punch of revolution into a body: isolated, frictionless, over any history.

    Parameters
    ----------
    body : Body or mapping
        The body, such as a `halfspace` or a `bonded_layer`, or its keys in a configuration; any that supports
        a load. A law with a continuous spectrum is replaced by a Prony series, as in `run`.
    punch : shape, mapping or pair of arrays
        A shape of the punch that is a convex body of revolution, its keys in a configuration, or radii and
        heights of a convex profile.
    time : array_like, shape (nt,)
        Ascending times. The body is at rest before the first one.
    depth, force : array_like, shape (nt,)
        The prescribed quantity, one of the two; linear between the times. The depth counts from the first
        touch of the undeformed surface and may be negative.
    tolerance : float
        Estimated error of force, depth and contact radius, relative to the largest of each. A radius below a
        tenth of the largest counts by its square: it falls like a root of time where contact is lost. With
        adhesion contact jumps: errors that a shift in time by up to `tolerance` times the duration removes
        do not count then. Not below 1e-9.
    work : float
        Work of adhesion: the energy per area that a slowly receding edge of the contact takes (JKR), with
        the relaxed modulus.
    edge_speed, edge_exponent : float
        An edge that recedes with the speed v takes work (1 + (v/edge_speed)^edge_exponent), as
        Maugis & Barquins, J. Phys. D 11 (1978) 1989, have it; length over time, and a number.
    healing_work : float, optional
        Energy per area that a slowly advancing edge gains, with the relaxed modulus; at most, and by default,
        work (relaxed/glassy modulus of the surface)^2. With the default, an edge exchanges the
        same energy with the glassy body next to it on both ways.
    snapshots : sequence of float
        Times of the radial profiles of pressure, displacement and gap.
    times : sequence of float
        Further times of rows. Straight lines between two rows deviate by about a thousandth of the largest
        force, depth and contact area, but for jumps of a contact with adhesion.

    Returns
    -------
    xarray.Dataset
        force, depth, contact_radius, work, stored, dissipated and energy_residual over `time`, the times
        of the steps; the profiles over `snapshot` and `r`. Each has the attributes long_name and units, a
        dimension such as "length": the numbers are in the units of the arguments. The attribute `error` is
        the estimated error. With adhesion there are `edge_work`, the energy that the edge has taken less that
        it has gained, and the attribute `pull_off_force`, the largest pull; energy_residual grows by the
        energy lost in jumps. A punch that a force has torn off has the depth of the surface, free of work.
        `plot()` draws it.

    Raises
    ------
    ConfigError
        If the input is impossible; the message has the reason and the allowed values.
    ConvergenceError
        If the tolerance is not reached.

    Examples
    --------
    Hertz, 4/3 E* R^(1/2) depth^(3/2) with E* = 2 G/(1 - nu) = 4:

    >>> body, sphere = gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=1.0)
    >>> found = gfmdlayer.indent(body, sphere, [0.0, 1.0], depth=[0.0, 0.01])
    >>> abs(float(found.force[-1]) / (4 / 3 * 4.0 * 0.01**1.5) - 1) < 1e-4
    True
    """
    body = body_of(body, "stiffness", "spectrum")
    history = _history(time, depth, force)
    _check_numbers(tolerance, work, edge_speed, edge_exponent, healing_work or 0.0)
    if not work and history.by_force and history.value.min() < 0:
        raise ConfigError([f"force: got {history.value.min():.6g}; must be >= 0 without adhesion"])
    if not history.by_force and history.value.max() >= (floor := getattr(body, "rigid_below", math.inf)):
        raise ConfigError(
            [f"depth: got {history.value.max():.6g}; must be above the rigid base, < {floor!r}"]
        )
    body = _as_series(body, history.time, tolerance)
    kept, rows = (
        np.unique(_numbers(name, each)) for name, each in (("snapshots", snapshots), ("times", times))
    )
    for name, each in (("snapshots", kept), ("times", rows)):
        if each.size and not (history.time[0] <= each[0] and each[-1] <= history.time[-1]):
            raise ConfigError([f"{name}: got {each}; must be between the first and the last time"])
    run = IsolatedIndentation(
        body,
        as_revolution(punch),
        history,
        tolerance=tolerance,
        adhesion=Edge(work, edge_speed, edge_exponent, healing_work),
        snapshots=kept.tolist(),
        stops=rows.tolist(),
    )
    try:
        return _data_of(run, adhesive=work > 0)
    except ArithmeticError as error:
        if isinstance(error, ConvergenceError):
            raise
        raise ConvergenceError(f"indent: {error}") from error
    except ValueError as error:
        if isinstance(error, GfmdlayerError):
            raise
        raise ConfigError([str(error)]) from None


def _numbers(name: str, values: ArrayLike) -> FloatArray:
    """Return an array of numbers; ConfigError for anything else."""
    try:
        return unmasked(values).astype(np.float64)
    except (TypeError, ValueError):
        raise ConfigError([f"{name}: got {shown(values)}; must be numbers"]) from None


def _data_of(run: IsolatedIndentation, *, adhesive: bool) -> ContactData:
    """Return the columns and profiles of an indentation as a dataset, with warnings."""
    import xarray

    from gfmdlayer.figures.contact_data import with_plot

    columns = run.columns()
    about = {column.name: column.described for column in INDENTATION}
    about |= {name: {"long_name": each.long_name, "units": each.units} for name, each in VARIABLES.items()}
    about["r"] = {"long_name": "distance from the axis", "units": "length"}
    data: dict[str, Any] = {name: ("time", values, about[name]) for name, values in columns.items()}
    coordinates = {"time": data.pop("time")}
    attributes = {"error": run.solved.error, "solutions": run.solved.solutions}
    if adhesive:
        meaning = {"long_name": "energy taken by the edge of the contact", "units": "energy"}
        data["edge_work"] = "time", run.solved.parted, meaning
        attributes["pull_off_force"] = max(0.0, -float(run.solved.force.min()))
    if run.snapshots:
        fields = run.profiles()
        data |= {name: (("snapshot", "r"), getattr(fields, name), about[name]) for name in FIELDS}
        coordinates |= {
            name: (name, each, about[name]) for name, each in (("snapshot", fields.time), ("r", fields.r))
        }
    for line in filter(None, (*run.warnings, run.unbalanced())):
        warn(line)
    return with_plot(xarray.Dataset(data, coordinates, attributes))


def as_revolution(indenter: Any) -> Revolution:
    """Return the profile of a punch, see `indent`; ConfigError if it is no convex body of revolution."""
    if isinstance(indenter, Revolution):
        return indenter
    if isinstance(indenter, Mapping):
        from gfmdlayer.punch.shapes import SHAPES

        keys = dict(indenter)
        shape = SHAPES.get(keys.get("shape", next(iter(SHAPES))))
        if shape is None:
            word = keys["shape"]
            allowed = f"must be one of {', '.join(SHAPES)}{nearest(str(word), SHAPES)}"
            raise ConfigError([f"punch: shape: got {word!r}; {allowed}"])
        indenter = shape(**keys)
    if isinstance(indenter, OfRevolution):
        return indenter.revolution()
    if isinstance(indenter, tuple) and len(indenter) == 2:
        return of_table(*indenter)
    allowed = "must be a shape of revolution such as Sphere(radius=1.0), its keys, or radii and heights"
    raise ConfigError([f"punch: got {shown(indenter)}; {allowed}"])


def _check_numbers(
    tolerance: float, work: float, edge_speed: float, edge_exponent: float, healing_work: float
) -> None:
    numbers = {
        "work": work,
        "edge_speed": edge_speed,
        "edge_exponent": edge_exponent,
        "healing_work": healing_work,
        "tolerance": tolerance,
    }
    for name, value in numbers.items():
        if np.ndim(value) or np.asarray(value).dtype.kind not in "iuf":
            raise ConfigError([f"{name}: got {value!r}; must be a number"])
    for name in ("work", "healing_work"):
        if not 0 <= numbers[name] < math.inf:
            raise ConfigError([f"{name}: got {numbers[name]!r}; must be finite and >= 0"])
    if not edge_speed > 0:
        raise ConfigError([f"edge_speed: got {edge_speed!r}; must be > 0"])
    if not 0 < edge_exponent < math.inf:
        raise ConfigError([f"edge_exponent: got {edge_exponent!r}; must be finite and > 0"])
    if not FINEST <= tolerance < math.inf:
        raise ConfigError([f"tolerance: got {tolerance!r}; must be finite and >= {FINEST:g}"])
    if not work and (edge_speed < math.inf or healing_work):
        name = "edge_speed" if edge_speed < math.inf else "healing_work"
        raise ConfigError([f"{name}: got {numbers[name]!r} without adhesion; must have a work > 0"])


def _history(time: ArrayLike, depth: ArrayLike | None, force: ArrayLike | None) -> History:
    if (depth is None) == (force is None):
        got = "neither" if depth is None else "both"
        raise ConfigError([f"depth, force: got {got}; must be one of the two"])
    name = "depth" if force is None else "force"
    prescribed = depth if force is None else force
    assert prescribed is not None
    times, values = _numbers("time", time), _numbers(name, prescribed)
    if times.ndim != 1 or times.size < 2 or values.shape != times.shape:
        raise ConfigError(
            [f"{name}: got shape {values.shape} for times of shape {times.shape}; must be equal, two or more"]
        )
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise ConfigError([f"time, {name}: must be finite"])
    if np.diff(times).min() <= 0:
        at = int(np.diff(times).argmin())
        raise ConfigError([f"time: got {times[at + 1]:.6g} after {times[at]:.6g}; must ascend"])
    return History(times, values, force is not None)
