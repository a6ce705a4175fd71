"""Fits of force maps: resumed with the same bits, failures named by curve, one file of maps."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray

from gfmdlayer import cli, fit_indentation, fit_map, open_results
from gfmdlayer.fitting.estimates import FitOptions
from gfmdlayer.fitting.force_map import ForceMap, parameter_names
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.study.folder import FolderError
from gfmdlayer.study.workers import assemble
from tests.waiting import until

MPIRUN = Path(sys.executable).parent / "mpirun"
MODEL = {
    "layer": {"thickness": float("inf"), "material": {"model": "zener", "G0": 1.0, "Ginf": 1.0, "tau": 1.0}},
    "punch": {"shape": "parabola", "radius": 5.0},
}
YAML = """\
layer: {thickness: .inf, material: {model: zener, G0: 1, Ginf: 1, tau: 1}}
punch: {shape: parabola, radius: 5}
free: [layer.material.G0]
"""
BAD = 3  # the curve with a hole
MODULI = np.linspace(1.0, 2.0, 6)


@pytest.fixture(autouse=True)
def curves(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map(Path("map.h5"), MODULI)
    Path("model.yaml").write_text(YAML)


def write_map(path, moduli, bad=BAD):
    """Write Hertz's forces with noise, on a grid of 3 by 2."""
    depth = np.linspace(0.0, 0.2, 60)
    hertz = 8 / 3 * 5.0**0.5 * depth**1.5 / 0.5
    force = np.outer(moduli, hertz) + 0.01 * np.random.default_rng(0).standard_normal((moduli.size, 60))
    force[bad, 7] = np.nan
    with h5py.File(path, "w") as h5:
        h5["time"], h5["depth"], h5["force"] = depth, np.stack([depth] * moduli.size), force
        h5["x"], h5["y"] = np.arange(moduli.size) % 3 * 2.0, np.arange(moduli.size) // 3 * 1.0


def force_map(out, path="map.h5"):
    return ForceMap([Path(path)], Path(out), MODEL, ["layer.material.G0"], FitOptions())


def fitted(out, path="map.h5"):
    with assemble() as pool:
        assert pool is not None
        force_map(out, path).run(pool)


def bits(folder):
    """Return the bits of every variable of the map and of the fits."""
    found = {}
    for path in sorted(Path(folder).rglob("*.h5")):
        with h5py.File(path) as h5:
            for name in h5:
                values = np.asarray(h5[name])
                text = values.dtype.kind == "O"  # whose bytes are those of pointers
                found[f"{path.name}:{name}"] = b"|".join(values.ravel()) if text else values.tobytes()
    return found


def test_a_map_holds_the_moduli_at_their_places_and_names_the_curve_that_failed():
    fitted("out")
    with open_results("out") as found:
        assert found["G0"].dims == ("y", "x")
        values = found["G0"].to_numpy().ravel()
        errors = found["G0_error"].to_numpy().ravel()
        good = np.arange(6) != BAD
        assert np.isnan(values[BAD])
        assert (np.abs(values - MODULI)[good] < 5 * errors[good]).all()
        assert (found["G0_low"] < found["G0"]).to_numpy().ravel()[good].all()
        assert found.attrs["failed"].startswith("0003: curve map-3: CurveError")
        assert found["name"].sel(x=4.0, y=0.0).item() == "map-2"


def test_a_map_is_fitted_by_pixels_unless_it_is_asked_for_together(capsys):
    write_map(Path("map.h5"), MODULI, bad=())
    command = ["fit-indentation", "map.h5", "--model", "model.yaml"]
    assert cli.main([*command, "--out", "out"]) == 0
    assert "Fits of 6 curves, each by itself" in capsys.readouterr().out
    assert Path("out/map.png").exists()
    assert open_results("out")["G0"].shape == (2, 3)
    assert cli.main([*command, "--joint", "--out", "one.yaml"]) == 0
    assert "Fit of 6 curves" in capsys.readouterr().out
    assert cli.main([*command, "--each", "--joint"]) == 2
    assert cli.main([*command, "model.yaml"]) == 2
    assert "--joint compares several" in capsys.readouterr().err
    with pytest.raises(FitError, match=r"6 curves at different places: fit_map .*; joint=True"):
        fit_indentation("map.h5", "model.yaml")
    together = fit_indentation("map.h5", "model.yaml", joint=True)
    assert MODULI.min() < together["G0"].value < MODULI.max()  # by the residual of each


