"""Moduli of force curves of other packages, beside those of nanite, for `files_of_others.py --moduli`.

All curves are fitted with Hertz on a halfspace: a paraboloid of 5 um, nu 1/2, their approach. From nanite to
this package there are four steps, and each is taken by itself, so that a difference has a reason:

    nanite   its contact point and baseline by estimators, then E and contact point free
    search   the same problem, the least sum of squares from several starts (plain least squares)
    offset   the offset of the force is free too (plain least squares)
    fit      the same by `fit_indentation`, depth prescribed
    base     `fit_indentation`, base prescribed: what an instrument does

The plain fit with the base prescribed (`plain`) shows that the last step belongs to the problem, not to the
program. With the base prescribed, a force that the model does not make bends the cantilever: rows where the
contact is stiffer than the cantilever count less, by 1 + (dF/d delta)/k.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

import gfmdlayer
from gfmdlayer.arrays import FloatArray
from gfmdlayer.files.tables import TableError
from gfmdlayer.fitting.measurement import FitError

RADIUS, POISSON = 5e-6, 0.5
CURVES = 4  # of a file
NEWTON = 60  # steps
CALIBRATION = {"stiffness": 0.1, "sensitivity": 5e-8}  # of files that lack it
LARGE = 0.03  # a difference that needs a reason
FOLLOWS = 0.25  # part of the variance below which a curve has no contact that counts
STIFF = 10.0  # times as stiff with the base prescribed
STEPS = {
    "search": "nanite's search ends above the least squares",
    "offset": "the offset of the force is free",
    "fit": "the noise of the depth is smoothed; nanite takes each row as exact",
    "base": "the base is prescribed",
}


class Rows(NamedTuple):
    """The approach of a curve."""

    depth: FloatArray
    force: FloatArray
    stiffness: float


def hertz(modulus: float, depth: FloatArray) -> FloatArray:
    """Force on a halfspace under a paraboloid."""
    return 4 / 3 * modulus / (1 - POISSON**2) * RADIUS**0.5 * np.maximum(depth, 0.0) ** 1.5


def bent(modulus: float, base: FloatArray, stiffness: float) -> FloatArray:
    """Force at a base: depth + force(depth)/stiffness = base, by Newton's method for a convex function."""
    depth = np.maximum(base, 0.0)
    for _ in range(NEWTON):
        slope = 1 + 1.5 * hertz(modulus, depth) / np.maximum(depth, 1e-30) / stiffness
        step = (depth + hertz(modulus, depth) / stiffness - np.maximum(base, 0.0)) / slope
        depth = np.maximum(depth - step, 0.0)
        if np.abs(step).max() < 1e-9 * np.abs(depth).max():
            break
    return hertz(modulus, depth)


