"""Observables of a step: contact, effort, friction, adhesion, energy, statistics, transport, steady state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from gfmdlayer.made_once import kept_with
from gfmdlayer.observables.adhesion import AdhesionColumns, Instabilities
from gfmdlayer.observables.contact import (
    INDENTATION,
    TOTALS,
    ContactMeans,
    ContactStatistics,
    Force,
    Resolution,
    TemperatureColumns,
    Yielding,
    of_one_contact,
    totals,
)
from gfmdlayer.observables.energy_balance import Bodies, EnergyBalance
from gfmdlayer.observables.friction import FrictionColumns, Slip
from gfmdlayer.observables.inside import LARGEST, InsideColumns
from gfmdlayer.observables.numerics import ACCURACY, Effort, SeriesError, SpectrumError, SteadyState
from gfmdlayer.observables.observable import Column, Observable, Observed, declared
from gfmdlayer.observables.transport import (
    FLOW,
    RESISTANCE,
    STIFFNESS,
    THROATS,
    ConductanceColumns,
    LeakageColumns,
    SealEstimates,
    SpotRadius,
    StiffnessColumns,
)

if TYPE_CHECKING:
    from gfmdlayer.config import Config

__all__ = [
    "ACCURACY",
    "INDENTATION",
    "OBSERVABLES",
    "SPARSE",
    "TOTALS",
    "Column",
    "Observable",
    "columns",
    "declared",
    "known_columns",
    "known_numbers",
    "measured_too",
    "observables",
    "totals",
]

# In the order of the columns; each may read the columns of those before it.
OBSERVABLES: dict[str, type[Observable]] = {
    "contact": ContactMeans,
    "force": Force,
    "resolution": Resolution,
    "effort": Effort,
    "friction": FrictionColumns,
    "slip": Slip,
    "adhesion": AdhesionColumns,
    "yielding": Yielding,
    "energy": EnergyBalance,
    "bodies": Bodies,
    "instabilities": Instabilities,
    "statistics": ContactStatistics,
    "temperature": TemperatureColumns,
    "seal_estimates": SealEstimates,
    "leakage": LeakageColumns,
    "spot_radius": SpotRadius,
    "conductance": ConductanceColumns,
    "stiffness": StiffnessColumns,
    "inside": InsideColumns,
    "series_error": SeriesError,
    "spectrum_error": SpectrumError,
    "steady_state": SteadyState,
}

# Columns that are NaN in the rows between two others.
SPARSE = frozenset(each.name for each in (*FLOW, *THROATS, RESISTANCE, *STIFFNESS, *LARGEST))


@contextmanager
def measured_too(own: Sequence[type[Observable]]) -> Iterator[None]:
    """Measure observables of the session's own classes too, within the block.

    TypeError for what is no such class, ValueError for a column that another one has.
    """
    known = {*known_columns(), *known_numbers()}
    for each in own:
        if not (isinstance(each, type) and issubclass(each, Observable)):
            raise TypeError(f"got {each!r}; must be a class that derives from gfmdlayer.Observable")
        for column in each.COLUMNS:
            if column.name in known:
                raise ValueError(f"{each.__name__}: there is a column {column.name!r}; take another name")
            known.add(column.name)
    names = {f"{each.__qualname__} {place}": each for place, each in enumerate(own)}
    OBSERVABLES.update(names)
    try:
        yield
    finally:
        for name in names:
            del OBSERVABLES[name]


def observables(case: Observed) -> dict[str, Observable]:
    """Make the observables that the configuration of a simulation asks for, by name."""
    return {name: made(case) for name, made in OBSERVABLES.items() if made.columns(case.config) is not None}


@kept_with
def columns(config: Config) -> tuple[Column, ...]:
    """Return the columns of a case on a grid, in the order of its rows."""
    every = [column for observable in OBSERVABLES.values() for column in observable.columns(config) or ()]
    if config.grid.isolated:
        whole = all(config.grid.without_images.isolated)
        return tuple(of_one_contact(every, line=len(config.grid.points) == 1, whole=whole))
    return tuple(every)


def costs(config: Config) -> tuple[float, float]:
    """Return the FFT pairs of a row that observables take, and the bytes of the largest of them."""
    costs = [
        observable.cost(config)
        for observable in OBSERVABLES.values()
        if observable.columns(config) is not None
    ]
    return sum(pairs for pairs, _ in costs), max((memory for _, memory in costs), default=0.0)


def known_columns() -> dict[str, Column]:
    """Return the columns of periodic contacts that are the same in every case that has them, by name."""
    known: dict[str, Column] = {}
    for observable in OBSERVABLES.values():
        for column in (*observable.COLUMNS, *observable.FURTHER):
            if column.name in known:
                raise ValueError(f"{observable.__name__}: another observable has a column {column.name!r}")
            known[column.name] = column
    return known


def known_numbers() -> dict[str, Column]:
    """Return the attributes of cases that sweep files hold as columns, by name."""
    every = [column for observable in OBSERVABLES.values() for column in observable.NUMBERS]
    return {column.name: column for column in (*every, *of_one_contact(every), *ACCURACY)}
