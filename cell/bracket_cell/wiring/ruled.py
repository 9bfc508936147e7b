"""Rules of a run: each tick asks them after its tree, and what breaks one is judged with the commands of that tick."""

from __future__ import annotations

from collections.abc import Sequence

from bracket_cell.running.controller import TickServices
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.trees.nodes.services import Tick
from bracket_cell.trees.rules import Rule, RuleWatch, Situation
from bracket_cell.wiring.reload import WatchedTree, set_up
from bracket_cell.wiring.services import TickClock
from btxml.engine.node import StatusChange
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.engine.why import Reason
from btxml.rules import nodes_of


class RuleLook:
    """Asks the rules once a tick, in a run and in its replay alike."""

    def __init__(self, rules: Sequence[Rule], kinematics: Kinematics) -> None:
        self._watch, self._kinematics = RuleWatch(rules), kinematics
        self._tree: Tree | None = None

    def look(self, tree: Tree, now: Tick) -> None:
        """Note in the command of a tick which rules are broken in it."""
        if not self._watch.rules:
            return
        if tree is not self._tree:
            self._tree, self._nodes = tree, nodes_of(tree)
        self._nodes.follow(tree.status_changes)
        seen, entries = now.observation, tree.blackboard.values() if self._watch.names_entries else {}
        situation = Situation(seen.time_s, seen, now.command, entries, self._nodes, self._kinematics)
        self._watch.step(seen.tick, situation)
        now.command.broken = tuple(self._watch.acting(situation))


class RuledTree:
    """A tree with rules; ticked by the controller like any other."""

    def __init__(self, ticked: Tree | WatchedTree, rules: Sequence[Rule], kinematics: Kinematics) -> None:
        self._ticked, self._look = ticked, RuleLook(rules, kinematics)

    def setup(self, services: TickServices, clock: TickClock) -> None:
        """Set up the tree."""
        self._services = services
        set_up(self._ticked, services, clock)

    def tick(self) -> Status:
        """Tick the tree, then ask the rules."""
        status = self._ticked.tick()
        tree = self._ticked.tree if isinstance(self._ticked, WatchedTree) else self._ticked
        self._look.look(tree, self._services.now)
        return status

    def halt(self) -> None:
        self._ticked.halt()

    def why(self) -> Reason | None:
        """Why the root of the tree ended, or goes on."""
        return self._ticked.why()

    @property
    def status_changes(self) -> Sequence[StatusChange]:
        return self._ticked.status_changes
