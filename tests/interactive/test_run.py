"""`gfmdlayer.run`: data in memory are those of the files, bit for bit; arrays are files of their contents."""

import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import xarray

import gfmdlayer
from gfmdlayer import Config, ConfigError, ConvergenceError, Prony, Sphere, Zener
from gfmdlayer.case import march
from gfmdlayer.config import digest
from gfmdlayer.study.case_run import Checkpoints
from gfmdlayer.study.claims import AtWork, Claim
from gfmdlayer.study.folder import FolderError
from gfmdlayer.study.interrupts import STOP_SIGNALS

X = np.arange(256) / 256 - 0.5
SHORT = {"time": {"end": 1.0, "step": 0.25}, "output": {"snapshots": [0.5, 1.0]}}
LINE = SHORT | {"grid": {"points": 256}}
SURFACE = SHORT | {"grid": {"points": [16, 12]}, "output": {"snapshots": [1.0], "patches": True}}
ATTRACTION = {"law": "exponential", "work": 1e-3, "range": 0.02}
OF_A_RUN = ("started", "finished", "wall_seconds")


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def same(found, wanted):
    """Assert that two datasets have the same bits, names, types and attributes."""
    for each in (found, wanted):
        for name in OF_A_RUN:
            each.attrs.pop(name, None)
    xarray.testing.assert_identical(found, wanted)
    assert {n: v.dtype.kind for n, v in found.variables.items()} == {
        n: v.dtype.kind for n, v in wanted.variables.items()
    }


@pytest.mark.parametrize(
    "config",
    [
        LINE,
        LINE | {"output": {}},
        SURFACE,
        LINE | {"output": {"snapshots": [1.0], "histograms": {"pressure": {"max": 2.0, "bins": 7}}}},
        LINE | {"units": {"length": "mm", "stress": "MPa", "time": "s"}},
        LINE | {"time": {"end": 0.5, "step": "adaptive"}, "output": {"times": 0.25}},
        SURFACE | {"counterbody": {"layer": {"thickness": 0.1}}},
        SURFACE
        | {
            "interface": {"law": "coulomb", "coefficient": 0.3},
            "trajectory": {"control": "load", "load": 0.02, "velocity": 0.05, "creepage": 0.01},
        },
        LINE
        | {
            "interface": [{"law": "hard_wall", "hardness": 0.5}, ATTRACTION],
            "trajectory": {"control": "load", "load": 0.05},
        },
        SHORT | {"grid": {"geometry": "axisymmetric"}},
        SURFACE | {"output": {"snapshots": [0.5, 1.0], "inside": {"depths": [0.0, 0.05], "times": [1.0]}}},
        LINE
        | {
            "layers": [{"thickness": 0.05}, {"thickness": 0.1, "material": {"model": "zener", "tau": 3.0}}],
            "output": {"snapshots": [0.5, 1.0], "inside": {"depths": [0.02]}},
        },
    ],
    ids=[
        *("line", "no snapshots", "surface", "histograms", "units", "adaptive", "two bodies", "friction"),
        *("attraction and hardness", "axisymmetric", "inside", "inside of a stack"),
    ],
)
def test_a_case_in_memory_is_that_of_its_file(config):
    with gfmdlayer.run(config, out="out") as written:
        same(gfmdlayer.run(config), written.load())


@pytest.mark.parametrize(
    "sweep",
    [
        {"layer.thickness": [0.05, 0.1], "layer.material.tau": [1, 2]},
        {"zip": {"layer.thickness": [0.05, 0.1],
         "punch": [{"radius": 0.5}, {"shape": "wedge", "slope": 0.1}]}},
        {"output.patches": [False, True]},
        {"output.histograms.gap": [{"max": 1.0, "bins": 3}, {"max": 1.0, "bins": 4}]},
        {"grid.points": [64, 128]},
        {"trajectory.depth": [0.005, 0.01]},
    ],
    ids=["product", "list", "a column of one", "other bins", "grids", "named as a column"],
)  # fmt: skip
def test_a_sweep_in_memory_is_that_of_its_file(sweep):
    config = SURFACE | {"sweep": sweep}
    with gfmdlayer.run(config, out="out") as written:
        same(gfmdlayer.run(config), written.load())


