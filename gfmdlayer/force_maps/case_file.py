"""One fit of a force map: a curve as a case, its fit, and the file cases/NNNN.h5 of its estimates.

estimate, error, low, high (parameter)    value, standard error and 95 % interval
correlation (parameter, parameter)        of the estimates
noise, aic, bic                           of the fit
"""

from __future__ import annotations

import hashlib
import json
import time
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.execution.case_run import record_failure
from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import Stopped
from gfmdlayer.execution.schedule import Outcome
from gfmdlayer.execution.status import StatusFile
from gfmdlayer.files.seals import is_intact
from gfmdlayer.fitting.indentation.curve_files import Entry, Units, read_curve
from gfmdlayer.fitting.indentation.estimates import FitOptions, IndentationFit
from gfmdlayer.fitting.indentation.fit import fit_curves
from gfmdlayer.fitting.indentation.parameters import Free, Model
from gfmdlayer.fitting.indentation.units import in_si
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.results.netcdf import add_variable, new_file, set_attributes
from gfmdlayer.results.provenance import provenance

COLUMNS = ("estimate", "error", "low", "high")
SCALARS = ("noise", "aic", "bic")


@dataclass(frozen=True)
class MapCase:
    """A curve of a map.

    Attributes
    ----------
    index : int
        Its number, that of its file.
    entry : Entry
        The curve in its file.
    contents : str
        Hash of this file.
    """

    index: int
    entry: Entry
    contents: str

    @property
    def values(self) -> dict[str, object]:
        """The curve's name, for messages."""
        return {"curve": self.entry.name}


@dataclass(frozen=True)
class FitTask:
    """Fit of one curve of a map.

    Attributes
    ----------
    folder : Folder
        A claimed results folder.
    model : mapping
        Body and indenter.
    free : sequence or mapping
        Free parameters.
    options : FitOptions
        How curves are fitted.
    units : sequence of str, optional
        Of columns without their own.
    """

    folder: Folder
    model: dict[str, Any]
    free: Free
    options: FitOptions
    units: Units | None = None

    def digest(self, case: MapCase) -> str:
        """Return a hash of everything that determines the estimates of a case."""
        asked = self.free if isinstance(self.free, dict) else list(self.free)
        units = None if self.units is None else list(self.units)
        determined = [
            self.model, asked, vars(self.options), units, case.contents, case.entry.key,
        ]  # fmt: skip
        return hashlib.sha256(json.dumps(determined, default=str).encode()).hexdigest()

    def __call__(self, case: MapCase) -> Outcome:
        """Fit a curve into its file; an error becomes the outcome, which names the curve."""
        begun = time.monotonic()
        try:
            with StatusFile(self.folder, case.index, 1.0, case.entry.name):
                self.folder.case(case.index, "failed").unlink(missing_ok=True)
                fit = self._fit(case)
                write_estimates(self.folder.case(case.index), fit, case.entry.name, self.digest(case))
        except Stopped:
            return Outcome(case.index, "stopped")
        except Exception as error:
            reason = f"curve {case.entry.name}: {type(error).__name__}: {error}".replace("\n", "; ")
            record_failure(self.folder, case, reason, traceback.format_exc())
            return Outcome(case.index, "failed", reason, time.monotonic() - begun)
        return Outcome(case.index, "complete", seconds=time.monotonic() - begun)

    def _fit(self, case: MapCase) -> IndentationFit:
        model = Model(self.model)
        curve = read_curve(case.entry, self.units, in_si(model.config.units))
        fit = fit_curves([curve], model, self.free, self.options)
        if not all(np.isfinite(each.value) for each in fit.parameters):
            raise FitError("an estimate is not a finite number")
        return fit


class Estimates(NamedTuple):
    """The contents of the file of a case.

    Attributes
    ----------
    keys : list of str
        Free parameters.
    columns : ndarray, shape (4, parameters)
        `COLUMNS`.
    scalars : ndarray, shape (3,)
        `SCALARS`.
    warnings : str
        One line each.
    """

    keys: list[str]
    columns: FloatArray
    scalars: FloatArray
    warnings: str


def write_estimates(path: Path, fit: IndentationFit, name: str, digest: str) -> None:
    """Write the file of a case, whole."""
    keys = [each.key for each in fit.parameters]
    rows = np.array([[each.value, each.standard_error, *each.interval] for each in fit.parameters]).T
    with new_file(path) as file:
        h5 = file.begin()
        text = h5py.string_dtype()
        add_variable(h5, "parameter", ("parameter",), {}, data=np.array(keys, dtype=object), dtype=text)
        for column, values in zip(COLUMNS, rows, strict=True):
            add_variable(h5, column, ("parameter",), {}, data=values)
        h5.create_dataset("correlation", data=fit.correlation)
        for scalar, value in zip(SCALARS, (fit.curves[0].noise, fit.aic, fit.bic), strict=True):
            h5.create_dataset(scalar, data=float(value))
        known = {"curve": name, "digest": digest, "warnings": "\n".join(fit.warnings)}
        set_attributes(h5, {**provenance(), **known, "complete": 1})


def read_estimates(path: Path, digest: str | None = None) -> Estimates | None:
    """Read the file of a case; None where it is missing, damaged, or of another digest."""
    try:
        if is_intact(path) is False:
            return None
        with h5py.File(path, locking=False) as h5:
            if h5.attrs["complete"] != 1 or (digest is not None and h5.attrs["digest"] != digest):
                return None
            keys = [key.decode() for key in h5["parameter"][:]]
            columns = np.stack([h5[column][:] for column in COLUMNS])
            scalars = np.array([h5[scalar][()] for scalar in SCALARS])
            return Estimates(keys, columns, scalars, str(h5.attrs["warnings"]))
    except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
        return None
