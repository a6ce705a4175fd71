"""Cases over several ranks: the results of one process, resumed bit for bit, refused where not possible."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import xarray

from gfmdlayer.config import load
from gfmdlayer.execution.case_run import ending_together
from gfmdlayer.execution.groups import _Group, input_errors_together, with_shared_solver

MPIRUN = Path(sys.executable).parent / "mpirun"
SURFACE = """\
name: rough
grid: {points: [40, 36], period: 1.0}
layer: {thickness: 0.1, material: {model: zener, G0: 1.0, Ginf: 10.0, tau: 0.1}}
punch: {shape: self_affine, hurst: 0.8, rms_slope: 0.1, short_cutoff: 0.2, seed: 3}
trajectory: {control: load, load: 0.02, ramp_time: 0.2}
time: {end: 0.4, step: 0.1}
solver: {method: nested_gradient, tolerance: 1.0e-10}
output: {snapshots: [0.2, 0.4], patches: true, histograms: {pressure: {max: 0.5, bins: 4}}}
"""
ROUGH = "self_affine, hurst: 0.8, rms_slope: 0.1, short_cutoff: 0.2, seed: 3"
ATTRACTIVE = SURFACE.replace("method: nested_gradient, ", "")
ATTRACTIVE = ATTRACTIVE.replace("control: load, load: 0.02", "control: depth, depth: 0.01")
ATTRACTIVE += "interface: {law: exponential, work: 2.0e-4, range: 4.0e-3}\n"
# Any boundary and punch, motion, hardness and attraction, stresses below the surface. Steps of the adhesive
# case have a V-cycle.
CASES = {
    "rough": SURFACE,
    "isolated": SURFACE.replace("period: 1.0", "period: [1.0, 0.9], boundary: isolated")
    .replace("load: 0.02", "force: 0.02").replace("control: load", "control: force")
    .replace(ROUGH, "parabola").replace(", histograms: {pressure: {max: 0.5, bins: 4}}", ""),
    "sliding": SURFACE.replace("ramp_time: 0.2", "ramp_time: 0.2, velocity: 1.0")
    .replace("patches: true", "patches: true, inside: {depths: [0.03, 0.1], every: 1}")
    + "interface: {law: hard_wall, hardness: 0.4}\n",
    "adhesive": ATTRACTIVE.replace("[40, 36]", "[72, 60]"),
    "smooth": ATTRACTIVE.replace("ramp_time: 0.2", "ramp_time: 0.2, velocity: 1.0")
    .replace(ROUGH, "parabola"),
}  # fmt: skip
MEASURED = """
punch: {shape: topography, file: heights.npy, detrend: paraboloid, taper: 0.3}
sweep: {trajectory.load: [0.01, 0.02]}
"""


@pytest.fixture(autouse=True)
def configuration() -> None:
    Path("rough.yaml").write_text(SURFACE)


def command(ranks: int, config: str, *options: str) -> list[str]:
    return [str(MPIRUN), "-n", str(ranks), sys.executable, "-m", "gfmdlayer", "run", config, *options]


def run(ranks: int, config: str, *options: str) -> subprocess.CompletedProcess[str]:
    given = command(ranks, config, *options)
    return subprocess.run(given, capture_output=True, text=True, timeout=240, check=False)


def case(folder: str, index: int = 0) -> xarray.Dataset:
    with xarray.open_dataset(f"{folder}/cases/{index:04d}.h5", engine="h5netcdf") as found:
        return found.load()


# Runs of the configurations that are named, each into the folder of this name.
SEVERAL = """
import sys
from gfmdlayer.cli import main
options = "--ranks-per-case", "2", "--checkpoint-every", "0", "--out"
sys.exit(max([main(["run", f"{name}.yaml", *options, f"{name}-ranks"]) for name in sys.argv[1:]]))
"""


def run_several(names: Iterable[str], program: str = SEVERAL) -> subprocess.CompletedProcess[str]:
    given = [str(MPIRUN), "-n", "2", sys.executable, "-c", program, *names]
    return subprocess.run(given, capture_output=True, text=True, timeout=240, check=False)


def test_ranks_have_the_results_of_one_process(run_here: Callable[..., Any]) -> None:
    for name, text in CASES.items():
        Path(f"{name}.yaml").write_text(text)
    process = run_several(CASES)
    assert process.returncode == 0, process.stderr
    assert process.stderr.count("1 case; 1 group of 2 MPI ranks") == len(CASES)
    for name in CASES:
        run_here(f"{name}.yaml", Path(name))
        one, two = case(name), case(f"{name}-ranks")
        assert set(one.variables) == set(two.variables)
        # Solved to 1e-10, the first residual above it and the last below differ between orders of summation,
        # and so does the bound on the margin, which is found to some percent.
        for column in set(one.data_vars) - {"residual", "iterations", "transforms", "margin"}:
            # The residual of the balance is a difference of energies, which agree to 1e-9 of the work.
            of = one["work"] if column == "energy_residual" else one[column]
            scale = float(np.abs(of).max()) or 1.0
            atol = (1e-9 if one[column].dtype == np.float64 else 1e-7) * scale  # or single precision
            np.testing.assert_allclose(
                two[column], one[column], rtol=0, atol=atol, err_msg=f"{name}: {column}"
            )
        assert two.attrs["digest"] == one.attrs["digest"]
        found = sorted(path.name for path in Path(f"{name}-ranks/cases").iterdir())
        assert found == [".lock", "0000.h5", "0000.xdmf"]


def test_groups_share_a_sweep_of_a_measured_surface_that_no_rank_holds(run_here: Callable[..., Any]) -> None:
    np.save("heights.npy", np.random.default_rng(2).normal(size=(40, 36)).cumsum(axis=1))
    text = SURFACE.replace(next(line for line in SURFACE.splitlines() if line.startswith("punch")), MEASURED)
    Path("measured.yaml").write_text(text)
    process = run(4, "measured.yaml", "--ranks-per-case", "2", "--out", "groups")
    assert process.returncode == 0, process.stderr
    assert "2 cases; 2 groups of 2 MPI ranks" in process.stderr
    run_here("measured.yaml", Path("one"))
    for index in (0, 1):
        one, two = case("one", index), case("groups", index)
        for name in ("gap", "pressure", "displacement", "depth"):
            np.testing.assert_allclose(
                two[name], one[name], rtol=0, atol=1e-9 * float(np.abs(one[name]).max())
            )


KILLED_AT = """
import os, signal
from mpi4py import MPI
from gfmdlayer.execution.case_run import Checkpoints
advance = Checkpoints.advance

