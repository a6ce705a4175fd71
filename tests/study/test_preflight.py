"""Checks before a run: crowded cores, MPI libraries, files open elsewhere, disk and memory."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from gfmdlayer.cli import main
from gfmdlayer.study import preflight
from gfmdlayer.study.folder import FolderError
from gfmdlayer.study.workers import assemble
from tests.studies import TINY

ONE, TWO = frozenset({0}), frozenset({0, 1})


@pytest.fixture(autouse=True)
def configuration():
    Path("tiny.yaml").write_text(TINY)


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
def test_more_threads_than_cores_are_warned_of(members, threads, crowded):
    warnings = preflight.crowding(members, threads)
    assert len(warnings) == bool(crowded)
    assert not crowded or crowded in warnings[0]


def test_the_largest_number_of_threads_counts():
    assert preflight.threads({}) == 1
    assert preflight.threads({"OMP_NUM_THREADS": "4,2", "MKL_NUM_THREADS": "3"}) == 4
    assert preflight.threads({"OMP_NUM_THREADS": "many"}) == 1


def test_a_run_warns_of_crowding_and_goes_on(run_here, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "4096")
    summary, log = run_here("tiny.yaml")
    assert "warning: 1 processes with 4096 threads each" in log
    assert summary.count("complete") == 1


def test_a_pool_of_more_processes_than_cores_has_a_warning(monkeypatch):
    for variable in preflight.THREAD_VARIABLES:
        monkeypatch.setenv(variable, "1")
    with assemble(4096) as pool:  # processes begin only as there are cases for them
        assert pool is not None
        assert "4096 processes with one thread each" in pool.warnings[0]


def test_two_mpi_libraries_in_one_environment_are_warned_of(tmp_path, monkeypatch):
    site = tmp_path / "site"
    for number, package in enumerate(preflight.MPI_PACKAGES):
        folder = site / f"{package.replace('-', '_')}-{number}.0.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {number}.0\n")
    monkeypatch.setattr(sys, "path", [str(site)])
    importlib.invalidate_caches()
    (warning,) = preflight.several_mpi_libraries()
    assert "two MPI libraries in one environment (mpich 0.0, openmpi 1.0, impi-rt 2.0)" in warning
    monkeypatch.setattr(preflight, "MPI_PACKAGES", ("mpich", "absent"))
    assert preflight.several_mpi_libraries() == []


HOLD = """
import sys, h5py
for line in sys.stdin:
    path, mode = line.split()
    h5 = h5py.File(path, mode)
    print("open", flush=True)
    sys.stdin.readline()
    h5.close()
    print("closed", flush=True)
"""


def test_a_file_that_another_program_writes_is_not_replaced(run_here):
    run_here("tiny.yaml")
    command = [sys.executable, "-c", HOLD]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdin is not None
        assert other.stdout is not None
        for name in ("sweep.h5", "cases/0000.h5"):
            path = Path("out") / name
            before = path.read_bytes()
            for mode in ("r+", "r"):
                print(path, mode, file=other.stdin, flush=True)
                assert other.stdout.readline() == "open\n"
                if mode == "r" or name != "sweep.h5":  # a complete case is read, and stays as it is
                    assert run_here("tiny.yaml")[0].collected
                else:
                    with pytest.raises(FolderError, match=f"{path}: is open for writing in another program"):
                        run_here("tiny.yaml")
                    assert path.read_bytes()[64:] == before[64:]  # HDF5 marks an open file in its first block
                print(file=other.stdin, flush=True)
                assert other.stdout.readline() == "closed\n"


def test_too_little_disk_or_memory_is_warned_of(capsys):
    assert preflight.disk_warnings(Path("not/made/yet"), 1.0) == []
    (warning,) = preflight.disk_warnings(Path("not/made/yet"), 1e21)
    assert warning.startswith("not/made/yet: about 1e+09 TB will be written, but only ")
    assert preflight.memory_warnings(1.0) == []
    assert len(preflight.memory_warnings(1e18)) == 1
    assert main(["check", "tiny.yaml", "--set", "grid.points=[32768, 32768]", "--jobs", "1000"]) == 0
    shown = capsys.readouterr().out
    assert "warning: about" in shown
    assert "of memory are needed" in shown


def test_check_estimates_the_time_left_from_finished_cases(run_here, capsys):
    def checked(*more):
        assert main(["check", "tiny.yaml", "--out", "out", *more]) == 0
        return capsys.readouterr().out

    Path("tiny.yaml").write_text(TINY + "sweep: {layer.thickness: [0.02, 0.1, 0.2, .inf]}\n")
    assert "on one core\n" in checked()
    run_here("tiny.yaml")
    for number in (1, 3):
        Path(f"out/cases/000{number}.h5").unlink()
    assert "on one core for the 2 cases left" in checked()
    assert "cases left" not in checked("--set", "time.end=0.04")


def test_memory_is_compared_with_the_limits_of_the_job(monkeypatch):
    monkeypatch.setenv("SLURM_MEM_PER_CPU", "1000")
    monkeypatch.setenv("SLURM_CPUS_ON_NODE", "4")
    monkeypatch.setattr(preflight.resource, "getrlimit", lambda _: (10**9, 10**9))
    assert preflight.memory_limits()[1:] == [
        (4000 * 2**20, "Slurm (SLURM_MEM_PER_CPU) allows", True),
        (1e9, "ulimit -v allows a process", False),
        (1e9, "ulimit -d allows a process", False),
    ]
    (warning,) = preflight.memory_warnings(0.9e9, 6)
    assert (
        "by 6 processes, but Slurm (SLURM_MEM_PER_CPU) allows 4.19 GB: take fewer grid.points or --jobs"
        in warning
    )
    (warning,) = preflight.memory_warnings(1.1e9)
    assert warning.endswith("ulimit -v allows a process 1 GB: take fewer grid.points")
    assert preflight.memory_refusal(1.4e9) == []  # which may be half as much
    assert preflight.memory_refusal(1.6e9) != []


def test_memory_that_cannot_be_had_is_refused_before_any_work(monkeypatch, capsys):
    monkeypatch.setattr(preflight, "memory_limits", lambda: [(1e8, "this machine has", True)])
    assert main(["run", "tiny.yaml"]) == 2
    assert "of memory are needed, but this machine has 100 MB" in capsys.readouterr().err
    assert not list(Path("results").rglob("*.h5"))
