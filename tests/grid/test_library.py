"""A user's own FFTW: which library computes, and what is said of one that cannot."""

import hashlib
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer.errors import GfmdlayerError
from gfmdlayer.grid.library import FftwError, own_library
from gfmdlayer.grid.transforms import Transforms

LIBRARIES = [*Path(find_spec("pyfftw").origin).parents[1].glob("py[fF][fF][tT][wW].libs/libfftw3*.so*")]
SHAPES = ((48, 64), (1024,))

of_a_wheel = pytest.mark.skipif(not LIBRARIES, reason="this build of pyfftw carries no FFTW of its own")


def folder_of(place, *names):
    """A folder with some libraries of pyfftw's wheel, under the names that FFTW's installation gives them."""
    for name in names:
        (place / f"{name}.so.3").symlink_to(
            next(file for file in LIBRARIES if file.name.startswith(f"{name}-"))
        )
    return place


def digest():
    found = hashlib.sha256()
    for shape in SHAPES:
        for single in False, True:
            field = np.random.default_rng(3).standard_normal(shape)
            found.update(Transforms(shape, single=single).forward(field).tobytes())
    return found.hexdigest()


# Prints what computes in a process with a library of its own.
OWN = """
import json, sys
sys.path.insert(0, sys.argv[1])
from test_library import digest
from gfmdlayer.grid.library import FftwError, library
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.results.provenance import made_by, provenance
try:
    Transforms((512, 512), threads=2)
    refused = ""
except FftwError as error:
    refused = str(error)
loaded = [line.split()[-1] for line in open("/proc/self/maps") if "libfftw3" in line]
attributes = [{k: v for k, v in each.items() if k.startswith("fftw")} for each in (provenance(), made_by(""))]
print(json.dumps([digest(), attributes, refused, sorted(set(loaded))]))
"""


@of_a_wheel
def test_a_library_that_is_named_computes_and_stands_in_the_results(tmp_path):
    folder = folder_of(tmp_path, "libfftw3", "libfftw3f")
    environment = os.environ | {"GFMDLAYER_FFTW": str(folder)}
    command = [sys.executable, "-c", OWN, str(Path(__file__).parent)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    bits, (origin, decisive), refused, loaded = json.loads(done.stdout)
    assert bits == digest()  # the library of the wheel, by another way
    version = own_library(folder).version
    assert version.startswith("fftw-3.")
    assert origin == {"fftw_version": version, "fftw_library": f"{folder}/libfftw3.so.3"}
    assert decisive == {"fftw_version": version}  # a checkpoint of another library is not continued
    assert refused == f"{folder}/libfftw3.so.3 has been built without threads; must run on one thread"
    assert {Path(name).name for name in loaded} == {
        (folder / f"{name}.so.3").resolve().name for name in ("libfftw3", "libfftw3f")
    }  # pyfftw's libraries for threads, which come with its module, are not there


def lacking(tmp_path):
    return tmp_path, "has no libfftw3;"


def double_alone(tmp_path):
    return folder_of(
        tmp_path, "libfftw3"
    ), "has no libfftw3f; FFTW is needed in double and in single precision"


def a_file(tmp_path):
    (tmp_path / "libfftw3.so").write_text("")
    return tmp_path / "libfftw3.so", "no such folder; must be the folder that holds libfftw3 and libfftw3f"


def no_library(tmp_path):
    (tmp_path / "libfftw3.so").write_text("text")
    return tmp_path, "libfftw3.so cannot be loaded:"


def another_library(tmp_path):
    (tmp_path / "libfftw3.so").symlink_to(next(file for file in LIBRARIES if "fftw3f-" in file.name))
    return tmp_path, "libfftw3.so has no fftw_version; must be FFTW 3"


def several(tmp_path):
    for name in "libfftw3-a.so.3", "libfftw3-b.so.3":
        (tmp_path / name).write_text("")
    return tmp_path, "has several libfftw3: libfftw3-a.so.3, libfftw3-b.so.3"


@of_a_wheel
@pytest.mark.parametrize("case", [lacking, double_alone, a_file, no_library, another_library, several])
def test_a_library_that_cannot_compute_is_told_with_its_place_and_the_remedy(case, tmp_path):
    folder, words = case(tmp_path)
    with pytest.raises(FftwError) as caught:
        own_library(folder)
    assert isinstance(caught.value, GfmdlayerError)
    assert words in str(caught.value)
    assert "GFMDLAYER_FFTW" in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_check_and_run_refuse_a_library_that_is_not_there(tmp_path):
    (tmp_path / "case.yaml").write_text("name: own\ngrid: {points: 64}\ntime: {end: 0.1, step: 0.05}\n")
    environment = os.environ | {"GFMDLAYER_FFTW": "nowhere"}
    for verb in "check", "run":
        command = [sys.executable, "-m", "gfmdlayer", verb, "case.yaml"]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 2
        assert "gfmdlayer: GFMDLAYER_FFTW=nowhere: no such folder" in done.stderr
    assert not list(tmp_path.glob("results/*/cases/*"))


@of_a_wheel
def test_two_threads_are_there_where_other_libraries_have_one():
    """The environment, which other processes inherit, stays as it is."""
    script = """
import ctypes, os
before = dict(os.environ)
import gfmdlayer.grid.fftw
assert dict(os.environ) == before
lines = open("/proc/self/maps").read().split()
(place,) = {each for each in lines if "pyfftw.libs/libgomp" in each}
print(ctypes.CDLL(place).omp_get_max_threads())
"""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-W", "ignore", "-c", script]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "2\n"
