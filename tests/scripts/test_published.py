"""Published values: tables that print exact numbers agree with ours to the last digit."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

SECTIONS = runpy.run_path(str(Path(__file__).parents[2] / "scripts/published.py"))["SECTIONS"]


@pytest.mark.parametrize("section", ["rough", "film"])
def test_contact_of_other_codes_and_closed_forms_agree_to_the_last_digit(section: str) -> None:
    """A difference beyond the last printed digit would be bold."""
    rows = [line for line in SECTIONS[section][0]() if re.match(r"\| [\dKq]", line)]
    assert len(rows) >= 2
    assert all("%" in row and "**" not in row for row in rows)


def test_pull_off_agrees_with_maugis_within_the_bound_of_the_verification() -> None:
    """Its bound is a hundredth; the numbers are of the stored run."""
    table = [line.split("|") for line in SECTIONS["adhesion"][0]() if line.startswith("| ")][1:]
    assert len(table) == 7
    for _, _, printed, ours, *_ in table:
        assert float(ours) == pytest.approx(float(printed), rel=0.01)
