"""The base class of all errors that users see, and warnings at the line of the user's own code."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

_PACKAGE = str(Path(__file__).parent)


class GfmdlayerError(Exception):
    """Base class of the errors of this package; each names the argument or file, what it is, and what may be.

    `ConfigError`, `FitError`, `TableError` of files: a ValueError. `ConvergenceError`: a RuntimeError.
    `ResultsError`: an OSError. `FolderError` of results folders.

    Examples
    --------
    >>> try:
    ...     gfmdlayer.Sphere(radius=-1.0)
    ... except gfmdlayer.GfmdlayerError as error:
    ...     print(error)
    radius: got -1.0; must be a number > 0, finite
    """


def warn(text: str, category: type[Warning] = UserWarning) -> None:
    """Warn at the line outside of this package that led here, so that each line is told once."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)
