"""Tables and figure of docs/theory/indentation.md: accuracy of fits, errors of polynomial corrections.

python scripts/indentation_fits.py coverage [DRAWS [KIND ...]]   how many 95 % intervals have the true value
python scripts/indentation_fits.py instruments [DRAWS [adhesion]]   the same for depth, force and base
python scripts/indentation_fits.py peers              moduli by polynomial corrections on the same curves
python scripts/indentation_fits.py thickness          contact sizes at which the base changes the force
python scripts/indentation_fits.py histories          standard errors by history
python scripts/indentation_fits.py pages               pictures of docs/guides: afm, nanoindenter, flat punch
python scripts/indentation_fits.py figure             docs/theory/indentation.svg
python scripts/indentation_fits.py loops              docs/theory/sticky-loops.svg: adhesion at three speeds
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq, least_squares

import gfmdlayer
from gfmdlayer import ForceCurve, design_indentation, fit_indentation
from gfmdlayer.body.closed_form import LayeredHalfspace
from gfmdlayer.body.layers import ViscoelasticLayer
from gfmdlayer.body.materials import Prony
from gfmdlayer.figures.plot_style import save
from gfmdlayer.fitting import stepped
from gfmdlayer.fitting.elastic import adhesion_of, work_for
from gfmdlayer.fitting.estimates import BAND, covariance, quantile
from gfmdlayer.fitting.force_curve import Correction
from gfmdlayer.fitting.indentation_report import fit_figure, summary
from gfmdlayer.fitting.prediction import Prediction
from gfmdlayer.fitting.problem import IndentationModel, LeastSquares, free_parameters
from gfmdlayer.indentation.solve import History, find_space, on_steps
from gfmdlayer.punch.revolution import paraboloid

RADIUS, DEPTH = 5.0, 0.2  # a contact of about one thickness of the thin layer
ROWS = 401
FINE = 160  # steps of the curves that stand for the truth
ZENER = ("layer.material.G0", "layer.material.Ginf", "layer.material.tau")
OWN = ("contact_point", "force_offset")
BRANCHES = tuple(f"layer.material.branches[{k}].{key}" for k in (0, 1) for key in ("G", "tau"))
# Dimitriadis et al., Biophys. J. 82 (2002) 2798; Garcia & Garcia, Biophys. J. 114 (2018) 2923; bonded.
POLYNOMIALS = {
    "Hertz": (1.0,),
    "Dimitriadis": (1.0, 1.133, 1.283, 0.769, 0.0975),
    "Garcia": (1.0, 1.133, 1.497, 1.469, 0.755),
}


def model(thickness: float, base: float, branches: int = 1) -> dict[str, Any]:
    """Return a layer of G0 = 1, Ginf = 5."""
    material: dict[str, Any] = {"model": "zener", "G0": 1.0, "Ginf": 5.0, "tau": 0.7}
    if branches == 2:
        pairs = [{"G": 2.5, "tau": 0.1}, {"G": 1.5, "tau": 1.5}]
        material = {"model": "prony", "G0": 1.0, "branches": pairs}
    return {
        "layer": {"thickness": thickness, "poisson": 0.5, "material": material},
        "halfspace": {"shear_modulus": base},
        "punch": {"shape": "parabola", "radius": RADIUS},
    }


def history(*corners: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return times and depths of straight pieces."""
    at, depth = np.array(corners).T
    times = np.linspace(at[0], at[-1], ROWS)
    return times, np.interp(times, at, depth)


RAMP_HOLD_BACK = history((-0.4, -0.08), (1, DEPTH), (4, DEPTH), (5, -0.02))


