"""`gfmdlayer.run`: the cases of a configuration as labelled data, in memory or with a folder of results.

In memory each case goes into a `Recording`; with a folder the run is that of the command line.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from multiprocessing import current_process
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from gfmdlayer.config import Config, ConfigError
from gfmdlayer.config.reader import from_python
from gfmdlayer.config.sweeps import is_listed, sampling, swept_keys
from gfmdlayer.execution import interrupts
from gfmdlayer.execution.folder import Folder, read_config
from gfmdlayer.execution.growth import refuse_foreign_folder
from gfmdlayer.execution.run import RunOptions, run_sweep
from gfmdlayer.execution.schedule import Outcome
from gfmdlayer.execution.sweep import SweepCase, cases, input_errors
from gfmdlayer.files.cache import user_cache
from gfmdlayer.grid.wisdom import planned
from gfmdlayer.interactive.arrays import History, on_disk, with_history, with_punch, with_voltages
from gfmdlayer.interactive.cases import GUARD, Result, compute, here, in_processes, pool_of
from gfmdlayer.interactive.progress import Watch, chosen_display
from gfmdlayer.model import ConvergenceError
from gfmdlayer.notes import notes
from gfmdlayer.punch.shape import Shape
from gfmdlayer.results.gathering import CaseRecord
from gfmdlayer.results.reader import open_results
from gfmdlayer.results.sweep_file import labelled

if TYPE_CHECKING:
    import xarray

Punch = ArrayLike | Callable[..., ArrayLike] | Shape | Mapping[str, Any]


def run(
    config: str | Path | Mapping[str, Any] | Config,
    *,
    punch: Punch | None = None,
    history: History | None = None,
    out: str | Path | None = None,
    progress: bool | None = None,
    jobs: int = 1,
    threads: int = 1,
    **values: object,
) -> xarray.Dataset:
    """Run a configuration and return its results.

    Parameters
    ----------
    config : path, mapping or Config
        A YAML file, the file of a case, or the same keys in Python; a mapping needs no name.
    punch : array_like, callable, shape or mapping, optional
        The punch in place of the configuration's. An array has the shape of the grid (and gives
        `grid.points` where the configuration does not); a function takes x, or x and y, as arrays. Heights
        are counted outward from the punch, as those of a measured surface: the largest touches first, and a
        round punch is -x^2/(2 R). Only differences of heights count.
    history : array_like, shape (m, 2), or pair of array_like, optional
        Time and what `trajectory.control` says, depth or load, in place of the configuration's; linear
        between the rows, from time 0 on.
    out : path, optional
        Results folder, as the command line writes it; complete cases in it are not run again. Without it
        nothing is written.
    progress : bool, optional
        Whether progress is shown; by default in a terminal or a notebook, where it takes more than a second.
    jobs : int
        Processes that compute the cases of a sweep. A script that asks for several begins with
        ``if __name__ == "__main__":``.
    threads : int
        Threads for the transforms of a large grid.
    **values
        Keys of the configuration and their values: ``layer__thickness=0.1``, or
        ``**{"layer.thickness": 0.1}``; None leaves a key out. The `voltage` of an interface law may be an
        array, as `history`.

    Returns
    -------
    xarray.Dataset
        Of one case all columns along `time`, and displacement, pressure and gap along (snapshot, x[, y]), as
        `open_case` gives them; of a sweep those that `open_results` gives, along the swept keys.

    Raises
    ------
    ConfigError
        If the configuration cannot be used; with every error, before anything is computed.
    ConvergenceError
        If a step does not reach the solver's tolerance, with the state and the steps before it. A case of a
        sweep that fails is NaN, is named in the attribute `failed`, and causes a warning.
    FolderError
        If `out` cannot be used for these results.

    Examples
    --------
    >>> x = np.arange(256) / 256 - 0.5
    >>> data = gfmdlayer.run({"time": {"end": 2.0, "step": 0.1}}, punch=-(x**2) / 0.5, layer__thickness=0.1)
    >>> data.contact_area.sizes["time"], float(data.contact_area[-1]) > float(data.contact_area[10])
    (21, True)

    A sweep:

    >>> data = gfmdlayer.run({"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 256}},
    ...                      sweep={"layer.thickness": [0.05, 0.1], "layer.material.tau": [1, 10]})
    >>> dict(data.mean_pressure.sizes)
    {'thickness': 2, 'tau': 2, 'time': 3}
    """
    if getattr(current_process(), "_inheriting", False):  # it is being started, and imports the script
        raise RuntimeError(f"run was called while a process of another run starts: {GUARD}")
    if not isinstance(jobs, int) or jobs < 1:
        raise ConfigError([f"jobs: got {jobs!r}; must be a whole number >= 1"])
    found = _configuration(config, punch, history, {k.replace("__", "."): v for k, v in values.items()})
    if out is not None:
        return _run_in_folder(found, Path(out), progress, jobs, threads)
    every = cases(found)
    _warn(notes(case.config for case in every), 3)
    if not found.sweep:
        wisdom = planned(found.grid.points, user_cache(), threads)
        with closing(Watch(chosen_display(progress), 1)) as watch:
            data, said = compute(every[0], wisdom, threads, watch.case(0, found.time.end))
            watch.ended(Outcome(0, "complete"))
        _warn(said, 3)
        return data
    with closing(Watch(chosen_display(progress), len(every))) as watch:
        if jobs == 1:
            outcomes = {case.index: outcome for case, outcome in here(every, threads, watch)}
        else:
            outcomes = dict(in_processes(every, min(jobs, len(every)), threads, watch))
    return _gathered(found, every, [outcomes[case.index] for case in every])


def _configuration(
    config: str | Path | Mapping[str, Any] | Config,
    punch: Punch | None,
    history: History | None,
    values: dict[str, object],
) -> Config:
    """Return the checked configuration, with arrays as files in memory."""
    if isinstance(punch, Shape | Mapping):
        values, punch = values | {"punch": punch}, None
    if "interface" in values:
        values = values | {"interface": with_voltages(values["interface"])}
    if history is not None:
        values |= with_history(history)
    if not isinstance(config, str | PathLike | Mapping | Config):
        raise ConfigError([f"config: got {type(config).__name__}; must be a path, a mapping or a Config"])
    if isinstance(config, Config | Mapping):
        given = config if isinstance(config, Config) else {"name": "run", **config}
        if isinstance(given, Mapping) and "interface" in given:
            given = {**given, "interface": with_voltages(given["interface"])}
        found = from_python(given, values, input_errors if punch is None else None)
    else:
        found = read_config(config, values)
    return found if punch is None else from_python(found, with_punch(found, punch), input_errors)


def _gathered(config: Config, every: Sequence[SweepCase], results: Sequence[Result]) -> xarray.Dataset:
    """Return the cases of a sweep as one dataset."""
    failures = {case.index: result for case, result in zip(every, results, strict=True) if result.error}
    if len(failures) == len(every):
        raise failures[0].error or AssertionError
    _warn(dict.fromkeys(text for result in results for text in result.said), 4)
    reasons = [f"{index:04d}: {result.reason}" for index, result in failures.items()]
    _warn_of_failures(reasons, len(every))
    records = [
        CaseRecord(case.index, result.data, case.values, result.reason or None)
        for case, result in zip(every, results, strict=True)
    ]
    keys, drawn = swept_keys(config.sweep), sampling(config.sweep)
    return labelled(records, keys, drawn, is_listed(config.sweep), config.unit)


def _run_in_folder(
    config: Config, out: Path, progress: bool | None, jobs: int, threads: int
) -> xarray.Dataset:
    """Run the cases as the command line does; return what its reader opens."""
    refuse_foreign_folder(Folder(out))
    config = on_disk(config, out / "arrays")
    _warn(notes(case.config for case in cases(config)), 4)
    display = chosen_display(progress)
    show = None if display is None else lambda: display
    with interrupts.listening(), pool_of(jobs) as pool:
        summary = run_sweep(config, out, pool, RunOptions(threads=threads), show)
    if summary.count("stopped"):
        raise KeyboardInterrupt
    if len(summary.failures) == len(summary.outcomes):
        name, _, reason = summary.failures[0].reason.partition(": ")
        raise (
            ConvergenceError(reason)
            if name == ConvergenceError.__name__
            else RuntimeError(f"{name}: {reason}")
        )
    _warn_of_failures(
        [f"{each.index:04d}: {each.reason}" for each in summary.failures], len(summary.outcomes)
    )
    return open_results(out)


def _warn_of_failures(reasons: Sequence[str], total: int) -> None:
    if reasons:
        _warn([f"{len(reasons)} of {total} cases failed and are NaN:\n" + "\n".join(reasons)], 5)


def _warn(texts: Iterable[str], level: int) -> None:
    """Warn of each, at the line that called `run`, so many calls above."""
    for text in texts:
        warnings.warn(text, stacklevel=level)
