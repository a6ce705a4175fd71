"""Cases over several ranks: the results of one process, resumed bit for bit, refused where not possible."""

import shutil
import subprocess
import sys
from contextlib import chdir
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

from gfmdlayer.config import load
from gfmdlayer.study.case_run import ending_together
from gfmdlayer.study.groups import _Group, input_errors_together, with_shared_solver

MPIRUN = Path(sys.executable).parent / "mpirun"
SURFACE = """\
name: rough
grid: {points: [40, 36], period: 1.0}
layer: {thickness: 0.1, material: {model: zener, G0: 1.0, Ginf: 10.0, tau: 0.1}}
punch: {shape: self_affine, hurst: 0.8, rms_slope: 0.1, short_cutoff: 0.2, seed: 3}
trajectory: {control: load, load: 0.02, ramp_time: 0.2}
time: {end: 0.3, step: 0.1}
solver: {method: nested_gradient, tolerance: 1.0e-10}
output: {snapshots: [0.2, 0.3], patches: true, histograms: {pressure: {max: 0.5, bins: 4}}}
"""
ROUGH = "self_affine, hurst: 0.8, rms_slope: 0.1, short_cutoff: 0.2, seed: 3"
ATTRACTIVE = SURFACE.replace("method: nested_gradient, ", "")
ATTRACTIVE = ATTRACTIVE.replace("control: load, load: 0.02", "control: depth, depth: 0.01")
ATTRACTIVE += "interface: {law: exponential, work: 2.0e-4, range: 4.0e-3}\n"
COULOMB = "{law: coulomb, coefficient: 0.3}"
RUBBING = SURFACE.replace("method: nested_gradient, ", "") + f"interface: {COULOMB}\n"
HARD = "{law: hard_wall, hardness: 0.4}"
# Any boundary and punch, motion, hardness, attraction and friction, stresses below the surface. Steps of the
# adhesive case have a V-cycle.
CASES = {
    "rough": SURFACE,
    "isolated": SURFACE.replace("period: 1.0", "period: [1.0, 0.9], boundary: isolated")
    .replace("load: 0.02", "force: 0.02").replace("control: load", "control: force")
    .replace(ROUGH, "parabola").replace(", histograms: {pressure: {max: 0.5, bins: 4}}", ""),
    "one isolated axis": SURFACE
    .replace("period: 1.0", "period: [1.0, 0.9], boundary: [isolated, periodic], datum: 2.0")
    .replace("load: 0.02", "force: 0.02").replace("control: load", "control: force")
    .replace(ROUGH, "parabola").replace(", histograms: {pressure: {max: 0.5, bins: 4}}", ""),
    "sliding": SURFACE.replace("ramp_time: 0.2", "ramp_time: 0.2, velocity: 1.0").replace("0.3", "0.4")
    .replace("patches: true", "patches: true, inside: {depths: [0.03, 0.1], every: 1}")
    + f"interface: {HARD}\n",
    "adhesive": ATTRACTIVE.replace("[40, 36]", "[72, 60]").replace("0.3", "0.4"),
    "smooth": ATTRACTIVE.replace("ramp_time: 0.2", "ramp_time: 0.2, velocity: 1.0")
    .replace(ROUGH, "parabola"),
    "partial slip": RUBBING.replace(COULOMB, f"[{COULOMB}, {HARD}]").replace(
        "ramp_time: 0.2", "ramp_time: 0.2, tangential: {displacement: 2.0e-3, start: 0.1, ramp_time: 0.2}"
    ).replace("patches: true", "patches: true, inside: {depths: [0.03, 0.15], every: 1}"),
    "creepage": RUBBING.replace(ROUGH, "parabola").replace("0.3, step: 0.1", "0.4, step: 0.05")
    .replace("ramp_time: 0.2", "ramp_time: 0.2, velocity: 0.5, creepage: {x: 0.01, spin: 0.1}"),
}  # fmt: skip
MEASURED = """
punch: {shape: topography, file: heights.npy, detrend: paraboloid, taper: 0.3}
sweep: {trajectory.load: [0.01, 0.02]}
"""


def configure():
    for name, text in CASES.items():
        Path(f"{name}.yaml").write_text(text)


@pytest.fixture(autouse=True)
def configuration():
    configure()


