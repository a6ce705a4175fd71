"""The same runs over MPI ranks: same bits, one voice, and no rank left hanging."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from gfmdlayer.execution.workers import LauncherError, launched_size, threads_each

MPIRUN = Path(sys.executable).parent / "mpirun"  # that of the environment's own MPI library
TINY = """\
name: tiny
grid: {points: 32}
time: {end: 0.03, step: 0.01}
trajectory: {ramp_time: 0.03}
"""
SWEEP = "sweep: {layer.thickness: [0.02, 0.1, .inf]}\n"


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert MPIRUN.exists(), "the tests need the MPI of the extra `mpich`: pip install -e '.[mpich,test]'"
    monkeypatch.chdir(tmp_path)
    Path("tiny.yaml").write_text(TINY + SWEEP)


def over_ranks(number: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [str(MPIRUN), "-n", str(number), sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def gfmdlayer(ranks: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    return over_ranks(ranks, "-m", "gfmdlayer", *arguments)


def contents(directory: str) -> dict[str, bytes]:
    """Return the bits of every variable of every file in a results folder."""
    found: dict[str, bytes] = {}
    for path in sorted(Path(directory).rglob("*.h5")):
        with h5py.File(path) as h5:
            found |= {f"{path.relative_to(directory)}:{key}": np.asarray(h5[key]).tobytes() for key in h5}
    return found


def test_ranks_give_the_same_bits_as_one() -> None:
    for ranks in (1, 2, 3):
        process = gfmdlayer(ranks, "run", "tiny.yaml", "--out", f"ranks-{ranks}")
        assert process.returncode == 0, process.stderr
    assert len([key for key in contents("ranks-1") if key.endswith("mean_pressure")]) == 4
    assert contents("ranks-1") == contents("ranks-2") == contents("ranks-3")


def test_all_ranks_compute() -> None:
    # Ten cases of the same length: neither rank can have taken all of them.
    Path("tiny.yaml").write_text(TINY + f"sweep: {{punch.radius: {[0.2 + 0.01 * i for i in range(10)]}}}\n")
    script = """
import os
from gfmdlayer.execution import sweep
from gfmdlayer.config import load
from gfmdlayer.execution.workers import assemble
from gfmdlayer.execution.schedule import Outcome

def who(case, **_):
    import time
    time.sleep(0.1)
    return Outcome(case.index, "complete", reason=str(os.getpid()))

with assemble() as pool:
    if pool is not None:
        from gfmdlayer.execution.folder import Folder
        from pathlib import Path
        from gfmdlayer.execution.schedule import Schedule
        outcomes = list(Schedule(pool, who, Folder(Path()), print).run(sweep.cases(load("tiny.yaml"))))
        assert sorted(outcome.index for outcome in outcomes) == list(range(10))
        print("computed by", len({outcome.reason for outcome in outcomes}))
"""
    Path("who.py").write_text(script)
    process = over_ranks(2, "who.py")
    assert "computed by 2" in process.stdout, process.stderr


def test_only_one_rank_speaks() -> None:
    assert gfmdlayer(2, "run", "tiny.yaml").stdout == "complete: results/tiny/sweep.h5\n"
    process = gfmdlayer(2, "run", "tiny.yaml", "--set", "time.end=0.04")
    assert process.returncode == 2
    assert process.stderr.count("another configuration") == 1
    assert "Traceback" not in process.stderr


def test_a_failing_case_does_not_stop_the_others() -> None:
    Path("tiny.yaml").write_text(TINY + "sweep: {solver.max_iterations: [1, 20000, 30000]}\n")
    process = gfmdlayer(2, "run", "tiny.yaml", "--out", "out")
    assert process.returncode == 1
    assert "0000: ConvergenceError" in process.stdout
    assert sorted(path.name for path in Path("out/cases").glob("[0-9]*")) == [
        "0000.failed", "0001.h5", "0002.h5",
    ]  # fmt: skip


@pytest.mark.parametrize("signum", [signal.SIGTERM, signal.SIGUSR1])
def test_a_signal_to_mpirun_stops_all_ranks_and_the_next_run_takes_up(signum: signal.Signals) -> None:
    Path("tiny.yaml").write_text(TINY + "sweep: {time.end: [60, 61, 0.03]}\n")
    command = [str(MPIRUN), "-n", "2", sys.executable, "-m", "gfmdlayer", "run", "tiny.yaml", "--out", "out"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 60
        while not all(Path(f"out/cases/{index:04d}.running").exists() for index in (0, 1)):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signum)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 75, errors
    assert "Traceback" not in errors
    left = {path.name for path in Path("out/cases").iterdir()}
    assert left >= {".lock", "0000.checkpoint", "0001.checkpoint", "0002.h5"}
    assert not [name for name in left if name.endswith(("failed", "running", "part"))]
    process_again = gfmdlayer(2, "run", "tiny.yaml", "--out", "out")
    assert process_again.returncode == 0
    assert "1 complete already" in process_again.stderr
    assert process_again.stderr.count("goes on from time") == 2, process_again.stderr


@pytest.mark.parametrize("crash", ["if pool is not None: raise RuntimeError('lost')", "os._exit(3)"])
def test_a_crash_of_one_rank_ends_the_job_instead_of_hanging_it(crash: str) -> None:
    script = f"""
