#!/usr/bin/env bash
# Runs the tests in the clone's own environment, without those marked slow; arguments go to pytest.
# All of them:  bash scripts/test.sh -m ""
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
bash scripts/environment.sh mpich,test

export PATH="$root/.venv/bin:$PATH"
python -m pytest -n 2 -m "not slow" "$@"
