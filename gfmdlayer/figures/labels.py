r"""Labels of the figures: words and symbols, values, and units with their prefixes.

An axis has words with the symbol behind, "mean pressure $\bar{p}$ (MPa)", or the symbol alone. The words are
the first part of what a column means (`long_name`), or shorter ones below. Symbols of swept keys come from
the attribute `symbol` of the results, symbols of other variables from there or from the paper.

Where the configuration names its units (`units: {length: m, ...}`), values are drawn in
them: "$u$ (µm)". Where it does not, they are divided by the scales of the paper, "$u/L$", "$p/G_0$",
"$t/\tau$": the attributes L (period along x), G0 and tau of the results. A quantity whose scale the cases do
not share keeps the numbers of the configuration, and its symbol has no scale.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from matplotlib import rcParams
from matplotlib.axis import Axis, XAxis
from matplotlib.font_manager import font_scalings
from matplotlib.ticker import FixedLocator, Formatter, LogLocator, MaxNLocator, NullFormatter

from gfmdlayer.observables import INDENTATION, TOTALS, known_columns, known_numbers
from gfmdlayer.observables.inside import SHEAR, VON_MISES
from gfmdlayer.results.names import OVER_TIME, SYMBOLS, VARIABLES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset


_COLUMNS = (
    *filter(None, TOTALS.values()), *known_columns().values(), *known_numbers().values(), *INDENTATION,
    VON_MISES, SHEAR, *VARIABLES.values(),
)  # fmt: skip
PAPER_SYMBOLS = {column.name: column.symbol for column in _COLUMNS if column.symbol} | {
    "tangential_work": r"\int\,\bar{t}\,\mathrm{d}D",
    "tangential_loop_work": r"\int\,T\,\mathrm{d}D",
    "loop_area": r"\int\,\bar{p}\,\mathrm{d}\delta",
    "loop_work": r"\int\,F\,\mathrm{d}\delta",
    "largest_shear": r"\tau_\mathrm{max}",
    "shear_on_plane": r"\tau_z",
    "leak_rate": "Q",
    "pressure_drop": r"\Delta P",
}
# Words on an axis, where the first part of the meaning is too long for it, or is no name.
WORDS = {
    "contact_area": "contact area / nominal area",
    "contact_area_interpolated": "contact area / nominal area",
    "contact_area_error": "error of the contact area",
    "mean_pressure": "mean pressure",
    "mean_stress": "mean pressure",
    "area_error": "error of the contact area",
    "attractive_area": "attracted area / nominal area",
    "attracted_area": "attracted area",
    "energy_residual": "residual of the energies",
    "residual": "residual of the contact problem",
    "stick_area": "sticking area",
    "yielded_area": "yielded area",
    "tangential_displacement": "tangential displacement",
    "drag_force": "drag",
    "creepage": "creepage",
    "lateral_creepage": "lateral creepage",
    "friction": "friction coefficient",
    "interface_friction": "friction of the interface",
    "hysteresis_friction": "friction by hysteresis",
    "friction_body": "friction by the body",
    "friction_counterbody": "friction by the counterbody",
    "leak_rate": "leak rate",
    "pressure_drop": "pressure drop",
    "shift_factor": "shift factor",
    "flow_bruggeman": "flow by Bruggeman's medium",
    "flow_xx": "flow along x",
    "flow_xy": "flow along x by a drop along y",
    "flow_yy": "flow along y",
    "hydraulic_gap_x": "hydraulic gap along x",
    "hydraulic_gap_y": "hydraulic gap along y",
    "critical_gap_x": "critical gap along x",
    "critical_gap_y": "critical gap along y",
    "throat_points_x": "points across the throat, x",
    "throat_points_y": "points across the throat, y",
    "spot_radius": "radius of an equal spot",
    "resistance": "resistance",
    "transforms": "pairs of transforms",
    "rejected": "rejected attempts",
    "displacement": "displacement",
    "pressure": "pressure",
    "depth": "depth",
    "force": "force",
    "gap": "gap",
    "traction": "traction",
    "stress_zz": "normal stress along z",
    "slip_velocity_x": "slip velocity along x",
    "slip_velocity_y": "slip velocity along y",
    "displacement_body": "displacement of the body",
    "displacement_counterbody": "displacement of the counterbody",
    "shear_x": "shear traction along x",
    "shear_y": "shear traction along y",
    "accuracy_balance": "largest open energy / largest work",
    "restick": "time of the next sticking",
    "snapshot": "time",
    "x": "",
    "y": "",
}  # fmt: skip
Labels = Literal["words", "symbols"]
_labels: ContextVar[Labels] = ContextVar("labels", default="words")


@contextmanager
def labelled(labels: Labels) -> Iterator[None]:
    """Write words with the symbol behind on axes and bars within the block, or symbols alone."""
    before = _labels.set(labels)
    try:
        yield
    finally:
        _labels.reset(before)


# Last parts of keys, inside a section that is swept as a whole -> symbol; KINDS have none.
SYMBOLS_OF_KEYS = {key.rpartition(".")[2]: symbol for key, (_, symbol) in reversed(SYMBOLS.items())}
KINDS = ("shape", "model", "kind", "law", "method")
MOST_LETTERS = 24

_ENTRIES = re.compile(r", (?![^\[]*\])")  # between entries, not inside of a list


def symbol(array: DataArray) -> str:
    """Return the symbol of a variable or swept key as mathtext, or its name in words if it has no symbol."""
    if "symbol" in array.attrs:
        return f"${mathtext(array.attrs['symbol'])}$"
    name = str(array.name).removesuffix(OVER_TIME)
    total = TOTALS.get(name)
    if total is not None and total.symbol and array.attrs.get("long_name") == total.long_name:
        return f"${total.symbol}$"  # an isolated contact has another one under the same name
    return f"${PAPER_SYMBOLS[name]}$" if name in PAPER_SYMBOLS else name.replace("_", " ")


def words_of(array: DataArray) -> str:
    """Return what an axis calls a variable or swept key; nothing where the symbol says it."""
    name = str(array.name).removesuffix(OVER_TIME)
    if name in WORDS and "key" not in array.attrs:
        return WORDS[name]
    said = str(array.attrs.get("long_name", ""))
    words = re.split(r",| \(", said, maxsplit=1)[0] or name.replace("_", " ")
    return f"{words}, {array.attrs['place']}" if "place" in array.attrs else words


def mathtext(plain: str) -> str:
    r"""Write a symbol of plain text, such as G_inf, nu_bulk or dt, as mathtext."""
    letter, _, index = plain.partition("_")
    if letter == "dt":
        letter = r"\Delta t"
    elif len(letter) > 1 and letter.isalpha():
        letter = f"\\{letter}"
    if len(index) > 1:
        parts = (r"\infty" if part == "inf" else rf"\mathrm{{{part}}}" for part in index.split(","))
        joined = ",".join(parts)
        index = f"{{{joined}}}" if "," in index else joined
    return f"{letter}_{index}" if index else letter


def value_labels(values: Sequence[object]) -> list[str]:
    """Write values for a legend, all in the same way: 1/32 if all are whole or plain fractions.

    Numbers of more than five digits are rounded to those that tell the values apart. Infinity is written as
    its sign, large numbers with powers of ten. Text stays, except that a mapping such as "shape=parabola,
    radius=0.25" is shortened.
    """
    if any(isinstance(value, str) for value in values):
        return _short([str(value) for value in values])
    numbers = [float(str(value)) for value in values]
    fractions = [_fraction(number) for number in numbers if math.isfinite(number)]
    is_fractional = None not in fractions and any(
        fraction is not None and fraction.denominator not in (1, 2, 4) for fraction in fractions
    )
    digits = _digits(numbers)
    return [_number_label(number, is_fractional, digits) for number in numbers]


def _digits(numbers: Sequence[float]) -> int:
    """Return the digits that tell values apart: three, or more where these do not, or suffice for all."""
    texts = {digits: [f"{number:.{digits}g}" for number in numbers] for digits in range(3, 7)}
    if all(float(text) == float(longest) for text, longest in zip(texts[5], texts[6], strict=True)):
        return 6
    return next((digits for digits in texts if len(set(texts[digits])) == len(set(texts[6]))), 6)


def _short(texts: Sequence[str]) -> list[str]:
    """Write mappings as "parabola $R$ = 0.25", without entries that are the same in all of them."""
    mappings = [dict(entry.partition("=")[::2] for entry in _ENTRIES.split(text)) for text in texts]
    in_all = set.intersection(*(set(mapping.items()) for mapping in mappings)) if len(texts) > 1 else set()
    found = []
    for text, mapping in zip(texts, mappings, strict=True):
        kinds = [value for key, value in mapping.items() if key in KINDS]
        entries = [(key, value) for key, value in mapping.items() if key not in KINDS]
        kept = [entry for entry in entries if entry not in in_all] or entries
        signs = {key: f"${mathtext(SYMBOLS_OF_KEYS[key])}$" for key, _ in kept if key in SYMBOLS_OF_KEYS}
        written = (f"{signs.get(key, key)} = {_short_value(value)}" for key, value in kept)
        found.append(" ".join([*kinds, ", ".join(written)]) if "=" in text else text)
    return found


def _short_value(value: str) -> str:
    """Write a number as `value_labels` does, and the first letters of a long list."""
    try:
        return value_labels([float(value)])[0]
    except ValueError:
        return value if len(value) <= MOST_LETTERS else f"{value[: MOST_LETTERS - 1]}…"


def _fraction(number: float) -> Fraction | None:
    """Return the plain fraction that a number stands for, or None."""
    fraction = Fraction(number).limit_denominator(1024)
    is_binary = fraction.denominator & (fraction.denominator - 1) == 0
    has_many_digits = len(repr(abs(number)).strip("0.")) > 10
    return fraction if float(fraction) == number and (is_binary or has_many_digits) else None


def _number_label(number: float, is_fractional: bool, digits: int = 6) -> str:
    if math.isinf(number):
        return r"$\infty$" if number > 0 else r"$-\infty$"
    if is_fractional:
        return str(_fraction(number))
    number = float(f"{number:.{digits}g}") if abs(number) < 10 ** (digits - 1) else number
    mantissa, _, exponent = f"{number:.6g}".partition("e")
    if not exponent and (abs(number) < 1e4 or number % 1000):
        return mantissa
    mantissa, _, exponent = f"{number:.5e}".partition("e")
    mantissa = mantissa.rstrip("0").rstrip(".")
    power = f"10^{{{int(exponent)}}}"
    return f"${power}$" if mantissa == "1" else rf"${mantissa}\times {power}$"


SCALES = {"length": ("L", "L"), "pressure": ("G0", "G_0"), "time": ("tau", r"\tau")}
MEANINGS = {"L": "period along x", "G_0": "relaxed shear modulus", r"\tau": "relaxation time"}
PREFIXES = {-18: "a", -15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
_POWERS = {prefix: power for power, prefix in PREFIXES.items()} | {"u": -6, "μ": -6}
# Magnitudes that are written as they are: in units that take a prefix, and others.
WITH_PREFIX, PLAIN = (1e-1, 1e3), (1e-2, 1e5)
SHORT_TICK = 4  # letters
SPAN_OF_ROUND = 3.0  # of a logarithmic axis, in which there may be only one multiple of a power of ten
DECADES = 1e4  # values within it have the same prefix in a legend

_FACTOR = re.compile(r"(/?)\s*([^\s/*^()]+)(?:\^(-?\d+))?")
_LEADING = re.compile(r"([afpnuµμmkMGT]?)(m|Pa|s|N|J)(?:\^(\d))?(?![\w^])")


class Quantity(NamedTuple):
    """A quantity in a picture: its symbol over the scale, its unit, the value of the scale, a power of ten.

    Every axis, colour bar, legend and title is written here. The power of ten is a prefix of the unit where
    it takes one; the EngFormatter of matplotlib writes a prefix at each tick, and knows neither mm nor m^2.
    """

    symbol: str
    unit: str = ""  # as in the files: um, N/m, m^2
    scale: float = 1.0
    power: int = 0  # of ten, of the written numbers
    words: str = ""  # before the symbol, where axes have words

    def fit(self, values: Iterable[float]) -> Quantity:
        """Return it with the power of ten of values, which are already divided by the scale."""
        return self._replace(power=power_of_ten(values, self.unit))

    @property
    def label(self) -> str:
        """Label of an axis: words, symbol and unit, "displacement $u$ (µm)", or the latter two."""
        words = f"{self.words} " if self.words and _labels.get() == "words" else ""
        unit = prefixed(self.unit, self.power)
        if unit is None:
            unit = rf"$10^{{{self.power}}}$ {self.unit}".rstrip()
        return f"{words}{self.symbol} ({mathtext_units(unit)})" if unit else f"{words}{self.symbol}"

    def numbers(self, values: Sequence[Any]) -> list[str]:
        """Write values for ticks, in the power of ten of the label; fractions are for pure numbers."""
        if self.unit and not any(isinstance(value, str) for value in values):
            scaled = [float(value) / 10.0**self.power for value in values]
            return [_number_label(each, is_fractional=False, digits=_digits(scaled)) for each in scaled]
        if self.power:
            values = [float(f"{value / 10.0**self.power:.12g}") for value in values]
        return value_labels(values)

    def equals(self, values: Sequence[Any]) -> list[str]:
        """Write that it has each of some values, "$d$ = 2 µm": with one prefix, or each with its own."""
        sizes = [abs(value) for value in values if isinstance(value, int | float) and math.isfinite(value)]
        sizes = [size for size in sizes if size] or [1.0]
        if max(sizes) > DECADES * min(sizes) and prefixed(self.unit, power_of_ten(sizes, self.unit)):
            return [text for value in values for text in self.equals([value])]
        drawn = self.fit(sizes)
        unit = prefixed(self.unit, drawn.power)
        if not unit:
            drawn, unit = self._replace(power=0), self.unit
        ends = ("" if value in (math.inf, -math.inf) else mathtext_units(unit) for value in values)
        texts = zip(drawn.numbers(values), ends, strict=True)
        return [f"{self.symbol} = {number} {end}".rstrip() for number, end in texts]


def quantity(array: DataArray, scales: Mapping[str, Any] = MappingProxyType({})) -> Quantity:
    """Return how a variable, coordinate or swept key of results is drawn.

    Its attribute `units` is "m", say, or a product of length, pressure and time; `scales` has L, G0 and tau.
    Swept keys keep the numbers of the configuration.
    """
    factors, sign = _factors(str(array.attrs.get("units", "1"))), symbol(array)
    words = words_of(array)
    if not sign.startswith("$"):
        sign, words = words if _labels.get() == "words" else sign, ""
    if not factors.keys() <= SCALES.keys():
        return Quantity(sign, str(array.attrs["units"]), words=words)
    if "key" in array.attrs or any(SCALES[factor][0] not in scales for factor in factors):
        return Quantity(sign, words=words)
    scale = math.prod(float(scales[SCALES[factor][0]]) ** power for factor, power in factors.items())
    divided = _over(sign, {SCALES[factor][1]: power for factor, power in factors.items()})
    return Quantity(divided, "", scale, words=words)


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
    if not scales:
        return written
    parts: dict[bool, list[str]] = {True: [], False: []}
    for scale, power in scales.items():
        parts[power > 0].append(scale if abs(power) == 1 else f"{scale}^{{{abs(power)}}}")
    times, by = r"\,".join(parts[False]), r"\,".join(parts[True])
    quotient = f"{times}/({by})" if len(parts[True]) > 1 else f"{times}/{by}" if by else times
    return f"{written[:-1]}{quotient}$" if written.endswith("$") else f"{written} ${quotient}$"


def mathtext_units(units: str) -> str:
    """Write powers in units, micro and degrees as in print."""
    units = units.replace("degrees Celsius", "°C")
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", re.sub(r"\bu(?=m\b|s\b|Pa\b|N\b)", "µ", units))


def prefixed(unit: str, power: int) -> str | None:
    """Return the unit that is a power of ten larger: mm/s for 1e-3 m/s, mm^2 for 1e-6 m^2; or None."""
    if not power:
        return unit
    if (first := _LEADING.match(unit)) is None:
        return None
    own, base, times = first[1], first[2], int(first[3] or 1)
    found = PREFIXES.get(_POWERS[own] + power // times) if power % times == 0 else None
    if found is None or (base == "s" and found in PREFIXES.values() and _POWERS[found] > 0):
        return None
    return f"{found}{unit[len(own) :]}"


def power_of_ten(values: Iterable[float], unit: str = "") -> int:
    """Return the power of ten to be written with the unit of values, by the largest; 0 for most."""
    largest = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    first = _LEADING.match(unit)
    low, high = WITH_PREFIX if first else PLAIN
    if largest == 0 or low <= largest < high:
        return 0
    step = 3 * int(first[3] or 1) if first else 3
    room = step // 3 - 1  # a prefix of m^2 has six decades: numbers from 0.1 to 1e5
    return step * math.floor((math.log10(largest) + room) / step + 1e-9)


class Ticks(Formatter):
    """Ticks of a quantity, in the power of ten that is written with its unit."""

    def __init__(self, drawn: Quantity, *, is_log: bool = False) -> None:
        self.quantity, self.is_log = drawn, is_log

    def __call__(self, value: float, pos: int | None = None) -> str:  # noqa: ARG002
        """Write a single tick."""
        return self.format_ticks([value])[0]

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """Write all ticks with the digits that one of them needs; on a logarithmic axis each with its own."""
        if self.is_log:
            return [_number_label(value / 10.0**self.quantity.power, is_fractional=False) for value in values]
        shown = [f"{value / 10.0**self.quantity.power:.10g}" for value in values]
        if any("e" in text for text in shown):
            return [_number_label(float(text), is_fractional=False) for text in shown]
        digits = max((len(text.partition(".")[2]) for text in shown), default=0)
        return [f"{float(text) + 0.0:.{digits}f}".replace("-", "\N{MINUS SIGN}") for text in shown]


def label_places(axis: Axis, places: Sequence[int], labels: Sequence[str]) -> None:
    """Label places in their order; long words along x are broken after the first, smaller, or upright."""
    if isinstance(axis, XAxis) and max(map(len, labels), default=0) * len(labels) > MOST_LETTERS:
        labels = [label.replace(" ", "\n", 1) for label in labels]
        longest = max(len(line) for label in labels for line in label.split("\n"))
        letters = longest * len(labels)
        axis.set_tick_params(rotation=90 if letters > 3 * MOST_LETTERS else 0)
        if letters > 1.5 * MOST_LETTERS:
            axis.set_tick_params(labelsize="small")
    axis.set_ticks(places, labels)
    axis.set_ticks([], minor=True)


def name_axes(axes: Axes, x: Quantity | None = None, y: Quantity | None = None) -> None:
    """Write the quantities along the axes of a panel, whose scales and shared axes are set before."""
    for axis, drawn in ((axes.xaxis, x), (axes.yaxis, y)):
        if drawn is not None:
            axis.set_label_text(drawn.label)
            if axis.get_scale() == "linear":
                axis.set_major_formatter(Ticks(drawn))
            else:
                _round_ticks(axis, drawn)


def _round_ticks(axis: Axis, drawn: Quantity) -> None:
    """Label a logarithmic axis of up to three decades at round numbers, without powers of ten."""
    low, high = axis.get_view_interval()
    axis.set_minor_formatter(NullFormatter())
    if high / low <= 1e3:
        subs = range(1, 10) if high / low <= 4 else (1, 2, 5) if high / low <= 100 else (1,)
        axis.set_major_locator(LogLocator(subs=subs) if high / low > SPAN_OF_ROUND else MaxNLocator(5))
        axis.set_major_formatter(Ticks(drawn, is_log=True))


def finish(figure: Figure, notes: Sequence[str] = ()) -> None:
    """Write notes below a finished figure, and into the labels of its axes the prefixes of their units."""
    insets = [inset for axes in figure.axes for inset in axes.child_axes if isinstance(inset, type(axes))]
    for axes in [*figure.axes, *insets]:
        for axis in (axes.xaxis, axes.yaxis):
            # Panels that share an axis share its ticks; not all of them have a label.
            if isinstance(ticks := axis.get_major_formatter(), Ticks):
                ticks.quantity = ticks.quantity.fit(axis.get_view_interval())
                axis.set_label_text(ticks.quantity.label if axis.get_label_text() else "")
        _part_ticks(axes.xaxis)
        _part_label(axes)
    if notes:
        lines = _lines(notes, figure.get_figwidth())
        if len(lines) > _MOST_LINES and any(map(is_warning, notes)):
            others = [note for note in notes if not is_warning(note)]
            lines = _lines([*others, "with warnings, see status or report"], figure.get_figwidth())
        # More lines make the figure taller, not its panels smaller.
        line = _LINE * float(rcParams["font.size"]) * font_scalings["small"] / 72
        figure.set_figheight(figure.get_figheight() + line * max(0, len(lines) - _MOST_LINES))
        text = "\n".join(lines)
        figure.supxlabel(text, x=0.01, ha="left", fontsize="small", color="0.3")


def is_warning(note: str) -> bool:
    """Whether a note is a warning of the run."""
    return note.startswith("warning: ") or "more warning" in note


_WIDTH = 0.55  # of a letter, relative to the height of the font
_LINE = 1.2  # likewise, of a line
_MOST_LINES = 3  # with warnings: panels stay legible


def _part_ticks(axis: XAxis) -> None:
    """Take fewer ticks of a linear axis where they are so long that they would run together."""
    ticks = axis.get_major_formatter()
    if isinstance(ticks, Ticks) and not (ticks.is_log or isinstance(axis.get_major_locator(), FixedLocator)):
        longest = max(map(len, ticks.format_ticks(axis.get_majorticklocs().tolist())), default=0)
        if longest > SHORT_TICK:
            # By the axis there is a tick for every 3 heights of a letter; the layout will shorten the axis.
            room = 0.7 * 3.0 * axis.get_tick_space()
            axis.set_major_locator(
                MaxNLocator(max(2, int(room / (0.65 * longest + 1.0))), steps=[1, 2, 5, 10])
            )


def _part_label(axes: Axes) -> None:
    """Break labels that are longer than their axis; three lines are smaller."""
    window, points = axes.get_window_extent(), 72 / axes.figure.dpi
    for label, length in ((axes.xaxis.label, window.width), (axes.yaxis.label, window.height)):
        room = max(length * points / (_WIDTH * float(label.get_fontsize())), SHORT_TICK)
        if _letters(label.get_text()) <= room:
            continue
        lines = [""]
        for word in label.get_text().split():
            longer = f"{lines[-1]} {word}".lstrip()
            lines[-1:] = [longer] if _letters(longer) <= room or not lines[-1] else [lines[-1], word]
        label.set_text("\n".join(lines))
        if len(lines) > 2:
            label.set_fontsize("small")


def explained(case: Dataset, names: Sequence[str], written: Iterable[str] = ()) -> list[str]:
    """Return notes on symbols: of variables, of swept keys in the texts, of scales that divide them.

    The coordinates x and snapshot of a variable have scales too.
    """
    text = " ".join(written)
    keys = [str(name) for name, key in case.coords.items() if "key" in key.attrs and symbol(key) in text]
    variables = [case[name] for name in dict.fromkeys([*names, *keys]) if name in case]
    known = [variable for variable in variables if "long_name" in variable.attrs]
    # An axis has the words; a legend the symbol alone.
    said_there = (
        [] if _labels.get() == "symbols" else [words_of(case[name]) for name in names if name in case]
    )
    parts = [
        f"{symbol(variable)}: {_meaning(variable)}"
        for variable in known
        if symbol(variable).startswith("$")
        and (_meaning(variable) not in said_there or symbol(variable) in text)
    ]
    along = [case[name] for name in ("snapshot", "x") if any(name in variable.dims for variable in variables)]
    scales = [
        quantity(variable, case.attrs).symbol.removeprefix(symbol(variable).rstrip("$"))
        for variable in [*known, *along]
    ]
    scales += ["G_0" for part in parts if "G_0)" in part]  # of the mean pressure over 2 G0
    used, said = " ".join(scales), {part.partition(":")[0] for part in parts}
    return parts + [
        f"${sign}$: {meaning}"
        for sign, meaning in MEANINGS.items()
        if f"${sign}$" not in said and sign in used
    ]


def _meaning(array: DataArray) -> str:
    """Return the first part of a long name, its symbols as in the figures."""
    words = str(array.attrs["long_name"]).partition(",")[0].removesuffix(" atilde").removesuffix(" pbar")
    return words.replace("ptilde = pbar / (2 G0)", r"$\bar{p}/(2G_0)$")


def _lines(notes: Sequence[str], inches: float) -> list[str]:
    """Fill lines with notes."""
    room = inches * 72 / (_WIDTH * rcParams["font.size"] * font_scalings["small"])
    lines = [""]
    for note in notes:
        whole = _letters(note) <= room or "$" in note
        first, *rest = [note] if whole else textwrap.wrap(note, int(room))
        longer = f"{lines[-1]}; {first}" if lines[-1] else first
        lines[-1:] = [longer] if _letters(longer) <= room or not lines[-1] else [lines[-1], first]
        lines += rest
    return lines


def _letters(text: str) -> int:
    return len(re.sub(r"\\[a-z]+|[${}]", "", text))
