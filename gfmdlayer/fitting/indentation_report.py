"""The output of a fit: model in YAML, numbers in JSON, rows in CSV, all in HDF5, a picture, a summary.

JSON and HDF5 have every input of the fit: digests of the files, segments, rows, starts, options, versions.
The rows of a curve in CSV and HDF5 can be read and fitted again.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from gfmdlayer.figures.plot_style import save
from gfmdlayer.files.whole import output_file
from gfmdlayer.fitting.estimates import best_of
from gfmdlayer.fitting.material import YAML, plain_name, with_suffixes, written
from gfmdlayer.fitting.result import CurveFit, Estimate, IndentationFit, fit_figure, summary
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.netcdf import add_variable, new_file, set_attributes
from gfmdlayer.results.provenance import provenance
from gfmdlayer.validation import text

if TYPE_CHECKING:
    pass

# In HDF5: the value, standard error and 95 % interval of each parameter; and facts of the fit.
COLUMNS = ("estimate", "error", "low", "high")
SCALARS = ("noise", "aic", "bic")
MEASURED = ("depth", "force", "fitted_depth", "fitted_force")
SHOWN_CURVES = 6
SECTIONS = ("units", "grid", "layer", "layers", "halfspace", "punch")


def _yaml_file(out: str | Path | None, name: str) -> Path:
    """Return the YAML file of a fit, see `output_file`; a name of another ending gets .yaml behind it."""
    file = output_file(out, Path(f"{name}.yaml"))
    if file.suffix.lower() in YAML:
        return file
    if file.exists():
        raise ResultsError(f"{file}: cannot be written: is another file; must be .yaml, .yml, or a folder")
    return file.with_name(f"{file.name}.yaml")


def targets(out: str | Path | None, force: bool, name: str = "fit") -> list[Path]:
    """Return the names of YAML, JSON, picture, CSV and HDF5; existing files are an error unless `force`.

    `name` is theirs where `out` is a folder, or None.
    """
    return with_suffixes(_yaml_file(out, name), [".json", ".png", ".csv", ".h5"], force)


def write_report(fit: IndentationFit, out: str | Path, force: bool = False) -> list[str]:
    """Write YAML to `out`, the other files beside it, and return the lines of a summary."""
    material, numbers, picture, rows, everything = targets(out, force)
    data = json.dumps(as_data(fit), indent=2, allow_nan=False) + "\n"
    written(material, {material: model_yaml(fit, material.stem), numbers: data, rows: as_table(fit)}, force)
    with new_file(everything) as file:
        add_fit(file.begin(), fit)
    save(fit_figure(fit), picture)
    files = {"model": material, "numbers": numbers, "rows": rows, "all": everything, "figure": picture}
    return [*summary(fit), *(f"{name}: {path}" for name, path in files.items())]


def as_table(fit: IndentationFit) -> str:
    """Return the rows of all curves as text in columns, measured and fitted."""
    units = fit.config.units
    time, length, force = (
        "" if units is None else f" ({units.label(x)})" for x in ("time", "length", "force")
    )
    names = [
        f"time{time}",
        f"depth{length}",
        f"force{force}",
        f"fitted_depth{length}",
        f"fitted_force{force}",
    ]
    lines = [f"# {line}" for line in summary(fit)]
    lines.append(",".join([*names, "used", "segment", "prescribed", "curve"]))
    for fitted in fit.curves:
        columns = _rows(fitted)
        numbers = np.column_stack([columns[key] for key in ("time", *MEASURED)])
        words = zip(columns["used"], columns["segment"], columns["prescribed"], strict=True)
        for row, (used, *named) in zip(numbers.tolist(), words, strict=True):
            lines.append(",".join([*map(repr, row), str(int(used)), *named, _word(fitted.curve.name)]))
    return "\n".join(lines) + "\n"


def accounts(fit: IndentationFit) -> str:
    """Return how the files of a fit were read, a line for each."""
    return "\n".join(filter(None, (str(each.curve.origin.get("account", "")) for each in fit.curves)))


def add_fit(h5: h5py.File, fit: IndentationFit) -> None:
    """Put estimates, input and rows of a fit into a new file, a group for each curve."""
    add_estimates(h5, fit)
    units = fit.config.units
    labels = {"time": "time", "depth": "length", "force": "force"}
    for fitted in fit.curves:
        name = fitted.curve.name.replace("/", "_")
        while name in h5:  # an estimate, or another curve
            name += "_"
        group = h5.create_group(name)
        for key, values in _rows(fitted).items():
            is_text = key in {"segment", "prescribed"}
            data = np.array(values, dtype=object) if is_text else values
            group.create_dataset(key, data=data, dtype=h5py.string_dtype() if is_text else None)
            if units is not None and (words := labels.get(key.removeprefix("fitted_"))):
                group[key].attrs["units"] = units.label(words)
        for key, value in _curve_data(fitted).items():
            if value is not None:
                stored = value if isinstance(value, (str, int, float)) else json.dumps(value)
                group.attrs[key] = stored
    if fit.adhesion is not None:
        h5.attrs["adhesion"] = json.dumps(dict(fit.adhesion))
    if fit.choice:
        h5.attrs["alternatives"], h5.attrs["choice"] = json.dumps(dict(fit.alternatives)), fit.choice
    inputs = {"start": json.dumps(dict(fit.start)), "options": json.dumps(vars(fit.options))}
    model = text.written(fit.config.model_dump(exclude_none=True))
    known = {"model": model, "warnings": "\n".join(fit.warnings), "read": accounts(fit)}
    set_attributes(h5, {**provenance(), **inputs, **known, "complete": 1})


def add_estimates(h5: h5py.File, fit: IndentationFit) -> None:
    """Put the estimates of a fit into a new file, see `force_map`."""
    keys = np.array([estimate.name for estimate in fit.parameters], dtype=object)
    rows = np.array(
        [[estimate.value, estimate.standard_error, *estimate.interval] for estimate in fit.parameters]
    ).T
    add_variable(h5, "parameter", ("parameter",), {}, data=keys, dtype=h5py.string_dtype())
    for column, values in zip(COLUMNS, rows, strict=True):
        add_variable(h5, column, ("parameter",), {}, data=values)
    h5.create_dataset("correlation", data=fit.correlation)
    for scalar, value in zip(SCALARS, (_noise(fit), fit.aic, fit.bic), strict=True):
        h5.create_dataset(scalar, data=float(value))


def _noise(fit: IndentationFit) -> float:
    """Return the root mean square of the curves' noise of force; of depth where no force is measured."""
    every = np.array([(each.noise, each.depth_noise) for each in fit.curves]).T
    known = next(each[np.isfinite(each)] for each in every if np.isfinite(each).any())
    return float(np.sqrt(np.mean(known**2)))


