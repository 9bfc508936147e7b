"""What all commands share: lines of their table, the console, tables and JSON on the terminal, exit statuses."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bracket_cell.packages import how_to_install
from bracket_ground.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from bracket_ground.interfaces.product import Product


ENTRY_POINTS = "cell.commands"
BAD_INPUT, SAFE_STOP = 2, 3  # exit statuses
BESIDE = "CELL_BESIDE"  # set in the environment of a command that another one runs and waits for
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def printable(text: str) -> str:
    """A text that moves no cursor and turns none round, whatever the file holds that it was read from."""
    return _CONTROLS.sub(lambda found: ascii(found[0])[1:-1], text)


def complain(text: str) -> None:
    """Say on standard error what is wrong, or missing."""
    sys.stderr.write(f"cell: {printable(text)}\n")


def console() -> Console:
    """Standard error: progress and messages, shown as they are; standard output is for what programs read."""
    from rich.console import Console

    return Console(stderr=True, soft_wrap=True, emoji=False, markup=False)


def wait_for_enter(prompt: str) -> None:
    """Wait for Enter; raises InputError where nobody can press it."""
    console().print(f"{prompt}, then press Enter", highlight=False)
    if not sys.stdin.readline():
        raise InputError("nobody pressed Enter: this command asks at the terminal; nothing was changed")


def table(title: str, values: Mapping[str, object]) -> Any:
    """Names and values, a row each; what is counted by name as `bracket 2, rest 1`."""
    from rich.table import Table

    drawn = Table(title=title, show_header=False, title_justify="left")
    for name, value in values.items():
        if isinstance(value, Mapping):
            value = ", ".join(f"{what} {count}" for what, count in value.items())
        drawn.add_row(name, str(value))
    return drawn


def print_json(values: Mapping[str, object]) -> None:
    """One line of JSON on standard output."""
    sys.stdout.write(json.dumps(values) + "\n")
    sys.stdout.flush()


def report_scores(title: str, scores: Mapping[str, float], as_json: bool) -> None:
    """Scores as a table, each with its interval where it has one, and as JSON where that is asked for."""
    rows = {name: f"{value:.4g}" for name, value in scores.items() if not name.endswith(("_low", "_high", "_n"))}
    for name in rows:
        if f"{name}_n" in scores:
            rows[name] += f" of {scores[f'{name}_n']:.0f}"
        if f"{name}_low" in scores:
            rows[name] += f" ({scores[f'{name}_low']:.3f} - {scores[f'{name}_high']:.3f})"
    console().print(table(title, rows))
    if as_json:
        print_json(scores)


def product_of(config: Path) -> Product:
    """The product that a configuration names.

    Raises:
        InputError: a file is missing or wrong, with its line.
    """
    from bracket_cell.configuration import load_configuration, load_product

    return load_product(load_configuration(config), config)


@dataclass(frozen=True)
class Command:
    """A command, or a group of commands.

    Attributes:
        target: "module:name" of a function or a typer application; of a group, that of its table; of another
            distribution, its entry point.
        help: in one line, for the list of commands.
        panel: where it stands in the list; None for not there.
        comes_with: the distribution that has it; empty for this one.
    """

    target: str
    help: str
    panel: str | None = None
    group: bool = False
    comes_with: str = ""

    def load(self) -> Any:
        """The function or the typer application.

        Raises:
            InputError: it is of a distribution that is not installed.
        """
        if self.comes_with:
            found = entry_points(group=ENTRY_POINTS, name=self.target)
            if not found:
                raise InputError(f"this command is not installed; install it: {how_to_install(self.comes_with)}")
            return next(iter(found)).load()
        module, _, name = self.target.partition(":")
        return getattr(import_module(module), name)


Table = Mapping[str, Command]
