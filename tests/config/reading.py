"""Configurations from text, and the problems of those that are refused."""

import pytest

from gfmdlayer.config import ConfigError, load


def read(folder, content, *overrides):
    path = folder / "case.yaml"
    path.write_text(content, encoding="utf-8")
    return load(path, overrides)


def problems(path, content=None, *overrides):
    """Return the problems of a file, or of a text that becomes a file in a folder; without the folder."""
    folder = path.parent if content is None else path
    with pytest.raises(ConfigError) as caught:
        load(path, overrides) if content is None else read(folder, content, *overrides)
    return [problem.replace(f"{folder}/", "") for problem in caught.value.problems]
