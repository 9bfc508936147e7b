"""Why a replay decides otherwise: what was changed, and which value lies between the old limit and the new one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.log.replay.compare import Comparison, Difference
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.logged_tree import logged_tree
from bracket_cell.log.replay.replay import Replay
from bracket_cell.recording.schemas import plain
from bracket_ground.errors import InputError, LogError
from btxml.engine.tree import Tree

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
_PLACE = re.compile(r"::\d+")
NOT_THERE = "not there"
MOST_CROSSED = 6


@dataclass(frozen=True)
class Change:
    """One key that is another one than in the log.

    Attributes:
        where: a key of the configuration, or a node's path and its attribute.
    """

    where: str
    was: str
    now: str

    def __str__(self) -> str:
        return f"{self.where}: {self.was} -> {self.now}"


def changed_keys(log: Log, changes: Changes, tree: Tree | None = None) -> list[Change]:
    """What configuration and tree have otherwise than those of the log.

    Args:
        tree: the one that is ticked in place of the log's.
    """
    found: list[Change] = []
    if changes.configuration is not None and "configuration.yaml" in log.attachments:
        was = yaml.safe_load(log.attachments["configuration.yaml"])
        found += _differing(dict(_flat(was)), dict(_flat(yaml.safe_load(changes.configuration.read_text("utf-8")))))
    found += [Change(f"weights.{name}", "those of the log", str(file)) for name, file in changes.weights.items()]
    if changes.perception is not None:
        found.append(Change("perception", log.metadata.get("perception", "unknown"), changes.perception))
    if changes.tree is not None and tree is not None:
        try:
            found += _differing(_attributes(logged_tree(log, changes.nodes)), _attributes(tree))
        except (LogError, InputError):
            found.append(Change("tree", log.metadata.get("tree", "unknown"), str(changes.tree)))
    return found


def crossed(replay: Replay, changed: Iterable[Change], comparison: Comparison) -> list[str]:
    """Values of the first tick that differs, or of what was believed then, that lie between an old and a new limit."""
    numbers = list(dict.fromkeys(_numbers([vars(one) for one in comparison.at_first], "")))
    numbers += list(_numbers(_believed(replay.log, comparison.first), "belief"))
    told = []
    for one in changed:
        try:
            low, high = sorted((float(one.was), float(one.now)))
        except ValueError:
            continue
        values = [(name, value) for name, value in numbers if low <= value <= high]
        values.sort(key=lambda pair: pair[1] in (low, high))
        told += [f"{name} {value:g} lies between {one.was} and {one.now} of {one.where}" for name, value in values[:1]]
    return told[:MOST_CROSSED]


def _believed(log: Log, first: Difference | None) -> Mapping[str, float]:
    before = [tick for tick in log.ticks if first is not None and tick.number <= first.tick]
    goals = (note["goals"] for tick in reversed(before) for topic, note in tick.notes if "goals" in note)
    return next(goals, {})


def _numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """(what, number) of everything in plain data, in the words of texts, too."""
    if isinstance(value, Mapping):
        for key, one in value.items():
            if key not in ("tick", "time_s", "node"):
                yield from _numbers(one, f"{name}.{key}".strip("."))
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _numbers(one, name)
    elif isinstance(value, str):
        yield from ((f"{name} ({value})" if len(value) < 90 else name, float(one)) for one in _NUMBER.findall(value))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield name, float(value)


def _attributes(tree: Tree) -> dict[str, str]:
    """Every attribute of every node, by the node's path and the attribute; a node without any is there, too."""
    counts: dict[str, int] = {}
    found = {}
    for node, origin in zip(tree.nodes, tree.origins, strict=True):
        path = _PLACE.sub("", node.full_path)
        counts[path] = counts.get(path, 0) + 1
        place = path if counts[path] == 1 else f"{path} ({counts[path]})"
        found[place] = origin.tag
        found |= {f"{place}.{name}": value for name, value in origin.attributes.items() if name != "name"}
    return found


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, one in value.items():
            yield from _flat(one, f"{name}.{key}".strip("."))
    else:
        yield name, str(value)


def _differing(was: Mapping[str, str], now: Mapping[str, str]) -> list[Change]:
    keys = [key for key in dict.fromkeys((*was, *now)) if was.get(key) != now.get(key)]
    return [Change(key, was.get(key, NOT_THERE), now.get(key, NOT_THERE)) for key in keys]


def replay_row(path: str, changes: Changes) -> dict[str, Any]:
    """A log of many as a row: how many ticks differ, and where the first other command and the first difference stand.

    A log that cannot be replayed is a row that says why.
    """
    row: dict[str, Any] = {"log": path, "ticks": 0, "differing_ticks": None, "error": ""}
    try:
        replay = Replay(read_log(Path(path)), changes)
        comparison = replay.run()
    except (LogError, InputError) as error:
        return {**row, "error": str(error)}
    row |= {"ticks": comparison.ticks, "differing_ticks": comparison.differing_ticks}
    act = comparison.first_by_aspect.get("command")
    for name, one in (("first", comparison.first), ("command", act)):
        at = {"tick": None, "time_s": None, "aspect": None} if one is None else plain(one)
        row |= {f"{name}_{key}": at[key] for key in ("tick", "time_s", "aspect")}
    row["node"] = comparison.command_node if act is not None else (comparison.first.node if comparison.first else "")
    changed = changed_keys(replay.log, changes, replay.tree)
    row["why"] = "; ".join(crossed(replay, changed, comparison) or map(str, changed[:1])) if comparison.first else ""
    return row
