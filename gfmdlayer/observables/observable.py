"""The interface of observables: their columns, which they measure on each accepted step.

An observable is a class in a file of this folder and a line in the table `OBSERVABLES`. Result files, sweep
files, checkpoints, estimates of storage and plots follow from its columns. Checks of configurations and
estimates of cost need these modules, so the modules import neither numpy nor compiled kernels at the top.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from textwrap import dedent
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeAlias

from gfmdlayer.resumable import Saving

if TYPE_CHECKING:
    from gfmdlayer.arrays import Attribute, FloatArray
    from gfmdlayer.body.body import Body
    from gfmdlayer.body.materials import PronySeries
    from gfmdlayer.config import Config
    from gfmdlayer.drives import Drives
    from gfmdlayer.grid.grid import Grid
    from gfmdlayer.grid.transforms import Transforms
    from gfmdlayer.step import Step

Value: TypeAlias = "float | FloatArray"


@dataclass(frozen=True)
class Bins:
    """Bins of a distribution, a dimension of the result files."""

    name: str  # of the dimension; its coordinates NAME and NAME_end are the lower and upper ends of the bins
    quantity: str  # with the distribution
    units: str
    edges: tuple[float, ...]  # increasing; one more than there are bins

    @property
    def ends(self) -> Iterator[tuple[str, tuple[float, ...], dict[str, str]]]:
        """Yield name, values and attributes of the coordinates of the lower and the upper ends."""
        for name, end, edges in (
            (self.name, "lower", self.edges[:-1]),
            (f"{self.name}_end", "upper", self.edges[1:]),
        ):
            yield name, edges, {"long_name": f"{end} end of the bin of {self.quantity}", "units": self.units}


@dataclass(frozen=True)
class Places(Bins):
    """Places along a dimension of the result files, such as frequencies: the `edges` themselves."""

    @property
    def ends(self) -> Iterator[tuple[str, tuple[float, ...], dict[str, str]]]:
        """Yield name, values and attributes of the coordinate."""
        yield self.name, self.edges, {"long_name": self.quantity, "units": self.units}


@dataclass(frozen=True)
class Column:
    """One column of the rows, a number for each accepted step or for each bin; or a field of a snapshot.

    Parameters
    ----------
    name : str
        Name of the variable in the files.
    long_name : str
        Its meaning.
    units : str, default "1"
        Dimension in words, such as pressure; "1" of dimensionless quantities.
    dtype : str, default "f8"
        Type of the numbers in the files, as numpy names it.
    along : Bins, optional
        Bins of a distribution, or `Places`; a number without them.
    symbol : str, optional
        In mathtext, of the figures.
    origin : str, optional
        From where, or over what, it is measured; for the reference.

    Examples
    --------
    >>> gfmdlayer.Column("highest", "largest pressure", "pressure").described
    {'long_name': 'largest pressure', 'units': 'pressure'}
    """

    name: str
    long_name: str
    units: str = "1"
    dtype: str = "f8"
    along: Bins | None = None
    symbol: str = ""
    origin: str = ""

    @property
    def size(self) -> int:
        """Numbers in a row."""
        return 1 if self.along is None else len(next(self.along.ends)[1])

    def in_units(self, unit: Callable[[str], str]) -> Column:
        """Return the column with the label of its unit in place of the words.

        Parameters
        ----------
        unit : callable
            Returns the label of a unit from its dimension in words.
        """
        along = self.along and replace(self.along, units=unit(self.along.units))
        return replace(self, units=unit(self.units), along=along)

    @property
    def described(self) -> dict[str, str]:
        """Attributes of the variable in a file."""
        return {"long_name": self.long_name, "units": self.units}


def declared(table: str) -> tuple[Column, ...]:
    """Return the columns of a text, each in a line "name | meaning | units | origin [| symbol [| dtype]]".

    A line goes on in those that are indented further.
    """
    columns = []
    for line in re.sub(r"\n +", " ", dedent(table).strip()).splitlines():
        name, meaning, units, origin, *more = (part.strip() for part in line.split("|"))
        symbol, dtype = (*more, *("", "f8")[len(more) :])
        columns.append(Column(name, meaning, units, dtype, symbol=symbol, origin=origin))
    return tuple(columns)


class Observed(Protocol):
    """The parts of a simulation that an observable may need (`gfmdlayer.case.case.Case`)."""

    config: Config

    @property
    def drives(self) -> Drives:
        """The quantities imposed over time."""

    @property
    def grid(self) -> Grid:
        """The periodic grid."""

    @property
    def transforms(self) -> Transforms:
        """Fourier transforms of the grid."""

    @property
    def body(self) -> Body:
        """The body under the surface."""

    def in_cell(self, body: Body) -> Body:
        """Return a body as it answers in the cell: without periodic images in an isolated contact."""

    @property
    def series(self) -> tuple[PronySeries, ...]:
        """The laws of layers and halfspace as series of Maxwell branches."""

    @property
    def punch(self) -> FloatArray:
        """Height of the punch above its lowest point, one value a point."""

    @property
    def interior(self) -> Any:
        """The fields below the surface (`history.inside.Interior`); None where they are not asked for."""

    @property
    def history(self) -> Any:
        """The history of the body, of the kind that the configuration asks for."""


class Observable(Saving):
    """Measures columns of each accepted step.

    Parameters
    ----------
    case : Observed
        The simulation that is about to begin. It is not to be kept: large arrays would stay with it.

    Attributes
    ----------
    COLUMNS : tuple of Column
        Columns that are the same in every case that has the observable.
    FURTHER : tuple of Column
        Columns that some of these cases have besides: `columns` says which.
    NUMBERS : tuple of Column
        Attributes that the sweep file holds too, a number for each case.
    KEPT : tuple of str
        Names of the numbers, tuples and lists that it carries from step to step: "work" is the attribute
        `_work`.
    finished : bool
        Whether the run may end after the last accepted step.
    attributes : dict
        Attributes of the result file, known at the end of the run.
    warning : str
        A line for the log at the end of the run; empty where all is well.

    Examples
    --------
    A column of your own, from the fields of a step (displacement, pressure, gap):

    >>> class Highest(gfmdlayer.Observable):
    ...     COLUMNS = (gfmdlayer.Column("highest", "largest pressure", "pressure"),)
    ...
    ...     def measure(self, step):
    ...         return {"highest": float(step.fields["pressure"].max())}
    >>> data = gfmdlayer.run({"time": {"end": 1.0}}, observables=[Highest])
    >>> float(data.highest[-1]) > 0
    True
    """

    COLUMNS: ClassVar[tuple[Column, ...]] = ()
    FURTHER: ClassVar[tuple[Column, ...]] = ()
    NUMBERS: ClassVar[tuple[Column, ...]] = ()
    finished: bool = False
    attributes: Mapping[str, Attribute] = MappingProxyType({})
    warning: str = ""

    def __init__(self, case: Observed) -> None:
        """Take the needed parts of the simulation."""

    @classmethod
    def columns(cls, config: Config) -> tuple[Column, ...] | None:  # noqa: ARG003
        """Return the columns of a case, or None where the case does not have this observable.

        Parameters
        ----------
        config : Config
            Configuration of the case.
        """
        return cls.COLUMNS

    @classmethod
    def cost(cls, config: Config) -> tuple[float, float]:  # noqa: ARG003
        """Return FFT pairs, or as much other time, of a row, and bytes in memory; 0 where it is cheap.

        Parameters
        ----------
        config : Config
            Configuration of the case.
        """
        return 0.0, 0.0

    def measure(self, step: Step) -> Mapping[str, Value]:  # noqa: ARG002
        """Return the values of the columns, by name.

        Parameters
        ----------
        step : Step
            Accepted step, with its numbers and fields by name.

        Returns
        -------
        dict of str to float or ndarray
            A number for each column, or an array of shape (bins,) where the column has bins.
        """
        return {}


def rounded_down(value: float) -> str:
    """Return a number with its first digit."""
    unit = 10.0 ** math.floor(math.log10(value))
    return f"{math.floor(value / unit) * unit:.1g}"
