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

import numpy as np
import scipy.fft

from gfmdlayer.arrays import ComplexArray, FloatArray
from gfmdlayer.files.tables import TableError
from gfmdlayer.grid.grid import Grid


def random_surface(
    grid: Grid,
    *,
    hurst: float,
    short_cutoff: float,
    seed: int,
    roll_off: float | None = None,
    long_cutoff: float | None = None,
    rms_slope: float | None = None,
    rms_height: float | None = None,
) -> FloatArray:
    """Return the heights of a self-affine surface above its lowest point, of the grid's shape.

    The parameters, all lengths, are the keys of `gfmdlayer.punch.self_affine.SelfAffine`.

    Raises
    ------
    TableError
        If no wave of the cell lies between the cut-offs.
    """
    q = grid.wavenumbers
    longest = np.inf if long_cutoff is None else long_cutoff
    slack = 1 + 1e-9  # a cut-off that is a wave of the cell includes it
    inside = (q > 0) & (q <= 2 * np.pi / short_cutoff * slack) & (q >= 2 * np.pi / longest / slack)
    if not inside.any():
        raise TableError("no wave of the cell lies between long_cutoff and short_cutoff")
    plateau = 2 * np.pi / min(roll_off or np.inf, longest)
    falling = np.maximum(q[inside], plateau) if plateau > 0 else q[inside]
    amplitude = np.zeros_like(q)
    amplitude[inside] = falling ** -(hurst + len(grid.shape) / 2)
    twice = np.full(q.shape[-1], 2.0)  # waves of the half spectrum that stand for two
    twice[0] = 1.0
    power = amplitude**2 * twice * (1.0 if rms_slope is None else q**2)
    amplitude *= (rms_height if rms_slope is None else rms_slope) / np.sqrt(power.sum()) * grid.size
    spectrum = amplitude * _phases(grid, seed)
    heights = scipy.fft.irfftn(spectrum, s=grid.shape, overwrite_x=True)
    return np.asarray(heights - heights.min())


def _phases(grid: Grid, seed: int) -> ComplexArray:
    """Factors exp(i phi) of the modes; those of q and -q belong together.

    Along the last of two axes each number of waves has a generator of its own, which gives the phases for 0,
    1, -1, 2, -2 ... waves along the first.
    """
    last = grid.spectral_shape[-1]
    if len(grid.shape) == 1:
        return _factors(np.random.default_rng(seed).random(last))
    waves = np.rint(np.fft.fftfreq(grid.points[0], 1 / grid.points[0])).astype(int)
    order = 2 * np.abs(waves) - (waves > 0)
    found = np.empty(grid.spectral_shape, dtype=np.complex128)
    for j in range(last):
        found[:, j] = _factors(np.random.default_rng((seed, j)).random(grid.points[0] + 1)[order])
    found[waves < 0, 0] = found[-waves[waves < 0], 0].conj()
    return found


def _factors(turns: FloatArray) -> ComplexArray:
    return np.asarray(np.exp(2j * np.pi * turns))
