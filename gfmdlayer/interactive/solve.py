"""`gfmdlayer.solve`: one elastic contact of a rigid punch with a body, with or without friction."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gfmdlayer.body.body import Body
from gfmdlayer.body.continuous import ContinuousLaw
from gfmdlayer.body.isolated import IsolatedBody
from gfmdlayer.body.isolated import isolated as without_images
from gfmdlayer.body.materials import Elastic, Law
from gfmdlayer.body.pair import Pair
from gfmdlayer.body.solid import Boundary, Solid
from gfmdlayer.case.checks import too_deep, weak
from gfmdlayer.case.model import ConvergenceError
from gfmdlayer.case.normal import NormalContact
from gfmdlayer.case.parts import Parts
from gfmdlayer.case.wider_cell import wider_cell, within
from gfmdlayer.config import Config, ConfigError
from gfmdlayer.config.reader import body_of, from_python
from gfmdlayer.contact.loading import Imprint, Loading, is_pulled_off
from gfmdlayer.contact.problem import in_contact, why_not_converged
from gfmdlayer.contact.reach import EDGE, Reach
from gfmdlayer.drives import Drives
from gfmdlayer.errors import warn
from gfmdlayer.files.tables import TableError
from gfmdlayer.friction.isolated import without_images as kernels_without_images
from gfmdlayer.friction.problem import FrictionProblem, FrictionSolution
from gfmdlayer.friction.response import AnyResponse, Response
from gfmdlayer.friction.solver import NOT_POSITIVE, FrictionSolver
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.grid.wider import WiderCell
from gfmdlayer.interactive.one_contact import MEANINGS, dataset, meaning, number_in, numbers_in
from gfmdlayer.interactive.surface import Punch, surface_of
from gfmdlayer.interface.friction import ShearBound
from gfmdlayer.interface.interface import Interface
from gfmdlayer.interface.law import HARD_WALL, Interaction
from gfmdlayer.made_once import made_once
from gfmdlayer.observables import totals
from gfmdlayer.observables.contact import FEWEST, UPSIDE_DOWN
from gfmdlayer.observables.contact_statistics import contact_extent, is_upside_down
from gfmdlayer.punch.shape import Cell, Shape
from gfmdlayer.punch.topography import fitting, outward_heights
from gfmdlayer.time_functions import Constant
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import shown
from gfmdlayer.validation.sections import plain

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.body.relaxation import Spectrum
    from gfmdlayer.contact.loading import Surface
    from gfmdlayer.contact.problem import Problem, Solution
    from gfmdlayer.figures.contact_data import ContactData

MOST_STRAIN = 1.0  # about, beyond which a result of linear elasticity means nothing


@entry()
def solve(
    body: Body | Mapping[str, Any],
    punch: Punch,
    *,
    depth: float | Sequence[float] | None = None,
    mean_pressure: float | Sequence[float] | None = None,
    force: float | Sequence[float] | None = None,
    period: float | tuple[float, float] | None = None,
    points: int | tuple[int, ...] | None = None,
    interface: Interface | Mapping[str, Any] | Sequence[Any] | Interaction = HARD_WALL,
    instantaneous: bool = False,
    isolated: bool | Sequence[bool] = False,
    datum: float | None = None,
    friction: float | Mapping[str, float] | None = None,
    tangential_force: float | Sequence[float] | None = None,
    tangential_displacement: float | Sequence[float] | None = None,
    previous: xarray.Dataset | None = None,
    method: str | None = None,
    tolerance: float | None = None,
    inertia: str | None = None,
    max_iterations: int | None = None,
) -> ContactData:
    """Solve the contact of a rigid punch with an elastic body in a periodic cell.

    Parameters
    ----------
    body : Body or mapping
        A `halfspace`, a `bonded_layer`, another, or its keys in a configuration; a viscoelastic body is
        relaxed. A body of your own needs `mean_stiffness` and `spectrum`.
    punch : array_like, callable, path, Topography, DataArray, Shape or mapping
        Heights outward from the punch, as an array of the grid's shape or a function of x, or of x and y: the
        largest touches first, and a round punch is -x^2/(2 R). Or a shape, such as `Sphere`, or its keys. Or
        a measured surface, whose points, period and unit are taken: a file, `Topography`, the object of the
        package SurfaceTopography, or a DataArray over equally spaced x, y.
    depth, mean_pressure, force : float, or sequence of float
        One of them: depth of the punch below the height at which it touches the surface at rest; mean
        pressure over the cell; force over the cell, per length for a line. Of several, each contact begins
        from the one before, and the result has a dimension of this name.
    period : float, or pair of float, optional
        Length of the cell, along each axis; default: the size of the surface, or 1.
    points : int, or pair of int, optional
        Points of the grid, for a line or a surface; default: those of the array or of the measured surface,
        or 1024 on a line.
    interface : Interface, mapping or sequence
        Law of the interaction across the gap, such as `Exponential`, or its keys; the laws of a sequence
        add. Default: a hard wall.
    instantaneous : bool
        Whether a viscoelastic body is glassy instead of relaxed.
    isolated : bool, or pair of bool
        Whether the contact has no periodic images; of a surface also a pair, along x and along y. One that is
        wider than some 0.4 periods, with friction half of a period, is computed in a larger cell, of which
        the attribute `cell` tells the cost.
    datum : float, optional
        Of one isolated axis on a halfspace, the distance at which the surface counts as at rest.
    friction : float or mapping, optional
        Coefficient of friction, or a mapping with `coefficient` mu, `strength` tau_0 (pressure) or both: the
        shear traction of a point is at most the smaller of mu p and tau_0, with the pressure p of the wall,
        which presses against the attraction too.
    tangential_force, tangential_displacement : float, or pair of float, optional
        With friction, one of them: of the punch along x, or along x and y, over the cell (per length for a
        line) and from its place before the first contact. By default the punch keeps its place.
    previous : xarray.Dataset, optional
        With friction, the result from which this step starts.
    method, tolerance, inertia, max_iterations : optional
        Of the solver, as in a configuration.

    Returns
    -------
    xarray.Dataset
        pressure, displacement (positive upward), gap, contact and, with a hardness, imprint along x[, y], of
        a `Pair` also displacement_body and displacement_counterbody, each out of its own body;
        contact_area (part of the cell), contact_area_interpolated (with edges between the points) and the
        estimate contact_area_error of its error, mean_pressure, force, depth, residual and FFT pairs, in the
        units of the arguments. An isolated contact has area, area_interpolated and area_error (of a line, of
        the width) in place of parts and means of the cell,
        and displacement and gap are NaN where they are not known, further from a point in contact than the
        reach. Of a measured surface the attributes `read` and `unit_of_length`. `plot()` draws it.

        With friction also shear_x (traction of the punch on the body), slip_x (of the body against the
        punch, in this step; NaN out of contact), displacement_x, stick, stick_area, tangential_force_x and
        tangential_displacement_x, and on surfaces the same along y. `transforms` counts each component, and
        half of the pairs in single precision.

    Raises
    ------
    ConfigError
        If an argument cannot be used.
    ConvergenceError
        If the solver does not reach its tolerance, with its last state, or no contact carries the pull.

    Notes
    -----
    An incompressible body, or one on a halfspace, keeps its mean height. Depths count from there, and are
    smaller than under an isolated punch, by corrections in 1/period. `isolated=True` removes them.

    Examples
    --------
    Hertz: a sphere of radius R = 8 on a halfspace of E* = 2 G/(1 - nu) = 4, in a cell that is 12 times as
    wide as the contact. The contact radius is (3 F R/(4 E*))^(1/3), the largest pressure 3 F/(2 pi a^2).

    >>> F, R, E = 0.0004, 8.0, 4.0
    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=R), force=F,
    ...                         points=(256, 256))
    >>> a = (3 * F * R / (4 * E)) ** (1 / 3)
    >>> abs(float(np.sqrt(found.contact_area_interpolated / np.pi) / a) - 1) < 0.002  # images, (a/L)^3
    True
    >>> abs(float(found.pressure.max() / (3 * F / (2 * np.pi * a**2))) - 1) < 0.01
    True

    Without periodic images the depth is Hertz's too, F = 4/3 E* R^(1/2) depth^(3/2), in a smaller cell:

    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=R), depth=0.0008,
    ...                         period=0.48, points=(128, 128), isolated=True)
    >>> abs(float(found.force) / (4 / 3 * E * R**0.5 * 0.0008**1.5) - 1) < 1e-4
    True

    Westergaard: a wave h (1 - cos 2 pi x/L) is in contact over |x| < a under the mean pressure
    (pi E* h/L) sin^2(pi a/L), of which the largest pressure is 2/sin(pi a/L).

    >>> mean = 0.5 * np.pi * E * 0.01
    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), lambda x: 0.01 * np.cos(2 * np.pi * x),
    ...                         mean_pressure=mean)
    >>> abs(float(found.contact_area_interpolated) - 0.5) <= 0.02 / 1024  # a fiftieth of a grid spacing
    True
    >>> abs(float(found.pressure.max() / (mean * 2 / 0.5**0.5)) - 1) < 1e-6  # the solver's tolerance
    True

    Several loads in one call, such as the contact area over the load of a measured surface:

    >>> rough = gfmdlayer.SelfAffine(hurst=0.8, rms_slope=0.1, short_cutoff=0.05, seed=1)
    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), rough, mean_pressure=[0.01, 0.02], points=(64, 64))
    >>> found.contact_area.dims, bool(found.contact_area[1] > found.contact_area[0])
    (('mean_pressure',), True)

    A parabola on a thin compressible layer, bonded to a rigid base: springs of 2 G (1 - nu)/((1 - 2 nu) d),
    so that the force per length is 4/3 of this times depth^(3/2) (2 R)^(1/2), but for terms in (d/a)^2.

    >>> bonded = gfmdlayer.bonded_layer(0.0005, 1.0, poisson=0.25)
    >>> found = gfmdlayer.solve(bonded, lambda x: -x**2 / 2, depth=0.005, points=4096)
    >>> spring = 2 * 0.75 / (0.5 * 0.0005)
    >>> abs(float(found.force / (4 / 3 * spring * 0.005**1.5 * 2**0.5)) - 1) < (0.0005 / 0.1) ** 2
    True

    Cattaneo: under a tangential force Q < mu F the edge of the contact of a cylinder slips, and the middle
    sticks over the part (1 - Q/(mu F))^(1/2) of the contact.

    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=0.25), force=0.01,
    ...                         points=1024, friction=0.4, tangential_force=0.003)
    >>> abs(float(found.stick_area / found.contact_area) - (1 - 0.003 / (0.4 * 0.01)) ** 0.5) < 0.01
    True
    """
    body = _at_rest(body_of(body, "mean_stiffness", "spectrum"), glassy=instantaneous)
    given_friction = {
        "friction": friction, "tangential_force": tangential_force,
        "tangential_displacement": tangential_displacement, "previous": previous,
    }  # fmt: skip
    frictional = {name: value for name, value in given_friction.items() if value is not None}
    solver = {"method": method, "tolerance": tolerance, "inertia": inertia, "max_iterations": max_iterations}
    solver = {name: value for name, value in solver.items() if value is not None}
    surface = surface_of(punch, points, period)
    sections: dict[str, Any] = {"punch": punch} if isinstance(surface.heights, Mapping) else {}
    if isinstance(interface, Interface | Mapping | Sequence):
        sections["interface"] = interface
    elif not hasattr(interface, "traction"):
        allowed = "must be a law such as Exponential(work=..., range=...), its keys, or a list of laws"
        raise ConfigError([f"interface: got {shown(interface)}; {allowed}"])
    config = _config({"points": surface.points, "period": surface.period}, solver, sections)
    grid = Grid(config.grid.points, config.grid.period)
    _check_grid(body, grid)
    law: Interaction = Drives(config).interface if "interface" in sections else interface  # type: ignore[assignment]
    if frictional and "friction" not in frictional:
        raise ConfigError([f"{name}: only with friction; remove it" for name in frictional])
    boundary = _boundary(isolated, grid, datum)
    if mean_pressure is not None and boundary:
        raise ConfigError(["mean_pressure: given with isolated=True; must be depth or force"])
    name, values = _prescribed(depth, mean_pressure, force, law)
    heights = _heights(config.punch if isinstance(surface.heights, Mapping) else surface.heights, grid)
    stiffness = math.inf if boundary else body.mean_stiffness
    if name == "depth" and (message := too_deep(max(values), float(heights.mean()), stiffness)):
        raise ConfigError([f"depth: {message}"])
    given = _Asked(config, grid, body, heights, (name, values[0]), law, instantaneous, boundary)
    found = list(_in_turn(given, name, values, frictional, solver))
    for note in surface.notes:
        warn(note)
    several = np.ndim(next(value for value in (depth, mean_pressure, force) if value is not None)) > 0
    whole = _along_loads(name, values, found) if several else found[0]
    known = {"read": surface.account, "unit_of_length": surface.unit}
    whole.attrs |= {key: text for key, text in known.items() if text}
    from gfmdlayer.figures.contact_data import with_plot

    return with_plot(whole)


def _boundary(isolated: bool | Sequence[bool], grid: Grid, datum: float | None) -> Boundary | None:
    """Return the axes without images, and the datum; None for a periodic cell."""
    axes = len(grid.points)
    alone = [isolated] * axes if isinstance(isolated, bool | np.bool_) else list(np.atleast_1d(isolated))
    if len(alone) != axes or not all(isinstance(each, bool | np.bool_) for each in alone):
        allowed = "must be True or False" + ", or a pair of them, along x and y" * (axes == 2)
        raise ConfigError([f"isolated: got {shown(isolated)}; {allowed}"])
    if any(alone):
        return Boundary(tuple(map(bool, alone)), datum)
    if datum is not None:
        raise ConfigError(["datum: only with isolated=True; remove it"])
    return None


def _in_turn(
    given: _Asked, name: str, values: Sequence[float], frictional: dict[str, Any], solver: Mapping[str, Any]
) -> Iterator[xarray.Dataset]:
    """Yield the contacts at several loads, each from the one before."""
    area = math.prod(given.grid.period) if name == "force" else 1.0
    for number, value in enumerate(values):
        target = "depth" if name == "depth" else "load", value / area
        given = replace(given, target=target, number=number, more=number + 1 < len(values))
        solve_with: Callable[[_Asked], xarray.Dataset] = _without_friction
        if frictional:
            solve_with = partial(with_friction, solver=solver, **frictional)
        if given.boundary is None:
            found = solve_with(given)
        else:
            try:
                found = _without_images(given, solve_with, friction=bool(frictional))
            except ValueError as error:
                if isinstance(error, ConfigError):
                    raise
                raise ConfigError([f"isolated: {error}"]) from None
        if frictional:
            frictional = {**frictional, "previous": found}
        yield found


def _along_loads(name: str, values: Sequence[float], found: Sequence[xarray.Dataset]) -> xarray.Dataset:
    """Return the contacts at several loads along a dimension, which has the prescribed values."""
    import xarray

    about = found[0][name].attrs if name in found[0] else {}
    along = xarray.DataArray([*values], dims=name, name=name, attrs=about)
    return xarray.concat(
        [each.drop_vars(name, errors="ignore") for each in found], along, combine_attrs="override"
    )


def _at_rest(body: Body, *, glassy: bool) -> Body:
    """Return the body with one modulus in place of each law, where some are continuous or liquids."""
    laws: Sequence[Law] = getattr(body, "laws", ())
    if not any(isinstance(law, ContinuousLaw) or not law.relaxed for law in laws):
        return body
    moduli = [law.glassy if glassy else law.relaxed for law in laws]
    if not all(0 < modulus < math.inf for modulus in moduli):
        how = "instantaneous" if glassy else "relaxed"
        bad = next(law for law, modulus in zip(laws, moduli, strict=True) if not 0 < modulus < math.inf)
        words = "give instantaneous=True, or run it over time" if not glassy else "run it over time"
        number = "infinite" if glassy else "0"
        raise ConfigError([f"body: the {how} modulus of {type(bad).__name__} is {number}; {words}"])
    return cast("Any", body).with_series(list(map(Elastic, moduli)), 0.0)  # type: ignore[no-any-return]


class _TooWideError(ConvergenceError):
    """An isolated contact is wider than the reach in its cell."""


@dataclass(frozen=True)
class _Asked:
    """A contact on a grid, which is the cell of an isolated one."""

    config: Config
    grid: Grid
    body: Body
    heights: FloatArray
    target: tuple[str, float]  # "depth" or "load", and its value
    interface: Interaction
    glassy: bool
    boundary: Boundary | None = None  # of an isolated contact
    wider: WiderCell | None = None  # which the grid is, if the user sees less
    number: int = 0  # of the load, of several
    more: bool = False  # whether another one follows
    kept: dict[tuple[int, ...], NormalContact] = field(default_factory=dict)  # of loads before, by their grid

    def inside(self, wider: WiderCell) -> _Asked:
        """Return the contact in a wider cell."""
        control, target = self.target
        if control == "load":
            target *= math.prod(wider.period) / math.prod(wider.whole.period)
        return replace(
            self, config=within(self.config, wider), grid=wider.whole, wider=wider,
            heights=wider.extended(self.heights), target=(control, target),
        )  # fmt: skip

    def seen(self, field: NDArray[Any]) -> NDArray[Any]:
        """Return the part of a field, one value a point, that the user sees."""
        whole = np.reshape(field, self.grid.shape)
        return whole if self.wider is None else self.wider.seen(whole)

    def within(self, field: FloatArray, outside: float) -> FloatArray:
        """Return a field that the user sees on the points of the cell."""
        wider = self.wider
        return np.ravel(field) if wider is None else replace(wider, above=outside).extended(field)

    def warn(self, reach: Reach) -> None:
        """Warn where the contact ends with the window."""
        if self.wider is not None and reach.at_the_edge(self.wider.points):
            warn(EDGE.replace("grid.", ""))

    def dataset(self, fields: Mapping[str, Any], scalars: Mapping[str, Any], *known: Any) -> xarray.Dataset:
        """Return what the user sees, with totals of an isolated contact."""
        area = math.prod(self.grid.period)
        grid = self.grid if self.wider is None else Grid(self.wider.points, self.wider.period)
        seen = {name: self.seen(field) for name, field in fields.items()}
        found = dataset(grid, seen, totals(scalars, area) if self.boundary else scalars, *known)
        if self.wider is not None:
            found.attrs["cell"] = self.wider.account
        return found


def _without_images(
    given: _Asked, solve_with: Callable[[_Asked], xarray.Dataset], *, friction: bool
) -> xarray.Dataset:
    """Solve an isolated contact in the cell that the user sees, or in the larger one that it needs."""
    try:
        return solve_with(given)
    except (_TooWideError, ValueError) as error:
        if isinstance(error, ConfigError):
            raise
        control, target = given.target
        assert given.boundary is not None
        wider = wider_cell(
            given.body, given.grid, given.heights, target, given.boundary,
            rates=(math.inf if given.glassy else 0.0,), by_depth=control == "depth", friction=friction,
            larger=True, interface=given.interface,
        )  # fmt: skip
        if wider is None:
            raise
    return solve_with(given.inside(wider))


def _without_friction(given: _Asked) -> xarray.Dataset:
    """Return the contact under a load or at a depth."""
    config, grid, body, law = given.config, given.grid, given.body, given.interface
    response = body if given.boundary is None else without_images(body, grid.period, given.boundary)
    control, target = given.target
    loading = Loading(given.heights, Constant(target), law, by_depth=control == "depth")
    spectrum = response.spectrum(grid.waves)
    kappa = np.ravel(spectrum.glassy) if given.glassy else _in_the_end(spectrum)
    nothing = np.zeros(kappa.shape, dtype=np.complex128)
    if (contact := given.kept.get(grid.points)) is None:
        contact = NormalContact(Parts(config, grid=grid, body=body, punch=given.heights, interface=law))
        given.kept[grid.points] = contact
    problem = contact.imprint.under(loading.problem(kappa, nothing, 0.0))
    if message := _beyond_the_hardness(problem.mean_pressure, law, problem.hardness):
        raise ConfigError([message])
    solution = contact.solve(problem, given.number)
    if is_pulled_off(problem.mean_pressure, solution.gap, law):
        reason = f"PULLED OFF: no contact carries the mean pressure of {target:.6g}"
        raise ConvergenceError(reason, problem, solution)
    if not solution.converged:
        solver = config.solver
        reason = why_not_converged(problem, solution, solver.method, solver.tolerance)
        raise ConvergenceError(reason, problem, solution)
    reach = Reach(grid, response.boundary, response) if isinstance(response, IsolatedBody) else None
    if reach is not None:
        noise = config.solver.tolerance * law.strength
        if beyond := reach.refusal(solution.pressure, noise):
            raise _TooWideError(beyond, problem, solution)
        reach.remember(solution.pressure, noise)
        given.warn(reach)
    contact.imprint.remember(solution.flow)
    if given.more:
        start = getattr(solution, contact.solver.starts_from)
        contact.guess.remember(given.number, start, solution.gap, at_breakpoint=True)
    points = int(in_contact(problem, solution).sum())
    if 0 < points < FEWEST and is_upside_down(problem.obstacle, grid):
        warn(f"{points} point{'s' * (points > 1)} in contact; {UPSIDE_DOWN}")
    surface = loading.surface(solution, kappa, nothing, 0.0)
    _warn_of_strain(body, grid, kappa, solution, surface.depth)
    parts = _parts(contact.parts, surface, glassy=given.glassy) if reach is None else {}
    if contact.imprint.yields:
        parts |= {"imprint": contact.imprint.depth}
    return _dataset(given, problem, solution, surface, reach, parts)


def _check_grid(body: Body, grid: Grid) -> None:
    """Raise a ConfigError if the grid does not suit a body, or one of a pair."""
    if isinstance(body, Pair):
        _check_grid(body.first, grid)
        _check_grid(body.second, grid)
    elif isinstance(body, Solid):
        problems = body.problems_on_grid(grid.points, grid.period)
        if messages := [f"body.{problem.key}: {problem.message}" for problem in problems]:
            raise ConfigError(messages)


def _config(grid: Mapping[str, Any], solver: Mapping[str, object], sections: Mapping[str, Any]) -> Config:
    """Return the checked configuration of grid, solver, and a punch or an interface given by its keys."""
    data, text = {"name": "solve", "grid": grid, "solver": solver, **sections}, ""
    if not sections:  # which may name files
        with suppress(TypeError):  # of values that are refused
            text = json.dumps(plain(data))
    try:
        return _config_of(text) if text else from_python(data)
    except ConfigError as error:
        lines = (line.removeprefix("grid.").removeprefix("solver.") for line in error.problems)
        raise ConfigError(lines) from None


@made_once(lambda _: 1 << 10)
def _config_of(text: str) -> Config:
    return from_python(json.loads(text))


def _in_the_end(spectrum: Spectrum) -> FloatArray:
    """Return the relaxed stiffness; ConfigError for a liquid, which has none."""
    relaxed = np.ravel(spectrum.relaxed)
    if not relaxed.any():
        message = "relaxes to nothing, as a liquid does; give instantaneous=True, or run it over time"
        raise ConfigError([f"body: {message}"])
    return relaxed


def _prescribed(
    depth: Any, mean_pressure: Any, force: Any, interface: Interaction
) -> tuple[str, list[float]]:
    """Return the prescribed quantity and its values."""
    values = {"depth": depth, "mean_pressure": mean_pressure, "force": force}
    prescribed = {name: value for name, value in values.items() if value is not None}
    if len(prescribed) != 1:
        names = " and ".join(prescribed) or "nothing"
        raise ConfigError([f"solve: got {names}; must be one of depth, mean_pressure and force"])
    ((name, value),) = prescribed.items()
    found = numbers_in(value)
    least = -math.inf if interface.attracts else 0.0
    if found.ndim != 1 or not found.size or not (np.isfinite(found).all() and (found >= least).all()):
        raise ConfigError([f"{name}: got {shown(value)}; must be a number >= 0, finite, or several"])
    return name, found.tolist()


def _heights(punch: ArrayLike | Callable[..., ArrayLike] | Shape, grid: Grid) -> FloatArray:
    """Return heights above the lowest point, one value a point."""
    if not isinstance(punch, Shape):
        outward = outward_heights(punch, grid).ravel()
        return np.asarray(outward.max() - outward)
    if misfits := list(punch.misfits(Cell(grid.points, grid.period))):
        raise ConfigError(f"punch.{each}" for each in misfits)
    try:
        return fitting("punch", punch.heights(grid), grid.shape).ravel()
    except TableError as error:
        raise ConfigError([f"punch: {error}"]) from None


def _beyond_the_hardness(target: float | None, law: Interaction, hardness: float) -> str:
    """Return why surfaces of a hardness do not bear the attraction or the mean pressure, or ""."""
    if message := weak(law, hardness):
        return f"interface: {message}"
    flow_stress = law.flow_stress(hardness)
    if target is None or target < flow_stress:
        return ""
    most = f"the hardness {hardness!r}"
    if law.attracts:
        most = f"{flow_stress:.6g}, {most} less the attraction in contact"
    return f"mean pressure: got {target!r}; must be below {most}"


def _warn_of_strain(body: Body, grid: Grid, kappa: FloatArray, solution: Solution, depth: float) -> None:
    """Warn of a strain beyond small ones: mean pressure in contact over K(q)/q, or depth over all layers."""
    if not solution.contact_area > 0:
        return
    q = np.ravel(grid.wavenumbers)
    moduli = kappa[q > 0] / q[q > 0]
    strain = solution.mean_pressure / solution.contact_area / float(moduli.max(initial=1e-300))
    thickness = sum(getattr(body, "thicknesses", ())) or math.inf
    if thickness < math.inf:
        strain = min(strain, abs(depth) / thickness)
    if strain > MOST_STRAIN:
        words = "linear elasticity, of small strains, does not hold"
        warn(f"STRAINED: by about {strain:.2g} under the contact; {words}")


def _parts(parts: Parts, surface: Surface, *, glassy: bool) -> dict[str, FloatArray]:
    """Return the displacement of each body of a pair; nothing for one body."""
    body = parts.body
    if not isinstance(body, Pair):
        return {}
    part = np.ravel(body.part_of_second(parts.grid.waves, glassy=glassy))
    second = parts.transforms.backward(part * surface.spectrum) / parts.grid.size
    first = parts.transforms.backward((1 - part) * surface.spectrum) / parts.grid.size
    return {"displacement_body": first, "displacement_counterbody": second}


def _dataset(
    given: _Asked,
    problem: Problem,
    solution: Solution,
    surface: Surface,
    reach: Reach | None,
    parts: Mapping[str, FloatArray],
) -> xarray.Dataset:
    """Return fields and scalars of a solution; an isolated contact has a `reach`."""
    touching, grid = in_contact(problem, solution), given.grid
    extent = contact_extent(touching, solution.wall_pressure, solution.gap, grid)
    fields = {
        "displacement": surface.displacement,
        "pressure": solution.pressure,
        "gap": np.where(touching, 0.0, solution.gap),
        "contact": touching,
        **parts,
    }
    scalars = {
        "contact_area": solution.contact_area,
        "contact_area_interpolated": extent.area,
        "contact_area_error": extent.error,
        "mean_pressure": solution.mean_pressure,
        "force": solution.mean_pressure * math.prod(grid.period),
        "depth": surface.depth,
        "residual": solution.residual,
        "transforms": solution.transforms,
        "iterations": solution.iterations,
    }
    if reach is not None:
        fields |= {name: reach.masked(np.asarray(fields[name], float)) for name in ("displacement", "gap")}
    return given.dataset(fields, scalars)


# With friction: one step of a punch that sticks and slips.

_TOLERANCE, _LIMIT = 1e-7, 60  # residual and Newton steps, where nothing is given


def with_friction(
    given: _Asked,
    *,
    solver: Mapping[str, Any],
    friction: float | Mapping[str, float],
    tangential_force: float | Sequence[float] | None = None,
    tangential_displacement: float | Sequence[float] | None = None,
    previous: xarray.Dataset | None = None,
) -> xarray.Dataset:
    """Return the contact under a load or at a depth, and under shear."""
    if "method" in solver:
        raise ConfigError(["method: not with friction, which has one solver; remove it"])
    if tangential_force is not None and tangential_displacement is not None:
        raise ConfigError(["tangential_force: given with tangential_displacement; must be one of the two"])
    grid, interface = given.grid, given.interface
    response, axes = _response(given, given.body), len(grid.points)
    imprint = Imprint(given.heights.size, given.config.hardness or math.inf)
    method = FrictionSolver(grid, Transforms(grid.points), attracts=interface.attracts, yields=imprint.yields)
    moved, before, start, gap = _taken_from(previous, given)
    if imprint.yields and previous is not None and "imprint" in previous:
        imprint.remember(given.within(previous["imprint"].to_numpy(), 0.0))
    if given.boundary and start is not None:  # the displacements of a result are not known everywhere
        before = method.displacements(response, start)[1:]
    force, at = None, moved
    if tangential_force is not None:
        force = _components("tangential_force", tangential_force, axes) / math.prod(grid.period)
    if tangential_displacement is not None:
        at = _components("tangential_displacement", tangential_displacement, axes)
    control, value = given.target
    problem = FrictionProblem(
        response,
        imprint.on(given.heights),
        _law(friction),
        load=value if control == "load" else None,
        depth=value if control == "depth" else 0.0,
        force=force,
        path=None if force is not None else at - moved,
        before=before,
        interface=interface,
        hardness=imprint.hardness,
    )
    _check(problem)
    tolerance, limit = solver.get("tolerance", _TOLERANCE), solver.get("max_iterations", _LIMIT)
    solution = method.solve(problem, start, gap=gap, tolerance=tolerance, limit=limit)
    reach = None if given.boundary is None else Reach(grid, given.boundary)
    if reach is not None:
        noise = tolerance * interface.strength
        if beyond := reach.refusal(solution.stress, noise):
            raise _TooWideError(beyond)
        reach.remember(solution.stress, noise)
        given.warn(reach)
    if not solution.converged:
        raise ConvergenceError(solution.reason)
    imprint.remember(solution.flow)
    own = _of_bodies(given, method, solution) | ({"imprint": imprint.depth} if imprint.yields else {})
    return _frictional_dataset(given, solution, moved + solution.path, reach, own)


def _check(problem: FrictionProblem) -> None:
    """Raise a ConfigError for a problem that has no solution, or no solver."""
    if message := _beyond_the_hardness(problem.load, problem.interface, problem.hardness):
        raise ConfigError([message])
    if reason := problem.why_not_solvable():
        raise ConfigError([f"tangential_force: {reason}"])
    if (problem.interface.attracts or problem.yields) and not problem.response.is_positive:
        raise ConfigError([f"isolated: {NOT_POSITIVE}"])


def _of_bodies(given: _Asked, method: FrictionSolver, solution: FrictionSolution) -> dict[str, FloatArray]:
    """Return the displacement of each body of a pair; nothing for one body."""
    own: dict[str, FloatArray] = {}
    if isinstance(given.body, Pair):
        p, *t = solution.loads
        for name, each, sign in (("body", given.body.first, 1), ("counterbody", given.body.second, -1)):
            loads = np.stack((p, *(sign * along for along in t)))
            own[f"displacement_{name}"] = -method.displacements(_response(given, each), loads)[0]
    return own


def _response(given: _Asked, body: Any) -> AnyResponse:
    """Return the response of a body in all directions, relaxed or to a sudden load."""
    grid, glassy = given.grid, given.glassy
    for each in (body.first, body.second) if isinstance(body, Pair) else (body,):
        if not hasattr(each, "traction_spectrum"):
            needed = "must be a halfspace or layers, or have the method traction_spectrum"
            raise ConfigError([f"body: {type(each).__name__} has no response to shear; {needed}"])
    if given.boundary:
        creep = kernels_without_images(body, grid, given.boundary)
        return creep.with_weights(np.full(creep.times.size, 0.0 if glassy else 1.0))
    if isinstance(body, Pair):
        one, two = (_response(given, each) for each in (body.first, body.second))
        return cast("Response", one).beside(cast("Response", two))
    spectrum = body.traction_spectrum(grid.waves)
    plane, across = spectrum.in_plane, spectrum.across
    if glassy:
        return Response.of_stiffness(plane.glassy, across.glassy)
    return Response.of_stiffness(plane.relaxed, across.relaxed)


def _law(friction: float | Mapping[str, float]) -> ShearBound:
    """Return the bound of the shear traction."""
    limits = dict(friction) if isinstance(friction, Mapping) else {"coefficient": friction}
    if not limits or set(limits) - {"coefficient", "strength"}:
        keys = ", ".join(map(str, limits)) or "nothing"
        raise ConfigError([f"friction: got {keys}; must be a number, or a mapping of coefficient, strength"])
    for name, value in limits.items():
        limits[name] = number_in(value)
        if not limits[name] >= 0:
            raise ConfigError([f"friction.{name}: got {shown(value)}; must be a number >= 0"])
    return ShearBound(limits.get("coefficient", math.inf), limits.get("strength", math.inf))


def _components(name: str, value: float | Sequence[float], axes: int) -> FloatArray:
    """Return the components along the axes; of a number, that along x."""
    components = numbers_in(value)
    if components.ndim > 1 or components.size > axes or not np.isfinite(components).all():
        allowed = "a number" if axes == 1 else "a number, or a pair along x and y"
        raise ConfigError([f"{name}: got {shown(value)}; must be {allowed}, finite"])
    return np.concatenate((components, np.zeros(axes - components.size)))


def _taken_from(
    previous: xarray.Dataset | None, given: _Asked
) -> tuple[FloatArray, FloatArray | None, FloatArray | None, FloatArray | None]:
    """Return place of the punch, tangential displacements, tractions and gap of a result."""
    axes = "xy"[: len(given.grid.points)]
    if previous is not None and not hasattr(previous, "data_vars"):
        raise ConfigError([f"previous: got {shown(previous)}; must be a result of solve with friction"])
    shape = given.grid.shape if given.wider is None else given.wider.points
    if previous is None:
        return np.zeros(len(axes)), None, None, None
    for name in ("displacement", "shear", "tangential_displacement"):
        for axis in axes:
            if f"{name}_{axis}" not in previous:
                must = "must be a result of solve with friction"
                raise ConfigError([f"previous: has no {name}_{axis}; {must}"])
    if previous["pressure"].shape != shape:
        shapes = f"{previous['pressure'].shape}; must be {shape}"
        raise ConfigError([f"previous: has the shape {shapes}"])

    def fields(name: str) -> list[FloatArray]:
        return [given.within(previous[f"{name}_{axis}"].to_numpy(), 0.0) for axis in axes]

    moved = np.array([float(previous[f"tangential_displacement_{axis}"]) for axis in axes])
    pressure = given.within(previous["pressure"].to_numpy(), 0.0)
    gap = given.within(np.nan_to_num(previous["gap"].to_numpy(), nan=math.inf), math.inf)
    return moved, np.array(fields("displacement")), np.array([pressure, *fields("shear")]), gap


def _frictional_dataset(
    given: _Asked,
    solution: FrictionSolution,
    moved: FloatArray,
    reach: Reach | None,
    own: Mapping[str, FloatArray],
) -> xarray.Dataset:
    """Return fields and scalars of a solution; isolated contacts have a `reach`, two bodies `own` fields."""
    grid = given.grid
    area, touching = math.prod(grid.period), solution.contact
    gap = np.where(touching, 0.0, np.maximum(solution.gap, 0.0))
    extent = contact_extent(touching, solution.pressure, gap, grid)
    fields = {
        "pressure": solution.stress,
        "displacement": -solution.displacement[0],
        "gap": gap,
        "contact": touching,
        "stick": solution.stick,
        **own,
    }
    scalars = {
        "contact_area": touching.mean(),
        "contact_area_interpolated": extent.area,
        "contact_area_error": extent.error,
        "stick_area": solution.stick.mean(),
        "mean_pressure": solution.stress.mean(),
        "force": solution.stress.mean() * area,
        "depth": solution.depth,
        "residual": solution.residual,
        "transforms": solution.pairs,
        "iterations": solution.iterations,
    }
    for i, axis in enumerate("xy"[: len(grid.points)]):
        fields[f"shear_{axis}"] = solution.traction[i]
        fields[f"slip_{axis}"] = np.where(touching, solution.slip[i], np.nan)
        fields[f"displacement_{axis}"] = solution.displacement[1 + i]
        scalars[f"tangential_force_{axis}"] = solution.traction[i].mean() * area
        scalars[f"tangential_displacement_{axis}"] = moved[i]
    if reach is not None:
        known = [name for name in fields if name == "gap" or name.startswith("displacement")]
        fields |= {name: reach.masked(np.asarray(fields[name], float)) for name in known}
    return given.dataset(fields, scalars, _MEANINGS)


def _along(axis: str) -> dict[str, dict[str, str]]:
    """Meanings of components along an axis."""
    return {
        f"shear_{axis}": meaning(f"shear traction of the punch on the surface along {axis}", "pressure"),
        f"slip_{axis}": meaning(f"slip of the surface against the punch in the step along {axis}", "length"),
        f"displacement_{axis}": meaning(f"displacement of the surface along {axis}", "length"),
        f"tangential_force_{axis}": meaning(
            f"force of the punch along {axis}, of a line per length", "pressure area"
        ),
        f"tangential_displacement_{axis}": meaning(f"displacement of the punch along {axis}", "length"),
    }


_MEANINGS = {
    **MEANINGS,
    **_along("x"),
    **_along("y"),
    "stick": meaning("whether the point is in contact and below the bound of friction"),
    "stick_area": meaning("area of the points that stick, relative; of an isolated contact, the area itself"),
    "residual": meaning("residual of the frictional contact"),
    "transforms": meaning("pairs of Fourier transforms of one component; half for single precision"),
    "iterations": meaning("Newton steps"),
}
