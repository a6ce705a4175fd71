"""Self-affine rough surfaces by random phases.

The height is a sum of waves whose power falls with the wavenumber like

    C(q) ~ q^(-2 (H + D/2)),      D = 1, 2 directions,      H the Hurst exponent

between the wavenumbers of the roll-off and of the short cut-off; it is constant from the long cut-off to the
roll-off and zero elsewhere (Persson et al., J. Phys.: Condens. Matter 17 (2005) R1, sec. 2).  Each wave has
the amplitude of the spectrum and a phase of its own, and the sum is scaled to the given rms slope or height,
exactly.

The phase of a wave follows from the seed and from the number of its periods in the cell. Neither phase nor
amplitude depends on the grid: grids that resolve the short cut-off sample one and the same surface.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from gfmdlayer.punch.shape import Cell, Shape
from gfmdlayer.validation.fields import MustBe, Optional, Positive, Seed, strict
from gfmdlayer.validation.problems import Mistake

if TYPE_CHECKING:
    from gfmdlayer.arrays import ComplexArray, FloatArray
    from gfmdlayer.grid.grid import Grid

Hurst = Annotated[float, strict, Field(gt=0, le=1), MustBe("a number > 0 and <= 1")]


class SelfAffine(Shape):
    """Rough surface by random phases; cut-offs and roll-off are wavelengths.

    One of rms_slope and rms_height is given: the square root of the mean of grad h . grad h, or of
    (h - mean(h))^2.

    Examples
    --------
    >>> punch = gfmdlayer.SelfAffine(hurst=0.8, rms_slope=0.1, short_cutoff=0.05, seed=1)
    >>> found = gfmdlayer.solve(gfmdlayer.halfspace(1.0), punch, mean_pressure=0.01, points=256)
    >>> bool(0 < found.contact_area < 1)
    True
    """

    rough: ClassVar[bool] = True

    shape: Literal["self_affine"] = "self_affine"
    """a rough surface of random phases"""
    hurst: Hurst
    """Hurst exponent H: the power falls as q^(-2 (H + 1))"""
    short_cutoff: Positive
    """shortest wavelength, longer than two grid spacings: length"""
    seed: Seed
    """of the phases: the same surface on any grid"""
    roll_off: Optional = None
    """wavelength above which the spectrum is flat; none without it: length"""
    long_cutoff: Optional = None
    """longest wavelength; by default the longest that fits: length"""
    rms_slope: Optional = None
    """root-mean-square slope; this or rms_height"""
    rms_height: Optional = None
    """root-mean-square height; this or rms_slope: length"""

    def heights(self, grid: Grid) -> FloatArray:
        """Heights above the lowest point; TableError if no wave of the cell is between the cut-offs."""
        import numpy as np

        from gfmdlayer.files.tables import TableError

        q, longest = grid.wavenumbers, self.long_cutoff or np.inf
        slack = 1 + 1e-9  # a cut-off that is a wave of the cell includes it
        inside = (q > 0) & (q <= 2 * np.pi / self.short_cutoff * slack) & (q >= 2 * np.pi / longest / slack)
        if not grid.ranks.maximum(int(inside.any())):
            raise TableError("no wave of the cell lies between long_cutoff and short_cutoff")
        plateau = 2 * np.pi / min(self.roll_off or np.inf, longest)
        falling = np.maximum(q[inside], plateau) if plateau > 0 else q[inside]
        amplitude = np.zeros_like(q)
        amplitude[inside] = falling ** -(self.hurst + len(grid.shape) / 2)
        twice = np.full(q.shape[-1], 2.0)  # waves of the half spectrum that stand for two
        twice[0] = 1.0 if grid.ranks.first else 2.0
        power = amplitude**2 * twice * (1.0 if self.rms_slope is None else q**2)
        rms = np.sqrt(grid.ranks.total(float(power.sum())))
        amplitude *= (self.rms_slope or self.rms_height) / rms * grid.size
        heights = grid.from_waves(amplitude * _phases(grid, self.seed))
        return np.asarray(heights - grid.ranks.minimum(float(heights.min())))

    def problems(self) -> Iterator[Mistake]:
        """Refuse a surface of no size, or of two."""
        one_rms = "one of rms_slope and rms_height must be given"
        if self.rms_slope is None and self.rms_height is None:
            yield Mistake(("rms_slope",), f"missing; {one_rms}", ("shape",))
        if self.rms_slope is not None and self.rms_height is not None:
            yield Mistake(("rms_height",), f"given beside rms_slope; {one_rms}", ("rms_slope",))

    def misfits(self, cell: Cell) -> Iterator[Mistake]:
        """Refuse waves that the grid does not resolve, that the cell does not hold, or in another order."""
        spacing = max(length / n for length, n in zip(cell.period, cell.points, strict=False))
        if self.short_cutoff <= 2 * spacing:
            message = f"got {self.short_cutoff!r}; must be > {2 * spacing!r}, two spacings of the grid"
            yield Mistake(("short_cutoff",), message)
        below, shortest = "short_cutoff", self.short_cutoff
        for key, value in (("roll_off", self.roll_off), ("long_cutoff", self.long_cutoff)):
            if value is not None:
                if value < shortest:
                    message = f"got {value!r}, below {below} = {shortest!r}; must be a longer wave"
                    yield Mistake((key,), message, (below,))
                below, shortest = key, value
        if shortest > max(cell.period):
            message = f"got {shortest!r}; must be <= the period, {max(cell.period)!r}"
            yield Mistake((below,), message)


def _phases(grid: Grid, seed: int) -> ComplexArray:
    """Factors exp(i phi) of the modes; those of q and -q belong together."""
    # Along the last of two axes each number of waves has a generator of its own, which gives the phases for
    # 0, 1, -1, 2, -2 ... waves along the first.
    import numpy as np

    if len(grid.shape) == 1:
        return np.asarray(np.exp(2j * np.pi * np.random.default_rng(seed).random(grid.spectral_shape[-1])))
    waves = np.rint(np.fft.fftfreq(grid.points[0], 1 / grid.points[0])).astype(int)
    order = 2 * np.abs(waves) - (waves > 0)
    phases = np.empty(grid.spectral_shape, dtype=np.complex128)
    for k, j in enumerate(grid.waves_y):
        turns = np.random.default_rng((seed, j)).random(grid.points[0] + 1)[order]
        phases[:, k] = np.exp(2j * np.pi * turns)
    if grid.ranks.first:
        phases[waves < 0, 0] = phases[-waves[waves < 0], 0].conj()
    return phases
