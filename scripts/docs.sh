#!/usr/bin/env bash
# Builds the documentation into docs/_build/html; a warning, a broken link, a misspelt word
# or text that a browser cuts off is an error.
# Makes the environment where there is none.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bash "$root/scripts/environment.sh" mpi,test,docs
cd "$root"
.venv/bin/codespell ./*.md docs configs
.venv/bin/python -m sphinx -q -W --keep-going -j 2 -b html docs docs/_build/html
.venv/bin/python -m pytest -q -n 2 -m "" tests/scripts/test_site.py  # in a browser, if there is one
echo "docs/_build/html/index.html"
