"""The tables of docs/reference/files-of-others.md: test files of other packages, read or refused.

    python scripts/files_of_others.py > table.md
    python scripts/files_of_others.py --moduli > moduli.md

It downloads the source distributions of the packages, and needs the extras `afm` and `topography`. A folder
may stand in for one: SurfaceTopography=FOLDER, a copy of its repository, as its distribution has no examples.
`--moduli` fits them, the force curves with nanite beside (`force_curves_of_others.py`).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tarfile
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from gfmdlayer.files.tables import Answers, TableError
from gfmdlayer.fitting.curve_files import entries, read_curve
from gfmdlayer.fitting.estimates import FitOptions
from gfmdlayer.fitting.laws import SeriesProblem, fit
from gfmdlayer.fitting.material import fit_material
from gfmdlayer.fitting.measurement import FitError, isotherms, read
from gfmdlayer.punch.scan import times
from gfmdlayer.punch.scan_files import read_scan

Reader = Callable[[Path], str]


def topography(path: Path) -> str:
    """Read heights of a surface, or of a line."""
    try:
        scan = read_scan(path, 2)
    except TableError as error:
        try:
            scan = read_scan(path, 1)
        except TableError as second:
            raise (second if "two columns" in str(error) else error) from None
    if scan.doubt:
        raise TableError(f"{path}: {scan.doubt} may say a length or a unit; unit and size are asked")
    sizes = [f"{axis.length:.6g} {axis.unit or ''}".strip() for axis in scan.axes if axis.length is not None]
    unequal = "unequal distances" * any(axis.positions is not None for axis in scan.axes)
    holes = int(np.isnan(scan.heights).sum())
    unit = f"heights in {scan.unit}" * bool(scan.unit)
    parts = (f"{times(scan.shape)} points", " x ".join(sizes), unequal, unit, f"{holes} holes" * bool(holes))
    return ", ".join(filter(None, [*parts, *scan.notes[:1]]))


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
    return f"{found}, with {' and '.join(filter(None, (', '.join(lacks[:-1]), *lacks[-1:])))}"


def _curves(path: Path, options: FitOptions) -> str:
    found = entries([path])
    rows = [read_curve(entry, options=options).time.size for entry in found]
    return f"{len(rows)} curve{'s' * (len(rows) > 1)} of {min(rows)} rows" + " or more" * (len(set(rows)) > 1)


def material(path: Path) -> str:
    """Read measured curves; moduli that do not say it are in tension."""
    curves = isotherms(path, None, Answers(modulus="E"))
    rows = sum(curve.abscissa.size for curve in curves)
    return f"{curves[0].name} of {rows} rows" + f" at {len(curves)} temperatures" * (len(curves) > 1)


def laws(root: Path) -> Iterator[str]:
    """Yield a table of fits of pyvisco's data beside the numbers that it publishes with them."""
    yield "| data | published | here |\n|-|-|-|"
    folder = root / "verification/time_master"
    curve = read(folder / "time_user_master.csv")
    parts, tau = np.loadtxt(folder / "prony_terms_KPf_MD.csv", delimiter=",").T
    glassy = curve.moduli[0] * 3
    series = 1739.03 * (1 - parts.sum() + np.exp(-np.divide.outer(curve.abscissa, tau)) @ parts)
    least = SeriesProblem(curve, None).error(np.log(tau))
    own = fit(curve)
    yield (
        f"| `time_user_master.csv`, {curve.abscissa.size} rows: rms error of a Prony series "
        f"| {len(tau)} terms of ANSYS: {100 * np.sqrt(np.mean((series / glassy - 1) ** 2)):.3f} % "
        f"| the same times: {100 * least:.3f} %; {len(own.material.branches)} of its own: "  # type: ignore[attr-defined]
        f"{100 * own.rms:.3f} % |"
    )
    for kind, words in (("time", "E(t)"), ("freq", "E', E''")):
        name = f"{kind}_user_raw"
        table = root / f"sample_data/{name}__shift_factors.csv"
        if not table.exists():
            table = root / "verification/freq_raw/freq_Eplexor_raw__shift_factors.csv"
        text = table.read_text(encoding="utf-8-sig").splitlines()[2:]
        T, known = np.array(sorted([float(each) for each in line.split(",")] for line in text)).T
        found = fit_material(root / f"sample_data/{name}.csv", shift="free")
        joined = found.superposition
        assert joined is not None
        at = np.append(joined.temperatures, joined.reference)
        published = np.interp(at, T, known)
        apart = np.array([each.value for each in joined.factors]) - (published[:-1] - published[-1])
        error = found.fitted.least
        yield (
            f"| `{name}.csv`, {words} at {len(joined.curves)} temperatures: log10 aT, free "
            f"| over {np.ptp(published):.1f} decades "
            f"| apart by {np.median(np.abs(apart)):.2f} in the median, {np.abs(apart).max():.2f} at most; "
            f"least error of any series {100 * error:.2g} % |"
        )


# Packages, the files in their source distributions, and how each is read.
PACKAGES: dict[str, tuple[tuple[str, Reader], ...]] = {
    "SurfaceTopography": (("test/file_format_examples/*", topography), ("test/*.txt.gz", topography)),
    "afmformats": (("tests/data/*", force_curve), ("docs/data/*.jpk*", force_curve),
                   ("examples/data/*.jpk*", force_curve)),
    "nanite": (("tests/data/fmt-*", force_curve), ("tests/data/*.h5", force_curve),
               ("docs/data/*.jpk*", force_curve), ("examples/data/*.jpk*", force_curve)),
    "pyjibe": (("tests/data/*", force_curve),),
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
            shown = lines[0].partition("; known names are")[0]
            yield path.name, " ".join(shown.split()).replace("|", "\\|")


def folder_of(argument: str) -> tuple[str, Path]:
    """Read PACKAGE=FOLDER."""
    package, _, folder = argument.partition("=")
    if package not in PACKAGES:
        names = ", ".join(PACKAGES)
        raise argparse.ArgumentTypeError(f"got {argument!r}; must be PACKAGE=FOLDER, with one of {names}")
    if not Path(folder).is_dir() or not folder:
        raise argparse.ArgumentTypeError(f"got {argument!r}; {folder!r} is no folder")
    return package, Path(folder)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "folders", nargs="*", type=folder_of, metavar="PACKAGE=FOLDER", help="a copy of its files"
    )
    meaning = "fit the force curves, beside nanite"
    parser.add_argument("--moduli", action="store_true", help=meaning)
    options = parser.parse_args()
    given = dict(options.folders)
    warnings.simplefilter("ignore")
    for package, patterns in PACKAGES.items():
        readers = {reader for _, reader in patterns}
        if options.moduli and topography in readers:
            continue
        with tempfile.TemporaryDirectory() as folder:
            root = given[package] if package in given else unpacked(package, Path(folder))
            print(f"\n## {root.name.replace('-', ' ')}\n")
            if options.moduli and material in readers:
                print("\n".join(laws(root)))
                continue
            if options.moduli:
                from force_curves_of_others import moduli

                files = [path for pattern, _ in patterns for path in sorted(root.glob(pattern))]
                for line in moduli(files):
                    print(line, flush=True)
                continue
            print("| file | result |\n|-|-|")
            for name, result in results(root, patterns):
                print(f"| `{name}` | {result} |")


if __name__ == "__main__":
    main()