def case(folder, index=0):
    with xarray.open_dataset(Path(folder, f"cases/{index:04d}.h5"), engine="h5netcdf") as found:
        return found.load()


# Runs of configurations, each into the folder of its name; the death of a rank after a step.
PROGRAM = """
import os, shutil, signal, sys
from gfmdlayer.cli import main
from gfmdlayer.study.case_run import Checkpoints
from mpi4py import MPI

def several(*names, ranks=2):
    options = "--ranks-per-case", str(ranks), "--checkpoint-every", "0", "--out"
    return max([main(["run", f"{name.removesuffix('-killed')}.yaml", *options, name]) for name in names])

def kill(victim, end, advance=Checkpoints.advance):
    def killed(self, time):
        advance(self, time)
        if MPI.COMM_WORLD.Get_rank() == victim and time > end:
            os.kill(os.getpid(), signal.SIGKILL)
    Checkpoints.advance = killed
"""


def over_ranks(ranks, program):
    given = [str(MPIRUN), "-n", str(ranks), sys.executable, "-c", PROGRAM + program]
    return subprocess.run(given, capture_output=True, text=True, timeout=240, check=False)


@pytest.fixture(scope="module")
def of_two_ranks(tmp_path_factory):
    """A folder with the results of all cases, each computed by two ranks, and of three that were killed."""
    folder = tmp_path_factory.mktemp("ranks")
    with chdir(folder):
        configure()
        assert over_ranks(2, "kill(1, 0.15); several('adhesive-killed')").returncode != 0
        shutil.copytree("adhesive-killed", "begun")
        for program in (
            "several('adhesive-killed'); kill(0, 0.15); several('sliding-killed')",
            "kill(1, 0.25); several('sliding-killed')",
            "several('sliding-killed'); kill(1, 0.25); several('partial slip-killed')",
        ):
            process = over_ranks(2, program)
            assert process.returncode != 0
            assert process.stderr.count("goes on from time") == 1, process.stderr
        assert case("adhesive-killed").time[-1] == 0.4
        for name in ("begun", "partial slip-killed"):
            left = {path.name for path in Path(f"{name}/cases").iterdir()}
            assert left >= {"0000.checkpoint", "0000.snapshots"}
        process = over_ranks(2, f"several('partial slip-killed'); sys.exit(several(*{[*CASES]}))")
    assert process.returncode == 0, process.stderr
    assert process.stderr.count("goes on from time") == 1, process.stderr
    assert process.stderr.count("1 case; 1 group of 2 MPI ranks") == len(CASES) + 1
    return folder


def test_ranks_have_the_results_of_one_process(of_two_ranks, run_here):
    for name in CASES:
        run_here(f"{name}.yaml", Path(name))
        one, two = case(name), case(of_two_ranks / name)
        assert_alike(one, two, name)
        assert two.attrs["digest"] == one.attrs["digest"]
        found = sorted(path.name for path in (of_two_ranks / name / "cases").iterdir())
        assert found == [".lock", "0000.h5", "0000.xdmf"]


def assert_alike(one, two, name, within=1e-9):
    assert set(one.variables) == set(two.variables)
    # Solved to 1e-10, the first residual above it and the last below differ between orders of summation,
    # and so does the bound on the margin, which is found to some percent.
    for column in set(one.data_vars) - {"residual", "iterations", "transforms", "margin"}:
        # The residual of the balance is a difference of energies, which agree to 1e-9 of the work; the
        # error of the area comes from second differences of fields, and agrees to 1e-9 of the area.
        # Tractions are solved as vectors.
        wholes = {"energy_residual": "work", "area_error": "area_interpolated"}
        wholes |= {"shear_y": "shear_x", "transverse_force": "tangential_force"}
        wholes |= {"slip_velocity_y": "slip_velocity_x", "slip_heat": "work"}
        wholes["contact_area_error"] = "contact_area_interpolated"
        of = one[wholes.get(column, column)]
        scale = float(np.abs(of).max()) or 1.0
        atol = (within if one[column].dtype == np.float64 else 1e-7) * scale  # or single precision
        np.testing.assert_allclose(two[column], one[column], rtol=0, atol=atol, err_msg=f"{name}: {column}")


