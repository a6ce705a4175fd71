"""The table of docs/reference/files-of-others.md: test files of other packages, read or refused.

    python scripts/files_of_others.py > table.md

It downloads the source distributions of the packages, and needs the extra `afm`.
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from gfmdlayer.files.tables import Answers, TableError
from gfmdlayer.fitting.curve_files import entries, read_curve
from gfmdlayer.fitting.estimates import FitOptions
from gfmdlayer.fitting.measurement import FitError, read

Reader = Callable[[Path], str]


def force_curve(path: Path) -> str:
    """Read all curves of a file without any option; with a calibration where it lacks one."""
    try:
        return _curves(path, FitOptions())
    except (FitError, TableError):
        options = FitOptions(stiffness=0.1, sensitivity=5e-8, sampling=1e3)
        found = _curves(path, options)
    lacks = []
    for key in ("stiffness", "sensitivity", "sampling"):
        try:
            _curves(path, replace(options, **{key: None}))
        except (FitError, TableError):
            lacks.append(f"`--{key}`")
    return f"{found}, with {' and '.join(lacks)}"


def _curves(path: Path, options: FitOptions) -> str:
    found = entries([path])
    rows = [read_curve(entry, options=options).time.size for entry in found]
    return f"{len(rows)} curve{'s' * (len(rows) > 1)} of {min(rows)} rows" + " or more" * (len(set(rows)) > 1)


def material(path: Path) -> str:
    """Read a measured curve; moduli that do not say it are in tension."""
    curve = read(path, answers=Answers(modulus="E"))
    return f"{curve.name} of {curve.abscissa.size} rows"


# Packages, the files in their source distributions, and how each is read.
PACKAGES: dict[str, tuple[tuple[str, Reader], ...]] = {
    "afmformats": (("tests/data/*", force_curve),),
    "nanite": (("tests/data/fmt-*", force_curve), ("tests/data/*.h5", force_curve)),
    "pyvisco": (("sample_data/*.csv", material), ("sample_data/*.xls", material),
                ("verification/*/input_master.csv", material)),
}  # fmt: skip


def unpacked(package: str, folder: Path) -> Path:
    """Download and unpack the source distribution of a package."""
    command = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--quiet",
        "--no-deps",
        "--no-binary",
        ":all:",
        package,
    ]
    subprocess.run([*command, "--dest", str(folder)], check=True)
    (archive,) = folder.glob(f"{package}-*.tar.gz")
    with tarfile.open(archive) as file:
        file.extractall(folder, filter="data")
    return folder / archive.name.removesuffix(".tar.gz")


def results(root: Path, patterns: tuple[tuple[str, Reader], ...]) -> Iterator[tuple[str, str]]:
    """Yield the files of a package and what became of each."""
    for pattern, reader in patterns:
        for path in sorted(root.glob(pattern)):
            try:
                result = reader(path)
            except (TableError, FitError) as error:
                result = f"refused: {error}"
            lines = result.replace(f"{path}:", "").replace(str(path), path.name).split("\n")
            yield path.name, " ".join(lines[0].split()).replace("|", "\\|")


def main() -> None:
    """Print the tables."""
    warnings.simplefilter("ignore")
    for package, patterns in PACKAGES.items():
        with tempfile.TemporaryDirectory() as folder:
            root = unpacked(package, Path(folder))
            print(f"\n## {root.name.replace('-', ' ')}\n\n| file | result |\n|-|-|")
            for name, result in results(root, patterns):
                print(f"| `{name}` | {result} |")


if __name__ == "__main__":
    main()
