"""Lists of combinations and samples: which cases a sweep stands for, and how their results are labelled."""

import math
import subprocess
import sys

import numpy as np
import pytest

from gfmdlayer.config import digest, load
from gfmdlayer.config.sweeps import combinations, count
from gfmdlayer.results.reader import open_results
from gfmdlayer.study.cases import cases, label
from gfmdlayer.study.run import run_study
from gfmdlayer.study.workers import assemble

TINY = """\
name: tiny
grid: {points: 16}
time: {end: 0.02, step: 0.01}
trajectory: {ramp_time: 0.02}
"""


@pytest.fixture
def read(tmp_path):
    def read(sweep, *overrides):
        path = tmp_path / "tiny.yaml"
        path.write_text(f"{TINY}sweep: {sweep}\n")
        return load(path, overrides)

    return read


def rows(config):
    return [tuple(case.values.values()) for case in cases(config)]


def column(config, key):
    return np.array([row[key] for row in combinations(config.sweep)], dtype=float)


def test_zip_takes_the_first_with_the_first(read):
    config = read("{zip: {layer.thickness: [0.1, 0.2, 0.1], punch.radius: [1, 2, 3]}}")
    assert rows(config) == [(0.1, 1), (0.2, 2), (0.1, 3)]
    assert [case.config.punch.radius for case in cases(config)] == [1, 2, 3]


@pytest.mark.parametrize(
    ("formula", "values"),
    [
        ("layer.thickness: {from: 1.0e-3, to: 1.0e+2, points: 6, spacing: log}",
         [1e-3, 0.01, 0.1, 1, 10, 100]),
        ("layer.thickness: {from: 0.1, to: 0.5, points: 5}", [0.1, 0.2, 0.3, 0.4, 0.5]),
        ("grid.points: {from: 16, to: 128, points: 4, spacing: log}", [16, 32, 64, 128]),
    ],
)  # fmt: skip
def test_values_by_a_formula_are_those_of_the_list(read, formula, values):
    key = formula.partition(":")[0]
    config, listed = read(f"{{{formula}}}"), read(f"{{{key}: {values}}}")
    assert config.sweep == {key: values}
    assert [digest(case.config) for case in cases(config)] == [digest(case.config) for case in cases(listed)]
    assert load("", content=config.dump()).sweep == {key: values}  # config.yaml of the results lists them
    zipped = read(f"{{zip: {{{formula}, punch.radius: {[1 + i for i in range(len(values))]}}}}}")
    assert [row[0] for row in rows(zipped)] == values


def test_every_combination_of_a_list_meets_every_product_of_the_other_keys(read):
    config = read(
        "{solver.method: [fire, active_set], zip: {layer.thickness: [0.1, 0.2], punch.radius: [1, 2]}}"
    )
    assert rows(config) == [
        (0.1, 1, "fire"),
        (0.1, 1, "active_set"),
        (0.2, 2, "fire"),
        (0.2, 2, "active_set"),
    ]
    assert count(config.sweep) == 4


@pytest.mark.parametrize(("samples", "method"), [(100, "latin_hypercube"), (64, "sobol")])
def test_each_stratum_of_each_key_has_one_sample(read, samples, method):
    """Stratification is what both methods promise of every coordinate, Sobol's for powers of two."""
    config = read(
        f"{{{method}: {{samples: {samples}, seed: 7, layer.thickness: {{from: 0.01, to: 1, scale: log}}, "
        "punch.radius: {from: 0.2, to: 0.6}}}"
    )
    parts = {
        "layer.thickness": np.log(column(config, "layer.thickness") / 0.01) / math.log(100),
        "punch.radius": (column(config, "punch.radius") - 0.2) / 0.4,
    }
    for part in parts.values():
        assert sorted(np.floor(part * samples)) == list(range(samples))
    # Neither key follows the other: the ranks of 64 independent pairs correlate by 1/8 in the mean square.
    ranks = [np.argsort(np.argsort(part)) for part in parts.values()]
    assert abs(np.corrcoef(ranks)[0, 1]) < 0.5


def test_samples_are_those_of_their_seed_in_any_process(read, tmp_path):
    sweep = "{latin_hypercube: {samples: 5, seed: 3, layer.thickness: {from: 0.01, to: 1}}}"
    here = rows(read(sweep))
    script = (
        "import sys; from gfmdlayer.config import load; from gfmdlayer.study.cases import cases; "
        "print([tuple(case.values.values()) for case in cases(load(sys.argv[1]))])"
    )
    command = [sys.executable, "-c", script, str(tmp_path / "tiny.yaml")]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() == str(here)
    assert rows(read(sweep, "sweep.latin_hypercube.seed=4")) != here
    assert rows(read(sweep.replace("seed: 3, ", ""))) == rows(read(sweep, "sweep.latin_hypercube.seed=0"))


def test_samples_stay_within_their_range_and_have_twelve_digits(read):
    third = 1 / 3
    config = read(f"{{sobol: {{samples: 1024, layer.thickness: {{from: {third!r}, to: {third + 1e-9!r}}}}}}}")
    values = column(config, "layer.thickness")
    assert values.min() >= third
    assert values.max() <= third + 1e-9
    config = read("{sobol: {samples: 8, layer.thickness: {from: 0.01, to: 1, scale: log}}}")
    assert all(len(repr(value).lstrip("0.")) <= 12 for value in column(config, "layer.thickness").tolist())


