#!/usr/bin/env bash
# Builds the source distribution and, from it, the wheel, into dist/, and tries the wheel where there is nothing else:
# in an empty folder, with an environment of its own, the quick variant of the paper's Figure 2, a comparison with
# theory, a cell of a notebook, and the tests of the source distribution that need no clone.
# With the word quick the wheel takes its dependencies and compiled kernels from the clone, and the tests are left out.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
bash scripts/environment.sh mpi,test
rm -rf dist
.venv/bin/python -m build --outdir dist . >/dev/null
if python3 -m zipfile -l dist/*.whl | grep -E '__pycache__|\.nb[ci]|\.lock'; then
    echo "the wheel has files of one machine" >&2
    exit 1
fi

empty=$(mktemp -d)
trap 'rm -rf "$empty"' EXIT
cd "$empty"
wheel=$(echo "$root"/dist/*.whl)
if [[ ${1-} == quick ]]; then
    "$root/.venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --target environment "$wheel"
    export PATH="$root/.venv/bin:$PATH" PYTHONPATH="$empty/environment"
    # The kernels too, where the clone has them: the wheel's sources, compared by their contents, are the same.
    (cd "$root" && find gfmdlayer -name '*.nb[ci]' -exec cp --parents -t "$empty/environment" {} +)
else
    python3 -m venv environment
    environment/bin/python -m pip install --quiet --disable-pip-version-check -c "$root/constraints.txt" \
        "$wheel[mpi]" pytest hypothesis mpmath
    export PATH="$empty/environment/bin:$PATH"
    unset PYTHONPATH
fi
export PYTHONNOUSERSITE=1

tar xzf "$root"/dist/*.tar.gz
rm -r gfmdlayer-*/gfmdlayer # the sources: what follows is the wheel's
cd gfmdlayer-*/
mpirun -n 2 python -m gfmdlayer run configs/figure2-quick.yaml
python -m gfmdlayer plot results/figure2-quick
python - <<'CELL'
from pathlib import Path

import gfmdlayer

assert Path(gfmdlayer.__file__).is_relative_to(Path("../environment").resolve()), gfmdlayer.__file__
data = gfmdlayer.run({"time": {"end": 1.0, "step": 0.1}})
print(gfmdlayer.__version__, float(data.mean_pressure[-1]))
CELL
if [[ ${1-} != quick ]]; then
    python -m gfmdlayer verify --quick >/dev/null
    python -m pytest -q -m "not slow" tests/test_interfaces.py tests/body/test_layer.py
fi
echo "dist/: $(cd "$root/dist" && echo *)"
