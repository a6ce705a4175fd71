"""The contact problem in a window around the contact, by transforms of twice the window's width.

Far from the contact there is no pressure, and the only condition is that nothing overlaps. The effect of
pressures in a window on the gaps in it is a convolution that involves differences of its points only: exact
by transforms of twice the width of the window, with the kernel of the whole surface at these differences
(circulant embedding: Golub and Van Loan, Matrix Computations, 2013, ch. 4.8). Where the contact takes a tenth
of the surface, an iteration costs a quarter of one on the whole surface, and stays in the inner caches. The
whole surface takes three transforms, which show whether anything overlaps elsewhere: then a larger window is
next, and where there is none the whole surface.

The preconditioner need not be exact: it is the stiffness of a surface as long as the transforms, which is
every second, fourth ... of the stiffnesses of the modes.
"""

from __future__ import annotations

from math import prod
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.active_set.state import Work, make_contact, make_work
from gfmdlayer.contact.active_set.window import overlaps, respond, restrict, solve
from gfmdlayer.contact.active_set.window_state import Pair, Surface, Window
from gfmdlayer.contact.pressure_form import CLAMPED, Iterate, State, System
from gfmdlayer.contact.problem import Problem, Solution, make_solution
from gfmdlayer.contact.residual import ResidualFloor
from gfmdlayer.grid.grid import parts
from gfmdlayer.grid.periodic_extent import NOWHERE, Stretch, periodic_extent
from gfmdlayer.grid.transforms import Transforms

_MARGIN = 16  # points at least on either side of the contact that belong to the window


class WindowResult(NamedTuple):
    """Result of the windows that were tried.

    Attributes
    ----------
    transforms : float
        Of the whole surface, or of as many points.
    iterations : int
        Of conjugate gradients.
    within : bool
        Whether the state is a solution for the whole surface.
    state : State, optional
        The state of the whole surface.
    assessment : tuple of float
        What `assess` would return of it.
    """

    transforms: float = 0.0
    iterations: int = 0
    within: bool = False
    state: State | None = None
    assessment: tuple[float, float, float, float] = (np.nan, 0.0, 0.0, 0.0)

    def solution(self, problem: Problem, tolerance: float, pairs: int) -> Solution:
        """The state as a solution that took a number of FFT pairs."""
        assert self.state is not None  # as it is within
        u, pressure, gap, spectrum = self.state
        return make_solution(
            problem, u, pressure, spectrum, gap=gap, spent=(pairs, self.iterations),
            within=tolerance, assessment=self.assessment,
        )  # fmt: skip

    def guess(self, start: FloatArray) -> FloatArray:
        """The pressure, with a tiny one where it overlapped; or ``start`` where there is no state."""
        if self.state is None:
            return start
        p, gap = self.state.p, self.state.gap
        return np.where((p == 0.0) & (gap == 0.0), np.finfo(float).tiny, p)