def test_a_case_is_the_same_however_it_was_swept(read):
    zipped = cases(read("{zip: {layer.thickness: [0.1, 0.25], punch.radius: [1, 2]}}"))[1]
    product = cases(read("{punch.radius: [2], layer.thickness: [0.25]}"))[0]
    (alone,) = cases(read("{punch: [{radius: 2.0}]}", "layer.thickness=0.25"))
    assert digest(zipped.config) == digest(product.config) == digest(alone.config)
    assert zipped.config.dump() == product.config.dump()
    drawn = cases(read("{sobol: {samples: 2, layer.thickness: {from: 0.1, to: 1}}}"))[0]
    value = drawn.values["layer.thickness"]
    (same,) = cases(read(f"{{layer.thickness: [{value!r}]}}"))
    assert digest(drawn.config) == digest(same.config)


@pytest.mark.parametrize(
    "sweep",
    [
        "{zip: {layer.thickness: [0.1, .inf], solver.method: [fire, active_set]}, punch.radius: [1, 2]}",
        "{latin_hypercube: {samples: 3, layer.thickness: {from: 0.01, to: 1, scale: log}}}",
        "{punch: [{radius: 1}, {shape: wedge, slope: 0.1}], grid.points: [16, [16, 32]]}",
        "{layer.material: [{Ginf: 5}, {model: prony, branches: [{G: 1, tau: 2}, {G: 3, tau: 0.5}]}]}",
        "{output.snapshots: [[], [0.01], [0.01, 0.02]]}",
    ],
)
def test_a_dumped_sweep_stands_for_the_same_cases(read, tmp_path, sweep):
    config = read(sweep)
    (tmp_path / "dumped.yaml").write_text(config.dump())
    again = load(tmp_path / "dumped.yaml")
    assert again == config
    assert cases(again) == cases(config)
    assert count(config.sweep) == len(cases(config))


def test_options_reach_into_lists_and_samples(read):
    config = read(
        "{zip: {layer.thickness: [0.1, 0.2], punch.radius: [1, 2]}}", "sweep.zip.punch.radius=[3, 4]"
    )
    assert rows(config) == [(0.1, 3), (0.2, 4)]
    sweep = "{sobol: {samples: 4, layer.thickness: {from: 0.1, to: 1}}}"
    config = read(sweep, "sweep.sobol.samples=8", "sweep.sobol.layer.poisson={from: 0, to: 0.5}")
    assert len(cases(config)) == 8
    assert list(cases(config)[0].values) == ["layer.thickness", "layer.poisson"]


def test_swept_files_are_relative_to_the_configuration(read, tmp_path):
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text("".join(f"{j / 16} {j * (16 - j) / 256}\n" for j in range(16)))
    zipped = read(
        "{zip: {punch.file: [a.txt, b.txt], layer.thickness: [0.1, 0.2]}}",
        "punch={shape: profile, file: a.txt}",
    )
    swept = read("{punch: [{shape: profile, file: a.txt}, {shape: profile, file: b.txt}]}")
    for config in (zipped, swept):
        files = [case.config.punch.file for case in cases(config)]
        assert files == [tmp_path / "a.txt", tmp_path / "b.txt"]


def test_labels_are_for_people(read):
    config = read(
        "{grid.points: [16, [16, 32]], punch: [{shape: wedge, slope: 0.1}], output.snapshots: [[0.01]]}"
    )
    assert [label(case.values) for case in cases(config)] == [
        "points = 16, punch = shape=wedge, slope=0.1, snapshots = [0.01]",
        "points = 16x32, punch = shape=wedge, slope=0.1, snapshots = [0.01]",
    ]


def run(config, directory):
    with assemble() as team:
        assert team is not None
        assert run_study(config, directory, team).count("complete") == count(config.sweep)


def test_results_of_a_list_lie_along_the_cases_with_their_values(read, tmp_path):
    # Every thickness with every method is a product too; a list stays a list.
    run(read("{zip: {layer.thickness: [0.1, 0.2]}, solver.method: [fire, active_set]}"), tmp_path / "out")
    with open_results(tmp_path / "out") as results:
        assert results["mean_pressure"].sizes == {"case": 4, "time": 3}
        np.testing.assert_array_equal(results["thickness"], [0.1, 0.1, 0.2, 0.2])
        assert results["solver.method"].to_numpy().tolist() == ["fire", "active_set"] * 2
        assert not results["mean_pressure"].isnull().any()


def test_results_of_samples_record_how_they_were_drawn(read, tmp_path):
    config = read("{sobol: {samples: 4, seed: 9, layer.thickness: {from: 0.1, to: 1}}}")
    run(config, tmp_path / "out")
    with open_results(tmp_path / "out") as results:
        drawn = {key: results.attrs[key] for key in ("sampling", "samples", "seed")}
        assert drawn == {"sampling": "sobol", "samples": 4, "seed": 9}
        np.testing.assert_array_equal(results["thickness"], column(config, "layer.thickness"))
    assert load(tmp_path / "out/config.yaml") == config
    assert "seed: 9" in (tmp_path / "out/config.yaml").read_text()
