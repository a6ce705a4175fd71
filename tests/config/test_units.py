"""Units are labels: checked by name, written to files, and without effect on any number."""

from __future__ import annotations

from pathlib import Path

import pytest

from gfmdlayer.config import Config, digest
from gfmdlayer.validation.units import Units
from tests.config.reading import problems


@pytest.mark.parametrize(
    ("length", "stress", "force", "per_length"),
    [
        ("m", "Pa", "N", "N/m"),
        ("mm", "MPa", "N", "N/mm"),
        ("um", "Pa", "pN", "pN/um"),
        ("um", "GPa", "mN", "mN/um"),
        ("mm", "GPa", "kN", "kN/mm"),
        ("cm", "Pa", "Pa cm^2", "Pa cm"),  # 1e-4 N, for which there is no prefix
        ("in", "psi", "psi in^2", "psi in"),
    ],
)
def test_a_force_is_in_newtons_where_a_prefix_is_its_size(
    length: str, stress: str, force: str, per_length: str
) -> None:
    units = Units(length=length, stress=stress, time="s")
    assert units.label("force") == force
    assert units.label("force / length") == units.label("pressure length") == per_length


def test_words_become_labels_and_stay_without_units() -> None:
    line = Config(name="line")
    surface = line.with_values(
        {"grid.points": [16, 16], "units": {"length": "mm", "stress": "MPa", "time": "h"}}
    )
    words = ("length", "pressure", "time", "length / time", "1", "force")
    assert [surface.unit(each) for each in words] == ["mm", "MPa", "h", "mm/h", "1", "N"]
    assert [line.unit(each) for each in words] == [*words[:-1], "force / length"]


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ("{length: m, stress: Pa}", "units.time: missing; must be a unit of time, such as s, ms, min or h"),
        ("{length: Pa, stress: Pa, time: s}", "units.length: got the text 'Pa'; must be a unit of length"),
        ("{length: m, stress: mpa, time: s}", "units.stress: got the text 'mpa'; must be a unit of stress"),
        ("{length: m, stress: MPA, time: s}", "did you mean 'MPa'?"),
        (
            "{length: 1.0, stress: Pa, time: s}",
            "units.length: got 1.0; must be a unit of length, such as m, mm",
        ),
        ("{lenght: m, stress: Pa, time: s}", "units.lenght: unknown key; allowed: length, stress, time"),
        ("SI", "units: got the text 'SI'; must be a mapping"),
        ("{length: m, stress: Pa, time: s}\nsweep: {units.length: [m, mm]}", "units.length: cannot be swept"),
    ],
)
def test_other_names_and_sweeps_of_labels_are_refused(tmp_path: Path, units: str, message: str) -> None:
    assert message in "\n".join(problems(tmp_path, f"name: a\nunits: {units}\n"))


def test_configurations_without_units_keep_their_digest() -> None:
    # Of version 0.1: results of it stay valid.
    assert digest(Config(name="x")) == "655824c9d0e292b21e7f13cad05f9044d3211883f6365e0bfbbb1fd7a51c1af1"
