#!/usr/bin/env bash
# From a fresh clone to the quick variant of the paper's Figure 2: environment, run, figure.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
bash scripts/environment.sh mpi

export PATH="$root/.venv/bin:$PATH"
cores=$(python -c 'import os; print(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count())')
mpirun -n "$cores" gfmdlayer run configs/figure2-quick.yaml
figures=$(gfmdlayer plot results/figure2-quick)

printf -v here %q "$root"

cat <<END

data     $root/results/figure2-quick/sweep.h5  (each case: cases/NNNN.h5)
figure   $root/${figures//$'\n'/$'\n'figure   $root/}

This command computes the paper's full Figure 2 (16384 points, 1600 steps per case):

    (cd $here && . .venv/bin/activate && mpirun -n $cores gfmdlayer run configs/figure2.yaml && gfmdlayer plot results/figure2)
END
