"""What holds for the dataclasses of all rooms."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest

from tests import ROOT

ROOMS = ("cell", "learned", "sim", "skills", "trees")
ARRAYS = {"Array", "NDArray", "Image", "Images", "Floats", "Bools", "Mask"}


def compared_arrays(text: str) -> Iterator[str]:
    """Classes of a module whose generated `__eq__` compares an array, which has no truth value."""
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.ClassDef):
            continue
        made = [ast.unparse(expr) for expr in node.decorator_list]
        compares = any(one.startswith("dataclass") and "eq=False" not in one for one in made)
        fields = [one for one in node.body if isinstance(one, ast.AnnAssign)]
        told = [field for field in fields if field.value is None or "compare=False" not in ast.unparse(field.value)]
        names = {name.id for assign in told for name in ast.walk(assign.annotation) if isinstance(name, ast.Name)}
        if compares and names & ARRAYS and "Option" not in names:
            yield node.name


@pytest.mark.parametrize("room", ROOMS)
def test_no_dataclass_compares_arrays(room: str) -> None:
    """`in` a list compares with each element, and raises in the middle of a run where two have the same numbers."""
    files = sorted((ROOT / room).rglob("*.py"))
    assert [(file.name, name) for file in files for name in compared_arrays(file.read_text())] == []


def test_one_that_does_is_found() -> None:
    text = "@dataclass(frozen=True{})\nclass A:\n    name: str\n    points: Mapping[str, Array]\n"
    assert list(compared_arrays(text.format(""))) == ["A"]
    assert list(compared_arrays(text.format(", eq=False"))) == []
