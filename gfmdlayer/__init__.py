"""Contact of a rigid punch with a viscoelastic layer on an elastic halfspace, by GFMD.

The public names; each is imported when it is first used, so that ``import gfmdlayer`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gfmdlayer.body.layer import LayeredHalfspace
    from gfmdlayer.body.materials import Prony, Zener
    from gfmdlayer.body.relaxation import relaxation_spectrum
    from gfmdlayer.config import Config, ConfigError, load
    from gfmdlayer.fitting.indentation.curve import ForceCurve
    from gfmdlayer.fitting.indentation.fit import fit_indentation
    from gfmdlayer.indentation.indent import indent
    from gfmdlayer.results.reader import open_case, open_results
    from gfmdlayer.simulation import ConvergenceError, simulate

__all__ = [
    "Config",
    "ConfigError",
    "ConvergenceError",
    "ForceCurve",
    "LayeredHalfspace",
    "Prony",
    "Zener",
    "fit_indentation",
    "indent",
    "load",
    "open_case",
    "open_results",
    "relaxation_spectrum",
    "simulate",
]

_MODULES = {
    "gfmdlayer.config": ("Config", "ConfigError", "load"),
    "gfmdlayer.fitting.indentation.curve": ("ForceCurve",),
    "gfmdlayer.fitting.indentation.fit": ("fit_indentation",),
    "gfmdlayer.indentation.indent": ("indent",),
    "gfmdlayer.results.reader": ("open_case", "open_results"),
    "gfmdlayer.simulation": ("ConvergenceError", "simulate"),
    "gfmdlayer.body.layer": ("LayeredHalfspace",),
    "gfmdlayer.body.materials": ("Prony", "Zener"),
    "gfmdlayer.body.relaxation": ("relaxation_spectrum",),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'gfmdlayer' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
