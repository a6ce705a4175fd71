"""Measured curves, and the response of a branch at the measured frequencies or times.

A master curve is the storage and loss modulus G' + i G'' = G(omega) over angular frequency, a relaxation
curve G(t) the stress after a unit step of strain, over two, a creep curve J(t) the strain after a unit step
of stress, times two. A branch of unit modulus and relaxation time tau adds, Eqs. (4) and (5) of Petrenko et
al., Materials Physics and Mechanics 52 (2024) 60-68,

    i omega tau/(1 + i omega tau)     to the first, and     exp(-t/tau)     to the second.

The compliance is linear in retarded parts instead,

    J(t)   = Jinf + t/eta     + sum_k J_k (1 - exp(-t/theta_k))
    1/G(s) = Jinf + 1/(s eta) + sum_k J_k/(1 + s theta_k)

and the relaxation times are the poles of G(s). Dynamic compliances are moduli, G = 1/(J' - i J'').
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import FloatArray
from gfmdlayer.body.materials import Law, Prony
from gfmdlayer.body.network import relaxation
from gfmdlayer.errors import GfmdlayerError
from gfmdlayer.files.headings import ANGULAR, ORDINARY
from gfmdlayer.files.tables import Answers, TableError, TextTable, read_table
from gfmdlayer.files.units import unit_of

FEWEST_ROWS = 8  # enough to choose between one branch and two
FEWEST_OF_A_TEMPERATURE = 3  # rows of one of several curves
SAME_TEMPERATURE = 1.0  # kelvin: rows closer than this are of one curve


class FitError(GfmdlayerError, ValueError):
    """A fit is not possible; the message gives the reason and the allowed values.

    Examples
    --------
    >>> try:
    ...     gfmdlayer.fit_indentation([], {"punch": gfmdlayer.Sphere(radius=1.0)}, "layer.material.G0")
    ... except gfmdlayer.FitError as error:
    ...     print(error)
    got no curve; give at least one
    """


@dataclass(frozen=True)
class Measurement(ABC):
    """A measured curve; responses are flat, one modulus after the other."""

    source: str  # name of the file
    abscissa: FloatArray  # shape (rows,): angular frequencies or times, positive
    moduli: FloatArray  # moduli, or compliances: shape (moduli, rows), positive
    units: tuple[str, str] = ("", "")  # of times and moduli, where the file names them
    account: str = ""  # how the file was read
    notes: tuple[str, ...] = ()  # conversions
    temperature: float | None = None  # degrees Celsius, where it is known

    name: ClassVar[str]
    columns: ClassVar[tuple[str, ...]]
    slower: ClassVar[str]
    power: ClassVar[int]  # of the relaxation times to which the abscissa is proportional

    @property
    def reach(self) -> tuple[float, float]:
        """The shortest and the longest relaxation time within the measured range."""
        ends = np.array([self.abscissa.min(), self.abscissa.max()])
        shortest, longest = sorted((ends ** float(self.power)).tolist())
        return shortest, longest

    @property
    def elastic(self) -> FloatArray:
        """The modulus that a spring has over the abscissa: G', G, 1/J, shape (rows,)."""
        return np.asarray(self.moduli[0])

    @property
    @abstractmethod
    def constant(self) -> FloatArray:
        """Response of a spring of unit modulus, or of unit compliance, shape (moduli * rows,)."""

    @abstractmethod
    def response(self, times: FloatArray) -> FloatArray:
        """Response of branches of unit modulus, shape (moduli * rows, times)."""

    @abstractmethod
    def sensitivity(self, times: FloatArray) -> FloatArray:
        """Derivative of the response to the logarithm of the relaxation time, in the response's shape."""

    @abstractmethod
    def predicted(self, material: Law, abscissa: FloatArray) -> FloatArray:
        """The moduli of a material, shape (moduli, abscissae)."""

    def slowed(self, factor: float) -> Self:
        """The curve of a material with all relaxation times longer by a factor."""
        return replace(self, abscissa=self.abscissa * factor**self.power)

    def in_units_of(self, modulus: float) -> Self:
        """The same curve with its moduli divided by one."""
        return replace(self, moduli=self.moduli / modulus, units=(self.units[0], ""))

    @property
    def labels(self) -> tuple[str, str]:
        """Units of the abscissa and of the moduli or compliances, "" where they are not known."""
        time, modulus = self.units
        return time and ("rad/s" if self.power < 0 else time), modulus


