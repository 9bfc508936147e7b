"""The tree that a log was recorded with, loaded from the log itself."""

from __future__ import annotations

import tempfile
from pathlib import Path

from cell.interfaces.errors import LogError
from cell.log.reader import Log
from cell.node_library import node_registry
from trees.loader import load_tree
from trees.tree import Tree

FOLDER = "tree/"


def logged_tree(log: Log) -> Tree:
    """Load it with the nodes of this version.

    Raises:
        LogError: the log holds no tree.
        InputError: this version cannot load it.
    """
    name = log.metadata.get("tree")
    files = {Path(one).name: text for one, text in log.attachments.items() if one.startswith(FOLDER)}
    if name is None or name not in files:
        raise LogError(log.path, f"holds no tree; it holds: {', '.join(log.attachments) or 'nothing'}")
    with tempfile.TemporaryDirectory(prefix="cell-tree-") as folder:
        for file, text in files.items():
            (Path(folder) / file).write_bytes(text)
        return load_tree(Path(folder) / name, node_registry())
