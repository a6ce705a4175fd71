"""Names in result files: coordinates, fields and swept parameters, their meaning, units and type.

Units are those of the config that was run. In the paper's convention lengths are in L, moduli in G0 and times
in tau, so a file says "length", "pressure" or "time" where a unit is wanted, products of these such as
"pressure length" for an energy per area, and "1" for dimensionless quantities.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


class ResultsError(OSError):
    """A results file or folder that cannot be written or read; the message names it and says why."""


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turn an OSError of the block into a ResultsError that names the file."""
    try:
        yield
    except ResultsError:
        raise
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written: {error.strerror or error}") from error


@dataclass(frozen=True)
class Variable:
    """Meaning, units and numpy type of a coordinate or field; columns of rows are declared by observables."""

    long_name: str
    units: str = "1"
    dtype: str = "f8"


@dataclass(frozen=True)
class Parameter:
    """Meaning of one config key that may be swept: its name, symbol in plain text, units."""

    long_name: str
    symbol: str
    units: str = "1"


VARIABLES: dict[str, Variable] = {
    "x": Variable("position along x", "length"),
    "y": Variable("position along y", "length"),
    "snapshot": Variable("time of the snapshot", "time"),
    "displacement": Variable("normal displacement of the surface, positive upward", "length"),
    "pressure": Variable("contact pressure, positive in compression", "pressure"),
    "gap": Variable("gap between surface and punch, zero in contact", "length"),
    "case": Variable("number of the case, that of its file in cases/", "1", "i8"),
}

FIELDS = ("displacement", "pressure", "gap")

PARAMETERS: dict[str, Parameter] = {
    "layer.thickness": Parameter("thickness of the layer", "d", "length"),
    "layer.poisson": Parameter("Poisson's ratio of the layer", "nu"),
    "layer.material.G0": Parameter("relaxed modulus of the layer", "G_0", "pressure"),
    "layer.material.Ginf": Parameter("glassy modulus of the layer", "G_inf", "pressure"),
    "layer.material.tau": Parameter("relaxation time of the layer", "tau", "time"),
    "halfspace.shear_modulus": Parameter("shear modulus of the halfspace", "G_bulk", "pressure"),
    "halfspace.poisson": Parameter("Poisson's ratio of the halfspace", "nu_bulk"),
    "punch.radius": Parameter("radius of the punch", "R", "length"),
    "punch.hurst": Parameter("Hurst exponent of the punch", "H"),
    "punch.rms_slope": Parameter("rms slope of the punch", "g'"),
    "punch.rms_height": Parameter("rms height of the punch", "h_rms", "length"),
    "punch.short_cutoff": Parameter("shortest wave of the punch", "lambda_s", "length"),
    "punch.roll_off": Parameter("roll-off wavelength of the punch", "lambda_r", "length"),
    "trajectory.depth": Parameter("depth of the indentation", "h_0", "length"),
    "trajectory.load": Parameter("mean pressure on the punch", "p_0", "pressure"),
    "trajectory.velocity": Parameter("velocity of the punch along x", "v", "length / time"),
    "trajectory.ramp_time": Parameter("duration of the ramp", "t_0", "time"),
    "time.step": Parameter("time step", "dt", "time"),
    "grid.points": Parameter("grid points", "n"),
    "grid.period": Parameter("period of the surface", "L", "length"),
}
