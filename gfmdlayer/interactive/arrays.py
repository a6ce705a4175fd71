"""Arrays of Python as the files that a configuration names: in memory, or beside the results."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.config import Config, ConfigError
from gfmdlayer.config.reader import from_python
from gfmdlayer.config.sweeps import swept_keys
from gfmdlayer.config.trajectory import Trajectory
from gfmdlayer.files.cache import MemoryFile
from gfmdlayer.files.whole import unfinished
from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.topography import numbers, outward_heights
from gfmdlayer.validation.sections import files_named

History = ArrayLike | tuple[ArrayLike, ArrayLike]


def with_history(history: History) -> dict[str, object]:
    """Return the keys of a trajectory that is given as an array of shape (m, 2), or a pair of arrays.

    These are time, and depth, mean pressure or force, as `trajectory.control` says; else ConfigError.
    """
    file = _table("history", history)
    others = Trajectory.model_fields.keys() - {"control", "velocity", "velocity_file"}
    left_out: dict[str, object] = {f"trajectory.{key}": None for key in others}
    return left_out | {"trajectory.kind": "table", "trajectory.file": file}


def with_voltages(given: Any) -> Any:
    """Return interface laws with voltages as files where these are arrays, as those of `with_history`.

    `given` are the keys of a law, or those of several; anything else is returned unchanged.
    """
    if isinstance(given, list | tuple):
        return [with_voltages(law) for law in given]
    voltage: Any = given.get("voltage") if isinstance(given, Mapping) else None
    is_array = hasattr(voltage, "__len__") and not isinstance(voltage, str)
    return {**given, "voltage": _table("voltage", voltage)} if is_array else given


def _table(name: str, history: History) -> MemoryFile:
    """Return a file in memory with the rows of an array."""
    try:
        pair = isinstance(history, tuple) and len(history) == 2
        rows = np.column_stack(history) if pair else np.asarray(history)  # type: ignore[arg-type]
        rows = rows.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError([f"{name}: {error}; must be an (m, 2) array, or a pair of arrays"]) from None
    if rows.ndim != 2 or rows.shape[1] != 2:
        shape = " x ".join(map(str, rows.shape))
        raise ConfigError([f"{name}: got an array of {shape}; must be (m, 2), or a pair of arrays"])
    text = "".join(f"{time!r} {value!r}\n" for time, value in rows.tolist())
    return _held(name, ".txt", text.encode())


def with_punch(config: Config, punch: ArrayLike | Callable[..., ArrayLike]) -> dict[str, object]:
    """Return the keys of a punch that is given as an array or a function, see `outward_heights`.

    Where the configuration does not give the points of the grid, the array gives them. Heights that are not
    finite numbers of the grid's shape, or a function for several grids, are a ConfigError.
    """
    keys: dict[str, object] = {}
    swept = swept_keys(config.sweep)
    if callable(punch):
        if any(key.startswith("grid.") for key in swept):
            message = (
                "a function, which is evaluated on one grid; must be an array, or no key of grid be swept"
            )
            raise ConfigError([f"punch: got {message}"])
    elif "points" not in config.grid.model_fields_set and "grid.points" not in swept:
        punch = numbers(punch)
        keys = {"grid.points": list(punch.shape)}
        config = from_python(config, keys)
    heights = outward_heights(punch, Grid(config.grid.points, config.grid.period))
    stream = io.BytesIO()
    np.save(stream, -heights, allow_pickle=False)  # a profile is counted from its lowest point
    return keys | {"punch": {"shape": "profile", "file": _held("punch", ".npy", stream.getvalue())}}


def _held(kind: str, suffix: str, contents: bytes) -> MemoryFile:
    return MemoryFile(f"{kind}-{hashlib.sha256(contents).hexdigest()[:12]}{suffix}", contents)


def held_files(config: Config) -> Mapping[str, MemoryFile]:
    """Return the files of a configuration that are in memory, by dotted key."""
    return {key: file for key, file in files_named(config).items() if isinstance(file, MemoryFile)}


def on_disk(config: Config, folder: Path) -> Config:
    """Write the files of a configuration that are in memory into a folder; return the one that names them.

    They are named after their contents, so that none is overwritten by another.
    """
    keys: dict[str, Any] = {}
    for key, file in held_files(config).items():
        path = folder.absolute() / file.name
        if not path.exists():
            folder.mkdir(parents=True, exist_ok=True)
            with unfinished(path) as part:
                part.write_bytes(file.contents)
        keys[key] = path
    return from_python(config, keys) if keys else config
