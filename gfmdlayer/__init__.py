"""Contact of a rigid punch with a viscoelastic layer on an elastic halfspace, by GFMD.

The public names; each is imported when it is first used, so that ``import gfmdlayer`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gfmdlayer.body.anisotropic import Anisotropic
    from gfmdlayer.body.closed_form import LayeredHalfspace, relaxation_spectrum
    from gfmdlayer.body.continuous import FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw
    from gfmdlayer.body.lattice import Lattice
    from gfmdlayer.body.layer import Layer
    from gfmdlayer.body.layers import LayerStack, ViscoelasticLayer, bonded_layer, halfspace
    from gfmdlayer.body.materials import Elastic, Prony, Zener
    from gfmdlayer.body.pair import Pair
    from gfmdlayer.body.relaxation import Spectrum
    from gfmdlayer.body.shifts import WLF, Arrhenius
    from gfmdlayer.body.solid import Solid
    from gfmdlayer.body.tabulated import Tabulated
    from gfmdlayer.body.wavevectors import Wavevectors
    from gfmdlayer.case.case import Case
    from gfmdlayer.case.model import ConvergenceError, simulate
    from gfmdlayer.config import Config, ConfigError, load
    from gfmdlayer.convergence.converge import converge
    from gfmdlayer.fitting.design import design_indentation
    from gfmdlayer.fitting.force_curve import ForceCurve
    from gfmdlayer.fitting.indentation import fit_indentation
    from gfmdlayer.indentation.indent import indent
    from gfmdlayer.interactive.fit_map import fit_map
    from gfmdlayer.interactive.inside import inside
    from gfmdlayer.interactive.leakage import leakage
    from gfmdlayer.interactive.run import run
    from gfmdlayer.interactive.solve import solve
    from gfmdlayer.interface.adhesion import Dugdale, Electrostatic, Exponential, LennardJones
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
    from gfmdlayer.results.reader import open_case, open_results

__all__ = [
    "WLF", "Anisotropic", "Arrhenius", "BluntedCone", "Case", "Cone", "Config", "ConfigError",
    "ConvergenceError", "Cylinder", "Dugdale", "Elastic", "Electrostatic", "Exponential", "Flat",
    "FlatPunch", "ForceCurve", "FractionalZener", "HavriliakNegami", "Kohlrausch", "Lattice", "Layer",
    "LayerStack", "LayeredHalfspace", "LennardJones", "Pair", "Parabola", "PowerLaw", "Prony", "Pyramid",
    "RadialProfile", "SelfAffine", "Sinusoid", "Solid", "Spectrum", "Sphere", "Tabulated",
    "ViscoelasticLayer", "Wavevectors", "Wedge", "Zener", "bonded_layer", "converge", "design_indentation",
    "fit_indentation", "fit_map", "halfspace",
    "indent", "inside", "leakage", "load", "open_case", "open_results", "relaxation_spectrum", "run",
    "simulate", "solve",
]  # fmt: skip

_MODULES = {
    "gfmdlayer.config": ("Config", "ConfigError", "load"),
    "gfmdlayer.convergence.converge": ("converge",),
    "gfmdlayer.fitting.force_curve": ("ForceCurve",),
    "gfmdlayer.fitting.design": ("design_indentation",),
    "gfmdlayer.fitting.indentation": ("fit_indentation",),
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
    "gfmdlayer.body.layer": ("Layer",),
    "gfmdlayer.body.layers": ("LayerStack", "ViscoelasticLayer", "bonded_layer", "halfspace"),
    "gfmdlayer.body.materials": ("Elastic", "Prony", "Zener"),
    "gfmdlayer.body.continuous": ("FractionalZener", "HavriliakNegami", "Kohlrausch", "PowerLaw"),
    "gfmdlayer.body.shifts": ("WLF", "Arrhenius"),
    "gfmdlayer.body.relaxation": ("Spectrum",),
    "gfmdlayer.body.pair": ("Pair",),
    "gfmdlayer.body.solid": ("Solid",),
    "gfmdlayer.body.wavevectors": ("Wavevectors",),
}  # fmt: skip
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'gfmdlayer' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
