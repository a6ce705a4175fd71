"""Contact of a rigid punch with a viscoelastic layer on an elastic halfspace, by GFMD.

One contact      solve: a periodic or isolated contact of any surface
                 indent: an isolated punch of revolution over time
Runs, sweeps     run, load, Config; Case, simulate: parts of your own
                 converge: how sure the numbers are; Observable, Column: columns of your own
Results          open_results, open_case; leakage, inside; plot, and `.plot()` of a result
Fits             fit_indentation, fit_map, ForceCurve, design_indentation; fit_material
Bodies           halfspace, bonded_layer; Layer, Halfspace, LayerStack, Pair
                 Anisotropic, Lattice, Tabulated; Solid: of your own
Materials        Elastic, Zener, Prony, PowerLaw, FractionalZener, HavriliakNegami, Kohlrausch
                 shifts: WLF, Arrhenius; Material: of your own
Punches          Parabola, Sphere, Cylinder, Flat, Cone, BluntedCone, Wedge, Pyramid, Sinusoid
                 rough: SelfAffine, Topography; of indent alone: FlatPunch, RadialProfile
Interfaces       Exponential, Dugdale, LennardJones, Electrostatic
Errors           GfmdlayerError: ConfigError, ConvergenceError, FitError, FolderError, ResultsError
Formulas         LayeredHalfspace, ViscoelasticLayer, relaxation_spectrum
                 Spectrum, TractionSpectrum, Wavevectors: what a Solid of your own answers with

`help(gfmdlayer.solve)` explains a name. The names are imported when they are first used, so that
``import gfmdlayer`` costs nothing.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str

    from gfmdlayer.body.anisotropic import Anisotropic
    from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
    from gfmdlayer.body.continuous import FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw
    from gfmdlayer.body.lattice import Lattice
    from gfmdlayer.body.layer import Halfspace, Layer
    from gfmdlayer.body.layers import LayerStack, ViscoelasticLayer, bonded_layer, halfspace
    from gfmdlayer.body.materials import Elastic, Material, Prony, Zener
    from gfmdlayer.body.pair import Pair
    from gfmdlayer.body.relaxation import Spectrum, TractionSpectrum
    from gfmdlayer.body.shifts import WLF, Arrhenius
    from gfmdlayer.body.solid import Solid
    from gfmdlayer.body.tabulated import Tabulated
    from gfmdlayer.body.wavevectors import Wavevectors
    from gfmdlayer.case.case import Case
    from gfmdlayer.case.model import ConvergenceError, simulate
    from gfmdlayer.config import Config, ConfigError, load
    from gfmdlayer.convergence.converge import converge
    from gfmdlayer.errors import GfmdlayerError
    from gfmdlayer.figures.pictures import plot
    from gfmdlayer.fitting.design import design_indentation
    from gfmdlayer.fitting.force_curve import ForceCurve
    from gfmdlayer.fitting.indentation import fit_indentation
    from gfmdlayer.fitting.material import fit_material
    from gfmdlayer.fitting.measurement import FitError
    from gfmdlayer.indentation.indent import indent
    from gfmdlayer.interactive.fit_map import fit_map
    from gfmdlayer.interactive.inside import inside
    from gfmdlayer.interactive.leakage import leakage
    from gfmdlayer.interactive.run import run
    from gfmdlayer.interactive.solve import solve
    from gfmdlayer.interface.adhesion import Dugdale, Electrostatic, Exponential, LennardJones
    from gfmdlayer.observables import Column, Observable
    from gfmdlayer.punch.measured import Topography
    from gfmdlayer.punch.self_affine import SelfAffine
    from gfmdlayer.punch.simple_shapes import (
        BluntedCone,
        Cone,
        Cylinder,
        Flat,
        FlatPunch,
        Parabola,
        Pyramid,
        RadialProfile,
        Sinusoid,
        Sphere,
        Wedge,
    )
    from gfmdlayer.results.names import ResultsError
    from gfmdlayer.results.reader import open_case, open_results
    from gfmdlayer.study.folder import FolderError

__all__ = [
    "WLF", "Anisotropic", "Arrhenius", "BluntedCone", "Case", "Column", "Cone", "Config", "ConfigError",
    "ConvergenceError", "Cylinder", "Dugdale", "Elastic", "Electrostatic", "Exponential", "FitError",
    "Flat", "FlatPunch", "FolderError", "ForceCurve", "FractionalZener", "GfmdlayerError", "Halfspace",
    "HavriliakNegami", "Kohlrausch", "Lattice", "Layer", "LayerStack", "LayeredHalfspace",
    "LennardJones", "Material", "Observable", "Pair", "Parabola", "PowerLaw", "Prony", "Pyramid",
    "RadialProfile", "ResultsError", "SelfAffine", "Sinusoid", "Solid", "Spectrum", "Sphere",
    "Tabulated", "Topography", "TractionSpectrum", "ViscoelasticLayer", "Wavevectors", "Wedge", "Zener",
    "bonded_layer",
    "converge", "design_indentation", "fit_indentation", "fit_map", "fit_material", "halfspace",
    "indent", "inside", "leakage", "load", "open_case", "open_results", "plot", "relaxation_spectrum",
    "run", "simulate", "solve",
]  # fmt: skip

_MODULES = {
    "gfmdlayer.config": ("Config", "ConfigError", "load"),
    "gfmdlayer.convergence.converge": ("converge",),
    "gfmdlayer.fitting.force_curve": ("ForceCurve",),
    "gfmdlayer.fitting.design": ("design_indentation",),
    "gfmdlayer.fitting.indentation": ("fit_indentation",),
    "gfmdlayer.fitting.material": ("fit_material",),
    "gfmdlayer.indentation.indent": ("indent",),
    "gfmdlayer.results.reader": ("open_case", "open_results"),
    "gfmdlayer.interactive.fit_map": ("fit_map",),
    "gfmdlayer.interactive.inside": ("inside",),
    "gfmdlayer.interactive.leakage": ("leakage",),
    "gfmdlayer.interactive.run": ("run",),
    "gfmdlayer.case.model": ("ConvergenceError", "simulate"),
    "gfmdlayer.case.case": ("Case",),
    "gfmdlayer.interactive.solve": ("solve",),
    "gfmdlayer.interface.adhesion": ("Dugdale", "Electrostatic", "Exponential", "LennardJones"),
    "gfmdlayer.punch.simple_shapes": (
        "BluntedCone", "Cone", "Cylinder", "Flat", "FlatPunch", "Parabola", "Pyramid", "RadialProfile",
        "Sinusoid", "Sphere", "Wedge",
    ),
    "gfmdlayer.punch.self_affine": ("SelfAffine",),
    "gfmdlayer.body.anisotropic": ("Anisotropic",),
    "gfmdlayer.body.lattice": ("Lattice",),
    "gfmdlayer.body.tabulated": ("Tabulated",),
    "gfmdlayer.body.closed_form": ("LayeredHalfspace", "relaxation_spectrum"),
    "gfmdlayer.errors": ("GfmdlayerError",),
    "gfmdlayer.figures.pictures": ("plot",),
    "gfmdlayer.fitting.measurement": ("FitError",),
    "gfmdlayer.punch.measured": ("Topography",),
    "gfmdlayer.results.names": ("ResultsError",),
    "gfmdlayer.study.folder": ("FolderError",),
    "gfmdlayer.body.layer": ("Halfspace", "Layer"),
    "gfmdlayer.body.layers": ("LayerStack", "ViscoelasticLayer", "bonded_layer", "halfspace"),
    "gfmdlayer.body.materials": ("Elastic", "Material", "Prony", "Zener"),
    "gfmdlayer.observables": ("Column", "Observable"),
    "gfmdlayer.body.continuous": ("FractionalZener", "HavriliakNegami", "Kohlrausch", "PowerLaw"),
    "gfmdlayer.body.shifts": ("WLF", "Arrhenius"),
    "gfmdlayer.body.relaxation": ("Spectrum", "TractionSpectrum"),
    "gfmdlayer.body.pair": ("Pair",),
    "gfmdlayer.body.solid": ("Solid",),
    "gfmdlayer.body.wavevectors": ("Wavevectors",),
}  # fmt: skip
_FRAMES_OF_HELP = 4  # from `docmodule` of pydoc to `__dir__`
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("gfmdlayer")
    if name not in _HOME:
        from gfmdlayer.validation.problems import nearest

        hint = "" if name.startswith("_") else nearest(name, __all__)
        raise AttributeError(f"module 'gfmdlayer' has no attribute {name!r}{hint}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """Return the public names; none where `help` asks, whose pages of all names would hide those above."""
    frame, depth = sys._getframe(), 0
    while frame.f_back is not None and depth < _FRAMES_OF_HELP:
        frame, depth = frame.f_back, depth + 1
        if frame.f_code.co_name == "docmodule":
            return []
    return __all__
