"""What goes wrong before it begins is found at the start and told in a line."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gfmdlayer.execution import guards

TINY = """\
name: tiny
grid: {points: 32}
time: {end: 0.03, step: 0.01}
trajectory: {ramp_time: 0.03}
"""
ONE, TWO = frozenset({0}), frozenset({0, 1})


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tiny.yaml").write_text(TINY)


def gfmdlayer(*arguments: str, before: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    script = f"{before}\nimport sys\nfrom gfmdlayer.cli import main\nsys.exit(main(sys.argv[1:]))"
    return subprocess.run(
        [sys.executable, "-c", script, *arguments],
        env=os.environ | environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("members", "threads", "crowded"),
    [
        ([("a", TWO)], 2, ""),
        ([("a", TWO)], 3, "1 processes with 3 threads each on 2 cores of a:"),
        ([("a", TWO), ("a", TWO), ("b", TWO)], 1, ""),
        ([("a", TWO), ("b", ONE), ("b", ONE)], 1, "2 processes with one thread each on 1 cores of b:"),
        ([("a", ONE), ("a", frozenset({1}))], 1, ""),  # each bound to a core of its own
        ([("a", ONE), ("a", ONE), ("b", ONE), ("b", ONE)], 1, "(and 1 more hosts)"),
    ],
)  # fmt: skip
def test_more_threads_than_cores_are_told(
    members: list[tuple[str, guards.Cores]], threads: int, crowded: str
) -> None:
    warnings = guards.crowding(members, threads)
    assert len(warnings) == bool(crowded)
    assert not crowded or crowded in warnings[0]


def test_the_largest_number_of_threads_counts() -> None:
    assert guards.threads({}) == 1
    assert guards.threads({"OMP_NUM_THREADS": "4,2", "MKL_NUM_THREADS": "3"}) == 4
    assert guards.threads({"OMP_NUM_THREADS": "many"}) == 1


@pytest.mark.parametrize(("jobs", "threads"), [("1", "4096"), ("4096", "1")])
def test_a_run_warns_of_crowding_and_goes_on(jobs: str, threads: str) -> None:
    # Processes begin only as there are cases for them.
    process = gfmdlayer("run", "tiny.yaml", "--jobs", jobs, OMP_NUM_THREADS=threads)
    assert process.returncode == 0, process.stderr
    assert "warning: " in process.stderr
    assert (
        f"{jobs} processes with {'one thread' if threads == '1' else '4096 threads'} each" in process.stderr
    )


def test_two_mpi_libraries_in_one_environment_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site"
    for number, package in enumerate(guards.MPI_PACKAGES):
        folder = site / f"{package.replace('-', '_')}-{number}.0.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {number}.0\n")
    monkeypatch.setattr(sys, "path", [str(site)])
    importlib.invalidate_caches()
    (warning,) = guards.several_mpi_libraries()
    assert "two MPI libraries in one environment (mpich 0.0, openmpi 1.0, impi-rt 2.0)" in warning
    monkeypatch.setattr(guards, "MPI_PACKAGES", ("mpich", "absent"))
    assert guards.several_mpi_libraries() == []


HOLD = """
import sys, h5py
with h5py.File(sys.argv[1], sys.argv[2]):
    print("open", flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize("name", ["sweep.h5", "cases/0000.h5"])
def test_a_file_that_somebody_writes_is_not_replaced_under_their_hands(name: str) -> None:
    assert gfmdlayer("run", "tiny.yaml", "--out", "out").returncode == 0
    path = Path("out") / name
    before = path.read_bytes()
    command = [sys.executable, "-c", HOLD, str(path)]
    for mode, status in (("r+", 2), ("r", 0)):
        with subprocess.Popen([*command, mode], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
            assert other.stdout is not None
            assert other.stdout.readline() == b"open\n"
            process = gfmdlayer("run", "tiny.yaml", "--out", "out")
            assert process.returncode == status, process.stderr
            assert ("is open for writing in another program" in process.stderr) == (status == 2)
            if status == 2:
                assert str(path) in process.stderr
                assert path.read_bytes()[64:] == before[64:]  # HDF5 marks an open file in its first block
            other.communicate()


def test_a_full_disk_is_found_before_any_work() -> None:
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))"
    process = gfmdlayer("run", "tiny.yaml", "--out", "out", before=full)
    assert process.returncode == 2
    assert "out: cannot be written (File too large" in process.stderr
    assert "Traceback" not in process.stderr
    assert not list(Path("out").rglob("*.part"))
    assert gfmdlayer("run", "tiny.yaml", "--out", "out").returncode == 0


def test_what_will_not_fit_is_told() -> None:
    assert guards.lack_of_space(Path("not/made/yet"), 1.0) == []
    (warning,) = guards.lack_of_space(Path("not/made/yet"), 1e21)
    assert warning.startswith("not/made/yet: about 1e+09 TB will be written, but only ")
    assert guards.lack_of_memory(1.0) == []
    assert len(guards.lack_of_memory(1e18)) == 1
    shown = gfmdlayer("check", "tiny.yaml", "--set", "grid.points=[32768, 32768]", "--jobs", "1000").stdout
    assert "warning: about" in shown
    assert "of memory are needed" in shown


def test_check_tells_the_time_left_from_what_is_finished() -> None:
    Path("tiny.yaml").write_text(TINY + "sweep: {layer.thickness: [0.02, 0.1, 0.2, .inf]}\n")
    assert "time  " not in gfmdlayer("check", "tiny.yaml").stdout
    assert gfmdlayer("run", "tiny.yaml", "--shard", "1/2").returncode == 0
    assert "on one core for the 2 cases left" in gfmdlayer("check", "tiny.yaml").stdout
    assert "on one core" not in gfmdlayer("check", "tiny.yaml", "--set", "time.end=0.04").stdout
