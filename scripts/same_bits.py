"""Whether a change keeps the bits of results: runs the quick configurations, and compares two such folders.

    python scripts/same_bits.py OUT                     before the change
    python scripts/same_bits.py OUT --against BEFORE    after it

Every column, field and attribute of every case file is compared. Differences are printed relative to the
largest number of their array. Exit status 1 if there is one.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
# Attributes that tell where, when and by what a case was computed.
PROVENANCE = {"config", "digest", "git_commit", "hostname", "started", "finished", "wall_seconds"}


def main() -> int:
    """Run the configurations, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path, help="folder for the results")
    parser.add_argument("--against", type=Path, metavar="BEFORE", help="folder of an earlier call")
    parser.add_argument("--configs", type=Path, nargs="+", default=sorted(ROOT.glob("configs/*-quick.yaml")))
    given = parser.parse_args()
    differ = 0
    for config in given.configs:
        folder = given.out / config.stem
        command = [sys.executable, "-m", "gfmdlayer", "run", str(config), "--jobs", "1", "--out", str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            *_, last = ["", *done.stderr.strip().splitlines()]
            print(f"{config.stem}: exit status {done.returncode}: {last}")
            differ += 1
        elif given.against is not None:
            lines = list(differences(given.against / config.stem, folder))
            print(f"{config.stem}: {'equal' if not lines else 'differs'}", *lines, sep="\n  ", flush=True)
            differ += bool(lines)
    return int(differ > 0)


def differences(before: Path, after: Path) -> Any:
    """Yield a line for each array and attribute of the case files that differs."""
    names = {path.name for folder in (before, after) for path in (folder / "cases").glob("*.h5")}
    if not names:
        yield "no case file"
    for name in sorted(names):
        with h5py.File(before / "cases" / name) as one, h5py.File(after / "cases" / name) as other:
            first, second = contents(one), contents(other)
        for key in sorted(first.keys() | second.keys()):
            if key not in first or key not in second:
                yield f"{name} {key}: only {'after' if key in second else 'before'}"
            elif not np.array_equal(first[key], second[key], equal_nan=first[key].dtype.kind == "f"):
                yield f"{name} {key}: {size(first[key], second[key])}"


def contents(file: h5py.File) -> dict[str, Any]:
    """Return datasets and attributes by name."""
    arrays: dict[str, Any] = {}
    file.visititems(
        lambda key, item: arrays.update({key: item[()]} if isinstance(item, h5py.Dataset) else {})
    )
    attributes = {f"@{key}": value for key, value in file.attrs.items() if key not in PROVENANCE}
    return {
        key: np.asarray(value)
        for key, value in (arrays | attributes).items()
        if not key.startswith("@_") and np.asarray(value).dtype.kind in "fiubUSO"
    }


def size(before: Any, after: Any) -> str:
    """Return how large a difference is."""
    if before.shape != after.shape:
        return f"shape {before.shape} -> {after.shape}"
    if before.dtype.kind != "f":
        return f"{before!r} -> {after!r}"[:80]
    scale = float(np.nanmax(np.abs(before), initial=0.0)) or 1.0
    return f"{float(np.nanmax(np.abs(after - before), initial=0.0)) / scale:.1e}"


if __name__ == "__main__":
    sys.exit(main())