def plain(rows: Rows, start: tuple[float, float], *, offset: bool, base: bool) -> tuple[float, float]:
    """Return E of least squares over E, contact point and, if asked, offset, and its part of the variance.

    The best of several starts.
    """
    size, force = float(np.ptp(rows.depth)), float(np.ptp(rows.force))
    position = rows.depth + rows.force / rows.stiffness if base else rows.depth

    def residuals(p: FloatArray) -> FloatArray:
        modulus, below = float(np.exp(p[0])), position - p[1] * size - base * p[2] * force / rows.stiffness
        made = bent(modulus, below, rows.stiffness) if base else hertz(modulus, below)
        return np.asarray((made + p[2] * force * offset - rows.force)[:: max(below.size // 4000, 1)] / force)

    found = []
    for shift in (-0.1, -0.02, 0.0, 0.02, 0.1):
        begin = np.array([np.log(start[0]), start[1] / size + shift, 0.0])
        found.append(least_squares(residuals, begin, x_scale=(0.1, 0.01, 0.01)))
    best = min(found, key=lambda each: each.cost)
    part = 1 - 2 * best.cost / best.fun.size / float(np.var(rows.force / force))
    return float(np.exp(best.x[0])), part


def nanites(curve: Any) -> tuple[float, float]:
    """Return modulus and contact point (a depth) of nanite, without weights near the contact."""
    curve.apply_preprocessing(["compute_tip_position", "correct_force_offset", "correct_tip_offset"])
    start = curve.get_initial_fit_parameters(model_key="hertz_para")
    start["R"].value, start["nu"].value = RADIUS, POISSON
    curve.fit_model(
        model_key="hertz_para",
        params_initial=start,
        segment="approach",
        range_type="absolute",
        x_axis="tip position",
        weight_cp=0,
    )
    if not curve.fit_properties["success"]:
        raise FitError("its fit does not converge")
    fitted = curve.fit_properties["params_fitted"]
    return float(fitted["E"].value), -float(fitted["contact_point"].value)


def own(curve: Any, near: float, prescribed: str, **facts: float) -> float:
    """Return Young's modulus of `fit_indentation`."""
    material = {"model": "elastic", "G": near / 2 / (1 + POISSON)}
    model = {
        "units": {"length": "m", "stress": "Pa", "time": "s"},
        "layer": {"thickness": float("inf"), "poisson": POISSON, "material": material},
        "punch": {"shape": "parabola", "radius": RADIUS},
    }
    fit = gfmdlayer.fit_indentation(
        curve,
        model,
        ["layer.material.G"],
        contact="detect",
        segments=("approach",),
        prescribed=prescribed,
        **facts,  # type: ignore[arg-type]
    )
    return 2 * (1 + POISSON) * fit["G"].value


@contextmanager
def _named(whose: str) -> Iterator[None]:
    """Turn what another package raises, and what this one refuses, into a reason."""
    try:
        yield
    except BaseException as error:  # nanite and afmformats raise classes that are no Exception
        if isinstance(error, (KeyboardInterrupt, SystemExit)):
            raise
        refused = isinstance(error, (FitError, TableError))
        words = str(error).partition("\n")[0] or "no reason given"
        raise FitError(f"{whose}: {words if refused else f'{type(error).__name__}, {words}'}") from error


def _group(path: Path) -> Sequence[Any]:
    import afmformats.errors
    import nanite

    try:
        return nanite.IndentationGroup(path)
    except afmformats.errors.MissingMetaDataError:
        override = {"sensitivity": CALIBRATION["sensitivity"], "spring constant": CALIBRATION["stiffness"]}
        return nanite.IndentationGroup(path, meta_override=override)


def _approach(curve: Any) -> Rows:
    rows = np.asarray(curve["segment"]).astype(int) == 0
    depth, force = -np.asarray(curve["tip position"])[rows], np.asarray(curve["force"])[rows]
    return Rows(depth, force, float(curve.metadata["spring constant"]))


def compared(curve: Any) -> tuple[dict[str, float], float]:
    """Return the moduli of a curve by the names of the steps, and the CPU time of the fit with the base."""
    with _named("nanite"):
        modulus, point = nanites(curve)
    if not modulus > 0:
        raise FitError(f"nanite: E = {modulus:.3g}")
    rows = _approach(curve)
    found = {"nanite": modulus}
    found["search"], _ = plain(rows, (modulus, point), offset=False, base=False)
    found["offset"], found["part"] = plain(rows, (modulus, point), offset=True, base=False)
    found["plain"], _ = plain(rows, (modulus, point), offset=True, base=True)
    with _named("gfmdlayer"):
        found["fit"] = own(curve, modulus, "depth")
        begun = time.process_time()
        found["base"] = own(curve, modulus, "base")
    return found, time.process_time() - begun


def reason(found: dict[str, float]) -> str:
    """Name the steps that make the difference, the largest first, where one is large."""
    if found["part"] < FOLLOWS:
        return f"no contact: Hertz's force is {100 * found['part']:.0f} % of the variance of the force"
    if found["base"] > STIFF * found["fit"] and found["plain"] > STIFF * found["fit"]:
        return "the base determines no upper limit: the contact is stiffer than the cantilever"
    names = ["nanite", *STEPS]
    if max(abs(found[each] / found["nanite"] - 1) for each in ("fit", "base")) <= LARGE:
        return ""
    steps = {name: found[name] / found[before] - 1 for before, name in pairwise(names)}
    large = sorted((name for name in steps if abs(steps[name]) > LARGE), key=lambda name: -abs(steps[name]))
    return "; ".join(f"{STEPS[name]} ({100 * steps[name]:+.0f} %)" for name in large) or "several small steps"


def moduli(files: Sequence[Path]) -> Iterator[str]:
    """Yield the lines of a table."""
    logging.disable(logging.CRITICAL)
    yield "| curve | nanite, Pa | search | offset | depth | base | base, plain | s | reason |"
    yield "|-|-|-|-|-|-|-|-|-|"
    for path in files:
        try:
            with _named("nanite"):
                curves = list(_group(path))
        except FitError as error:
            yield _line(path.name, f"{error}{_alone(path)}")
            continue
        for curve in curves[:CURVES]:
            name = path.name if len(curves) == 1 else f"{path.name}, {curve.enum}"
            try:
                found, seconds = compared(curve)
            except FitError as error:
                yield _line(name, str(error) + (_alone(path) if len(curves) == 1 else ""))
                continue
            cells = [_percent(found[each] / found["nanite"] - 1) for each in (*STEPS, "plain")]
            own_words = f"{found['nanite']:.4g} | {' | '.join(cells)} | {seconds:.1f} | {reason(found)}"
            yield f"| `{name}` | {own_words} |"


def _percent(part: float) -> str:
    return f"{100 * part:+.1f}" if part < STIFF else "open"


def _alone(path: Path) -> str:
    """Say what this package makes of a file that nanite does not fit."""
    try:
        with _named("gfmdlayer"):
            try:
                found = [own(path, 1e4, prescribed) for prescribed in ("depth", "base")]
            except (FitError, TableError) as error:
                if "give" not in str(error):
                    raise
                found = [own(path, 1e4, prescribed, **CALIBRATION) for prescribed in ("depth", "base")]
    except FitError as error:
        return f"; {error}".replace(f"{path}: ", "")
    return f"; gfmdlayer: {found[0]:.4g} Pa with the depth, {found[1]:.4g} Pa with the base"


def _line(name: str, words: str) -> str:
    shown = " ".join(words.split()).replace("|", "\\|")
    return f"| `{name}` | | | | | | | | {shown[:300]} |"