class Windows:
    """The windows of the surface of one run.

    Parameters
    ----------
    transforms : Transforms
        Of the whole surface.
    work : Work
        Work arrays of the whole surface.
    used : bool
        Whether there are any.
    """

    def __init__(self, transforms: Transforms, work: Work, *, used: bool = True) -> None:
        self._transforms, self._shape = transforms, transforms.shape
        self._parts = parts(self._shape) if used else ()
        self._made: dict[int, tuple[Transforms, Window]] = {}
        self._current: set[int] = set()  # parts whose window has the present stiffness
        self._work = work
        self._kernel = transforms.empty_field()

    def set_system(self, system: System) -> None:
        """Take over stiffness and floor, which stay the same for several steps."""
        self._system, self._kernel_is_known = system, False
        self._current.clear()

    @property
    def kernel_is_known(self) -> bool:
        """Whether the kernel of the present compliance has been made."""
        return self._kernel_is_known

    def make_kernel(self) -> None:
        """Make the kernel: the displacement of all points by a pressure at one. A transform."""
        respond(self._transforms.plans, self._system.compliance, self._work.spectrum, self._kernel)
        self._kernel_is_known = True

    def solve(
        self, problem: Problem, guess: FloatArray, tolerance: float, rounds: int, limit: int
    ) -> WindowResult:
        """Solve in the shortest window around a guess of the pressure, then in larger ones if it outgrows it.

        Parameters
        ----------
        problem : Problem
            The problem on the whole surface.
        guess : ndarray, one value a point
            Of the pressure. Without contact it is replaced by the overlap of the surface without pressure.
        tolerance : float
            Of the residual.
        rounds, limit : int
            Most changes of the contact set, and iterations.

        Returns
        -------
        WindowResult
            Empty where nothing overlaps, or no window is short enough.
        """
        surface = Surface(
            self._transforms.plans, self._system.compliance, problem.obstacle,
            problem.intercept, self._work.spectrum, self._work.z,
        )  # fmt: skip
        result, part, shape = WindowResult(), 0, _two(self._shape)
        extent = periodic_extent(guess, shape)
        if extent == NOWHERE and not self._system.load_given:
            guess, result = overlaps(surface), WindowResult(transforms=1)
            extent = periodic_extent(guess, shape)
        while result.iterations < limit and (part := self._largest_part(extent, part)):
            spent, window = self._window(part)
            arguments = window, _origin(extent, window), surface, guess, problem.applied_pressure
            done, whole, shorter, more, overlap, assessment, state = solve(
                *arguments, tolerance, rounds, limit - result.iterations
            )
            taken = result.transforms + spent + whole + shorter / part ** len(self._shape)
            result = WindowResult(taken, result.iterations + more)
            if not done:
                break
            within = overlap <= CLAMPED and assessment[0] <= tolerance
            result = result._replace(within=within, state=state, assessment=assessment)
            if within:
                break
            guess = result.guess(guess)
            extent = periodic_extent(guess, shape)
        return result

    def _largest_part(self, extent: tuple[Stretch, Stretch], below: int) -> int:
        """The largest part whose window has room for a contact, below ``below`` unless that is 0; else 0."""
        (_, rows), (_, points) = extent
        if not points:
            return 0
        high, wide = (2 * (length + 2 * max(_MARGIN, length // 8)) for length in (rows, points))
        lines, line = _two(self._shape)
        for part in reversed(self._parts):
            if wide * part <= line and (lines == 1 or high * part <= lines) and not 0 < below <= part:
                return part
        return 0

    def _window(self, part: int) -> tuple[int, Window]:
        """Return the transforms of the whole surface that this takes, and a window for a part of it."""
        if part in self._current:
            return 0, self._made[part][1]
        if part not in self._made:
            shorter = self._transforms.shorter(part)
            self._made[part] = shorter, _make_window(shorter, _two(self._shape))
        shorter, window = self._made[part]
        taken = 0 if self._kernel_is_known else 1
        if taken:
            self.make_kernel()
        shared = {name: getattr(self._system, name) for name in ("floor", "load_given", "mean_compliance")}
        window = window._replace(system=window.system._replace(**shared))
        self._made[part] = shorter, window
        restrict(window, self._kernel, self._system.stiffness)
        self._current.add(part)
        return taken, window


def _origin(extent: tuple[Stretch, Stretch], window: Window) -> Pair:
    """Line and point where a window begins that has a contact in its middle."""
    (first_row, rows), (first, points) = extent
    return (
        (first_row + rows // 2 - window.width[0] // 2) % window.surface[0],
        (first + points // 2 - window.width[1] // 2) % window.surface[1],
    )


def _make_window(transforms: Transforms, surface: Pair) -> Window:
    """A window for some transforms, without a problem."""
    spectral, length = prod(transforms.spectral_shape), _two(transforms.shape)
    gap0, h, p, gap = (transforms.empty_field() for _ in range(4))
    floor = ResidualFloor(1.0, 0.0)
    return Window(
        plans=transforms.plans,
        system=System(np.zeros(spectral), np.zeros(spectral), gap0, h, floor, False, 0.0),
        at=Iterate(p, gap, transforms.empty_spectrum()),
        contact=make_contact(transforms.shape),
        work=make_work(transforms),
        length=length,
        width=((length[0] + 1) // 2, length[1] // 2),
        surface=surface,
    )


def _two(shape: tuple[int, ...]) -> Pair:
    return (1, *shape)[-2], shape[-1]
