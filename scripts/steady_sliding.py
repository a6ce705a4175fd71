"""A parabola that slides or rolls steadily over a viscoelastic halfspace: by time steps and directly.

In the frame of the punch the steady state is a problem without time: pressure and displacement are related by
the stiffness K(q, -i q v) of each wave, and

    p >= 0,   gap = h - depth + C p >= 0,   p gap = 0

with the circulant matrix C of 1/K. C is not symmetric, so there is no energy to minimise. This script
computes the dense C from the complex modulus of the halfspace. Block principal pivoting (J. J. Judice, F. M.
Pires, Comput. Oper. Res. 21 (1994) 587-596) solves the complementarity problem: it solves the linear
equations of a guessed contact set, and points that contradict the guess change sides. The direct solution
uses none of the package's modes, time steps and contact solvers.

    python scripts/steady_sliding.py
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.results.recording import Recording
from gfmdlayer.verification.runs import run

Floats = NDArray[np.float64]

RADIUS, G0, GINF, TAU = 0.25, 1.0, 10.0, 1.0  # of punch and halfspace; nu = 1/2, period 1
_MOST_ROUNDS, _PATIENCE = 1000, 10


def compliance(points: int, velocity: float) -> Floats:
    """Matrix C of displacement by pressure at a velocity, in the mean zero, shape (points, points)."""
    q = 2 * np.pi * np.fft.fftfreq(points, 1 / points)
    cycles = -1j * q * velocity * TAU
    stiffness = 2 * np.abs(q) * (G0 + (GINF - G0) * cycles / (1 + cycles))
    inverse = np.divide(1.0, stiffness, where=q != 0, out=np.zeros(points, dtype=complex))
    if points % 2 == 0:
        # Two waves, which travel either way, look the same here: their stiffnesses are conjugate.
        inverse[points // 2] = 1 / stiffness[points // 2].real
    column = np.fft.ifft(inverse).real
    return np.asarray(column[np.subtract.outer(np.arange(points), np.arange(points)) % points])


def steady_pressure(C: Floats, gap: Floats) -> Floats:
    """Pressure p >= 0 with gap + C p >= 0, zero where there is pressure; ArithmeticError if none is found."""
    contact, fewest, patience = gap < 0, gap.size + 1, _PATIENCE
    for _ in range(_MOST_ROUNDS):
        pressure = np.zeros(gap.size)
        pressure[contact] = np.linalg.solve(C[np.ix_(contact, contact)], -gap[contact])
        opening = gap + C @ pressure
        wrong = np.where(contact, pressure < 0, opening < -1e-14 * np.ptp(gap))
        if not wrong.any():
            return pressure
        patience = patience - 1 if wrong.sum() >= fewest else _PATIENCE
        fewest = min(fewest, int(wrong.sum()))
        if patience < 0:  # one at a time, which ends for any positive definite C
            wrong[: np.flatnonzero(wrong)[-1]] = False
        contact ^= wrong
    raise ArithmeticError("the steady contact was not found")


def stepped(points: int, velocity: float, control: str, amount: float, **time: object) -> Recording:
    """Run the package from rest to the steady state."""
    values = {
        "grid.points": points,
        "layer": {"thickness": float("inf"), "material": {"G0": G0, "Ginf": GINF, "tau": TAU}},
        "punch": {"shape": "parabola", "radius": RADIUS},
        "trajectory": {"control": control, control: amount, "ramp_time": TAU, "velocity": velocity},
        "time": {"end": 1e4 * TAU, "step": "adaptive", "steady": 1e-8} | time,
        "solver": {"method": "active_set", "tolerance": 1e-9},
    }
    return run(values)


def direct(points: int, velocity: float, depth: float) -> dict[str, float | Floats]:
    """Solve for the steady state at a depth."""
    x = np.arange(points) / points - 0.5
    h = x**2 / (2 * RADIUS)
    pressure = steady_pressure(compliance(points, velocity), h - depth)
    u = compliance(points, velocity) @ -pressure
    q = 2 * np.pi * np.fft.fftfreq(points, 1 / points) * (np.arange(points) != points / 2)
    slope = np.fft.ifft(1j * q * np.fft.fft(u)).real
    touching = np.flatnonzero(pressure > 0)
    return {
        "pressure": pressure,
        "mean": float(pressure.mean()),
        "force": float(np.mean(pressure * slope)),
        "edges": x[touching[[0, -1]]],
    }


def main() -> None:
    """Print both solutions for velocities around the maximum of the friction."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--points", type=int, default=512)
    options.add_argument("--depth", type=float, default=0.01)
    given = options.parse_args()
    print(f"n = {given.points}, depth = {given.depth} L; differences relative to the direct solution")
    print("v tau/L   friction    mean pressure  tangential  pressure(x)  contact edges (direct, stepped)")
    for velocity in (0.001, 0.01, 0.1, 1.0, 10.0):
        answer = direct(given.points, velocity, given.depth)
        found = stepped(given.points, velocity, "depth", given.depth)
        p, mean = found.fields["pressure"][-1], answer["mean"]
        touching = np.flatnonzero(p > 0)[[0, -1]] / given.points - 0.5
        print(
            f"{velocity:<9g} {answer['force'] / mean:<11.6g} {p.mean() / mean - 1:<14.1e} "
            f"{found.last('tangential_force') / answer['force'] - 1:<11.1e} "
            f"{np.abs(p - answer['pressure']).max() / p.max():<12.1e} {answer['edges']} {touching}"
        )


if __name__ == "__main__":
    main()
