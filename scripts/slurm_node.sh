#!/usr/bin/env bash
# Tests the scripts in slurm/ on a Slurm of one node, which is stopped at the end.
# A sweep on ranks and a sweep of an array, each with too short a time limit, must be complete after requeues, and
# each case must run once. A sweep with a failing case must fail. A cancelled sweep must stay cancelled.
# Takes some ten minutes. Prints "skipped" and the reason if Slurm cannot start.
# usage: bash scripts/slurm_node.sh [--install]      as root, with gfmdlayer and its mpirun in the PATH or in .venv
# --install takes Slurm from Debian's packages where there is none.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export PATH="$PATH:$root/.venv/bin"
skip() { echo "skipped: $1"; exit 0; }
fail() { echo "FAILED: $1" >&2; exit 1; }

command -v gfmdlayer >/dev/null || fail "gfmdlayer is not in the PATH (scripts/environment.sh mpi,test)"
(($(nproc --all) >= 2)) || skip "two ranks need two cores"
[[ $(id -u) == 0 ]] || skip "a Slurm node needs root"
if ! command -v slurmctld slurmd munged >/dev/null; then
    [[ ${1-} == --install ]] || skip "Slurm is not installed; --install takes it from Debian's packages"
    command -v apt-get >/dev/null || skip "Slurm is not installed, and there is no apt-get"
    echo "installing slurm-wlm and munge"
    { apt-get update && apt-get install -y --no-install-recommends slurm-wlm munge; } >/dev/null 2>&1 ||
        skip "apt-get cannot install slurm-wlm and munge"
fi

# --- one node, in a folder of its own; only processes started here are ended ---

