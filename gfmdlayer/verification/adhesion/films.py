"""Films that are attracted across a gap: uniform pull-in, the wavelength of the instability, its delay."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.layer import LayeredHalfspace
from gfmdlayer.verification.rows import Row
from gfmdlayer.verification.runs import ELASTIC, RIGID, Recording, run

_PULL_IN = "V^2 = 8 K (g0 + h0)^3/(27 eps0)"
_FILM = "Shenoy and Sharma, Phys. Rev. Lett. 86 (2001) 119"
_DELAY = "equation of the uniform mode, by an adaptive Runge-Kutta method"

_GAP, _INSULATION, _VOLTAGE = 2e-3, 1e-3, 1.0
_THICKNESS, _POISSON = 0.05, 0.2  # compressible enough for the uniform mode to be the softest
_FLAT = {"shape": "sinusoid", "amplitude": 1e-12, "wavelength": 1.0}


def _voltage(square: float) -> dict[str, object]:
    """Interface of a voltage of one; `square` is eps0 V^2."""
    return {"law": "electrostatic", "voltage": _VOLTAGE, "insulation": _INSULATION, "permittivity": square}


def _first(found: Recording, quantity: str) -> float:
    """Time or depth of the first instability of a run."""
    return float(np.asarray(found.noted[f"instability_{quantity}"])[0])


def pull_in(_quick: bool) -> Iterator[Row]:
    """A flat punch under voltage, brought down upon a compressible film on a rigid base.

    The film, a spring K(0) = 2 G (1 - nu)/((1 - 2 nu) d) per area, snaps to the punch where the gap at rest
    g0 is such that eps0 V^2 = 8 K (g0 + h0)^3/(27). Adaptive steps locate an instability to a thousandth of
    a gap.
    """
    stiffness = float(LayeredHalfspace(_THICKNESS, _POISSON, math.inf).stiffness(0.0, 1.0))
    square = 8 * stiffness * (_GAP + _INSULATION) ** 3 / 27
    motion = {"kind": "approach_retract", "start": -2 * _GAP, "depth": 0.0, "final": -2 * _GAP,
              "approach_speed": _GAP, "retract_speed": _GAP}  # fmt: skip
    values: dict[str, object] = {
        "grid.points": 16,
        "layer.thickness": _THICKNESS,
        "layer.poisson": _POISSON,
        "punch": _FLAT,
        "interface": _voltage(square),
        "trajectory": motion,
        "time": {"end": 2.0, "step": "adaptive", "tolerance": 1e-4},
    }
    found = run(RIGID, ELASTIC, values)
    yield Row("g0 at pull-in", _GAP, -_first(found, "depth"), 1e-3 * _GAP, _PULL_IN)


def flat_film(_quick: bool) -> Iterator[Row]:
    """The wavelength at which a flat incompressible film becomes unstable under a punch at a distance.

    The flat state ends where the attraction falls with the gap faster than the softest wave of the film is
    stiff: 6.2229 G/d, at q d = 2.1196. The grid has waves at steps of 2 pi d/L = 0.1 in q d. Heights of 1e-5
    of the gap choose the phase, and lower the threshold by a part of the order of (1e-5)^(2/3).
    """
    period = 2 * math.pi * 10 * _THICKNESS
    q = 2 * math.pi / period * np.arange(1, 65)
    stiffness = LayeredHalfspace(_THICKNESS, 0.5, math.inf).stiffness(q, 1.0)
    softest = int(np.argmin(stiffness))
    square = float(stiffness[softest]) * (_GAP + _INSULATION) ** 3
    motion = {"kind": "approach_retract", "start": -1.5 * _GAP, "depth": 0.0, "final": -2 * _GAP,
              "approach_speed": _GAP, "retract_speed": _GAP}  # fmt: skip
    rough = {
        "shape": "self_affine",
        "hurst": 0.8,
        "short_cutoff": _THICKNESS,
        "roll_off": 1.2 * _THICKNESS,
        "rms_height": 1e-5 * _GAP,
    }
    values: dict[str, object] = {
        "grid": {"points": 256, "period": period},
        "layer.thickness": _THICKNESS,
        "punch": rough | {"seed": 1},
        "interface": _voltage(square),
        "trajectory": motion,
        "time": {"end": 1.0, "step": "adaptive", "tolerance": 1e-4},
        "output.snapshots": "every",
    }
    found = run(RIGID, ELASTIC, values)
    closest = -_first(found, "depth")
    theory = 6.2229 / _THICKNESS
    attraction = square / (closest + _INSULATION) ** 3
    yield Row("|w''| where the flat film ends", theory, attraction, 5e-3 * theory, _FILM)
    before = max(each[0] for each in found.snapshots if each[0] < _first(found, "time"))
    shape = next(u for time, u, _ in found.snapshots if time == before)
    wave = int(np.argmax(np.abs(np.fft.rfft(shape))[1:]))
    yield Row("q d of the wave that grows", 2.1196, float(q[wave]) * _THICKNESS, 0.1, _FILM)


def delayed_pull_in(_quick: bool) -> Iterator[Row]:
    """A film that is stable while it is glassy, and snaps to the punch late, because it relaxes.

    The punch is brought at once to a distance between those of pull-in of the glassy and of the relaxed
    film. The uniform mode, a Zener spring of K(0) times G(t)/G0, sinks towards it until no equilibrium is
    left: K_inf u - w xi = eps0 V^2/(2 (g0 + h0 - u)^2), tau dxi/dt + xi = u.
    """
    relaxed, contrast = float(LayeredHalfspace(_THICKNESS, _POISSON, math.inf).stiffness(0.0, 1.0)), 4.0
    rest = _GAP + _INSULATION
    square = 8 * 1.5 * relaxed * rest**3 / 27  # half more than the relaxed film carries
    glassy, weight = contrast * relaxed, (contrast - 1) * relaxed

    last = rest - (square / glassy) ** (1 / 3)  # beyond it the attraction grows faster than the film's stress

    def excess(u: float, xi: float) -> float:
        return float(glassy * u - weight * xi - square / (2 * (rest - u) ** 2))

    def rate(_time: float, state: FloatArray) -> list[float]:
        xi = float(state[0])
        u = brentq(excess, 0.0, last, args=(xi,), xtol=1e-15) if excess(last, xi) > 0 else last
        return [float(u) - xi]

    def ends(_time: float, state: FloatArray) -> float:
        return excess(last, float(state[0]))

    ends.terminal = True  # type: ignore[attr-defined]
    followed = solve_ivp(rate, (0, 50), [0.0], events=ends, rtol=1e-9, atol=1e-15)
    theory = float(followed.t_events[0][0])
    sudden = _GAP / 1e-6
    motion = {"kind": "approach_retract", "start": -2 * _GAP, "depth": -_GAP, "final": -2 * _GAP,
              "approach_speed": sudden, "retract_speed": sudden, "dwell": 2 * theory}  # fmt: skip
    values: dict[str, object] = {
        "grid.points": 16,
        "layer.thickness": _THICKNESS,
        "layer.poisson": _POISSON,
        "layer.material.Ginf": contrast,
        "punch": _FLAT,
        "interface": _voltage(square),
        "trajectory": motion,
        "time": {"end": 2 * theory, "step": "adaptive", "tolerance": 1e-4},
    }
    found = run(RIGID, values)
    yield Row("time of pull-in/tau", theory, _first(found, "time"), 0.02 * theory, _DELAY)
