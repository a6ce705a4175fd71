"""Runs over MPI ranks: same bits, one log, and no rank left hanging."""

import json
import os
import signal
import subprocess
import sys
from contextlib import chdir
from pathlib import Path

import pytest

from gfmdlayer.config import Config
from gfmdlayer.files.locks import read_json
from gfmdlayer.study.folder import MARK
from gfmdlayer.study.preflight import launched_size
from gfmdlayer.study.workers import threads_each
from tests.studies import TINY
from tests.waiting import SLOWLY, until

MPIRUN = Path(sys.executable).parent / "mpirun"  # that of the environment's own MPI library
CORES = len(os.sched_getaffinity(0))
SWEEP = "sweep: {layer.thickness: [0.02, 0.1, .inf]}\n"


@pytest.fixture(autouse=True)
def configuration():
    assert MPIRUN.exists(), "the tests need the MPI of the extra `mpi`: pip install -e '.[mpi,test]'"
    Path("tiny.yaml").write_text(TINY + SWEEP)


def over_ranks(number, *arguments):
    command = [str(MPIRUN), "-n", str(number), sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


PROGRAM = """
from gfmdlayer.cli import main
run = ["run", "tiny.yaml", "--out"]
first = main([*run, "ranks"])
raise SystemExit(first + 4 * main([*run, "other"]) + 16 * main([*run, "jobs", "--jobs", "2"]))
"""


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    """The folder and the process of commands over more ranks than cores.

    A sweep whose first case fails; a folder of another configuration; processes beside ranks.
    """
    folder = tmp_path_factory.mktemp("sweep")
    text = TINY + "solver: {method: fire}\nsweep: {solver.max_iterations: [1, 20000, 30000]}\n"
    (folder / "tiny.yaml").write_text(text)
    (folder / "other").mkdir()
    (folder / "other/config.yaml").write_text(MARK + Config(name="other").dump())
    with chdir(folder):
        return folder, over_ranks(CORES + 1, "-c", PROGRAM)


def test_ranks_give_the_same_bits_as_one_process(sweep, run_here, bits):
    run_here(str(sweep[0] / "tiny.yaml"), sweep[0] / "one")
    found = bits(sweep[0] / "ranks")
    assert len([key for key in found if key.endswith("mean_pressure")]) == 3
    assert found == bits(sweep[0] / "one")


def test_one_rank_writes_to_the_terminal_and_a_failing_case_does_not_stop_the_others(sweep):
    folder, process = sweep
    assert process.returncode % 4 == 1, process.stderr
    assert process.stdout.startswith("1 of 3 cases failed:\n")
    assert "0000: ConvergenceError" in process.stdout
    assert len(process.stdout.splitlines()) == 3
    assert process.stderr.count("3 cases; ") == 1
    warning = f"warning: {CORES + 1} processes with one thread each on {CORES} cores"
    assert process.stderr.count(warning) == 1
    names = {path.name for path in (folder / "ranks/cases").glob("[0-9]*")}
    assert names >= {"0000.failed", "0001.h5", "0002.h5"}
    assert "0000.h5" not in names


def test_what_ranks_cannot_do_is_refused(sweep):
    folder, process = sweep
    assert process.returncode // 4 == 2 + 4 * 2
    assert not list(folder.glob("other/**/*.h5"))
    assert not (folder / "jobs").exists()
    assert process.stderr.count("another configuration") == 1
    assert "leave --jobs out" in process.stderr
    assert "Traceback" not in process.stderr


def test_all_ranks_compute():
    # Ten cases of the same length: neither rank can have taken all of them.
    Path("tiny.yaml").write_text(TINY + f"sweep: {{punch.radius: {[0.2 + 0.01 * i for i in range(10)]}}}\n")
    script = """
import os
from gfmdlayer.study.cases import cases
from gfmdlayer.config import load
from gfmdlayer.study.workers import assemble
from gfmdlayer.study.schedule import Outcome

def who(case, **_):
    import time
    time.sleep(0.3)
    return Outcome(case.index, "complete", reason=str(os.getpid()))

with assemble() as pool:
    if pool is not None:
        from gfmdlayer.study.folder import Folder
        from pathlib import Path
        from gfmdlayer.study.schedule import Schedule
        outcomes = list(Schedule(pool, who, Folder(Path()), print).run(cases(load("tiny.yaml"))))
        assert sorted(outcome.index for outcome in outcomes) == list(range(10))
        print("computed by", len({outcome.reason for outcome in outcomes}))
"""
    Path("who.py").write_text(script)
    process = over_ranks(2, "who.py")
    assert "computed by 2" in process.stdout, process.stderr


# Two cases take 10 s over slow steps, and the third one two steps.
TAKING_LONG = TINY + "sweep: {time.end: [2, 2.1, 0.03]}\n"
SLOWLY_OVER_RANKS = [str(MPIRUN), "-n", "2", sys.executable, SLOWLY, "run", "tiny.yaml", "--out", "out"]


def steps(index):
    return (read_json(Path(f"out/cases/000{index}.running")) or {}).get("steps", 0)


def test_a_signal_to_mpirun_stops_all_ranks_and_the_next_run_resumes(run_here):
    """One that mpirun hands on to its ranks, and one by which it ends."""
    Path("tiny.yaml").write_text(TAKING_LONG)
    for signum in (signal.SIGUSR1, signal.SIGTERM):
        for checkpoint in Path("out/cases").glob("*.checkpoint"):  # of the first: the second makes its own
            checkpoint.unlink()
        with subprocess.Popen(SLOWLY_OVER_RANKS, stderr=subprocess.PIPE, text=True) as process:
            until(lambda: all(steps(index) > 0 for index in (0, 1)), process)
            process.send_signal(signum)
            _, errors = process.communicate(timeout=300)
        assert process.returncode == 75, errors
        assert "Traceback" not in errors
        left = {path.name for path in Path("out/cases").iterdir()}
        assert left >= {".lock", "0000.checkpoint", "0001.checkpoint", "0002.h5"}
        assert not [name for name in left if name.endswith(("failed", "running", "part"))]
    summary, log = run_here("tiny.yaml")
    assert summary.count("complete") == 3
    assert "1 complete already" in log
    assert log.count("goes on from time") == 2, log


@pytest.mark.parametrize("victim", ["manager", "worker"])
def test_a_rank_killed_in_a_sweep_ends_the_job_and_the_next_run_resumes(victim, run_here):
    Path("tiny.yaml").write_text(TAKING_LONG)
    command = [*SLOWLY_OVER_RANKS, "--checkpoint-every", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        # The longest case, 1, goes to the other rank first; rank 0 takes the shortest, then case 0.
        index = 0 if victim == "manager" else 1
        told = Path(f"out/cases/000{index}.running")
        awaited = told, told.with_suffix(".checkpoint"), Path("out/cases/0002.h5")
        until(lambda: all(path.exists() for path in awaited), process)
        os.kill(json.loads(told.read_text())["pid"], signal.SIGKILL)
        process.communicate(timeout=120)
    assert process.returncode != 0
    summary, log = run_here("tiny.yaml")
    assert summary.count("complete") == 3
    assert "1 complete already" in log
    assert f"case {index:04d} goes on from time" in log
    assert sorted(path.name for path in Path("out/cases").iterdir()) == [
        ".lock", "0000.h5", "0001.h5", "0002.h5",
    ]  # fmt: skip


# What rank 0 does while the other rank works for long.
MANAGING = """
import os, sys, time
from gfmdlayer.study.workers import assemble
with assemble() as pool:
    if pool is not None:
        pool.executor.submit(time.sleep, 600)
        time.sleep(0.5)
        {}
"""
# What the other rank does while rank 0 compiles for long.
COMPILING = """
import os, sys, time
from gfmdlayer.cli import run as verb
from gfmdlayer.study import run
def compile_for_long(*_, **__):
    open("compiling", "w").close()
    time.sleep(600)
def meanwhile():
    while not os.path.exists("compiling"):
        time.sleep(0.01)
    {}
run.warm_up, verb.prepare = compile_for_long, meanwhile
from gfmdlayer.cli import main
sys.exit(main(["run", "tiny.yaml"]))
"""


ENDS = {
    "computes": (MANAGING, ("raise RuntimeError('lost')", "os._exit(3)", "sys.exit(3)")),
    "compiles": (COMPILING, ("os.kill(os.getpid(), 9)", "os._exit(3)", "sys.exit(3)")),
}


@pytest.mark.parametrize(("other", "end"), [(key, end) for key, (_, ends) in ENDS.items() for end in ends])
def test_a_rank_that_dies_while_the_other_works_ends_the_job(other, end):
    """Within the two minutes of `over_ranks`, instead of hanging it."""
    program, _ = ENDS[other]
    assert over_ranks(2, "-c", program.format(end)).returncode not in (0, 75)


def test_ranks_end_when_the_launcher_dies_while_rank_0_compiles():
    Path("compiling.py").write_text(COMPILING.format("time.sleep(600)"))
    command = [str(MPIRUN), "-n", "2", sys.executable, "compiling.py"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            until(Path("compiling").exists, process)
            (proxy,) = children(process.pid)  # the launcher's process on this host, which started the ranks
            ranks = children(proxy)
            assert len(ranks) == 2
            os.kill(proxy, signal.SIGKILL)
            until(lambda: not any(Path(f"/proc/{rank}").exists() for rank in ranks))  # none is left behind
        finally:
            process.kill()


def children(pid):
    """Return the processes that a process has started."""
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(child) for child in found.split()]


def test_a_launcher_of_another_mpi_library_is_refused():
    # MPI is initialised before the variables are set, hence alone.
    script = """
import os
from mpi4py import MPI
from gfmdlayer.cli import main
for variable in ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS"):
    os.environ[variable] = "4"
    print(main(["run", "tiny.yaml"]))
    del os.environ[variable]
"""
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert process.stdout.split() == ["2"] * 3
    assert process.stderr.count("started 4 processes") == 3
    assert process.stderr.count("use that library's mpirun") == 3
    assert "Traceback" not in process.stderr
    assert not Path("results").exists()


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
def test_launchers_are_known_by_their_variables(environment, size):
    assert launched_size(environment) == size


def test_threads_are_one_each_unless_asked():
    environment = {}
    assert threads_each(environment) == 1
    assert set(environment.values()) == {"1"}
    environment = {"OMP_NUM_THREADS": "4"}
    assert threads_each(environment) == 4
    assert environment["OMP_NUM_THREADS"] == "4"
    assert environment["OPENBLAS_NUM_THREADS"] == "1"
    assert threads_each(environment, 2) == 2
    assert environment["OMP_NUM_THREADS"] == "2"
    assert threads_each({"OMP_NUM_THREADS": "3,2"}) == 3  # for nested regions


@pytest.mark.parametrize("free", [1, 2, 64])
def test_one_process_alone_leaves_its_threads_to_the_size_of_the_case(free, monkeypatch):
    monkeypatch.setattr("gfmdlayer.study.workers.cores", lambda: frozenset(range(free)))
    environment = {}
    assert threads_each(environment, jobs=1) == (None if free > 1 else 1)
    assert environment["OMP_NUM_THREADS"] == "1"  # of the processes that this one may start
    assert environment["OPENBLAS_NUM_THREADS"] == "1"
    assert threads_each({}, 1, jobs=1) == threads_each({"OMP_NUM_THREADS": "1"}, jobs=1) == 1
    assert threads_each({}, jobs=2) == threads_each({"PMI_SIZE": "2"}, jobs=1) == 1
