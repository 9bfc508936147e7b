"""What a sweep runs: seeds x trees x configurations x people x looks x goals x faults, from a YAML file."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import yaml
from pydantic import Field

from bracket_cell.configuration import (
    DEFAULT_CONFIGURATION,
    DEFAULT_TREE,
    Configuration,
    load_configuration,
    load_product,
    simulated,
)
from bracket_cell.fleet.store import is_address
from bracket_cell.kinds import DETECTORS, files_of
from bracket_cell.recording.identity import code_version
from bracket_cell.runs.heading import robot_files
from bracket_cell.simulator import simulator
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_ground.errors import InputError, Problem
from bracket_ground.files.files import read_text
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml, place_of, read_data
from bracket_ground.interfaces.product import Product
from btxml.files.parse.xml_file import plain_files

MOST_RUNS = 10_000_000
MOST_SENT_BYTES = 32_000_000
YAML = (".yaml", ".yml")
SOME = Field(min_length=1)
NOT_SENT = ("robot", "nodes", "log", "page", "plant")  # keys of a configuration: what they name goes otherwise, or not
Packed = tuple[str, str, tuple[tuple[str, bytes], ...], tuple[str, ...], tuple[str, ...]]


class Seeds(Model):
    """Seeds in a row.

    Attributes:
        first: the first one.
        count: how many.
    """

    first: int = Field(default=0, ge=0)
    count: int = Field(default=1, ge=1, le=MOST_RUNS)


class Sweep(Model):
    """Every combination of what is listed is run once.

    Attributes:
        seeds: of every combination; the same for all, so that runs can be compared in pairs.
        trees: tree files, relative to this file.
        configurations: configuration files, relative to this file.
        people: who stands at the bench, names, or files relative to this file; null for the configuration's.
        looks: what the simulated cell looks like, names or files, likewise; null for the configuration's.
        goals: what the person assembles, or random.
        faults: FAULT@STATE, a fault that is put in; null for none.
        pixels: render what the cameras see; without, hands, holes and parts come from the truth, several times faster.
        max_duration_s: each run ends by itself after this much clock time; null for the configuration's.
    """

    seeds: Seeds = Seeds()
    trees: Annotated[tuple[Path, ...], SOME] = (DEFAULT_TREE,)
    configurations: Annotated[tuple[Path, ...], SOME] = (DEFAULT_CONFIGURATION,)
    people: Annotated[tuple[str | None, ...], SOME] = (None,)
    looks: Annotated[tuple[str | None, ...], SOME] = (None,)
    goals: Annotated[tuple[str, ...], SOME] = ("random",)
    faults: Annotated[tuple[str | None, ...], SOME] = (None,)
    max_duration_s: float | None = Field(default=None, gt=0, le=86_400)
    pixels: bool = True


@dataclass(frozen=True)
class Task:
    """One run, with the text of every file that it needs: a worker needs nothing but the package.

    Attributes:
        tree, configuration: names in `files`.
        files: content by name, relative to a folder that the worker makes.
        person, look: names, or names in `files`.
        logs: folder or address for the run's log, with images; None to keep none.
        keep_one_in: of so many runs that went right, the log of one is kept; all others are.
        nodes: names in `files` of files with further nodes.
        made_of: digests of weights that are not sent, as every worker has them, and the program's commit.
        label: what tells it apart from the sweep's other runs, for people and for rows.
    """

    tree: str
    configuration: str
    files: tuple[tuple[str, bytes], ...]
    seed: int
    goal: str
    person: str | None
    look: str | None
    fault: str | None
    max_duration_s: float | None
    label: tuple[tuple[str, str], ...]
    logs: str | None = None
    keep_one_in: int = 1
    pixels: bool = True
    nodes: tuple[str, ...] = ()
    made_of: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Names the run by all that decides it; where a file, weights or the program changed, it is another."""
        files: list[object] = [[name, _digest(content)] for name, content in self.files]
        files += [*self.nodes, *self.made_of]
        asked = [self.tree, self.configuration, self.goal, self.person, self.look, self.fault, self.max_duration_s]
        asked = asked if self.pixels else [*asked, "without pixels"]
        return hashlib.sha256(json.dumps([files, *asked, self.seed]).encode()).hexdigest()[:32]

    def keeps(self, summary: Mapping[str, object]) -> bool:
        """Whether a run's log is worth its place: it failed, or is of the sample, which is the same every time."""
        right = summary.get("end") == "finished" and summary.get("correct") is not False
        return not right or int(self.key[:8], 16) % self.keep_one_in == 0


