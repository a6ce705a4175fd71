"""The page of results: it holds what the files hold, and works in a browser."""

import base64
import csv
import json
import re
import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest

from gfmdlayer.cli import main
from gfmdlayer.config import Config
from gfmdlayer.figures.report import page as page_module
from gfmdlayer.figures.report.page import Listed, html, kept_rows, write_report
from gfmdlayer.observables import INDENTATION, Column, known_columns
from gfmdlayer.observables.contact import TIME
from gfmdlayer.results.reader import case_path, open_case
from tests.recordings import case_file, named

SWEEP = """\
name: layers
grid: {points: 64}
time: {end: 0.4, step: 0.05}
trajectory: {ramp_time: 0.2}
output: {snapshots: [0.1, 0.2, 0.4]}
sweep: {layer.thickness: [0.1, .inf], solver.max_iterations: [20000, 1]}
"""
SURFACE = """\
name: surface
grid: {points: [32, 16]}
time: {end: 0.4, step: 0.1}
trajectory: {ramp_time: 0.2}
output: {snapshots: [0.2, 0.4], histograms: {pressure: {max: 1.0}}}
"""
SINGLE = 2.0**-23  # relative spacing of the page's numbers


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run a configuration once, and return its folder with the page in it."""
    done = {}

    def run(text):
        if text not in done:
            folder = tmp_path_factory.mktemp("results")
            (folder / "config.yaml").write_text(text)
            main(["run", str(folder / "config.yaml"), "--out", str(folder / "out")])
            assert main(["report", str(folder / "out")]) == 0
            done[text] = folder / "out"
        return done[text]

    return run


def data_of(page):
    """The data in a page."""
    found = re.search(
        r'<script type="application/json" id="data">(.*?)</script>', page.read_text(), re.DOTALL
    )
    assert found
    return json.loads(found[1])


def unpacked(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_a_page_holds_every_case_with_its_state_and_the_curves_of_the_files(run, tmp_path):
    folder = Path(shutil.copytree(run(SWEEP), tmp_path / "copy"))
    (folder / "cases" / "0003.failed").unlink()
    case_path(folder, 2).write_bytes(b"damaged")
    assert main(["report", str(folder), "--out", str(tmp_path / "page.html")]) == 0
    assert not list(tmp_path.glob("*.part"))
    data = data_of(tmp_path / "page.html")
    assert [each["state"] for each in data["cases"]] == ["complete", "failed", "damaged", "waiting"]
    assert "ConvergenceError" in data["cases"][1]["reason"]
    assert [key["titles"] for key in data["keys"]] == [
        ["d = 0.1", "d = ∞"],
        ["max iterations = 1", "max iterations = 2×10⁴"],
    ]
    assert [each["at"] for each in data["cases"]] == [[0, 1], [0, 0], [1, 1], [1, 0]]
    assert "max_iterations: [20000, 1]" in data["config"]
    with open_case(case_path(folder, 0)) as case:
        assert data["cases"][0]["residual"] == case["residual"].max()
        assert data["cases"][0]["columns"].keys() == {
            "time",
            *(n for n in case.data_vars if case[n].dims == ("time",)),
        }
        for name, text in data["cases"][0]["columns"].items():
            np.testing.assert_allclose(unpacked(text), case[name], rtol=SINGLE, atol=1e-45)
        for name in ("displacement", "pressure", "gap"):
            field = unpacked(data["cases"][0]["surface"]["fields"][name])
            np.testing.assert_allclose(field, case[name].to_numpy().ravel(), rtol=SINGLE, atol=1e-45)
        assert data["provenance"]["numpy version"] == case.attrs["numpy_version"]


def test_a_flipped_bit_of_a_case_is_damage_wherever_it_is(run, tmp_path):
    folder = Path(shutil.copytree(run(SWEEP), tmp_path / "copy"))
    content = case_path(folder, 0).read_bytes()
    for place in (content.index(b"gfmdlayer_version"), len(content) // 2):
        flipped = content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]
        case_path(folder, 0).write_bytes(flipped)
        assert main(["report", str(folder), "--out", str(tmp_path / "page.html")]) == 0
        assert data_of(tmp_path / "page.html")["cases"][0]["state"] == "damaged"
    (folder / "config.yaml").write_bytes((folder / "config.yaml").read_bytes() + b"# \xff\n")
    assert main(["report", str(folder), "--out", str(tmp_path / "page.html")]) == 0


def test_a_configuration_of_other_cases_than_it_names_is_refused(run, tmp_path, capsys):
    folder = Path(shutil.copytree(run(SWEEP), tmp_path / "copy"))
    written = (folder / "config.yaml").read_text()
    (folder / "config.yaml").write_text(written.replace("[20000, 1]", "[20000, 1, 2]"))
    assert main(["report", str(folder)]) == 2
    assert "names 4 cases, and its sweep has 6; must be as the run wrote it" in capsys.readouterr().err


def test_a_page_is_one_file_that_may_load_nothing(run):
    page = (run(SWEEP) / "report.html").read_text()
    assert "<title>out</title>" in page
    policy = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
    assert page.index(f'http-equiv="Content-Security-Policy" content="{policy}"') < page.index("<style>")
    assert not re.search(r"<script[^>]* src=|<link|@import", page)


def test_any_column_attribute_and_list_of_a_case_is_there(tmp_path):
    own = Column("pull", "pull of the surface", "force")
    path = case_path(tmp_path, 5)
    with case_file(path, {"x": np.arange(4.0)}, {"name": "demo"}, [*known_columns().values(), own]) as case:
        for time in (0.0, 1.0):
            case.row(time=time, contact_area=0.1, pull=-3.0 * time)
        case.note(pull_off_force=2.5, most_contact_points=7, comment="</script><b>")  # which closes no tag
    with h5py.File(path, "r+") as h5:
        h5.attrs["instability_time"] = [0.25, 0.5]
    assert main(["report", str(path)]) == 0
    data = data_of(path.with_name("0005-report.html"))
    (pull,) = (each for each in data["columns"] if each["name"] == "pull")
    assert pull["meaning"] == own.long_name
    (only,) = data["cases"]
    np.testing.assert_array_equal(unpacked(only["columns"]["pull"]), [0, -3])
    assert only["facts"] == {"pull_off_force": 2.5, "most_contact_points": 7, "comment": "</script><b>"}
    assert only["warnings"] == ["coarse: at most 7 points in contact"]
    assert [(each["name"], unpacked(each["values"]).tolist()) for each in only["lists"]] == [
        ("instability_time", [0.25, 0.5])
    ]


def test_an_indenter_in_si_units_has_round_units_and_its_own_columns(tmp_path):
    path = case_path(tmp_path, 0)
    unit = Config(
        name="demo", grid={"geometry": "axisymmetric"}, units={"length": "m", "stress": "Pa", "time": "s"}
    ).unit
    x = 1e-6 * np.arange(8.0)
    with case_file(path, {"x": x}, {"name": "demo", "G0": 1e3}, [TIME, *INDENTATION], unit=unit) as case:
        for time in (0.0, 1.0):
            case.row(time=time, force=3e-9 * time, depth=2e-7 * time, contact_radius=1e-6 * time)
        case.snapshot(1.0, named(-2e-7 + 1e-8 * x / x[-1], 2e5 * np.exp(-x / x[1]), 0.1 * x))
    assert main(["report", str(path)]) == 0
    data = data_of(path.with_name("0000-report.html"))
    labels = {each["name"]: each["label"] for each in data["columns"]}
    assert (labels["force"], labels["depth"], labels["time"]) == (
        "force F (nN)",
        "depth δ (nm)",
        "time t (s)",
    )
    assert data["shown"] == ["force", "depth"]
    assert (data["fields"]["displacement"], data["fields"]["gap"]) == ("displacement u (nm)", "gap g (nm)")
    assert (data["fields"]["x"], data["fields"]["pressure"]) == ("x (µm)", "pressure p (kPa)")
    np.testing.assert_allclose(unpacked(data["cases"][0]["columns"]["depth"]), [0, 200], rtol=2 * SINGLE)


def test_pages_are_thinned_to_what_a_browser_takes_in_and_say_so(tmp_path, monkeypatch):
    x = np.linspace(-0.5, 0.5, 2048, endpoint=False)
    for number in range(6):
        with case_file(case_path(tmp_path, number), {"x": x}, {"name": "demo", "tau": 1.0}) as case:
            for time in range(1000):
                case.row(time=float(time), contact_area=0.5, residual=float(time == 500))
            for time in range(8):
                case.snapshot(float(time), named(x, x, x))
    monkeypatch.setattr(page_module, "CURVE_NUMBERS", 4 * 24 * 2)  # time and area: the residual has no room
    monkeypatch.setattr(page_module, "SURFACE_NUMBERS", 3 * 2 * 3 * 256)
    listed = [Listed(i, case_path(tmp_path, i), {"layer.thickness": 1.0 + i}) for i in range(6)]
    data = data_of(write_report(listed, tmp_path / "page.html", "demo"))
    held = [each for each in data["cases"] if each["columns"]]
    assert len(held) == 4
    assert sum(len(unpacked(text)) for each in held for text in each["columns"].values()) <= 4 * 24 * 2
    assert all(each["residual"] == 1.0 for each in data["cases"])  # of every row
    surfaces = [each["surface"] for each in held if each["surface"]]
    assert len(surfaces) == 3
    assert (
        sum(len(unpacked(text)) for each in surfaces for text in each["fields"].values()) <= 3 * 2 * 3 * 256
    )
    assert surfaces[0]["note"] == "every 8th point along x, 2 of 8 snapshots"
    assert surfaces[0]["times"] == [0, 7]
    assert data["notes"]["curves"].startswith("The page shows the curves of 4 of 6 complete cases. ")
    assert data["notes"]["surfaces"] == "The page shows the surfaces of 3 of 6 cases."


def test_thinned_rows_keep_the_ends_and_resolve_every_decade():
    rows = kept_rows(100_000, 100)
    assert (rows[0], rows[-1]) == (0, 99_999)
    assert len(rows) <= 100
    for start in 10 ** np.arange(1, 5):
        assert np.count_nonzero((rows >= start) & (rows < 10 * start)) >= 8  # 50 over five decades
    assert np.diff(rows).max() <= 100_000 / 48
    np.testing.assert_array_equal(kept_rows(5, 5), np.arange(5))


@pytest.mark.parametrize(
    ("label", "written"),
    [
        (r"$\tilde{p}/G_0$", "p̃/G<sub>0</sub>"),
        (r"$h_\mathrm{rms}$ (µm)", "h<sub>rms</sub> (µm)"),
        (r"$2\times 10^{-5}$", "2×10⁻⁵"),
        (r"$G_{\mathrm{bulk},1}$", "G<sub>bulk,1</sub>"),
        (r"$F/(G_0\,L^{2})$", "F/(G<sub>0</sub>\u2009L²)"),
        (r"a < b $\Delta t$", "a &lt; b Δt"),
    ],
)
def test_labels_are_written_as_html(label, written):
    assert html(label) == written


def test_what_is_no_results_is_refused(tmp_path, capsys):
    (tmp_path / "case.h5").write_bytes(b"")
    for path, reason in (
        ("", "not a results folder"),
        ("none", "no such folder"),
        ("case.h5", "not a result file"),
    ):
        assert main(["report", str(tmp_path / path)]) == 2
        assert reason in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == ["case.h5"]


def test_a_page_of_another_kind_of_file_is_refused(run, capsys):
    assert main(["report", str(run(SWEEP)), "--out", "page.pdf"]) == 2
    assert "use .html, .htm" in capsys.readouterr().err


@pytest.mark.skipif(shutil.which("node") is None, reason="no Node.js; browsers check the syntax too")
def test_the_program_is_sound_javascript():
    folder = Path(page_module.__file__).parent
    for name in page_module.PROGRAM:
        subprocess.run(["node", "--check", str(folder / name)], check=True)


def drawn(page, figure, what):
    """A part of what a figure shows, by its data."""
    return page.evaluate(f"(() => {{ const g = document.getElementById('{figure}'); return {what}; }})()")


def table(download):
    """The rows of a file that the page saved."""
    return list(csv.DictReader(Path(download.path()).read_text().splitlines()))


def assert_legible(page, flaws):
    """No text is cut off or pale, in what is unfolded and after the choice of a case neither.

    Colours depend on page and scheme, places on page and width: each of these pairs is in one of four tests.
    """
    page.click("summary")
    page.click("#table tbody tr:first-child button")
    assert flaws(page) == []


def test_in_a_browser_a_sweep_is_legible_a_slider_moves_the_profile_selectors_the_curves(run, visit, flaws):
    page = visit(run(SWEEP) / "report.html", ready="html[data-ready]")
    with open_case(case_path(run(SWEEP), 0)) as case:
        case.load()
    surface, pressure = "Array.from(g.data[0].y)", "Array.from(g.data[1].y)"
    np.testing.assert_allclose(drawn(page, "profile", surface), case["displacement"][2], rtol=SINGLE)
    assert_legible(page, flaws)
    page.focus("#time")
    page.keyboard.press("ArrowLeft")
    assert page.text_content("#time-value") == "time t/τ = 0.2"
    np.testing.assert_allclose(drawn(page, "profile", surface), case["displacement"][1], rtol=SINGLE)
    np.testing.assert_allclose(drawn(page, "profile", pressure), case["pressure"][1], rtol=SINGLE, atol=1e-30)
    punch = drawn(page, "profile", "Array.from(g.data[2].y)")
    np.testing.assert_allclose(punch, case["displacement"][1] + case["gap"][1], rtol=4 * SINGLE, atol=1e-9)

    assert drawn(page, "curve-0", "g.data.map((each) => each.name)") == ["d = 0.1", "d = ∞"]
    page.select_option("#key-0", label="d = 0.1")
    assert drawn(page, "curve-1", "g.data.length") == 1
    page.select_option("#y-1", "dissipated")
    page.select_option("#x", "depth")
    assert drawn(page, "curve-1", "g.layout.xaxis.title.text") == "depth δ/L"
    np.testing.assert_allclose(drawn(page, "curve-1", "Array.from(g.data[0].x)"), case["depth"], rtol=SINGLE)
    np.testing.assert_allclose(
        drawn(page, "curve-1", "Array.from(g.data[0].y)"), case["dissipated"], rtol=SINGLE
    )
    with page.expect_download() as saved:
        page.click("#curves-csv")
    rows = table(saved.value)
    assert list(rows[0])[:4] == ["case", "layer.thickness", "solver.max_iterations", "depth [δ/L]"]
    np.testing.assert_allclose([float(row["depth [δ/L]"]) for row in rows], case["depth"], rtol=1e-6)

    page.select_option("#key-0", "")
    page.focus("#legend li:nth-child(2) button")
    page.keyboard.press("Enter")
    assert page.text_content("#facts h3") == "Case 0002: d = ∞, max iterations = 2×10⁴"
    assert page.evaluate("document.activeElement.textContent") == "d = ∞"
    with open_case(case_path(run(SWEEP), 2)) as other:
        np.testing.assert_allclose(drawn(page, "profile", surface), other["displacement"][1], rtol=SINGLE)
    page.select_option("#state", "failed")
    assert page.locator("#table tbody tr").count() == 2
    assert "ConvergenceError" in page.text_content("#table")


def test_in_a_browser_a_surface_is_legible_and_has_maps_a_cut_and_distributions(run, visit, flaws):
    page = visit(run(SURFACE) / "report.html", ready="html[data-ready]", scheme="dark")
    assert_legible(page, flaws)
    with open_case(case_path(run(SURFACE), 0)) as case:
        case.load()
    page.fill("#time", "0")
    z = drawn(page, "map-pressure", "g.data[0].z.map((row) => Array.from(row))")
    np.testing.assert_allclose(z, case["pressure"][0].transpose("y", "x"), rtol=SINGLE, atol=1e-30)
    np.testing.assert_array_equal(
        np.array(drawn(page, "map-gap", "g.data[0].z.map((row) => row.map((each) => each === null))")),
        (case["gap"][0] == 0).T,
    )
    assert drawn(page, "map-gap", "g.layout.plot_bgcolor") == data_of(run(SURFACE) / "report.html")["contact"]
    for figure in ("map-gap", "profile"):
        assert "contact" in page.text_content(f"#{figure} .legend")
    page.fill("#cut", "5")
    cut = case["pressure"].isel(snapshot=0, y=5)
    np.testing.assert_allclose(
        drawn(page, "profile", "Array.from(g.data[1].y)"), cut, rtol=SINGLE, atol=1e-30
    )
    with page.expect_download() as saved:
        page.click("#maps-csv")
    assert len(table(saved.value)) == 32 * 16
    page.fill("#row", "2")
    steps = drawn(page, "distribution-plot", "Array.from(g.data[0].y)")
    np.testing.assert_allclose(steps[:-1], case["pressure_histogram"][2], rtol=SINGLE)
    dark = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.click("#theme")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != dark
    assert drawn(page, "profile", "g.layout.font.color") == "#1b1f24"


def test_in_a_browser_as_wide_as_a_phone_a_surface_is_legible_and_all_is_reached_by_keys(run, visit, flaws):
    page = visit(run(SURFACE) / "report.html", ready="html[data-ready]", width=375)
    assert page.evaluate("document.documentElement.scrollWidth") == 375
    assert_legible(page, flaws)
    assert page.evaluate("document.documentElement.scrollWidth") == 375
    controls = page.eval_on_selector_all(
        "button, input, select, summary, a[href]",
        "all => all.filter((each) => !each.disabled && each.checkVisibility()).map((each) => each.outerHTML)",
    )
    unreached = set(controls)
    for _ in range(2 * len(controls)):  # figures and tables that scroll are reached too
        page.keyboard.press("Tab")
        unreached.discard(page.evaluate("document.activeElement.outerHTML"))
        if not unreached:
            break
    assert unreached == set()


def test_pale_and_cut_off_text_is_found(tmp_path, visit, flaws):
    box = '<div style="width: 80px; white-space: nowrap; overflow: {}">long words in a small box</div>'
    (tmp_path / "page.html").write_text(
        '<html lang="en"><title>page</title><body style="color: #767676"><p>grey</p>'
        '<p style="color: #777">pale</p>'
        + "".join(map(box.format, ("auto", "hidden")))
        + '<p style="position: absolute; left: 395px">over the edge</p></body></html>'
    )
    page = visit(tmp_path / "page.html", width=400)
    assert {each.partition(":")[0] for each in flaws(page)} == {"contrast 4.48", "cut off", "outside"}
    assert any(each.startswith("scrolls") for each in flaws(page, unscrolled="div"))


def test_in_a_narrow_dark_browser_a_sweep_is_legible(run, visit, flaws):
    page = visit(run(SWEEP) / "report.html", width=400, scheme="dark", ready="html[data-ready]")
    assert_legible(page, flaws)


def test_a_folder_without_a_complete_case_has_a_page_of_its_cases(run, tmp_path, visit):
    folder = Path(shutil.copytree(run(SWEEP), tmp_path / "copy"))
    for number in (0, 2):
        case_path(folder, number).unlink()
    assert main(["report", str(folder)]) == 0
    page = visit(folder / "report.html", ready="html[data-ready]")
    assert "2 failed, 2 waiting" in page.text_content("#summary")
    assert page.locator("#table tbody tr").count() == 4
    assert page.text_content("#curves p") == page.text_content("#surface p") == "No case is complete."
