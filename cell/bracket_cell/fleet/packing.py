"""The files that a run of a sweep takes along: all that its tree and its configuration name."""

from __future__ import annotations

import hashlib
import itertools
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from bracket_cell.configuration import Configuration, load_configuration, load_product
from bracket_cell.kinds import DETECTORS, files_of
from bracket_cell.recording.identity import code_version
from bracket_cell.runs.heading import robot_files
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_ground.errors import InputError
from bracket_ground.files.files import read_text
from bracket_ground.files.yaml_file import read_data
from btxml.files.parse.xml_file import plain_files

MOST_SENT_BYTES = 32_000_000
YAML = (".yaml", ".yml")
NOT_SENT = ("robot", "nodes", "log", "page", "plant")  # keys of a configuration: what they name goes otherwise, or not


@dataclass(frozen=True)
class Packed:
    """A tree and a configuration with all that they name, which lie to one another as they do here.

    Attributes:
        tree, configuration: names in `files`.
        files: content by name, relative to a folder that the worker makes.
        nodes: names in `files` of files with further nodes.
        made_of: digests of weights that are not sent, as every worker has them, and the program's commit.
    """

    tree: str
    configuration: str
    files: tuple[tuple[str, bytes], ...]
    nodes: tuple[str, ...] = ()
    made_of: tuple[str, ...] = ()


def pack(tree: Path, path: Path, given: Sequence[str], others: Sequence[Path]) -> Packed:
    """What runs of a tree in the cell of a configuration take along.

    Args:
        given: Python files with further nodes, and folders of them.
        others: files of people and looks.

    Raises:
        InputError: a file cannot be used, or it is too much.
    """
    configuration = load_configuration(path)
    product = load_product(configuration, path)
    own = _node_files([*given, *(name for name in configuration.nodes if Path(name).exists())])
    loaded = load_tree(tree, node_registry(product, given, configuration))
    folder = tree.resolve().parent
    files = {f"trees/{_inside(part, folder)}": text.encode() for part, text in loaded.texts.items()}
    files |= {sent_as(file): file.read_bytes() for file in others}
    files |= {name: file.read_bytes() for name, file in own.items()}
    weights = [file for name in DETECTORS for file in configuration.perception.files(name).values()]
    weights += [file for name, planner in configuration.planners for file in files_of(name, planner).values()]
    made_of = [f"commit {' '.join(code_version().values())}"]
    for file in dict.fromkeys(weights):
        if not file.is_file():
            raise InputError(f"{path}: names weights {file}, which are not there")
        made_of.append(digest(file.read_bytes()))
    path = path.parent.resolve() / path.name
    named = _named(path, {})
    sent = [*filter(Path.is_file, named), *(file for file in map(Path.resolve, weights) if file.parent in named)]
    top = Path(os.path.commonpath([file.parent for file in sent]))
    names = {file: f"config/{file.relative_to(top)}" for file in sent}
    files |= {name: _content(file, named) for file, name in names.items()}
    _send_robot(configuration, path, names[path], files)
    if (size := sum(map(len, files.values()))) > MOST_SENT_BYTES:
        raise InputError(f"{path}: with its weights each run takes {size} bytes along; legal: up to {MOST_SENT_BYTES}")
    return Packed(f"trees/{tree.name}", names[path], tuple(sorted(files.items())), tuple(sorted(own)), tuple(made_of))


def _send_robot(configuration: Configuration, path: Path, name: str, files: dict[str, bytes]) -> None:
    """Take a robot of one's own along, with URDF and meshes, as a log does."""
    written = read_data(path, files[name].decode())
    if (path.parent / str(written.get("robot", ""))).is_file():
        folder = Path(name).parent
        files.update({f"{folder}/sent/{file}": sent for file, (_, sent) in robot_files(configuration.robot).items()})
        files[name] = yaml.safe_dump({**written, "robot": "sent/robot.yaml"}).encode()


def _named(file: Path, found: dict[Path, None]) -> dict[Path, None]:
    """A file and, where it is YAML, all files and folders that it and those name."""
    found[file] = None
    if file.suffix in YAML and file.is_file():
        for text in _texts(read_data(file, read_text(file))):
            module = f"{text.partition(':')[0].replace('.', '/')}.py" if ":" in text else text
            for other in ((file.parent / name).resolve() for name in (text, module)):
                if other not in found and os.access(other, os.R_OK):
                    _named(other, found)
    return found


def _texts(value: object) -> Iterator[str]:
    """All texts of what a YAML file says."""
    if isinstance(value, dict):
        value = [item for key, item in value.items() if key not in NOT_SENT]
    if isinstance(value, list):
        yield from itertools.chain.from_iterable(map(_texts, value))
    elif isinstance(value, str) and value:
        yield value


def _content(file: Path, named: Collection[Path]) -> bytes:
    """What is sent of a file: names of others as they are seen from it, and no nodes, which come by themselves."""
    content = file.read_bytes()
    written = read_data(file, content.decode()) if file.suffix in YAML else None
    moved = _moved(written, file.parent, named)
    return content if moved == written else yaml.safe_dump(moved).encode()


def _moved(value: object, folder: Path, named: Collection[Path]) -> object:
    if isinstance(value, dict):
        kept = {key: item for key, item in value.items() if key != "nodes"}
        return {key: item if key in NOT_SENT else _moved(item, folder, named) for key, item in kept.items()}
    if isinstance(value, list):
        return [_moved(item, folder, named) for item in value]
    if isinstance(value, str) and value and (file := (folder / value).resolve()) in named:
        return os.path.relpath(file, folder)
    return value


def sent_as(file: Path) -> str:
    """The name of a file of people or looks where it is sent."""
    return f"people/{digest(file.read_bytes())[:16]}/{file.name}"


def _node_files(nodes: Iterable[str]) -> dict[str, Path]:
    """Files by the names under which they are sent.

    Raises:
        InputError: one is no Python file.
    """
    found = {}
    for node in nodes:
        path = Path(node)
        if not path.exists() or (path.is_file() and path.suffix != ".py"):
            raise InputError(f"--with {node}: only Python files, and folders with them, are sent to workers")
        for file in plain_files(path, "*.py") if path.is_dir() else [path]:
            found[f"nodes/{digest(str(file.parent).encode())[:8]}/{file.name}"] = file
    return found


def digest(content: bytes) -> str:
    """SHA-256 of a content."""
    return hashlib.sha256(content).hexdigest()


def _inside(file: Path, folder: Path) -> Path:
    try:
        return file.resolve().relative_to(folder)
    except ValueError:
        raise InputError(f"{file}: a tree that is sent to workers includes only files beside it or below") from None
