"""`cell init`: a folder with a configuration, a product, a tree and a test that run at once, and with schemas."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.schema import modeline, schema_texts
from bracket_cell.commands.terminal import console
from bracket_cell.trees.node_library import node_registry
from bracket_ground.files.files import shipped, write_new

TREES = ("ahead", "algorithm1", "assemble", "clear_and_grasp", "shift", "shift_ahead")
SHIPPED = {
    "config": ("cell.yaml", "sim.yaml", "products.yaml", "products_steel.yaml"),
    "trees": (*(f"{name}.xml" for name in TREES), "assembly.rules.yaml"),
}
OWN = ("README.md", "AGENTS.md", "tests/test_assemble.py")
NODES = "nodes: [nodes] # nodes of your own, which every command loads; `cell new leaf NAME` writes the first\n"
# For the XML language server of Visual Studio Code, which then completes nodes and ports in tree files.
EDITOR = """{
  "xml.fileAssociations": [{"pattern": "trees/**/*.xml", "systemId": "config/schema/trees.xsd"}]
}
"""
# Lets `pytest` find the folder `nodes`, however it is started, and know what marks a run in simulation.
PYTEST = """[tool.pytest.ini_options]
pythonpath = ["."]
testpaths = ["tests"]
markers = ["slow: runs the simulated cell"]
filterwarnings = ["ignore:Please update your 'hppfcl' imports:DeprecationWarning"]
"""


def init(folder: Annotated[Path, typer.Argument(help="Folder to make; existing files are kept.")]) -> None:
    """Make a folder for a cell of your own: configuration, product, tree and test."""
    say, files = console(), new_cell()
    write_new(folder, files)
    for name in files:
        say.print(f"{folder / name}", highlight=False)
    say.print(f"next: cd {shlex.quote(str(folder))} && cell run", highlight=False)


def new_cell() -> dict[str, bytes]:
    """Contents by their names in the folder."""
    files = {
        f"{folder}/{name}": shipped(f"bracket_cell.{folder}", name)
        for folder, names in SHIPPED.items()
        for name in names
    }
    files |= {name: shipped("bracket_cell.commands", "new_cell", name) for name in OWN}
    contents = {name: file.read_bytes() for name, file in files.items()}
    cell = contents["config/cell.yaml"].decode().replace("\nbench:", f"{NODES}\nbench:", 1)
    contents["config/cell.yaml"] = cell.encode()
    for name in ("cell", "sim", "products"):
        first_line = f"{modeline(f'schema/{name}.json')}\n".encode()
        contents[f"config/{name}.yaml"] = first_line + contents[f"config/{name}.yaml"]
    texts = {f"config/schema/{name}": text for name, text in schema_texts(node_registry()).items()}
    texts |= {".vscode/settings.json": EDITOR, "pyproject.toml": PYTEST}
    return contents | {name: text.encode() for name, text in texts.items()}
