"""The contact problem in a window around the contact, by transforms of twice the window's width.

Far from the contact there is no pressure, and all that is asked is that nothing overlaps. What pressures in a
window do to the gaps in it is a convolution with differences of its points only: exact by transforms of twice
the width of the window, with the kernel of the whole surface at these differences (circulant embedding: Golub
and Van Loan, Matrix Computations, 2013, ch. 4.8). Where the contact takes a tenth of the surface, an
iteration costs a quarter of one on the whole surface, and stays in the inner caches. The whole surface takes
three transforms, which show whether anything overlaps elsewhere: then a larger window is next, and where
there is none the whole surface.

The preconditioner needs not be exact: it is the stiffness of a surface as long as the transforms, which is
every second, fourth ... of the stiffnesses of the modes.
"""

from __future__ import annotations

from math import prod
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.contact.active_set.state import Work, make_bank, make_contact, make_work
from gfmdlayer.contact.active_set.window import overlaps, respond, restrict, solve
from gfmdlayer.contact.active_set.window_state import Found, Pair, Whole, Window
from gfmdlayer.contact.pressure_form import CLAMPED, Iterate, System
from gfmdlayer.contact.problem import Assessment, Problem, ResidualFloor, Solution, make_solution
from gfmdlayer.grid.grid import parts
from gfmdlayer.grid.periodic_extent import NOWHERE, Stretch, periodic_extent
from gfmdlayer.grid.transforms import Transforms

_MARGIN = 16  # points at least on either side of the contact that belong to the window


class Attempt(NamedTuple):
    """What a window gave.

    Attributes
    ----------
    transforms : float
        Of the whole surface, or of as many points.
    iterations : int
        Of conjugate gradients.
    within : bool
        Whether the state is a solution for the whole surface.
    found, judgement
        The state of the whole surface, where there is one.
    """

    transforms: float = 0.0
    iterations: int = 0
    within: bool = False
    found: Found | None = None
    judgement: Assessment = (np.nan, 0.0, 0.0, 0.0)

    def solution(self, problem: Problem, tolerance: float, pairs: int) -> Solution:
        """The state as a solution, which took a number of pairs."""
        assert self.found is not None  # as it is within
        u, pressure, gap, spectrum = self.found
        return make_solution(
            problem, u, pressure, spectrum, gap=gap, transforms=pairs, iterations=self.iterations,
            within=tolerance, judgement=self.judgement,
        )  # fmt: skip

    def guess(self, start: FloatArray) -> FloatArray:
        """The pressure, and next to none where it overlapped; or the one that it was started from."""
        if self.found is None:
            return start
        p, gap = self.found.p, self.found.gap
        return np.where((p == 0.0) & (gap == 0.0), np.finfo(float).tiny, p)


