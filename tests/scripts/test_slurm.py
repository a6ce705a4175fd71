"""The Slurm scripts pass signals on, wait for the run, and requeue where it can be taken up."""

import os
import signal
import subprocess
from pathlib import Path

import pytest

from tests.waiting import until

ROOT = Path(__file__).parents[2]
# Stands for gfmdlayer: notes its arguments, and ends a while after a signal, with a status of its own.
RUN = """#!/bin/bash
echo "gfmdlayer $*" >>"$LOG"
stop() { echo "$1" >>"$LOG"; sleep 0.1; echo ended >>"$LOG"; exit "$STATUS"; }
trap 'stop USR1' USR1
for each in HUP INT TERM USR2 XCPU; do trap "stop $each" $each; done
echo begun >>"$LOG"
[[ $LASTS == no ]] && exit "$STATUS"
for ((i = 0; i < 600; i++)); do sleep 0.1; done
"""
SCONTROL = '#!/bin/bash\necho "scontrol $*" >>"$LOG"\n'
MPIRUN = '#!/bin/bash\necho "mpirun $1 $2" >>"$LOG"\nshift 2\nexec "$@"\n'
JOB = {
    "ranks.sbatch": {"SLURM_JOB_ID": "17", "SLURM_NTASKS": "4"},
    "array.sbatch": {
        "SLURM_JOB_ID": "19", "SLURM_ARRAY_JOB_ID": "17", "SLURM_ARRAY_TASK_ID": "3",
        "SLURM_ARRAY_TASK_COUNT": "8", "SLURM_CPUS_PER_TASK": "2",
    },
}  # fmt: skip
REQUEUE = {"ranks.sbatch": "scontrol requeue 17", "array.sbatch": "scontrol requeue 17_3"}
COMMAND = {
    "ranks.sbatch": ["mpirun -n 4", "gfmdlayer run sweep.yaml --out here"],
    "array.sbatch": ["gfmdlayer run sweep.yaml --out here --jobs 2 --shard 3/8"],
}


@pytest.fixture
def log(tmp_path, monkeypatch):
    for name, text in (("gfmdlayer", RUN), ("scontrol", SCONTROL), ("mpirun", MPIRUN)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setenv("LOG", str(tmp_path / "log"))
    return tmp_path / "log"


def job(script, log, status, signum, **environment):
    given = {"STATUS": str(status), "LASTS": "yes" if signum else "no"} | JOB[script] | environment
    command = ["bash", str(ROOT / "slurm" / script), "sweep.yaml", "--out", "here"]
    with subprocess.Popen(command, env=os.environ | given) as process:
        if signum:
            until(lambda: log.exists() and "begun" in log.read_text())
            process.send_signal(signum)
        return process.wait(timeout=120), log.read_text().splitlines()


@pytest.mark.parametrize("script", JOB)
def test_a_run_stopped_in_time_is_requeued_when_it_has_ended(script, log):
    status, log_lines = job(script, log, 75, signal.SIGUSR1)
    assert status == 75
    assert log_lines == [*COMMAND[script], "begun", "USR1", "ended", REQUEUE[script]]


@pytest.mark.parametrize("script", JOB)
@pytest.mark.parametrize(
    ("status", "signum", "environment"),
    [
        (0, None, {}),
        (1, None, {}),
        (2, None, {}),
        (0, signal.SIGUSR1, {}),  # complete just in time
        (1, signal.SIGUSR1, {}),
        (75, signal.SIGTERM, {}),  # cancelled
        (75, signal.SIGUSR1, {"SLURM_RESTART_COUNT": "100"}),
    ],
)
def test_any_other_end_is_that_of_the_job(script, log, status, signum, environment):
    found, log_lines = job(script, log, status, signum, **environment)
    assert found == status
    assert not any(line.startswith("scontrol") for line in log_lines)
    assert (log_lines[-1] == "ended") == (signum is not None)


@pytest.mark.parametrize("script", JOB)
@pytest.mark.parametrize("name", ["HUP", "TERM", "USR2", "XCPU"])  # bash ignores INT in the background
def test_every_signal_reaches_the_run(script, name, log):
    found, log_lines = job(script, log, 75, signal.Signals[f"SIG{name}"])
    assert found == 75
    known = {"ranks.sbatch": {"INT", "TERM"}}.get(script, {name})  # others end an MPI launcher
    assert log_lines[-2:] == [name if name in known else "USR1", "ended"]


@pytest.mark.parametrize("script", ["slurm/ranks.sbatch", "slurm/array.sbatch", "scripts/slurm_node.sh"])
def test_scripts_are_sound_shell(script):
    assert subprocess.run(["bash", "-n", str(ROOT / script)], check=False).returncode == 0


def test_where_slurm_cannot_be_brought_up_the_trial_says_so():
    script = (
        f"id() {{ echo 1000; }}; nproc() {{ echo 2; }}; gfmdlayer() {{ :; }}; . {ROOT}/scripts/slurm_node.sh"
    )
    process = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert (process.returncode, process.stdout) == (0, "skipped: a Slurm node needs root\n")
