"""Curves at several temperatures on one master curve: the shift factors and the law that they follow.

A curve at the temperature T has the relaxation times of the reference times aT, and its moduli are times bT,
if asked. With the logarithms of aT given, all rows are one curve, whose least error is that of a Prony series
on a dense grid of times: a convex problem, see `laws`. The logarithms, or the constants of WLF or Arrhenius
behind them, minimise this error (variable projection, Golub & Pereyra, SIAM J. Numer. Anal. 10 (1973) 413).
No curve is interpolated, and a branch moves by d ln tau = d ln aT. The search starts where each curve, from
the reference outwards, joins the ones before with the least error over an overlap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.shifts import GAS_CONSTANT, WLF, ZERO_CELSIUS, Arrhenius, Shift
from gfmdlayer.fitting.intervals import mixture
from gfmdlayer.fitting.laws import SeriesProblem
from gfmdlayer.fitting.measurement import CreepCurve, FitError, Measurement

LEVEL = 0.95
OVERLAP = 1 / 3  # of the rows of a curve, that lie among those before it when the search starts
TRIALS, REACH = 0.2, 10.0  # decades: distance of the first trials, and the largest shift between neighbours
LARGEST = 23.0  # logarithm of a constant, 1e10, beyond which the law is another one
STRAIGHT = 20.0  # C2 over the range of temperatures, from which WLF is a straight line
LAWS = ("wlf", "arrhenius", "free")


@dataclass(frozen=True)
class FittedNumber:
    """A fitted number with its 95 % interval; held numbers have none."""

    name: str
    value: float
    interval: tuple[float, float] | None = None
    unit: str = ""

    @property
    def stderr(self) -> float | None:
        """Half of the interval over 1.96."""
        if self.interval is None:
            return None
        return (self.interval[1] - self.interval[0]) / (2 * float(norm.ppf((1 + LEVEL) / 2)))

    @property
    def vary(self) -> bool:
        """Whether it is fitted."""
        return self.interval is not None


@dataclass(frozen=True)
class Superposition:
    """A master curve from curves at several temperatures."""

    curves: tuple[Measurement, ...]  # as measured, by ascending temperature
    reference: float  # degrees Celsius
    factors: tuple[FittedNumber, ...]  # log10 aT of each curve
    vertical: tuple[FittedNumber, ...]  # log10 bT of each curve; empty where moduli are not shifted
    constants: tuple[FittedNumber, ...]  # of the law of the shift
    law: Shift | None  # None for free factors
    master: Measurement  # all rows at the reference

    @property
    def temperatures(self) -> FloatArray:
        """Temperatures of the curves in degrees Celsius."""
        return np.array([each.temperature for each in self.curves], float)


def superposed(
    curves: Sequence[Measurement],
    reference: float | None = None,
    shift: str | Shift = "wlf",
    *,
    vertical: bool = False,
    relaxed: float | None = None,
) -> Superposition:
    """Find the shift factors of curves at several temperatures together with their master curve.

    Parameters
    ----------
    curves : sequence of Measurement
        Curves of one kind, each with its temperature.
    reference : float, optional
        Temperature of the master curve, degrees Celsius; by default that of the curve in the middle.
    shift : str or Shift
        wlf or arrhenius, whose constants are fitted; free, a factor for each curve; or a law, which is held.
    vertical : bool
        Whether the moduli of each curve have a factor too.
    relaxed : float, optional
        Relaxed modulus, see `laws.fit`.

    Returns
    -------
    Superposition
    """
    every = sorted(curves, key=lambda each: float(each.temperature or 0.0))
    problem = _ShiftProblem(tuple(every), _reference(every, reference, shift), shift, vertical, relaxed)
    return problem.solved()


def _reference(curves: Sequence[Measurement], reference: float | None, shift: str | Shift) -> float:
    temperatures = [float(each.temperature or 0.0) for each in curves]
    known = ", ".join(f"{T:g}" for T in temperatures)
    if len(curves) < 2:
        raise FitError("shift: got one temperature; factors need curves at two or more")
    if len({type(each) for each in curves}) > 1 or len({each.units for each in curves}) > 1:
        raise FitError("the curves at several temperatures differ in kind or units; must be alike")
    if isinstance(shift, Shift):
        if reference not in (None, shift.reference):
            raise FitError(f"reference: got {reference:g}, and {shift.reference:g} in the shift; give one")
        for temperature in temperatures:
            if reason := shift.refused(temperature):
                raise FitError(f"temperature: {reason}")
        return shift.reference
    if shift not in LAWS:
        raise FitError(f"shift: got {shift!r}; must be one of {', '.join(LAWS)}, or a law with its constants")
    if shift == "wlf" and len(curves) < 3:
        raise FitError("shift: wlf has two constants and needs three temperatures; take arrhenius or free")
    if reference is None:
        return temperatures[(len(curves) - 1) // 2]
    if shift == "free" and reference not in temperatures:
        raise FitError(f"reference: got {reference:g}; must be one of {known} with free factors")
    if not temperatures[0] <= reference <= temperatures[-1]:
        raise FitError(
            f"reference: got {reference:g}; must be from {temperatures[0]:g} to {temperatures[-1]:g}"
        )
    return reference


@dataclass(frozen=True)
class _ShiftProblem:
    """The error of the master curve as a function of unbounded numbers: of the shift, then ln bT."""

    curves: tuple[Measurement, ...]
    reference: float
    shift: str | Shift
    vertical: bool
    relaxed: float | None

    @cached_property
    def temperatures(self) -> FloatArray:
        return np.array([each.temperature for each in self.curves], float)

    @cached_property
    def nearest(self) -> int:
        """The curve that is not shifted in moduli, and from which the search starts."""
        return int(np.abs(self.temperatures - self.reference).argmin())

    @cached_property
    def owner(self) -> FloatArray:
        """The number of the curve of each row, curve by curve."""
        return np.repeat(np.arange(len(self.curves)), [each.abscissa.size for each in self.curves])

    @cached_property
    def others(self) -> list[int]:
        return [i for i in range(len(self.curves)) if i != self.nearest]

    # The law of the shift by unbounded numbers.

    def law(self, x: FloatArray) -> Shift | None:
        if isinstance(self.shift, Shift):
            return self.shift
        if self.shift == "wlf":  # the pole lies below the lowest temperature
            C1, above = np.exp(x[:2].clip(-LARGEST, LARGEST)).tolist()
            C2 = self.reference - float(self.temperatures[0]) + above
            return WLF(C1=C1, C2=C2, reference=self.reference)
        if self.shift == "arrhenius":
            energy = float(np.exp(x[0].clip(-LARGEST, LARGEST)))
            return Arrhenius(activation_energy=energy, reference=self.reference)
        return None

    @property
    def count(self) -> int:
        """Number of unknowns of the shift."""
        if isinstance(self.shift, Shift):
            return 0
        return {"wlf": 2, "arrhenius": 1, "free": len(self.others)}[self.shift]

    def logarithms(self, x: FloatArray) -> FloatArray:
        """Return ln aT of each curve."""
        law = self.law(x)
        if law is None:
            factors = np.zeros(len(self.curves))
            factors[self.others] = x[: self.count]
            return factors
        return np.array([law.logarithm(T) for T in self.temperatures.tolist()])

    def slopes(self, x: FloatArray) -> FloatArray:
        """Return the derivatives of ln aT by the unknowns of the shift."""
        step = 1e-5
        trials = [step * each for each in np.eye(x.size)[: self.count]]
        return np.reshape(
            [(self.logarithms(x + d) - self.logarithms(x - d)) / (2 * step) for d in trials],
            (self.count, len(self.curves)),
        ).T

    def heights(self, x: FloatArray) -> FloatArray:
        """Return ln bT of each curve."""
        heights = np.zeros(len(self.curves))
        if self.vertical:
            heights[self.others] = x[self.count :]
        return heights

    # The master curve.

    def joined(self, logs: FloatArray, heights: FloatArray, which: Sequence[int]) -> Measurement:
        """Return the rows of some curves as one, at the reference, curve by curve."""
        parts = [self.curves[i].slowed(math.exp(-logs[i])).in_units_of(math.exp(heights[i])) for i in which]
        return replace(
            self.curves[which[0]],
            abscissa=np.concatenate([each.abscissa for each in parts]),
            moduli=np.concatenate([each.moduli for each in parts], axis=1),
        )

    def series(self, x: FloatArray) -> SeriesProblem:
        """Return the problem of the dense series at the unknowns."""
        every = range(len(self.curves))
        return SeriesProblem(
            self.joined(self.logarithms(x), self.heights(x), every), self.relaxed, flows=self.flows
        )

    @property
    def flows(self) -> bool:
        return isinstance(self.curves[0], CreepCurve)

    def residual(self, x: FloatArray) -> FloatArray:
        problem = self.series(x)
        return problem.residual(problem.grid)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Derivatives of the residual, projected since the moduli follow (Kaufman)."""
        problem = self.series(x)
        curve, moduli = problem.measurement, problem.moduli(problem.grid)
        columns = problem.columns(problem.grid)
        over = curve.moduli.reshape(-1)
        moves = curve.sensitivity(np.exp(problem.grid)) @ moduli[problem.first :] / over
        if isinstance(curve, CreepCurve):
            moves -= columns[:, 1] * moduli[1]
        grows = (-1.0 if isinstance(curve, CreepCurve) else 1.0) * (columns @ moduli)
        ones = np.tile(self.owner, curve.moduli.shape[0])[:, np.newaxis] == np.arange(len(self.curves))
        found = [(ones * moves[:, np.newaxis]) @ self.slopes(x)]
        if self.vertical:
            found.append((ones * grows[:, np.newaxis])[:, self.others])
        free = moduli > 0
        if self.relaxed is not None:
            free[0] = False
        slopes, basis = np.hstack(found), np.linalg.qr(columns[:, free]).Q
        return np.asarray(slopes - basis @ (basis.T @ slopes))

    # The search.

    def start(self) -> FloatArray:
        """Return ln aT of each curve, where it joins the ones nearer to the reference best."""
        logs, flat = np.zeros(len(self.curves)), np.zeros(len(self.curves))
        placed = [self.nearest]
        below = list(range(self.nearest - 1, -1, -1))
        above = list(range(self.nearest + 1, len(self.curves)))
        for rows, sign in ((below, 1.0), (above, -1.0)):
            known = self.nearest
            for i in rows:
                trials = logs[known] + sign * math.log(10) * np.arange(0.0, REACH + TRIALS, TRIALS)
                errors = [self._beside(i, value, logs, flat, placed) for value in trials.tolist()]
                if not np.isfinite(errors).any():
                    raise FitError(
                        f"the curve at {self.temperatures[i]:g} degrees overlaps with no other one"
                    )
                logs[i] = trials[int(np.argmin(errors))]
                placed, known = [*placed, i], i
        return logs

    def _beside(
        self, i: int, value: float, logs: FloatArray, flat: FloatArray, placed: Sequence[int]
    ) -> float:
        """Return the error of the placed curves with another one; infinite where these hardly overlap."""
        trial = logs.copy()
        trial[i] = value
        own = self.curves[i].slowed(math.exp(-value)).abscissa
        span = self.joined(trial, flat, placed).abscissa
        if np.mean((own >= span.min()) & (own <= span.max())) < OVERLAP:
            return math.inf
        problem = SeriesProblem(self.joined(trial, flat, [*placed, i]), self.relaxed, flows=self.flows)
        return problem.least

    def solved(self) -> Superposition:
        heights = np.zeros(len(self.others) if self.vertical else 0)
        if isinstance(self.shift, Shift):
            x = heights
        else:
            logs = self.start()
            x = np.concatenate([logs[self.others], heights])
            if self.shift != "free":
                free = replace(self, shift="free")
                logs = free.logarithms(free.minimised(x)) if not self.vertical else logs
                x = np.concatenate([self._constants(logs), heights])
        x = self.minimised(x) if x.size else x
        law, longest = self.law(x), STRAIGHT * float(np.ptp(self.temperatures))
        if self.shift == "wlf" and isinstance(law, WLF) and longest < law.C2:
            message = f"the logarithms of the factors do not bend as those of wlf (C2 = {law.C2:.3g} K)"
            raise FitError(f"shift: {message}; take arrhenius or free")
        half, spread = np.zeros(0), np.zeros((0, 0))
        if x.size:
            blocks = [each.abscissa.size for each in self.curves]
            order = self._by_curve()
            made = mixture(
                -self.residual(x)[order], self.jacobian(x)[order],
                [rows for rows in blocks for _ in range(self.curves[0].moduli.shape[0])], level=LEVEL,
            )  # fmt: skip
            half, spread = made.half, made.spread
        return self._result(x, half, spread)

    def _by_curve(self) -> FloatArray:
        """Return the order of rows in which each modulus of each curve is a block."""
        size, parts = self.owner.size, self.curves[0].moduli.shape[0]
        return np.concatenate(
            [
                k * size + np.flatnonzero(self.owner == i)
                for i in range(len(self.curves))
                for k in range(parts)
            ]
        )

    def minimised(self, x: FloatArray) -> FloatArray:
        found = least_squares(self.residual, x, self.jacobian, x_scale="jac", xtol=1e-8, ftol=1e-10)
        return np.asarray(found.x)

    def _constants(self, logs: FloatArray) -> FloatArray:
        """Return the unknowns of the law that follows given ln aT best."""
        above = self.temperatures - self.reference
        if self.shift == "arrhenius":
            slope = 1 / (self.temperatures + ZERO_CELSIUS) - 1 / (self.reference + ZERO_CELSIUS)
            energy = GAS_CONSTANT * float(slope @ logs / (slope @ slope))
            if energy <= 0:
                raise FitError("shift: the curves become slower as the temperature rises; take free factors")
            return np.array([math.log(energy)])
        room = max(1.0, float(np.ptp(above)))
        starts = [
            np.array([math.log(C1), math.log(part * room)]) for C1 in (5.0, 15.0) for part in (0.3, 2.0)
        ]
        trials = [least_squares(lambda x: self.logarithms(x) - logs, start) for start in starts]
        return np.asarray(min(trials, key=lambda trial: trial.cost).x)

    def _result(self, x: FloatArray, half: FloatArray, spread: FloatArray) -> Superposition:
        law, logs, heights = self.law(x), self.logarithms(x), self.heights(x)
        widths = self._widths(self.slopes(x), spread, half)
        factors = tuple(
            _of("log10 aT", value / math.log(10), width / math.log(10), is_known)
            for value, width, is_known in zip(
                logs.tolist(), widths.tolist(), (widths > 0).tolist(), strict=True
            )
        )
        vertical: tuple[FittedNumber, ...] = ()
        if self.vertical:
            wide = np.zeros(len(self.curves))
            wide[self.others] = half[self.count :]
            vertical = tuple(
                _of("log10 bT", value / math.log(10), width / math.log(10), width > 0)
                for value, width in zip(heights.tolist(), wide.tolist(), strict=True)
            )
        joined = self.joined(logs, heights, range(len(self.curves)))
        order = np.argsort(joined.abscissa, kind="stable")
        words = ", ".join(f"{T:g}" for T in self.temperatures.tolist())
        master = replace(
            joined, abscissa=joined.abscissa[order], moduli=joined.moduli[:, order],
            notes=tuple(dict.fromkeys(note for each in self.curves for note in each.notes)),
            source=", ".join(dict.fromkeys(each.source for each in self.curves)), temperature=self.reference,
        )  # fmt: skip
        note = f"Curves at {words} degrees Celsius are shifted to {self.reference:g}."
        master = replace(master, notes=(*master.notes, note))
        return Superposition(
            self.curves, self.reference, factors, vertical, self._fitted(x, half, law), law, master
        )

    def _widths(self, slopes: FloatArray, spread: FloatArray, half: FloatArray) -> FloatArray:
        """Return the half widths of ln aT."""
        if not self.count:
            return np.zeros(len(self.curves))
        part = spread[: self.count, : self.count]
        errors = np.sqrt(np.einsum("ia,ab,ib->i", slopes, part, slopes))
        ratio = float(np.mean(half[: self.count] / np.sqrt(np.diag(part))))
        return np.asarray(ratio * errors)

    def _fitted(self, x: FloatArray, half: FloatArray, law: Shift | None) -> tuple[FittedNumber, ...]:
        if isinstance(law, WLF):
            base = self.reference - self.temperatures[0]
            if isinstance(self.shift, Shift):
                return FittedNumber("C1", law.C1), FittedNumber("C2", law.C2, unit="K")
            ends = [(math.exp(x[i] - half[i]), math.exp(x[i] + half[i])) for i in (0, 1)]
            return (
                FittedNumber("C1", law.C1, ends[0]),
                FittedNumber("C2", law.C2, (base + ends[1][0], base + ends[1][1]), "K"),
            )
        if isinstance(law, Arrhenius):
            ends_of = None
            if not isinstance(self.shift, Shift):
                ends_of = math.exp(x[0] - half[0]), math.exp(x[0] + half[0])
            return (FittedNumber("activation_energy", law.activation_energy, ends_of, "J/mol"),)
        return ()


def _of(name: str, value: float, width: float, is_known: bool) -> FittedNumber:
    return FittedNumber(name, value, (value - width, value + width) if is_known else None)
