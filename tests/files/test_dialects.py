"""Tables of one content in random dialects are read to the last digit that is written, or refused.

The generator knows the numbers as decimal fractions and the units as exact ratios; names and units here are
written down a second time, apart from the vocabulary of the package.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from gfmdlayer.files.tables import TableError, read_table

TURN = Fraction(2 * math.pi)
PSI = Fraction("4.4482216152605") / Fraction("0.0254") ** 2
UNITS: dict[str, dict[str, Any]] = {
    "time": {"s": 1, "ms": "1e-3", "us": "1e-6", "µs": "1e-6", "min": 60, "h": 3600, "sec": 1, "seconds": 1,
    "ns": "1e-9"},
    "angular": {"rad/s": 1, "1/s": 1, "s^-1": 1, "s⁻¹": 1, "rad·s⁻¹": 1, "rad s-1": 1,
    "rpm": TURN / 60},
    "frequency": {"Hz": 1, "mHz": "1e-3", "kHz": "1e3", "MHz": "1e6"},
    "modulus": {"Pa": 1, "kPa": "1e3", "MPa": "1e6", "GPa": "1e9", "N/m²": 1, "N/mm^2": "1e6",
    "N mm⁻²": "1e6",
                "dyn/cm²": "0.1", "psi": PSI, "bar": "1e5", "kgf/cm²": "98066.5", "hPa": 100,
                "kN/m^2": "1e3"},
    "compliance": {"1/Pa": 1, "MPa^-1": "1e-6", "Pa⁻¹": 1, "mm²/N": "1e-6", "cm²/dyn": 10},
    "length": {"m": 1, "mm": "1e-3", "µm": "1e-6", "μm": "1e-6", "um": "1e-6", "nm": "1e-9", "pm": "1e-12",
    "micron": "1e-6",
               "Å": "1e-10", "in": "0.0254", "cm": "1e-2", "nanometers": "1e-9"},
    "force": {"N": 1, "mN": "1e-3", "µN": "1e-6", "nN": "1e-9", "pN": "1e-12", "kN": "1e3",
    "gf": "9.80665e-3", "dyn": "1e-5"},
    "velocity": {"µm/s": "1e-6", "mm/s": "1e-3", "nm/s": "1e-9", "m/s": 1, "mm/min": Fraction(1, 60000),
    "um s^-1": "1e-6",
                 "nm/ms": "1e-6"},
    "voltage": {"V": 1, "mV": "1e-3", "kV": "1e3"},
    "temperature": {"°C": 1, "degC": 1, "C": 1, "K": 1},
    "stiffness": {"Pa/m": 1, "MPa/um": "1e12", "N/m^3": 1, "kPa/nm": "1e12", "MPa µm^-1": "1e12",
    "N/mm³": "1e9"},
    "wavenumber": {"1/m": 1, "1/um": "1e6", "µm^-1": "1e6", "nm⁻¹": "1e9", "1/mm": "1e3"},
    "ratio": {"-": 1, "1": 1, "%": "0.01"},
}  # fmt: skip
SI = {
    "time": "s", "angular": "rad/s", "frequency": "Hz", "modulus": "Pa", "compliance": "1/Pa", "length": "m",
    "force": "N", "velocity": "m/s", "voltage": "V", "temperature": "K", "stiffness": "Pa/m",
    "wavenumber": "1/m",
    "ratio": "1",
}  # fmt: skip
# Quantity: kind of unit, and names.
NAMES = {
    "time": ("time", "time|Time|t|Zeit|TIME|Elapsed Time|Temps|Messzeit|Prüfzeit|Test Time"),
    "depth": ("length", "depth|Depth|Indentation|Eindringtiefe|indentation depth|d|Weg|Profondeur|Penetration"
              "|displacement|h|Tiefe|Enfoncement"),
    "force": ("force", "force|Force|F|Kraft|Load|Normal Force|Last|Normalkraft|Effort|P"),
    "mean pressure": ("modulus", "mean pressure|Pressure|p|Druck|load|Pression moyenne|Flächenpressung"),
    "velocity": ("velocity", "velocity|v|Geschwindigkeit|Speed|Vitesse|sliding velocity"),
    "voltage": ("voltage", "voltage|Voltage|U|Spannung|bias|V|Tension"),
    "temperature": ("temperature", "temperature|T|Temperatur|Temp.|Température|TEMP"),
    "displacement": ("length", "displacement|x|tangential displacement|Verschiebung|Weg|Déplacement|disp"),
    "tangential force": ("force", "tangential force|Friction force|Tangentialkraft|Q|Ft|Reibkraft"),
    "speed": ("velocity", "speed|v|slip speed|Sliding Speed|Gleitgeschwindigkeit|vitesse de glissement"),
    "coefficient": ("ratio", "coefficient|mu|COF|Reibungskoeffizient|friction coefficient|µ|Reibzahl"),
    "wavenumber": ("wavenumber", "q|wavenumber|k|Wellenzahl|Wave number|wavevector"),
    "stiffness": ("stiffness", "K|stiffness|Steifigkeit|Raideur|Stiffness"),
    "radius": ("length", "r|radius|Radius|R|Rayon"),
    "height": ("length", "height|h|z|Höhe|Hauteur|profile"),
    "angular frequency": ("angular", "omega|ω|Angular Frequency|Kreisfrequenz|ang. frequency|w|Pulsation"),
    "frequency": ("frequency", "f|Frequency|Frequenz|freq|Fréquence|FREQ."),
    "G'": ("modulus", "G'|G′|Gp|G_stor|G prime|Shear storage modulus|G' storage modulus"),
    "G''": ("modulus", "G''|G\"|G″|Gpp|G_loss|G double prime|Shear loss modulus"),
    "E'": ("modulus", "E'|E′|E_stor|Tensile storage modulus"),
    "E''": ("modulus", "E''|E\"|E″|E_loss|Tensile loss modulus"),
    "tan delta": ("ratio", "tan delta|tan(δ)|tan d|tand|Loss Factor|Verlustfaktor"),
    "J(t)": ("compliance", "J(t)|J|shear compliance"),
    "G(t)": ("modulus", "G(t)|G|Shear relaxation modulus"),
}  # fmt: skip
FILES = [
    ("time", "depth"), ("time", "mean pressure"), ("time", "force"), ("time", "velocity"), ("time",
    "voltage"),
    ("time", "temperature"), ("time", "displacement"), ("time", "tangential force"), ("speed", "coefficient"),
    ("wavenumber", "stiffness"), ("radius", "height"), ("angular frequency", "G'", "G''"),
    ("frequency", "G'", "G''"), ("frequency", "E'", "tan delta"), ("angular frequency", "E'", "E''"),
    ("time", "J(t)"), ("time", "G(t)"), ("time", "depth", "force"),
]  # fmt: skip
OTHERS = [
    ("Point No.", "", "count"), ("Nr", "", "count"), ("Status", "", "words"), ("Channel 7", "V", "numbers"),
    ("Torque", "mNm", "numbers"), ("Comment", "", "words"), ("Date", "", "dates"),
]  # fmt: skip
REMARKS = [
    "Sample: PDMS 10:1, batch 3", "Operator: Müller", "Date: 2024-03-12 14:41:52", "Gap: 1{d}000 mm",
    "[Parameters]",
    "Temperature: 25{d}0 °C", "exported by the instrument", "Points: 24", "Versuch Nr. 7",
]  # fmt: skip


@dataclass
class Written:
    """A table in a dialect, and what it means."""

    data: bytes
    values: dict[str, list[Fraction]]  # in SI; those of holes are missing
    holes: dict[str, set[int]]
    doubt: str = ""  # why a reader cannot be certain
    line_of_row: list[int] = field(default_factory=list)
    text: str = ""
    encoding: str = "utf-8"
    separator: str = ","
    decimal: str = "."


class Dialect:
    """A random dialect."""

    def __init__(self, seed: int) -> None:
        self.r = np.random.default_rng(seed)
        self.encoding = self.pick(
            ["utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"]
        )
        self.separator = self.pick([",", ";", "\t", "|", "  ", " ", ", ", "; "])
        self.mark = self.separator.strip()
        self.decimal = "." if self.mark == "," and self.chance(0.8) else self.pick([".", ","])
        self.thousands = self.pick(
            ["", "", "", "", "", "", "'", ",.".replace(self.decimal, ""), "\u00a0", "\u202f"]
        )
        wide = {"\u00a0", "\u202f"} if not self.mark else {"\u202f"} if self.encoding == "cp1252" else {""}
        self.thousands = "" if self.thousands in wide else self.thousands
        self.quoted = self.mark == "," and "," in (self.decimal, self.thousands)
        self.style = self.pick([".5f", ".6g", ".6e", ".4E", ".3f", "D"])
        self.places = self.pick(["[]", "()", "/", "in", "row", "row", "[row]", ",", "_", "none"])
        if self.places == "," and self.mark == ",":
            self.places = "[]"
        self.comment = self.pick(["#", "%", "//"])
        self.trailing = self.mark if self.mark in {",", ";"} and self.chance(0.15) else ""

    def pick(self, items: Any) -> Any:
        """Return one of some items."""
        return items[int(self.r.integers(len(items)))]

    def chance(self, p: float) -> bool:
        """Whether an event of a probability happens."""
        return bool(self.r.random() < p)

    def number(self, x: float) -> tuple[str, Fraction]:
        """Return a number as it is written, and what that means."""
        text = f"{x:.5e}".replace("e", "D") if self.style == "D" else f"{x:{self.style}}"
        value = Fraction(text.replace("D", "e"))
        head, point, tail = text.partition(".")
        whole = head.lstrip("-")
        if self.thousands and whole.isdigit() and len(whole) > 3:
            head = "-" * head.startswith("-") + f"{int(whole):,}".replace(",", self.thousands)
        return head + self.decimal * bool(point) + tail, value

    def heading(self, name: str, unit: str) -> str:
        """Return a heading with its unit."""
        between = "_" if self.separator == " " else self.pick(["", " "])
        if unit in {"", "-"} or self.places in {"row", "[row]", "none"}:
            shown = name
        elif self.places in {"[]", "()"}:
            shown = f"{name}{between}{self.places[0]}{unit}{self.places[1]}"
        else:
            shown = name + {"/": "/", ",": ", ", "_": "_", "in": " in "}[self.places] + unit
        return shown.replace(" ", "_") if self.separator == " " else shown

    def unit(self, unit: str) -> str:
        """Return a unit in a row of its own."""
        unit = unit.replace(" ", ".") if self.separator == " " else unit
        return f"[{unit}]" if self.places == "[row]" and unit else unit or "" if self.mark else unit or "-"

    def line(self, cells: list[str]) -> str:
        """Join cells, those in quotes that need them."""
        for i, text in enumerate(cells):
            if (self.quoted and "0" <= text[-1:] <= "9") or (self.mark and self.mark in text):
                cells[i] = '"' + text.replace('"', '""') + '"'
        wide = self.separator == "  "
        return (
            "   ".join(f"{text:<12}" for text in cells) if wide else self.separator.join(cells)
        ) + self.trailing


Columns = list[tuple[str, str, list[str]]]  # heading, unit, cells


def write(seed: int) -> Written:
    """Write a random table in a random dialect."""
    dialect = Dialect(seed)
    written = Written(
        b"", {}, {}, encoding=dialect.encoding, separator=dialect.separator, decimal=dialect.decimal
    )
    columns = columns_of(dialect, written)
    lines = lines_above(dialect, columns)
    for i in range(len(columns[0][2])):
        if dialect.chance(0.03):
            lines.append(dialect.pick(["", f"{dialect.comment} a remark"]))
        written.line_of_row.append(len(lines))
        lines.append(dialect.line([cells[i] for _, _, cells in columns]))
    if dialect.chance(0.1):
        lines += ["", dialect.pick(["End of data", f"{dialect.comment} end"])]
    written.text = dialect.pick(["\n", "\r\n", "\r"]).join([*lines, ""] if dialect.chance(0.8) else lines)
    written.data = written.text.encode(dialect.encoding)
    written.doubt = doubt(dialect, [text for _, _, cells in columns for text in cells])
    return written


def columns_of(dialect: Dialect, written: Written) -> Columns:
    """Make the columns of a file, in any order, with others that nobody asks for; put their meaning down."""
    r, names = dialect.r, list(dialect.pick(FILES))
    rows = int(r.integers(3, 30))
    order = np.arange(rows) if names[0] == "time" else r.permutation(rows)
    columns: Columns = []
    for quantity in [names[i] for i in r.permutation(len(names))]:
        kind, headings = NAMES[quantity]
        sizes = {name: size for name, size in UNITS[kind].items() if encodable(name, dialect.encoding)}
        unit = "K" if kind == "temperature" and dialect.places in {"_", "none"} else dialect.pick([*sizes])
        size, offset = Fraction(sizes[unit]), Fraction("273.15") * (kind == "temperature" and unit != "K")
        heading = dialect.pick([name for name in headings.split("|") if encodable(name, dialect.encoding)])
        first = quantity == names[0]
        x = np.sort(r.uniform(0, 10 ** r.uniform(0, 4), rows)) if first else r.normal(0, 500, rows)
        cells, exact = map(list, zip(*(dialect.number(float(value)) for value in x[order]), strict=True))
        holes = set()
        if not first and rows > 4 and dialect.chance(0.15):
            word = dialect.pick(
                ["nan", "NaN", "n/a", "--", "---", "***", "Bad", "#NV", "-", "" if dialect.mark else "NA"]
            )
            holes = set(np.flatnonzero(r.random(rows) < 0.2).tolist())
            cells = [word if i in holes else cell for i, cell in enumerate(cells)]
        written.holes[quantity], written.values[quantity] = holes, [value * size + offset for value in exact]
        columns.append((heading, unit, cells))
    if dialect.places in {"_", "/"} and any({*"/ "} & {*unit} for _, unit, _ in columns):
        dialect.places = "()"
    for heading, unit, kind in OTHERS:
        if dialect.chance(0.08):
            word = dialect.pick(["ok", "Pre Shear", "a b"] if dialect.mark else ["ok", "hold", "WMa", "load"])
            cells = {"count": [str(i + 1) for i in range(rows)], "words": [word] * rows,
                     "numbers": [dialect.number(v)[0] for v in r.uniform(1, 9, rows)],
                     "dates": ["2024-03-12"] * rows}[kind]  # fmt: skip
            columns.insert(int(r.integers(len(columns) + 1)), (heading, unit, cells))
    return columns


def lines_above(dialect: Dialect, columns: Columns) -> list[str]:
    """Return remarks, headings and units."""
    head = [dialect.line([dialect.heading(name, unit) for name, unit, _ in columns])]
    if dialect.places in {"row", "[row]"}:
        head.append(dialect.line([dialect.unit(unit) for _, unit, _ in columns]))
    if dialect.chance(0.2):
        head = [f"{dialect.comment} {line}" for line in head]
    lines = []
    if dialect.chance(0.4):
        remarks = [
            dialect.pick(REMARKS).format(d=dialect.decimal) for _ in range(int(dialect.r.integers(1, 7)))
        ]
        lines = [f"{dialect.comment} {line}" if dialect.chance(0.5) else line for line in remarks]
        lines += [""] * dialect.chance(0.6)
    return lines + head


def doubt(dialect: Dialect, cells: list[str]) -> str:
    """Return why a reader cannot be certain of a table."""
    if dialect.thousands and any(dialect.thousands in text for text in cells):
        grouped = [text for text in cells if dialect.thousands in text]
        if not all(dialect.decimal in text for text in grouped):
            return "thousands"
    elif dialect.decimal == "," or dialect.mark == ";":
        marked = [text for text in cells if dialect.decimal in text]
        if marked and not any(certain(text, dialect.decimal) for text in marked):
            return f"1{dialect.decimal}234"
    return "no units" if dialect.places == "none" else ""


def encodable(text: str, encoding: str) -> bool:
    """Whether an encoding has all letters of a text."""
    return text == text.encode(encoding, errors="replace").decode(encoding)


def certain(text: str, mark: str = ",") -> bool:
    """Whether the mark in a number cannot separate thousands."""
    whole, found, part = text.lstrip("-").partition(mark)
    return bool(found) and (
        len(part) != 3 or not part.isdigit() or not 1 <= len(whole) <= 3 or whole[0] == "0"
    )


def read(path, written: Written) -> dict[str, np.ndarray]:
    """Read the table in SI; holes are NaN."""
    path.write_bytes(written.data)
    table = read_table(path, tuple(written.values))
    return {quantity: table.take(quantity, SI[NAMES[quantity][0]], holes=True) for quantity in written.values}


def check(found: dict[str, np.ndarray], written: Written) -> None:
    """Compare: text, ratio of units and offset are rounded once each, 3 half units of the last place."""
    for quantity, exact in written.values.items():
        expected = np.array([float(value) for value in exact])
        expected[list(written.holes[quantity])] = np.nan
        tolerance = 3 * np.spacing(np.maximum(np.abs(expected), 273.15 * (quantity == "temperature")))
        assert found[quantity].shape == expected.shape
        assert np.array_equal(np.isnan(found[quantity]), np.isnan(expected)), quantity
        assert np.all((np.abs(found[quantity] - expected) <= tolerance) | np.isnan(expected)), quantity


@pytest.mark.parametrize("first", range(0, 500, 50))
def test_a_table_in_a_random_dialect_is_read_to_the_last_digit_or_refused_where_it_is_uncertain(
    first, tmp_path
):
    for seed in range(first, first + 50):
        written = write(seed)
        if not written.doubt:
            check(read(tmp_path / "table.csv", written), written)
        else:
            try:
                found = read(tmp_path / "table.csv", written)
            except TableError:
                continue
            assert written.doubt == "no units", (seed, written.doubt)
            assert all(np.isfinite(values).any() for values in found.values())


DAMAGES = [
    "lost cell",
    "doubled cell",
    "letter",
    "less than",
    "infinite",
    "other mark",
    "row of text",
    "word",
]


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_table_is_refused_or_read_as_if_it_were_sound(damage, tmp_path):
    """Never other numbers: a damage in a column that is not read may pass."""
    refused = 0
    for seed in range(60):
        written = write(seed)
        if written.doubt:
            continue
        check_damaged = damaged(written, damage, seed)
        if check_damaged is None:
            continue
        try:
            check(read(tmp_path / "table.csv", check_damaged), written)
        except TableError:
            refused += 1
    assert refused > 20


def damaged(written: Written, damage: str, seed: int) -> Written | None:
    """Return the table with one damaged row."""
    r = np.random.default_rng(seed + 10_000)
    lines = written.text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    at = written.line_of_row[int(r.integers(len(written.line_of_row)))]
    between = {"  ": "   ", ", ": ",", "; ": ";"}.get(written.separator, written.separator)
    cells = lines[at].split() if between.strip(" ") == "" else lines[at].split(between)
    if '"' in lines[at]:
        return None
    numbers = [i for i, text in enumerate(cells) if text.strip().lstrip("-")[:1].isdigit()]
    i = int(r.choice(numbers))
    if damage == "lost cell":
        del cells[i]
    elif damage == "doubled cell":
        cells.insert(i, cells[i])
    elif damage == "letter":
        if "0" not in cells[i]:
            return None
        cells[i] = cells[i].replace("0", "O")
    elif damage == "other mark":
        if written.decimal not in cells[i]:
            return None
        cells[i] = cells[i].replace(written.decimal, "." if written.decimal == "," else ",")
    elif damage == "row of text":
        lines.insert(at, "Segment 2: hold")
        return Written("\n".join(lines).encode(written.encoding), written.values, written.holes)
    else:
        cells[i] = {"less than": f"<{cells[i].strip()}", "infinite": "inf", "word": "overflow"}[damage]
    if not "".join(cells).strip():
        return None
    lines[at] = between.join(cells)
    return Written("\n".join(lines).encode(written.encoding), written.values, written.holes)
