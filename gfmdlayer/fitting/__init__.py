"""From a measured master curve or relaxation curve to the Prony series of a configuration."""

from gfmdlayer.fitting.measurement import FitError, MasterCurve, Measurement, RelaxationCurve, read
from gfmdlayer.fitting.prony import Fit, fit
from gfmdlayer.fitting.report import fit_material
from gfmdlayer.fitting.wlf import WLF

__all__ = [
    "WLF",
    "Fit",
    "FitError",
    "MasterCurve",
    "Measurement",
    "RelaxationCurve",
    "fit",
    "fit_material",
    "read",
]
