"""`cell nodes`: the nodes that tree files may name."""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.options import WithOption, own_files
from cell.commands.show import write
from trees.node_library import node_registry
from trees.views.palette import groot_model, named, palette_list, palette_text


class NodeFormat(StrEnum):
    """How the nodes are listed."""

    text = "text"
    json = "json"
    groot = "groot"


def nodes(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="A node's name, or a text in its name or meaning.")
    ] = None,
    style: Annotated[
        NodeFormat, typer.Option("--format", help="text; json for programs; groot: palette for Groot2.")
    ] = NodeFormat.text,
    groot: Annotated[Path | None, typer.Option(help="Write the palette for Groot2 into this file.")] = None,
    own: WithOption = None,
) -> None:
    """List the nodes that tree files may name, with their ports; or one of them."""
    registry = node_registry(more=own_files(own)[0])
    chosen = tuple(registry.classes) if name is None else named(registry, name)
    if groot is not None:
        write(groot, groot_model(registry).encode())
    elif style is NodeFormat.text:
        sys.stdout.write(palette_text(registry, chosen))
    elif style is NodeFormat.json:
        sys.stdout.write(json.dumps(palette_list(registry, chosen)) + "\n")
    else:
        sys.stdout.write(groot_model(registry))