def test_a_notebook_runs_an_array_in_a_loop_and_plots_without_a_file(tmp_path):
    mpl.use("agg")
    x = np.arange(512) / 512 - 0.5
    for d in (0.05, 0.1, 0.2):
        data = gfmdlayer.run({"time": {"end": 2.0, "step": 0.1}}, punch=-(x**2) / 0.5, layer__thickness=d)
        (line,) = data.contact_area.plot()
    assert line.get_xdata().size == 21
    assert data.sizes["x"] == 512
    assert list(tmp_path.iterdir()) == []


# --- arrays ---


def test_heights_count_outward_from_the_punch():
    """The parabola of a configuration is -x^2/(2 R), wherever its top is; a bump touches first."""
    wanted = gfmdlayer.run(LINE, punch={"radius": 0.25})
    for given in (-(X**2) / 0.5, 3.0 - X**2 / 0.5, lambda x: -(x**2) / 0.5):
        found = gfmdlayer.run(LINE, punch=given)
        np.testing.assert_allclose(found.pressure, wanted.pressure, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.depth, wanted.depth)
    bump = np.where(np.arange(256) == 40, 0.5, -(X**2) / 0.5)
    assert gfmdlayer.run(LINE, punch=bump).pressure[0].to_numpy().argmax() == 40


def test_an_array_of_a_surface_has_x_first():
    x, y = np.meshgrid(np.arange(16) / 16 - 0.5, np.arange(12) / 12 - 0.5, indexing="ij")
    wanted = gfmdlayer.run(SURFACE, punch={"radius": [0.25, 1.0]})
    array = gfmdlayer.run(SURFACE, punch=-(x**2) / 0.5 - y**2 / 2)
    function = gfmdlayer.run(SURFACE, punch=lambda x, y: -(x**2) / 0.5 - y**2 / 2)
    np.testing.assert_allclose(array.pressure, wanted.pressure, rtol=0, atol=1e-9)
    np.testing.assert_allclose(function.pressure, wanted.pressure, rtol=0, atol=1e-9)


def test_a_punch_is_also_an_object():
    same(gfmdlayer.run(LINE, punch=Sphere(radius=2.0)), gfmdlayer.run(LINE | {"punch": Sphere(radius=2.0)}))


@pytest.mark.parametrize("control", ["depth", "load", "force"])
def test_a_history_is_the_table_of_a_file(control):
    rows = np.array([[0.0, 0.0], [0.4, 0.02], [1.0, 1 / 300]])
    Path("table.txt").write_text("\n".join(f"{t!r} {v!r}" for t, v in rows.tolist()) + "\n")
    table = {"control": control, "kind": "table", "file": "table.txt"}
    wanted = gfmdlayer.run(LINE | {"trajectory": table})
    before = {"control": control, control: 0.01, "ramp_time": 1.0}
    for given in (rows, rows.tolist(), (rows[:, 0], rows[:, 1])):
        for trajectory in ({"control": control}, before, table):
            found = gfmdlayer.run(LINE | {"trajectory": trajectory}, history=given)
            xarray.testing.assert_equal(found, wanted)
            assert found.attrs["digest"] == wanted.attrs["digest"]


def test_a_voltage_over_time_is_the_table_of_a_file():
    rows = np.array([[0.0, 0.0], [0.4, 0.3], [1.0, 0.1]])
    Path("volts.txt").write_text("0 0\n0.4 0.3\n1 0.1\n")
    law = {"law": "electrostatic", "insulation": 0.01, "permittivity": 1e-3}
    wanted = gfmdlayer.run(LINE | {"interface": law | {"voltage": "volts.txt"}})
    for given in (rows, rows.tolist(), (rows[:, 0], rows[:, 1])):
        for found in (
            gfmdlayer.run(LINE | {"interface": law | {"voltage": given}}),
            gfmdlayer.run(LINE, interface=[law | {"voltage": given}]),
        ):
            xarray.testing.assert_equal(found, wanted)


