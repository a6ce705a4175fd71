"""Predictions of a model for a measured curve, in the columns of the curve.

Values of a curve correct its columns, with the position x of the base, or else of the indenter:
depth = measured depth - contact_point - drift (t - t_first),
force = (measured force - force_offset - force_drift (t - t_first) - tilt (x - x_first)) stiffness/(nominal).

The prescribed quantity is measured too. Straight pieces replace it, and the values at their corners have a
covariance C from least squares. With the derivatives P of the predictions to these values, the residuals
have the covariance noise^2 + P C P^T; they are multiplied by its inverse root (generalised least squares).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import Config
from gfmdlayer.fitting.elastic import Contacts, ElasticContact, Jumping, Touch
from gfmdlayer.fitting.force_curve import (
    DEPTH,
    FORCE,
    SIGMAS,
    Correction,
    CurveError,
    ForceCurve,
    Pieces,
    Setup,
    StraightDrive,
    baseline,
    straight_derivatives,
)
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.stepped import KEPT, SteppedContact
from gfmdlayer.indentation.equilibrium import EdgeAdhesion
from gfmdlayer.indentation.indent import as_revolution
from gfmdlayer.indentation.model import IsolatedContact

SHIFT = 1e-3  # of the range: smallest step of a difference to a corner
CLOSE = 0.2  # of the shortest piece: largest step of a difference to the time of a corner
LEAST_FORCE = 0.01  # of the largest: rows of a prescribed force below it do not count
RETRACTED = 0.05  # of the range: a motion back by more is a retraction
SAME_RATE = 1.5  # ratio of the rates of segments whose noise is one
NOISY = 0.1  # least noise of the prescribed over noise of the measured quantity that counts; both over ranges


class Prediction:
    """Forces and depths under the prescribed quantity of a measured curve."""

    def __init__(
        self,
        curve: ForceCurve,
        segments: Sequence[str] = (),
        offset: float = 0.0,
        adhesive: bool = False,
    ) -> None:
        self.curve = curve
        self.drives: list[StraightDrive] = []
        self._kinds: list[str] = []
        self.used = np.zeros(curve.time.size, dtype=bool)  # rows whose residuals count
        for kind, segments_of_kind in groupby(curve.segments, key=lambda segment: segment.prescribed):
            parts = list(segments_of_kind)
            rows = slice(parts[0].first, parts[-1].end)
            values = {FORCE: curve.force, DEPTH: curve.depth}.get(kind, curve.position_of_drive)
            within = curve.within(rows, kind)
            self.drives.append(StraightDrive.of(curve.time[rows], values[rows], within))
            self._kinds.append(kind)
            for part in parts:
                self.used[part.first : part.end] = not segments or part.name in segments
        if (by_force := curve.by_force).any():
            # Without force the indenter may be anywhere above the surface.
            times = np.concatenate([drive.time for drive in self.drives])
            forces = np.interp(curve.time, times, np.concatenate([drive.value for drive in self.drives]))
            kinds = zip(self.drives, self._kinds, strict=True)
            errors = [drive.error for drive, kind in kinds if kind == FORCE]
            least = max(LEAST_FORCE * float(np.max(curve.force) - offset), SIGMAS * max(errors) / 10**0.5)
            counts = (np.abs(forces - offset) if adhesive else forces - offset) > least
            if adhesive and counts.any():  # from push to pull there is contact
                first, *_, last = np.flatnonzero(counts).tolist() * 2
                counts[first:last] = True
            self.used &= ~by_force | counts
        if curve.weights is not None:
            self.used &= curve.weights > 0
        if not self.used.any():
            known = ", ".join(dict.fromkeys(segment.name for segment in curve.segments))
            raise CurveError(
                f"curve {curve.name}: no row is left in the segments {', '.join(segments) or known}; it has "
                f"{known}"
            )
        self._setups: list[tuple[Config, Setup]] = []  # the last ones
        self._relaxes: bool | None = None
        self._elastic, self._stepped = ElasticContact(curve), SteppedContact(curve)
        self._in_steps = False  # whether an elastic body is solved in steps too
        self.touch = Touch(curve.time.size)
        self._labels = 0

    @property
    def changes(self) -> int:
        """Number of changes of times, nodes and rows in contact, across which responses are not compared."""
        return self._labels + self._elastic.changes + self._stepped.changes

    def corrected(self, at: Correction) -> tuple[FloatArray, FloatArray]:
        """Return the corners of the prescribed quantity without its corrections: times and values."""
        pieces = self._pieces(at)
        return np.append(pieces.begin, pieces.end[-1]), np.append(pieces.first, pieces.last[-1])

    @property
    def kinds(self) -> set[str]:
        """The prescribed quantities."""
        return set(self._kinds)

    def adapt(self, config: Config, at: Correction) -> None:
        """Choose the times by the bends of the response of a model, and the nodes by its lengths."""
        setup, pieces = self.setup(config), self._pieces(at)
        if self.is_elastic(config):
            try:
                self._elastic.adapt(setup, at, pieces)
            except FitError:
                if at.adhesion != EdgeAdhesion():
                    raise
                self._in_steps = True  # a very wide contact
            if not self._in_steps:
                return
        self._stepped.adapt(setup, at, pieces)

    def response(self, config: Config, at: Correction, rough: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return force and depth of the indenter at the rows; `rough` suffices for differences."""
        setup, pieces = self.setup(config), self._pieces(at)
        if self.is_elastic(config) and not self._in_steps:
            return self._elastic.response(setup, at, pieces, self.touch.touching)
        return self._stepped.response(setup, at, pieces, self.touch.touching, rough)

    def _jumping(self, config: Config, at: Correction, rough: bool = False) -> Jumping:
        if self.is_elastic(config):
            return self.contacts(config, at)
        return self._stepped.course(self.setup(config), at, self._pieces(at), rough)

    def contacts(self, config: Config, at: Correction) -> Contacts:
        """Return the stable contacts of the relaxed body, up to the largest prescribed values."""
        return self._elastic.contacts(self.setup(config), at, self._pieces(at))

    def is_elastic(self, config: Config) -> bool:
        """Whether the body of a model does not relax."""
        if self._relaxes is None:
            self._relaxes = bool(self.setup(config).body.spectrum(np.array([1.0])).weights.size)
        return not self._relaxes

    def setup(self, config: Config) -> Setup:
        """Return body and indenter of a model."""
        for known, setup in self._setups:
            if known is config:
                return setup
        setup = Setup(IsolatedContact(config).body, as_revolution(config.punch))
        self._setups = [(config, setup), *self._setups[: KEPT - 1]]
        return setup

    @property
    def blocks(self) -> list[int]:
        """Numbers of successive rows that count, of one sampling rate each."""
        sizes, pace = list[int](), 0.0
        for part in self.curve.segments:
            rows = int(self.used[part.first : part.end].sum())
            spacing = float(np.median(np.diff(self.curve.time[max(part.first - 1, 0) : part.end])))
            if rows and sizes and 1 / SAME_RATE < spacing / pace < SAME_RATE:
                sizes[-1] += rows
            elif rows:
                sizes.append(rows)
            pace = spacing if rows else pace
        return sizes

    @property
    def retracts(self) -> bool:
        """Whether a row of a retraction counts."""
        retracts = False
        for part in self.curve.segments:
            rows = np.flatnonzero(self.used[part.first : part.end]) + part.first
            if rows.size > 1:
                drive = self.curve.force if part.prescribed == FORCE else self.curve.position_of_drive
                top = rows[0] + int(np.argmax(drive[rows[0] : rows[-1] + 1]))
                retracts |= bool(drive[top] - drive[rows[-1]] > RETRACTED * np.ptp(drive))
        return retracts

    def forget(self) -> None:
        """Take rows in contact and jumps from the model."""
        self.touch, self._labels = Touch(self.used.size), self._labels + 1

    def label(self, config: Config, at: Correction) -> None:
        """Take the rows in contact, and the jumps, from the measurement, where there is adhesion."""
        self.forget()
        if at.adhesion == EdgeAdhesion():
            return
        squares = []
        for touching in (True, False):
            self.touch.touching = np.full(self.used.size, touching)
            squares.append((self.measured(config, at) - self.curve.measured) ** 2)
        own = 1.0 if self.curve.stiffness is None else self.curve.stiffness / at.stiffness
        seen = self.curve, self.used, self._jumping(config, at), self._pieces(at), own
        self.touch.find(*seen, squares[0] - squares[1], self._error_of_drive)

    def _error_of_drive(self, row: int) -> float:
        """Return the standard error of the prescribed value before a row."""
        time = float(self.curve.time[row - 1 : row + 1].mean())
        drive = next(drive for drive in self.drives[::-1] if drive.time[0] <= time or drive is self.drives[0])
        if drive.time.size < 2:
            return 0.0
        along = straight_derivatives(np.array([time]), drive.time, drive.value)[0]
        along = along[: drive.covariance.shape[0]]
        return drive.error * math.sqrt(max(float(along @ drive.covariance @ along), 0.0))

    def jumps(self, config: Config, at: Correction, rough: bool = False) -> FloatArray:
        """Return the places of the jumps, predicted less measured, over their errors; shape (jumps,)."""
        if not self.touch.jumps:
            return np.zeros(0)
        return self.touch.places(self.curve, self._jumping(config, at, rough), self._pieces(at))

    def in_columns(
        self, config: Config, at: Correction, rough: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return force and depth in the columns of the curve, with its corrections, at the rows."""
        force, depth = self.response(config, at, rough)
        curve, since = self.curve, self.curve.time - self.curve.time[0]
        ratio = 1.0 if curve.stiffness is None else curve.stiffness / at.stiffness
        own = ratio * force + baseline(curve, at)
        depth = depth + at.contact_point + at.drift * since
        if curve.stiffness and curve.by_base:  # the column is the base less the measured deflection
            base = np.where(curve.by_force, depth + force / at.stiffness, curve.position_of_drive)
            return own, base - own / curve.stiffness
        return own, np.where(curve.by_force, depth, curve.depth)

    def measured(self, config: Config, at: Correction, rough: bool = False) -> FloatArray:
        """Return the predicted values of the measured quantity, at the rows."""
        force, depth = self.in_columns(config, at, rough)
        return np.where(self.curve.by_force, depth, force)

    def scatter(self, config: Config, at: Correction, noise: FloatArray) -> tuple[FloatArray, int]:
        """Return the errors of rows and jumps by the noise of the prescribed quantity, and the solutions.

        Shape (rows + jumps, corners), with independent columns; only of the drives that are noisy beside
        `noise`, or beside the spread of the jumps.
        """
        relative = float(np.median(noise)) / max(float(np.ptp(self.curve.measured)), 1e-300)

        def every() -> FloatArray:
            return np.append(self.measured(config, at, rough=True), self.jumps(config, at, rough=True))

        base, columns = every(), list[FloatArray]()
        near = all(self._error_of_drive(jump.row) < NOISY * jump.spread for jump in self.touch.jumps)
        solutions = 1
        for k, drive in enumerate(self.drives):
            span = max(float(np.ptp(drive.value)), 1e-300)
            if (drive.error < NOISY * relative * span and near) or drive.time.size < 2:
                continue
            derivatives = []
            for number, variance in enumerate(np.diag(drive.covariance)):
                shift = np.zeros(drive.covariance.shape[0])
                shift[number] = max(drive.error * variance**0.5, SHIFT * span)
                if number >= drive.time.size:
                    shift[number] = min(
                        drive.error * variance**0.5, CLOSE * float(np.min(np.diff(drive.time)))
                    )
                self.drives[k] = drive.moved(shift)
                derivatives.append((every() - base) / shift[number])
                self.drives[k] = drive
                solutions += 1
            values, vectors = np.linalg.eigh(drive.covariance)
            root = vectors * np.sqrt(np.maximum(values, 0.0))
            columns.append(drive.error * np.stack(derivatives, axis=1) @ root)
        return np.hstack(columns) if columns else np.zeros((base.size, 0)), solutions

    def _pieces(self, at: Correction) -> Pieces:
        curve, parts = self.curve, []
        begin: float | None = None
        for drive, kind in zip(self.drives, self._kinds, strict=True):
            time, value = drive.time, drive.value
            since = time - curve.time[0]
            if kind == FORCE:
                position = np.interp(time, curve.time, curve.position_of_drive) - curve.position_of_drive[0]
                value = value - at.force_offset - at.force_drift * since - at.tilt * position
                value = value if curve.stiffness is None else value * (at.stiffness / curve.stiffness)
            else:
                value = value - at.contact_point - at.drift * since
            if begin is not None:  # from the last row of the drive before to the first of this one
                slope = (value[1] - value[0]) / (time[1] - time[0]) if time.size > 1 else 0.0
                first = value[0] - slope * (time[0] - begin)
                time, value = np.append(begin, time), np.append(first, value)
            parts.append((time[:-1], time[1:], value[:-1], value[1:], np.full(time.size - 1, kind == FORCE)))
            begin = float(time[-1])
        # The first piece of a drive begins at the end of the last one.
        breakpoints, *later = (drive.breakpoints for drive in self.drives)
        breakpoints = np.concatenate(
            [breakpoints, *(times[1:] if times.size > 1 else times for times in later)]
        )
        return Pieces._make([*(np.concatenate(column) for column in zip(*parts, strict=True)), breakpoints])
