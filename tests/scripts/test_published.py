"""Published values: tables that print exact numbers agree with ours to the last digit."""

import re
import runpy
from pathlib import Path

import pytest

SECTIONS = runpy.run_path(str(Path(__file__).parents[2] / "scripts/published.py"))["SECTIONS"]


@pytest.mark.parametrize("section", ["rough", "film"])
def test_contact_of_other_codes_and_closed_forms_agree_to_the_last_digit(section):
    """A difference beyond the last printed digit would be bold."""
    rows = [line for line in SECTIONS[section][0]() if re.match(r"\| [\dKq]", line)]
    assert len(rows) >= 2
    assert all("%" in row and "**" not in row for row in rows)


def test_pull_off_agrees_with_maugis_within_the_bound_of_the_verification():
    """Its bound is a hundredth."""
    table = [line.split("|") for line in SECTIONS["adhesion"][0]() if line.startswith("| ")][1:]
    assert len(table) == 7
    for _, _, printed, ours, *_ in table:
        assert float(ours) == pytest.approx(float(printed), rel=0.01)


@pytest.mark.parametrize(
    "ratios", [(3.0, 5.0, 8.0, 12.0), pytest.param((4.0, 8.0, 12.0, 16.0), marks=pytest.mark.slow)]
)
def test_pull_off_from_thin_layers_tends_to_the_limits_of_theory(ratios):
    """From some layers the limits are found within 1 %, ten times nearer than the force on the last layer.

    The page has the thinner layers.
    """
    cells = [[cell.strip() for cell in line.split("|")] for line in SECTIONS["thin-layer"][0](ratios)]
    rows = [cell[1:4] for cell in cells if cell[1:] and re.match(r"[\d∞]", cell[1])]
    for last, limit in (rows[3:5], rows[8:10]):
        theory = float(limit[1])
        assert abs(float(limit[2]) - theory) < 0.1 * abs(float(last[2]) - theory)
        assert float(limit[2]) == pytest.approx(theory, rel=0.01)
