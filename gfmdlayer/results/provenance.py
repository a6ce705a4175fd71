"""Provenance of results: versions, commit and host, stored as attributes of the files."""

from __future__ import annotations

import platform
import signal
import socket
import subprocess
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from gfmdlayer.grid.library import own

UNKNOWN = "unknown"
CHECKPOINT_FORMAT = "9"  # of checkpoint and snapshots
LIBRARIES = ("numpy", "scipy", "numba", "pyfftw", "h5py", "mpi4py")
OWN_FFTW = ("fftw_version", "fftw_library")  # attributes where another FFTW than pyfftw's computes
_DECISIVE = ("gfmdlayer", "numpy", "numba", "pyfftw")  # for the bits of results


def now() -> str:
    """Return the present moment in UTC, ISO 8601, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def duration(seconds: float) -> str:
    """Write a duration for people: 0.4 s, 12 s, 3 min 20 s, 5 h 10 min, 3 d 4 h."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    for unit, name, part, part_name in ((86400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s")):
        if whole >= unit:
            return f"{whole // unit} {name} {whole % unit // part} {part_name}"
    return f"{whole} s"


def provenance() -> dict[str, str]:
    """Return versions of software, commit and host as attributes."""
    return {**_software(), "hostname": socket.gethostname()}


@cache
def _software() -> dict[str, str]:
    versions = {f"{library}_version": version_of(library) for library in LIBRARIES}
    return {
        "gfmdlayer_version": version_of("gfmdlayer"),
        "git_commit": git_commit(Path(__file__).parents[2]),
        "python_version": platform.python_version(),
        **versions,
        **_own_fftw(),
    }


def _own_fftw() -> dict[str, str]:
    """Return version and file of a user's own FFTW; nothing where pyfftw's computes."""
    fftw = own()
    return {} if fftw is None else dict(zip(OWN_FFTW, (fftw.version, fftw.place), strict=True))


def version_of(distribution: str) -> str:
    """Return the version of an installed package."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return UNKNOWN


def git_commit(checkout: Path) -> str:
    """Return the commit checked out in a folder, with "-dirty" where files differ from it, or UNKNOWN.

    The folder itself must be the checkout: a package installed inside another repository has no commit.
    Nothing is written to the repository, not even to git's index.
    """
    if not (checkout / ".git").exists():
        return UNKNOWN
    describe = ["describe", "--always", "--abbrev=40", "--dirty", "--exclude=*"]
    command = ["git", "--no-optional-locks", "-C", str(checkout), *describe]
    # Schedulers and terminals signal all processes of a run. A child inherits the blocked signals, so that a
    # request to stop the run does not end git and make the commit unknown.
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    return answer.stdout.strip() or UNKNOWN


def made_by(digest: str) -> dict[str, str]:
    """Return the input, versions and processor that fix the bits of a case."""
    return {"format": CHECKPOINT_FORMAT, "digest": digest, **_versions_and_processor()}


@cache
def _versions_and_processor() -> dict[str, str]:
    from llvmlite.binding import get_host_cpu_name

    known = _software()
    return {
        # Uncommitted changes have no name of their own, and most do not change results.
        "git_commit": known["git_commit"].removesuffix("-dirty"),
        "processor": get_host_cpu_name(),
        **{f"{name}_version": known[f"{name}_version"] for name in _DECISIVE},
        **{name: known[name] for name in OWN_FFTW[:1] if name in known},
    }
