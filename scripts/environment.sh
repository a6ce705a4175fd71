#!/usr/bin/env bash
# Makes the clone's own environment, .venv, with the given extras; does nothing where it is up to date and has them.
# usage: bash scripts/environment.sh EXTRAS        for example: mpi,test
set -euo pipefail

extras=$1
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
python=$root/.venv/bin/python

# The clone's own place counts too: the environment's scripts do not survive a move.
state=$({ echo "$root"; cat "$root/pyproject.toml" "$root/constraints.txt"; } | sha256sum)
for marker in "$root"/.venv/gfmdlayer-*; do
    had=,${marker##*/gfmdlayer-},
    for extra in ${extras//,/ }; do
        [[ $had == *,$extra,* ]] || continue 2
    done
    [[ -x $python && -f $marker && $(<"$marker") == "$state" ]] && exit 0
done

if [[ ! -x $python ]]; then
    echo "making $root/.venv"
    python3 -m venv "$root/.venv"
fi
echo "installing gfmdlayer[$extras] into $root/.venv"
(cd "$root" && "$python" -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e ".[$extras]")
"$python" -m compileall -q -j 0 "$root/.venv/lib" >/dev/null || true # on all cores; some files are templates
echo "$state" >"$root/.venv/gfmdlayer-$extras"