class MasterCurve(Measurement):
    """Storage and loss modulus over angular frequency."""

    name = "master curve"
    columns = ("omega", "G'", "G''")
    slower = "lower frequencies"
    power = -1

    @property
    def constant(self) -> FloatArray:
        """One and zero."""
        return np.repeat((1.0, 0.0), self.abscissa.size)

    def response(self, times: FloatArray) -> FloatArray:
        """Real and imaginary part of i omega tau/(1 + i omega tau)."""
        cycles = 1j * np.multiply.outer(self.abscissa, times)
        return _parts(cycles / (1 + cycles))

    def sensitivity(self, times: FloatArray) -> FloatArray:
        """Real and imaginary part of i omega tau/(1 + i omega tau)^2."""
        cycles = 1j * np.multiply.outer(self.abscissa, times)
        return _parts(cycles / (1 + cycles) ** 2)

    def predicted(self, material: Law, abscissa: FloatArray) -> FloatArray:
        """Storage and loss modulus of a material."""
        modulus = material.complex_modulus(abscissa)
        return np.stack([modulus.real, modulus.imag])


class RelaxationCurve(Measurement):
    """Relaxation modulus over time."""

    name = "relaxation curve"
    columns = ("t", "G")
    slower = "longer times"
    power = 1

    @property
    def constant(self) -> FloatArray:
        """One."""
        return np.ones(self.abscissa.size)

    def response(self, times: FloatArray) -> FloatArray:
        """exp(-t/tau)."""
        return np.asarray(np.exp(-np.divide.outer(self.abscissa, times)))

    def sensitivity(self, times: FloatArray) -> FloatArray:
        """(t/tau) exp(-t/tau)."""
        elapsed = np.divide.outer(self.abscissa, times)
        return np.asarray(elapsed * np.exp(-elapsed))

    def predicted(self, material: Law, abscissa: FloatArray) -> FloatArray:
        """Relaxation modulus of a material, in a first dimension of one."""
        return material.relaxation_modulus(abscissa)[np.newaxis]


class CreepCurve(Measurement):
    """Creep compliance over time; its branches are retarded compliances."""

    name = "creep curve"
    columns = ("t", "J")
    slower = "longer times"
    power = 1

    @property
    def elastic(self) -> FloatArray:
        """Modulus 1/J."""
        return np.asarray(1 / self.moduli[0])

    @property
    def constant(self) -> FloatArray:
        """One."""
        return np.ones(self.abscissa.size)

    @property
    def flow(self) -> FloatArray:
        """Response t of a dashpot, in units of the longest time, shape (rows,)."""
        return np.asarray(self.abscissa / self.abscissa.max())

    def response(self, times: FloatArray) -> FloatArray:
        """1 - exp(-t/theta)."""
        return np.asarray(-np.expm1(-np.divide.outer(self.abscissa, times)))

    def sensitivity(self, times: FloatArray) -> FloatArray:
        """-(t/theta) exp(-t/theta)."""
        elapsed = np.divide.outer(self.abscissa, times)
        return np.asarray(-elapsed * np.exp(-elapsed))

    def predicted(self, material: Law, abscissa: FloatArray) -> FloatArray:
        """Creep compliance of a material, in a first dimension of one."""
        return material.creep_compliance(abscissa)[np.newaxis]

    def in_units_of(self, modulus: float) -> Self:
        """The same curve with its compliances multiplied by a modulus."""
        return replace(self, moduli=self.moduli * modulus, units=(self.units[0], ""))

    @property
    def labels(self) -> tuple[str, str]:
        """Units of the time and of the compliance."""
        time, modulus = self.units
        return time, modulus and f"1/{modulus}"

    def series(self, instant: float, flow: float, compliances: FloatArray, times: FloatArray) -> Prony:
        """Return the Prony series of retarded compliances and a flow in units of the longest time."""
        if flow:  # a retardation far beyond all times
            endless = _ENDLESS * max(self.abscissa[-1], times.max(initial=0.0))
            compliances = np.append(compliances, flow * endless / self.abscissa[-1])
            times = np.append(times, endless)
        moduli, relaxing = relaxation(instant, compliances, times)
        order = np.argsort(relaxing)
        branches = zip(moduli[order].tolist(), relaxing[order].tolist(), strict=True)
        G0 = 0.0 if flow else 1 / (instant + float(compliances.sum()))
        return Prony(G0, tuple(branches))


_ENDLESS = 1e25


