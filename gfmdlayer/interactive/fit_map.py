"""`gfmdlayer.fit_map`: fits of the curves of a force map, each by itself, and their result."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.figures.map_plots import fit_map_figure
from gfmdlayer.fitting.force_map import ForceMap
from gfmdlayer.fitting.indentation import Given, answers_of
from gfmdlayer.fitting.problem import Free
from gfmdlayer.fitting.result import Fit, FitOptions, Table
from gfmdlayer.fitting.starts import read_model
from gfmdlayer.interactive.run import check_jobs, chosen_display, pool_of
from gfmdlayer.results.reader import open_results
from gfmdlayer.study import interrupts
from gfmdlayer.validation.entry import entry

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FitMap(Fit):
    """The fits of a force map.

    Parameters
    ----------
    data : xarray.Dataset
        Each free parameter by the last part of its key, NAME, with NAME_error, NAME_low and NAME_high (95 %
        interval), and noise, aic, bic, name and warnings of each curve: over (y, x) where the places of the
        curves are a grid, else over `curve`. Failed curves are NaN. `units` where the model has units.
    """

    data: xarray.Dataset

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(str(self.data.attrs["fitted"]).split())

    @property
    def failed(self) -> dict[str, str]:
        """The reason of each failed curve, by its name."""
        lines = (line.partition(": curve ")[2] for line in str(self.data.attrs["failed"]).splitlines())
        return {name: reason for name, _, reason in (line.partition(": ") for line in lines)}

    def __getitem__(self, name: str) -> xarray.DataArray:
        """Return a variable of `data`."""
        if name not in self.data:
            raise KeyError(f"{name}: must be one of {', '.join(map(str, self.data))}")
        return self.data[name]

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Return headings and cells: the median of each parameter over the curves, and its quartiles."""
        rows = []
        for name in self.names:
            values = self.data[name].to_numpy()
            known = values[np.isfinite(values)]
            low, median, high = np.quantile(known, (0.25, 0.5, 0.75)) if known.size else [np.nan] * 3
            unit = str(self.data[name].attrs.get("units", "")).removeprefix("1")
            cells = f"{median:.6g}", f"{low:.6g} to {high:.6g}", unit, f"{known.size}"
            rows.append([name, *cells])
        return ["parameter", "median", "quartiles", "unit", "curves"], rows

    def sentences(self) -> Iterator[str]:
        """Yield the failed curves with their reasons, and one warning of each kind with its curves."""
        for name, reason in self.failed.items():
            yield f"failed: {name}: {reason}"
        named = zip(
            self.data["name"].to_numpy().ravel(), self.data["warnings"].to_numpy().ravel(), strict=True
        )
        kinds: dict[str, list[str]] = {}
        for name, lines in named:
            for line in str(lines).splitlines():
                kinds.setdefault(line.partition(" (")[0], []).append(f"{name}: {line}")
        for alike in kinds.values():
            yield f"warning of {len(alike)}, such as {alike[0]}" if alike[1:] else f"warning of {alike[0]}"

    def tables(self) -> list[Table]:
        """Return the table of the parameters."""
        return [self.table()]

    def lines(self) -> list[str]:
        """Return a table of the parameters, the failed curves and the warnings."""
        head, rows = self.table()
        widths = [max(len(row[c]) for row in (head, *rows)) for c in range(len(head))]
        lines = ["  ".join(f"{cell:{w}}" for cell, w in zip(row, widths, strict=True)).rstrip()
                 for row in (head, *rows)]  # fmt: skip
        count = int((self.data["case"] >= 0).sum())
        return [f"Fits of {count} curves, each by itself", *lines, *self.sentences()]

    def figure(self, names: Sequence[str] = ()) -> Figure:
        """Draw parameters, all or these, and their errors over the sample, failed curves hatched."""
        return fit_map_figure(self.data, z=names)

    def to_dataset(self) -> xarray.Dataset:
        """Return `data`."""
        return self.data


@entry()
def fit_map(
    curves: Given | Iterable[Given],
    model: Mapping[str, object] | str | Path,
    free: Free | None = None,
    *,
    units: Sequence[str] | Mapping[str, str] | None = None,
    decimal: str | None = None,
    columns: str | Sequence[str] = (),
    loss: str = "linear",
    profile: bool = False,
    contact: str = "given",
    segments: str | Sequence[str] = (),
    prescribed: str | None = None,
    stiffness: float | None = None,
    stiffness_error: float | None = None,
    adhesion: str | None = None,
    sensitivity: float | None = None,
    sampling: float | None = None,
    baseline: str = "none",
    weight: float | None = None,
    range: tuple[float, float] | None = None,  # noqa: A002
    jobs: int = 1,
    out: str | Path | None = None,
    restart: bool = False,
    progress: bool | None = None,
) -> FitMap:
    """Fit each curve of a force map by itself; failed curves are named, and the others go on.

    Parameters
    ----------
    curves, model, free, units, decimal, columns : as of `fit_indentation`
        That function fits one model to all curves.
    loss, profile, contact, segments, prescribed, stiffness : as of `fit_indentation`
        Options of the fit of each curve.
    stiffness_error, adhesion, sensitivity, sampling, baseline, weight, range : as of `fit_indentation`
        Likewise.
    jobs : int
        Number of processes.
    out : path, optional
        Results folder. The fits of a run that was stopped go on there; `status` and `plot` read it.
    restart : bool
        Whether earlier results in `out` are removed.
    progress : bool, optional
        Whether to show progress; by default in a notebook or a terminal.

    Returns
    -------
    FitMap
        Parameters over x and y.

    Raises
    ------
    ConfigError
        The model, a key or an option is not possible.
    FitError
        There is no curve.
    FolderError
        If `out` cannot be used.

    Examples
    --------
    Hertz's forces on halfspaces of G = 7 and 8 under a paraboloid of radius 5:

    >>> import numpy as np
    >>> depth = np.linspace(0.0, 0.1, 50)
    >>> material = {"model": "elastic", "G": 1.0}
    >>> model = {
    ...     "layer": {"thickness": float("inf"), "material": material},
    ...     "punch": {"shape": "parabola", "radius": 5.0},
    ... }
    >>> force = 8 / 3 * 5.0**0.5 * depth**1.5 / (1 - 0.5)
    >>> curves = [gfmdlayer.ForceCurve(f"{G}", depth, depth, G * force) for G in (7, 8)]
    >>> fits = gfmdlayer.fit_map(curves, model, ["layer.material.G"])
    >>> [round(G, 2) for G in fits["G"].values.tolist()]
    [7.0, 8.0]
    """
    check_jobs(jobs)
    options = FitOptions(
        loss, profile, contact, segments, prescribed, stiffness, stiffness_error, adhesion, sensitivity,
        sampling, baseline, weight, range,
    )  # fmt: skip
    data, keys = read_model(model, free)
    answers = answers_of(units, decimal, columns)
    display = chosen_display(progress)
    with ExitStack() as held:
        if out is None:
            place = Path(held.enter_context(tempfile.TemporaryDirectory(prefix="gfmdlayer-")))
        else:
            place = Path(out)
        every = ForceMap(curves, place, data, keys, options, answers)
        held.enter_context(interrupts.listening())
        pool = held.enter_context(pool_of(jobs))
        summary = every.run(pool, restart, None if display is None else lambda: display)
        if not summary.collected:
            raise KeyboardInterrupt
        with open_results(place) as found:
            return FitMap(found.load())