def load_sweep(path: Path) -> Sweep:
    """The sweep of a file; paths in it are relative to it.

    Raises:
        InputError: the file is wrong.
    """
    sweep = load_yaml(path, Sweep)
    folder = path.resolve().parent
    trees = tuple((folder / tree).resolve() for tree in sweep.trees)
    configurations = tuple((folder / configuration).resolve() for configuration in sweep.configurations)
    others = {name: tuple(_beside(folder, text) for text in getattr(sweep, name)) for name in ("people", "looks")}
    return sweep.model_copy(update={"trees": trees, "configurations": configurations, **others})


def _beside(folder: Path, names: str | None) -> str | None:
    """Names of people or looks, those that are files in a folder by their whole paths."""
    return names and ",".join(str(file) if (file := folder / name).is_file() else name for name in names.split(","))


def tasks(
    sweep: Sweep, logs: str | None = None, nodes: Iterable[str] = (), keep_one_in: int = 1, spec: Path | None = None
) -> Iterator[Task]:
    """All runs, seed by seed; every file is read and checked before the first one.

    Args:
        logs: folder or address for the logs of all runs, by their keys; None to keep none.
        nodes: Python files with further nodes, and folders of them; they are sent along.
        keep_one_in: of so many runs that went right, the log of one is kept.
        spec: the sweep's file, for messages.

    Raises:
        InputError: a tree, a configuration or what else is named cannot be used.
    """
    given = tuple(nodes)
    packed = {
        (tree, configuration): _packed(sweep, tree, configuration, given, spec)
        for tree, configuration in itertools.product(sweep.trees, sweep.configurations)
    }
    folder = logs if logs is None or is_address(logs) else str(Path(logs).resolve())
    return _tasks(sweep, packed, folder, keep_one_in)


def count(sweep: Sweep) -> int:
    """How many runs there are."""
    listed = (sweep.trees, sweep.configurations, sweep.people, sweep.looks, sweep.goals, sweep.faults)
    total = sweep.seeds.count
    for values in listed:
        total *= len(values)
    return total


def _tasks(sweep: Sweep, packed: dict[tuple[Path, Path], Packed], logs: str | None, keep_one_in: int) -> Iterator[Task]:
    first = sweep.seeds.first
    trees, configurations = apart(sweep.trees), apart(sweep.configurations)
    others = apart(_files_of(sweep.people, sweep.looks))
    for seed in range(first, first + sweep.seeds.count):
        for pair, person, look, goal, fault in itertools.product(
            itertools.product(sweep.trees, sweep.configurations), sweep.people, sweep.looks, sweep.goals, sweep.faults
        ):
            tree, configuration, files, nodes, made_of = packed[pair]
            names = {"tree": trees[pair[0]], "configuration": configurations[pair[1]]}
            named = {**names, "person": person, "look": look}
            label = tuple((name, _each(value, others) or "as configured") for name, value in named.items())
            away = {file: _sent_as(file) for file in others}
            yield Task(
                tree,
                configuration,
                files,
                seed,
                goal,
                _each(person, away),
                _each(look, away),
                fault,
                sweep.max_duration_s,
                (*label, ("goal_asked", goal), ("fault", fault or "")),
                logs,
                keep_one_in,
                sweep.pixels,
                nodes,
                made_of,
            )


