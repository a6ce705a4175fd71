"""Compiling kernels and planning transforms before the cases of a run begin."""

from __future__ import annotations

import math
import warnings
from contextlib import suppress
from pathlib import Path

from gfmdlayer.config import Config
from gfmdlayer.files.cache import user_cache
from gfmdlayer.grid.transforms import keep_pair_seconds
from gfmdlayer.grid.wisdom import planned
from gfmdlayer.periodic import Case, ConvergenceError, simulate


def warm_up(
    config: Config,
    wisdom_folder: Path | None = None,
    threads: int = 1,
    results: Path | None = None,
    *,
    plan: bool = True,
) -> str:
    """Compile the kernels that a case needs and plan its transforms.

    Plans are kept in the wisdom folder: runs with the same plans agree in every bit. The seconds of an FFT
    pair are kept beside them. A warning says where plans or kernels are not those of other runs.

    Parameters
    ----------
    config : Config
        The case.
    wisdom_folder : Path, optional
        By default the user's cache.
    threads : int
        Threads that the transforms may use.
    results : Path, optional
        Where the wisdom of some results is kept, which comes first.
    plan : bool
        Whether to plan transforms.

    Returns
    -------
    str
        FFTW's wisdom, for `simulate`.
    """
    wisdom = ""
    if plan and not config.grid.axisymmetric:
        points, folder = config.grid.points, wisdom_folder or user_cache()
        wisdom = planned(points, folder, threads, results)
        keep_pair_seconds(points, wisdom, folder, threads)
    try:
        _compile(config)
    except Exception as error:  # the case will meet it again, or not; its plans are made in any case
        warnings.warn(
            f"the cases compile their kernels themselves: {type(error).__name__}: {error}", stacklevel=2
        )
    return wisdom


def _compile(config: Config) -> None:
    """Compile the kernels that a case needs, by a small one of the same kind."""
    if config.grid.axisymmetric:
        simulate(_indented_in_small(config), _NoRecorder())
        return
    small = _in_small(config)
    Case(small).solver.compile()
    with suppress(ConvergenceError):  # of lengths that do not go together; the kernels are compiled
        simulate(small, _NoRecorder())


def _in_small(config: Config) -> Config:
    """The same kind of case over a ramp and a hold of few steps, on the smallest grid that has windows."""
    control, step, output = config.trajectory.control, config.time.step, config.output
    ramp_time = 1.0 if isinstance(step, str) else 2 * step
    moves = {"velocity": 1.0} if config.trajectory.moves else {}
    times = {"times": ramp_time} if isinstance(step, str) else {}
    loose = {"time.tolerance": 1e-3} if isinstance(step, str) else {}
    references = [law.shift.reference for law in config.laws if law.shift is not None]
    at_reference = {"temperature": {"value": max(references)}} if references else {}
    return config.with_values(
        at_reference
        | {
            "grid": {"points": 256},
            "punch": {"shape": "parabola"},
            "solver.method": config.contact_solver.method,
            "trajectory": {"control": control, control: 0.01, "ramp_time": ramp_time, **moves},
            "time.end": 3 * ramp_time,
            **loose,
            "output": output.model_dump(include={"patches", "histograms"}, exclude_none=True) | times,
        }
    )


def _indented_in_small(config: Config) -> Config:
    """An isolated case of one ramp, small beside the layers: wide contacts on thin ones take long."""
    control, base = config.trajectory.control, config.halfspace.shear_modulus
    size = min((each.thickness for each in config.stacked if 0 < each.thickness < math.inf), default=1.0)
    moduli = [*(law.unit for law in config.laws), *([base] if base and math.isfinite(base) else [])]
    value = 1e-2 * size if control == "depth" else 1e-3 * size**2 * min(moduli)
    return config.with_values(
        {
            "grid": {"geometry": "axisymmetric", "points": config.grid.points},
            "punch": {"shape": "parabola", "radius": size},
            "trajectory": {"control": control, control: value},
            "time": {"end": 2.0, "step": 1.0},
            "output": {},
        }
    )


class _NoRecorder:
    """Records nothing."""

    def row(self, **values: object) -> None:
        """Do nothing."""

    def note(self, **values: object) -> None:
        """Do nothing."""

    def snapshot(self, *fields: object) -> None:
        """Do nothing."""
