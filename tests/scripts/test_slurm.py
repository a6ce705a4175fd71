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


@pytest.mark.parametrize(
    "script",
    [
        *("slurm/ranks.sbatch", "slurm/array.sbatch", "slurm/submit.sh", "slurm/site.example.sh"),
        "scripts/slurm_node.sh",
    ],
)
def test_scripts_are_sound_shell(script):
    assert subprocess.run(["bash", "-n", str(ROOT / script)], check=False).returncode == 0


def test_where_slurm_cannot_be_brought_up_the_trial_says_so():
    script = (
        f"id() {{ echo 1000; }}; nproc() {{ echo 2; }}; gfmdlayer() {{ :; }}; . {ROOT}/scripts/slurm_node.sh"
    )
    process = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert (process.returncode, process.stdout) == (0, "skipped: a Slurm node needs root\n")


# The site file, and the submission that reads it.

SBATCH = """#!/bin/bash
echo "sbatch $*" >>"$LOG"
env | grep "^SBATCH_" | sort >>"$LOG"
echo "$((40 + $(grep -c "^sbatch" "$LOG")))"
"""
CHECK = """#!/bin/bash
echo "memory     about 2.5 GB a process"
echo "disk       about 1.12 MB in $PWD/results/sweep"
"""


def submitted(log, tmp_path, *options, site="", status=0):
    """Run submit.sh with a site file beside stand-ins; return its process and what sbatch was given."""
    for name, text in (("sbatch", SBATCH), ("gfmdlayer", CHECK)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    (tmp_path / "sweep.yaml").write_text("name: sweep\n")
    (tmp_path / "own.sh").write_text(site)
    command = ["bash", str(ROOT / "slurm" / "submit.sh"), *options]
    given = {"GFMDLAYER_SITE": str(tmp_path / "own.sh")}
    process = subprocess.run(
        command, env=os.environ | given, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert process.returncode == status, process.stderr
    return process, log.read_text().splitlines() if log.exists() else []


def test_a_submission_takes_account_partition_and_memory(log, tmp_path):
    site = "export SBATCH_ACCOUNT=rubber SBATCH_PARTITION=long SBATCH_CONSTRAINT=zen4 SBATCH_EXPORT=NONE\n"
    process, lines = submitted(log, tmp_path, "--ranks", "64", "sweep.yaml", "--time", "10:00", site=site)
    assert lines[0] == (
        f"sbatch --parsable --mem-per-cpu=3950M --time 10:00 --ntasks=64 {ROOT}/slurm/ranks.sbatch sweep.yaml"
    )
    known = [
        "SBATCH_ACCOUNT=rubber",
        "SBATCH_CONSTRAINT=zen4",
        f"SBATCH_EXPORT=GFMDLAYER_SITE={tmp_path}/own.sh",
    ]
    assert lines[1:] == [*known, "SBATCH_PARTITION=long"]
    assert process.stdout.splitlines()[-1] == "submitted 41"


def test_where_requeue_is_forbidden_a_chain_goes_on(log, tmp_path):
    _, lines = submitted(log, tmp_path, "--array", "16", "--chain", "3", "sweep.yaml", site="REQUEUE=no\n")
    assert [line.partition(" --no-requeue ")[2].split()[0] for line in lines] == [
        f"{ROOT}/slurm/array.sbatch", "--dependency=afterany:41", "--dependency=afterany:42",
    ]  # fmt: skip


def test_a_dry_submission_submits_nothing(log, tmp_path):
    process, lines = submitted(log, tmp_path, "--array", "2", "--dry", "sweep.yaml")
    assert not lines
    assert "--array=1-2" in process.stdout


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("sweep.yaml",), "must have --ranks N or --array N"),
        (("--ranks", "many", "sweep.yaml"), "--ranks: got many; must be a whole number from 1"),
        (("--ranks", "2", "sweap.yaml"), "sweap.yaml: no such file"),
        (("--ranks", "2", "sweep.yaml", "other.yaml"), "got other.yaml beside sweep.yaml"),
    ],
)
def test_a_wrong_submission_says_why(log, tmp_path, options, said):
    process, lines = submitted(log, tmp_path, *options, status=2)
    assert said in process.stderr
    assert not lines


@pytest.mark.parametrize("script", JOB)
def test_a_job_reads_the_site_file(script, log, tmp_path):
    """A requeue that the site forbids is left to the chain; the environment is made where there is none."""
    (tmp_path / "slurm").mkdir()
    (tmp_path / "slurm" / "site.sh").write_text('echo "site" >>"$LOG"\nREQUEUE=no\n')
    status, lines = job(script, log, 75, signal.SIGUSR1, SLURM_SUBMIT_DIR=str(tmp_path))
    assert status == 75
    assert lines == ["site", *COMMAND[script], "begun", "USR1", "ended"]


def test_results_are_written_on_scratch_and_copied_back(log, tmp_path, monkeypatch):
    """Also those of a run that its time limit stops; the next one begins from them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gfmdlayer").write_text(
        '#!/bin/bash\necho "gfmdlayer $*" >>"$LOG"\necho case >>"$4/0000.h5"\nexit 75\n'
    )
    (tmp_path / "slurm").mkdir()
    (tmp_path / "slurm" / "site.sh").write_text("SCRATCH=$SLURM_SUBMIT_DIR/local-$SLURM_JOB_ID\n")
    for run, number in enumerate(("17", "18")):
        place = {"SLURM_SUBMIT_DIR": str(tmp_path), "SLURM_JOB_ID": number}
        assert job("ranks.sbatch", log, 75, None, **place)[0] == 75
        assert f"gfmdlayer run sweep.yaml --out {tmp_path}/local-{number}/here" in log.read_text()
        assert (tmp_path / "here" / "0000.h5").read_text() == "case\n" * (run + 1)
