"""Tables of numbers in text files: what is fast, what is said of a file, what chooses where it is open."""

import numpy as np
import pytest

from gfmdlayer.files.headings import ANGULAR, ORDINARY, meaning
from gfmdlayer.files.tables import Answers, TableError, read_matrix, read_table
from gfmdlayer.files.units import unit_of


@pytest.fixture
def table(tmp_path):
    """Read a text as a table of quantities."""

    def read(text, *wanted, **answers):
        path = tmp_path / "table.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_table(path, wanted or ("time", "depth"), Answers(**answers))

    return read


def test_plain_rows_are_read_by_numpy_whatever_their_decimal_mark(table, monkeypatch):
    """By NumPy's reader: a million rows take a second, and ten by the reader of single cells."""
    rows = [(i, i / 7) for i in range(1000)]
    for between, mark in ((", ", "."), (" ", "."), (";", ","), ("\t", ",")):
        text = "time depth\n" + "".join(f"{i}{between}{x}\n".replace(".", mark) for i, x in rows)
        calls = 0
        plain = np.loadtxt

        def counted(*given, **options):
            nonlocal calls
            calls += 1
            return plain(*given, **options)  # noqa: B023

        monkeypatch.setattr(np, "loadtxt", counted)
        found = table(text)
        monkeypatch.undo()
        assert calls == 1
        assert np.array_equal(np.transpose([found.take("time"), found.take("depth")]), rows)


@pytest.mark.parametrize(
    ("text", "size", "dimension"),
    [
        ("nm", "1e-9", "m"), ("µm", "1e-6", "m"), ("Å", "1e-10", "m"), ("in", "0.0254", "m"), ("min", "60",
        "s"),
        ("N/mm²", "1e6", "Pa"), ("N mm^-2", "1e6", "Pa"), ("dyn/cm2", "0.1", "Pa"), ("Kpa", "1e3", "Pa"),
        ("kgf/cm^2", "98066.5", "Pa"), ("mPas", "1e-3", "Pa s"), ("mPa.s", "1e-3", "Pa s"), ("mNm", "1e-3",
        "N m"),
        ("s⁻¹", "1", "1/s"), ("rads^-1", "1", "rad/s"), ("kg/(m s^2)", "1", "Pa"), ("um per s", "1e-6",
        "m/s"),
        ("nanometers", "1e-9", "m"), ("kV", "1e3", "V"), ("mm/mm", "1", "-"), ("%", "0.01", "1"),
    ],
)  # fmt: skip
def test_a_unit_has_its_size_and_dimension(text, size, dimension):
    unit, other = unit_of(text), unit_of(dimension)
    assert unit is not None and other is not None  # noqa: PT018
    assert float(unit.size) == float(size)
    assert unit.dimension == other.dimension


def test_degrees_are_temperatures_and_no_electric_charges():
    for text in ("°C", "C", "degC", "℃"):
        assert unit_of(text).offset == unit_of("°C").offset
        assert unit_of(text).dimension == unit_of("K").dimension
    assert float(212 * unit_of("°F").size + unit_of("°F").offset) == 373.15
    # Unknown, or with two meanings: counts, milli- or megapascal, a gigaradian, half a unit.
    for text in ("counts", "a.u.", "mpa", "Grad", "m/", "(s", "10", "", "%kHz", "m^99"):
        assert unit_of(text) is None, text


@pytest.mark.parametrize(
    ("heading", "quantity"),
    [
        ("Frequency [rad/s]", ANGULAR), ("f [Hz]", ORDINARY), ("Kreisfrequenz [1/s]", ANGULAR), ("ω",
        ANGULAR),
        ("f [1/s]", None), ("omega [Hz]", None), ("delta [nm]", "depth"), ("delta [deg]", "phase"),
        ("T", "temperature"), ("t", "time"), ("T [s]", "time"), ("load [nN]", "force"),
        ("load [MPa]", "mean pressure"), ("Spannung [V]", "voltage"), ("Spannung [MPa]", "stress"),
    ],
)  # fmt: skip
def test_the_unit_chooses_among_the_meanings_of_a_name(heading, quantity):
    assert meaning(heading).quantity == quantity


def test_moduli_are_of_shear_or_of_tension_by_name_or_by_an_answer(table):
    text = "f [Hz];Speichermodul [MPa];Verlustmodul [MPa]\n1;2;3\n2;3;4\n"
    wanted = ("frequency", "G'", "G''", "E'", "E''")
    with pytest.raises(
        TableError, match=r"'Speichermodul \[MPa\]' may be in shear \(G\) or in tension \(E\)"
    ):
        table(text, *wanted).take("G'", "Pa")
    assert table(text, *wanted, modulus="E").take("E'", "Pa").tolist() == [2e6, 3e6]
    assert table(text, *wanted, modulus="G").take("G''", "kPa").tolist() == [3e3, 4e3]