def _packed(sweep: Sweep, tree: Path, path: Path, given: Sequence[str], spec: Path | None) -> Packed:
    """Texts of a tree and a configuration with all that they name, which lie to one another as they do here."""
    configuration = load_configuration(path)
    product = load_product(configuration, path)
    _check(sweep, configuration, product, spec)
    own = _node_files([*given, *(name for name in configuration.nodes if Path(name).exists())])
    loaded = load_tree(tree, node_registry(product, given, configuration))
    folder = tree.resolve().parent
    files = {f"trees/{_inside(part, folder)}": text.encode() for part, text in loaded.texts.items()}
    files |= {_sent_as(file): file.read_bytes() for file in _files_of(sweep.people, sweep.looks)}
    files |= {name: file.read_bytes() for name, file in own.items()}
    weights = [file for name in DETECTORS for file in configuration.perception.files(name).values()]
    weights += [file for name, planner in configuration.planners for file in files_of(name, planner).values()]
    made_of = [f"commit {' '.join(code_version().values())}"]
    for file in dict.fromkeys(weights):
        if not file.is_file():
            raise InputError(f"{path}: names weights {file}, which are not there")
        made_of.append(_digest(file.read_bytes()))
    path = path.parent.resolve() / path.name
    named = _named(path, {})
    sent = [*filter(Path.is_file, named), *(file for file in map(Path.resolve, weights) if file.parent in named)]
    top = Path(os.path.commonpath([file.parent for file in sent]))
    names = {file: f"config/{file.relative_to(top)}" for file in sent}
    files |= {name: _content(file, named) for file, name in names.items()}
    _send_robot(configuration, path, names[path], files)
    if (size := sum(map(len, files.values()))) > MOST_SENT_BYTES:
        raise InputError(f"{path}: with its weights each run takes {size} bytes along; legal: up to {MOST_SENT_BYTES}")
    return f"trees/{tree.name}", names[path], tuple(sorted(files.items())), tuple(sorted(own)), tuple(made_of)


def _check(sweep: Sweep, configuration: Configuration, product: Product, spec: Path | None) -> None:
    """Raises InputError where the configuration cannot have an entry of the sweep, with its line in the file."""

    def goal(name: str) -> None:
        if name != "random" and name not in product.goals:
            raise InputError(f"unknown goal '{name}'; legal: {', '.join(product.goals)}, random")

    checks: Mapping[str, Callable[[str], object]] = {
        "people": lambda person: simulated(configuration, person=person),
        "looks": lambda look: simulated(configuration, look=look),
        "goals": goal,
        "faults": lambda fault: simulator().injected(fault, len(configuration.robot.joints)),
    }
    for name, check in checks.items():
        for number, entry in enumerate(getattr(sweep, name)):
            try:
                _ = entry is not None and check(entry)
            except InputError as error:
                place = None if spec is None else place_of(spec, (name, number))
                raise InputError(str(error) if place is None else Problem(place, str(error))) from None


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


def _files_of(*named: Iterable[str | None]) -> list[Path]:
    """Files among names of people and looks; persons with commas between them take turns."""
    texts = (text for names in named for name in names if name for text in name.split(","))
    return [file for file in map(Path, dict.fromkeys(texts)) if file.is_file()]


def _each(names: str | None, others: Mapping[Path, str]) -> str | None:
    """Names with commas between them, files among them by other names."""
    return names and ",".join(others.get(Path(name), name) for name in names.split(","))


def _sent_as(file: Path) -> str:
    return f"people/{_digest(file.read_bytes())[:16]}/{file.name}"


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
            found[f"nodes/{_digest(str(file.parent).encode())[:8]}/{file.name}"] = file
    return found


def apart(paths: Iterable[Path]) -> dict[Path, str]:
    """Paths by their name, with as many folders before it as tell them apart."""
    parts = {path: path.resolve().parts for path in paths}
    names = {}
    for path, own in parts.items():
        length = next(
            (n for n in range(1, len(own)) if sum(other[-n:] == own[-n:] for other in parts.values()) == 1), len(own)
        )
        names[path] = "/".join(own[-length:])
    return names


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _inside(file: Path, folder: Path) -> Path:
    try:
        return file.resolve().relative_to(folder)
    except ValueError:
        raise InputError(f"{file}: a tree that is sent to workers includes only files beside it or below") from None
