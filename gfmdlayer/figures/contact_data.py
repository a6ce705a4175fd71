"""The dataset of a contact, with a `plot()` beside the plots of xarray."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import xarray
from xarray.plot.accessor import DatasetPlotAccessor

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class _Plots(DatasetPlotAccessor):
    """The plots of xarray, of which the call itself draws the contact."""

    def __call__(self, out: str | os.PathLike[str] | None = None, **how: Any) -> Figure:  # type: ignore[override]
        """Draw the contact, and write it to a file `out`; further arguments as of `gfmdlayer.plot`."""
        from gfmdlayer.figures.pictures import plot

        return plot(self._ds, out=out, **how)


class ContactData(xarray.Dataset):  # type: ignore[no-untyped-call]
    """Data of `solve` and `indent`: an xarray.Dataset that `plot()` draws."""

    __slots__ = ()

    @property
    def plot(self) -> _Plots:  # type: ignore[override]
        """Draw the contact; `plot.scatter` and the others are those of xarray."""
        return _Plots(self)


def with_plot(data: xarray.Dataset) -> ContactData:
    """Return a new dataset as data of a contact."""
    data.__class__ = ContactData  # a copy takes as long as a small contact
    return data  # type: ignore[return-value]