def _parts(values: NDArray[np.complex128]) -> FloatArray:
    return np.concatenate([values.real, values.imag])


# Columns of measured data by their quantities (`files.headings`): frequency in Hz, moduli in tension ...
#
#     omega = 2 pi f,      G = E/(2 (1 + nu)),     J = 2 (1 + nu) D,      G = 1/(J' - i J'')
#
# with a constant Poisson's ratio nu.

_TENSION = {
    "G'": "E'", "G''": "E''", "|G*|": "|E*|", "G(t)": "E(t)", "J'": "D'", "J''": "D''", "J(t)": "D(t)",
}  # fmt: skip
_TAN = "tan delta"
_ABSCISSAE = {
    ANGULAR: ((ANGULAR, "rad/s", 1.0), (ORDINARY, "Hz", 2 * math.pi)),
    "time": (("time", "s", 1.0), ("step time", "s", 1.0)),
}
# The moduli of a master curve by two columns, in the order of preference.
_PAIRS: Mapping[tuple[str, str], Callable[[FloatArray, FloatArray], NDArray[Any]]] = {
    ("G'", "G''"): lambda storage, loss: storage + 1j * loss,
    ("J'", "J''"): lambda storage, loss: 1 / (storage - 1j * loss),
    ("G'", _TAN): lambda storage, tan: storage * (1 + 1j * tan),
    ("|G*|", _TAN): lambda size, tan: size * (1 + 1j * tan) / np.hypot(1, tan),
    ("G''", _TAN): lambda loss, tan: loss * (1 / tan + 1j),
    ("J'", _TAN): lambda storage, tan: 1 / (storage * (1 - 1j * tan)),
    ("J''", _TAN): lambda loss, tan: 1 / (loss * (1 / tan - 1j)),
    ("|G*|", "G'"): lambda size, storage: storage + 1j * np.sqrt(size**2 - storage**2),
    ("|G*|", "G''"): lambda size, loss: np.sqrt(size**2 - loss**2) + 1j * loss,
}
_WAYS: Sequence[tuple[type[Measurement], str, tuple[str, ...]]] = (
    *((MasterCurve, ANGULAR, pair) for pair in _PAIRS),
    (RelaxationCurve, "time", ("G(t)",)),
    (CreepCurve, "time", ("J(t)",)),
)
_STRESSES = ("Pa", "kPa", "MPa", "GPa", "mPa", "bar", "psi", "ksi")  # of configurations
TEMPERATURE = "temperature"
WANTED = (
    ANGULAR, ORDINARY, "time", "step time", _TAN, "phase", *_TENSION, *_TENSION.values(), TEMPERATURE,
)  # fmt: skip
_APART = 4  # of these, the units of frequencies and times
ORDERS = ((ANGULAR, "G'", "G''"), ("time", "G(t)"))
WAYS = (
    "omega or f with two of G', G'', |G*|, tan delta or phase, or with J' and J''; or t with G(t) or J(t); "
    "E in place of G, and D of J, in tension"
)
_TAU = re.compile(r"(tau|τ)([ _]?[ikn]|_relax)?\b|relaxation[ _]times?", re.IGNORECASE)
_AGREE = 0.05  # median of the relative differences of a further column from the two that are read


def read(path: Path, poisson: float | None = None, answers: Answers = Answers()) -> Measurement:  # noqa: B008
    """Read a measured curve from a table: moduli over frequency, or a modulus or a compliance over time.

    The columns go by their names; without names they are omega, G', G'', or t, G, or E where the answers say
    so. `poisson`, 1/2 by default, converts moduli and compliances in tension. Rows are sorted by frequency or
    time. A table with rows at several temperatures is refused, see `isotherms`.
    """
    first, *others = isotherms(path, poisson, answers)
    if others:
        raise TableError(f"{path}: has curves at {1 + len(others)} temperatures; must be one")
    return first


