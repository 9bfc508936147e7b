"""The state of a run between two ticks as plain data, so that a replay may begin there: what is kept is never code.

Nodes, blackboard, memory and supervisor are walked field by field. What a fresh run has by itself, such as planners,
kinematics and files, is named and not written. On the way back records of a closed list are made, each field of its own
type, and a node gets such attributes alone as its own code sets.
"""

from __future__ import annotations

import dataclasses
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

from bracket_cell.running.supervisor import Supervisor
from bracket_cell.skills.motion.collision import Box
from bracket_cell.skills.motion.lying_grasp import LyingHold
from bracket_cell.trees.nodes.services import Services
from bracket_cell.wiring.records import records, stored_by
from bracket_cell.wiring.state_reader import StateError, StateReader
from bracket_cell.wiring.state_writer import StateWriter, is_own
from bracket_ground.errors import mistakes
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.grip import Hold
from bracket_ground.interfaces.perception import PartsView
from bracket_ground.interfaces.planning import GraspPlan
from btxml.engine.blackboard import UNSET, Entry
from btxml.engine.node import TreeNode
from btxml.engine.ports import Connection
from btxml.engine.script import Evaluated, Script
from btxml.engine.status import Status
from btxml.engine.tree import Tree

OF_ENGINE = frozenset(
    ("runtime", "note_change", "children", "decorated", "services", "name", "uid", "full_path", "conditions", "_made")
)
OF_NODE = {"status": Status, "feedback_message": str, "what_if": str, "_error": str}  # of every one
OF_MOTION = {"hold": Hold | None, "lying": LyingHold | None, "around": Box | None}
PLAIN = bool | int | float | str
OF_ENTRY = {"value": Any, "revision": int, "carried": bool, "declared": bool, "text": str | None}
FORM = 3  # of the state; older ones have other names
NUMBER = re.compile(r"::\d+")


def state_of(tree: Tree, services: Services, supervisor: Supervisor) -> dict[str, Any]:
    """What a replay needs to go on after this tick; `lost` says why it cannot, where a monitor's hook is in the way."""
    if hooked := next((node.full_path for node in tree.nodes if "execute" in vars(node)), None):
        return {"lost": f"{hooked}: a monitor has put a hook on it"}
    try:
        return _written(tree, services, supervisor)
    except RecursionError:
        return {"lost": "a node keeps what is too deep for a log"}


def go_on_from(state: Mapping[str, Any], tree: Tree, services: Services, supervisor: Supervisor) -> list[str]:
    """Put a tree, its services and a supervisor, all set up and fresh, where a run was.

    Where the tree is another one, nodes of the same class and place go on, and entries of the same name.

    Args:
        services: the tick that they hold is the one after which the state was written.

    Returns:
        Paths of nodes and names of entries that begin anew.

    Raises:
        StateError: the state is none of this program.
    """
    if state.get("form") != FORM:
        raise StateError("its state is of another release; that one can replay it, and this one from tick 0 on")
    try:
        for parts in state["learned"][len(services.learned) :]:
            services.learn(tuple(map(str, parts)))
        read = StateReader(_named(tree, services), records(tree.nodes))
        fresh = [*_nodes(state["nodes"], tree, read), *_entries(state["entries"], tree, read)]
        tree._runtime.ticks, tree._runtime.agreed = map(int, state["runtime"])
        read.fill(state["memory"], services.memory)
        motion = services.tools.motion
        for name, value in read.fields(state["motion"], vars(motion), OF_MOTION, "motion").items():
            setattr(motion, name, value)
        services.now.display = read.value(state["display"], Display, "display")
        view, solved = state["solved"]
        services._solved_view = read.value(view, PartsView | None, "solved")
        services._solved = read.value(solved, dict[int, GraspPlan], "solved")
        for written, record in zip(state["supervisor"], supervisor.keeps, strict=True):
            read.fill(written, record)
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, StopIteration, RecursionError) as error:
        raise StateError(f"the state of the run does not fit this program: {mistakes(error)[0]}") from None
    return fresh


def _written(tree: Tree, services: Services, supervisor: Supervisor) -> dict[str, Any]:
    write, motion = StateWriter(_named(tree, services), records(tree.nodes)), services.tools.motion
    return {
        "form": FORM,
        "nodes": [[node.full_path, type(node).__name__, write.fields(_kept_by(node))] for node in tree.nodes],
        "entries": [
            [scope, key, write.fields({name: getattr(entry, name) for name in OF_ENTRY})]
            for (scope, key), entry in _entries_of(tree).items()
            if entry.revision
        ],
        "runtime": [tree._runtime.ticks, tree._runtime.agreed],
        "learned": [list(parts) for parts in services.learned],
        "memory": write.record(services.memory),
        "display": write(services.now.display),
        "motion": write.fields({name: getattr(motion, name) for name in OF_MOTION}),
        "solved": [write(services._solved_view), write(services._solved)],
        "supervisor": [write.record(keep) for keep in supervisor.keeps],
    }


