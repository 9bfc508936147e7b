"""The tree and the product that a log was recorded with, loaded from the log itself."""

from __future__ import annotations

import tempfile
from pathlib import Path

from cell.interfaces.errors import LogError
from cell.interfaces.product import Product
from cell.interfaces.yaml_file import load_yaml
from cell.log.reader import Log
from cell.node_library import node_registry
from trees.loader import load_tree
from trees.tree import Tree

FOLDER = "tree/"
PRODUCT = "product.yaml"


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


def logged_product(log: Log) -> Product:
    """The product that was assembled.

    Raises:
        LogError: the log holds none.
        InputError: this version cannot read it.
    """
    if PRODUCT not in log.attachments:
        raise LogError(log.path, f"holds no {PRODUCT}; it holds: {', '.join(log.attachments) or 'nothing'}")
    with tempfile.TemporaryDirectory(prefix="cell-product-") as folder:
        path = Path(folder) / PRODUCT
        path.write_bytes(log.attachments[PRODUCT])
        return load_yaml(path, Product)