def isotherms(
    path: Path, poisson: float | None = None, answers: Answers = Answers()  # noqa: B008
) -> list[Measurement]:  # fmt: skip
    """Read the curves of a table, see `read`: one of each temperature where it has a column of them."""
    table = read_table(path, WANTED, answers, orders=ORDERS, apart=WANTED[:_APART])
    columns = _Quantities(table, 1 / (2 * (1 + (0.5 if poisson is None else poisson))))
    kind, abscissa, needed = _way(columns, answers)
    values = {name: columns.take(name) for name in (abscissa, *needed)}
    said = list(_conversions(table, columns, needed, poisson, answers))
    temperatures, degrees = _temperatures(table)
    groups = _groups(temperatures, table) if temperatures is not None else [np.arange(values[abscissa].size)]
    least = FEWEST_ROWS if len(groups) == 1 else FEWEST_OF_A_TEMPERATURE
    notes, found = list[str](), []
    for rows in groups:
        x = values[abscissa][rows]
        order = rows[np.argsort(x, kind="stable")]
        if kind is not MasterCurve and values[abscissa][order[0]] == 0:
            order = order[1:]
            notes.append("The row at t = 0 is left out: times count by their logarithm.")
        for name, column in values.items():
            if (wrong := np.flatnonzero(~(column > 0))).size and (row := int(wrong[0])) in order:
                raise TableError(f"{table.place(row)}: {name} = {column[row]:g}; must be > 0")
        if (same := np.flatnonzero(np.diff(values[abscissa][order]) <= 0)).size:
            first, second = (int(order[same[0] + i]) for i in range(2))
            line = table.place(first).rpartition(":")[2]
            message = f"{abscissa} = {values[abscissa][second]:g} again, after line {line}"
            raise TableError(f"{table.place(second)}: {message}; must be one row for each")
        at = None if temperatures is None else float(temperatures[rows].mean())
        if order.size < least:
            where = "" if at is None or len(groups) == 1 else f" at {at:g} degrees Celsius"
            message = f"holds {order.size} rows of numbers{where}; must be at least {least}"
            raise TableError(f"{path}: {message}")
        if (np.diff(order) < 0).any():
            notes.append(f"The rows are sorted by {abscissa}.")
        if kind is MasterCurve:
            moduli = _PAIRS[needed[0], needed[1]](values[needed[0]], values[needed[1]])
            columns.refuse_contradictions(moduli, needed)
            parts = _parts(moduli).reshape(2, -1)
            if (wrong := np.flatnonzero(~(parts > 0).all(axis=0))).size:
                raise TableError(f"{table.place(int(wrong[0]))}: {needed[0]} < {needed[1]}; must be larger")
        else:
            parts = values[needed[0]][np.newaxis]
        units, told = columns.units(abscissa), tuple(dict.fromkeys([*notes, *degrees, *said]))
        found.append(
            kind(path.name, values[abscissa][order], parts[:, order], units, table.account, told, at)
        )
    return found


def _conversions(
    table: TextTable, columns: _Quantities, needed: Sequence[str], poisson: float | None, answers: Answers
) -> Iterator[str]:
    """Yield how moduli were taken, in shear or in tension."""
    if columns.tension:
        assumed = "nu = 0.5, which is assumed" if poisson is None else f"nu = {poisson:g}"
        yield f"Moduli in tension are divided by 2 (1 + nu), with Poisson's ratio {assumed}."
    elif not any(column.heading for column in table.columns.values()):
        asked = answers.to_give("modulus", "E")
        if poisson is not None and answers.modulus is None:
            either = f"in shear, and need no Poisson's ratio, or in tension; say which, {asked} or G"
            raise TableError(f"{table.path}: has no headings: its moduli may be {either}")
        yield f"No headings: {' and '.join(needed)} are taken in shear; {asked} for tension."
    elif poisson is not None:
        yield f"Poisson's ratio {poisson:g} has no effect: {' and '.join(needed)} are in shear."


def _temperatures(table: TextTable) -> tuple[FloatArray | None, list[str]]:
    """Return the temperature of each row in degrees Celsius, if the table has it, and a note."""
    if TEMPERATURE not in table.columns:
        return None, []
    if table.columns[TEMPERATURE].unit is None:
        return table.take(TEMPERATURE, None), ["Temperatures without a unit are in degrees Celsius."]
    return table.take(TEMPERATURE, "degC"), []


def _groups(temperatures: FloatArray, table: TextTable) -> list[NDArray[np.intp]]:
    """Return the rows of each temperature."""
    order = np.argsort(temperatures, kind="stable")
    found = np.split(order, 1 + np.flatnonzero(np.diff(temperatures[order]) > SAME_TEMPERATURE))
    for rows in found:
        if (spread := float(np.ptp(temperatures[rows]))) > 2 * SAME_TEMPERATURE:
            raise TableError(
                f"{table.path}: the temperature changes by {spread:.3g} K in steps below "
                f"{SAME_TEMPERATURE:g} K; must be constant over the rows of a curve"
            )
    return found