def test_a_map_from_python_has_the_numbers_of_the_command_line_and_names_what_failed():
    fitted("out")
    fits = fit_map("map.h5", "model.yaml")
    with open_results("out") as found:
        xarray.testing.assert_identical(fits["G0"], found["G0"].load())
    assert [*fits.failed] == ["map-3"]
    assert fits.failed["map-3"].startswith("CurveError: curve map-3")
    assert "failed: map-3: CurveError" in str(fits)
    assert fits.names == ("G0",)
    median = float(np.nanmedian(fits["G0"]))
    assert f"{median:.6g}" in str(fits).splitlines()[2]
    with pytest.raises(KeyError, match=r"E: must be one of G0"):
        fits["E"]
    fits.plot("map.png")
    assert Path("map.png").exists()


def test_curves_in_memory_are_a_map_that_goes_on_in_its_folder():
    depth = np.linspace(0.0, 0.2, 60)
    hertz = 8 / 3 * 5.0**0.5 * depth**1.5 / 0.5
    forces = [np.where(np.arange(60) == 7, np.nan, G) * hertz if G == 3 else G * hertz for G in (1, 2, 3, 4)]
    places = [{"x": x, "y": y} for y in (0.0, 1.0) for x in (0.0, 2.0)]
    held = [
        xarray.Dataset(
            {"time": ("row", depth), "depth": ("row", depth), "force": ("row", force)}, attrs=place
        )
        for force, place in zip(forces, places, strict=True)
    ]
    fits = fit_map(held, "model.yaml", out="out", jobs=2)
    np.testing.assert_allclose(fits["G0"], [[1, 2], [np.nan, 4]], rtol=1e-6)
    assert [*fits.failed] == ["2"]
    before = Path("out/cases/0001.h5").stat().st_mtime_ns
    fit_map(held, "model.yaml", out="out")
    assert Path("out/cases/0001.h5").stat().st_mtime_ns == before
    held[1]["force"] = 2 * held[1]["force"]
    with pytest.raises(FolderError, match="this fit used other data"):
        fit_map(held, "model.yaml", out="out")


def test_places_of_a_stage_that_scatter_are_a_grid_in_the_units_of_the_model():
    rng = np.random.default_rng(1)
    with h5py.File("map.h5", "r+") as h5:
        for key in "xy":
            values = h5[key][:]
            del h5[key]
            h5[key] = 1000 * (values + 0.01 * rng.standard_normal(6))
            h5[key].attrs["units"] = "nm"
    Path("model.yaml").write_text(YAML.replace("layer:", "units: {length: um, stress: Pa, time: s}\nlayer:"))
    fits = fit_map("map.h5", "model.yaml")
    assert fits["G0"].dims == ("y", "x")
    np.testing.assert_allclose(fits["x"], [0, 2, 4], atol=0.03)
    np.testing.assert_allclose(fits["y"], [0, 1], atol=0.03)
    assert fits["x"].attrs["units"] == "um"
    assert fits["G0"].attrs["units"] == "Pa"


def test_a_map_that_was_interrupted_goes_on_with_the_same_bits():
    fitted("whole")
    fitted("out")
    for lost in ("out/cases/0001.h5", "out/cases/0004.h5", "out/sweep.h5"):
        Path(lost).unlink()
    Path("out/cases/0002.h5").write_bytes(b"damaged")
    changed = bytearray(Path("out/cases/0005.h5").read_bytes())
    with h5py.File("out/cases/0005.h5") as h5:
        changed[h5["estimate"].id.get_offset()] ^= 1
    Path("out/cases/0005.h5").write_bytes(changed)
    kept = Path("out/cases/0000.h5").stat().st_mtime_ns
    fitted("out")
    assert Path("out/cases/0000.h5").stat().st_mtime_ns == kept
    assert Path("out/cases/0002.h5.aside").exists()
    assert Path("out/cases/0005.h5.aside").exists()
    assert bits("out") == bits("whole")


def test_curves_that_have_changed_and_other_models_are_refused(capsys):
    arguments = ["fit-indentation", "map.h5", "--model", "model.yaml", "--each", "--out", "out"]
    assert cli.main(arguments) == 1  # a curve failed
    assert "curve map-3" in capsys.readouterr().out
    Path("model.yaml").write_text(YAML.replace("radius: 5", "radius: 6"))
    assert cli.main(arguments) == 2
    assert "radius: 6" in capsys.readouterr().err
    Path("model.yaml").write_text(YAML)
    write_map(Path("map.h5"), 2 * MODULI)
    assert cli.main(arguments) == 2
    assert "this fit used other data" in capsys.readouterr().err
    Path("out/cases/my_analysis.h5").write_text("mine")
    assert cli.main([*arguments, "--restart"]) == 1
    assert Path("out/cases/my_analysis.h5").read_text() == "mine"
    assert open_results("out")["G0"].max() > 3


