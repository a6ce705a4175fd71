"""What a case is made of is made once: counted in a run of the command line."""

from collections import Counter
from pathlib import Path

import pytest

from gfmdlayer.cli import main
from gfmdlayer.config import Config
from gfmdlayer.drives import Drives
from tests.studies import TINY


@pytest.fixture
def made(monkeypatch):
    """Return how often a configuration is validated and how often drives are made."""
    found = Counter()

    def counted(name, owner, method):
        before = getattr(owner, method)

        def counting(*arguments, **named):
            found[name] += 1
            return before(*arguments, **named)

        monkeypatch.setattr(owner, method, counting)

    counted("validated", Config, "model_validate")
    counted("drives", Drives, "__init__")
    return found


@pytest.mark.parametrize(("sweep", "cases"), [("", 1), ("sweep: {layer.thickness: [0.02, 0.1, 0.3]}\n", 3)])
def test_a_case_is_validated_twice_at_most_and_its_programme_made_once(sweep, cases, made):
    """Beside those of the cases there are the whole configuration, and a small case that compiles kernels."""
    Path("tiny.yaml").write_text(TINY + sweep)
    assert main(["run", "tiny.yaml", "--out", "out"]) == 0
    assert len(list(Path("out/cases").glob("*.h5"))) == cases
    assert made["validated"] <= 2 * cases + 2
    assert made["drives"] <= cases + 1
