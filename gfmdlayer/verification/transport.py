"""Leakage through gaps, conductance and stiffness of contact spots, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import BoolArray
from gfmdlayer.body.layers import bonded_layer, halfspace
from gfmdlayer.body.materials import Zener
from gfmdlayer.grid.grid import Grid
from gfmdlayer.interactive.solve import solve
from gfmdlayer.punch.self_affine import SelfAffine
from gfmdlayer.punch.simple_shapes import Parabola
from gfmdlayer.transport.leakage import flow_through
from gfmdlayer.transport.percolation import throats
from gfmdlayer.transport.spots import Spots, impedance, inverse
from gfmdlayer.verification.rows import Convergence, Row

_MADELUNG, _THIRD = 3.90026492, 9.0336217  # lattice sums over a square cell, of 1/r and 1/r^3
_INSIDE, _STRIP = 0.13, 0.19  # spacings from the outline of the points to the edge, of a disc and a strip
_SCATTER = 0.05  # spacings by which this varies with the place of a disc's outline between the points


def leakage(quick: bool) -> Iterator[Row | Convergence]:
    """Flow between plates, across and along ridges, through a checkerboard, and none through a closed cell.

    Ridges 1 + e cos: across (1 - e^2)^(5/2)/(1 + e^2/2), along 1 + 3 e^2/2. The harmonic mean is the
    trapezoidal rule for the integral of g^-3, which converges geometrically, the linear mean is of second
    order. A checkerboard conducts the geometric mean; the pressure at its corners is singular, r^0.5 or less,
    so that the error is of an order below one: 8 % at 128 points. The rest is rounding.
    """
    e, n = 0.7, 64 if quick else 128
    x = np.arange(n) / n
    ridges = np.repeat(1 + e * np.cos(2 * np.pi * x)[:, None], n, axis=1)
    across, along = (1 - e**2) ** 2.5 / (1 + e**2 / 2), 1 + 1.5 * e**2
    K = flow_through(ridges, (1.0, 1.0)).tensor
    yield Row(
        "K between plates", 0.027, flow_through(np.full((n, n), 0.3), (1, 1)).tensor[0, 0], 1e-12, "h^3"
    )
    yield Row(f"K across ridges, n = {n}", across, K[0, 0], 1e-11, "1/mean(g^-3)")
    yield Row(f"K along ridges, n = {n}", along, K[1, 1], 1e-11, "mean(g^3)")
    points, errors = (32, 64, 128), []
    for m in points:
        gap = np.repeat(1 + e * np.cos(2 * np.pi * np.arange(m) / m)[:, None], 8, axis=1)
        errors.append(abs(flow_through(gap, (1.0, 1.0), "linear").tensor[0, 0] / across - 1))
    curve = Convergence("points", "flow by the linear mean", tuple(map(float, points)), tuple(errors), -2.0)
    yield curve
    yield curve.row(0.1, "second order")
    fields = np.where((np.arange(n)[:, None] * 2 // n + np.arange(n) * 2 // n) % 2, 1.0, 0.4)
    board = flow_through(fields, (1.0, 1.0)).tensor[0, 0] / 0.4**1.5 - 1
    yield Row(f"K of a checkerboard, n = {n}", 0.0, board, 0.08 * (128 / n) ** 0.5, "geometric mean")
    punch = SelfAffine(hurst=0.8, roll_off=0.25, short_cutoff=0.04, rms_slope=0.1, seed=1)
    rough = solve(halfspace(1.0), punch, mean_pressure=0.03, points=(128, 128)).gap.to_numpy()
    flow = flow_through(rough, (1.0, 1.0))
    yield Row("balance of mass, rough contact", 0.0, float(flow.imbalance.max()), 1e-9, "conservation")
    tiled = flow_through(np.tile(rough, (1, 2)), (1.0, 2.0)).tensor
    yield Row("K of two tiles over one", 1.0, tiled[0, 0] / flow.tensor[0, 0], 1e-8, "periodicity")
    closed = solve(halfspace(1.0), punch, mean_pressure=0.2, points=(128, 128)).gap.to_numpy()
    flow_left = float(np.abs(flow_through(closed, (1.0, 1.0)).tensor).max())
    yield Row("K where contact closes the cell", 0.0, flow_left, 0.0, "no path")


def closing(quick: bool) -> Iterator[Row]:
    """Contact area at which the last path closes, over surfaces and both directions.

    Published for isotropic surfaces: 0.42 (Dapp et al., Phys. Rev. Lett. 108 (2012) 244301). One surface
    with four waves of the roll-off in the cell scatters by 0.03; the mean of m of them by 0.03/m^0.5, and the
    bracket of the pressure adds 0.01.
    """
    seeds, n = ((1, 2), 128) if quick else ((1, 2, 3, 4, 5), 256)
    areas = []
    for seed in seeds:
        punch = SelfAffine(hurst=0.8, roll_off=0.25, short_cutoff=0.04, rms_slope=0.1, seed=seed)
        for axis in (0, 1):
            low, high, area = 0.05, 0.14, math.nan
            while high / low > 1.03:
                middle = math.sqrt(low * high)
                contact = solve(halfspace(1.0), punch, mean_pressure=middle, points=(n, n))
                is_open = throats(contact.gap.to_numpy(), (1.0, 1.0))[axis].gap > 0
                low, high, area = (
                    (middle, high, area) if is_open else (low, middle, float(contact.contact_area))
                )
            areas.append(area)
    bound = 3 * 0.03 / math.sqrt(len(areas)) + 0.01
    yield Row(f"closing contact area, n = {n}", 0.42, float(np.mean(areas)), bound, "Dapp et al. (2012)")


def conductance(quick: bool) -> Iterator[Row]:
    """Resistance of a disc and of a strip in a periodic cell, and the stiffness of Hertz's contact.

    Disc: 1/(4 a) - 3.90026/(2 pi L) + 9.03362 a^2/(6 pi L^3) (Holm, with images); strip:
    ln(1/sin(pi b/L))/pi per length. The outline of a disc's points lies 0.13 spacings outside its edge,
    within 0.05 of one; of a strip 0.19, within 0.01. Hertz: dF/d(depth) = 2 E* a with the same images.
    """
    n, a = (128, 0.1) if quick else (512, 0.05)
    resistance = 1 / _total(_disc(n, a))
    radius = math.sqrt(float(_disc(n, a).mean()) / math.pi) - _INSIDE / n
    off = _SCATTER / (n * radius) * resistance
    yield Row(f"resistance of a disc, n = {n}", _one_disc(radius), resistance, off, "Holm, with images")
    m, b = 1024, 0.1
    contact = np.abs((np.arange(m) + 0.5) / m - 0.5) < b
    line = Spots(impedance(Grid((m,), (1.0,)).wavenumbers, [], 1.0), 1 / m, 1e-14).total(contact)
    edge = float(contact.mean()) / 2 - _STRIP / m
    theory = -math.log(math.sin(math.pi * edge)) / math.pi
    yield Row(f"resistance of a strip, n = {m}", theory, 1 / line, 0.01 / m / edge, "conformal map")
    n = 128 if quick else 256
    hertz = solve(halfspace(1.0), Parabola(radius=8.0), force=0.0032, points=(n, n), tolerance=1e-9)
    contact = hertz.contact.to_numpy()
    radius = math.sqrt(float(contact.mean()) / math.pi) - _INSIDE / n
    theory = 2 / _one_disc(radius)
    stiffness = 2 * _total(contact)
    yield Row(f"dF/d(depth) of Hertz, n = {n}", theory, stiffness, _SCATTER / (n * radius) * theory, "2 E* a")


def stiffness(_quick: bool) -> Iterator[Row]:
    """Dynamic stiffness of a frozen contact.

    Of one material it is proportional to G*(omega), on an elastic base not. There it is compared with
    elimination of the same equations. Bounds: the tolerance of the sum, 1e-20, times the condition of the
    preconditioned problem, below 1e3, and of the unpreconditioned one for elimination, below 1e6 roundings.
    """
    material, contact, grid = Zener(), _disc(32, 0.2), Grid((32, 32), (1.0, 1.0))
    ratio = complex(material.laplace(2j) / material.laplace(0.0))
    bonded = bonded_layer(0.1, material)
    relaxed, moving = (_total(contact, inverse(bonded.stiffness(grid.waves, s))) for s in (0.0, 2j))
    yield Row("|K*/K| of one material", abs(ratio), abs(moving / relaxed), 1e-9, "G*(omega)/G(0)")
    Z = inverse(bonded_layer(0.1, material, halfspace=3.0).stiffness(grid.waves, 2j))
    units = np.eye(contact.size)[contact.ravel()].reshape(-1, 32, 32)
    dense = sum(
        factor * np.fft.irfft2(part * np.fft.rfft2(units), (32, 32))[:, contact]
        for factor, part in ((1, Z.real), (1j, Z.imag))
    )
    exact = complex(np.linalg.solve(dense, np.ones(len(units))).sum()) / contact.size
    yield Row("K* on an elastic base", 0.0, abs(_total(contact, Z) / exact - 1), 1e-9, "elimination")


def _disc(n: int, radius: float) -> BoolArray:
    x = (np.arange(n) + 0.5) / n - 0.5
    return np.asarray(x[:, None] ** 2 + x**2 < radius**2)


def _one_disc(a: float) -> float:
    """Resistance of a disc in a square cell of length 1, for a conductivity of 1."""
    return 1 / (4 * a) - _MADELUNG / (2 * math.pi) + _THIRD * a**2 / (6 * math.pi)


def _total(contact: BoolArray, Z: NDArray[Any] | None = None) -> Any:
    n = len(contact)
    Z = impedance(Grid((n, n), (1.0, 1.0)).wavenumbers, [], 1.0) if Z is None else Z
    return Spots(Z, n**-2.0, 1e-20).total(contact)
