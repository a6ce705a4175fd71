"""A stored case is run again from its own file as long as the files that it names are unchanged."""

import h5py
import pytest

from gfmdlayer.cli import main
from gfmdlayer.config import Config, ConfigError, digest
from gfmdlayer.results.reader import stored_config

PROFILE = "".join(f"{j / 8} {abs(j - 4)}\n" for j in range(8))
FILES = {
    "punch.file": ({"shape": "profile"}, PROFILE, PROFILE.replace(" 4", " 5")),
    "trajectory.file": ({"kind": "table"}, "0 0\n1 0.001\n", "0 0\n1 0.002\n"),
    "trajectory.velocity_file": ({}, "0 0\n1 0.001\n", "0 0\n1 0.002\n"),
}


@pytest.mark.parametrize("key", FILES)
def test_a_case_whose_input_file_has_changed_is_refused(key, tmp_path, capsys):
    keys, before, after = FILES[key]
    section, _, name = key.partition(".")
    data, stored = tmp_path / "data.txt", tmp_path / "0000.h5"
    data.write_text(before)
    plain = {"name": "x", "grid": {"points": 8}, section: keys | {name: str(data)}}
    config = Config.model_validate(plain)
    with h5py.File(stored, "w") as file:
        file.attrs.update({"config": config.dump(), "digest": digest(config)})
    assert stored_config(stored) == config
    assert main(["check", str(stored)]) == 0
    data.write_text(after)
    changed = "data.txt has changed since this case was computed from it"
    with pytest.raises(ConfigError, match=changed):
        stored_config(stored)
    assert main(["run", str(stored)]) == 2
    assert changed in capsys.readouterr().err
