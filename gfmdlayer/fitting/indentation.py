"""Fit of a body under an indenter to measured force curves.

The free parameters minimise the sum of squares of predicted minus measured force over the noise
(`problem.LeastSquares`, the trust-region reflective method of scipy). The fit starts with all free moduli
multiplied by the factor that fits the forces best, and with the best of several relaxation times.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import ConfigError
from gfmdlayer.files.tables import Answers
from gfmdlayer.fitting.curve_files import is_map, sources, units_of
from gfmdlayer.fitting.design import second_curve
from gfmdlayer.fitting.elastic import CHOOSE, KINDS, NO_ADHESION
from gfmdlayer.fitting.estimates import best_of, conclude, minimised, prepared
from gfmdlayer.fitting.force_curve import COLUMNS, CurveError, ForceCurve
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.problem import (
    STICKING,
    Free,
    IndentationModel,
    LeastSquares,
    depths,
    refuse_adhesion,
    refuse_impossible,
    refuse_mixed_units,
    warnings_before,
)
from gfmdlayer.fitting.result import FitOptions, IndentationFit
from gfmdlayer.fitting.starts import (
    curve_parameters,
    first_guess,
    make_problem,
    read_model,
    with_adhesion,
)
from gfmdlayer.indentation.model import IsolatedContact
from gfmdlayer.validation.entry import entry

Given = ForceCurve | str | Path | Mapping[str, Any]
ROUGH, FINE = 1e-2, 1e-5  # precision of the first fit, and of the fits after the times are chosen again
ROUNDS, ROUNDS_OF_NOISE = 4, 10
SAME_NOISE = 0.05  # change of the logarithm of the noise
WORSE, FAINT = 10.0, 0.01  # growth of BIC by adhesion that asks for another start, with so much of it
ASTRAY, WORKS = 5.0, 25  # errors of the place of a jump that ask for other works, and their number
STAYS = 0.2  # change of a logarithm below which the times of the solution stay


@entry()
def fit_indentation(
    curves: Given | Iterable[Given],
    model: Mapping[str, Any] | str | Path,
    free: Free | None = None,
    *,
    units: Sequence[str] | Mapping[str, str] | None = None,
    decimal: str | None = None,
    columns: str | Sequence[str] = (),
    loss: str = "linear",
    profile: bool = False,
    contact: str = "given",
    segments: str | Sequence[str] = (),
    prescribed: str | None = None,
    stiffness: float | None = None,
    stiffness_error: float | None = None,
    adhesion: str | None = None,
    sensitivity: float | None = None,
    sampling: float | None = None,
    baseline: str = "none",
    weight: float | None = None,
    range: tuple[float, float] | None = None,  # noqa: A002
    joint: bool = False,
) -> IndentationFit:
    """Fit moduli, times, thicknesses and more to measured force curves.

    Parameters
    ----------
    curves : ForceCurve, path, mapping or Dataset, or an iterable of these
        Measured curves: files or folders (see `curve_files`), mappings, frames or datasets with columns of
        time, depth (or base) and force by their headings, or curves of afmformats and nanite. An elastic
        model needs no time. All curves share the parameters of the model; each has its own contact point,
        drift, stiffness and baseline of the force. Of several curves, those that cannot be used, such as
        one without contact, are left out, with a warning.
    model : mapping, str or Path
        Body and punch, with the keys of a configuration (body, or layer or layers, halfspace; punch) and
        their values as keys or objects, such as `Sphere`; or a YAML file with them. The fit starts from
        these values. A key `free` names the free parameters.
    free : str, sequence of str, or mapping
        Dotted keys of the model, and contact_point, drift, force_offset, force_drift, tilt, stiffness; a
        mapping gives bounds as [low, high], or None.
        A layer lies on a rigid base where the model has no halfspace; warnings name all that is assumed.
    units : sequence of str, or mapping, optional
        Units of columns without units: of time, depth and force, such as ("s", "nm", "nN"), or by name. A
        column that has another unit is refused; the numbers are converted to those of the model.
    decimal : str, optional
        Decimal mark of text files, "." or ",", where they leave it open.
    columns : sequence of str, optional
        Names of the columns of text files in place of their headings; "-" is not read.
    loss : str
        linear (default); or soft_l1, huber, cauchy, which give outliers less weight.
    profile : bool
        Whether profile intervals are found too; three to eleven times the time; off by default.
    contact : str
        given (default): depths count from the surface. detect: each curve has a free contact point and a free
        offset of the force, which start where the force begins to rise. Other words name estimators of the
        contact point: depths count from it, unless contact_point is free; then the fit starts there.
    segments : str or sequence of str
        Names of the segments whose rows count, such as ("approach", "hold"); all by default.
    prescribed : str, optional
        What the instrument prescribes: depth, force or base; by default as the curves say, or guessed.
    stiffness, stiffness_error : float, optional
        Of curves without it: stiffness of the cantilever, force over length in the units of the model, and
        its relative standard error. With an error it is fitted too.
    adhesion : str, optional
        none, jkr or dmt, whose work or force is then free; or choose, the best by BIC. By default the
        model's.
    sensitivity, sampling : float, optional
        Of files without them: the deflection of the cantilever per volt, length/volt, and the rows in a unit
        of time.
    baseline : str
        Subtracted before the fit: none (default); offset, the mean force of the rows before contact; or tilt,
        their straight line over the position.
    weight : float, optional
        Residuals count by the distance from the contact point over this length, up to 1; by default all
        alike.
    range : tuple of float, optional
        Lowest and highest depth of the rows that count, length, relative to the contact point; by default
        all.
    joint : bool
        Whether one model is fitted to all curves of a map; `fit_map` fits each by itself.

    Returns
    -------
    IndentationFit
        Parameters with their intervals, curves and warnings; printed, it is a table.

    Raises
    ------
    ConfigError
        The model or a key is not possible.
    CurveError
        A curve cannot be used.
    FitError
        The fit is not possible.

    Examples
    --------
    Hertz's force on a halfspace of G = 7, nu = 1/2 under a paraboloid of radius 5:

    >>> import numpy as np
    >>> from gfmdlayer import ForceCurve, fit_indentation
    >>> depth = np.linspace(0.0, 0.1, 50)
    >>> force = 8 / 3 * 7.0 * 5.0**0.5 * depth**1.5 / (1 - 0.5)
    >>> material = {"model": "zener", "G0": 1.0, "Ginf": 1.0}
    >>> model = {
    ...     "layer": {"thickness": float("inf"), "material": material},
    ...     "punch": {"shape": "parabola", "radius": 5.0},
    ... }
    >>> fit = fit_indentation(ForceCurve("ramp", depth, depth, force), model, ["layer.material.G0"])
    >>> print(f"{fit['G0'].value:.2f}")
    7.00
    """
    options = FitOptions(
        loss, profile, contact, segments, prescribed, stiffness, stiffness_error, adhesion, sensitivity,
        sampling, baseline, weight, range,
    )  # fmt: skip
    data, keys = read_model(model, free)
    made, every = IndentationModel(data), list(sources(curves))
    if not joint and is_map(every):
        raise FitError(
            f"{len(every)} curves at different places: fit_map fits each by itself; joint=True fits one "
            "model to all"
        )
    into, timeless = units_of(made.config.units), made.is_timeless(keys)
    answers = answers_of(units, decimal, columns)
    measured, lost = usable(partial(each.curve, answers, into, options, timeless=timeless) for each in every)
    if not measured:
        raise FitError("got no curve; give at least one")
    return fit_curves(measured, made, keys, options, notes=lost)


def answers_of(
    units: Sequence[str] | Mapping[str, str] | None, decimal: str | None, columns: str | Sequence[str]
) -> Answers:
    """Return what is said about tables in the words of `fit_indentation`."""
    if isinstance(units, str):
        allowed = "must be those of time, depth and force, such as ('s', 'nm', 'nN'), or a mapping"
        raise ConfigError([f"units: got {units!r}; {allowed}"])
    pairs = units if isinstance(units, Mapping) else dict(zip(COLUMNS, units or (), strict=False))
    return Answers(decimal, tuple(pairs.items()), (columns,) if isinstance(columns, str) else tuple(columns))


def usable(made: Iterable[Callable[[], ForceCurve]]) -> tuple[list[ForceCurve], list[str]]:
    """Return the curves that can be used, and a sentence for each other one; CurveError if all are such."""
    found: list[ForceCurve] = []
    errors: list[CurveError] = []
    for each in made:
        try:
            found.append(each())
        except CurveError as error:
            errors.append(error)
    if errors and not found:
        raise errors[0]
    return found, [f"left out: {'; '.join(str(error).splitlines())}" for error in errors]


def fit_curves(
    curves: Sequence[ForceCurve],
    model: IndentationModel,
    free: Free,
    options: FitOptions,
    advise: bool = True,
    begin: Mapping[str, float] | None = None,
    notes: Sequence[str] = (),
) -> IndentationFit:
    """Fit a checked model to curves, see `fit_indentation`; `advise` adds a proposal for a second curve.

    The search starts at the parameters `begin` by name, or at the first guess. `notes` become warnings.
    """
    curves, lost = usable(partial(_prepared, each, model, free, options) for each in curves)
    notes = [*notes, *lost]
    if options.adhesion == CHOOSE:
        return _best_adhesion(curves, model, free, options, advise, notes)
    if options.adhesion is not None:
        model, free = with_adhesion(model, free, options.adhesion, curves)
    names = [curve.name for curve in curves]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise FitError(f"curve {', '.join(twice)}: this name is given twice; give each curve its own name")
    parameters = curve_parameters(curves, model, free, options)
    reached = depths(curves, parameters)
    refuse_impossible(reached, model)
    problem = make_problem(curves, model, parameters, options)
    if problem.rows < 2 * len(parameters):
        raise FitError(
            f"{problem.rows} rows are too few for {len(parameters)} free parameters; the fit needs at least "
            f"{2 * len(parameters)}"
        )
    refuse_adhesion(problem)
    u, scale = first_guess(problem)
    refuse_mixed_units(model, scale)
    notes = [*notes, *warnings_before(curves, reached, model, scale, free)]
    if begin is not None:
        u = np.clip(problem.coordinates({**problem.values(u), **begin}), *problem.bounds)
    start = problem.values(u)
    u, stopped = _solve(problem, u, options.loss)
    notes += stopped
    fit = conclude(problem, u, options, notes, start)
    if not advise or model.adhesion is not None:
        return fit
    return replace(fit, warnings=(*fit.warnings, *second_curve(problem, u, fit, free)))


def _prepared(curve: ForceCurve, model: IndentationModel, free: Free, options: FitOptions) -> ForceCurve:
    """Return a curve with what the options ask for; CurveError where its contact point is not found."""
    made = curve
    if "prepared" not in curve.origin:  # else one of the fits that adhesion compares
        made = prepared(curve, options, settled="contact_point" not in free)
    asked = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    # The kind of adhesion is not settled yet.
    if own := {key: bounds for key, bounds in asked.items() if not str(key).startswith(STICKING)}:
        curve_parameters([made], model, own, options)
    return made


def _best_adhesion(
    curves: Sequence[ForceCurve],
    model: IndentationModel,
    free: Free,
    options: FitOptions,
    advise: bool,
    notes: Sequence[str],
) -> IndentationFit:
    """Fit without adhesion, with JKR and with DMT, and return the fit of the least BIC."""
    asked = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    names = {kind: f"{STICKING}{name}" for kind, name in KINDS.items()}

    def fitted(kind: str, begin: Mapping[str, float] | None = None) -> IndentationFit:
        foreign = {name for other, name in names.items() if other != kind}
        own = {key: bounds for key, bounds in asked.items() if key not in foreign}
        return fit_curves(curves, model, own, replace(options, adhesion=kind), advise, begin, notes)

    if IsolatedContact(model.config).body.spectrum(np.array([1.0])).weights.size:
        del names["dmt"]  # of elastic bodies
    fits = {kind: fitted(kind) for kind in (*names, NO_ADHESION)}  # adhesion is refused before any fit
    bare = fits[NO_ADHESION]
    for kind, name in names.items():
        if fits[kind].bic > bare.bic + WORSE:  # without adhesion is a limit of it: the search went astray
            begin = {parameter.name: parameter.value for parameter in bare.parameters}
            begin[name] = FAINT * fits[kind][name].value
            fits[kind] = min(fits[kind], fitted(kind, begin), key=lambda fit: fit.bic)
    best, criteria = best_of(fits)
    return replace(fits[best], alternatives=criteria)


def _solve(problem: LeastSquares, u: FloatArray, loss: str) -> tuple[FloatArray, list[str]]:
    """Fit; then choose the times of the solutions and the noise again and refit, until u stays.

    Return u, and a warning where the search had to stop before.
    """
    minimise = partial(minimised, problem.residuals, problem.jacobian, bounds=problem.bounds)
    notes: list[str] = []
    problem.adapt(u)
    for prediction in problem.predictions:  # a wrong place of a jump would draw the search
        prediction.touch.jumps.clear()
    known, u = u, minimise(start=u, precision=ROUGH)
    for number in range(ROUNDS):
        before = u
        try:
            problem.adapt(u)
        except FitError as error:
            if problem.model.adhesion is None:
                raise
            notes, u = [f"the search stopped early; the parameters are rough: {error}"], known
            problem.adapt(u)
        if not problem.is_elastic and (number == 0 or np.abs(problem.jumps(u)).max(initial=0.0) > ASTRAY):
            u = _with_losses(problem, u)
        known = u
        _estimate_noise(problem, u, loss)
        problem.weigh(u)
        _estimate_noise(problem, u, loss)
        if notes:
            break
        u = minimise(start=u, loss=loss, precision=FINE)
        stays = np.abs(u - before).max() < STAYS
        if stays and (problem.is_homogeneous or _noise_stays(problem, u, loss)) and problem.contact_stays(u):
            break
    return u, notes


def _with_losses(problem: LeastSquares, u: FloatArray) -> FloatArray:
    """Return u with the work that follows the rows best if the model has its own losses of contact.

    Rows in contact by the data hardly depend on a work that is far too large or small.
    """
    sticky = [i for i, each in enumerate(problem.parameters) if each.key.startswith(STICKING)]
    if not sticky:
        return u
    low, high = problem.bounds
    trials = np.repeat(u[np.newaxis], WORKS + 1, axis=0)
    trials[1:, sticky] = np.linspace(low[sticky], high[sticky], WORKS)
    for each in problem.predictions:
        each.forget()
    squares = [float(np.sum(problem.residuals(each) ** 2)) for each in trials]
    best: FloatArray = trials[int(np.argmin(squares))]
    problem.adapt(best)
    return best


def _noise_stays(problem: LeastSquares, u: FloatArray, loss: str) -> bool:
    """Whether the noise at u is that by which the residuals were divided."""
    before = problem.noise.copy()
    _estimate_noise(problem, u, loss)
    return bool(np.abs(np.log(problem.noise / before)).max() < SAME_NOISE)


def _estimate_noise(problem: LeastSquares, u: FloatArray, loss: str) -> None:
    """Set the noise of forces and depths from the residuals at u, where it is not given.

    Only uncorrelated residuals have the noise; the noise of the prescribed quantity correlates them.
    """
    for _ in range(ROUNDS_OF_NOISE):
        before = problem.noise.copy()
        for i, (residuals, prediction) in enumerate(
            zip(problem.rows_over_noise(u), problem.predictions, strict=True)
        ):
            for k in np.flatnonzero(~problem.noise_is_given(i)):
                rows = prediction.used & ~prediction.touch.uncertain & (prediction.curve.by_force == bool(k))
                found = problem.noise[i, k] * _spread(residuals[rows], loss)
                problem.noise[i, k] = max(found, problem.least_noise[i, k], 1e-300)
        problem.decorrelate()
        if np.allclose(problem.noise, before, rtol=SAME_NOISE, atol=0.0):
            break


def _spread(residual: FloatArray, loss: str) -> float:
    """Return the standard deviation of a residual, without outliers if the loss is not linear."""
    if loss == "linear":
        spread = float(np.sqrt(np.mean(residual**2)))
    else:
        spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    return max(spread, 1e-12 * float(np.abs(residual).max()), 1e-300)