class Windows:
    """The windows of the surface of one run.

    Parameters
    ----------
    transforms : Transforms
        Of the whole surface.
    work : Work
        Work arrays of the whole surface.
    """

    def __init__(self, transforms: Transforms, work: Work) -> None:
        self._transforms, self._shape = transforms, transforms.shape
        self._parts = parts(self._shape)
        self._made: dict[int, tuple[Transforms, Window]] = {}
        self._fresh: set[int] = set()
        self._work = work
        self._kernel = transforms.empty_field()

    def renew(
        self, compliance: FloatArray, stiffness: FloatArray, least: ResidualFloor, *, load: bool
    ) -> None:
        """Take over what is the same for several steps, as in `System`."""
        self._compliance, self._stiffness, self._least, self._load = compliance, stiffness, least, load
        self._kernel_is_known = False
        self._fresh.clear()

    @property
    def kernel_is_known(self) -> bool:
        """Whether the kernel of this compliance has been made."""
        return self._kernel_is_known

    def make_kernel(self) -> None:
        """Make the kernel: what pressure at one point does to the others. A transform."""
        respond(self._transforms.plans, self._compliance, self._work.spectrum, self._kernel)
        self._kernel_is_known = True

    def solve(
        self, problem: Problem, guess: FloatArray, tolerance: float, rounds: int, limit: int
    ) -> Attempt:
        """Solve a problem in the shortest window around a guess of the pressure; where it outgrows it, again.

        A guess without contact is replaced by the overlap of the surface without pressure. Nothing is done
        where there is none either, or no window is short enough.
        """
        whole = Whole(
            self._transforms.plans, self._compliance, problem.obstacle,
            problem.intercept, self._work.spectrum, self._work.z,
        )  # fmt: skip
        attempt, part, shape = Attempt(), 0, _two(self._shape)
        around = periodic_extent(guess, shape)
        if around == NOWHERE and not self._load:
            guess, attempt = overlaps(whole), Attempt(transforms=1)
            around = periodic_extent(guess, shape)
        while attempt.iterations < limit and (part := self._fitting(around, part)):
            attempt = self._attempt(part, around, problem, whole, guess, attempt, tolerance, rounds, limit)
            if attempt.within or attempt.found is None:
                break
            guess = attempt.guess(guess)
            around = periodic_extent(guess, shape)
        return attempt

    def _attempt(
        self,
        part: int,
        around: tuple[Stretch, Stretch],
        problem: Problem,
        whole: Whole,
        guess: FloatArray,
        last: Attempt,
        tolerance: float,
        rounds: int,
        limit: int,
    ) -> Attempt:
        """Solve in a window around a contact."""
        spent, window = self._window(part), self._made[part][1]
        (first_row, rows), (first, points) = around
        origin = (
            (first_row + rows // 2 - window.width[0] // 2) % window.whole[0],
            (first + points // 2 - window.width[1] // 2) % window.whole[1],
        )
        done, transforms, shorter, more, overlap, judgement, state = solve(
            window, origin, whole, guess, problem.applied_pressure,
            tolerance, rounds, limit - last.iterations,
        )  # fmt: skip
        taken = last.transforms + spent + transforms + shorter / part ** len(self._shape)
        iterations = last.iterations + more
        if not done:
            return Attempt(taken, iterations)
        within = overlap <= CLAMPED and judgement[0] <= tolerance
        return Attempt(taken, iterations, within, state, judgement)

    def _fitting(self, around: tuple[Stretch, Stretch], less: int) -> int:
        """The largest part, less than some part if there is one, in whose window there is room, or none."""
        (_, rows), (_, points) = around
        if not points:
            return 0
        high, wide = (2 * (span + 2 * max(_MARGIN, span // 8)) for span in (rows, points))
        lines, line = _two(self._shape)
        for part in reversed(self._parts):
            if wide * part <= line and (lines == 1 or high * part <= lines) and not 0 < less <= part:
                return part
        return 0

    def _window(self, part: int) -> int:
        """Have a window with its kernels; return the transforms of the whole surface that this took."""
        if part in self._fresh:
            return 0
        if part not in self._made:
            shorter = self._transforms.shorter(part)
            self._made[part] = shorter, _empty(shorter, _two(self._shape))
        (shorter, window), taken = self._made[part], 0
        if not self._kernel_is_known:
            self.make_kernel()
            taken = 1
        yielding = float(self._compliance[0])
        own = window.system._replace(least=self._least, load=self._load, yielding=yielding)
        self._made[part] = shorter, window._replace(system=own)
        restrict(window, self._kernel, self._stiffness)
        self._fresh.add(part)
        return taken


def _empty(transforms: Transforms, whole: Pair) -> Window:
    """A window for some transforms, without a problem."""
    shape = transforms.shape
    size, spectral = prod(shape), prod(transforms.spectral_shape)
    gap0, h, p, gap, z = (transforms.empty_field() for _ in range(5))
    bank, length = make_bank(size), _two(shape)
    return Window(
        plans=transforms.plans,
        system=System(np.zeros(spectral), np.zeros(spectral), gap0, h, ResidualFloor(1.0, 0.0), False, 0.0),
        at=Iterate(p, gap, transforms.empty_spectrum()),
        contact=make_contact(shape),
        bank=bank,
        work=make_work(bank, z, transforms.empty_spectrum()),
        length=length,
        width=((length[0] + 1) // 2, length[1] // 2),
        whole=whole,
    )


def _two(shape: tuple[int, ...]) -> Pair:
    return (1, *shape)[-2], shape[-1]