def test_arrays_lie_with_the_results_that_are_run_again_from_them():
    given = {"punch": -(X**2) / 0.5, "history": [(0.0, 0.0), (1.0, 0.01)]}
    found = gfmdlayer.run(SHORT, **given)
    with gfmdlayer.run(SHORT, out="out", **given) as written:
        assert written.attrs["digest"] == found.attrs["digest"]
        xarray.testing.assert_equal(found, written)
    assert sorted(path.suffix for path in Path("out/arrays").iterdir()) == [".npy", ".txt"]
    assert digest(gfmdlayer.load("out/config.yaml")) == found.attrs["digest"]
    begun = Path("out/cases/0000.h5").stat().st_mtime_ns
    gfmdlayer.run(SHORT, out="out", **given).close()
    gfmdlayer.run("out/config.yaml", out="out").close()
    assert Path("out/cases/0000.h5").stat().st_mtime_ns == begun
    other = given | {"punch": -(X**2)}
    gfmdlayer.run(SHORT, out="other", **other).close()
    with pytest.raises(FolderError, match=r"punch\.file"):
        gfmdlayer.run(SHORT, out="out", name="run", **other, trajectory__velocity=1.0)


def test_a_folder_of_something_else_is_left_alone():
    Path("mine").mkdir()
    Path("mine/thesis.tex").touch()
    with pytest.raises(FolderError, match="not a results folder"):
        gfmdlayer.run(SHORT, punch=-(X**2), out="mine")
    assert [path.name for path in Path("mine").iterdir()] == ["thesis.tex"]


# --- what is refused ---