def _nodes(written: list[Any], tree: Tree, read: StateReader) -> list[str]:
    """Fill the nodes; paths of those that nothing was written for."""
    if [(path, kind) for path, kind, _ in written] == [(node.full_path, type(node).__name__) for node in tree.nodes]:
        pairs = list(zip(tree.nodes, written, strict=True))
    else:
        places: dict[tuple[str, str], tuple[list[TreeNode], list[Any]]] = defaultdict(lambda: ([], []))
        for node in tree.nodes:
            places[NUMBER.sub("", node.full_path), type(node).__name__][0].append(node)
        for entry in written:
            places[NUMBER.sub("", entry[0]), entry[1]][1].append(entry)
        alike = [two for two in places.values() if len(two[0]) == len(two[1])]
        pairs = [pair for nodes, ones in alike for pair in zip(nodes, ones, strict=True)]
    found = {id(entry): node for node, entry in pairs}
    numbers = {id(entry): number for number, entry in enumerate(written, 1)}
    read.named |= {f"node {numbers[key]}": node for key, node in found.items()}
    for entry in written:
        filled = found.get(id(entry))
        if filled is None:
            read.skip(entry[2])
        else:
            vars(filled).update(read.fields(entry[2], vars(filled), _attributes_of(filled), entry[0]))
    known = {node.uid for node, _ in pairs}
    return [node.full_path for node in tree.nodes if node.uid not in known]


def _entries(written: list[Any], tree: Tree, read: StateReader) -> list[str]:
    entries, lost = _entries_of(tree), []
    for scope, key, fields in written:
        entry = entries.get((scope, key))
        if entry is None:
            read.skip(fields)
            lost.append(str(key))
            continue
        was = {name: getattr(entry, name) for name in OF_ENTRY}
        for name, value in read.fields(fields, was, OF_ENTRY, key).items():
            setattr(entry, name, value)
    return lost


def _entries_of(tree: Tree) -> dict[tuple[str, str], Entry]:
    """All entries, each once, by the outermost scope that has it and its name there."""
    found: dict[int, tuple[str, str, Entry]] = {}
    for scope in tree.scopes:
        for key in scope:
            found.setdefault(id(scope.entry(key)), (scope.name, key, scope.entry(key)))
    return {(scope, key): entry for scope, key, entry in found.values()}


def _kept_by(node: TreeNode) -> dict[str, Any]:
    """What a node keeps between two ticks, with its status and its words."""
    kept = _attributes_of(node)
    return {name: value for name, value in vars(node).items() if name in kept}


def _attributes_of(node: TreeNode) -> dict[str, Any]:
    """The types of what a node may keep: what it was made with, and what its own code sets.

    Nodes do not say of what types these are. What is plain where the node was just made stays plain.
    """
    bound = {name for name, value in vars(node).items() if isinstance(value, Connection | Script | Evaluated)}
    kind: type = type(node)
    names = (vars(node).keys() | stored_by(kind)) - OF_ENGINE - bound
    return {name: PLAIN | None if isinstance(vars(node).get(name), PLAIN) else Any for name in names} | OF_NODE


def _named(tree: Tree, services: Services) -> dict[str, Any]:
    """What both have, the run and its replay, by name; it is not written."""
    seen, tools = services.now.observation, services.tools
    named: dict[str, Any] = {"unset": UNSET, "services": services, "now": services.now, "memory": services.memory}
    named |= {"seen": seen, "runtime": tree._runtime, "clock": tree._runtime.clock}
    named |= {f"seen.{name}": value for name, value in vars(seen).items() if is_own(value)}
    named |= {f"tools.{field.name}": getattr(tools, field.name) for field in dataclasses.fields(tools)}
    named |= {"tools": tools, **dict(_below("motion", tools.motion, 3))}
    named |= {f"entry {scope} {key}": entry for (scope, key), entry in _entries_of(tree).items()}
    return named | {f"node {node.uid}": node for node in tree.nodes}


def _below(name: str, thing: Any, depth: int) -> Iterator[tuple[str, Any]]:
    for key, value in vars(thing).items() if depth else ():
        if is_own(value) and key not in OF_MOTION:
            yield f"{name}.{key}", value
            if hasattr(value, "__dict__"):
                yield from _below(f"{name}.{key}", value, depth - 1)
