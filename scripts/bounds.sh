#!/usr/bin/env bash
# Tries the package with the lowest versions that pyproject.toml allows and with the newest, each in an environment of its
# own: the quick variant of the paper's Figure 2, and tests that use every dependency. The folder is removed at the end.
# usage: bash scripts/test.sh bounds [pytest arguments]
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
tests=(tests/body tests/cli/test_completion.py tests/figures/test_plot.py tests/figures/test_loop.py
    tests/interactive/test_friction.py tests/interactive/test_run.py tests/interactive/test_solve.py
    tests/observables/test_contact_statistics.py tests/observables/test_friction.py tests/punch tests/results/test_results.py
    tests/transport)
[[ $# -gt 0 ]] && tests=("$@")

own=$(mktemp -d)
trap 'rm -rf "$own"' EXIT
python3 - "$own" <<'REQUIREMENTS'
import sys
import tomllib
from pathlib import Path

needed = tomllib.loads(Path("pyproject.toml").read_text())["project"]["dependencies"]
Path(sys.argv[1], "newest").write_text("\n".join(needed))
Path(sys.argv[1], "lowest").write_text("\n".join(each.replace(">=", "==") for each in needed))
REQUIREMENTS
export OPENBLAS_NUM_THREADS=1 MPLBACKEND=Agg PYTHONPATH=$root PYTHONNOUSERSITE=1
for bound in lowest newest; do
    warnings=() # an error each; but old libraries use what newer ones deprecate
    [[ $bound == lowest ]] && warnings=(-W default::DeprecationWarning -W default::PendingDeprecationWarning)
    python3 -m venv "$own/$bound-environment"
    python=$own/$bound-environment/bin/python
    echo "== $bound =="
    "$python" -m pip install --quiet --disable-pip-version-check -r "$own/$bound" pytest hypothesis jsonschema mpmath
    "$python" -m pip list --disable-pip-version-check | grep -iE "^(numba|numpy|scipy|h5py|h5netcdf|xarray|pydantic) "
    XDG_CACHE_HOME=$own/$bound-cache "$python" -m gfmdlayer run configs/figure2-quick.yaml --out "$own/$bound-results"
    XDG_CACHE_HOME=$own/$bound-cache "$python" -m pytest -q -p no:cacheprovider "${warnings[@]}" -m "not slow" "${tests[@]}"
done
