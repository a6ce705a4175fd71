"""The force of a model at the rows of a measured curve.

The contact is solved on a mesh of times that a fit chooses once, so that the force depends smoothly on the
parameters: between two corners of the depth, the times are fixed parts of the piece; where the first contact
lies within a piece, of what is left of it. There are more of them where the force bends, which evens out the
error of interpolation (de Boor 1973) and of the solution itself.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import Config
from gfmdlayer.fitting.indentation.curve import Drive, ForceCurve
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.indentation.indent import as_revolution
from gfmdlayer.indentation.isolated import IsolatedContact
from gfmdlayer.indentation.solve import on_halved_steps
from gfmdlayer.indentation.space import History, LeftGridError, Space, find_space, make_space

STEPS = 32  # of a mesh; each piece has at least FEWEST
FEWEST = 2
TRIAL = 10  # steps a piece of the solution that finds where the force bends
ONSET = 1.5  # F grows with this power of the depth
WIDER = 1.3  # largest radius, where a contact leaves the nodes
EVEN = 0.3  # part of the steps that is spread evenly over the time


class Prediction:
    """Forces under the depth of a measured curve.

    Parameters
    ----------
    curve : ForceCurve
        The curve.
    """

    def __init__(self, curve: ForceCurve) -> None:
        self.curve = curve
        self.drive = Drive.of(curve.time, curve.depth)
        self._parts = [np.linspace(0, 1, TRIAL + 1)] * (self.drive.time.size - 1)
        self._space: Space | None = None
        self.changes = 0  # of times and nodes: forces before and after one are not to be compared

    def adapt(self, config: Config, contact_point: float = 0.0, drift: float = 0.0) -> None:
        """Choose the mesh by where the force of a model bends, and the nodes by its lengths."""
        self._space, self.changes = None, self.changes + 1
        drive = self.drive.corrected(contact_point, drift)
        self._parts = [np.linspace(0, 1, TRIAL + 1)] * len(self._parts)
        times, force = self._solution(config, drive)
        if times.size > 2 and np.ptp(force) > 0:
            self._parts = _graded(times, force, drive)

    def force(self, config: Config, contact_point: float = 0.0, drift: float = 0.0) -> FloatArray:
        """Return the force at the rows of the curve, without an offset."""
        drive, rows = self.drive.corrected(contact_point, drift), self.curve.time
        times, force = self._solution(config, drive)
        found = np.zeros(rows.size)
        edges = [times[0], *(kink for kink in drive.kinks if kink > times[0])]
        for first, last in pairwise(edges):
            inside = (rows >= first) & (rows <= last)
            nodes = (times >= first) & (times <= last)
            found[inside] = _interpolated(times[nodes], force[nodes], rows[inside])
        return found

    def _solution(self, config: Config, drive: Drive) -> tuple[FloatArray, FloatArray]:
        """Return times and forces from the first contact on."""
        times = _mesh(drive, self._parts)
        body, profile = IsolatedContact(config).body, as_revolution(config.punch)
        history = History(times, np.interp(times, drive.time, drive.depth))
        if not history.value.max() > 0:
            return times, np.zeros(times.size)
        while True:
            space = self._space = self._space or find_space(body, profile, history)
            try:
                return times, on_halved_steps(body, space, profile, history, times).force[::2]
            except LeftGridError:
                self._space = make_space(space.features, min(WIDER * space.nodes.reach, profile.rim))
                self.changes += 1
            except ArithmeticError as error:
                raise FitError(f"curve {self.curve.name}: {error}") from error


def _mesh(drive: Drive, parts: list[FloatArray]) -> FloatArray:
    """Return the times of a mesh, from the first contact on."""
    first, begin = drive.first_contact
    times = []
    for piece in range(first, len(parts)):
        end = drive.time[piece + 1]
        times.append(begin + (end - begin) * parts[piece][:-1])
        begin = end
    return np.append(np.concatenate(times), drive.time[-1])


def _interpolated(times: FloatArray, force: FloatArray, rows: FloatArray) -> FloatArray:
    """Interpolate F^(2/3), which is smooth where a sphere touches, up to the time at which contact is lost.

    The root goes on straight to zero from the last two times in contact, at most to the next time: a time
    that comes to be one of contact with a small force changes nothing.
    """
    root = np.maximum(force, 0.0) ** (1 / ONSET)
    touching = np.flatnonzero(root > 0)
    if touching.size < 2:
        return np.asarray(np.interp(rows, times, force))
    last = int(touching[-1])
    if last < times.size - 1 and root[last] < root[last - 1]:
        pace = (root[last - 1] - root[last]) / (times[last] - times[last - 1])
        leaves = min(times[last] + root[last] / pace, times[last + 1])
        times, root = np.append(times[: last + 1], leaves), np.append(root[: last + 1], 0.0)
    inside = rows <= times[-1]
    found = np.zeros(rows.size)
    found[inside] = np.maximum(PchipInterpolator(times, root)(rows[inside]), 0.0) ** ONSET
    return found


def _graded(times: FloatArray, force: FloatArray, drive: Drive) -> list[FloatArray]:
    """Return the parts of each piece at which the error of interpolation is even."""
    first, begin = drive.first_contact
    root = np.maximum(force, 0.0) ** (1 / ONSET)
    slope = np.diff(root) / np.diff(times)
    bend = np.abs(np.diff(slope)) / (times[2:] - times[:-2]) / np.ptp(root)
    bend[np.isin(times[1:-1], drive.time)] = 0.0  # a kink of the depth is a node
    bend = np.concatenate((bend[:1], bend, bend[-1:]))
    density = np.sqrt(np.maximum(bend[1:], bend[:-1]))
    density += EVEN * np.sum(density * np.diff(times)) / np.ptp(times) + 1e-300
    level = np.concatenate(([0.0], np.cumsum(density * np.diff(times))))
    parts = [np.linspace(0, 1, FEWEST + 1)] * (drive.time.size - 1)
    for piece in range(first, len(parts)):
        end = drive.time[piece + 1]
        low, high = np.interp([begin, end], times, level)
        steps = max(FEWEST, round(STEPS * (high - low) / level[-1]))
        inner = np.interp(np.linspace(low, high, steps + 1), level, times)
        parts[piece] = np.clip((inner - begin) / (end - begin), 0.0, 1.0)
        parts[piece][[0, -1]] = 0.0, 1.0
        begin = end
    return parts
