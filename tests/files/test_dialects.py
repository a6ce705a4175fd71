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

from gfmdlayer.files.tables import Answers, TableError, read_table

TURN = Fraction(2 * math.pi)
PSI = Fraction("4.4482216152605") / Fraction("0.0254") ** 2
UNITS: dict[str, dict[str, Any]] = {
    "time": {"s": 1, "ms": "1e-3", "us": "1e-6", "µs": "1e-6", "min": 60, "h": 3600, "sec": 1, "seconds": 1,
    "ns": "1e-9"},
    "angular": {"rad/s": 1, "1/s": 1, "s^-1": 1, "s⁻¹": 1, "rad·s⁻¹": 1, "rad s-1": 1, "krad/s": None,
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
    "wavenumber": {"1/m": 1, "1/um": "1e6", "µm^-1": "1e6", "nm⁻¹": "1e9", "rad/m": None, "1/mm": "1e3"},
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
    "tangential force": ("force", "tangential force|Friction force|Tangentialkraft|Q|Ft|Reibkraft|lateral force"),
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


def write(seed: int) -> Written:
    """Write a random table in a random dialect."""
    r = np.random.default_rng(seed)

    def pick(items: Any) -> Any:
        return items[int(r.integers(len(items)))]

    def chance(p: float) -> bool:
        return bool(r.random() < p)

    wanted = list(pick(FILES))
    encoding = pick(["utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
    separator = pick([",", ";", "\t", "|", "  ", " ", ", ", "; "])
    decimal = "." if separator.strip() == "," and chance(0.8) else pick([".", ","])
    quoted = separator.strip() == "," and decimal == ","
    thousands = pick(["", "", "", "", "", "", "'", "." if decimal == "," else ",", "\u00a0", "\u202f"])
    if (separator.isspace() and thousands in {"\u00a0", "\u202f"}) or (
        thousands == "\u202f" and encoding == "cp1252"
    ):
        thousands = ""
    quoted = quoted or (separator.strip() == "," and thousands == ",")
    style = pick(["fixed", "short", "scientific", "E+00", "fortran", "three"])
    rows = int(r.integers(3, 30))

    def number(x: float) -> tuple[str, Fraction]:
        text = {"fixed": f"{x:.5f}", "short": f"{x:.6g}", "scientific": f"{x:.6e}", "E+00": f"{x:.4E}",
                "fortran": f"{x:.5e}".replace("e", "D"), "three": f"{x:.3f}"}[style]  # fmt: skip
        value = Fraction(text.replace("D", "e"))
        head, _, tail = text.partition(".")
        whole = head.lstrip("-")
        if thousands and whole.isdigit() and len(whole) > 3:
            head = "-" * head.startswith("-") + f"{int(whole):,}".replace(",", thousands)
        return (head + decimal + tail if "." in text else text.replace(".", decimal)), value

    places = pick(["[]", "()", "/", "in", "row", "row", "[row]", ",", "_", "none"])
    if places == "," and separator.strip() == ",":
        places = "[]"
    doubt = "no units" if places == "none" else ""
    columns: list[tuple[str, str, list[str]]] = []  # heading, unit, cells
    values: dict[str, list[Fraction]] = {}
    holes: dict[str, set[int]] = {}
    order = r.permutation(rows) if wanted[0] not in {"time"} else np.arange(rows)
    for quantity in [wanted[i] for i in r.permutation(len(wanted))]:
        kind, names = NAMES[quantity]
        unit = pick(
            [name for name, size in UNITS[kind].items() if size is not None and encodable(name, encoding)]
        )
        if places in {"_", "none"} and kind == "temperature":
            unit = "K"
        size = Fraction(UNITS[kind][unit])
        name = pick([name for name in names.split("|") if encodable(name, encoding)])
        x = (
            np.sort(r.uniform(0, 10 ** r.uniform(0, 4), rows))
            if quantity == wanted[0]
            else r.normal(0, 500, rows)
        )
        cells, exact = map(list, zip(*(number(float(value)) for value in x[order]), strict=True))
        offset = Fraction("273.15") if kind == "temperature" and unit != "K" else Fraction(0)
        holes[quantity] = set()
        if quantity != wanted[0] and chance(0.15):
            word = pick(
                [
                    "nan",
                    "NaN",
                    "n/a",
                    "--",
                    "---",
                    "***",
                    "Bad",
                    "#NV",
                    "-",
                    *([] if separator.isspace() else [""]),
                ]
            )
            holes[quantity] = set(np.flatnonzero(r.random(rows) < 0.2).tolist()) if rows > 4 else set()
            cells = [word if i in holes[quantity] else cell for i, cell in enumerate(cells)]
        values[quantity] = [value * size + offset for value in exact]
        columns.append((name, unit, cells))
    if places in {"_", "/"} and any("/" in unit or " " in unit for _, unit, _ in columns):
        places = "()"
    for heading, unit, what in OTHERS:
        if chance(0.08):
            word = pick(["ok", "hold", "WMa", "load"] if separator.isspace() else ["ok", "Pre Shear", "a b"])
            cells = {"count": [str(i + 1) for i in range(rows)], "words": [word] * rows,
                     "numbers": [number(v)[0] for v in r.uniform(1, 9, rows)],
                     "dates": ["2024-03-12"] * rows}[what]  # fmt: skip
            columns.insert(int(r.integers(len(columns) + 1)), (heading, unit, cells))
    spaced = separator == " "

    def heading(name: str, unit: str) -> str:
        between = "_" if spaced else pick(["", " "])
        if unit in {"", "-"} or places in {"row", "[row]", "none"}:
            shown = name
        elif places in {"[]", "()"}:
            shown = f"{name}{between}{places[0]}{unit}{places[1]}"
        elif places == "in":
            shown = f"{name} in {unit}"
        else:
            shown = {"/": f"{name}/{unit}", ",": f"{name}, {unit}", "_": f"{name}_{unit}"}[places]
        return shown.replace(" ", "_") if spaced else shown

    def cell(text: str, number: bool = False) -> str:
        if (number and quoted) or (separator.strip() and separator.strip() in text):
            return '"' + text.replace('"', '""') + '"'
        return text

    def joined(cells: list[str]) -> str:
        return separator.join(cells) if separator != "  " else "   ".join(f"{text:<12}" for text in cells)

    trailing = separator.strip() if separator.strip() in {",", ";"} and chance(0.15) else ""
    head = [joined([cell(heading(name, unit)) for name, unit, _ in columns]) + trailing]
    if places in {"row", "[row]"}:
        units = [unit.replace(" ", ".") if spaced else unit for _, unit, _ in columns]
        units = [
            f"[{unit}]" if places == "[row]" and unit else unit or ("-" if separator.isspace() else "")
            for unit in units
        ]
        head.append(joined([cell(unit) for unit in units]) + trailing)
    mark = pick(["#", "%", "//"])
    if chance(0.2):
        head = [f"{mark} {line}" for line in head]
    lines = []
    if chance(0.4):
        remarks = [pick(REMARKS).format(d=decimal) for _ in range(int(r.integers(1, 7)))]
        lines = [f"{mark} {line}" if chance(0.5) else line for line in remarks if encodable(line, encoding)]
        lines += [""] * chance(0.6)
    lines += head
    written = Written(b"", values, holes, doubt, encoding=encoding, separator=separator, decimal=decimal)
    for i in range(rows):
        if chance(0.03):
            lines.append(pick(["", f"{mark} a remark"]))
        written.line_of_row.append(len(lines))
        lines.append(
            joined([cell(cells[i], "0" <= cells[i][-1:] <= "9") for _, _, cells in columns]) + trailing
        )
    if chance(0.1):
        lines += ["", pick(["End of data", f"{mark} end"])]
    end = pick(["\n", "\r\n", "\r"])
    written.text = end.join([*lines, ""] if chance(0.8) else lines)
    shown = "\n".join(lines[written.line_of_row[0] :])
    if decimal == "," and not quoted and not any(certain(text) for _, _, cells in columns for text in cells):
        written.doubt = "1,234"
    if decimal == "." and separator.strip() == ";" and "." in shown:
        if not any(certain(text, ".") for _, _, cells in columns for text in cells):
            written.doubt = "1.234"
    if thousands and not any(
        thousands in text and decimal in text for _, _, cells in columns for text in cells
    ):
        written.doubt = (
            "thousands"
            if any(thousands in text for _, _, cells in columns for text in cells)
            else written.doubt
        )
    written.data = written.text.encode(encoding)
    return written


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
    """Compare: text to double, ratio of units and offset are each rounded once, 3 half units of the last place."""
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
        except TableError as error:
            refused += 1
            assert "table.csv" in str(error)
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
    lines[at] = between.join(cells)
    return Written("\n".join(lines).encode(written.encoding), written.values, written.holes)
