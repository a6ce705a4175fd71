"""Names in result files: coordinates, fields and swept parameters, their meaning, units and type.

Units are those of the config that was run, by name where it names them (`config.units`). In the paper's
convention lengths are in L, moduli in G0 and times in tau, so without names a file says "length", "pressure",
"time" or "force" where a unit is wanted, products of these such as "pressure length" for an energy per area,
and "1" for dimensionless quantities.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import NamedTuple

from gfmdlayer.config import Config
from gfmdlayer.config.sweeps import as_label
from gfmdlayer.errors import GfmdlayerError
from gfmdlayer.observables import known_numbers
from gfmdlayer.observables.contact import TIME
from gfmdlayer.observables.observable import declared
from gfmdlayer.validation.sections import described


class ResultsError(GfmdlayerError, OSError):
    """A results file or folder that cannot be written or read; the message names it and says why.

    Examples
    --------
    >>> try:
    ...     gfmdlayer.open_case("nothing.h5")
    ... except gfmdlayer.ResultsError as error:
    ...     print(error)
    nothing.h5: no such file
    """


class Parameter(NamedTuple):
    """A config key that may be swept: its meaning, its symbol in plain text (may be empty), and its units."""

    long_name: str
    symbol: str
    units: str


# Fields of snapshots at the surface, which contacts return: traction where the interface attracts, imprint
# with a hardness, shear and slip with friction, the displacement of each of two bodies.
_FIELDS = declared(r"""
    displacement | normal displacement of the surface, positive upward | length |
      from the surface at rest | u
    pressure | contact pressure, positive in compression | pressure | at each point, of the wall | p
    gap | gap between surface and punch, zero in contact | length | at each point | g
    traction | traction across the gap, positive in attraction | pressure |
      at each point, of the interface | \tau
    imprint | height that the surfaces have lost | length |
      at each point, from the beginning of the run | W
    shear_x | shear traction of the punch on the surface along x | pressure | at each point | t_x
    shear_y | shear traction of the punch on the surface along y | pressure | at each point | t_y
    slip_velocity_x | velocity of the surface against the punch along x, zero where it sticks |
      length / time | at each point in contact, mean over the step; else NaN | \dot{s}_x
    slip_velocity_y | velocity of the surface against the punch along y, zero where it sticks |
      length / time | at each point in contact, mean over the step; else NaN | \dot{s}_y
    displacement_body | normal displacement of the surface of the body, positive out of it | length |
      from the surface at rest | u_1
    displacement_counterbody | normal displacement of the surface of the counterbody, positive out of it |
      length | from the surface at rest | u_2
    """)
FIELDS = tuple(field.name for field in _FIELDS)
# Coordinates, these fields, and those below the surface; observables declare the columns of the rows.
VARIABLES = {
    variable.name: variable
    for variable in declared(r"""
    x | position along x | length |
      from the middle of the cell, and of the punch; from the axis of an isolated indenter | x
    y | position along y | length | from the middle of the cell | y
    snapshot | time of the snapshot | time | from the beginning of the run | t
    z | depth below the surface | length | of the undeformed body; an interface is there twice | z
    layer | number of the layer at the depth | 1 | from the surface, 0 | | i8
    displacement_x | displacement along x | length | below the surface | u_x | f4
    displacement_y | displacement along y | length | below the surface | u_y | f4
    displacement_z | displacement along z, positive downward | length | below the surface | u_z | f4
    stress_xx | normal stress along x, positive in tension | pressure |
      below the surface | \sigma_{xx} | f4
    stress_yy | normal stress along y, positive in tension | pressure |
      below the surface | \sigma_{yy} | f4
    stress_zz | normal stress along z, of an interface the peel stress, positive in tension | pressure |
      below the surface | \sigma_{zz} | f4
    stress_xy | shear stress xy | pressure | below the surface | \sigma_{xy} | f4
    stress_xz | shear stress xz | pressure | below the surface | \sigma_{xz} | f4
    stress_yz | shear stress yz | pressure | below the surface | \sigma_{yz} | f4
    von_mises | von Mises stress | pressure | below the surface | \sigma_\mathrm{Mises} | f4
    spring | number of the spring | 1 | from the surface, 0 | | i8
    spring_strain | strain of each spring of the layers | length | for other depths
    spring_force | force of each spring of the layers | pressure | for other depths
    case | number of the case and of its file in cases/ | 1 | from 0 | | i8
    """)
    + _FIELDS
}
# Fields of the snapshots below the surface, and their first dimension. Springs only where
# the layers relax by different laws: they determine the fields at all depths (`body.inside`).
BELOW = {
    **dict.fromkeys((f"displacement_{axis}" for axis in "xyz"), "z"),
    **dict.fromkeys((f"stress_{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")), "z"),
    "von_mises": "z",
    "spring_strain": "spring",
    "spring_force": "spring",
}
SNAPSHOT_FIELDS = (*FIELDS, *BELOW)
SWEEP_FILE = "sweep.h5"
SAME_TIME = 1e-9  # relative: times that are reached by different steps differ by rounding
OVER_TIME = "_over_time"  # end of the name of a column in a sweep over a key of the same name

ROW = "row"  # the dimension of the rows of cases with times of their own
SNAPSHOT_ROW = "snapshot_row"  # likewise of their snapshots
# These dimensions cannot be selected by keyword: sel(tolerance=1e-6) selects nothing, without an error.
_ARGUMENTS_OF_SEL = ("indexers", "method", "tolerance", "drop")
# Of a coordinate with such a name xarray gives its own method or attribute: data.load is no load.
_OF_XARRAY = ("load", "max", "mean", "min", "name", "resample", "shape", "shift", "size", "transpose")
_SAYS_NOTHING = re.compile(r"value|\d+")  # last parts without a meaning of their own: temperature.value

# Name and symbol of the keys that have one; the dimension is declared with the key, in its section.
SYMBOLS: dict[str, tuple[str, str]] = {
    "layer.thickness": ("thickness of the layer", "d"),
    "layer.poisson": ("Poisson's ratio of the layer", "nu"),
    "layer.material.G0": ("relaxed modulus of the layer", "G_0"),
    "layer.material.Ginf": ("glassy modulus of the layer", "G_inf"),
    "layer.material.tau": ("relaxation time of the layer", "tau"),
    "halfspace.shear_modulus": ("shear modulus of the halfspace", "G_bulk"),
    "halfspace.poisson": ("Poisson's ratio of the halfspace", "nu_bulk"),
    "punch.radius": ("radius of the punch", "R"),
    "punch.hurst": ("Hurst exponent of the punch", "H"),
    "punch.rms_slope": ("rms slope of the punch", "g'"),
    "punch.rms_height": ("rms height of the punch", "h_rms"),
    "punch.short_cutoff": ("shortest wave of the punch", "lambda_s"),
    "punch.roll_off": ("roll-off wavelength of the punch", "lambda_r"),
    "interface.work": ("work of adhesion", "w"),
    "interface.range": ("range of the attraction", "rho"),
    "interface.stress": ("cohesive stress", "sigma_0"),
    "interface.separation": ("equilibrium separation", "z_0"),
    "interface.voltage": ("voltage", "V"),
    "interface.hardness": ("hardness", "H"),
    "interface.coefficient": ("coefficient of friction", "mu_C"),
    "trajectory.creepage": ("creepage", "xi"),
    "trajectory.creepage.x": ("creepage along x", "xi_x"),
    "trajectory.creepage.y": ("creepage along y", "xi_y"),
    "trajectory.creepage.spin": ("spin", "phi"),
    "trajectory.tangential.displacement": ("displacement along the surface", "D_0"),
    "trajectory.tangential.force": ("force along the surface", "Q_0"),
    "trajectory.depth": ("depth of the indentation", "h_0"),
    "trajectory.gap": ("mean gap of the path", "g_0"),
    "trajectory.load": ("mean pressure on the punch", "p_0"),
    "trajectory.force": ("force on the punch", "F_0"),
    "trajectory.velocity": ("velocity of the punch along x", "v"),
    "trajectory.ramp_time": ("duration of the ramp", "t_0"),
    "trajectory.approach_speed": ("speed of the approach", "v_in"),
    "trajectory.retract_speed": ("speed of the retraction", "v_out"),
    "trajectory.dwell": ("dwell time", "t_d"),
    "temperature.value": ("temperature", "T"),
    "time.step": ("time step", "dt"),
    "grid.points": ("grid points", "n"),
    "grid.period": ("period of the surface", "L"),
}
_OF_A_BRANCH = {
    "G": ("modulus of a branch of the layer", "G"),
    "tau": ("relaxation time of a branch of the layer", "tau"),
}


def numbered(cases: Sequence[int], most: int = 8) -> str:
    """Name cases by their numbers, or the first of many."""
    more = len(cases) - most
    first = ", ".join(f"{number:04d}" for number in cases[:most])
    return f"case{'s' * (len(cases) > 1)} {first}{f' and {more} more' * (more > 0)}"


def dimension_names(keys: Sequence[str], names: Iterable[str] = ()) -> list[str]:
    """Name the swept keys by their last parts, or by the whole keys where these are not free or say nothing.

    A last part is not free if another key has it, or if it is one of `names`, a variable or dimension of the
    results, an argument of `sel`, or a method of xarray. A key of one part then is `sweep.interface`.
    """
    last = [key.rpartition(".")[2] for key in keys]
    own = (TIME.name, ROW, SNAPSHOT_ROW, *VARIABLES, *known_numbers())
    taken = Counter([*last, *{*own, *_ARGUMENTS_OF_SEL, *_OF_XARRAY, *names}])
    return [
        part
        if taken[part] == 1 and not _SAYS_NOTHING.fullmatch(part)
        else key
        if "." in key
        else f"sweep.{key}"
        for key, part in zip(keys, last, strict=True)
    ]


def labels(key: str, values: Sequence[object]) -> list[int] | list[float] | list[str]:
    """Return labels of one type for the values of one key: numbers if all are numbers, else text."""
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        return [int(str(value)) for value in values]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [float(str(value)) for value in values]
    return [as_label(key, value) for value in values]


@cache
def parameter(key: str) -> Parameter | None:
    """Return the meaning of a config key that may be swept; None for a key without symbol and dimension.

    Layers and branches are counted from 1: `layers.0.thickness` is d_1.
    """
    words, dimension = described(Config, key)
    units = " / ".join(part.strip() for part in (dimension or "1").split("/"))
    parts = key.split(".")
    places = [str(int(part) + 1) for part in parts if part.isdigit()]
    section, *below = (part for part in parts if not part.isdigit())
    owner = f"of layer {places[0]}" if section == "layers" else f"of the {section}"
    index = [*(["bulk"] if (section, *below[:1]) == ("halfspace", "material") else []), *places]
    plain = ".".join(["layer", *below] if section == "layers" or "bulk" in index else [section, *below])
    known = _OF_A_BRANCH.get(below[-1]) if below[:2] == ["material", "branches"] else SYMBOLS.get(plain)
    if known is None:
        return Parameter(words.partition(";")[0], "", units) if dimension else None
    name, symbol = known
    if index:
        name = name.replace("of the layer", owner)
        symbol = f"{symbol}{',' if '_' in symbol else '_'}{','.join(index)}"
    return Parameter(name, symbol, units)


def described_key(key: str, unit: Callable[[str], str]) -> dict[str, str]:
    """Return the attributes of the labels of a swept key, with the label of a unit from its words."""
    if (known := parameter(key)) is None:
        return {"key": key}
    symbol = {"symbol": known.symbol} if known.symbol else {}
    return {"key": key, "long_name": known.long_name, **symbol, "units": unit(known.units)}
