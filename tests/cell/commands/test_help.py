"""The help of all commands: what is written is what is shown."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.markup import render
from typer.main import get_command

from bracket_cell.commands.main import application


def test_no_word_of_any_help_is_taken_for_a_style() -> None:
    """Square brackets are: of "[s]" nothing was left."""
    texts = list(_texts(get_command(application()), "cell"))
    assert len(texts) > 300
    lost = [(name, text) for name, text in texts if render(text).plain != text.replace("\\[", "[")]
    assert lost == []


def _texts(command: Any, name: str) -> Iterator[tuple[str, str]]:
    """Every text of a command's help and of those below it, with what it belongs to."""
    yield name, command.help or ""
    yield from ((f"{name} {param.name}", getattr(param, "help", None) or "") for param in command.params)
    for word, below in getattr(command, "commands", {}).items():
        yield from _texts(below, f"{name} {word}")
