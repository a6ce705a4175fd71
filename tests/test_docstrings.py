"""Public functions, classes and methods describe their arguments and results, as numpydoc reads them."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from functools import cache
from types import FunctionType

import pytest
from numpydoc.validate import validate

import gfmdlayer
from gfmdlayer import figures
from gfmdlayer.validation.sections import Section

# No docstring; an argument without a row, a row without an argument, a row without a type or a description;
# a result without a description.
CODES = {"GL08", "PR01", "PR02", "PR04", "PR07", "RT03"}
PUBLIC = {f"gfmdlayer.{name}": getattr(gfmdlayer, name) for name in gfmdlayer.__all__} | {
    f"gfmdlayer.figures.{name}": getattr(figures, name) for name in figures.__all__
}


@cache
def flaws(name: str) -> tuple[str, ...]:
    """Return what a docstring lacks."""
    return tuple(f"{name}: {text}" for code, text in validate(name)["errors"] if code in CODES)


def definitions(owner: type, name: str) -> list[tuple[str, FunctionType]]:
    """Return a method of the package in a class, and those that it overrides, with their full names."""
    found = []
    for base in owner.__mro__:
        held = vars(base).get(name)
        function = getattr(held, "__func__", held)
        if isinstance(function, FunctionType) and function.__module__.startswith(("gfmdlayer.", __name__)):
            found.append((f"{base.__module__}.{base.__qualname__}.{name}", function))
    return found


def flaws_of_methods(owner: type) -> Iterator[str]:
    """Yield what methods lack; an override may leave the table to the method that it overrides."""
    for name in dir(owner):
        if name.startswith("_") or not (several := definitions(owner, name)):
            continue
        needed = set(inspect.signature(several[0][1]).parameters)
        tables = [full for full, one in several if needed <= set(inspect.signature(one).parameters)]
        if all(flaws(full) for full in tables):
            yield from flaws(several[0][0])


@pytest.mark.parametrize("name", PUBLIC)
def test_arguments_and_results_are_described(name: str) -> None:
    found = PUBLIC[name]
    assert [*flaws(name), *(flaws_of_methods(found) if inspect.isclass(found) else ())] == []


class Undescribed(Section):
    """A section with a method whose argument has no row."""

    size: float
    """size: length"""

    def grown(self, by: float) -> float:
        """Return the size times a factor."""
        return self.size * by


def test_a_missing_row_is_found() -> None:
    assert list(flaws_of_methods(Undescribed)) == [
        f"{__name__}.Undescribed.grown: Parameters {{'by'}} not documented"
    ]


def test_a_section_has_a_table_of_its_keys() -> None:
    words = inspect.getdoc(gfmdlayer.Electrostatic) or ""
    meaning = "Permittivity of vacuum; known from units [pressure length^2/V^2]."
    assert f"permittivity : float, optional\n    {meaning}\n" in words
    assert "G0 : float, default 1.0\n    Relaxed shear modulus" in (inspect.getdoc(gfmdlayer.Zener) or "")
    assert words.index("Parameters\n") < words.index("Examples\n")
