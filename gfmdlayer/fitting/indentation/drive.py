"""The measured depth as straight pieces in time, and time points of a solution between their corners.

A measured depth has noise, and thousands of rows. It is replaced by straight pieces whose corners are among
the rows (Ramer 1972; Douglas & Peucker 1973), within `TOLERANCE` of its range or `SIGMAS` of its noise. Their
depths are those of least squares; under noise, corners that it explains are removed again. The pieces stay
straight when a contact point and a drift are taken off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gfmdlayer.arrays import FloatArray

TOLERANCE = 1e-3  # of the range of the depth
SIGMAS = 4.5  # of the noise: one row in 150 000 is further away
CHANCE = 20.0  # variances of the noise: what a needless corner takes off the sum of squares, at most
SHARP = 0.1  # of the largest rate: a larger jump of the rate is a kink of the force


@dataclass(frozen=True)
class Drive:
    """A depth of straight pieces.

    Parameters
    ----------
    time, depth : ndarray, shape (corners,)
        The corners.
    error : float
        Standard deviation of the measured depth from it.
    """

    time: FloatArray
    depth: FloatArray
    error: float

    @classmethod
    def of(cls, time: FloatArray, depth: FloatArray) -> Drive:
        """Reduce a measured depth to straight pieces."""
        noise = 1.4826 * float(np.median(np.abs(np.diff(depth, 2)))) / 6**0.5
        within = TOLERANCE * float(np.ptp(depth))
        corners = time[_corners(time, depth, max(within, SIGMAS * noise))]
        if SIGMAS * noise > within:
            corners = _pruned(time, depth, corners, CHANCE * noise**2)
        at_corners, squares = _least_squares(time, depth, corners)
        return cls(corners, at_corners, (squares / time.size) ** 0.5)

    def corrected(self, contact_point: float, drift: float) -> Drive:
        """Return the depth below the contact point, without the drift."""
        return Drive(self.time, self.depth - contact_point - drift * (self.time - self.time[0]), self.error)

    @property
    def first_contact(self) -> tuple[int, float]:
        """The piece in which the depth first becomes positive, and the time at which it does.

        A depth that is positive from the beginning does so at the first corner; one that never is, at the
        last.
        """
        if self.depth[0] >= 0:
            return 0, float(self.time[0])
        below = np.flatnonzero(self.depth > 0)
        if not below.size:
            return self.time.size - 2, float(self.time[-1])
        piece = int(below[0]) - 1
        before, after = self.depth[piece], self.depth[piece + 1]
        part = -before / (after - before)
        return piece, float(self.time[piece] + part * (self.time[piece + 1] - self.time[piece]))

    @property
    def kinks(self) -> FloatArray:
        """Times of the corners at which the rate jumps by a large part of itself, and both ends."""
        rates = np.diff(self.depth) / np.diff(self.time)
        jumps = np.abs(np.diff(rates)) > SHARP * np.abs(rates).max()
        return np.asarray(self.time[np.concatenate(([True], jumps, [True]))])


def _corners(time: FloatArray, depth: FloatArray, within: float) -> list[int]:
    """Return the rows that are corners: the furthest from each chord, as long as any is too far."""
    found, open_pieces = {0, time.size - 1}, [(0, time.size - 1)]
    while open_pieces:
        first, last = open_pieces.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        chord = np.interp(time[inside], time[[first, last]], depth[[first, last]])
        away = np.abs(depth[inside] - chord)
        furthest = int(np.argmax(away))
        if away[furthest] > within:
            middle = first + 1 + furthest
            found.add(middle)
            open_pieces += [(first, middle), (middle, last)]
    return sorted(found)


def _pruned(time: FloatArray, depth: FloatArray, corners: FloatArray, chance: float) -> FloatArray:
    """Return the corners without those whose removal adds no more than `chance` to the sum of squares."""
    squares = _least_squares(time, depth, corners)[1]
    while corners.size > 2:
        without = [np.delete(corners, i) for i in range(1, corners.size - 1)]
        sums = [_least_squares(time, depth, each)[1] for each in without]
        best = int(np.argmin(sums))
        if sums[best] > squares + chance:
            break
        corners, squares = without[best], sums[best]
    return corners


def _least_squares(time: FloatArray, depth: FloatArray, corners: FloatArray) -> tuple[FloatArray, float]:
    """Return the depths of the corners that are closest to all rows, and the sum of squares."""
    from scipy.linalg import solveh_banded

    piece = np.clip(np.searchsorted(corners, time, side="right") - 1, 0, corners.size - 2)
    right = (time - corners[piece]) / (corners[piece + 1] - corners[piece])
    left = 1 - right
    banded = np.zeros((2, corners.size))
    np.add.at(banded[1], piece, left**2)
    np.add.at(banded[1], piece + 1, right**2)
    np.add.at(banded[0], piece + 1, left * right)
    moment = np.zeros(corners.size)
    np.add.at(moment, piece, left * depth)
    np.add.at(moment, piece + 1, right * depth)
    found = np.asarray(solveh_banded(banded, moment))
    return found, float(np.sum((depth - np.interp(time, corners, found)) ** 2))
