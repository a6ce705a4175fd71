"""The response of a surface to tractions in all directions, and its action on fields.

Per wavevector q with unit vector n: displacement W into the body, along the wave u_n = i U, across it V; on
the surface the pressure p, the traction i T along n and S across it (both on the body). Then

    W = C_WW p + C_WU T,    U = C_WU p + C_UU T,    V = C_VV S

with real C. In components C is Hermitian, and real but for the coupling of p with t, -i C_WU n. Parts that
are odd along an axis vanish at its largest wavenumber, where +q and -q share a mode.

Fields stand one below the other, (p, t_x[, t_y]) and (W, u_x[, u_y]), of shape (1 + axes, points).

In steady rolling a state repeats itself after a way h along x. The response of a body that relaxes is then
complex, of the material that passes, with the conjugate at -q_x. Slip is linear in the tractions (`Rolling`):
the displacements u(x) - u(x + h) relative to the last step have the factor 1 - exp(i q_x h) on u.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from hashlib import blake2b
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.grid.grid import Grid, parts
from gfmdlayer.grid.ranks import ALONE, Ranks
from gfmdlayer.grid.transforms import Plans, Transforms, backward, forward
from gfmdlayer.kernels import kernel


@dataclass(frozen=True)
class Response:
    """Compliance of a surface at the modes of a grid, displacement over traction: C_WW, C_WU, C_UU, C_VV.

    The value at q = 0 is that of the mean: zero where the mean displacement is fixed. There `along` is the
    tangential compliance in all directions.
    """

    normal: FloatArray  # C_WW
    coupling: FloatArray  # C_WU
    along: FloatArray  # C_UU
    across: FloatArray  # C_VV; without a meaning on a line
    _: KW_ONLY
    ranks: Ranks = ALONE  # the processes that hold the modes

    @classmethod
    def of_stiffness(cls, in_plane: NDArray[Any], across: NDArray[Any], ranks: Ranks = ALONE) -> Response:
        """Response of a stiffness K over (W, U), shape (*modes, 2, 2), and of that over V."""
        # Where K is zero, at q = 0, the mean displacement is fixed; the mean of W and that of u do not
        # couple.
        normal, coupling, along = in_plane[..., 0, 0], in_plane[..., 0, 1], in_plane[..., 1, 1]
        mean = np.zeros(normal.shape, dtype=bool)
        ranks.set_mean_wave(mean.ravel(), 1)
        coupling = np.where(mean, 0.0, coupling)
        with np.errstate(divide="ignore", invalid="ignore"):
            whole = normal * along - coupling**2
            full = along / whole, -coupling / whole, normal / whole, 1 / across
            alone = 1 / normal, np.zeros(normal.shape), 1 / along, 1 / across
        parts = (np.where(mean, one, other) for one, other in zip(alone, full, strict=True))
        return cls(*(np.where(np.isfinite(part), part, 0.0) for part in parts), ranks=ranks)

    def beside(self, other: Response) -> Response:
        """Response of gap and slip between this surface and one above it, mirrored, that feels p and -t."""
        # C_1 + J C_2 J with J = diag(1, -1): equal surfaces do not couple.
        return Response(
            self.normal + other.normal,
            self.coupling - other.coupling,
            self.along + other.along,
            self.across + other.across,
            ranks=self.ranks,
        )

    @cached_property
    def digest(self) -> str:
        """Digest of the values."""
        return _digest((self.normal, self.coupling, self.along, self.across), self.ranks)

    def equals(self, other: AnyResponse) -> bool:
        """Whether another response has the same values."""
        return self is other or self.digest == other.digest

    is_positive = True  # in all waves

    @cached_property
    def couples(self) -> bool:
        """Whether shear moves the surface up and down."""
        return bool(self.ranks.maximum(int(self.coupling.any())))

    @cached_property
    def softest(self) -> float:
        """Largest compliance of a wave to pressure."""
        return self.ranks.maximum(float(self.normal.real.max()))

    @cached_property
    def critical_coefficient(self) -> float:
        """Coefficient of friction with which shear moves a wave up and down as much as pressure does."""
        coupled = self.coupling != 0
        normal, coupling = np.abs(self.normal[coupled]), np.abs(self.coupling[coupled])
        return self.ranks.minimum(float(np.min(normal / coupling, initial=np.inf)))

    def factors(self, grid: Grid) -> tuple[FloatArray, ...]:
        """Factors of the components over the number of points: C_pp, coupling along the axes, C_tt."""
        flat = (self.normal, self.coupling, self.along, self.across)
        normal, coupling, along, across = (np.ravel(part) / grid.size for part in flat)
        if len(grid.points) == 1:
            return _of_shared_modes(grid, normal, coupling, along)
        q = grid.wavenumbers
        length = np.where(q > 0, q, 1.0)
        x, y = (np.ravel(np.broadcast_to(component, q.shape) / length) for component in grid.wavevectors)
        difference = along - across
        xx, yy = across + difference * x**2, across + difference * y**2
        for part in (xx, yy):
            grid.ranks.set_mean_wave(part, along[0])
        return _of_shared_modes(grid, normal, coupling * x, coupling * y, xx, difference * x * y, yy)

    def on(self, fine: Transforms, coarse: Transforms) -> Response:
        """Response at the modes of a coarser grid of the same cell."""
        parts = self.normal, self.coupling, self.along, self.across
        on = (fine.truncated(part, coarse).reshape(coarse.spectral_shape) for part in parts)
        return Response(*on, ranks=self.ranks)

    def inverse(self, grid: Grid) -> Response:
        """Stiffness without the coupling; a fixed mean has that of the longest wave."""
        stiffness = []
        for part in (self.normal, self.along, self.across):
            positive = part.ravel().copy()
            if grid.ranks.first and positive[0].real <= 0:  # who holds the longest wave too
                longest = np.argmin(np.where(grid.wavenumbers.ravel() > 0, grid.wavenumbers.ravel(), np.inf))
                positive[0] = positive[longest]
            stiffness.append((1 / positive).reshape(part.shape))
        if len(grid.points) > 1 and grid.ranks.first:  # the mean has no direction
            stiffness[1].flat[0] = 2 / (1 / stiffness[1].flat[0] + 1 / stiffness[2].flat[0])
        normal, along, across = stiffness
        return Response(normal, np.zeros_like(normal), along, across, ranks=grid.ranks)


@dataclass(frozen=True)
class CroppedResponse:
    """Compliance of a surface without images, by its kernel in a cell: exact in a box of half of the cell.

    Its spectrum has no direction of its own, and may be negative in some waves: on the points in contact it
    is the positive one of the surface itself. `friction.isolated` makes it.
    """

    parts: tuple[FloatArray, ...]  # as of `Response.factors`, each of the spectral shape
    plain: Response  # of the same surface with images, the mean fixed: for what needs positive waves only

    @property
    def normal(self) -> FloatArray:
        """C_WW; at q = 0 the displacement under a mean pressure."""
        return self.parts[0]

    @cached_property
    def digest(self) -> str:
        """Digest of the values."""
        return _digest(self.parts, self.plain.ranks)

    def equals(self, other: AnyResponse) -> bool:
        """Whether another response has the same values."""
        return self is other or self.digest == other.digest

    @cached_property
    def is_positive(self) -> bool:
        """Whether pressure presses the surface down in all waves, as a solver without friction needs it."""
        return self.plain.ranks.minimum(float(self.normal.min())) > 0

    @property
    def couples(self) -> bool:
        """Whether shear moves the surface up and down."""
        return self.plain.couples

    @property
    def softest(self) -> float:
        """Largest compliance of a wave to pressure."""
        return self.plain.softest

    @property
    def critical_coefficient(self) -> float:
        """Coefficient of friction with which shear moves a wave up and down as much as pressure does."""
        return self.plain.critical_coefficient

    def factors(self, grid: Grid) -> tuple[FloatArray, ...]:
        """Real factors of the components over the number of points, see `Response.factors`."""
        return _of_shared_modes(grid, *(np.ravel(part) / grid.size for part in self.parts))

    def on(self, fine: Transforms, coarse: Transforms) -> CroppedResponse:
        """Response at the modes of a coarser grid of the same cell."""
        parts = (fine.truncated(part, coarse).reshape(coarse.spectral_shape) for part in self.parts)
        return CroppedResponse(tuple(parts), self.plain.on(fine, coarse))

    def inverse(self, grid: Grid) -> Response:
        """Stiffness of the surface with images, without the coupling, see `Response.inverse`."""
        return self.plain.inverse(grid)


class Rolling(NamedTuple):
    """Slip in place of displacements along the surface: u(x) - u(x + way), times a length over the way."""

    way: float  # h, in which the state repeats itself
    length: float  # brings the slip of a point under a load on it to its displacement
    kept: float  # part of u(x + way) of which a stiffness is the inverse: slip alone has no mean
    stiff: bool = False  # whether it is a stiffness, tractions over slip

    @classmethod
    def over(cls, way: float, of: Response | CroppedResponse, grid: Grid, points: int) -> Rolling:
        """Rolling by a way, in a contact of so many points along x."""
        q = np.broadcast_to(grid.wavevectors[0], grid.spectral_shape)
        waves = grid.parseval_weights.ravel() * of.factors(grid)[1 + len(grid.points)].real
        sums = np.array([waves.sum(), (waves * (1 - np.cos(q * way)).ravel()).sum()])
        point, change = grid.ranks.total(sums).tolist()
        return cls(way, abs(way) * point / change, max(1 - _LEFT_OUT / points, 0.0))

    def rows(self, q: FloatArray) -> ComplexArray:
        """Return the factor on displacements, or on tractions over them, at wavenumbers along x."""
        turned = np.exp(1j * q * self.way)
        if self.stiff:
            return np.asarray(abs(self.way) / self.length / (1 - self.kept * turned))
        return np.asarray(self.length / abs(self.way) * (1 - turned))

    def on(self, part: float) -> Rolling:
        """Return the same on a grid with a part of the points along x, which rolls by as many."""
        return self._replace(way=self.way / part, kept=1 - (1 - self.kept) / part)


@dataclass(frozen=True)
class RollingResponse:
    """The displacement W and the slip of steady rolling over tractions, or a stiffness."""

    of: Response | CroppedResponse  # over displacements, in the state; parts may be complex
    rolling: Rolling

    @cached_property
    def digest(self) -> str:
        """Digest of the values."""
        return f"{self.of.digest} {self.rolling}"

    def equals(self, other: AnyResponse) -> bool:
        """Whether another response has the same values."""
        return self is other or self.digest == other.digest

    is_positive = False

    @property
    def normal(self) -> NDArray[Any]:
        """C_WW."""
        return self.of.normal

    @property
    def couples(self) -> bool:
        """Whether shear moves the surface up and down."""
        return self.of.couples

    @property
    def softest(self) -> float:
        """Largest compliance of a wave to pressure."""
        return self.of.softest

    @property
    def critical_coefficient(self) -> float:
        """Coefficient of friction with which shear moves a wave up and down as much as pressure does."""
        return self.of.critical_coefficient

    def factors(self, grid: Grid) -> tuple[ComplexArray, ...]:
        """Factors of the components over the number of points, those on p and t for W, then for each slip."""
        normal, *parts = self.of.factors(grid)
        rows = self.rolling.rows(np.broadcast_to(grid.wavevectors[0], grid.spectral_shape).ravel())
        axes = len(grid.points)
        coupling, along = [1j * part for part in parts[:axes]], parts[axes:]
        matrix = [normal, *(-part for part in coupling)]
        for axis, part in enumerate(coupling):
            matrix += [rows * part, *(rows * each for each in along[axis : axis + axes])]
        return tuple(np.asarray(part, dtype=np.complex128) for part in matrix)

    def on(self, fine: Transforms, coarse: Transforms) -> RollingResponse:
        """Response at the modes of a coarser grid of the same cell."""
        rolling = self.rolling.on(coarse.points[0] / fine.points[0])
        return RollingResponse(self.of.on(fine, coarse), rolling)

    def inverse(self, grid: Grid) -> RollingResponse:
        """Stiffness without the coupling, see `Response.inverse`, and with less than the mean of slip."""
        return RollingResponse(self.of.inverse(grid), self.rolling._replace(stiff=True))


AnyResponse = Response | CroppedResponse | RollingResponse

_LEFT_OUT = 6.0  # of 1 - 6/n: 1 takes three times the iterations of 4 to 8


def _digest(parts: Sequence[NDArray[Any]], ranks: Ranks) -> str:
    """Digest of values, the same one on all ranks."""
    every = ranks.all_of(blake2b(b"".join(part.tobytes() for part in parts)).hexdigest())
    return every[0] if len(every) == 1 else blake2b("".join(every).encode()).hexdigest()


def _of_shared_modes(grid: Grid, *parts: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Return factors, with the mean of +q and -q in modes that both share at the end of an axis."""
    # With the conjugate at -q_x, even ones are real and odd ones imaginary; along y odd ones vanish.
    axes, made = len(grid.points), [*parts]
    for axis in (axis for axis in range(axes) if grid.points[axis] % 2 == 0):
        largest = np.arange(grid.spectral_shape[axis]) + (grid.columns.start if axis == axes - 1 else 0)
        along = np.expand_dims(largest == grid.points[axis] // 2, tuple({*range(axes)} - {axis}))
        shared = np.broadcast_to(along, grid.spectral_shape)
        for number, part in enumerate(parts):
            is_odd, is_complex = number in {1 + axis, 4}, np.iscomplexobj(part) and axis == 0
            if is_odd or is_complex:
                mean = 1j * part.imag if is_complex else 0.0
                made[number] = np.where(shared.ravel(), mean if is_odd else part.real, made[number])
    return tuple(made)


@dataclass
class Spent:
    """FFT pairs of one real field on the finest grid; those in single precision count half."""

    pairs: float = 0.0


class SharedTransforms:
    """Transforms of a grid and of windows in it, with their fields, which all operators on it share."""

    def __init__(self, transforms: Transforms, spent: Spent, share: float) -> None:
        self.shape = transforms.points
        self._transforms, self.spent, self._share = transforms, spent, share
        # Several ranks transform the whole surface, the rows of which they hold.
        self._parts = parts(self.shape) if transforms.ranks.count == 1 else ()
        self._made: dict[tuple[int, bool], CountedFields] = {}
        self._last: tuple[Any, tuple[int, NDArray[Any]]] = None, (1, np.zeros(0, int))  # see `window`

    def fields(self, part: int = 1, *, single: bool) -> CountedFields:
        """Return transforms and fields of a window with 1/part of the points of each axis."""
        if (part, single) not in self._made:
            plan, shape = self._transforms, tuple(n // part for n in self.shape)
            if single or part > 1:
                plan = plan.of_shape(shape, single=single)
            share = self._share / part ** len(shape)
            self._made[part, single] = CountedFields(plan, self.spent, share * (0.5 if single else 1.0))
        return self._made[part, single]

    def spend(self, pairs: float) -> None:
        """Count FFT pairs."""
        self.spent.pairs += pairs * self._share

    def window(self, points: NDArray[Any]) -> tuple[int, NDArray[Any]]:
        """Return the part of the smallest window twice as wide as some points, and where they are in it."""
        if points is not self._last[0]:  # two responses are asked for at the same points in turn
            self._last = points, self._window(points) if self._parts else (1, points)
        return self._last[1]

    def _window(self, points: NDArray[Any]) -> tuple[int, NDArray[Any]]:
        places = np.unravel_index(points, self.shape)
        extents = [_extent(place, n) for place, n in zip(places, self.shape, strict=True)]
        fitting = (
            part
            for part in reversed(self._parts)
            if all(2 * width * part <= n for (_, width), n in zip(extents, self.shape, strict=True))
        )
        part = next(fitting, 1)
        if part == 1:
            return 1, points
        inside = [(at - first) % n for at, (first, _), n in zip(places, extents, self.shape, strict=True)]
        return part, np.ravel_multi_index(inside, tuple(n // part for n in self.shape))


class CountedFields:
    """Fields and spectra of one shape with their transforms, which are counted."""

    def __init__(self, plan: Transforms, spent: Spent, share: float) -> None:
        self.plan, self._spent, self._share = plan, spent, share
        count = 1 + len(plan.shape)
        self.points = [plan.empty_field() for _ in range(count)]
        self.waves = [plan.empty_spectrum() for _ in range(count)]

    def spend(self, pairs: float) -> None:
        """Count FFT pairs."""
        self._spent.pairs += pairs * self._share

    def transform(self, number: int) -> None:
        """Transform a field."""
        self.plan.transform(self.points[number], self.waves[number])
        self._spent.pairs += 0.5 * self._share

    def transform_back(self, number: int) -> None:
        """Transform a spectrum back."""
        self.plan.transform_back(self.waves[number], self.points[number])
        self._spent.pairs += 0.5 * self._share

    def respond(self, factors: tuple[NDArray[Any], ...], live: Sequence[bool]) -> list[Any]:
        """Replace the first fields by the response to them; those that are not live are zero."""
        for number, is_live in enumerate(live):
            if is_live:
                self.transform(number)
            else:
                self.waves[number][:] = 0.0
        spectra = self.waves[: len(live)]
        if len(live) == 1:
            spectra[0] *= factors[0]
        elif len(factors) == len(live) ** 2:
            (_rolling_line if len(live) == 2 else _rolling_surface)(*factors, *spectra)
        elif len(live) == 2:  # a line
            _line(*factors, *spectra)
        else:
            _surface(*factors, *spectra)
        for number in range(len(live)):
            self.transform_back(number)
        return self.points[: len(live)]


def _extent(places: NDArray[Any], n: int) -> tuple[int, int]:
    """First point and length of the shortest periodic interval of an axis that holds some points."""
    held = np.flatnonzero(np.bincount(places, minlength=n))
    if not held.size:
        return 0, 0
    steps = np.empty_like(held)
    steps[:-1], steps[-1] = held[1:] - held[:-1], held[0] + n - held[-1]
    longest = int(np.argmax(steps))
    return int(held[(longest + 1) % held.size]), n - int(steps[longest]) + 1


class Operator:
    """A response at the points of a grid, in double and in single precision."""

    def __init__(
        self, grid: Grid, response: AnyResponse, work: SharedTransforms, counted: Collection[int] = ()
    ) -> None:
        # `counted` are parts of windows whose kernels a resumed run has made, and counted, before.
        self.size, self.axes, self.ranks = math.prod(grid.shape), len(grid.points), grid.ranks
        self._response, self.work, self._counted = response, work, counted
        self.rolls = isinstance(response, RollingResponse)
        self._double: tuple[NDArray[Any], ...] = response.factors(grid)
        self._kind = np.complex64 if self.rolls else np.float32
        self._single = {1: tuple(part.astype(self._kind) for part in self._double)}
        weights = np.ravel(grid.parseval_weights) * grid.size
        along = self._double[1 + self.axes + self.rolls]
        # displacement of a point under a load on it alone
        of_waves = np.array([weights @ np.ravel(response.normal.real), weights @ along.real * grid.size])
        self.point: tuple[float, float] = tuple(grid.ranks.total(of_waves).tolist())

    def __call__(self, x: NDArray[Any], *, single: bool = False) -> FloatArray:
        """Return the response to fields, as new fields in double precision."""
        work = self.work.fields(single=single)
        for field, values in zip(work.points, x, strict=False):
            field[:] = values
        factors = self._single[1] if single else self._double
        live = self.ranks.maximum(np.array([values.any() for values in x], dtype=np.int64))
        return np.array(work.respond(factors, live.astype(bool).tolist()), dtype=np.float64)

    def among(self, points: NDArray[Any]) -> Callable[[NDArray[Any]], NDArray[Any]]:
        """Return the response at points to fields at the same points, in single precision."""
        # Transforms of a window twice as wide as the points have the response at their differences.
        part, places = self.work.window(points)
        work, factors = self.work.fields(part, single=True), self._in_window(part)

        def response(x: NDArray[Any]) -> NDArray[Any]:
            for field, values in zip(work.points, x, strict=False):
                field.fill(0.0)
                field[places] = values
            return np.array([field[places] for field in work.respond(factors, [True] * len(x))])

        return response

    def on_line(self, points: NDArray[Any]) -> LineWindow:
        """Return what `respond_on_line` needs for the response at points of a line to fields there."""
        part, places = self.work.window(points)
        work = self.work.fields(part, single=True)
        (p, t), (of_p, of_t) = work.points, work.waves
        normal, coupling, along = self._in_window(part)
        return LineWindow(work.plan.plans, p, t, of_p, of_t, normal, coupling, along, places)

    def spend_on_line(self, points: NDArray[Any], times: int) -> None:
        """Count the FFT pairs of such responses."""
        part, _ = self.work.window(points)
        self.work.fields(part, single=True).spend(2.0 * times)

    def kernel(self, number: int) -> FloatArray:
        """Return the response to a load on the first point, of a component of `factors`; not counted."""
        work, before = self.work.fields(single=False), self.work.spent.pairs
        work.waves[0][:] = self._double[number]
        work.transform_back(0)
        self.work.spent.pairs = before
        return np.array(work.points[0])

    @property
    def windows(self) -> list[int]:
        """Parts of the windows whose kernels are known."""
        return [part for part in self._single if part > 1]

    def shear_of(self, pressure: ComplexArray) -> FloatArray:
        """Return u_x[, u_y] under a pressure with this unnormalised transform."""
        work, shear = self.work.fields(single=False), np.zeros((self.axes, self.size))
        for axis in range(self.axes if self._response.couples else 0):
            work.waves[axis][:] = 1j * self._double[1 + axis] * pressure
            work.transform_back(axis)
            shear[axis] = work.points[axis]
        return shear

    def _in_window(self, part: int) -> tuple[NDArray[Any], ...]:
        """Return the factors on transforms of a window: of the kernel of the surface near its centre."""
        if part not in self._single:
            work, window = self.work.fields(single=False), self.work.fields(part, single=True)
            shape = self.work.shape
            near = [np.fft.fftfreq(n // part, part / n).round().astype(int) for n in shape]
            odd = range(1, 1 + (0 if self.rolls else self.axes))
            factors, before = [], self.work.spent.pairs
            for number, factor in enumerate(self._double):
                made = np.zeros(window.waves[0].size, dtype=self._kind)
                if factor.any():
                    work.waves[0][:] = factor * (-1j if number in odd else 1.0)
                    work.transform_back(0)
                    kernel_there = work.points[0].reshape(shape)[np.ix_(*near)]
                    window.points[0][:] = kernel_there.ravel()
                    window.transform(0)
                    spectrum = window.waves[0]
                    if not self.rolls:
                        spectrum = -spectrum.imag if number in odd else spectrum.real
                    made = spectrum / window.plan.size
                factors.append(np.ascontiguousarray(made, dtype=self._kind))
            self._single[part] = tuple(factors)
            if part in self._counted:
                self.work.spent.pairs = before
        return self._single[part]


class LineWindow(NamedTuple):
    """The transforms of a window of a line, in single precision, and a response there."""

    plans: Plans
    p: Any
    t: Any
    of_p: Any  # transforms
    of_t: Any
    normal: Any  # factors on them
    coupling: Any
    along: Any
    places: NDArray[Any]  # of the points


@kernel(reorder=True, inner=True)
def respond_on_line(window: LineWindow, fields: Any) -> None:
    """Replace pressure and shear at the points by the displacements under them."""
    p, t, places, none = window.p, window.t, window.places, np.float32(0.0)
    p[:], t[:] = none, none
    for i in range(places.size):
        p[places[i]], t[places[i]] = fields[0, i], fields[1, i]
    forward(window.plans, p, window.of_p)
    forward(window.plans, t, window.of_t)
    _line(window.normal, window.coupling, window.along, window.of_p, window.of_t)
    backward(window.plans, window.of_p, p)
    backward(window.plans, window.of_t, t)
    for i in range(places.size):
        fields[0, i], fields[1, i] = p[places[i]], t[places[i]]


@kernel(reorder=True)
def _line(a: Any, c: Any, b: Any, p: Any, t: Any) -> None:
    """Replace the transforms of p and t by those of W and u."""
    for k in range(p.size):
        pr, pi, tr, ti, couple = p[k].real, p[k].imag, t[k].real, t[k].imag, c[k]
        p[k] = complex(a[k] * pr + couple * ti, a[k] * pi - couple * tr)
        t[k] = complex(b[k] * tr - couple * pi, b[k] * ti + couple * pr)


@kernel(reorder=True)
def _surface(a: Any, cx: Any, cy: Any, xx: Any, xy: Any, yy: Any, p: Any, tx: Any, ty: Any) -> None:
    """Replace the transforms of p, t_x and t_y by those of W, u_x and u_y."""
    for k in range(p.size):
        pr, pi = p[k].real, p[k].imag
        xr, xi, yr, yi = tx[k].real, tx[k].imag, ty[k].real, ty[k].imag
        p[k] = complex(a[k] * pr + cx[k] * xi + cy[k] * yi, a[k] * pi - cx[k] * xr - cy[k] * yr)
        tx[k] = complex(xx[k] * xr + xy[k] * yr - cx[k] * pi, xx[k] * xi + xy[k] * yi + cx[k] * pr)
        ty[k] = complex(xy[k] * xr + yy[k] * yr - cy[k] * pi, xy[k] * xi + yy[k] * yi + cy[k] * pr)


@kernel(reorder=True)
def _rolling_line(a: Any, b: Any, c: Any, d: Any, p: Any, t: Any) -> None:
    """Replace the transforms of p and t by those of W and slip."""
    for k in range(p.size):
        of_p, of_t = p[k], t[k]
        p[k], t[k] = a[k] * of_p + b[k] * of_t, c[k] * of_p + d[k] * of_t


@kernel(reorder=True)
def _rolling_surface(
    a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any, i: Any, p: Any, tx: Any, ty: Any
) -> None:
    """Replace the transforms of p, t_x and t_y by those of W and slip."""
    for k in range(p.size):
        of_p, of_x, of_y = p[k], tx[k], ty[k]
        p[k] = a[k] * of_p + b[k] * of_x + c[k] * of_y
        tx[k] = d[k] * of_p + e[k] * of_x + f[k] * of_y
        ty[k] = g[k] * of_p + h[k] * of_x + i[k] * of_y
