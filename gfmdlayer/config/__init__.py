"""What a user may write: YAML to plain validated data, in milliseconds and without any numerics.

`load` reads a file into a `Config` or raises one `ConfigError` that lists everything wrong with it, each with
its place, its key and what is allowed. `digest` names what determines a case's results.
"""

from gfmdlayer.config.input_errors import ConfigError
from gfmdlayer.config.model import Config, digest
from gfmdlayer.config.output import Histogram, Histograms, Output
from gfmdlayer.config.punches import (
    Array,
    Cone,
    Cylinder,
    Flat,
    Parabola,
    Profile,
    Punch,
    Pyramid,
    SelfAffine,
    Sinusoid,
    Sphere,
    Topography,
    Wedge,
)
from gfmdlayer.config.reader import load
from gfmdlayer.config.sections import (
    Branch,
    Grid,
    Halfspace,
    Layer,
    Material,
    Prony,
    Solver,
    Time,
    Trajectory,
    Zener,
)

__all__ = [
    "Array",
    "Branch",
    "Cone",
    "Config",
    "ConfigError",
    "Cylinder",
    "Flat",
    "Grid",
    "Halfspace",
    "Histogram",
    "Histograms",
    "Layer",
    "Material",
    "Output",
    "Parabola",
    "Profile",
    "Prony",
    "Punch",
    "Pyramid",
    "SelfAffine",
    "Sinusoid",
    "Solver",
    "Sphere",
    "Time",
    "Topography",
    "Trajectory",
    "Wedge",
    "Zener",
    "digest",
    "load",
]
