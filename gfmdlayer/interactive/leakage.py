"""`gfmdlayer.leakage`: flow through the gap of stored snapshots, as labelled data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gfmdlayer.body.body import Body
from gfmdlayer.config import ConfigError
from gfmdlayer.config.reader import body_of
from gfmdlayer.errors import warn
from gfmdlayer.interactive.one_contact import check_data, config_of, derived
from gfmdlayer.observables.transport import CRITICAL_GAPS, FLOW, THROATS
from gfmdlayer.transport.leakage import doubts, flow_through, numbers_of
from gfmdlayer.transport.percolation import Throat, throats
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import shown

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.arrays import FloatArray

LIFTS = 0.1  # of the critical gap, or of the contact pressure, from which a fluid changes the gap
MOST_SAID = 20  # warnings
_LONG_NAMES = {
    "flow_error_x": ("difference of flow_xx by the linear and the harmonic mean, relative", "1"),
    "flow_error_y": ("difference of flow_yy by the linear and the harmonic mean, relative", "1"),
    "leak_rate": ("volume of fluid per time through the seal", "length^3 / time"),
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
    pressure_drop: float | None = None,
    along: Literal["x", "y"] = "x",
    length: float | None = None,
    width: float | None = None,
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
    pressure_drop : float, optional
        Over the length of the seal.
    along : {"x", "y"}
        Direction of the drop. Along y, on a line, the fluid flows along the ridges.
    length, width : float, optional
        Of the seal, along the flow and across it; default: length and width of the cell, and 1 along the
        ridges of a line.
    body : Body or mapping, optional
        For the lift of the surface; default: the body of the case's configuration.
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
        also leak_rate [length^3/time], and lift, the rise of the surface over the critical gap. With `fields`
        fluid_pressure, flow_x and flow_y.

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
    seal = {"viscosity": viscosity, "pressure_drop": pressure_drop, "length": length, "width": width}
    check_data(data)
    grid = _grid(data, along, seal)
    leads = [str(name) for name in data["gap"].dims if name not in grid]
    gaps = data["gap"].transpose(*leads, *grid)
    spacing = {name: float(data[name][1] - data[name][0]) for name in grid}
    period = tuple(spacing[name] * data.sizes[name] for name in grid)
    rate = None
    if viscosity is not None and pressure_drop is not None:
        cell = (*period, 1.0)[:2] if along == "x" else (*period, 1.0)[1::-1]  # 1 along the ridges of a line
        rate = pressure_drop / (12 * viscosity) / (length or cell[0]) * (width or cell[1])
    solid = None if body is None else body_of(body)
    if body is None and pressure_drop is not None:
        try:
            solid = None if (config := config_of(data, trust=trust)) is None else config.solid
        except ConfigError as error:  # of code, or of files that have moved
            warn(f"lift is left out, which needs the body: {error}")
    shape = tuple(data.sizes[name] for name in leads)
    quantities: dict[str, FloatArray] = {}
    said: list[str] = []
    for at in np.ndindex(*shape):
        here = dict(zip(leads, at, strict=True))
        gap = gaps.isel(here).to_numpy()
        if np.isnan(gap).any():
            continue
        row, fluid, narrow = _flow(gap, period, along)
        if rate is not None:
            row["leak_rate"] = rate * row[f"flow_{along}{along}"]
        state = data.isel({name: i for name, i in here.items() if name in data.dims})
        reasons: list[str] = []
        depth, residual = _depth_and_residual(state)
        for axis, throat in narrow.items():
            reasons += doubts(axis, throat, depth, residual, gap.shape)
        if pressure_drop is not None and along in narrow:
            lift, more = _lift(narrow[along], gap, state, spacing, solid, pressure_drop)
            row |= {} if solid is None else {"lift": lift}
            reasons += more
        if fields and len(grid) == 2:
            row |= dict(zip(("fluid_pressure", "flow_x", "flow_y"), fluid, strict=True))
        for name, value in row.items():
            quantities.setdefault(name, np.full((*shape, *np.shape(value)), np.nan))[at] = value
        when = f"t = {float(state['snapshot']):.6g}: " if "snapshot" in state.coords else ""
        said += [when + reason for reason in reasons]
    if (further := len(said) - MOST_SAID) > 0:
        said[MOST_SAID:] = [f"{further} more doubts of this kind"]
    for text in said:
        warn(text)
    columns = (*FLOW, *THROATS, *CRITICAL_GAPS)
    meanings = {column.name: (column.long_name, column.units) for column in columns} | _LONG_NAMES
    dims = {name: [*leads, *grid] if array.ndim > len(leads) else leads for name, array in quantities.items()}
    values = {name: (dims[name], array) for name, array in quantities.items()}
    found = derived(data, values, meanings, {*leads, *(grid if "fluid_pressure" in quantities else ())})
    return found.assign_attrs(warnings="\n".join(said)) if said else found


def _grid(data: xarray.Dataset, along: str, seal: Mapping[str, float | None]) -> tuple[str, ...]:
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
    for name, value in seal.items():
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if value is not None and not (number and math.isfinite(value) and value > 0):
            wrong.append(f"{name}: got {shown(value)}; must be a number > 0, finite")
    if (seal["viscosity"] is None) and any(seal[name] is not None for name in ("length", "width")):
        wrong.append("viscosity: missing; length and width of the seal need viscosity and pressure_drop")
    if seal["viscosity"] is not None and seal["pressure_drop"] is None:
        wrong.append("pressure_drop: missing; a leak rate needs viscosity and pressure_drop")
    if wrong:
        raise ConfigError(wrong)
    return tuple(name for name in "xy" if name in data["gap"].dims)


def _flow(
    gap: FloatArray, period: tuple[float, ...], along: str
) -> tuple[dict[str, Any], tuple[FloatArray, ...], dict[str, Throat]]:
    """Return the numbers of one gap, the fields under a drop along an axis, and the throats."""
    flow, linear = flow_through(gap, period), flow_through(gap, period, "linear").tensor
    K, axis = flow.tensor, "xy".index(along)
    row: dict[str, Any] = {**numbers_of(flow)}
    for i, name in enumerate("xy"):
        row[f"flow_error_{name}"] = linear[i, i] / K[i, i] - 1 if K[i, i] > 0 else 0.0
    if gap.ndim == 1:
        return row, (), {}
    spacing = period[0] / gap.shape[0], period[1] / gap.shape[1]
    narrow = dict(zip("xy", throats(gap, spacing), strict=True))
    for name, throat in narrow.items():
        row |= {f"critical_gap_{name}": throat.gap, f"throat_points_{name}": throat.points}
    return row, (flow.pressure[axis], *flow.flow[axis]), narrow


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
    drop: float,
) -> tuple[float, list[str]]:
    """Return the rise of the surface at the throat over the critical gap, and doubts about the leak."""
    if throat.gap <= 0:
        return 0.0, []
    said, lift = [], math.nan
    if body is not None:
        K = float(np.real(np.asarray(body.stiffness([2 * math.pi / throat.width], 0.0))[0]))
        lift = drop / K / throat.gap if K > 0 else math.inf
        if lift > LIFTS:
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
    return lift, said