def _rows(fitted: CurveFit) -> dict[str, Any]:
    """Return the columns of a curve, measured and fitted, with the names of its segments."""
    curve = fitted.curve
    words: dict[str, list[str]] = {"segment": [], "prescribed": []}
    for part in curve.segments:
        for key, word in (("segment", part.name), ("prescribed", part.prescribed)):
            words[key] += [_word(word)] * (part.end - part.first)
    numbers = {"time": curve.time, "depth": curve.depth, "force": curve.force}
    return numbers | {"fitted_depth": fitted.depth, "fitted_force": fitted.force, "used": fitted.used} | words


def _word(words: str) -> str:
    """Return words without the characters that separate columns."""
    return re.sub(r"[\s,;#]+", "_", words) or "_"


def model_yaml(fit: IndentationFit, name: str) -> str:
    """Write the fitted model as a small configuration, with the estimates in comments above it."""
    data = fit.config.model_dump(exclude_none=True)
    kept = {"name": plain_name(name, "model")} | {key: data[key] for key in SECTIONS if key in data}
    kept["trajectory"] = {"depth": fit.depth}
    if fit.adhesion is not None:  # a run has no adhesion: the section is for a further fit
        del kept["trajectory"]
        kept["adhesion"] = dict(fit.adhesion)
    return "".join(f"# {line}\n" for line in summary(fit)) + text.written(kept)


def as_data(fit: IndentationFit) -> dict[str, Any]:
    """Return a fit as plain data; null for numbers that the data leave open."""
    return {
        "parameters": [_estimate(each) for each in fit.parameters],
        "correlation": [[_known(value) for value in row] for row in fit.correlation.tolist()],
        "aic": fit.aic,
        "bic": fit.bic,
        "curves": [_curve_data(each) for each in fit.curves],
        "adhesion": fit.adhesion and dict(fit.adhesion),
        "alternatives": dict(fit.alternatives),
        "choice": fit.choice,
        "warnings": list(fit.warnings),
        "start": dict(fit.start),
        "options": vars(fit.options),
        "provenance": provenance(),
    }


def _curve_data(fitted: CurveFit) -> dict[str, Any]:
    return {
        "name": fitted.curve.name,
        "rows": fitted.curve.time.size,
        "fitted_rows": int(fitted.used.sum()),
        "noise": _known(fitted.noise),
        "depth_noise": _known(fitted.depth_noise),
        "segments": [segment._asdict() for segment in fitted.curve.segments],
        "guessed": fitted.curve.guessed,
        "stiffness": fitted.curve.stiffness,
        "stiffness_error": fitted.curve.stiffness_error,
        "punch": None if fitted.curve.punch is None else dict(fitted.curve.punch),
        **fitted.curve.origin,
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _estimate(estimate: Estimate) -> dict[str, Any]:
    ends = estimate.profile and [end if math.isfinite(end) else None for end in estimate.profile]
    return {
        "key": estimate.key,
        "curve": estimate.curve or None,
        "value": estimate.value,
        "standard_error": _known(estimate.standard_error),
        "interval_95": [_known(end) for end in estimate.interval],
        "profile_95": ends,
        "bounds": list(estimate.bounds),
    }


def comparison(fits: dict[str, IndentationFit]) -> list[str]:
    """Return a table of models with their information criteria, the best by BIC first."""
    best_aic, (best, criteria) = min(f.aic for f in fits.values()), best_of(fits)
    width = max(len(name) for name in fits)
    lines = [f"{'model':{width}}  parameters  {'noise':>10}  {'AIC - best':>11}  {'BIC - best':>11}"]
    for name, fit in sorted(fits.items(), key=lambda item: criteria[item[0]]):
        lines.append(
            f"{name:{width}}  {len(fit.parameters):10d}  {_noise(fit):10.4g}  {fit.aic - best_aic:11.2f}  "
            f"{criteria[name] - criteria[best]:11.2f}"
        )
    return lines
