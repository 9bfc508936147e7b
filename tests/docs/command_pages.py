"""docs/reference/commands.md and research-commands.md: every command and option, in the words of `--help`."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from functools import partial
from typing import Any

from typer.main import get_command

from bracket_cell.commands.main import application
from tests.docs.reference_pages import MADE

HEAD = """# {title}

{made} `{command} --help` says the same.

"""
RESEARCH = "lab"


def commands(*path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Each public command below a group, with its words; of the whole program without those for research."""
    group: Any = get_command(application())
    for word in path:
        group = group.commands[word]
    yield from _below(group, path)


def options(command: Any) -> Iterator[tuple[str, str]]:
    """(how it is written, what it does) of each public argument and option."""
    for param in command.params:
        if not param.hidden and param.name != "help":
            written = " / ".join([*param.opts, *param.secondary_opts])
            if param.param_type_name == "argument":
                written = param.metavar or param.name.upper()
            elif values := _values(param):
                written += f" {values}"
            yield written.replace("|", r"\|"), _plain(param.help).replace("|", r"\|")


def _values(param: Any) -> str:
    """What follows an option, as far as it is told."""
    kind = param.type_descriptor.annotation
    choices = [str(one.value) for one in kind] if isinstance(kind, type) and issubclass(kind, Enum) else []
    return param.metavar or "|".join(choices)


def _plain(words: str) -> str:
    return " ".join(words.replace(r"\[", "[").split())


def _below(group: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, command in group.commands.items():
        if not command.hidden:
            if getattr(command, "invoke_without_command", True):
                yield (*path, name), command
            if hasattr(command, "commands"):
                yield from _below(command, (*path, name))


def _page(title: str, *path: str) -> str:
    lines = [HEAD.format(title=title, made=MADE, command=" ".join(("cell", *path)))]
    for words, command in commands(*path):
        lines.append(f"## cell {' '.join(words)}\n{_plain(command.help)}\n\n")
        rows = [f"| `{written}` | {told} |\n" for written, told in options(command)]
        lines += ["| | |\n|---|---|\n", *rows, "\n"] if rows else []
    return "".join(lines).rstrip() + "\n"


PAGES = {
    "docs/reference/commands.md": partial(_page, "Commands"),
    "docs/reference/research-commands.md": partial(_page, "Commands for research", RESEARCH),
}
