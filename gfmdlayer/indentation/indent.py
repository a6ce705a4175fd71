"""`gfmdlayer.indent`: an isolated indentation as an xarray.Dataset."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.body import check_body
from gfmdlayer.config.geometries import FINEST
from gfmdlayer.indentation.isolated import IsolatedIndentation
from gfmdlayer.indentation.solve import Edge, History
from gfmdlayer.observables import INDENTATION
from gfmdlayer.punch.revolution import OfRevolution, Revolution, of_table
from gfmdlayer.results.schema import VARIABLES

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.body.body import Body

FIELDS = ("pressure", "displacement", "gap")


def indent(
    body: Body,
    indenter: OfRevolution | Revolution | Mapping[str, Any] | tuple[ArrayLike, ArrayLike],
    time: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    force: ArrayLike | None = None,
    tolerance: float = 1e-4,
    work_of_adhesion: float = 0.0,
    edge_speed: float = math.inf,
    edge_exponent: float = 0.6,
    healing_work: float | None = None,
    snapshots: Sequence[float] = (),
) -> xarray.Dataset:
    """Press a rigid indenter of revolution into a body: isolated, frictionless, over any history.

    Parameters
    ----------
    body : Body
        The body, such as a `ViscoelasticLayer`: a halfspace, a layer, or any other that supports a load.
    indenter : shape, mapping or pair of arrays
        A shape of the punch that is a convex body of revolution, its keys in a configuration, or radii and
        heights of a convex profile.
    time : array_like, shape (nt,)
        Ascending times. The body is at rest before the first one.
    depth, force : array_like, shape (nt,)
        What is prescribed, either; linear between the times. The depth counts from the first touch of the
        undeformed surface and may be negative.
    tolerance : float
        Estimated error of force, depth and contact radius, relative to the largest of each. A radius below a
        tenth of the largest counts by its square: it falls like a root of time where contact is lost. With
        adhesion contact jumps: then an error does not count that a shift in time mends, by up to `tolerance`
        times the duration. Not below 1e-9.
    work_of_adhesion : float
        Energy per area that a slowly receding edge of the contact takes (JKR), with the relaxed modulus.
    edge_speed, edge_exponent : float
        An edge that recedes with the speed v takes work_of_adhesion (1 + (v/edge_speed)^edge_exponent), as
        Maugis & Barquins, J. Phys. D 11 (1978) 1989, have it; length over time, and a number.
    healing_work : float, optional
        Energy per area that a slowly advancing edge gains, with the relaxed modulus; at most, and by default,
        work_of_adhesion (relaxed/glassy modulus of the surface)^2. With the default, an edge exchanges the
        same energy with the glassy body next to it on both ways.
    snapshots : sequence of float
        Times at which the radial profiles of pressure, displacement and gap are wanted.

    Returns
    -------
    xarray.Dataset
        force, depth, contact_radius, work, stored, dissipated and energy_residual over `time`, the times
        of the steps; the profiles over `snapshot` and `r`. Each has the attributes long_name and units, a
        dimension such as "length": the numbers are in the units of the arguments. The attribute `error` is
        the estimated error. With adhesion there are `edge_work`, the energy that the edge has taken less that
        it has gained, and the attribute `pull_off_force`, the largest pull; energy_residual grows by the
        energy lost in jumps. A punch that a force has torn off has the depth of the surface, free of work.

    Raises
    ------
    TypeError
        If the body lacks what an indentation needs, or a number is none.
    ValueError
        If the input is impossible; the message has the reason and the allowed values.
    ArithmeticError
        If the tolerance is not reached.

    Examples
    --------
    Hertz, 4/3 E* R^(1/2) depth^(3/2) with E* = 2 G/(1 - nu) = 4:

    >>> body, sphere = gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=1.0)
    >>> found = gfmdlayer.indent(body, sphere, [0.0, 1.0], depth=[0.0, 0.01])
    >>> abs(float(found.force[-1]) / (4 / 3 * 4.0 * 0.01**1.5) - 1) < 1e-4
    True
    """
    import xarray

    check_body(body, "stiffness", "spectrum")
    history = _history(time, depth, force)
    _check_numbers(tolerance, work_of_adhesion, edge_speed, edge_exponent, healing_work or 0.0)
    if not work_of_adhesion and history.by_force and history.value.min() < 0:
        raise ValueError(f"force: got {history.value.min():.6g}; must be >= 0 without adhesion")
    if not history.by_force and history.value.max() >= (floor := getattr(body, "rigid_below", math.inf)):
        raise ValueError(f"depth: got {history.value.max():.6g}; must be above the rigid base, < {floor!r}")
    times = np.unique(np.asarray(snapshots, dtype=float))
    if times.size and not (history.time[0] <= times[0] and times[-1] <= history.time[-1]):
        raise ValueError(f"snapshots: got {times}; must be between the first and the last time")
    run = IsolatedIndentation(
        body,
        as_revolution(indenter),
        history,
        tolerance=tolerance,
        adhesion=Edge(work_of_adhesion, edge_speed, edge_exponent, healing_work),
        snapshots=times.tolist(),
    )
    columns = run.columns()
    about = {column.name: column.described for column in INDENTATION}
    about |= {name: {"long_name": each.long_name, "units": each.units} for name, each in VARIABLES.items()}
    about["r"] = {"long_name": "distance from the axis", "units": "length"}
    data: dict[str, Any] = {name: ("time", values, about[name]) for name, values in columns.items()}
    coordinates = {"time": data.pop("time")}
    attributes = {"error": run.solved.error, "solutions": run.solved.solutions}
    if work_of_adhesion:
        meaning = {"long_name": "energy taken by the edge of the contact", "units": "energy"}
        data["edge_work"] = "time", run.solved.parted, meaning
        attributes["pull_off_force"] = max(0.0, -float(run.solved.force.min()))
    if times.size:
        fields = run.profiles()
        data |= {name: (("snapshot", "r"), getattr(fields, name), about[name]) for name in FIELDS}
        coordinates |= {
            name: (name, each, about[name]) for name, each in (("snapshot", times), ("r", fields.r))
        }
    for line in run.warnings:
        warnings.warn(line, stacklevel=2)
    return xarray.Dataset(data, coordinates, attributes)


def as_revolution(indenter: Any) -> Revolution:
    """Return the profile of an indenter, see `indent`; ValueError if it is no convex body of revolution."""
    if isinstance(indenter, Revolution):
        return indenter
    if isinstance(indenter, Mapping):
        from gfmdlayer.punch.shapes import SHAPES

        keys = dict(indenter)
        shape = SHAPES.get(keys.get("shape", next(iter(SHAPES))))
        if shape is None:
            raise ValueError(f"shape: got {keys['shape']!r}; must be one of {', '.join(SHAPES)}")
        indenter = shape(**keys)
    if isinstance(indenter, OfRevolution):
        return indenter.revolution()
    if isinstance(indenter, tuple) and len(indenter) == 2:
        return of_table(*indenter)
    raise ValueError(f"got {indenter!r}; must be a shape of revolution, its keys, or radii and heights")


def _check_numbers(
    tolerance: float, work_of_adhesion: float, edge_speed: float, edge_exponent: float, healing_work: float
) -> None:
    numbers = {
        "work_of_adhesion": work_of_adhesion,
        "edge_speed": edge_speed,
        "edge_exponent": edge_exponent,
        "healing_work": healing_work,
        "tolerance": tolerance,
    }
    for name, value in numbers.items():
        if np.ndim(value) or np.asarray(value).dtype.kind not in "iuf":
            raise TypeError(f"{name}: got {value!r}; must be a number")
    for name in ("work_of_adhesion", "healing_work"):
        if not 0 <= numbers[name] < math.inf:
            raise ValueError(f"{name}: got {numbers[name]!r}; must be finite and >= 0")
    if not edge_speed > 0:
        raise ValueError(f"edge_speed: got {edge_speed!r}; must be > 0")
    if not 0 < edge_exponent < math.inf:
        raise ValueError(f"edge_exponent: got {edge_exponent!r}; must be finite and > 0")
    if not FINEST <= tolerance < math.inf:
        raise ValueError(f"tolerance: got {tolerance!r}; must be finite and >= {FINEST:g}")
    if not work_of_adhesion and (edge_speed < math.inf or healing_work):
        name = "edge_speed" if edge_speed < math.inf else "healing_work"
        raise ValueError(f"{name}: got {numbers[name]!r} without adhesion; must have a work_of_adhesion > 0")


def _history(time: ArrayLike, depth: ArrayLike | None, force: ArrayLike | None) -> History:
    if (depth is None) == (force is None):
        got = "neither" if depth is None else "both"
        raise ValueError(f"depth, force: got {got}; must be one of the two")
    name = "depth" if force is None else "force"
    times = np.asarray(time, dtype=float)
    values: FloatArray = np.asarray(depth if force is None else force, dtype=float)
    if times.ndim != 1 or times.size < 2 or values.shape != times.shape:
        raise ValueError(
            f"{name}: got shape {values.shape} for times of shape {times.shape}; must be equal, two or more"
        )
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise ValueError(f"time, {name}: must be finite")
    if np.diff(times).min() <= 0:
        at = int(np.diff(times).argmin())
        raise ValueError(f"time: got {times[at + 1]:.6g} after {times[at]:.6g}; must ascend")
    return History(times, values, force is not None)
