"""Compiled kernels follow their sources, those of other modules included."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba as nb
import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import kernels
from gfmdlayer.case.march import March
from gfmdlayer.case.model import ConvergenceError, simulate
from gfmdlayer.config import Config
from gfmdlayer.grid.sums import pairwise_sum
from gfmdlayer.kernels import announce, compiling, kernel, product, quotient, source_digest
from tests.recordings import Recording

PACKAGE = Path(gfmdlayer.__file__).parent


PROGRAM = """
import numpy as np
from gfmdlayer.contact.pressure_form import System, satisfies_kkt
from gfmdlayer.contact.residual import ResidualFloor
ones = np.ones(4)
system = System(ones, ones, ones, ones, ResidualFloor(1.0, 0.0), False, 0.0)
print(satisfies_kkt(system, -ones, 0.5 * ones, 0.0, 1e-3))
"""


def copied(folder):
    """Return a copy of the package, without what is compiled."""
    return Path(shutil.copytree(PACKAGE, folder / "gfmdlayer", ignore=shutil.ignore_patterns("__pycache__")))


def printed(program, folder, **environment):
    """What a program prints with the package in a folder."""
    command = [sys.executable, "-c", program]
    env = os.environ | {"PYTHONPATH": str(folder)} | environment
    done = subprocess.run(command, env=env, cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_a_kernel_is_compiled_again_when_one_that_it_calls_in_another_module_has_changed(tmp_path):
    residual, kept = copied(tmp_path) / "contact" / "residual.py", tmp_path / "cache"
    assert printed(PROGRAM, tmp_path, NUMBA_CACHE_DIR=str(kept)) == "False"
    assert list(kept.rglob("*satisfies_kkt*.nbc"))
    before = residual.read_text()
    residual.write_text(before.replace("return abs(pressure if", "return 0.0 * abs(pressure if"))
    assert residual.read_text() != before
    assert printed(PROGRAM, tmp_path, NUMBA_CACHE_DIR=str(kept)) == "True"


EDITED = """
from pathlib import Path
import gfmdlayer
from gfmdlayer.contact import residual
file = Path(residual.__file__)
file.write_text(file.read_text().replace("return abs(pressure if", "return 0.0 * abs(pressure if"))
"""


def test_a_process_whose_sources_change_after_their_import_keeps_no_kernel(tmp_path):
    """Its kernels are those of the earlier sources, and would be taken for those of the present ones."""
    copied(tmp_path)
    kept = tmp_path / "cache"
    assert printed(EDITED + PROGRAM, tmp_path, NUMBA_CACHE_DIR=str(kept)) == "False"
    assert not list(kept.rglob("*satisfies_kkt*.nbc"))
    assert printed(PROGRAM, tmp_path, NUMBA_CACHE_DIR=str(kept)) == "True"


def test_kernels_from_the_cache_need_nothing_that_only_the_compiler_needs(tmp_path):
    program = (
        PROGRAM + "import sys; print({'scipy.linalg', 'numba.np.arraymath'} & {*sys.modules} or 'nothing')"
    )
    printed(PROGRAM, PACKAGE.parent, NUMBA_CACHE_DIR=str(tmp_path))
    assert printed(program, PACKAGE.parent, NUMBA_CACHE_DIR=str(tmp_path)).split() == ["False", "nothing"]


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
def test_an_installation_and_a_home_that_cannot_be_written_are_done_without(home, taken, tmp_path):
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


def test_the_digest_of_sources_is_that_of_the_module_and_of_what_it_imports(tmp_path):
    package = copied(tmp_path)
    modules = Path("contact/active_set/solver.py"), Path("grid/grid.py")
    solver, grid = (source_digest(PACKAGE / path) for path in modules)
    paths = ", ".join(f"source_digest(Path({str(package / path)!r}))" for path in modules)
    program = f"from pathlib import Path; from gfmdlayer.kernels import source_digest; print({paths})"
    assert printed(program, tmp_path).split() == [solver, grid]  # wherever the package lies
    with (package / "contact" / "residual.py").open("a") as file:
        file.write("# a comment\n")
    now = printed(program, tmp_path).split()
    assert now[0] != solver
    assert now[1] == grid


@kernel
def _elementwise(a, b, products, quotients):
    for i in range(a.size):
        products[i], quotients[i] = product(a[i], b[i]), quotient(a[i], b[i])


def test_complex_products_and_quotients_have_the_bits_of_numpy():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 1001)) + 1j * rng.normal(size=(2, 1001)) * 10 ** rng.uniform(-3, 3, 1001)
    products, quotients = np.empty_like(a), np.empty_like(a)
    _elementwise(a, b, products, quotients)
    np.testing.assert_array_equal(products, a * b)
    np.testing.assert_array_equal(quotients, a / b)


@kernel
def _summed(x, start, stride):
    return pairwise_sum(x, start, stride)


@pytest.mark.parametrize("size", [1, 3, 4, 7, 8, 63, 64, 65, 100, 128, 129, 257, 1000, 1024, 5003])
def test_sums_have_the_bits_of_numpy(size):
    rng = np.random.default_rng(size)
    x, z = rng.normal(size=size), rng.normal(size=size) + 1j * rng.normal(size=size)
    assert _summed(x, 0, 1) == x.sum()
    numbers = z.view(np.float64)
    assert complex(_summed(numbers, 0, 2), _summed(numbers, 1, 2)) == z.sum()


def test_the_first_call_says_once_that_kernels_are_compiled(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(nb.config, "CACHE_DIR", str(tmp_path))

    def thrice(x):
        return 3 * x

    thrice = kernel(thrice)
    announce(thrice, 5)
    assert not capsys.readouterr().err  # into a file
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    announce(thrice, 5)
    assert capsys.readouterr().err == "gfmdlayer: compiling kernels, once per machine (about 5 s)\n"
    assert thrice(2.0) == 6.0
    announce(thrice, 5)
    assert not capsys.readouterr().err


def test_a_process_does_not_wait_for_itself_to_compile():
    """Blocks stand within each other; one that an abandoned generator left open counts as one of them."""

    def left_open():
        with compiling():
            yield

    abandoned = left_open()
    next(abandoned)
    with compiling(), compiling():
        pass
    abandoned.close()


def test_a_first_step_that_fails_gives_the_lock_back(monkeypatch):
    """Else the process of the next case, or the next case of this one, would wait for ever."""
    monkeypatch.setattr(March, "_left_before", False)
    config = Config(name="fails", grid={"points": 64}, solver={"max_iterations": 1})
    config = config.with_values({"trajectory.ramp_time": 0.2, "time.end": 0.4, "time.step": 0.05})
    with pytest.raises(ConvergenceError):
        simulate(config, Recording())
    assert not kernels._compiling
