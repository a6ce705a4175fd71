"""The names in result files: what each variable means, its units and its type.

Units are those of the config that was run. In the paper's convention lengths are in L, moduli in G0 and times
in tau, so a file says "length", "pressure" or "time" where a unit is wanted, products of these such as
"pressure length" for an energy per area, and "1" for dimensionless quantities.
"""

from __future__ import annotations

from dataclasses import dataclass


class ResultsError(OSError):
    """A results file or folder that cannot be written or read; the message names it and says why."""


@dataclass(frozen=True)
class Variable:
    """Meaning, units and numpy type of one variable of a result file.

    A column of rows has one number a row, or one for each place along the dimension `along`.
    """

    long_name: str
    units: str = "1"
    dtype: str = "f8"
    along: str | None = None


@dataclass(frozen=True)
class Parameter:
    """Meaning of one config key that may be swept: its name, symbol in plain text and in mathtext, units."""

    long_name: str
    symbol: str
    mathtext: str
    units: str = "1"


VARIABLES: dict[str, Variable] = {
    "time": Variable("time", "time"),
    "x": Variable("position along x", "length"),
    "y": Variable("position along y", "length"),
    "snapshot": Variable("time of the snapshot", "time"),
    "contact_area": Variable("relative contact area atilde, contact points / all points"),
    "mean_pressure": Variable("mean contact pressure ptilde = pbar / (2 G0)"),
    "depth": Variable("indentation depth of the punch", "length"),
    "position": Variable("position of the punch along x", "length"),
    "tangential_force": Variable("mean tangential stress against the motion along x", "pressure"),
    "friction": Variable("tangential force / normal force"),
    "contact_centre": Variable("centre of pressure along x, from the middle of the punch", "length"),
    "displacement": Variable("normal displacement of the surface, positive upward", "length"),
    "pressure": Variable("contact pressure, positive in compression", "pressure"),
    "gap": Variable("gap between surface and punch, zero in contact", "length"),
    "mean_gap": Variable("mean gap between surface and punch", "length"),
    "patches": Variable("number of connected patches of contact", "1", "i8"),
    "pressure_bin": Variable("lower end of the bin of pressure", "pressure"),
    "pressure_bin_end": Variable("upper end of the bin of pressure", "pressure", along="pressure_bin"),
    "pressure_histogram": Variable(
        "part of the surface in contact with a pressure in the bin; the sum is the contact area",
        along="pressure_bin",
    ),
    "gap_bin": Variable("lower end of the bin of the gap", "length"),
    "gap_bin_end": Variable("upper end of the bin of the gap", "length", along="gap_bin"),
    "gap_histogram": Variable(
        "part of the surface out of contact with a gap in the bin; the sum is 1 - contact area",
        along="gap_bin",
    ),
    "transforms": Variable("pairs of Fourier transforms spent on the step, XX", "1", "i8"),
    "iterations": Variable("iterations of the contact solver in the step", "1", "i8"),
    "residual": Variable("residual of the contact problem when the step was accepted"),
    "rejected": Variable("attempts at the step that were rejected", "1", "i8"),
    "work": Variable("work done by the punch per area", "pressure length"),
    "stored": Variable("elastic energy stored per area", "pressure length"),
    "dissipated": Variable("energy dissipated per area", "pressure length"),
    "energy_residual": Variable("work - stored - dissipated, per area", "pressure length"),
    "case": Variable("number of the case, that of its file in cases/", "1", "i8"),
}

PARAMETERS: dict[str, Parameter] = {
    "layer.thickness": Parameter("thickness of the layer", "d", "d", "length"),
    "layer.poisson": Parameter("Poisson's ratio of the layer", "nu", r"\nu"),
    "layer.material.G0": Parameter("relaxed modulus of the layer", "G_0", "G_0", "pressure"),
    "layer.material.Ginf": Parameter("glassy modulus of the layer", "G_inf", r"G_\infty", "pressure"),
    "layer.material.tau": Parameter("relaxation time of the layer", "tau", r"\tau", "time"),
    "halfspace.shear_modulus": Parameter(
        "shear modulus of the halfspace", "G_bulk", r"G_\mathrm{bulk}", "pressure"
    ),
    "halfspace.poisson": Parameter("Poisson's ratio of the halfspace", "nu_bulk", r"\nu_\mathrm{bulk}"),
    "punch.radius": Parameter("radius of the punch", "R", "R", "length"),
    "punch.hurst": Parameter("Hurst exponent of the punch", "H", "H"),
    "punch.rms_slope": Parameter("rms slope of the punch", "g'", "g'"),
    "punch.rms_height": Parameter("rms height of the punch", "h_rms", r"h_\mathrm{rms}", "length"),
    "punch.short_cutoff": Parameter("shortest wave of the punch", "lambda_s", r"\lambda_s", "length"),
    "punch.roll_off": Parameter("roll-off wavelength of the punch", "lambda_r", r"\lambda_r", "length"),
    "trajectory.depth": Parameter("depth of the indentation", "h_0", "h_0", "length"),
    "trajectory.load": Parameter("mean pressure on the punch", "p_0", "p_0", "pressure"),
    "trajectory.velocity": Parameter("velocity of the punch along x", "v", "v", "length / time"),
    "trajectory.ramp_time": Parameter("duration of the ramp", "t_0", "t_0", "time"),
    "time.step": Parameter("time step", "dt", r"\Delta t", "time"),
    "grid.points": Parameter("grid points", "n", "n"),
    "grid.period": Parameter("period of the surface", "L", "L", "length"),
}


def variable(name: str) -> Variable:
    """Look up a variable of the result files.

    Raises
    ------
    KeyError
        If the table has no such name.
    """
    if name not in VARIABLES:
        raise KeyError(f"results have no variable {name!r}; known: {', '.join(sorted(VARIABLES))}")
    return VARIABLES[name]