def test_status_and_plot_read_a_map(capsys):
    fitted("out")
    assert cli.main(["status", "out"]) == 0
    shown = capsys.readouterr().out
    assert "6 cases: 5 complete, 0 running, 1 failed, 0 waiting" in shown
    assert "curve map-3: CurveError" in shown
    assert cli.main(["plot", "out", "--kind", "map", "--out", "map.png"]) == 0
    assert Path("map.png").exists()
    assert cli.main(["plot", "out", "--kind", "curves"]) == 2


def test_a_curve_whose_name_is_no_text_is_fitted_and_named():
    depth = np.linspace(0.0, 0.2, 60)
    force = 8 / 3 * 5.0**0.5 * depth**1.5 / 0.5
    lines = "".join(f"{d},{d},{f}\n" for d, f in zip(depth, force, strict=True))
    Path("raw").mkdir()
    Path(os.fsdecode(b"raw/\xff.csv")).write_text(f"time,depth,force\n{lines}")
    fitted("out", "raw")
    with open_results("out") as found:
        assert found["name"].item() == "\\xff"


def test_a_damaged_list_of_curves_is_refused(capsys):
    fitted("out")
    written = Path("out/config.yaml").read_bytes()
    Path("out/config.yaml").write_bytes(written.replace(b"free:", b"fr\xffe:"))
    command = ["fit-indentation", "map.h5", "--model", "model.yaml", "--each", "--out", "out"]
    assert cli.main(command) == 2
    assert "contains results of another model or other curves" in capsys.readouterr().err


def test_curves_without_places_are_in_a_row():
    with h5py.File("map.h5", "r+") as h5:
        del h5["x"]
    fitted("out")
    with open_results("out") as found:
        assert found["G0"].dims == ("curve",)


def test_a_map_has_the_stiffness_that_is_fitted_since_it_is_uncertain():
    options = FitOptions(prescribed="base", stiffness=1e3, stiffness_error=0.1)
    with assemble() as pool:
        assert pool is not None
        ForceMap([Path("map.h5")], Path("out"), MODEL, ["layer.material.G0"], options).run(pool)
    with open_results("out") as found:
        known = found["stiffness"].to_numpy().ravel()
        errors = found["stiffness_error"].to_numpy().ravel()
    is_good = np.arange(MODULI.size) != BAD
    assert (np.isfinite(known) == is_good).all()
    assert (np.abs(np.log(known[is_good] / 1e3)) < 0.1).all()  # the force tells little of it
    assert (errors[is_good] < 0.11 * known[is_good]).all()


def test_a_folder_of_something_else_is_left_alone(capsys):
    Path("out").mkdir()
    Path("out/notes.txt").write_text("mine")
    assert cli.main(["fit-indentation", "map.h5", "--model", "model.yaml", "--each", "--out", "out"]) == 2
    assert "not a results folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("keys", "names"),
    [
        (["layer.material.G0", "layer.thickness"], ["G0", "thickness"]),
        (["layers[0].thickness", "layers[1].thickness"], ["layers[0].thickness", "layers[1].thickness"]),
    ],
)
def test_parameters_are_named_by_their_last_parts_where_these_differ(keys, names):
    assert parameter_names(keys) == names


@pytest.mark.slow
def test_a_map_over_ranks_that_is_killed_twice_has_the_same_bits():
    moduli = np.linspace(1.0, 2.0, 36)
    write_map(Path("map.h5"), moduli, bad=35)
    fitted("whole")
    command = [
        *(str(MPIRUN), "-n", "2", sys.executable, "-m", "gfmdlayer", "fit-indentation", "map.h5"),
        *("--model", "model.yaml", "--each", "--out", "out"),
    ]
    for wanted in (6, 18):
        kill_after(command, lambda wanted=wanted: len(list(Path("out/cases").glob("*.h5"))) >= wanted)
        assert not Path("out/sweep.h5").exists()
    assert subprocess.run(command, capture_output=True, timeout=300, check=False).returncode == 1
    assert bits("out") == bits("whole")


def kill_after(command, reached):
    """Start a run and kill all of its processes at once when it has come far enough."""
    run = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    until(reached, run)
    at_work = processes_here()
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    until(lambda: all(map(has_ended, at_work)))  # ranks have sessions of their own; the launcher ends first


def processes_here():
    """Return the other processes that work in this folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cwd"):
        with suppress(OSError):  # it has ended
            if entry.readlink() == Path.cwd() and int(entry.parent.name) != os.getpid():
                found.append(int(entry.parent.name))
    return found


def has_ended(process):
    """Tell whether all threads of a process have ended: only then are its locks free."""
    for thread in Path(f"/proc/{process}/task").glob("*/stat"):
        with suppress(OSError):
            if thread.read_text().rpartition(")")[2].split()[0] not in "ZX":
                return False
    return True
