"""Pre- and post-conditions on any node: the attributes `_skipIf`, `_while`, `_onSuccess` and their like."""

from __future__ import annotations

from collections.abc import Mapping

from py_trees.common import Status

from trees.engine.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, TreeNode
from trees.engine.script import Script


class ScriptConditions:
    """The scripts of one node, by attribute name; evaluated in BehaviorTree.CPP's order."""

    def __init__(self, scripts: Mapping[str, Script]) -> None:
        before = (("_failureIf", FAILURE), ("_successIf", SUCCESS), ("_skipIf", SKIPPED))
        self._before = [(scripts[name], status) for name, status in before if name in scripts]
        self._while = scripts.get("_while")
        self._success = [scripts[name] for name in ("_onSuccess", "_post") if name in scripts]
        self._failure = [scripts[name] for name in ("_onFailure", "_post") if name in scripts]
        self._halted = scripts.get("_onHalted")

    def before(self, node: TreeNode) -> Status | None:
        """All are evaluated while the node is idle, `_while` also while it is RUNNING."""
        idle = node.status is IDLE or node.status is SKIPPED
        if idle:
            for script, status in self._before:
                if script.true():
                    return status
        if self._while is not None and (idle or node.status is RUNNING) and not self._while.true():
            if node.status is RUNNING:
                node.halt()
            return SKIPPED
        return None

    def after(self, status: Status) -> None:
        for script in self._success if status is SUCCESS else self._failure:
            script.run()

    def halted(self) -> None:
        if self._halted is not None:
            self._halted.run()
