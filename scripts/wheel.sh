#!/usr/bin/env bash
# Builds the source distribution and, from it, the wheel, into dist/, and tries the wheel where there is nothing else:
# in an empty folder, with an environment of its own, the quick variant of the paper's Figure 2, a comparison with
# theory, a cell of a notebook, and the tests of the source distribution that need no clone.
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
python3 -m venv environment
environment/bin/python -m pip install --quiet --disable-pip-version-check -c "$root/constraints.txt" \
    "$(echo "$root"/dist/*.whl)[mpi]" pytest hypothesis mpmath
export PATH="$empty/environment/bin:$PATH" PYTHONNOUSERSITE=1
unset PYTHONPATH

tar xzf "$root"/dist/*.tar.gz
rm -r gfmdlayer-*/gfmdlayer # the sources: what follows is the wheel's
cd gfmdlayer-*/
gfmdlayer run configs/figure2-quick.yaml
gfmdlayer plot results/figure2-quick
gfmdlayer verify --quick >/dev/null
python - <<'CELL'
from pathlib import Path

import gfmdlayer

assert Path(gfmdlayer.__file__).is_relative_to(Path("../environment").resolve()), gfmdlayer.__file__
data = gfmdlayer.run({"time": {"end": 1.0, "step": 0.1}})
print(gfmdlayer.__version__, float(data.mean_pressure[-1]))
CELL
python -m pytest -q -m "not slow" tests/test_interfaces.py tests/body/test_layer.py
echo "dist/: $(cd "$root/dist" && echo *)"
