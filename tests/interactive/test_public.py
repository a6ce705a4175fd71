"""Every public name is documented with an example that runs."""

import doctest

import numpy as np
import pytest

import gfmdlayer


@pytest.mark.parametrize("name", gfmdlayer.__all__)
def test_the_example_of_a_public_name_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    globs = {"gfmdlayer": gfmdlayer, "np": np}
    found = doctest.DocTestFinder(recurse=False).find(getattr(gfmdlayer, name), name, globs=globs)
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    assert sum(len(each.examples) for each in found) > 0
    for each in found:
        runner.run(each)
    assert runner.summarize(verbose=False).failed == 0


def test_all_names_what_the_table_imports():
    assert sorted(gfmdlayer.__all__) == sorted(set(gfmdlayer.__all__))
    assert set(gfmdlayer._HOME) == set(gfmdlayer.__all__)
    with pytest.raises(AttributeError, match="'gfmdlayer' has no attribute 'solv'"):
        gfmdlayer.solv  # noqa: B018