REFUSED = {
    "a misspelt key": ({"layer__thicknes": 1}, "layer.thicknes: unknown key; allowed: thickness, "),
    "a value": ({"layer__thickness": -1}, "layer.thickness: got -1; must be a number >= 0 or .inf"),
    "a list": ({"layer__thickness": [1, 2]}, "layer.thickness: got [1, 2]; must be a number"),
    "another shape": ({"grid__points": 64, "punch": X}, "punch: holds 256 heights; must be 64, as the grid"),
    "a hole": (
        {"punch": np.where(X == 0, np.nan, X)},
        "punch: the height at index [128] is not a finite number",
    ),
    "infinity": ({"punch": np.where(X == 0, np.inf, X)}, "punch: the height at index [128] is infinite"),
    "words": ({"punch": ["high", "low"]}, "punch: got an array of type <U4; must be real numbers"),
    "complex numbers": ({"punch": X * 1j}, "punch: got an array of type complex128"),
    "rows of different lengths": ({"punch": [[1, 2], [3]]}, "must be an array of real numbers"),
    "a function of another shape": (
        {"punch": lambda x: x[:3], "grid__points": 64},
        "punch: holds 3 heights; must be 64",
    ),
    "three axes": ({"punch": np.zeros((8, 8, 8))}, "grid.points: got 3 values"),
    "a function on several grids": (
        {"punch": lambda x: x, "sweep": {"grid.points": [64, 128]}},
        "punch: got a function, which is evaluated on one grid",
    ),
    "a swept key of another punch": (
        {"punch": X, "sweep": {"punch.radius": [1, 2]}},
        "sweep.punch.radius: unknown key; allowed: punch.shape, punch.file",
    ),
    "a flat history": ({"history": [0.0, 1.0]}, "history: got an array of 2; must be (m, 2)"),
    "a history of words": ({"history": [("a", "b")]}, "history: could not convert"),
    "a pair that differs": ({"history": ([0, 1], [0, 1, 2])}, "must be an (m, 2) array, or a pair of arrays"),
    "a flat voltage": (
        {"interface": {"law": "electrostatic", "voltage": [1, 2]}},
        "voltage: got an array of 2",
    ),
    "a late history": ({"history": [(1, 0), (2, 1)]}, "the first time is 1; must be 0"),
    "a history back in time": ({"history": [(0, 0), (2, 0.1), (1, 0)]}, "must increase from row to row"),
    "too deep a history": ({"history": [(0, 0), (1, 10)]}, "must be below the mean height of the punch"),
    "no process": ({"jobs": 0}, "jobs: got 0; must be a whole number >= 1"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_impossible_input_is_refused_in_words(name):
    values, words = REFUSED[name]
    with pytest.raises(ConfigError) as caught:
        gfmdlayer.run(SHORT, **values)
    assert words in str(caught.value)
    assert len(caught.value.problems) == 1


def test_errors_of_a_mapping_are_those_of_its_file_without_the_place():
    text = (
        "name: a\nlayer: {thickness: -1, poison: 0.3}\nsolver: {method: fir}\npunch: {shape: cube, side: 1}\n"
    )
    Path("a.yaml").write_text(text)
    with pytest.raises(ConfigError) as of_file:
        gfmdlayer.run("a.yaml")
    sections = {
        "layer": {"thickness": -1, "poison": 0.3},
        "solver": {"method": "fir"},
        "punch": {"shape": "cube", "side": 1},
    }
    wanted = {line.split(": ", 1)[1] for line in of_file.value.problems}
    assert len(wanted) == 4
    for refuse in (
        lambda: gfmdlayer.run(sections),
        lambda: Config(name="a", **sections),
        lambda: Config(name="a").with_values(sections),
    ):
        with pytest.raises(ConfigError) as caught:
            refuse()
        assert set(caught.value.problems) == wanted


def test_values_replace_those_of_a_file_and_keep_its_places():
    Path("a.yaml").write_text(
        "name: a\nlayer: {thickness: -1}\ntime: {end: 1, step: 0.5}\ngrid: {points: 64}\n"
    )
    with pytest.raises(ConfigError) as caught:
        gfmdlayer.run("a.yaml", solver__tolerance=2)
    assert [line.split(":")[:3] for line in caught.value.problems] == [
        ["a.yaml", "2", "20"],
        ["solver.tolerance", " got 2; must be a number >= 1e-13 and < 1"],
    ] or [line.split(":")[0] for line in caught.value.problems] == ["solver.tolerance", "a.yaml"]
    by_dots = gfmdlayer.run("a.yaml", **{"layer.thickness": 0.2})
    same(gfmdlayer.run("a.yaml", layer__thickness=np.float64(0.2)), by_dots)
    with pytest.raises(ConfigError, match=r"trajectory\.load: missing"):
        gfmdlayer.run("a.yaml", layer__thickness=0.2, trajectory__control="load")


def test_materials_and_shapes_are_objects_in_a_configuration():
    material = Prony(1.0, [(2.0, 0.5), (3.0, 5.0)])
    config = Config(name="a", layer={"material": material}, punch=Sphere(radius=2.0), **SHORT)
    assert config.layer.material == material
    again = config.with_values({"layer.thickness": np.float32(0.25), "grid.points": np.int64(64)})
    assert (again.layer.material, again.punch, again.layer.thickness) == (material, Sphere(radius=2.0), 0.25)
    Path("a.yaml").write_text(again.dump())
    assert gfmdlayer.load("a.yaml") == again
    swept = gfmdlayer.run(again, sweep={"layer.material": [material, Zener(1, 6, 0.5)]})
    assert swept.material.values.tolist()[1] == "model=zener, G0=1.0, Ginf=6.0, tau=0.5"


# --- failures ---

HARD = LINE | {"solver": {"method": "fire", "max_iterations": 25}}


def test_a_case_that_does_not_converge_raises_with_its_state():
    with pytest.raises(
        ConvergenceError, match=r"t = 0\.25: residual .* after 25 iterations of fire"
    ) as caught:
        gfmdlayer.run(HARD)
    error = caught.value
    assert error.time == 0.25
    assert error.problem is not None
    assert error.solution is not None
    assert error.data is not None
    assert error.solution.residual > 1e-6
    assert error.problem.obstacle.size == error.solution.pressure.size == 256
    assert error.data.time.values.tolist() == [0.0]
    with pytest.raises(ConvergenceError, match=r"t = 0\.25"):
        gfmdlayer.run(HARD, out="out")


def test_a_case_of_a_sweep_that_fails_is_nan_and_named_wherever_it_runs():
    config = HARD | {"sweep": {"solver.max_iterations": [25, 20000]}}
    found = []
    for options in ({}, {"jobs": 2}, {"out": "out"}):
        with pytest.warns(
            UserWarning, match=r"1 of 2 cases failed and are NaN:\n0000: ConvergenceError: t = 0"
        ):
            found.append(gfmdlayer.run(config, **options))
    assert found[0].attrs["failed"].startswith("0000: ConvergenceError: t = 0.25")
    assert np.isnan(found[0].contact_area.sel(max_iterations=25)).all()
    assert np.isfinite(found[0].contact_area.sel(max_iterations=20000)).all()
    same(found[1], found[0])
    with found[2] as written:
        xarray.testing.assert_identical(written.contact_area.load(), found[0].contact_area)


@pytest.mark.parametrize("options", [{}, {"out": "out"}], ids=["here", "folder"])
def test_a_sweep_without_a_complete_case_raises(options):
    with pytest.raises(ConvergenceError):
        gfmdlayer.run(HARD, sweep={"solver.max_iterations": [24, 25]}, **options)


def test_signals_have_their_effect_again_after_a_run():
    before = [signal.getsignal(each) for each in STOP_SIGNALS]
    gfmdlayer.run(LINE, out="out").close()
    assert [signal.getsignal(each) for each in STOP_SIGNALS] == before


@pytest.mark.parametrize("signum", STOP_SIGNALS)
def test_every_signal_of_a_batch_system_keeps_a_checkpoint(signum, monkeypatch):
    advance = Claim.advance

    def struck(claim, simulated_time):
        if claim._steps == 1:
            signal.raise_signal(signum)
        advance(claim, simulated_time)

    with monkeypatch.context() as patched:
        patched.setattr(Claim, "advance", struck)
        patched.setattr(Checkpoints, "stepwise", property(lambda _: True))
        with pytest.raises(KeyboardInterrupt):
            gfmdlayer.run(LINE, out="out")
    assert Path("out/cases/0000.checkpoint").exists()
    gfmdlayer.run(LINE, out="out").close()
    assert not Path("out/cases/0000.checkpoint").exists()


def test_a_dimension_is_not_named_as_an_argument_of_sel():
    found = gfmdlayer.run(LINE, sweep={"solver.method": ["fire", "active_set"], "layer.thickness": [0.1]})
    assert found.contact_area.dims == ("solver.method", "thickness", "time")
    assert found.contact_area.sel({"solver.method": "fire"}).dims == ("thickness", "time")


# Ctrl-C after three steps; a process of its own, since signals come to the main thread of one.
INTERRUPTED = """
import os, signal
import gfmdlayer, gfmdlayer.study.run
from gfmdlayer.case import march

loop, stretches = march.march, 0
march.ATTEMPTS = 3

def interrupting(*arrays):
    global stretches
    stretches += 1
    if stretches == 2:
        os.kill(os.getpid(), signal.SIGINT)
    return loop(*arrays)

march.march = interrupting
for module in (gfmdlayer.study.run, gfmdlayer.study.case_run):
    module.warm_up = lambda *_, **__: []  # it takes steps, too
for options in ({}, {"out": "out"}):
    stretches = 0
    try:
        gfmdlayer.run(LINE, **options)
    except KeyboardInterrupt:
        print("interrupted")
"""


def test_an_interrupted_run_raises_and_one_in_a_folder_goes_on():
    wanted = gfmdlayer.run(LINE)
    code = f"LINE = {LINE!r}\n{INTERRUPTED}"
    said = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True
    )
    assert said.stdout == "interrupted\ninterrupted\n"
    assert Path("out/cases/0000.checkpoint").exists()
    with gfmdlayer.run(LINE, out="out") as found:
        xarray.testing.assert_equal(found, wanted)


# --- progress ---


class _Spy:
    lists_complete = False

    def __init__(self):
        self.fractions = []
        self.notes = []
        self.closed = False

    def note(self, line):
        self.notes.append(line)

    def advance(self, progress):
        self.fractions.append(progress.fraction)

    def close(self):
        self.closed = True


@pytest.mark.parametrize("options", [{}, {"sweep": {"layer.thickness": [0.1, 0.2]}}, {"out": "out"}])
def test_doubts_about_a_configuration_are_warnings_at_the_line_of_the_call(options):
    config = {"grid": {"points": 64}, "time": {"end": 1.0, "step": 0.5}, "trajectory": {"ramp_time": 2.0}}
    with pytest.warns(UserWarning, match="the ramp is not completed") as caught:
        gfmdlayer.run(config, **options)
    assert [(Path(each.filename), str(each.message)) for each in caught if "ramp" in str(each.message)] == [
        (Path(__file__), "trajectory.ramp_time = 2 is beyond time.end = 1: the ramp is not completed")
    ]
    assert {Path(each.filename) for each in caught} == {Path(__file__)}


@pytest.mark.parametrize("sweep", [{}, {"layer.thickness": [0.1, 0.2, 0.3]}], ids=["case", "sweep"])
def test_progress_grows_to_its_end(monkeypatch, sweep):
    spy = _Spy()
    monkeypatch.setattr("gfmdlayer.interactive.run.chosen_display", lambda _: spy)
    monkeypatch.setattr("gfmdlayer.study.progress.READ_INTERVAL", 0.0001)
    advance = AtWork.advance

    def slowly(self, simulated_time):
        advance(self, simulated_time)
        time.sleep(0.05)

    monkeypatch.setattr(AtWork, "advance", slowly)
    monkeypatch.setattr(march, "ATTEMPTS", 1)
    gfmdlayer.run(LINE | ({"sweep": sweep} if sweep else {}))
    assert spy.fractions == sorted(spy.fractions)
    assert spy.fractions[-1] == 1.0
    assert len(set(spy.fractions)) > 4
    assert spy.closed


def test_a_short_run_shows_nothing_and_a_long_one_a_bar(monkeypatch):
    from gfmdlayer.interactive import run as progress
    from gfmdlayer.study.progress import Progress

    made = []

    def make():
        made.append(_Spy())
        return made[-1]

    for delay, shown in ((1e6, False), (-1.0, True)):
        monkeypatch.setattr(progress, "DELAY", delay)
        display = progress.Delayed(make)
        display.note("first")
        display.advance(Progress(2, 1))
        display.close()
        assert bool(made) is shown
    assert (made[0].notes, made[0].fractions, made[0].closed) == (["first"], [0.5], True)


def test_a_notebook_has_a_bar_of_its_own(monkeypatch):
    """The kernel of a notebook is recognised by IPython's shell; IPython itself need not be there."""
    from types import ModuleType, SimpleNamespace

    shown = []
    handle = SimpleNamespace(update=shown.append)
    ipython, display = ModuleType("IPython"), ModuleType("IPython.display")
    ipython.get_ipython = lambda: SimpleNamespace(kernel=None)
    display.HTML = str
    display.display = lambda _html, **_options: handle
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    gfmdlayer.run(LINE, progress=True)
    assert shown[-1] == '<progress value="1.0000" max="1"></progress> 1 of 1 complete'


def test_a_run_in_memory_makes_no_file(monkeypatch, tmp_path):
    def refuse(*_, **__):
        raise AssertionError("a folder is made")

    monkeypatch.setattr("gfmdlayer.interactive.run._scratch", refuse)
    monkeypatch.setattr("gfmdlayer.interactive.run.chosen_display", lambda _: _Spy())
    gfmdlayer.run(LINE, sweep={"layer.thickness": [0.1, 0.2]})
    assert not list(tmp_path.iterdir())


def test_nothing_is_said_where_nobody_watches(capfd):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gfmdlayer.run(LINE, grid__points=1024)
        gfmdlayer.run(LINE, grid__points=1024, progress=False, sweep={"layer.thickness": [0.1]})
    assert capfd.readouterr() == ("", "")


ROUND = -(np.linspace(-0.5, 0.5, 12, endpoint=False)[:, np.newaxis] ** 2 + (X[::32] * 2) ** 2) / 16


@pytest.mark.parametrize("given", ["mapping", "keyword", "file"])
def test_an_array_gives_the_points_before_the_rest_of_the_grid_is_checked(given):
    """The configuration's own punch, which needs a surface, is not looked at either."""
    own = SHORT | {"output": {}, "punch": {"shape": "pyramid", "faces": 4}}
    grid = {"period": [1.0, 2.0]}
    if given == "file":
        Path("a.yaml").write_text(
            "name: a\ngrid: {period: [1, 2]}\ntime: {end: 1, step: 0.25}\npunch: {shape: pyramid}\n"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if given == "keyword":
            data = gfmdlayer.run(own, punch=ROUND, grid=grid)
        else:
            data = gfmdlayer.run("a.yaml" if given == "file" else own | {"grid": grid}, punch=ROUND)
    assert (data.sizes["x"], data.sizes["y"]) == ROUND.shape


@pytest.mark.parametrize("points", [(64,), (16, 16)])
def test_a_run_on_few_points_asks_whether_a_round_punch_is_upside_down(points):
    """Not of the right sign, nor of a cone, whose heights have a cusp wherever the cell begins."""
    few = SHORT | {"output": {}, "trajectory": {"depth": 1e-4}}
    axes = [np.arange(n) / n - 0.5 for n in points]
    r = np.sqrt(sum(x**2 for x in np.meshgrid(*axes, indexing="ij")))
    for heights, asked in ((r**2, True), (-(r**2), False), (-r, False)):
        with pytest.warns(UserWarning, match=r"COARSE: at most \d+ points? in contact") as caught:
            gfmdlayer.run(few, punch=heights)
        (coarse,) = [str(each.message) for each in caught if "COARSE" in str(each.message)]
        assert ("upside down" in coarse) == asked == ("take more grid.points" not in coarse)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            gfmdlayer.solve(gfmdlayer.halfspace(1.0), heights, depth=1e-4)
        assert ["upside down" in str(each.message) for each in caught] == [True] * asked


def test_a_file_with_the_heights_of_an_array_is_the_same_punch():
    np.save("heights.npy", -(X**2))
    profile = {"shape": "profile", "file": "heights.npy", "touches_first": "highest"}
    found = gfmdlayer.run(LINE, punch=profile)
    np.testing.assert_array_equal(found.pressure, gfmdlayer.run(LINE, punch=-(X**2)).pressure)


def test_a_body_that_is_no_key_is_refused_by_its_type():
    with pytest.raises(ConfigError, match="body: got ndarray; must be a body such as halfspace"):
        gfmdlayer.run(LINE, body=np.ones(3))


def test_a_punch_that_is_a_word_gets_the_keys_of_its_shape():
    with pytest.raises(ConfigError, match=r"such as \{shape: sphere, radius: ...\}"):
        gfmdlayer.run(LINE, punch="sphere")
    with pytest.raises(ConfigError, match=r"is no file; a shape is an object such as Sphere\(radius=1.0\)"):
        gfmdlayer.solve(gfmdlayer.halfspace(1.0), "sphere", depth=0.1)
