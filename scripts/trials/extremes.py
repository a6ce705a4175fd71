"""Extreme cases in memory.

A case must end with finite numbers and a residual within the tolerance, or with `ConvergenceError`, which
names the step; the latter counts as not converged.
"""

from __future__ import annotations

import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from trials.configurations import DEFAULT, Drawn, draw
from trials.outcomes import Hangs, Outcome, limited

import gfmdlayer

LONGEST = 60.0  # seconds of processor time; a longer case counts as hanging
WITHOUT_CONTACT = {"friction", "contact_centre"}  # NaN there, as documented


def trial(seed: int, index: int, folder: Path, methods: tuple[str, ...] = (DEFAULT,)) -> Outcome:  # noqa: ARG001
    """Draw and run a case."""
    return outcome(draw(seed, index, methods))


def outcome(drawn: Drawn) -> Outcome:
    """Run a case."""
    try:
        with warnings.catch_warnings(), limited(LONGEST):
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)
            data = gfmdlayer.run(drawn.config, history=drawn.history, progress=False)
    except gfmdlayer.ConfigError as error:
        return Outcome("refused", str(error))
    except gfmdlayer.ConvergenceError as error:
        return Outcome("not converged", str(error))
    except Hangs:
        return Outcome("hangs", f"over {LONGEST:.0f} s")
    except Exception as error:  # any other error is a finding
        where = traceback.extract_tb(error.__traceback__)[-1]
        return Outcome(type(error).__name__, f"{error} ({where.filename.rpartition('/')[2]}:{where.lineno})")
    wrong = [name for name, values in data.variables.items() if not _sound(name, values)]
    if wrong:
        return Outcome("not finite", ", ".join(map(str, wrong)))
    if not (data["residual"] <= drawn.config["solver"]["tolerance"]).all():
        return Outcome("wrong", "a residual above the tolerance")
    return Outcome("converged")


def _sound(name: Any, values: Any) -> bool:
    values = np.asarray(values)
    return bool((np.isfinite(values) | (name in WITHOUT_CONTACT and np.isnan(values))).all())
