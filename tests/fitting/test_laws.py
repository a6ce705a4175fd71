"""Fits of laws with a continuous spectrum; columns by name; a fitted file as the material of a layer."""

from argparse import ArgumentParser

import numpy as np
import pytest

from gfmdlayer import Config, ConfigError, FractionalZener, HavriliakNegami, Kohlrausch, PowerLaw, cli, load
from gfmdlayer.config.model import digest
from gfmdlayer.files.tables import Answers, TableError
from gfmdlayer.fitting.laws import MODELS, fit, fit_law
from gfmdlayer.fitting.measurement import CreepCurve, FitError, MasterCurve, RelaxationCurve, read

LAWS = [
    FractionalZener(1.0, 100.0, 0.5, 0.6),
    PowerLaw(2.0, 1.0, 0.3),
    Kohlrausch(1.0, 100.0, 0.5, 0.6),
    HavriliakNegami(1.0, 100.0, 0.5, 0.7, 0.5),
]
KINDS = pytest.mark.parametrize("kind", [MasterCurve, RelaxationCurve, CreepCurve])


def measured(kind, law, rows=40):
    abscissa = np.geomspace(1e-3, 1e3, rows)
    return kind("measured.csv", abscissa, kind("", abscissa, np.empty(0)).predicted(law, abscissa))


def parameters(law):
    return np.array([*law.model_dump(exclude={"model", "shift", "tolerance"}).values()], dtype=float)


@KINDS
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.model)
def test_law_is_found_again_in_its_own_curve(kind, law):
    # Without noise the least squares end at their tolerance of 1e-8 in the cost, 1e-4 in the parameters.
    found = fit_law(measured(kind, law), law.model)
    assert found.rms < 1e-5
    np.testing.assert_allclose(parameters(found.material), parameters(law), rtol=1e-3, atol=1e-12)


def test_every_law_may_be_fitted_by_the_command():
    from gfmdlayer.cli.fits import fit_material

    parser = ArgumentParser()
    fit_material.add_options(parser)
    for law in ("prony", *MODELS):
        assert parser.parse_args(["data.csv", "--law", law]).law == law


def test_given_relaxed_modulus_is_kept():
    curve = measured(MasterCurve, LAWS[0])
    assert fit_law(curve, "fractional_zener", 1.5).material.relaxed == 1.5
    with pytest.raises(FitError, match="relaxed modulus 1e"):
        fit_law(curve, "fractional_zener", 1e6)


def test_curve_of_a_liquid_has_no_law_with_a_relaxed_modulus():
    with pytest.raises(FitError, match="flows like a liquid"):
        fit_law(measured(MasterCurve, PowerLaw(1.0, 1.0, 0.6)), "fractional_zener")


def written(path, header, *columns):
    rows = ("\t".join(f"{value:.17g}" for value in row) for row in zip(*columns, strict=True))
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "tension", "hertz"),
    [
        ("omega\tstorage\tloss", False, False),
        ("w [rad/s]\tG'\ttan delta", False, False),
        ("f [Hz]\tE' [MPa]\ttan(delta)", True, True),
        ("frequency (Hz)\tE''\tE'", True, True),
        ("freq\tG''\ttan_delta", False, True),
    ],
)
def test_columns_are_known_by_their_names(tmp_path, header, tension, hertz):
    law, omega = LAWS[0], np.geomspace(1e-2, 1e2, 20)
    modulus = law.complex_modulus(omega)
    storage, loss = (part * (2 * 1.3 if tension else 1) for part in (modulus.real, modulus.imag))
    ratio = loss / storage
    known = {"s": storage, "'": storage, "l": loss, "''": loss, "t": ratio}
    names = [name.split(" [")[0] for name in header.split("\t")[1:]]
    chosen = [
        known["t" if n.startswith("tan") else "''" if n.endswith("''") else "'" if n.endswith("'") else n[0]]
        for n in names
    ]
    path = written(tmp_path / "data.txt", header, omega / (2 * np.pi) if hertz else omega, *chosen)
    found = read(path, 0.3, Answers(modulus="G"))
    np.testing.assert_allclose(found.abscissa, omega, rtol=1e-14)
    np.testing.assert_allclose(found.moduli, [modulus.real, modulus.imag], rtol=1e-14)


