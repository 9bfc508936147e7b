"""docs/configuration.md and its pages have every key of every YAML file, and are what the models make."""

from __future__ import annotations

import pytest

from bracket_ground.files.model import Model
from tests import ROOT
from tests.cell.commands.test_surface import leaves, whole
from tests.docs.reference import FILES, FOLDER, INDEX, pages, sections, undocumented


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


@pytest.mark.parametrize("name", pages())
def test_a_page_is_what_the_models_say(name: str) -> None:
    assert (ROOT / name).read_text() == pages()[name], "make pictures"


def test_every_page_is_made_and_in_the_index() -> None:
    stored = {f"{FOLDER}/{page.name}" for page in (ROOT / FOLDER).iterdir()}
    assert stored == set(pages()) - {INDEX}, "make pictures; delete what it does not make"
    assert [name for name in stored if f"({name.removeprefix('docs/')})" not in pages()[INDEX]] == []


@pytest.mark.parametrize("model", FILES.values())
def test_every_key_stands_on_a_page(model: type[Model]) -> None:
    rows = [line for text in pages().values() for line in text.splitlines() if line.startswith("| `")]
    keys = [key for section in sections(model.model_json_schema()) for key in section.schema["properties"]]
    assert [key for key in keys if not any(row.startswith(f"| `{key}` |") for row in rows)] == []


def test_every_command_and_option_of_the_product_stands_on_the_page_of_commands() -> None:
    told = (ROOT / "docs" / "reference" / "commands.md").read_text().split("\n## cell ")[1:]
    rows = {section.partition("\n")[0]: section for section in told}
    commands = {" ".join(path): each for path, each in leaves(whole(), ())}
    assert set(commands) <= set(rows)
    missing = [
        (name, option)
        for name, each in commands.items()
        for param in each.params
        if not param.hidden and param.name != "help"
        for option in [*param.opts, *param.secondary_opts]
        if option.startswith("--") and f"| `{option}" not in rows[name] and f" / {option}" not in rows[name]
    ]
    assert missing == []
