"""Hot reload: an edited tree file takes the place of the running tree, at a safe point (`cell run --watch`).

Safe is a point between two ticks at which no node that moves arm or gripper is RUNNING, the arm stands and nothing is
held. There the old tree is halted, and the new one begins at its root with the old blackboard and with what the old
nodes remembered, so that the work goes on: `StartGraph` keeps the graph that it finds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from bracket_cell.running.controller import TickServices
from bracket_cell.running.device_reader import describe
from bracket_cell.trees.nodes.moving import ActivateGripper
from bracket_cell.trees.nodes.skill_node import SkillNode
from bracket_cell.watching.observer import Level, Observer
from bracket_ground.errors import InputError, Problem
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.observation import Observation
from btxml.engine.blackboard import UNSET
from btxml.engine.literals import fits
from btxml.engine.node import StatusChange
from btxml.engine.status import Status
from btxml.engine.tree import OnBlackboard, Tree
from btxml.engine.why import Reason

MOVING_NODES = (SkillNode, ActivateGripper)

Stamp = tuple[int, int] | None


class CannotBeSetUp(InputError):
    """A node of a tree refused to be set up."""


class WatchedTree:
    """A tree that is exchanged when its files change; ticked by the controller like any other.

    Args:
        load: loads the tree anew; raises InputError where the edit is broken.
        path: the file that was given on the command line.
        observers: are notified of refused edits and of swaps.
        swapped: called with every new tree, and the time, before its first tick.
    """

    def __init__(
        self,
        tree: Tree,
        load: Callable[[], Tree],
        path: Path,
        observers: Sequence[Observer],
        swapped: Callable[[Tree, float], None],
    ) -> None:
        self.tree = tree
        self._load = load
        self._observeres = observers
        self._swapped = swapped
        self._path = path
        self._files = self._stamps(tree.texts)
        self._next: Tree | None = None

    def setup(self, services: TickServices, clock: Clock) -> None:
        """Set up the tree, and every one that takes its place."""
        self._services = services
        self._clock = clock
        self.tree.setup(services, clock)

    def tick(self) -> Status:
        """Look for an edit, exchange the tree where that is safe, and tick."""
        self._look()
        if self._next is not None and is_safe_point(self.tree, self._services.now.observation):
            self._swap(self._next)
        return self.tree.tick()

    def halt(self) -> None:
        self.tree.halt()

    def why(self) -> Reason | None:
        """Why the root of the tree that runs now ended, or goes on."""
        return self.tree.why()

    @property
    def status_changes(self) -> Sequence[StatusChange]:
        return self.tree.status_changes

    def _look(self) -> None:
        stamps = self._stamps(self._files)
        if stamps == self._files:
            return
        self._files = stamps
        try:
            self._next = self._load()
        except InputError as error:
            self._next = None
            why = "; ".join(str(error).splitlines())  # a terminal shows one line
            self._say("warning", f"the edited tree is refused, the old one goes on: {why}")
            named = [problem.place.file for problem in error.problems if isinstance(problem, Problem)]
            self._files = self._stamps([*self._files, *named], stamps)
        else:
            self._files = self._stamps(self._next.texts, stamps)
            self._say("info", "the edited tree is sound and waits for a safe point")

    def _swap(self, tree: Tree) -> None:
        self._next = None
        try:
            lost = take_over(self.tree, tree, self._services, self._clock)
        except CannotBeSetUp as error:
            self._say("warning", f"the old tree goes on: {error}")
            return
        self.tree = tree
        self._swapped(tree, self._clock.now_s())
        dropped = f"; not carried over: {', '.join(lost)}" if lost else ""
        self._say("info", f"the edited tree took over{dropped}")

    def _stamps(self, files: Iterable[Path], known: Mapping[Path, Stamp] = MappingProxyType({})) -> dict[Path, Stamp]:
        """Of files, those that are known from before they were read: who saves meanwhile has edited again."""
        return {file: known[file] if file in known else _stamp(file) for file in (self._path, *files)}

    def _say(self, level: Level, text: str) -> None:
        for observer in self._observeres:
            observer.message(self._clock.now_s(), level, text)


def is_safe_point(tree: Tree, observation: Observation) -> bool:
    """Whether nothing moves, nothing is about to, and nothing is held."""
    busy = any(isinstance(node, MOVING_NODES) and node.status is Status.RUNNING for node in tree.nodes)
    return not (busy or observation.arm.moving or observation.gripper.holding)


def set_up(tree: Tree | WatchedTree, services: TickServices, clock: Clock) -> None:
    """Make a tree ready for its first tick.

    Raises:
        CannotBeSetUp: a node of it.
    """
    try:
        tree.setup(services, clock)
    except Exception as error:  # `prepare` of a user's own node may raise anything
        raise CannotBeSetUp(f"the tree cannot be set up: {describe(error)}") from error


def take_over(old: Tree, new: Tree, services: TickServices, clock: Clock) -> list[str]:
    """Make the new tree ready, then halt the old one; names of entries that were not carried over.

    Raises:
        CannotBeSetUp: a node of the new tree; the old tree has not been touched.
    """
    try:
        set_up(new, services, clock)
    except CannotBeSetUp:
        if isinstance(services, OnBlackboard):
            services.stand_on(old.blackboard)
        raise
    old.halt()
    hand_on_memories(old, new)
    return carry_over(old, new)


def carry_over(old: Tree, new: Tree) -> list[str]:
    """Copy what the old main tree's blackboard holds to entries of the new one; names of what has no place there."""
    lost = []
    for key in old.blackboard:
        value = old.blackboard.entry(key).value
        if value is UNSET:
            continue
        if key in new.blackboard and fits(value, new.blackboard.entry(key).kind):
            new.blackboard.entry(key).write(value)
            new.blackboard.entry(key).carried = True
        else:
            lost.append(key)
    return lost


def hand_on_memories(old: Tree, new: Tree) -> None:
    """Give the nodes of every class what those of the same class remembered, in order, where there are as many."""
    for kind in {type(node) for node in new.nodes if node.persistent}:
        before, after = ([node for node in tree.nodes if type(node) is kind] for tree in (old, new))
        if len(before) == len(after):
            for tree_node, other in zip(before, after, strict=True):
                vars(other).update({name: getattr(tree_node, name) for name in kind.persistent})


def _stamp(file: Path) -> Stamp:
    """What changes with every edit; None where the file is gone."""
    try:
        found = file.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