@pytest.mark.parametrize("word", ["Bad", "--", "***", "#NV", "n/a", "nan"])
def test_a_hole_is_named_and_quoted_however_long_its_line_is(word, table):
    numbers = ";".join(f"{i}.25" for i in range(40))
    names = ";".join(f"Channel {i}" for i in range(40))
    found = table(f"time;{names};depth\n0.0;{numbers};1\n1.0;{numbers};{word}\n2.0;{numbers};3.5\n")
    assert np.isnan(found.take("depth", holes=True)).tolist() == [False, True, False]
    with pytest.raises(TableError, match=r"table\.csv:3: depth is ") as caught:
        found.take("depth")
    assert f"{word}'" in str(caught.value).partition(" in ")[2]


def test_orders_without_a_meaning_are_restored_and_equal_values_refused(table):
    found = table("q K\n3 30\n1 10\n2 20\n", "wavenumber", "stiffness")
    assert found.ascending(found.take("wavenumber"), "q").tolist() == [1, 2, 0]
    found = table("q K\n3 30\n1 10\n3 20\n", "wavenumber", "stiffness")
    with pytest.raises(TableError, match=r"table\.csv:4: q = 3 again, as in line 2; must differ"):
        found.ascending(found.take("wavenumber"), "q")


def test_an_ambiguous_mark_is_refused_and_an_answer_chooses(table):
    text = "time;depth\n1,234;5,678\n2,345;6,789\n"
    with pytest.raises(TableError, match="may have decimal marks or marks of thousands, as in 1,234"):
        table(text)
    assert table(text, decimal=",").take("depth").tolist() == [5.678, 6.789]
    assert table(text, decimal=".").take("depth").tolist() == [5678, 6789]
    assert table("time;depth\n1.234,5;0,5\n2.345,5;1\n").take("time").tolist() == [1234.5, 2345.5]


def test_a_matrix_keeps_the_lines_above_it_and_its_holes(tmp_path):
    path = tmp_path / "matrix.txt"
    path.write_text("# Breite: 4,5 µm\n-0,5;-0,25;Bad\n0,5;1;2\n", encoding="cp1252")
    found = read_matrix(path)
    np.testing.assert_array_equal(found.values, [[-0.5, -0.25, np.nan], [0.5, 1, 2]])
    assert found.header == ["# Breite: 4,5 µm"]
    assert found.account.startswith(
        "matrix.txt: 2 rows of 3 numbers; separator ';', decimal mark ','; Windows-1252"
    )


@pytest.mark.parametrize(
    ("heading", "quantity", "unit"),
    [
        ("Speichermodul G' [kPa]", "G'", "kPa"), ('Loss modulus G" (Pa)', "G''", "Pa"),
        ("E'' Verlustmodul [MPa]", "E''", "MPa"),
        ("complex modulus |G*| [Pa]", "|G*|", "Pa"), ("Relaxation modulus G(t) [Pa]", "G(t)", "Pa"),
        ("Zeit t [ms]", "time", "ms"), ("Frequenz f (Hz)", "frequency", "Hz"), ("voltage V", "voltage", "V"),
        ("Spannung U [mV]", "voltage", "mV"), ("time h", "time", "h"),
    ],
)  # fmt: skip
def test_a_symbol_beside_a_name_is_no_other_name(heading, quantity, unit):
    means = meaning(
        heading, wanted=("G'", "G''", "E'", "E''", "|G*|", "G(t)", "time", "frequency", "voltage")
    )
    assert (means.quantity, means.symbol) == (quantity, unit)


def test_names_and_units_that_a_symbol_could_hide(table):
    found = table("f_Hz,G'_Pa,G''_Pa\n1,2,3\n4,5,6\n", ORDINARY, "storage modulus", "loss modulus")
    assert found.columns[ORDINARY].unit == unit_of("Hz")
    assert unit_of("murad") is None


def test_two_units_of_one_column_are_refused(table):
    with pytest.raises(TableError, match=r"depth \[mm\].*is in 'mm', but the row below says 'nm'"):
        table("time [s],depth [mm]\ns,nm\n0,1\n1,2\n").take("depth", "m")


def test_a_row_of_units_above_the_headings_counts(table):
    found = table("ms,nm\ntime,depth\n0,1\n1,2\n")
    np.testing.assert_array_equal(found.take("time", "s"), [0, 1e-3])
    np.testing.assert_array_equal(found.take("depth", "um"), [1e-3, 2e-3])