def truth(data: dict[str, Any], motion: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the force of a model, with many steps."""
    times, depth = motion
    curve = ForceCurve("truth", times, depth, np.maximum(depth, 0.0), prescribed="depth")
    return responses(data, curve)[0]


def responses(data: dict[str, Any], curve: ForceCurve) -> tuple[np.ndarray, np.ndarray]:
    """Return the force and the depth of a model under the prescribed column of a curve, with many steps."""
    model = IndentationModel(data)
    prediction, config = Prediction(curve), model.config
    at = Correction(stiffness=curve.stiffness or math.inf, adhesion=adhesion_of(model.adhesion))
    steps, stepped.STEPS = stepped.STEPS, FINE
    prediction.adapt(config, at)
    stepped.STEPS = steps
    return prediction.response(config, at)


KINDS: dict[str, tuple[dict[str, Any], float, tuple[str, ...]]] = {
    "thin, soft base": (model(1.0, 0.3), 0.01, ZENER),
    "thin, rigid base": (model(1.0, math.inf), 0.01, (*ZENER, OWN[0])),
    "thick, stiff base": (model(4.0, 30.0), 0.05, ZENER),
    "thick, soft base": (model(4.0, 0.3), 0.05, (*ZENER, OWN[0])),
    "thin, rigid base, offset": (model(1.0, math.inf), 0.05, (*ZENER, *OWN)),
    "thin, stiff base": (model(1.0, 10.0), 0.01, (*ZENER, "layer.thickness", OWN[0])),
    "thin, soft base unknown": (model(1.0, 0.3), 0.01, (*ZENER, *OWN, "halfspace.shear_modulus")),
    "thick, two branches": (model(4.0, math.inf, 2), 0.01, (ZENER[0], *BRANCHES, OWN[0])),
}


def at_truth(
    data: dict[str, Any], free: tuple[str, ...], motion: tuple[np.ndarray, np.ndarray], noise: float
) -> LeastSquares:
    """Return the problem of a curve without noise, started at the true values; and the noise."""
    force = truth(data, motion)
    curve = ForceCurve("a", *motion, force, noise=noise * float(force.max()))
    spans = {"contact_point": (-DEPTH, DEPTH), "force_offset": (-float(force.max()), float(force.max()))}
    problem = LeastSquares(
        IndentationModel(data),
        free_parameters(IndentationModel(data), free, ["a"], spans),
        [Prediction(curve)],
    )
    problem.adapt(problem.start)
    return problem


def held_by_theory(problem: LeastSquares, draws: np.ndarray) -> int:
    """Return how many intervals of the linear problem contain the true value for the same draws of noise.

    For a linear problem 95 % is exact, apart from chance. `draws`, shape (draws, rows), is the noise over its
    standard deviation.
    """
    jacobian, slopes = problem.jacobian(problem.start), problem.reported(problem.start)[1]
    spread = covariance(jacobian, 1.0)
    moved = draws @ jacobian @ spread
    freedom = draws.shape[1] - jacobian.shape[1]
    found = np.linalg.norm(draws - moved @ jacobian.T, axis=1) / freedom**0.5
    widths = quantile(BAND, freedom) * np.outer(found, np.sqrt(np.diag(slopes @ spread @ slopes.T)))
    return int(np.sum(np.abs(moved @ slopes.T) <= widths))


def coverage(draws: str = "25", *kinds: str) -> None:
    """Fit noisy curves of all or of the named kinds, and count the intervals with the true value."""
    rng = np.random.default_rng(0)
    number, total, held, theory, seconds = int(draws), 0, 0, 0, []
    print(f"{'kind':26} noise  free  with truth   linear   each parameter (%)            CPU s: median, most")
    for name in kinds or KINDS:
        data, noise, free = KINDS[name]
        problem, known = at_truth(data, free, RAMP_HOLD_BACK, noise), IndentationModel(data).keys
        clean = problem.predictions[0].curve.force
        inside, spent, drawn = np.zeros(len(free)), [], np.empty((number, clean.size))
        for row in drawn:
            row[:] = rng.standard_normal(clean.size)
            force = clean + noise * clean.max() * row
            begun = time.process_time()
            fit = fit_indentation(ForceCurve("curve", *RAMP_HOLD_BACK, force), started(data, rng), list(free))
            spent.append(time.process_time() - begun)
            for i, key in enumerate(free):
                low, high = fit[key].interval
                inside[i] += low <= known.get(key, 0.0) <= high
        linear, every = held_by_theory(problem, drawn), number * len(free)
        share = " ".join(f"{100 * each / number:3.0f}" for each in inside)
        seen = f"{np.median(spent):.2f}, {max(spent):.2f}"
        counts = f"{inside.sum():4.0f} of {every:4d} {linear:7d}"
        print(f"{name:26} {noise:5.0%}  {len(free):4d}  {counts}   {share:28}  {seen}", flush=True)
        total, held, theory = total + every, held + int(inside.sum()), theory + linear
        seconds += spent
    print(f"{len(seconds)} curves: {held} of {total} intervals contain the true value, {held / total:.1%}")
    print(f"linear problem with the same noise: {theory}, {theory / total:.1%}")
    print(f"CPU seconds of a fit: median {np.median(seconds):.2f}, maximum {max(seconds):.2f}")


INDENTERS = {
    "sphere": {"shape": "sphere", "radius": RADIUS},
    "cone": {"shape": "cone", "slope": 0.2},
    "flat": {"shape": "flat_punch", "radius": 1.0},
}
RUBBER: dict[str, Any] = {"model": "zener", "G0": 1.0, "Ginf": 5.0, "tau": 0.7}
UPPER = {"thickness": 0.5, "poisson": 0.5, "material": RUBBER}
LOWER = {"thickness": 1.0, "poisson": 0.45, "material": {"model": "elastic", "G": 3.0}}
SAMPLES: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "halfspace": ({"layer": UPPER | {"thickness": math.inf}}, ZENER),
    "layer": (
        {"layer": UPPER | {"thickness": 1.0}, "halfspace": {"shear_modulus": math.inf}},
        (*ZENER, "layer.thickness"),
    ),
    "stack": (
        {"layers": [UPPER, LOWER], "halfspace": {"shear_modulus": math.inf}},
        (*(key.replace("layer.", "layers[0].") for key in ZENER), "layers[1].material.G"),
    ),
}
ELASTIC = {"model": "elastic", "G": 1.0}
STICKING: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {  # elastic, with adhesion
    "halfspace": ({"layer": UPPER | {"thickness": math.inf, "material": ELASTIC}}, ("layer.material.G",)),
    "layer": (
        {"layer": UPPER | {"thickness": 1.0, "material": ELASTIC}, "halfspace": {"shear_modulus": math.inf}},
        ("layer.material.G", "layer.thickness"),
    ),
    "stack": (
        {"layers": [UPPER | {"material": ELASTIC}, LOWER], "halfspace": {"shear_modulus": math.inf}},
        ("layers[0].material.G", "layers[1].material.G"),
    ),
}
PULL = 0.15  # of the largest force: the largest pull of curves with adhesion
# Values of a curve that are free in the first, second, ... draw.
FREE_OF_CURVE = {
    "depth": ((), ("contact_point",), ("contact_point", "force_offset"), ("force_offset", "force_drift")),
    "force": ((), ("contact_point",), ("contact_point", "drift"), ("contact_point",)),
    "base": ((), ("contact_point",), ("contact_point", "force_offset"), ("contact_point", "stiffness")),
}


def instrument(
    data: dict[str, Any], prescribed: str, level: float, rng: np.random.Generator, both: bool
) -> ForceCurve:
    """Return a curve with noise of the measured quantity, and with `both` of the prescribed one too."""
    times, depth = RAMP_HOLD_BACK
    force = truth(data, RAMP_HOLD_BACK)
    most, back = float(force.max()), (0.1, DEPTH)  # part of the force, and depth, at the end
    noise = level * rng.standard_normal((2, ROWS))
    given: dict[str, Any] = {"prescribed": prescribed}
    early = late = 0.0
    if prescribed == "base":
        given["stiffness"] = most / DEPTH
    if "adhesion" in data:
        back = -0.8 * PULL, -1.4 * held_until(data, most / DEPTH if prescribed == "base" else math.inf)
        # The places of the jumps between two rows are random, as in an experiment.
        early, late = rng.uniform(0.0, 5.4 / (ROWS - 1), 2)
        top = 2 * DEPTH if prescribed == "base" else DEPTH
        end = top - (1 - late) * (top - back[1])
        motion = history((-0.4, top * (early - 0.4)), (1 - early, top), (4 + late, top), (5, end))
        times, depth = motion
        force = truth(data, motion)
    if prescribed == "force":
        times, force = history((0, 0), (1, most), (4, most), (5, back[0] * most))
        depth = responses(data, ForceCurve("truth", times, times, force, prescribed="force"))[1]
        depth = depth + noise[1] * np.ptp(depth)
    elif prescribed == "base":
        stiffness, base = given["stiffness"], depth if "adhesion" in data else 2 * depth
        seen = np.maximum(base, 0.0)
        force = responses(data, ForceCurve("truth", times, base - seen / stiffness, seen, **given))[0]
    elif both:
        depth = depth + noise[1] * np.ptp(depth)
    if prescribed != "force" or both:
        force = force + noise[0] * most
    if prescribed == "base":
        depth = base + noise[1] * np.ptp(base) * both - force / stiffness
    parts = np.diff(np.searchsorted(times, [-1, 1 - early, 4 + late, 6]))
    given["segment"] = np.repeat(["approach", "hold", "retract"], parts)
    return ForceCurve("curve", times, depth, force, **given)


def held_until(data: dict[str, Any], stiffness: float) -> float:
    """Return how far a base, or a depth, is drawn back until contact is lost."""
    times = np.linspace(0.0, 1.0, ROWS)
    kind = (
        {"prescribed": "depth"} if math.isinf(stiffness) else {"prescribed": "base", "stiffness": stiffness}
    )
    prediction = Prediction(ForceCurve("a", times, times, times, **kind))
    model = IndentationModel(data)
    at = Correction(stiffness=stiffness, adhesion=adhesion_of(model.adhesion))
    return -prediction.contacts(model.config, at).position.end


def sticking(data: dict[str, Any]) -> dict[str, Any]:
    """Return a model with the work of adhesion for a pull of a part of the largest force."""
    times, depth = RAMP_HOLD_BACK
    most = float(truth(data, RAMP_HOLD_BACK).max())
    curve = ForceCurve("a", times, depth, np.maximum(depth, 0.0), prescribed="depth")
    prediction = Prediction(curve)
    bare = prediction.contacts(IndentationModel(data).config, Correction())
    work = work_for(PULL * most, bare.equilibria)
    return data | {"adhesion": {"model": "jkr", "work": work}}


def instruments(draws: str = "12", adhesion: str = "") -> None:
    """Fit noisy curves of all instruments, indenters and samples; count the intervals with the truth."""
    rng, seconds, every = np.random.default_rng(1), [], []
    for prescribed in FREE_OF_CURVE:
        for shape, punch in INDENTERS.items():
            for sample, (body, keys) in (STICKING if adhesion else SAMPLES).items():
                data = body | {"punch": punch}
                if adhesion:
                    data, keys = sticking(data), (*keys, "adhesion.work")
                truths = IndentationModel(data).keys
                inside, spent, off = [], [], []
                for draw in range(int(draws)):
                    own = FREE_OF_CURVE[prescribed][draw % 4] or (("contact_point",) if adhesion else ())
                    free = (*(keys[:3] if draw % 2 else keys), *own)
                    curve = instrument(data, prescribed, (0.01, 0.05)[draw // 2 % 2], rng, draw % 3 == 2)
                    if "stiffness" in own:
                        wrong = float(1 + 0.1 * rng.standard_normal())
                        curve = miscalibrated(curve, wrong)
                    begun = time.process_time()
                    fit = fit_indentation(curve, started(data, rng, free), list(free))
                    spent.append(time.process_time() - begun)
                    for each in fit.parameters:
                        known = truths.get(each.key, 0.0)
                        if each.key == "stiffness":
                            known = curve.stiffness / wrong
                        low, high = each.interval
                        inside.append(low <= known <= high)
                        middle, width = each.value - known, high - low
                        if each.relative:
                            middle, width = math.log(each.value / known), math.log(high / low)
                        off.append(middle / max(width, 1e-300))
                every += [(ok, each) for ok, each in zip(inside, off, strict=True)]
                seconds += spent
                counts = f"{sum(inside):4d} of {len(inside):4d}   offset {np.median(off):+.3f} widths"
                seen = f"CPU s: {np.median(spent):.2f}, {max(spent):.2f}"
                print(f"{prescribed:6} {shape:7} {sample:10} {counts}   {seen}", flush=True)
    held = sum(ok for ok, _ in every)
    share = f"{held} of {len(every)} intervals contain the true value, {held / len(every):.1%}"
    print(f"{len(seconds)} curves: {share}")
    print(f"median offset over the width of the interval: {np.median([each for _, each in every]):+.4f}")
    print(f"CPU seconds of a fit: median {np.median(seconds):.2f}, maximum {max(seconds):.2f}")


def miscalibrated(curve: ForceCurve, factor: float) -> ForceCurve:
    """Return a curve whose stiffness, and so the force, is wrong by a factor; its error is 10 %."""
    return replace(curve, force=curve.force * factor, stiffness=curve.stiffness * factor, stiffness_error=0.1)


def started(data: dict[str, Any], rng: np.random.Generator, free: Sequence[str] = ()) -> dict[str, Any]:
    """Return a model whose materials are wrong by a factor of up to 2.5; of a stack, those that are free."""

    def moved(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: moved(each) for key, each in value.items()}
        if isinstance(value, list):
            return [moved(each) for each in value]
        return value * 2.5 ** rng.uniform(-1, 1) if isinstance(value, float) else value

    given = data["layers"] if "layers" in data else [data["layer"]]
    wrong = [len(given) == 1 or any(f"[{i}].material" in key for key in free) for i in range(len(given))]
    layers = [
        {**each, "material": moved(each["material"])} if is_wrong else each
        for each, is_wrong in zip(given, wrong, strict=True)
    ]
    for each in layers:
        if "Ginf" in each["material"]:
            each["material"]["Ginf"] = each["material"]["G0"] * 3
    sticks = {"adhesion": moved(data["adhesion"])} if "adhesion" in data else {}
    return {**data, **sticks, **({"layers": layers} if "layers" in data else {"layer": layers[0]})}


def hereditary(t: np.ndarray, elastic: np.ndarray, G0: float, Ginf: float, tau: float) -> np.ndarray:
    """Int G(t - s) dF_1(s), with F_1 linear between the rows."""
    force = np.zeros(t.size)
    memory = 0.0
    for i in range(1, t.size):
        step, grown = (t[i] - t[i - 1]) / tau, elastic[i] - elastic[i - 1]
        memory = memory * math.exp(-step) - grown * math.expm1(-step) / step
        force[i] = G0 * elastic[i] + (Ginf - G0) * memory
    return force


def by_polynomial(
    motion: tuple[np.ndarray, np.ndarray], force: np.ndarray, which: str, inside: bool, thickness: float
) -> np.ndarray:
    """Fit G0, Ginf and tau with a polynomial correction, inside the hereditary integral or outside."""
    times, depth = motion
    factor = np.polyval(POLYNOMIALS[which][::-1], np.sqrt(RADIUS * depth) / thickness)
    hertz = 16 / 3 * RADIUS**0.5 * depth**1.5

    def residual(u: np.ndarray) -> np.ndarray:
        G0, Ginf, tau = math.exp(u[0]), math.exp(u[0]) + math.exp(u[1]), math.exp(u[2])
        if inside:
            return hereditary(times, hertz * factor, G0, Ginf, tau) - force
        return hereditary(times, hertz, G0, Ginf, tau) * factor - force

    u = least_squares(residual, np.log([1.0, 4.0, 0.7])).x
    return np.array([math.exp(u[0]), math.exp(u[0]) + math.exp(u[1]), math.exp(u[2])])


def peers() -> None:
    """Print errors of moduli and time of other methods, for ramps and holds without noise."""
    motion = history((0, 0), (1, DEPTH), (4, DEPTH))
    print("| method | base | sqrt(R d)/h | G0 | Ginf | tau |\n|---|---|---|---|---|---|")
    for base, thickness in ((math.inf, 1.0), (math.inf, 2.0), (10.0, 1.0), (2.0, 1.0)):
        data = model(thickness, base)
        force = truth(data, motion)
        rows = {}
        for which in POLYNOMIALS:
            for inside in (True, False) if which != "Hertz" else (True,):
                place = "" if which == "Hertz" else ", inside" if inside else ", outside"
                rows[which + place] = by_polynomial(motion, force, which, inside, thickness)
        fit = fit_indentation(ForceCurve("a", *motion, force), data, list(ZENER))
        rows["exact"] = np.array([fit[key].value for key in ZENER])
        for name, found in rows.items():
            errors = " | ".join(f"{100 * each:+.1f} %" for each in found / np.array([1.0, 5.0, 0.7]) - 1)
            size = math.sqrt(RADIUS * DEPTH) / thickness
            print(f"| {name} | {'rigid' if math.isinf(base) else f'{base:g} G0'} | {size:g} | {errors} |")


def elastic_factor(ratio: float, base: float, poisson: float = 0.5) -> float:
    """F/F_Hertz of a paraboloid at sqrt(R d)/h on an elastic layer of unit modulus."""
    layer = ViscoelasticLayer(LayeredHalfspace(1.0, poisson, base, 0.5), Prony(1.0))
    depth = ratio**2 / 50.0
    profile = paraboloid(50.0)
    ends = History(np.array([0.0, 1.0]), np.array([0.0, depth]))
    found = on_steps(layer, find_space(layer, profile, ends), profile, ends, ends.time)
    return float(found.force[-1] / (8 / 3 * 50.0**0.5 * depth**1.5 / (1 - poisson)))


def thickness() -> None:
    """Print the contact sizes at which the base changes the force by 1, 5 and 10 %."""
    print("| base | nu | 1 % | 5 % | 10 % |\n|---|---|---|---|---|")
    for base in (0.1, 0.5, 2.0, 10.0, math.inf):
        for poisson in (0.5, 0.3):
            found = []
            for part in (0.01, 0.05, 0.1):

                def away(log_ratio: float, base=base, poisson=poisson, part=part) -> float:
                    return abs(elastic_factor(math.exp(log_ratio), base, poisson) - 1) - part

                found.append(f"{math.exp(brentq(away, math.log(1e-3), math.log(3.0), xtol=1e-3)):.3f}")
            name = "rigid" if math.isinf(base) else f"{base:g} G"
            print(f"| {name} | {poisson:g} | {' | '.join(found)} |")


HISTORIES = {
    "ramp in 1 tau": ((0, 0), (1, 1)),
    "ramp in 0.1 tau, hold 5 tau": ((0, 0), (0.1, 1), (5.1, 1)),
    "ramp in 1 tau, hold 1 tau": ((0, 0), (1, 1), (2, 1)),
    "ramp in 1 tau, hold 5 tau": ((0, 0), (1, 1), (6, 1)),
    "ramp in 10 tau, hold 5 tau": ((0, 0), (10, 1), (15, 1)),
    "ramp 0.1 to half, hold 2, to the whole, hold 3": ((0, 0), (0.1, 0.5), (2.1, 0.5), (2.2, 1), (5.2, 1)),
    "ramp 1, hold 4, back in 1": ((0, 0), (1, 1), (5, 1), (6, 0)),
    "ramp 0.1, back in 3, ramp 3, back in 0.1": ((0, 0), (0.1, 1), (3.1, 0), (6.1, 1), (6.2, 0)),
}


def histories() -> None:
    """Print standard errors of parameters for several histories with equal rows and 1 % noise."""
    sets = {
        "material": ZENER,
        "and contact point": (*ZENER, OWN[0]),
        "and thickness": (*ZENER, "layer.thickness"),
    }
    print("| history | G0 | Ginf | tau | with contact point: G0 | Ginf | with thickness: G0 | thickness |")
    print("|---|---|---|---|---|---|---|---|")
    data = model(1.0, 10.0)
    for name, corners in HISTORIES.items():
        motion = history(*((0.7 * t, DEPTH * d) for t, d in corners))
        errors = {}
        for label, free in sets.items():
            problem = at_truth(data, free, motion, 0.01)
            slopes = problem.reported(problem.start)[1]
            spread = slopes @ covariance(problem.jacobian(problem.start), 1.0) @ slopes.T
            errors[label] = 100 * np.sqrt(np.diag(spread))
        first, second, third = errors.values()
        cells = (*first, second[0], second[1], third[0], third[3])
        print(f"| {name} | {' | '.join(f'{each:.2g} %' for each in cells)} |")


def figure() -> None:
    """Draw exact and polynomial corrections and their errors."""
    from gfmdlayer.figures.plot_style import colours, line_style, new_figure, save, styled

    sizes = np.linspace(0.02, 1.5, 40)
    bases = {"rigid base": math.inf, "base 10 G": 10.0, "base 2 G": 2.0, "base 0.5 G": 0.5}
    exact = {name: np.array([elastic_factor(each, base) for each in sizes]) for name, base in bases.items()}
    with styled():
        picture = new_figure(2, 75.0)
        left, right = picture.subplots(1, 2)
        dark = colours(len(bases) + 2)
        for i, (name, values) in enumerate(exact.items()):
            left.plot(sizes, values, color=dark[i], label=f"exact, {name}")
        for i, which in enumerate(("Dimitriadis", "Garcia")):
            polynomial = np.polyval(POLYNOMIALS[which][::-1], sizes)
            left.plot(sizes, polynomial, color="black", linestyle=line_style(2 * i + 1), label=which)
            for k, name in enumerate(list(bases)[:3]):
                error = 100 * (exact[name] / polynomial - 1)
                right.plot(
                    sizes, error, color=dark[k], linestyle=line_style(2 * i + 1), label=f"{which}, {name}"
                )
        left.set(xlabel=r"$\sqrt{R\delta}/h$", ylabel=r"$F/F_\mathrm{Hertz}$", yscale="log")
        right.set(xlabel=r"$\sqrt{R\delta}/h$", ylabel="error of the modulus (%)", ylim=(-90, 110))
        right.axhline(0, color="black", linewidth=0.5)
        for axes, letter in ((left, "a"), (right, "b")):
            axes.set_title(f"({letter})", loc="left")
            axes.legend(fontsize=7, loc="upper left" if axes is left else "upper right")
    save(picture, Path(__file__).parents[1] / "docs" / "indentation.svg")


def loops() -> None:
    """Draw the approach and retraction of a sphere that sticks to a relaxing halfspace, at three speeds."""
    from gfmdlayer.figures.plot_style import colours, new_figure, save, styled

    body = gfmdlayer.halfspace(gfmdlayer.Prony(1.0, [(9.0, 1.0)]))
    elastic = gfmdlayer.halfspace(1.0)
    sphere, unit = gfmdlayer.Parabola(radius=1.0), 1.5 * math.pi * 0.01
    with styled():
        picture = new_figure(2, 75.0)
        left, right = picture.subplots(1, 2)
        shades = colours(4)
        jkr = gfmdlayer.indent(elastic, sphere, [0, 1, 3], depth=[0, 0.05, -0.05], work=0.01, tolerance=1e-5)
        for speed, shade, label in (
            (1e-4, shades[0], "slow"),
            (0.01, shades[1], "medium"),
            (1.0, shades[2], "fast"),
        ):
            duration = 0.05 / speed
            found = gfmdlayer.indent(
                body, sphere, [0, duration, 13 * duration], depth=[0, 0.05, -0.55],
                work=0.01, edge_speed=0.01,
            )  # fmt: skip
            shown = np.flatnonzero(found.contact_radius.values > 0)[-1] + 2
            name = f"{label}: {speed:g} R/τ"
            left.plot(found.depth[:shown], found.force[:shown] / unit, color=shade, label=name)
            right.plot(found.depth[:shown], found.contact_radius[:shown], color=shade, label=name)
        for axes, name in ((left, "force"), (right, "contact_radius")):
            values = jkr[name] / (unit if name == "force" else 1.0)
            axes.plot(
                jkr.depth, values, color="black", linestyle="--", linewidth=0.8, label="JKR, relaxed, w"
            )
            axes.set_xlabel("depth / R")
            axes.set_title("(a)" if axes is left else "(b)", loc="left")
        left.set_ylabel("force / (3/2 π w R)")
        right.set_ylabel("contact radius / R")
        left.axhline(0, color="black", linewidth=0.5)
        left.legend(loc="upper left")
    save(picture, Path(__file__).parents[1] / "docs" / "theory" / "sticky-loops.svg")


GUIDES = Path(__file__).parents[1] / "docs" / "guides"
SI = {"length": "um", "stress": "kPa", "time": "s"}  # forces in nN
GEL: dict[str, Any] = {
    "units": SI,
    "layer": {"thickness": 2.0, "material": {"model": "zener", "G0": 1.5, "Ginf": 6.0, "tau": 0.8}},
    "halfspace": {"shear_modulus": math.inf},
    "punch": {"shape": "sphere", "radius": 5.0},
}


def begun(data: dict[str, Any], G0: float, Ginf: float, tau: float, **layer: float) -> dict[str, Any]:
    """Return a model of one layer from which a fit starts."""
    material = {"model": "zener", "G0": G0, "Ginf": Ginf, "tau": tau}
    return data | {"layer": data["layer"] | {"material": material} | layer}


def pages() -> None:
    """Draw the pictures of the guides."""
    rng = np.random.default_rng(2)
    save(fit_figure(afm(rng)), GUIDES / "afm.png")
    save(fit_figure(adhesive()), GUIDES / "afm-adhesion.png")
    nanoindenter(rng)
    save(fit_figure(flat_punch(rng)), GUIDES / "flat-punch.png")


def afm(rng: np.random.Generator) -> Any:
    """Fit approach, pause at constant force and retraction of a soft cantilever with a tilted baseline."""
    stiffness, end = 60.0, 4.5  # nN/um, which is 0.06 N/m
    time = np.linspace(0.0, 6.0, 601)
    base = np.interp(time, [0, 1.5], [-1.0, 0.7])
    pause = (time > 1.5) & (time <= end)
    words = np.where(pause, "force", "base")
    at = Correction(stiffness=stiffness)

    def solved(rows: np.ndarray, base: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        curve = ForceCurve(
            "a", time[rows], (base - force / stiffness)[rows], force[rows], prescribed=list(words[rows]),
            stiffness=stiffness,
        )  # fmt: skip
        prediction, config = Prediction(curve), IndentationModel(GEL).config
        steps, stepped.STEPS = stepped.STEPS, FINE
        prediction.adapt(config, at)
        stepped.STEPS = steps
        return prediction.response(config, at)

    approach = time <= 1.5
    first, _ = solved(approach, base, np.maximum(base, 0.0))
    force = np.where(pause, first[-1], np.maximum(base, 0.0))
    until = time <= end
    found, depth = solved(until, base, force)
    base = np.where(pause, np.interp(time, time[until], depth + found / stiffness), base)
    base = np.where(time > end, base[until][-1] - 1.6 * (time - end), base)
    found, depth = solved(time >= 0, base, force)
    noise = rng.standard_normal((2, time.size))
    measured = found + 0.01 * found.max() * noise[0] + 0.4 + 0.3 * (base - base[0])
    measured = np.where(pause, found + 0.4 + 0.3 * (base - base[0]), measured)
    position = np.where(pause, base + 0.003 * noise[1], base) - measured / stiffness + 0.2
    words = np.where(time <= 1.5, "approach", np.where(pause, "pause", "retract"))
    curve = ForceCurve(
        "afm", time, position, 1.06 * measured, segment=list(words), stiffness=1.06 * stiffness,
        stiffness_error=0.1, prescribed=["force" if each == "pause" else "base" for each in words],
    )  # fmt: skip
    curve = replace(curve, depth=position + measured / stiffness - curve.force / curve.stiffness)
    fit = fit_indentation(curve, begun(GEL, 1.0, 3.0, 1.0), [*ZENER, "tilt"], contact="detect")
    print("\n".join(summary(fit)))
    return fit


def adhesive() -> Any:
    """Fit a cantilever that jumps onto an elastic gel and off, and choose the adhesion."""
    rng = np.random.default_rng(3)
    layer = GEL["layer"] | {"material": {"model": "elastic", "G": 1.5}}
    data = GEL | {"layer": layer, "adhesion": {"model": "jkr", "work": 0.2}}
    time = np.linspace(0.0, 3.0, 601)
    base = np.interp(time, [0, 1.3, 3], [-0.6, 0.7, -1.0])
    facts: dict[str, Any] = {"prescribed": "base", "stiffness": 20.0}
    seen = np.maximum(base, 0.0)
    force = responses(data, ForceCurve("a", time, base - seen / 20.0, seen, **facts))[0]
    force = force + 0.02 * force.max() * rng.standard_normal(time.size) + 0.2
    base = base + 0.1
    curve = ForceCurve("gel", time, base - force / 20.0, force, **facts)
    start = GEL | {"layer": layer | {"material": {"model": "elastic", "G": 4.0}}}
    free = ["layer.material.G", "layer.thickness", "contact_point", "force_offset"]
    fit = fit_indentation(curve, start, free, contact="detect", adhesion="choose")
    print("\n".join(summary(fit)))
    return fit


def nanoindenter(rng: np.random.Generator) -> None:
    """Draw a creep curve, its fit, and the parameters of a fit as if the depth were prescribed."""
    from gfmdlayer.figures.plot_style import colours, new_figure, styled

    free = [*ZENER, "layer.thickness"]
    plan = {"time": [0, 0.5, 10], "force": [0, 5.0, 5.0], "depth_noise": 0.003}
    (planned,) = design_indentation(plan, GEL, free).curves
    depth = planned.curve.depth + 0.003 * rng.standard_normal(planned.curve.time.size)
    curve = ForceCurve("creep", planned.curve.time, depth, planned.curve.force, prescribed="force")
    start = begun(GEL, 1.0, 3.0, 1.0, thickness=3.0)
    fits = {
        "force prescribed": fit_indentation(curve, start, free),
        "depth prescribed (wrong)": fit_indentation(replace(curve, prescribed="depth"), start, free),
    }
    for name, fit in fits.items():
        print(name, *summary(fit), sep="\n")
    truth = (1.5, 6.0, 0.8, 2.0)
    good = fits["force prescribed"].curves[0]
    with styled():
        picture = new_figure(2, 75.0)
        left, right = picture.subplots(1, 2)
        shades = colours(3)
        left.plot(curve.time, curve.depth, ".", color="0.6", ms=2.2, mew=0, label="measured")
        left.plot(curve.time, good.depth, color=shades[0], linewidth=1.0, label="fitted")
        left.set(xlabel="time (s)", ylabel="depth (µm)")
        left.legend()
        for row, (name, fit) in enumerate(fits.items()):
            for place, (key, true) in enumerate(zip(free, truth, strict=True)):
                low, high = np.array(fit[key].interval) / true
                at = place + 0.2 * row - 0.1
                line = {"color": shades[row], "label": name if not place else None}
                right.plot([at, at], [low, min(high, 100.0)], linewidth=3, **line)
        right.axhline(1, color="black", linewidth=0.5)
        right.set(yscale="log", ylim=(0.3, 30.0), ylabel="95 % interval / truth", xticks=range(4))
        right.set_xticklabels(["$G_0$", r"$G_\infty$", "τ", "thickness"])
        right.tick_params(axis="x", which="minor", bottom=False, top=False)
        right.legend()
        for axes, letter in ((left, "a"), (right, "b")):
            axes.set_title(f"({letter})", loc="left")
    save(picture, GUIDES / "nanoindenter.png")


def flat_punch(rng: np.random.Generator) -> Any:
    """Fit the relaxation of rubber under a flat punch whose depth takes two steps."""
    data = GEL | {
        "units": {"length": "mm", "stress": "MPa", "time": "s"},
        "layer": {
            "thickness": 2.0,
            "poisson": 0.5,
            "material": {"model": "zener", "G0": 0.4, "Ginf": 1.6, "tau": 5.0},
        },
        "punch": {"shape": "flat_punch", "radius": 1.5},
    }
    data = begun(data, 0.4, 1.6, 5.0)
    plan = {"time": [0, 1, 30, 31, 60], "depth": [0, 0.05, 0.05, 0.1, 0.1], "noise": 0.01}
    (planned,) = design_indentation(plan, data, list(ZENER)).curves
    force = planned.curve.force + 0.01 * planned.curve.force.max() * rng.standard_normal(
        planned.curve.time.size
    )
    curve = ForceCurve("rubber", planned.curve.time, planned.curve.depth, force, prescribed="depth")
    fit = fit_indentation(curve, begun(data, 1.0, 2.0, 1.0), list(ZENER))
    print("\n".join(summary(fit)))
    return fit


if __name__ == "__main__":
    command = {
        each.__name__: each
        for each in (coverage, instruments, peers, thickness, histories, pages, figure, loops)
    }
    if len(sys.argv) < 2 or sys.argv[1] not in command:
        sys.exit(__doc__)
    command[sys.argv[1]](*sys.argv[2:])