import os, time
from gfmdlayer.execution.workers import assemble
with assemble() as pool:
    if pool is not None:
        pool.executor.submit(time.sleep, 600)
        time.sleep(0.5)
        {crash}
"""
    begun = time.monotonic()
    process = over_ranks(2, "-c", script)
    assert process.returncode != 0
    assert time.monotonic() - begun < 60


@pytest.mark.parametrize("victim", ["manager", "worker"])
def test_a_rank_killed_in_a_sweep_ends_the_job_and_the_rerun_takes_up_the_rest(victim: str) -> None:
    Path("tiny.yaml").write_text(TINY + "sweep: {time.end: [60, 61, 0.03]}\n")
    command = [str(MPIRUN), "-n", "2", sys.executable, "-m", "gfmdlayer", "run", "tiny.yaml", "--out", "out"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        # The longest case, 1, goes to the other rank first; rank 0 takes the shortest, then case 0.
        told = Path(f"out/cases/{0 if victim == 'manager' else 1:04d}.running")
        deadline = time.monotonic() + 60
        while not (told.exists() and Path("out/cases/0002.h5").exists()):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.01)
        os.kill(json.loads(told.read_text())["pid"], signal.SIGKILL)
        process.communicate(timeout=30)
    assert process.returncode != 0
    again = gfmdlayer(2, "run", "tiny.yaml", "--out", "out")
    assert again.returncode == 0, again.stderr
    assert "1 complete already" in again.stderr
    assert sorted(path.name for path in Path("out/cases").iterdir()) == [
        ".lock", "0000.h5", "0001.h5", "0002.h5",
    ]  # fmt: skip


def test_more_ranks_than_cores_are_told() -> None:
    cores = len(os.sched_getaffinity(0))
    process = gfmdlayer(cores + 1, "run", "tiny.yaml", "--out", "out")
    assert process.returncode == 0
    assert f"warning: {cores + 1} processes with one thread each on {cores} cores" in process.stderr


@pytest.mark.parametrize("variable", ["PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS"])
def test_a_launcher_that_the_mpi_library_does_not_know_is_refused(variable: str) -> None:
    # The library looks at none of these by itself, or is told here that it is alone.
    script = f"""
import os, sys
from mpi4py import MPI
os.environ[{variable!r}] = "4"
from gfmdlayer.cli import main
sys.exit(main(["run", "tiny.yaml"]))
"""
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert process.returncode == 2
    assert "started 4 processes" in process.stderr
    assert "use that library's mpirun" in process.stderr
    assert "Traceback" not in process.stderr
    assert not Path("results").exists()


def test_processes_and_ranks_exclude_each_other() -> None:
    process = gfmdlayer(2, "run", "tiny.yaml", "--jobs", "2")
    assert process.returncode == 2
    assert "leave --jobs out" in process.stderr


@pytest.mark.parametrize(
    ("environment", "size"),
    [
        ({}, None),
        ({"PMI_RANK": "0", "PMI_SIZE": "8"}, 8),
        ({"OMPI_COMM_WORLD_SIZE": "3", "SLURM_STEP_NUM_TASKS": "1"}, 3),
        ({"SLURM_STEP_NUM_TASKS": "5"}, 5),
        ({"PMIX_RANK": "0"}, 0),
        ({"SLURM_JOB_ID": "17"}, None),
    ],
)
def test_launchers_are_known_by_their_variables(environment: dict[str, str], size: int | None) -> None:
    assert launched_size(environment) == size


def test_threads_are_one_each_unless_asked() -> None:
    environment: dict[str, str] = {}
    assert threads_each(environment) == 1
    assert set(environment.values()) == {"1"}
    environment = {"OMP_NUM_THREADS": "4"}
    assert threads_each(environment) == 4
    assert environment["OMP_NUM_THREADS"] == "4"
    assert environment["OPENBLAS_NUM_THREADS"] == "1"
    assert threads_each(environment, 2) == 2
    assert environment["OMP_NUM_THREADS"] == "2"
    assert threads_each({"OMP_NUM_THREADS": "3,2"}) == 3  # for nested regions
    with pytest.raises(LauncherError, match="--threads 0: must be 1 or more"):
        threads_each(environment, 0)


def test_mpi_is_not_loaded_without_a_launcher() -> None:
    script = """
import sys
from gfmdlayer.cli import main
main(["run", "tiny.yaml"])
print("mpi4py" in sys.modules)
"""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PMI", "OMPI"))}
    process = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, env=environment
    )
    assert process.stdout.splitlines()[-1] == "False"