def killed_at(self, time):
    advance(self, time)
    if MPI.COMM_WORLD.Get_rank() == {victim} and time > {time}:
        os.kill(os.getpid(), signal.SIGKILL)

Checkpoints.advance = killed_at
"""


def test_a_case_whose_rank_is_killed_twice_is_resumed_bit_for_bit(
    bits: Callable[[Path], dict[str, bytes]],
) -> None:
    """A moving punch on a body with memory, and an attracting one."""
    for name, victim in ("sliding", 0), ("adhesive", 1), ("sliding", 1):
        Path(f"{name}.yaml").write_text(CASES[name].replace("step: 0.1", "step: 0.02"))
        process = run_several([name], KILLED_AT.format(victim=victim, time=0.1 * (victim + 1)) + SEVERAL)
        assert process.returncode != 0
        left = {path.name for path in Path(f"{name}-ranks/cases").iterdir()}
        assert left >= {"0000.checkpoint", "0000.journal"}
    refused = run(3, "sliding.yaml", "--ranks-per-case", "3", "--out", "sliding-ranks")
    assert refused.returncode == 2
    assert refused.stderr.count("was written by 2 ranks a case") == 1
    assert "Traceback" not in refused.stderr
    for name in ("sliding", "adhesive"):
        Path(f"{name}-whole.yaml").write_text(Path(f"{name}.yaml").read_text())
    resumed = run_several(["sliding", "adhesive"])
    assert resumed.stderr.count("goes on from time") == 2, resumed.stderr
    for name in ("sliding", "adhesive"):  # the plans of the killed run, which its results keep
        shutil.copytree(f"{name}-ranks/wisdom", f"{name}-whole-ranks/wisdom")
    whole = run_several(["sliding-whole", "adhesive-whole"])
    assert whole.returncode == 0, whole.stderr
    for name in ("sliding", "adhesive"):
        assert bits(Path(f"{name}-ranks")) == bits(Path(f"{name}-whole-ranks")), name


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
def test_what_ranks_cannot_share_is_refused_before_work(
    before: str, after: str, key: str, words: str
) -> None:
    Path("rough.txt").write_text("1 2")
    Path("rough.yaml").write_text(SURFACE.replace(before, after))
    found = dict(input_errors_together(load("rough.yaml"), 30 if before == after else 3))
    assert words in found[key]


def test_ranks_take_nested_gradients_where_auto_takes_a_solver_of_one_process() -> None:
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


def test_ranks_that_make_no_groups_are_refused_once() -> None:
    process = run(3, "rough.yaml", "--ranks-per-case", "2")
    assert process.returncode == 2
    assert process.stderr.count("got 3 ranks; must be a multiple of 2") == 1
    assert not Path("results").exists()


def test_an_interrupt_of_the_first_rank_ends_the_job(capsys: pytest.CaptureFixture[str]) -> None:
    """The other ranks wait for it in the midst of the task: without an end they do so for ever."""

    class Control:
        def send(self, message: object, rank: int) -> None:
            assert (message, rank) == ((interrupted, (5,), {}), 1)

        def Abort(self, status: int) -> None:
            raise SystemExit(status)

    def interrupted(number: int, ranks: Any) -> None:
        with ending_together(ranks):
            assert number == 5
            raise KeyboardInterrupt

    group = _Group.__new__(_Group)
    group._ranks = cast(Any, SimpleNamespace(count=2, control=Control()))
    with pytest.raises(SystemExit, match="75"):
        group.run(interrupted, 5)
    assert capsys.readouterr().err == "gfmdlayer: stopped before the first case\n"
