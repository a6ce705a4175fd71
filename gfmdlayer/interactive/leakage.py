"""`gfmdlayer.leakage`: flow through the gap of stored snapshots, as labelled data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gfmdlayer.body.body import Body
from gfmdlayer.body.wavevectors import Wavevectors
from gfmdlayer.config import ConfigError
from gfmdlayer.config.reader import body_of
from gfmdlayer.errors import warn
from gfmdlayer.interactive.one_contact import check_data, config_of, derived
from gfmdlayer.observables.transport import CRITICAL_GAPS, FLOW, THROATS
from gfmdlayer.transport.leakage import doubts, flow_through, mean_under_fluid, numbers_of
from gfmdlayer.transport.percolation import Throat, throats
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import shown

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.arrays import FloatArray

LIFTS = 0.1  # of the critical gap, or of the contact pressure, from which a fluid changes the gap
MOST_SAID = 20  # warnings
LEVELS = 9  # of the fluid pressure, for contacts under a reduced load
ALIKE = 0.1  # of the flow, by which a body that relaxes by several laws differs from one of its relaxed shape
_LONG_NAMES = {
    "flow_error_x": ("difference of flow_xx by the linear and the harmonic mean, relative", "1"),
    "flow_error_y": ("difference of flow_yy by the linear and the harmonic mean, relative", "1"),
    "pressure_drop": ("pressure drop of the fluid over the seal", "pressure"),
    "leak_rate": ("volume of fluid per time through the seal", "length^3 / time"),
    "leak_rate_low": ("lower end of the interval of doubt of the leak rate", "length^3 / time"),
    "leak_rate_high": ("upper end of the interval of doubt of the leak rate", "length^3 / time"),
    "leak_rate_per_width": ("volume of fluid per time and width of the seal", "length^2 / time"),
    "leak_rate_one_way": ("leak rate if the fluid did not lift the surface", "length^3 / time"),
    "lift": ("rise of the surface at the throat under the drop of pressure, over the critical gap", "1"),
    "fluid_pressure": ("pressure of the fluid over its drop across the cell, 0 on average", "1"),
    "flow_x": ("flow per width along x times 12 viscosities over the drop per length", "length^3"),
    "flow_y": ("flow per width along y times 12 viscosities over the drop per length", "length^3"),
}


@entry()
def leakage(
    data: xarray.Dataset,
    *,
    viscosity: float | None = None,
    pressure_drop: float | Sequence[float] | None = None,
    along: Literal["x", "y"] = "x",
    length: float | None = None,
    width: float | None = None,
    diameter: float | None = None,
    coupled: bool = False,
    body: Body | Mapping[str, Any] | None = None,
    fields: bool = False,
    trust: bool = False,
) -> xarray.Dataset:
    """Return the flow of a thin fluid film through the gap of a contact, by the Reynolds equation.

    Parameters
    ----------
    data : xarray.Dataset
        With the gap along x, or x and y, and any further dimensions: from `run`, `solve`, `open_case` or
        `open_results`.
    viscosity : float, optional
        Of the fluid, pressure time; with `pressure_drop` it gives the leak rate.
    pressure_drop : float, or sequence of float, optional
        Over the length of the seal; of several, the result has a dimension of this name.
    along : {"x", "y"}
        Direction of the drop. Along y, on a line, the fluid flows along the ridges.
    length, width : float, optional
        Of the seal, along the flow and across it; default: length and width of the cell, and 1 along the
        ridges of a line.
    diameter : float, optional
        Of a ring, whose width is pi times it.
    coupled : bool
        Whether the fluid lifts the surface: its pressure, which falls along the seal from the drop to zero,
        takes the place of contact pressure, in a seal of many cells that is pressed by the mean pressure of
        the snapshot. The contacts under reduced loads are solved again.
    body : Body or mapping, optional
        For the lift of the surface, and for `coupled`; default: the body of the case's configuration.
    fields : bool
        Whether to return the pressure and the flow at each point of a surface.
    trust : bool
        Run the Python code that the configuration names as its body; without it there is no lift.

    Returns
    -------
    xarray.Dataset
        The flow tensor K, flow_xx, flow_xy, flow_yy [length^3]: the mean flow per width is K.G/(12 viscosity)
        for a drop of pressure per length G. Hydraulic gaps K_xx^(1/3), K_yy^(1/3); critical gaps; points
        across the throats; flow_imbalance, a check of the solver; flow_error_x, flow_error_y, an estimate of
        the error of the grid. All flows are exactly zero if contact closes the cell. With viscosity and drop
        also leak_rate [length^3/time], its interval of doubt leak_rate_low to leak_rate_high,
        leak_rate_per_width, and lift, the rise of the surface over the critical gap. If `coupled`,
        leak_rate_one_way is that without the lift, and the rates are NaN from the drop on that lifts the seal
        off. With `fields` fluid_pressure, flow_x and flow_y.

    Raises
    ------
    ConfigError
        If an argument cannot be used, or there is no gap.

    Warns
    -----
    UserWarning
        If a throat has fewer than 6 points, if the contact is solved too loosely for the gap of a throat, or
        if the fluid would lift the surface.

    Notes
    -----
    Finite volumes with harmonic means (docs/theory/transport.md). For an ideal gas with the pressures P_in
    and P_out, take (P_in^2 - P_out^2)/(2 P_out) for the drop; the leak rate is then that at the outlet.

    The interval of doubt has the difference of both means of the conductance, the residual of the contact,
    and the lift if it is not computed.

    Examples
    --------
    Ridges 1 + e cos 2 pi x out of contact: K is mean(g^3) along them, 1/mean(g^-3) across.

    >>> import xarray as xr
    >>> x = np.arange(64) / 64
    >>> gap = xr.DataArray(np.repeat(1 + 0.7 * np.cos(2 * np.pi * x)[:, None], 64, axis=1),
    ...                    coords={"x": x, "y": x}, dims=("x", "y"))
    >>> found = gfmdlayer.leakage(gap.to_dataset(name="gap"), viscosity=0.001, pressure_drop=12.0)
    >>> float(found.flow_yy.round(6)), float(found.flow_xx.round(5)), float(found.leak_rate.round(2))
    (1.735, 0.1492, 149.2)
    """
    several = pressure_drop is not None and np.ndim(pressure_drop) > 0
    drops = None if pressure_drop is None else np.atleast_1d(np.asarray(pressure_drop))
    seal = {"viscosity": viscosity, "length": length, "width": width, "diameter": diameter}
    check_data(data)
    grid = _grid(data, along, seal, drops, coupled=coupled)
    leads = [str(name) for name in data["gap"].dims if name not in grid]
    gaps = data["gap"].transpose(*leads, *grid)
    spacing = {name: float(data[name][1] - data[name][0]) for name in grid}
    period = tuple(spacing[name] * data.sizes[name] for name in grid)
    cell = (*period, 1.0)[:2] if along == "x" else (*period, 1.0)[1::-1]  # 1 along the ridges of a line
    if diameter is not None:
        width = math.pi * diameter
    width = width or cell[1]
    rates = None  # of a flow of 1
    if viscosity is not None and drops is not None:
        rates = drops / (12 * viscosity) / (length or cell[0]) * width
    solid = None if body is None else body_of(body)
    if body is None and drops is not None:
        solid = _solid_of(data, trust=trust, coupled=coupled)
    shape = tuple(data.sizes[name] for name in leads)
    quantities: dict[str, FloatArray] = {}
    said: list[str] = []
    for at in np.ndindex(*shape):
        here = dict(zip(leads, at, strict=True))
        gap = gaps.isel(here).to_numpy()
        if np.isnan(gap).any():
            continue
        row, fluid, narrow, linear = _flow(gap, period, along)
        state = data.isel({name: i for name, i in here.items() if name in data.dims})
        reasons: list[str] = []
        depth, residual = _depth_and_residual(state)
        for axis, throat in narrow.items():
            reasons += doubts(axis, throat, depth, residual, gap.shape)
        lift = np.zeros(1 if drops is None else drops.size)
        if drops is not None and along in narrow:
            lift, more = _lift(narrow[along], gap, state, spacing, solid, drops)
            row |= {} if solid is None else {"lift": lift}
            reasons += [] if coupled else more
        if rates is not None and drops is not None:
            K = row[f"flow_{along}{along}"]
            loose = 3 * residual * depth / narrow[along].gap if K > 0 and along in narrow else 0.0
            doubt = min(1.0, linear / K) / (1 + loose) if K > 0 else 1.0
            excess = max(1.0, linear / K) * (1 + loose) if K > 0 else 1.0
            one_way = np.full(drops.size, K)
            mean, low, high = one_way, one_way, one_way * (1 + np.where(np.isnan(lift), 0.0, lift)) ** 3
            if coupled:
                assert solid is not None
                (mean, low, high), more = _under_fluid(state, gap, grid, period, solid, along, K, drops)
                row["leak_rate_one_way"], reasons = rates * one_way, reasons + more
            row |= {"leak_rate": rates * mean, "leak_rate_per_width": rates * mean / width}
            row |= {"leak_rate_low": rates * low * doubt, "leak_rate_high": rates * high * excess}
        if fields and len(grid) == 2:
            row |= dict(zip(("fluid_pressure", "flow_x", "flow_y"), fluid, strict=True))
        for name, value in row.items():
            one = value if several or name not in _OF_DROPS else np.squeeze(value)
            quantities.setdefault(name, np.full((*shape, *np.shape(one)), np.nan))[at] = one
        when = f"t = {float(state['snapshot']):.6g}: " if "snapshot" in state.coords else ""
        said += [when + reason for reason in reasons]
    if (further := len(said) - MOST_SAID) > 0:
        said[MOST_SAID:] = [f"{further} more doubts of this kind"]
    for text in said:
        warn(text)
    columns = (*FLOW, *THROATS, *CRITICAL_GAPS)
    meanings = {column.name: (column.long_name, column.units) for column in columns} | _LONG_NAMES
    values = {
        name: ([*leads, *_further(name, grid, several=several)], array) for name, array in quantities.items()
    }
    kept = {*leads, *(grid if "fluid_pressure" in quantities else ())}
    coords = {"pressure_drop": ("pressure_drop", drops)} if several and drops is not None else None
    result = derived(data, values, meanings, kept, coords)
    return result.assign_attrs(warnings="\n".join(said)) if said else result


_OF_DROPS = "lift", *(name for name in _LONG_NAMES if name.startswith("leak_rate"))
_FIELDS = "fluid_pressure", "flow_x", "flow_y"


def _further(name: str, grid: tuple[str, ...], *, several: bool) -> tuple[str, ...]:
    """Return the dimensions of a quantity beside those of the snapshots."""
    if name in _FIELDS:
        return grid
    return ("pressure_drop",) if several and name in _OF_DROPS else ()


def _solid_of(data: xarray.Dataset, *, trust: bool, coupled: bool) -> Body | None:
    """Return the body of the configuration, None if it is not known; ConfigError if `coupled` needs it."""
    try:
        config = config_of(data, trust=trust)
    except ConfigError as error:  # of code, or of files that have moved
        if coupled:
            raise
        warn(f"lift is left out, which needs the body: {error}")
        return None
    if coupled and config is None:
        raise ConfigError(["body: missing; coupled needs the body, which these data do not name"])
    if config is not None and coupled:
        against = {
            "a moving punch": config.trajectory.moves, "attraction": bool(config.interfaces),
            "friction": bool(config.friction), "hardness": config.hardness is not None,
        }  # fmt: skip
        if wrong := [name for name, is_so in against.items() if is_so]:
            raise ConfigError([f"coupled: got a contact with {wrong[0]}; must be a hard wall at rest"])
    return None if config is None else config.solid


def _grid(
    data: xarray.Dataset,
    along: str,
    seal: Mapping[str, float | None],
    drops: FloatArray | None,
    *,
    coupled: bool,
) -> tuple[str, ...]:
    """Return the axes of the gap; ConfigError for data or arguments that cannot be used."""
    wrong = []
    if "gap" not in data or "x" not in data["gap"].dims:
        wrong.append("data: has no gap along x; set output.snapshots and run the configuration again")
    elif data.sizes.get("snapshot", 1) == 0:
        wrong.append("data: has no snapshot; set output.snapshots and run the configuration again")
    elif "reach" in data.attrs or ("config" in data.attrs and "L" not in data.attrs):
        wrong.append("data: an isolated contact has no cell to leak through; must have a periodic grid")
    if along not in ("x", "y"):
        wrong.append(f"along: got {shown(along)}; must be x or y")
    listed = [] if drops is None else drops.ravel().tolist() or [math.nan]
    every = [*seal.items(), *(("pressure_drop", each) for each in listed)]
    for name, value in every:
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if value is not None and not (number and math.isfinite(value) and value > 0):
            wrong.append(f"{name}: got {shown(value)}; must be a number > 0, finite")
    if seal["viscosity"] is None and any(value is not None for value in seal.values()):
        wrong.append("viscosity: missing; length and width of the seal need viscosity and pressure_drop")
    if seal["viscosity"] is not None and drops is None:
        wrong.append("pressure_drop: missing; a leak rate needs viscosity and pressure_drop")
    if seal["width"] is not None and seal["diameter"] is not None:
        wrong.append("diameter: beside width; give one of them, the width of a ring is pi times its diameter")
    if drops is not None and (drops.ndim > 1 or (drops.size > 1 and not (np.diff(drops) > 0).all())):
        wrong.append("pressure_drop: must be one number, or numbers that increase")
    if coupled and seal["viscosity"] is None:
        wrong.append("viscosity: missing; coupled needs viscosity and pressure_drop")
    if coupled and "gap" in data and not {"pressure", "displacement"} <= {*data.data_vars}:
        wrong.append("data: has no pressure or displacement, which coupled needs")
    if wrong:
        raise ConfigError(wrong)
    return tuple(name for name in "xy" if name in data["gap"].dims)


def _flow(
    gap: FloatArray, period: tuple[float, ...], along: str
) -> tuple[dict[str, Any], tuple[FloatArray, ...], dict[str, Throat], float]:
    """Return the numbers of one gap, fields under a drop along an axis, throats, and K by the linear mean."""
    flow, linear = flow_through(gap, period), flow_through(gap, period, "linear").tensor
    K, axis = flow.tensor, "xy".index(along)
    row: dict[str, Any] = {**numbers_of(flow)}
    for i, name in enumerate("xy"):
        row[f"flow_error_{name}"] = linear[i, i] / K[i, i] - 1 if K[i, i] > 0 else 0.0
    if gap.ndim == 1:
        return row, (), {}, K[axis, axis]
    spacing = period[0] / gap.shape[0], period[1] / gap.shape[1]
    narrow = dict(zip("xy", throats(gap, spacing), strict=True))
    for name, throat in narrow.items():
        row |= {f"critical_gap_{name}": throat.gap, f"throat_points_{name}": throat.points}
    return row, (flow.pressure[axis], *flow.flow[axis]), narrow, linear[axis, axis]


def _depth_and_residual(state: xarray.Dataset) -> tuple[float, float]:
    """Return the deepest displacement and the residual of the contact; 0 where they are not known."""
    if "displacement" not in state or "residual" not in state:
        return 0.0, 0.0
    residual = state["residual"].to_numpy()
    if residual.ndim:  # along time, or the rows of a sweep
        residual = residual[int(np.nanargmin(np.abs(state["time"].to_numpy() - float(state["snapshot"]))))]
    return max(-float(state["displacement"].min()), 0.0), float(residual)


def _lift(
    throat: Throat,
    gap: FloatArray,
    state: xarray.Dataset,
    spacing: Mapping[str, float],
    body: Body | None,
    drops: FloatArray,
) -> tuple[FloatArray, list[str]]:
    """Return the rises of the surface at the throat over the critical gap, and doubts about the leak."""
    if throat.gap <= 0:
        return np.zeros(drops.size), []
    said, lifts, drop = [], np.full(drops.size, np.nan), float(drops[-1])
    if body is not None:
        K = float(np.real(np.asarray(body.stiffness([2 * math.pi / throat.width], 0.0))[0]))
        lifts = drops / K / throat.gap if K > 0 else np.full(drops.size, np.inf)
        if (lift := float(lifts[-1])) > LIFTS:
            said.append(
                f"the fluid lifts the surface at the throat by {lift:.2g} of the critical gap: the leak is "
                f"larger than computed; the drop should be below {LIFTS * drop / lift:.2g}"
            )
    if "pressure" in state:
        away = [
            np.abs((np.arange(n) - at + n // 2) % n - n // 2) * h
            for n, at, h in zip(gap.shape, throat.place, spacing.values(), strict=True)
        ]
        near = (np.hypot(away[0][:, None], away[1]) <= throat.width) & (gap <= 0)
        pressure = state["pressure"].transpose("x", "y").to_numpy()
        if near.any() and drop > LIFTS * (beside := float(pressure[near].mean())):
            said.append(
                f"the drop of pressure, {drop:.3g}, is not small against the contact pressure around the "
                f"throat, {beside:.3g}: the fluid opens the seal further"
            )
    return lifts, said


def _under_fluid(
    state: xarray.Dataset,
    gap: FloatArray,
    grid: tuple[str, ...],
    period: tuple[float, ...],
    body: Body,
    along: str,
    K: float,
    drops: FloatArray,
) -> tuple[FloatArray, list[str]]:
    """Return the means of K under the falling pressure of the fluid, their lower and upper ends, and doubts.

    If a body of one law is loaded at once and its contact only grows, displacement and gap are those of the
    relaxed body under a smaller load (Lee and Radok 1960), which follows from the displacement. A fluid that
    has acted since then reduces this load by the same part.
    """
    from gfmdlayer.interactive.solve import solve

    pressure = state["pressure"].transpose(*grid).to_numpy()
    surface = state["displacement"].transpose(*grid).to_numpy()
    load, found = float(pressure.mean()), np.full((3, drops.size), np.nan)
    below = drops < load
    said = []
    if not below.all():
        said.append(
            f"a drop of pressure of {drops[~below][0]:.3g} lifts the seal off, which is pressed with "
            f"{load:.3g}; the leak has no bound"
        )
    if not below.any():
        return found, said
    if (gap <= 0).all():
        found[:, below] = 0.0
        return found, said
    present = _relaxed_load(surface, gap, period, body) / load
    levels = np.linspace(0.0, float(drops[below][-1]), LEVELS)
    contacts = solve(
        body, -(gap + surface), mean_pressure=((load - levels) * present).tolist(), period=_cell(period)
    )
    axis, gaps = "xy".index(along), contacts["gap"].transpose("mean_pressure", *grid).to_numpy()
    flows = np.array([flow_through(each, period).tensor[axis, axis] for each in gaps])
    means, spread = mean_under_fluid(levels, flows, drops[below])
    if K == 0 or flows[0] == 0:  # the outlet is closed: the fluid would have to open it
        found[:, below] = 0.0 * means, 0.0 * means, means
        if flows[-1] > 0:
            said.append("closed at its outlet; the upper end is for a fluid that has opened the seal")
        return found, said
    apart = flows[0] / K  # 1 but for the doubt of the assumption
    if abs(apart - 1) > ALIKE:
        said.append(
            f"the contact solved again has {apart:.3g} times the flow of the snapshot: its body does not "
            "relax by one law, or the load has not grown at once; the interval contains both"
        )
    means, spread = means / apart, spread / apart
    low, high = (means - spread) * min(apart, 1.0), (means + spread) * max(apart, 1.0)
    found[:, below] = means, np.maximum(low, 0.0), high
    return found, said


def _cell(period: tuple[float, ...]) -> float | tuple[float, float]:
    return period[0] if len(period) == 1 else (period[0], period[1])


def _relaxed_load(surface: FloatArray, gap: FloatArray, period: tuple[float, ...], body: Body) -> float:
    """Return the mean pressure under which the relaxed body has this displacement: none where it is open."""
    spacing = [length / n for length, n in zip(period, surface.shape, strict=True)]
    axes = (2 * np.pi * np.fft.fftfreq(n, h) for n, h in zip(surface.shape, spacing, strict=True))
    waves = Wavevectors.of_components(*(q.ravel()[1:] for q in np.meshgrid(*axes, indexing="ij")))
    u = np.fft.fftn(surface).ravel()
    u[1:] *= -np.real(body.stiffness(waves, 0.0))
    u[0] = 0.0
    pressure = np.real(np.fft.ifftn(u.reshape(surface.shape)))
    return -float(pressure[gap > 0].mean())
