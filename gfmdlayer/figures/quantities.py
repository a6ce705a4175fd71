r"""Quantities on the axes: symbol, unit, and the power of ten of the ticks.

Where the configuration names its units (`units: {length: m, ...}`), values are drawn in them: "$u$ (µm)".
Where it does not, they are divided by the scales of the paper, "$u/L$", "$p/G_0$", "$t/\tau$": the attributes
L (period along x), G0 and tau of the results. A quantity whose scale the cases do not share keeps the numbers
of the configuration, and its symbol stands alone.
"""

from __future__ import annotations

import math
import re
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from gfmdlayer.figures.labels import symbol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from xarray import DataArray

SCALES = {"length": ("L", "L"), "pressure": ("G0", "G_0"), "time": ("tau", r"\tau")}
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
PLAIN = (1e-3, 1e5)  # magnitudes whose ticks are written without a power of ten

_FACTOR = re.compile(r"(/?)\s*([^\s/*^()]+)(?:\^(-?\d+))?")
_SI = re.compile(r"(?:m|Pa|s|N|J|W)(?![\w^])")
_UNIT = re.compile(r"\(([^()]*)\)$")


class Quantity(NamedTuple):
    """A quantity on an axis.

    Attributes
    ----------
    symbol : str
        With the scale that it is divided by, as mathtext.
    unit : str
        Empty if it is dimensionless.
    scale : float
        What the values of the file are divided by.
    """

    symbol: str
    unit: str = ""
    scale: float = 1.0

    @property
    def label(self) -> str:
        """Label of the axis."""
        return f"{self.symbol} ({self.unit})" if self.unit else self.symbol

    def equals(self, value: str) -> str:
        """Write that it has a value."""
        return f"{self.symbol} = {value} {self.unit}".rstrip()


def quantity(array: DataArray, scales: Mapping[str, Any] = MappingProxyType({})) -> Quantity:
    """Return how a variable, coordinate or swept key of results is drawn.

    Parameters
    ----------
    array : DataArray
        The variable, whose attribute `units` is "m", say, or a product of length, pressure and time.
    scales : mapping
        Attributes of the results, of which L, G0 and tau are used. The values of swept keys stay in the
        numbers of the configuration.
    """
    factors = _factors(str(array.attrs.get("units", "1")))
    if not factors.keys() <= SCALES.keys():
        return Quantity(symbol(array), mathtext_units(str(array.attrs["units"])))
    if "key" in array.attrs or any(SCALES[each][0] not in scales for each in factors):
        return Quantity(symbol(array))
    scale = math.prod(float(scales[SCALES[each][0]]) ** power for each, power in factors.items())
    return Quantity(
        _over(symbol(array), {SCALES[each][1]: power for each, power in factors.items()}), "", scale
    )


def _factors(units: str) -> dict[str, int]:
    """Split units such as "force / length" into factors and their powers; a force is pressure times area."""
    found: dict[str, int] = {}
    for over, name, power in _FACTOR.findall(units):
        if name != "1":
            signed = int(power or 1) * (-1 if over else 1)
            for part, times in {"pressure": 1, "length": 2}.items() if name == "force" else [(name, 1)]:
                found[part] = found.get(part, 0) + signed * times
    return {name: power for name, power in found.items() if power}


def _over(written: str, scales: dict[str, int]) -> str:
    """Divide a symbol by scales, each to its power."""
    parts: dict[bool, list[str]] = {True: [], False: []}
    for scale, power in scales.items():
        parts[power > 0].append(scale if abs(power) == 1 else f"{scale}^{{{abs(power)}}}")
    times, by = r"\,".join(parts[False]), r"\,".join(parts[True])
    quotient = f"{times}/({by})" if len(parts[True]) > 1 else f"{times}/{by}" if by else times
    return f"{written[:-1]}{quotient}$" if written.endswith("$") else f"{written} ${quotient}$"


def mathtext_units(units: str) -> str:
    """Write powers in units, and micro, as in print."""
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", re.sub(r"\bu(?=m\b|s\b|Pa\b|N\b)", "µ", units))


def power_of_ten(values: Sequence[float]) -> int:
    """Return a multiple of three, the power of ten to be written with the unit of values; 0 for most."""
    largest = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    if largest == 0 or PLAIN[0] <= largest < PLAIN[1]:
        return 0
    return 3 * math.floor(math.log10(largest) / 3 + 1e-9)


def in_unit(power: int, unit: str) -> str:
    """Write a power of ten and a unit: µm for 1e-6 m."""
    if not power:
        return unit
    if _SI.match(unit) and power in PREFIXES:
        return PREFIXES[power] + unit
    return rf"$10^{{{power}}}$ {unit}".rstrip()


def finish(figure: Figure, notes: Sequence[str] = ()) -> None:
    """Write notes below a figure, and the powers of ten of its linear axes into their labels.

    Parameters
    ----------
    figure : Figure
        The figure, with everything drawn.
    notes : sequence of str
        What is held, left out or failed.
    """
    insets = [inset for axes in figure.axes for inset in axes.child_axes if isinstance(inset, type(axes))]
    for axes in [*figure.axes, *insets]:
        _write_power(axes.xaxis)
        _write_power(axes.yaxis)
    if notes:
        text = "\n".join(_lines(notes, figure.get_figwidth()))
        figure.supxlabel(text, x=0.01, ha="left", fontsize="small", color="0.3")


def _write_power(axis: Axis) -> None:
    from matplotlib.ticker import FuncFormatter, ScalarFormatter

    low, high = axis.get_view_interval()
    power = power_of_ten((low, high)) if isinstance(axis.get_major_formatter(), ScalarFormatter) else 0
    if power:
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 10.0**power:.10g}"))
        label, parts = axis.get_label_text(), _UNIT.search(axis.get_label_text())
        unit = in_unit(power, parts[1] if parts else "")
        axis.set_label_text(f"{label[: parts.start()] if parts else f'{label} '}({unit})" if label else "")


def _lines(notes: Sequence[str], inches: float) -> list[str]:
    """Fill lines with notes; a letter is taken to be half as wide as the font is high."""
    from matplotlib import rcParams
    from matplotlib.font_manager import font_scalings

    room = inches * 72 / (0.5 * rcParams["font.size"] * font_scalings["small"])
    lines = [""]
    for note in notes:
        longer = f"{lines[-1]}; {note}" if lines[-1] else note
        if len(re.sub(r"\\[a-z]+|[${}]", "", longer)) > room and lines[-1]:
            lines.append(note)
        else:
            lines[-1] = longer
    return lines