def _way(columns: _Quantities, answers: Answers) -> tuple[type[Measurement], str, tuple[str, ...]]:
    """Return the kind of curve that the columns make, its abscissa, and the columns that are needed."""
    known = columns.known
    found = next((way for way in _WAYS if {way[1], *way[2]} <= known), None)
    if found is not None:
        return found
    table = columns.table
    if table.refused:
        reasons = dict.fromkeys(table.refused.values())
        asked = "; say which with --modulus G or E" if any("tension" in each for each in reasons) else ""
        raise TableError(f"{table.path}: {'; '.join(reasons)}{asked}")
    if tau := next((heading for heading in table.unread if _TAU.match(heading)), None):
        raise TableError(
            f"{table.path}: {tau!r} names the relaxation times of a Prony series, not a curve; write it as "
            "material: {model: prony, G0: ..., branches: [{G: ..., tau: ...}, ...]}"
        )
    heads = [column.heading or name for name, column in table.columns.items()]
    unread = [f"{heading!r} is not read ({why})" for heading, why in table.unread.items()]
    message = f"the columns {', '.join(map(repr, heads))} make no curve; must be {WAYS}"
    names = [f"name all columns by {answers.to_give('columns', 'NAMES')}"] if unread else []
    raise TableError("; ".join([f"{table.path}: {message}", *unread, *names]))


@dataclass
class _Quantities:
    """The columns of a table as quantities in shear, in rad/s, and in one unit of moduli."""

    table: TextTable
    in_shear: float  # G/E
    tension: bool = False

    @property
    def known(self) -> set[str]:
        """The quantities that follow from the columns."""
        return {name for name in (ANGULAR, "time", _TAN, *_TENSION) if self._sources(name)}

    def _sources(self, name: str) -> list[str]:
        abscissae = [other for other, _, _ in _ABSCISSAE.get(name, ())]
        others = ["phase"] if name == _TAN else [_TENSION[name]] if name in _TENSION else []
        return [each for each in dict.fromkeys([*abscissae, name, *others]) if each in self.table.columns]

    @cached_property
    def modulus(self) -> str:
        """The unit of all moduli: that of the first one, if a configuration can have it."""
        sizes = [
            1 / column.unit.size if name[0] in "JD" else column.unit.size
            for name, column in self.table.columns.items()
            if column.unit is not None and name in {*_TENSION, *_TENSION.values()}
        ]
        if not sizes:
            return ""
        return next((name for name in _STRESSES if unit_of(name).size == sizes[0]), "Pa")  # type: ignore[union-attr]

    def take(self, name: str) -> FloatArray:
        """Return a quantity."""
        source, table = self._sources(name)[0], self.table
        unit = table.columns[source].unit
        for other, into, factor in _ABSCISSAE.get(name, ()):
            if other == source:
                return factor * table.take(source, into if unit else None)
        if source == "phase":
            if unit is None:
                raise TableError(
                    f"{table.path}: phase has no unit; must be in degrees or in rad, as in phase [deg]"
                )
            return np.asarray(np.tan(table.take(source, "rad")))
        if source == _TAN:
            return table.take(source)
        compliance = name[0] == "J"
        into = f"1/{self.modulus}" if compliance else self.modulus
        values = table.take(source, into if unit else None)
        if source == name:
            return values
        self.tension = True
        return values / self.in_shear if compliance else values * self.in_shear

    def units(self, abscissa: str) -> tuple[str, str]:
        """Return the units of times and moduli, "" where the file does not have them."""
        has_unit = self.table.columns[self._sources(abscissa)[0]].unit is not None
        return "s" if has_unit else "", self.modulus

    def refuse_contradictions(self, moduli: NDArray[np.complex128], needed: Sequence[str]) -> None:
        """Refuse further columns that differ from the moduli by two of them."""
        compliance = 1 / moduli
        follow = {
            "G'": moduli.real, "G''": moduli.imag, "|G*|": np.abs(moduli), _TAN: moduli.imag / moduli.real,
            "J'": compliance.real, "J''": -compliance.imag,
        }  # fmt: skip
        for name in sorted((self.known - {*needed}) & follow.keys()):
            try:
                values = self.take(name)
            except TableError:  # of holes
                continue
            ratio = float(np.median(values / follow[name]))
            if not abs(ratio - 1) <= _AGREE:
                message = f"{name} is {ratio:.3g} times the value that follows from {' and '.join(needed)}"
                raise TableError(
                    f"{self.table.path}: {message}; correct a unit, or leave it out with columns"
                )
