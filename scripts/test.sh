#!/usr/bin/env bash
# Runs the tests in the clone's own environment, without those marked slow; arguments go to pytest.
# All of them:  bash scripts/test.sh -m ""
# With the lowest and the newest versions of all dependencies:  bash scripts/test.sh bounds
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
if [[ ${1-} == bounds ]]; then
    shift
    exec bash scripts/bounds.sh "$@"
fi
bash scripts/environment.sh mpi,test

export PATH="$root/.venv/bin:$PATH"
# Threads of BLAS, on small matrices, wait for those of the other process of tests; the command line sets this too.
export OPENBLAS_NUM_THREADS=1
# The tests start Python some 150 times: it keeps what it has compiled, which takes a quarter of each start.
unset PYTHONDONTWRITEBYTECODE
python -m pytest -n 2 --dist worksteal -m "not slow" "$@"
