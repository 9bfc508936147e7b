"""`cell nodes`: the nodes that tree files may name."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.show import NodesOption, write


class NodeFormat(StrEnum):
    """How the nodes are listed."""

    text = "text"
    json = "json"
    groot = "groot"


def nodes(
    style: Annotated[
        NodeFormat, typer.Option("--format", help="text; json for programs; groot: palette for Groot2.")
    ] = NodeFormat.text,
    groot: Annotated[Path | None, typer.Option(help="Write the palette for Groot2 into this file.")] = None,
    own_nodes: NodesOption = None,
) -> None:
    """List the nodes that tree files may name, with their ports."""
    from trees.node_library import node_registry
    from trees.views import palette

    registry = node_registry(more=own_nodes or ())
    if groot is not None:
        write(groot, palette.groot_model(registry).encode())
        return
    writers: Mapping[NodeFormat, Callable[[], str]] = {
        NodeFormat.text: lambda: palette.palette_text(registry),
        NodeFormat.json: lambda: json.dumps(palette.palette_list(registry)) + "\n",
        NodeFormat.groot: lambda: palette.groot_model(registry),
    }
    sys.stdout.write(writers[style]())
