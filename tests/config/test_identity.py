"""By what a configuration is known: its digest, which results of the version before carry, and its cases."""

import json
import zipfile
from contextlib import suppress
from pathlib import Path

import h5py
import pytest

import gfmdlayer
from gfmdlayer.config import Config, ConfigError, digest, load

EARLIER = Path(__file__).with_name("earlier_results.zip")  # of version 0.2: two cases of 16 points

# Digests that version 0.2 wrote into results, which stay valid.
KEPT = {
    "defaults": (
        {},
        "655824c9d0e292b21e7f13cad05f9044d3211883f6365e0bfbbb1fd7a51c1af1",
    ),
    "stack": (
        {
            "layers": [{"thickness": 0.1, "material": {"model": "prony", "G0": 1,
                        "branches": [{"G": 1 / 3, "tau": 1e-3}, {"G": 2, "tau": 1e22}]}},
                       {"thickness": 0.2, "poisson": 0.3, "material": {"model": "power_law", "G": 1,
                        "tau": 1, "exponent": 0.5}}],
            "halfspace": {"shear_modulus": float("inf")},
            "units": {"length": "mm", "stress": "MPa", "time": "s"},
            "trajectory": {"kind": "approach_retract", "depth": 0.01, "dwell": 0.5},
            "time": {"step": "adaptive"},
            "output": {"snapshots": [0.1, 1], "times": 0.05},
        },
        "633e208c5a7378f672fa9997114465552e08afff20cecaa38ecfa3fb56a81b74",
    ),
    "friction on a surface": (
        {
            "grid": {"points": [32, 64], "period": [1, 2]},
            "layer": {"thickness": float("inf")},
            "interface": [{"law": "coulomb", "coefficient": 0.3}, {"law": "shear_strength", "stress": 2.0}],
            "trajectory": {"control": "force", "force": 0.1,
                           "tangential": {"kind": "oscillation", "displacement": 0.01}},
        },
        "2160e2546d7219dd4106acf47ad2c8ca5466eaa9ffaa414e7f84c315e190048a",
    ),
    "isolated indenter": (
        {
            "grid": {"geometry": "axisymmetric"},
            "punch": {"shape": "cone", "slope": 0.2},
            "interface": {"law": "hard_wall"},
        },
        "378e0cb95b16c6e456ce7b5910fc53ae355c85b0313b69911277aa3b3e2e0b2c",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("keys", "known"), KEPT.values(), ids=KEPT)
def test_results_of_the_version_before_keep_their_digest(keys, known):
    """Results have every default written out, also those that have changed since."""
    before = {"time": {"step": 0.005} | keys.get("time", {})}
    if "geometry" not in keys.get("grid", {}):
        before["grid"] = {"points": 16384} | keys.get("grid", {})
    assert digest(Config(name="x", **keys | before)) == known


def test_results_of_the_version_before_are_taken_for_those_of_the_same_cases(tmp_path):
    with zipfile.ZipFile(EARLIER) as archive:
        archive.extractall(tmp_path / "earlier")
    cases = [tmp_path / "earlier" / "cases" / f"000{i}.h5" for i in range(3)]
    written = [path.read_bytes() for path in cases[:2]]
    config = load(tmp_path / "earlier" / "config.yaml", ["sweep.layer.thickness=[0.1, .inf, 0.2]"])
    data = gfmdlayer.run(config, out=tmp_path / "earlier")
    assert data.thickness.values.tolist() == [0.1, float("inf"), 0.2]
    assert [path.read_bytes() for path in cases[:2]] == written  # not computed again
    with h5py.File(cases[2]) as added:
        assert added.attrs["digest"] == digest(config.with_values({"layer.thickness": 0.2}))


@pytest.fixture
def validations(monkeypatch):
    """The configurations that are validated, in order: contradictions are looked for once in each."""
    made = []
    looked_for = Config.problems
    with suppress(ConfigError):
        Config(nmae="x")  # a process validates the defaults once, to suggest their keys

    def counted(config):
        made.append(config)
        return looked_for(config)

    monkeypatch.setattr(Config, "problems", counted)
    return made


SMALL = {"name": "x", "grid": {"points": 16}, "time": {"end": 0.03, "step": 0.01}}


def test_a_single_case_is_the_configuration_that_was_read(validations, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("x.yaml").write_text(json.dumps(SMALL), encoding="utf-8")
    for config in (lambda: "x.yaml", lambda: SMALL, lambda: Config(**SMALL)):
        gfmdlayer.run(config())  # a process validates one more, from which it compiles the kernels
        assert 1 <= len(validations) <= 2
        validations.clear()


def test_a_sweep_validates_each_case_once_when_it_is_read(validations):
    sweep = {"layer.thickness": [0.1, 0.2, 0.3], "punch.radius": [1, 2]}
    config = load("", content=json.dumps(SMALL | {"sweep": sweep}))
    assert len(validations) == 1 + 6
    validations.clear()
    case = config.with_values({"layer.thickness": 0.2})
    assert len(validations) == 1
    assert case.grid is config.grid  # sections without a swept key are taken as they are
    assert case.time is config.time
    assert case.with_values({}) is case


def test_errors_take_one_more_validation_of_what_is_right(validations):
    content = (
        "name: a/b\nhalfspace: {material: {}, shear_modulus: 1}\nlayer: {poisson: 1, material: {G0: 20}}"
    )
    with pytest.raises(ConfigError) as caught:
        load("x.yaml", content=content)
    assert len(caught.value.problems) == 4
    assert len(validations) == 1  # the first ended at values that are not allowed