@pytest.mark.parametrize("header", ["tau [s]\tG [MPa]", "G\tτ_k", "k\tG\ttau"])
def test_a_prony_table_is_not_taken_for_a_curve(tmp_path, header):
    rows = np.arange(1.0, 11.0)
    path = written(tmp_path / "prony.csv", header, *[rows] * (2 + header.startswith("k")))
    with pytest.raises(TableError, match="names the relaxation times of a Prony series"):
        read(path)


def test_columns_without_names_are_named_by_the_user(tmp_path):
    t = np.geomspace(1e-2, 1e2, 20)
    path = written(tmp_path / "data.txt", "# nothing", t, 3 * LAWS[0].relaxation_modulus(t))
    found = read(path, answers=Answers(columns=("t", "E")))
    np.testing.assert_allclose(found.moduli[0], LAWS[0].relaxation_modulus(t), rtol=1e-14)
    with pytest.raises(TableError, match="holds 2 columns; columns names 3"):
        read(path, answers=Answers(columns=("t", "E", "G")))
    with pytest.raises(TableError, match="columns: 'colour' is not a known name"):
        read(path, answers=Answers(columns=("colour", "E")))


def fitted_file(folder, law, capsys):
    omega = np.geomspace(1e-2, 1e2, 20)
    modulus = LAWS[0].complex_modulus(omega)
    data = written(folder / "data.txt", "omega\tstorage\tloss", omega, modulus.real, modulus.imag)
    command = ["fit-material", str(data), "--law", law, "--modulus", "G", "--out", str(folder)]
    assert cli.main(command) == 0
    assert "material:" in capsys.readouterr().out
    return folder / "data.yaml"


@pytest.mark.parametrize("law", ["prony", "fractional_zener"])
def test_fitted_file_is_the_material_of_a_layer(tmp_path, law, capsys):
    file = fitted_file(tmp_path, law, capsys)
    (tmp_path / "case.yaml").write_text("name: a\nlayer: {material: {file: data.yaml}}\n")
    config, itself = load(tmp_path / "case.yaml"), load(file)
    assert config.layer.material == itself.layer.material
    assert config.layer.material.model == law
    assert Config(name="b", layer={"material": {"file": file}}).layer.material == config.layer.material
    # Its contents count, and not its name.
    assert digest(config) == digest(itself)
    before, moved = digest(config), tmp_path / "moved.yaml"
    moved.write_text(file.read_text())
    assert digest(Config(name="c", layer={"material": {"file": moved}})) == before
    moved.write_text(file.read_text().replace("G0: ", "G0: 1"))
    assert digest(Config(name="c", layer={"material": {"file": moved}})) != before


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("layer: {material: {model: zenner}}\n", "wrong.yaml:1:27: layer.material.model: got the text"),
        ("material: {model: zener, Ginf: 0.1}\n", "wrong.yaml:1:32: material.Ginf: got 0.1, below G0"),
        ("layer: {thickness: 1}\n", "wrong.yaml:1:1: has no material"),
        ("layer: [\n", "wrong.yaml:2:1: not YAML"),
    ],
)
def test_file_without_a_sound_material_is_refused_at_both_places(tmp_path, content, words):
    (tmp_path / "wrong.yaml").write_text(content)
    (tmp_path / "case.yaml").write_text("name: a\nlayer: {material: {file: wrong.yaml}}\n")
    with pytest.raises(ConfigError) as refused:
        load(tmp_path / "case.yaml")
    assert "case.yaml:2:26: layer.material.file: " in str(refused.value)
    assert words in str(refused.value)


def test_law_of_few_parameters_does_as_well_as_a_series_of_many():
    curve = measured(MasterCurve, LAWS[0])
    assert fit_law(curve, "fractional_zener").rms < fit(curve).rms
