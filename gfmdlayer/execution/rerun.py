"""Running a case again from its own file, which carries its configuration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from gfmdlayer.config import Config, ConfigError, digest, load
from gfmdlayer.execution.sweep import input_errors
from gfmdlayer.validation.sections import files_named

_SIGNATURE = b"\x89HDF\r\n\x1a\n"  # of HDF5


def is_result(path: str | Path) -> bool:
    """Tell whether a file is one of results, and not a configuration in YAML."""
    try:
        with Path(path).open("rb") as file:
            return file.read(len(_SIGNATURE)) == _SIGNATURE
    except OSError:
        return False


def read_config(path: str | Path, overrides: Iterable[str] | Mapping[str, object] = ()) -> Config:
    """Read a configuration, or that of a case's result file, and check its numbers and input files.

    Parameters
    ----------
    path : str or Path
        YAML file, or the file of a case.
    overrides : iterable of str, or mapping
        As `config.load` takes them.

    Raises
    ------
    ConfigError
        With every error in it.
    """
    return stored_config(path, overrides) if is_result(path) else load(path, overrides, input_errors)


def stored_config(path: str | Path, overrides: Iterable[str] | Mapping[str, object] = ()) -> Config:
    """Return the configuration from which a case was computed, as `config.load` does.

    Raises
    ------
    ConfigError
        Where the file holds none, or a file that it names holds something else now: the case would not be
        the same.
    """
    from gfmdlayer.results.reader import attributes
    from gfmdlayer.results.schema import ResultsError

    try:
        known = attributes(path)
    except ResultsError as error:
        raise ConfigError([str(error)]) from None
    if "config" not in known:
        raise ConfigError([f"{path}: holds no configuration; must be YAML, or the file of a case"])
    content = str(known["config"])
    config = load(path, overrides, input_errors, content)
    files = [str(file) for file in files_named(config).values()]
    if files and not overrides and digest(config) != known.get("digest"):
        raise ConfigError([f"{path}: {' or '.join(files)} has changed since this case was computed from it"])
    return config
