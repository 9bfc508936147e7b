"""What a sweep runs: seeds x trees x configurations x people x looks x goals x faults, from a YAML file."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from bracket_cell.configuration import (
    DEFAULT_CONFIGURATION,
    DEFAULT_TREE,
    load_configuration,
    load_product,
    simulated,
)
from bracket_cell.fleet.packing import Packed, pack, sent_as
from bracket_cell.fleet.store import is_address
from bracket_cell.fleet.task import Task
from bracket_cell.simulator import simulator
from bracket_ground.errors import InputError, Problem
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml, place_of

MOST_RUNS = 10_000_000
SOME = Field(min_length=1)


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
    given, others = tuple(nodes), _files_of(sweep.people, sweep.looks)
    for path in sweep.configurations:
        _check(sweep, path, spec)
    packed = {pair: pack(*pair, given, others) for pair in itertools.product(sweep.trees, sweep.configurations)}
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
            names = {"tree": trees[pair[0]], "configuration": configurations[pair[1]]}
            named = {**names, "person": person, "look": look}
            label = tuple((name, _each(value, others) or "as configured") for name, value in named.items())
            away = {file: sent_as(file) for file in others}
            yield Task(
                packed[pair],
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
            )


def _check(sweep: Sweep, path: Path, spec: Path | None) -> None:
    """Raises InputError where a configuration cannot have an entry of the sweep, with its line in the file."""
    configuration = load_configuration(path)
    goals = load_product(configuration, path).goals

    def goal(name: str) -> None:
        if name != "random" and name not in goals:
            raise InputError(f"unknown goal '{name}'; legal: {', '.join(goals)}, random")

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


def _files_of(*named: Iterable[str | None]) -> list[Path]:
    """Files among names of people and looks; persons with commas between them take turns."""
    texts = (text for names in named for name in names if name for text in name.split(","))
    return [file for file in map(Path, dict.fromkeys(texts)) if file.is_file()]


def _each(names: str | None, others: Mapping[Path, str]) -> str | None:
    """Names with commas between them, files among them by other names."""
    return names and ",".join(others.get(Path(name), name) for name in names.split(","))


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