@pytest.mark.slow
def test_three_ranks_have_the_results_of_one_process(run_here):
    process = over_ranks(3, f"sys.exit(several(*{[*CASES]}, ranks=3))")
    assert process.returncode == 0, process.stderr
    for name in CASES:
        run_here(f"{name}.yaml", Path("one", name))
        # Pressures of the shortest waves are some tens of residuals apart.
        assert_alike(case(Path("one", name)), case(name), name, within=1e-8)


@pytest.mark.parametrize("name", ["adhesive", "sliding", "partial slip"])
def test_a_case_whose_rank_is_killed_is_resumed_bit_for_bit(name, of_two_ranks, bits):
    """A punch that attracts or rubs loses its second rank; a moving one on a body with memory both."""
    assert bits(of_two_ranks / f"{name}-killed") == bits(of_two_ranks / name)


def test_groups_share_a_sweep_of_a_measured_surface_that_no_rank_holds(of_two_ranks, run_here):
    """Ranks that make no groups, or go on with a case that other ranks began, are refused once."""
    np.save("heights.npy", np.random.default_rng(2).normal(size=(40, 36)).cumsum(axis=1))
    text = SURFACE.replace(next(line for line in SURFACE.splitlines() if line.startswith("punch")), MEASURED)
    Path("groups.yaml").write_text(text.replace("end: 0.3", "end: 0.2").replace(", 0.3]", "]"))
    shutil.copytree(of_two_ranks / "begun", "adhesive")
    process = over_ranks(
        4,
        "assert several('groups') == 0; "
        "sys.exit(several('rough', ranks=3) + 2 * several('adhesive', ranks=4))",
    )
    assert process.returncode == 6, process.stderr
    assert process.stderr.count("got 4 ranks; must be a multiple of 3") == 1
    assert not Path("rough").exists()
    assert process.stderr.count("was written by 2 ranks a case") == 1
    assert "Traceback" not in process.stderr
    assert "2 cases; 2 groups of 2 MPI ranks" in process.stderr
    run_here("groups.yaml", Path("one"))
    for index in (0, 1):
        one, two = case("one", index), case("groups", index)
        for name in ("gap", "pressure", "displacement", "depth"):
            np.testing.assert_allclose(
                two[name], one[name], rtol=0, atol=1e-9 * float(np.abs(one[name]).max())
            )


@pytest.mark.parametrize(
    ("before", "after", "key", "words"),
    [
        ("[40, 36]", "64", "grid.points", "got a line"),
        ("nested_gradient", "nested_gradient", "grid.points", "at most 9 ranks"),
        ("nested_gradient", "active_set", "solver.method", "nested_gradient or newton with 3 ranks a case"),
        ("snapshots", "keep_state: true, snapshots", "output.keep_state", "must be false"),
        (ROUGH, "topography, file: rough.txt", "punch", "file: got .txt, not .npy"),
    ],
)  # fmt: skip
def test_what_ranks_cannot_share_is_refused_before_work(before, after, key, words):
    Path("rough.txt").write_text("1 2")
    Path("rough.yaml").write_text(SURFACE.replace(before, after))
    found = dict(input_errors_together(load("rough.yaml"), 30 if before == after else 3))
    assert words in found[key]


def test_ranks_take_nested_gradients_where_auto_takes_a_solver_of_one_process():
    hard = SURFACE.replace("method: nested_gradient, ", "")
    for text, before, after in (
        (hard.replace(ROUGH, "parabola"), "active_set", "nested_gradient"),
        (hard, "nested_gradient", "nested_gradient"),
        (ATTRACTIVE, "newton", "newton"),
    ):
        Path("rough.yaml").write_text(text)
        config = load("rough.yaml")
        assert config.contact_solver.method == before
        assert with_shared_solver(config).contact_solver.method == after


def test_an_interrupt_of_the_first_rank_ends_the_job(capsys):
    """The other ranks wait for it in the midst of the task: without an end they do so for ever."""

    class Control:
        def send(self, message, rank):
            assert (message, rank) == ((interrupted, (5,), {}), 1)

        def Abort(self, status):
            raise SystemExit(status)

    def interrupted(number, ranks):
        with ending_together(ranks):
            assert number == 5
            raise KeyboardInterrupt

    group = _Group.__new__(_Group)
    group._ranks = SimpleNamespace(count=2, control=Control())
    with pytest.raises(SystemExit, match="75"):
        group.run(interrupted, 5)
    assert capsys.readouterr().err == "gfmdlayer: stopped before the first case\n"
