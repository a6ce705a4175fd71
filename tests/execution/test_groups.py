"""Cases over several ranks: the results of one process, resumed bit for bit, refused where not possible."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import xarray

from gfmdlayer.config import load
from gfmdlayer.execution.case_run import ending_together
from gfmdlayer.execution.groups import _Group, input_errors_together

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
ISOLATED = """\
name: rough
grid: {points: [40, 36], period: [1.0, 0.9], boundary: isolated}
layer: {thickness: 0.1, material: {model: zener, G0: 1.0, Ginf: 10.0, tau: 0.1}}
punch: {shape: parabola, radius: 1.0}
trajectory: {control: force, force: 0.02, ramp_time: 0.2}
time: {end: 0.4, step: 0.1}
solver: {method: nested_gradient, tolerance: 1.0e-10}
output: {snapshots: [0.2, 0.4], patches: true}
"""
MEASURED = """
punch: {shape: topography, file: heights.npy, detrend: paraboloid, taper: 0.3}
sweep: {trajectory.load: [0.01, 0.02]}
"""


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rough.yaml").write_text(SURFACE)


def command(ranks: int, config: str, *options: str) -> list[str]:
    return [str(MPIRUN), "-n", str(ranks), sys.executable, "-m", "gfmdlayer", "run", config, *options]


def run(ranks: int, config: str, *options: str) -> subprocess.CompletedProcess[str]:
    given = command(ranks, config, *options)
    return subprocess.run(given, capture_output=True, text=True, timeout=240, check=False)


def case(folder: str, index: int = 0) -> xarray.Dataset:
    with xarray.open_dataset(f"{folder}/cases/{index:04d}.h5", engine="h5netcdf") as found:
        return found.load()


@pytest.mark.parametrize("text", [SURFACE, ISOLATED], ids=["periodic", "isolated"])
def test_ranks_have_the_results_of_one_process(run_here: Callable[..., Any], text: str) -> None:
    Path("rough.yaml").write_text(text)
    process = run(3, "rough.yaml", "--ranks-per-case", "3", "--out", "three")
    assert process.returncode == 0, process.stderr
    assert "1 case; 1 group of 3 MPI ranks" in process.stderr
    run_here("rough.yaml", Path("one"))
    one, three = case("one"), case("three")
    assert set(one.variables) == set(three.variables)
    # Solved to 1e-10, the first residual above it and the last below differ between orders of summation.
    for name in set(one.data_vars) - {"residual", "iterations", "transforms"}:
        # The residual of the balance is a difference of energies, which agree to 1e-9 of the work.
        of = one["work"] if name == "energy_residual" else one[name]
        scale = float(np.abs(of).max()) or 1.0
        np.testing.assert_allclose(three[name], one[name], rtol=0, atol=1e-9 * scale, err_msg=name)
    assert three.attrs["digest"] == one.attrs["digest"]
    assert sorted(path.name for path in Path("three/cases").iterdir()) == [".lock", "0000.h5", "0000.xdmf"]


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
import os, signal, sys
from mpi4py import MPI
from gfmdlayer.cli import main
from gfmdlayer.execution.case_run import Checkpoints
advance = Checkpoints.advance

def killed_at(self, time):
    advance(self, time)
    if MPI.COMM_WORLD.Get_rank() == {victim} and time > {time}:
        os.kill(os.getpid(), signal.SIGKILL)

Checkpoints.advance = killed_at
sys.exit(main())
"""


def test_a_case_whose_rank_is_killed_twice_is_resumed_bit_for_bit(
    bits: Callable[[Path], dict[str, bytes]],
) -> None:
    Path("rough.yaml").write_text(SURFACE.replace("step: 0.1", "step: 0.01"))
    options = "--ranks-per-case", "2", "--checkpoint-every", "0", "--out"
    for victim in (0, 1):
        program = KILLED_AT.format(victim=victim, time=0.1 * (victim + 1))
        given = [
            str(MPIRUN),
            "-n",
            "2",
            sys.executable,
            "-c",
            program,
            "run",
            "rough.yaml",
            *options,
            "killed",
        ]
        process = subprocess.run(given, capture_output=True, timeout=240, check=False)
        assert process.returncode != 0
        left = {path.name for path in Path("killed/cases").iterdir()}
        assert left >= {"0000.checkpoint", "0000.journal"}
    refused = run(3, "rough.yaml", "--ranks-per-case", "3", "--out", "killed")
    assert refused.returncode == 2
    assert refused.stderr.count("was written by 2 ranks a case") == 1
    assert "Traceback" not in refused.stderr
    resumed = run(2, "rough.yaml", *options, "killed")
    assert "goes on from time" in resumed.stderr, resumed.stderr
    shutil.copytree("killed/wisdom", "whole/wisdom")  # the plans of the killed run, which its results keep
    whole = run(2, "rough.yaml", *options, "whole")
    assert whole.returncode == 0, whole.stderr
    assert bits(Path("killed")) == bits(Path("whole"))


@pytest.mark.parametrize(
    ("before", "after", "key", "words"),
    [
        ("[40, 36]", "64", "grid.points", "got a line"),
        ("nested_gradient", "nested_gradient", "grid.points", "at most 9 ranks"),
        ("nested_gradient", "active_set", "solver.method", "must be nested_gradient with 3 ranks a case"),
        ("snapshots", "keep_state: true, snapshots", "output.keep_state", "must be false"),
        ("ramp_time", "velocity: 1.0, ramp_time", "trajectory", "moves the punch"),
        ("self_affine, hurst: 0.8, rms_slope: 0.1, short_cutoff: 0.2, seed: 3",
         "topography, file: rough.txt", "punch", "file: got .txt, not .npy"),
    ],
)  # fmt: skip
def test_what_ranks_cannot_share_is_refused_before_work(
    before: str, after: str, key: str, words: str
) -> None:
    Path("rough.txt").write_text("1 2")
    Path("rough.yaml").write_text(SURFACE.replace(before, after))
    found = dict(input_errors_together(load("rough.yaml"), 30 if before == after else 3))
    assert words in found[key]


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
