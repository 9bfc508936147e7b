"""The tree, the product and the bench that a log was recorded with, loaded from the log itself."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TypeVar

from cell.configuration import Configuration
from cell.errors import LogError
from cell.files.model import Model
from cell.files.yaml_file import load_yaml
from cell.interfaces.bench import Bench
from cell.interfaces.product import Product
from cell.log.read.reader import Log, LogStream
from cell.log.replay.recorded_configuration import CONFIGURATION, upgrade
from trees.engine.tree import Tree
from trees.files.loader import load_tree
from trees.node_library import node_registry

FOLDER = "tree/"
PRODUCT = "product.yaml"

AnyModel = TypeVar("AnyModel", bound=Model)


def logged_tree(log: Log | LogStream, more: Iterable[str] = ()) -> Tree:
    """Load it with the nodes of this version.

    Args:
        more: files or packages with further nodes.

    Raises:
        LogError: the log holds no tree.
        InputError: this version cannot load it.
    """
    name = f"{FOLDER}{log.metadata.get('tree')}"
    files = {one: text for one, text in log.attachments.items() if one.startswith(FOLDER)}
    if name not in files:
        raise LogError(log.path, f"holds no tree; it holds: {', '.join(log.attachments) or 'nothing'}")
    with tempfile.TemporaryDirectory(prefix="cell-tree-") as folder:
        write_files(log, files, Path(folder))
        return load_tree(Path(folder) / name, node_registry(more=more))


def write_files(log: Log | LogStream, files: Mapping[str, bytes], folder: Path) -> None:
    """Put attachments of a log into a folder, in folders of their own as their names say; see also `upgrade`.

    Raises:
        LogError: a name leads out of the folder.
    """
    for name, content in files.items():
        target = (folder / name).resolve()
        if not target.is_relative_to(folder.resolve()):
            raise LogError(log.path, f"has an attachment that leads out of its folder: {name}")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
    if CONFIGURATION in files:
        upgrade(folder)


def logged_bench(log: Log) -> Bench:
    """The bench as it was measured.

    Raises:
        LogError: the log holds none.
        InputError: this version cannot read it.
    """
    return _read(log, CONFIGURATION, Configuration).bench


def logged_product(log: Log) -> Product:
    """The product that was assembled.

    Raises:
        LogError: the log holds none.
        InputError: this version cannot read it.
    """
    return _read(log, PRODUCT, Product)


def _read(log: Log, name: str, kind: type[AnyModel]) -> AnyModel:
    if name not in log.attachments:
        raise LogError(log.path, f"holds no {name}; it holds: {', '.join(log.attachments) or 'nothing'}")
    with tempfile.TemporaryDirectory(prefix="cell-log-") as folder:
        files = {one: content for one, content in log.attachments.items() if not one.startswith(FOLDER)}
        write_files(log, files, Path(folder))
        return load_yaml(Path(folder) / name, kind)
