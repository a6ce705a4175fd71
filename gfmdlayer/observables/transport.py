"""Columns of a seal: flow through the gap, and estimates of it."""

from __future__ import annotations

from gfmdlayer.observables.observable import Column

_ONE_WAY = "between the points; valid while the fluid does not lift the surface"
_CELL = "over the cell; valid while the fluid does not lift the surface"
_MEANING = "flow per width times 12 viscosities, along {} by a drop of pressure per length along {}"

FLOW = (
    Column("flow_xx", _MEANING.format("x", "x"), "length^3", origin=_CELL),
    Column("flow_xy", _MEANING.format("x", "y"), "length^3", origin=_CELL),
    Column("flow_yy", _MEANING.format("y", "y"), "length^3", origin=_CELL),
    Column("hydraulic_gap_x", "distance of plates with the same flow along x", "length", origin=_CELL),
    Column("hydraulic_gap_y", "distance of plates with the same flow along y", "length", origin=_CELL),
    Column(
        "flow_imbalance",
        "largest difference of the flows through two cross-sections, relative to their mean",
        origin="over the cell",
    ),
    Column(
        "throat_points_x",
        "points across the narrowest place of the widest path along x; "
        "below 6 the flow is an order of magnitude",
        origin="of the grid",
    ),
    Column(
        "throat_points_y",
        "points across the narrowest place of the widest path along y; "
        "below 6 the flow is an order of magnitude",
        origin="of the grid",
    ),
)
CRITICAL_GAPS = (
    Column(
        "critical_gap_x",
        "largest gap such that the points with at least this gap lead through along x",
        "length",
        origin=_ONE_WAY,
    ),
    Column(
        "critical_gap_y",
        "largest gap such that the points with at least this gap lead through along y",
        "length",
        origin=_ONE_WAY,
    ),
)
