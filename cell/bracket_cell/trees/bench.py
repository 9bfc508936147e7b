"""The test kit of trees with the nodes of this cell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bracket_cell.trees.loading import input_errors
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.rules import Situation, load_rules, rules_beside, watch_of
from bracket_ground.errors import Problem
from bracket_ground.files.yaml_file import place_of
from btxml import testing
from btxml.engine.node import TreeNode
from btxml.files.check import Circumstances
from btxml.files.compile.registry import BUILT_IN, Registry, is_leaf
from btxml.files.parse.library import read_library
from btxml.rules import Violation, nodes_of

TICKS, PERIOD_S = 40, 1.0  # of each trial that looks for answers that break rules


class TreeBench(testing.TreeBench):
    """A tree whose leaves are scripted, as the engine's, with the nodes of the cell by default.

    Args:
        rules: files of rules; by default the one beside the tree file. What they say of devices is unknown here.

    Attributes:
        violations: of rules so far; a test asserts that there are none.
        ticks: so far.

    Raises:
        InputError: `cell check` refuses the tree.
    """

    def __init__(
        self,
        path: str | Path | TreeNode,
        answers: Mapping[str, str] | None = None,
        writes: Mapping[str, Mapping[str, Any]] | None = None,
        provided: Mapping[str, Any] | None = None,
        main: str | None = None,
        services: object = None,
        registry: Registry | None = None,
        beside: Iterable[Path] = (),
        real: Iterable[type[TreeNode]] = (),
        rules: Iterable[Path | str] | None = None,
        mocks: str | Path | None = None,
        part: bool = False,
    ) -> None:
        known = registry or node_registry()
        with input_errors():
            super().__init__(path, answers, writes, provided, main, services, known, beside, real, mocks, part)
        found = rules_beside(Path(path)) if rules is None and not isinstance(path, TreeNode) else None
        self._watch = watch_of([found] if found else map(Path, rules or ()))
        self._nodes, self.ticks = nodes_of(self.tree), 0
        self.violations: list[Violation] = []

    @property
    def unknown(self) -> tuple[str, ...]:
        """Rules that were unknown in some tick: this bench can say nothing of devices."""
        return tuple(name for name, (_, _, unknown) in self._watch.ticks.items() if unknown)

    def tick(self, after_s: float = 0.0) -> str:
        """Move the clock, then tick; the root's status as a letter. What breaks a rule joins `violations`."""
        letter = super().tick(after_s)
        self._nodes.follow(self.tree.status_changes)
        situation = Situation(self.clock.now_s(), entries=self.tree.blackboard.values(), nodes=self._nodes)
        self.violations += self._watch.step(self.ticks, situation)
        self.ticks += 1
        return letter


def breakable(tree: Path, rules: Path, registry: Registry, known: Circumstances) -> list[Problem]:
    """Rules that some answers of leaves break.

    Each BehaviorTree is ticked alone, where all its leaves succeed, and where one of them always fails. What a rule
    says of devices and of other trees is unknown then; that a leaf fails, or takes its time, is always possible.
    """
    leaves = {tag: node for tag, node in registry.classes.items() if is_leaf(node) and node not in BUILT_IN}
    usual = {tag: "S" if node.node_type == "Condition" else "RRRS" * TICKS for tag, node in leaves.items()}
    found: dict[str, str] = {}
    for name in read_library(tree, known.beside).trees:
        answers = dict(usual)
        bench = TreeBench(tree, answers, main=name, registry=registry, beside=known.beside, rules=[rules], part=True)
        for failing in ("", *sorted(leaves.keys() & {origin.tag for origin in bench.tree.origins})):
            answers.update(usual | ({failing: "F"} if failing else {}))
            begun, ticks = len(bench.violations), bench.ticks
            for _ in range(TICKS):
                bench.tick(PERIOD_S)
            bench.tree.halt()
            where = f"{failing} always fails" if failing else "all leaves succeed"
            for violation in bench.violations[begun:]:
                found.setdefault(
                    violation.rule, f"in {name} where {where}, in tick {violation.tick - ticks}: {violation.reason}"
                )
    places = {rule.name: place_of(rules, ("rules", n, rule.key)) for n, rule in enumerate(load_rules(rules).rules)}
    return [Problem(places[name], f"rule '{name}' can be broken {said}") for name, said in found.items()]
