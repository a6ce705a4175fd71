"""Compiled kernels follow their sources, those of other modules included."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import TypingError

import gfmdlayer
from gfmdlayer.kernels import address_of, call_at, kernel, maximum, source_digest

PACKAGE = Path(gfmdlayer.__file__).parent


@kernel(inner=True)
def half(x: Any) -> Any:
    """An inner kernel, which two others call."""
    return 0.5 * x


@kernel
def inverse_of_half(x: Any, count: int) -> Any:
    """A kernel that fails for x = 0."""
    return count / half(x)


_inverse_of_half = call_at(inverse_of_half)


@kernel
def at_an_address(address: int, x: Any) -> Any:
    """Call the kernel at an address, with a number of another type too, and an inner one."""
    values = np.array([half(x), _inverse_of_half(address, (x, 3))])
    return maximum(values)


def test_a_kernel_calls_another_one_at_its_address_and_passes_on_its_error() -> None:
    address = address_of(inverse_of_half, 1.0, 1)
    assert at_an_address(address, 0.5) == inverse_of_half(0.5, 3) == 12.0
    assert at_an_address(address, 100.0) == 50.0
    with pytest.raises(ZeroDivisionError):
        at_an_address(address, 0.0)
    with pytest.raises(TypingError, match="no address was taken"):  # which would read other numbers
        at_an_address(address, np.float32(0.5))


@pytest.mark.slow
def test_numba_of_an_unknown_version_compiles_the_same_kernels(tmp_path: Path) -> None:
    program = "import numba; numba.version_info = numba.version_info._replace(short=(99, 0));"
    program += "from test_kernels import address_of, at_an_address, half, inverse_of_half;"
    program += "print(at_an_address(address_of(inverse_of_half, 1.0, 1), 0.5), len(half.overloads));"
    paths = f"{PACKAGE.parent}{os.pathsep}{Path(__file__).parent}"
    environment = os.environ | {"PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["12.0", "1"]
    assert list(tmp_path.rglob("*half*.nbc"))  # as all functions


PROGRAM = """
import sys
import numpy as np
from gfmdlayer.contact.pressure_form import System, satisfies_kkt
from gfmdlayer.contact.residual import ResidualFloor
ones = np.ones(4)
system = System(ones, ones, ones, ones, ResidualFloor(1.0, 0.0), False, 0.0)
print(satisfies_kkt(system, -ones, 0.5 * ones, 0.0, 1e-3), "scipy.linalg" in sys.modules)
"""


def copied(folder: Path) -> Path:
    """Return a copy of the package, without what is compiled."""
    return Path(shutil.copytree(PACKAGE, folder / "gfmdlayer", ignore=shutil.ignore_patterns("__pycache__")))


def answer(folder: Path) -> str:
    """Run the program with the package in a folder."""
    environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_a_kernel_is_compiled_again_when_one_that_it_calls_in_another_module_has_changed(
    tmp_path: Path,
) -> None:
    residual = copied(tmp_path) / "contact" / "residual.py"
    assert answer(tmp_path) == "False True"
    assert answer(tmp_path) == "False False"  # Numba's compiler is not loaded with the kernel
    assert list((tmp_path / "cache").rglob("*satisfies_kkt*.nbc"))
    before = residual.read_text()
    residual.write_text(before.replace("return abs(pressure if", "return 0.0 * abs(pressure if"))
    assert residual.read_text() != before
    assert answer(tmp_path) == "True True"


HOMELESS = """
import pwd
def unknown(_):
    raise KeyError("no such user")
pwd.getpwuid = unknown
from gfmdlayer.files.cache import user_cache
from gfmdlayer.kernels import compiling, kernel
@kernel
def twice(x):
    return 2 * x
with compiling():
    assert twice(2) == 4
print(user_cache())
"""


@pytest.mark.parametrize(("home", "taken"), [("/proc/nowhere", False), (None, False), (None, True)])
def test_an_installation_and_a_home_that_cannot_be_written_are_done_without(
    home: str | None, taken: bool, tmp_path: Path
) -> None:
    """As in a container whose user the system does not know; even root cannot make a folder below a file."""
    (copied(tmp_path) / "__pycache__").write_text("")
    (tmp_path / "program.py").write_text(HOMELESS)
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    if taken:
        (temporary / f"gfmdlayer-{os.getuid()}").symlink_to("/etc")
    unset = ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")
    environment = {key: value for key, value in os.environ.items() if key not in unset}
    environment |= {"PYTHONPATH": str(tmp_path), "TMPDIR": str(temporary)} | ({"HOME": home} if home else {})
    command = [sys.executable, "program.py"]
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
    place = Path(done.stdout.strip())
    assert place.parent == temporary
    assert (place.name == f"gfmdlayer-{os.getuid()}") is not taken
    assert place.stat().st_mode & 0o077 == 0
    assert list((place / "kernels").rglob("*twice*.nbc"))
    assert {path.name for path in tmp_path.iterdir()} == {"gfmdlayer", "program.py", "tmp"}


def test_the_digest_of_sources_is_that_of_the_module_and_of_what_it_imports(tmp_path: Path) -> None:
    package = copied(tmp_path)
    of_solver, of_grid = (Path("contact/active_set/solver.py"), Path("grid/grid.py"))
    before = {path: source_digest(PACKAGE / path) for path in (of_solver, of_grid)}
    program = "import sys; from pathlib import Path; from gfmdlayer.kernels import source_digest;"
    program += f"print(source_digest(Path({str(package / of_solver)!r})), "
    program += f"source_digest(Path({str(package / of_grid)!r})))"

    def now() -> list[str]:
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        command = [sys.executable, "-c", program]
        return subprocess.run(
            command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout.split()

    assert now() == list(before.values())  # wherever the package lies
    with (package / "contact" / "residual.py").open("a") as file:
        file.write("# a comment\n")
    assert now()[0] != before[of_solver]
    assert now()[1] == before[of_grid]
