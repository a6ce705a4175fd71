"""Names in result files: coordinates, fields and swept parameters, their meaning, units and type.

Units are those of the config that was run, by name where it names them (`config.units`). In the paper's
convention lengths are in L, moduli in G0 and times in tau, so without names a file says "length", "pressure",
"time" or "force" where a unit is wanted, products of these such as "pressure length" for an energy per area,
and "1" for dimensionless quantities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace


class ResultsError(OSError):
    """A results file or folder that cannot be written or read; the message names it and says why."""


@dataclass(frozen=True)
class Variable:
    """Meaning, units and numpy type of a coordinate or field; columns of rows are declared by observables.

    Where it is measured from, or over what, is for the reference.
    """

    long_name: str
    units: str = "1"
    dtype: str = "f8"
    origin: str = ""

    def in_units(self, unit: Callable[[str], str]) -> Variable:
        """Return the variable with the label of its unit in place of the words."""
        return replace(self, units=unit(self.units))

    @property
    def described(self) -> dict[str, str]:
        """Attributes of the variable in a file."""
        return {"long_name": self.long_name, "units": self.units}


@dataclass(frozen=True)
class Parameter:
    """Meaning of one config key that may be swept: its name, symbol in plain text and in mathtext, units."""

    long_name: str
    symbol: str
    mathtext: str
    units: str = "1"


VARIABLES: dict[str, Variable] = {
    "x": Variable("position along x", "length", origin="from the middle of the cell, and of the punch"),
    "y": Variable("position along y", "length", origin="from the middle of the cell"),
    "snapshot": Variable("time of the snapshot", "time", origin="from the beginning of the run"),
    "displacement": Variable(
        "normal displacement of the surface, positive upward", "length", origin="from the surface at rest"
    ),
    "pressure": Variable(
        "contact pressure, positive in compression", "pressure", origin="at each point, of the wall"
    ),
    "gap": Variable("gap between surface and punch, zero in contact", "length", origin="at each point"),
    "traction": Variable(
        "traction across the gap, positive in attraction",
        "pressure",
        origin="at each point, of the interface",
    ),
    "case": Variable("number of the case, that of its file in cases/", "1", "i8", origin="from 0"),
}

FIELDS = ("displacement", "pressure", "gap", "traction")  # the last where the interface attracts
OVER_TIME = "_over_time"  # end of the name of a column in a sweep over a key of the same name

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
    "interface.work": Parameter("work of adhesion", "w", "w", "pressure length"),
    "interface.range": Parameter("range of the attraction", "rho", r"\rho", "length"),
    "interface.stress": Parameter("cohesive stress", "sigma_0", r"\sigma_0", "pressure"),
    "interface.separation": Parameter("equilibrium separation", "z_0", "z_0", "length"),
    "interface.voltage": Parameter("voltage", "V", "V", "V"),
    "trajectory.depth": Parameter("depth of the indentation", "h_0", "h_0", "length"),
    "trajectory.load": Parameter("mean pressure on the punch", "p_0", "p_0", "pressure"),
    "trajectory.force": Parameter("force on the punch", "F_0", "F_0", "force"),
    "trajectory.velocity": Parameter("velocity of the punch along x", "v", "v", "length / time"),
    "trajectory.ramp_time": Parameter("duration of the ramp", "t_0", "t_0", "time"),
    "trajectory.approach_speed": Parameter("speed of the approach", "v_in", r"v_\mathrm{in}", "drive / time"),
    "trajectory.retract_speed": Parameter(
        "speed of the retraction", "v_out", r"v_\mathrm{out}", "drive / time"
    ),
    "trajectory.dwell": Parameter("dwell time", "t_d", r"t_\mathrm{d}", "time"),
    "time.step": Parameter("time step", "dt", r"\Delta t", "time"),
    "grid.points": Parameter("grid points", "n", "n"),
    "grid.period": Parameter("period of the surface", "L", "L", "length"),
}


_BRANCH = {
    "G": Parameter("modulus of a branch of the layer", "G", "G", "pressure"),
    "tau": Parameter("relaxation time of a branch of the layer", "tau", r"\tau", "time"),
}


def parameter(key: str) -> Parameter | None:
    """Return the meaning of a config key that may be swept; None where it has no symbol.

    Layers and branches are counted from 1: `layers.0.thickness` is d_1, and the branches of its material have
    the moduli G_1,1 and G_1,2.
    """
    parts = key.split(".")
    places = [str(int(part) + 1) for part in parts if part.isdigit()]
    section, *below = (part for part in parts if not part.isdigit())
    owner = f"of layer {places[0]}" if section == "layers" else f"of the {section}"
    index = [*(["bulk"] if (section, *below[:1]) == ("halfspace", "material") else []), *places]
    plain = ".".join(["layer", *below] if section == "layers" or "bulk" in index else [section, *below])
    known = _BRANCH.get(below[-1]) if below[:2] == ["material", "branches"] else PARAMETERS.get(plain)
    if known is None or not index:
        return known
    letter, _, old = known.mathtext.partition("_")
    return replace(
        known,
        long_name=known.long_name.replace("of the layer", owner),
        symbol=f"{known.symbol}{',' if '_' in known.symbol else '_'}{','.join(index)}",
        mathtext=rf"{letter}_{{{','.join(filter(None, [old, *index]))}}}".replace("bulk", r"\mathrm{bulk}"),
    )


def described_key(key: str, unit: Callable[[str], str]) -> dict[str, str]:
    """Return the attributes of the labels of a swept key, with the label of a unit from its words."""
    if (known := parameter(key)) is None:
        return {"key": key}
    return {"key": key, "long_name": known.long_name, "symbol": known.symbol, "units": unit(known.units)}


def variable(name: str) -> Variable:
    """Return a coordinate or field of the result files.

    Raises
    ------
    KeyError
        If the table has no such name.
    """
    if name not in VARIABLES:
        raise KeyError(f"results have no variable {name!r}; known: {', '.join(sorted(VARIABLES))}")
    return VARIABLES[name]
