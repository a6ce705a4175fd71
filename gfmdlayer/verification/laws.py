"""Laws with a continuous spectrum and their Prony series; temperature against Boltzmann's integral."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.special import erfcx

from gfmdlayer.body.continuous import FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw
from gfmdlayer.body.shifts import WLF
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.punch.trajectory import Table
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import run

_TOLERANCE = 1e-4
_SHIFT = {"law": "wlf", "C1": 17.44, "C2": 51.6, "reference": 20.0}


def series_of_laws(quick: bool) -> Iterator[Row]:
    """The Prony series in place of laws with a continuous spectrum, at 2000 times and frequencies.

    The errors of G(t) and G(omega), relative to their magnitude, keep to the tolerance of the law between the
    samples of the fit. The law itself is checked for the exponent 1/2, where the function of Mittag-Leffler
    is exp(x) erfc(sqrt(x)); the contour integral reaches 1e-12.
    """
    half = FractionalZener(0.1, 1.0, 1.0, 0.5)
    t = np.geomspace(1e-6, 1e6, 2000)
    exact = 0.1 + 0.9 * erfcx(np.sqrt(t))
    found = float(np.abs(half.relaxation_modulus(t) / exact - 1).max())
    yield Row("fractional Zener, exponent 1/2: error of G(t)", 0.0, found, 1e-12, "exp(x) erfc(sqrt x)")
    decades = 4 if quick else 12
    laws = (
        half,
        PowerLaw(1.0, 1.0, 0.3),
        Kohlrausch(0.1, 1.0, 1.0, 0.5),
        HavriliakNegami(0.1, 1.0, 1.0, 0.7, 0.5),
    )
    for law in laws:
        width = decades if law is half else 4
        shortest, longest = 10.0 ** (-width / 2), 10.0 ** (width / 2)
        series = law.prony(shortest, longest, _TOLERANCE).material
        t = np.geomspace(shortest, longest, 2000)
        in_time = np.abs(series.relaxation_modulus(t) / law.relaxation_modulus(t) - 1).max()
        in_frequency = np.abs(series.complex_modulus(1 / t) / law.complex_modulus(1 / t) - 1).max()
        name = f"{law.model}, {width} decades by {len(series.maxwell_branches)} branches: error of"
        yield Row(f"{name} G(t)", 0.0, float(in_time), _TOLERANCE, "the law itself")
        yield Row(f"{name} G(omega)", 0.0, float(in_frequency), _TOLERANCE, "the law itself")


def jump_of_temperature(_quick: bool) -> Iterator[Row]:
    """A flat punch on the material alone, in which the temperature rises from 18 to 30 degrees in 1e-3 tau.

    The contact does not change, so that p(t) = p_0 int G(xi(t) - xi(s))/G0 dh(s)/h_0, p_0 the pressure on
    the relaxed material and the reduced time xi. The displacement is linear over each step, for which the
    exponential scheme is exact: what remains is the tolerance of the solver, 1e-10, of both runs, and the
    rounded edges of the punch, 1e-6 of the cell, which are less than a tenth of a point. The bound is a
    hundred times the tolerance, for a pressure that falls to a tenth of its peak.
    """
    rows = (0.0, 18.0), (1.0, 18.0), (1.001, 30.0), (3.0, 30.0)
    tolerance = 1e-10
    flat: dict[str, object] = {
        "layer.thickness": math.inf,
        "punch": {"shape": "flat", "width": 0.25, "edge_radius": 1e-6},
        "trajectory": {"depth": 0.01, "ramp_time": 0.5},
        "solver.tolerance": tolerance,
        "grid.points": 128,
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "jump.txt"
        file.write_text("".join(f"{time} {degrees}\n" for time, degrees in rows))
        jump: dict[str, object] = {
            "layer.material": {"model": "zener", "shift": _SHIFT},
            "temperature": {"file": str(file)},
            "time": {"step": "adaptive", "tolerance": 1e-5, "end": 3.0},
        }
        found = run(flat | jump)
    elastic = run(flat | {"layer.material": {"model": "elastic"}, "time": {"step": 0.25, "end": 0.5}})
    shift = WLF(C1=17.44, C2=51.6, reference=20.0)
    reduced = ReducedTime(shift, Table(*np.array(rows).T))
    slow = shift.factor(18.0)
    held = found["time"] >= 0.5
    xi = np.array([reduced.step(0.0, time) for time in found["time"][held]])
    ramp = slow * math.expm1(0.5 / slow) / 0.5
    exact = elastic["mean_pressure"][-1] * (1 + 9 * np.exp(-xi) * ramp)
    error = float(np.abs(found["mean_pressure"][held] / exact - 1).max())
    yield Row("p(t)/p - 1, jump of temperature", 0.0, error, 100 * tolerance, "Boltzmann's integral")
