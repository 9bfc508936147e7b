"""Why a run decides otherwise than another: from what both noted when they compared, and from nothing else."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.log.replay.compare import Comparison, Difference, Turn
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.logged_tree import logged_tree, other_nodes
from bracket_cell.log.replay.matching import NUMBER, partners
from bracket_cell.log.replay.replay import Replay
from bracket_cell.recording.schemas import plain
from bracket_ground.errors import InputError, LogError
from bracket_ground.files.yaml_file import read_data
from btxml.engine.tree import Tree

NOT_THERE = "not there"
MOST_CAUSES = 6
CONFIGURED = ("configuration.yaml", "simulation.json", "product.yaml", "faults.yaml")
SEEN_BY = {  # of what two runs saw: words of the keys of whoever measures it
    "bench": ("overhead", "camera", "perception", "person", "seed"),
    "parts": ("wrist", "camera", "perception", "seed"),
    "arm": ("arm", "joint", "latency", "trailing", "motion", "seed"),
    "gripper": ("gripper", "seed"),
    "time": ("controller",),
}
PLANNED = {"belief": ("semantic", "goals"), "plan": ("grasp", "graspable")}


@dataclass(frozen=True)
class Change:
    """One key that is another one than in the log.

    Attributes:
        where: a key of the configuration, or a node's path and its attribute.
        node: that path in the log; empty for a key.
    """

    where: str
    was: str
    now: str
    node: str = ""

    def __str__(self) -> str:
        return f"{self.where}: {self.was} -> {self.now}"


def changed_keys(replay: Replay) -> list[Change]:
    """What configuration, weights, nodes and tree of a replay have otherwise than those of the log."""
    log, changes, tree, found = replay.recorded, replay.changes, replay.tree, list[Change]()
    if changes.configuration is not None and "configuration.yaml" in log.attachments:
        now = changes.configuration.read_bytes()
        found += _differing(_keys(log.attachments["configuration.yaml"]), _keys(now))
    found += [Change(f"weights.{name}", "those of the log", str(file)) for name, file in changes.weights.items()]
    if changes.perception is not None:
        found.append(Change("perception", log.metadata.get("perception", "unknown"), changes.perception))
    for node, file in other_nodes(log, tree):
        path = replay.names.get(node.full_path, node.full_path)
        found.append(Change(f"code of {NUMBER.sub('', path)}", "that of the log", file, path))
    if changes.tree is not None:
        found += _other_tree(log, lambda: (logged_tree(log, changes.nodes), tree))
    return found


def changed_files(one: Log, other: Log) -> list[Change]:
    """What two logs were recorded with that is not alike: keys of files, attributes of trees, weights and seeds."""
    found: list[Change] = []
    for name in CONFIGURED:
        if name in one.attachments and name in other.attachments:
            found += _differing(_keys(one.attachments[name]), _keys(other.attachments[name]))
    names = [key for key in one.metadata if key == "seed" or key.startswith(("weights.", "code."))]
    found += _differing(*({key: log.metadata.get(key, NOT_THERE) for key in names} for log in (one, other)))
    return found + _other_tree(one, lambda: (logged_tree(one), logged_tree(other)))


def causes(comparison: Comparison, changed: Sequence[Change]) -> list[str]:
    """The first cause of a difference, then the comparisons that turned with the first other command; a line each.

    A cause is what was noted: another answer of a planner on the same, a comparison that turned, a changed node that
    answers otherwise, or something else that was seen.
    """
    if comparison.first is None:
        return []
    found = sorted(
        [*_seen(comparison, changed), *_planned(comparison), *_turned(comparison), *_answered(comparison, changed)],
        key=lambda cause: cause[:2],
    )
    leading = comparison.leading
    last = [line for tick, _, line in found[1:] if leading is not None and tick == leading.tick]
    lines = [line for *_, line in found[:1]] + last
    if lines:
        return list(dict.fromkeys(lines))[:MOST_CAUSES]
    if not comparison.recorded:
        return ["no record: the log holds no comparisons, as releases before 0.13 wrote none"]
    return ["no record: no noted comparison answers otherwise up to there"]


_Found = Iterator[tuple[int, int, str]]  # tick, rank among those of one tick, words


def _seen(comparison: Comparison, changed: Iterable[Change]) -> _Found:
    """What two runs saw; in a replay both see the same."""
    for aspect, words in SEEN_BY.items():
        if (first := comparison.first_by_aspect.get(aspect)) is not None:
            keys = [str(change) for change in changed if any(word in change.where for word in words)]
            reason = f"; changed: {', '.join(keys)}" if keys else "; no record of what makes it so"
            yield first.tick, 0, f"{_at(first)}: {aspect} is seen otherwise{reason}"


def _planned(comparison: Comparison) -> _Found:
    """A planner that answers otherwise about the same parts in place."""
    for aspect, (planner, key) in PLANNED.items():
        first = comparison.first_by_aspect.get(aspect)
        if first is None or not (isinstance(first.was, list) and isinstance(first.now, list)):
            continue
        for was, now in zip(first.was, first.now, strict=False):
            same = all(was.get(name) == now.get(name) for name in ("placed", "required"))
            if same and key in was and was[key] != now.get(key):
                yield first.tick, 1, f"{_at(first)}: planner {planner} answers {key} {was[key]} -> {now.get(key)}"


def _turned(comparison: Comparison) -> _Found:
    for turn in comparison.turns:
        yield turn.tick, 2 if turn.changed else 4, turn_text(turn)


def _answered(comparison: Comparison, changed: Iterable[Change]) -> _Found:
    """A changed node that answers otherwise, and no node whose comparison turned."""
    nodes: dict[str, list[str]] = {}
    for change in changed:
        if change.node:
            nodes.setdefault(change.node, []).append(str(change))
    turned = {(turn.tick, turn.now.by) for turn in comparison.turns}
    for path, first in comparison.first_by_node.items():
        if path in nodes and (first.tick, path) not in turned:
            was, now = (", ".join(map(str, v)) if isinstance(v, list) else v for v in (first.was, first.now))
            name = NUMBER.sub("", path)
            yield first.tick, 3, f"{_at(first)}: {name}: {was} -> {now}; changed: {', '.join(nodes[path])}"


def turn_text(turn: Turn) -> str:
    """A comparison in both runs, and which parameter makes the difference."""
    was, now = turn.was, turn.now
    named = [f"{name} {was.given[name]:.6g} -> {now.given.get(name, math.nan):.6g}" for name in turn.changed]
    reason = f"changed: {', '.join(named)}" if named else "no parameter of it was changed"
    place = f" ({now.source})" if now.source else ""
    sides = (
        f"{cause}{f', since tick {at}' * (at < turn.tick)}" for cause, at in zip((was, now), turn.noted, strict=True)
    )
    return f"tick {turn.tick}, {turn.time_s:.2f} s: {NUMBER.sub('', now.by)}{place}, {' -> '.join(sides)}; {reason}"


def _at(first: Difference) -> str:
    return f"tick {first.tick}, {first.time_s:.2f} s"


def _other_tree(log: Log, trees: Callable[[], tuple[Tree, Tree]]) -> list[Change]:
    """Attributes, and nodes, that are others than those of a log's tree, in the order of that."""
    try:
        was, tree = trees()
    except (LogError, InputError) as error:
        return [Change("tree", log.metadata.get("tree", "unknown"), str(error))]
    names = partners(was, tree)
    old, new = _attributes(was, {}), _attributes(tree, names)
    several = Counter(NUMBER.sub("", path) for path in old.keys() | new.keys())
    found = []
    for path in dict.fromkeys((*old, *new)):
        (place, a), (beside, b) = old.get(path, ("", {})), new.get(path, ("", {}))
        name = NUMBER.sub("", path).removesuffix(" (new)")
        name += f" ({place or beside})" if several[NUMBER.sub("", path)] > 1 else ""
        keys = [key for key in dict.fromkeys((*a, *b)) if a.get(key) != b.get(key)]
        found += [Change(f"{name}{key}", a.get(key, NOT_THERE), b.get(key, NOT_THERE), path) for key in keys]
    return found


def _attributes(tree: Tree, names: Mapping[str, str]) -> dict[str, tuple[str, dict[str, str]]]:
    """Of every node by its path in the log: its place in a file, its tag, which has no name, and its attributes."""
    found = {}
    for node, origin in zip(tree.nodes, tree.origins, strict=True):
        given = {f".{name}": value for name, value in origin.attributes.items() if name != "name"}
        place = ":".join(map(str, tree.place_of(node)))
        found[names.get(node.full_path, node.full_path)] = place, {"": origin.tag, **given}
    return found


def _keys(content: bytes) -> dict[str, str]:
    return dict(_flat(read_data(Path("a configuration"), content.decode())))


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}".strip("."))
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
    for name, difference in (("first", comparison.first), ("command", act)):
        at = {"tick": None, "time_s": None, "aspect": None} if difference is None else plain(difference)
        row |= {f"{name}_{key}": at[key] for key in ("tick", "time_s", "aspect")}
    node = comparison.command_node if act is not None else (comparison.first.node if comparison.first else "")
    row["node"] = NUMBER.sub("", node) if changes.tree is not None else node
    row["why"] = "; ".join(causes(comparison, changed_keys(replay)))
    return row