dir=$(mktemp -d)
daemons=()
take_down() {
    scancel --user=root 2>/dev/null || true
    sleep 1
    for ((i = ${#daemons[@]} - 1; i >= 0; i--)); do kill "${daemons[i]}" 2>/dev/null || true; done
    wait
    rm -rf "$dir"
}
trap take_down EXIT

host=$(hostname -s)
cores=$(nproc --all) # nproc alone counts the threads of OMP_NUM_THREADS
export SLURM_CONF=$dir/slurm.conf
mkdir "$dir"/{controller,node,work}
chmod 755 "$dir"
cat >"$SLURM_CONF" <<CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$((20000 + RANDOM % 5000))
SlurmdPort=$((25000 + RANDOM % 5000))
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$dir/munge.socket
StateSaveLocation=$dir/controller
SlurmdSpoolDir=$dir/node
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
MinJobAge=3600
KillWait=10
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores
PartitionName=debug Nodes=$host Default=YES State=UP
CONF

dd if=/dev/urandom of="$dir/munge.key" bs=128 count=1 status=none
chmod 400 "$dir/munge.key"
munged --foreground --force --socket="$dir/munge.socket" --key-file="$dir/munge.key" \
    --pid-file="$dir/munge.pid" --log-file="$dir/munge.log" --seed-file="$dir/munge.seed" >/dev/null 2>&1 &
daemons+=($!)
slurmctld -D >"$dir/slurmctld.log" 2>&1 &
daemons+=($!)
slurmd -D >"$dir/slurmd.log" 2>&1 &
daemons+=($!)
for ((i = 0; i < 60; i++)); do
    [[ $(sinfo --noheader --format=%T 2>/dev/null) == idle ]] && break
    sleep 1
done
if [[ $(sinfo --noheader --format=%T 2>/dev/null) != idle ]]; then
    tail -n 5 "$dir/slurmctld.log" "$dir/slurmd.log"
    skip "the node does not come up here"
fi
echo "$(sinfo --version) on $host, $cores cores"

# --- jobs, and how they must end ---

cd "$dir/work"
started=$SECONDS
shown() { scontrol show job "$1" | tr ' ' '\n' | grep -E '^(JobId|ArrayTaskId|JobState|Reason|Restarts|ExitCode)=' | paste -sd ' ' | sed 's/ JobId/\nJobId/g'; }
ended() { ! shown "$1" | grep -qE 'JobState=(PENDING|RUNNING|CONFIGURING|COMPLETING|REQUEUED|SUSPENDED)'; }
wait_for() { # JOB SECONDS
    for ((waited = 0; waited < $2; waited += 2)); do
        ended "$1" && return
        # Slurm lets a job wait for two minutes after a requeue; here it need not.
        if shown "$1" | grep -q Reason=BeginTime; then scontrol update JobId="$1" StartTime=now || true; fi
        sleep 2
    done
    shown "$1"
    tail -n 20 ./*.log
    fail "job $1 has not ended within $2 s"
}
must_be() { # JOB PATTERN TIMES
    shown "$1"
    (($(shown "$1" | grep -cE "$2") == $3)) || fail "job $1: must be $2"
}
requeued_and_complete() { # JOB OUT LOGS...
    local job=$1 out=$2 twice
    shift 2
    shown "$job" | grep -qE 'Restarts=[1-9]' || fail "job $job was never requeued; the limit was long enough"
    twice=$(grep -ho 'case [0-9]* complete' "$@" | sort | uniq -d | head -n 3)
    [[ -z $twice ]] || fail "run twice: $twice"
    gfmdlayer status "$out" | tee status
    grep -q "^$number cases: $number complete, 0 running, 0 failed, 0 waiting" status || fail "$out: not complete"
    [[ -f $out/sweep.h5 ]] || fail "$out: there is no sweep.h5"
}

# As many cases as fill two and a half minutes of two ranks: USR1@30 comes after 30 to 90 s of two minutes.
write_sweep() { # NAME NUMBER
    printf 'name: %s\ngrid: {points: 4096}\ntime: {end: 8.0, step: %s}\nsweep: {punch.radius: [%s]}\n' \
        "$1" "$step" "$(seq -s ', ' -f '%.5f' 0.25 0.00001 "$(awk "BEGIN {print 0.25 + ($2 - 1) * 1e-5}")")" >"$1.yaml"
}
step=0.005
write_sweep trial 2
gfmdlayer run trial.yaml 2>trial.log
seconds=$(sed -n 's/.*case 0001 complete in \([0-9.]*\) s.*/\1/p' trial.log)
number=$(awk "BEGIN {print int(2 * 150 / ($seconds > 0.1 ? $seconds : 0.1))}") # a short one is shown as 0.0 s
echo "a case takes $seconds s: $number cases"
write_sweep sweep "$number"
short=(--time=2 --signal=B:USR1@30)

echo "--- one job over two ranks, limit two minutes"
job=$(sbatch --parsable "${short[@]}" --ntasks=2 "$root/slurm/ranks.sbatch" sweep.yaml --out ranks)
wait_for "$job" 1800
must_be "$job" 'JobState=COMPLETED .*ExitCode=0:0' 1
requeued_and_complete "$job" ranks "gfmdlayer-$job.log"

echo "--- an array of two jobs over one sweep, limit two minutes"
job=$(sbatch --parsable "${short[@]}" --array=1-2 "$root/slurm/array.sbatch" sweep.yaml --out array)
wait_for "$job" 1800
must_be "$job" 'JobState=COMPLETED .*ExitCode=0:0' 2
requeued_and_complete "$job" array "gfmdlayer-${job}"_*.log
shards=$(grep -ho 'cases in shard [0-9/]*' "gfmdlayer-${job}"_*.log | sort | uniq -c)
echo "$shards"

echo "--- a case that fails"
job=$(sbatch --parsable --ntasks=2 "$root/slurm/ranks.sbatch" trial.yaml --out fails --set solver.max_iterations=1)
wait_for "$job" 120
must_be "$job" 'JobState=FAILED .*Restarts=0 .*ExitCode=1:0' 1

echo "--- a job that is cancelled"
job=$(sbatch --parsable --ntasks=2 "$root/slurm/ranks.sbatch" sweep.yaml --out cancelled)
until ls cancelled/cases/0001.h5 >/dev/null 2>&1; do sleep 1; done
scancel "$job"
wait_for "$job" 120
must_be "$job" 'JobState=CANCELLED .*Restarts=0 ' 1
echo "passed in $((SECONDS - started)) s"
