"""docs/configuration.md tells every key of every YAML file, and is the page that the models make."""

from __future__ import annotations

import pytest

from cell.files.model import Model
from tests import ROOT
from tests.docs.reference import FILES, PAGE, page, undocumented


@pytest.mark.parametrize("model", FILES.values())
def test_no_key_is_undocumented(model: type[Model]) -> None:
    assert undocumented(model.model_json_schema()) == []


def test_a_key_without_words_is_found() -> None:
    class Inner(Model):
        """An inner part."""

        told_m: float
        forgotten_s: float

    class Outer(Model):
        """An outer part.

        Attributes:
            many: by name.
        """

        many: dict[str, Inner]

    assert undocumented(Outer.model_json_schema()) == ["many.*.told_m", "many.*.forgotten_s"]


def test_several_names_and_long_lines_of_a_docstring_are_read() -> None:
    class Part(Model):
        """A part
        in two lines.

        Attributes:
            first_m, second_m: told together,
                in two lines: really.
            third: alone.
        """

        first_m: float
        second_m: float
        third: int

    together = "told together, in two lines: really."
    assert Part.meanings() == {"first_m": together, "second_m": together, "third": "alone."}
    assert Part.model_json_schema()["properties"]["second_m"]["description"] == together
    assert Part.model_json_schema()["description"] == "A part in two lines."


@pytest.mark.parametrize("model", FILES.values())
def test_docstrings_name_only_keys_that_exist(model: type[Model]) -> None:
    for each in [model, *Model.__subclasses__()]:
        if each.__module__.split(".")[0] != "tests":
            assert set(each.meanings()) <= set(each.model_fields), each


def test_the_page_is_what_the_models_say() -> None:
    assert (ROOT / PAGE).read_text() == page(), "make pictures"
