"""An AND/OR graph of assembly states from demonstrations: the planner that the paper argues against, as a planner.

An OR node is a state that some demonstration went through. A hyperarc is an action: it needs the assembly as it is
AND a part, and leads to the next state; of the arcs that leave a node one OR another can be taken. Leaves are the
finished products. Costs are all one: every open slot takes one action. The graph knows what was demonstrated and
nothing else: of a state that is none of its nodes, a misdetection or an order that nobody has shown, it says so.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from bracket_cell.learned.semantic.graph import EMPTY, Floats, Ints, Layout
from bracket_cell.learned.semantic.misdetection import Scenarios
from bracket_cell.learned.semantic.model import Answer, assembly_plan, templated_guidance
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from bracket_ground.interfaces.product import Product

State = tuple[int, ...]


@dataclass(frozen=True)
class Node:
    """An OR node.

    Attributes:
        state: part type at every position, EMPTY where nothing is.
        goals: (z,) demonstrations that went through it, by the goal that they ended in.
        arcs: (m,) how often the next action filled each position.
    """

    state: State
    goals: tuple[int, ...]
    arcs: tuple[int, ...]


@dataclass(frozen=True)
class AndOrGraph:
    """The graph by state."""

    layout: Layout
    nodes: dict[State, Node]

    @staticmethod
    def of(layout: Layout, train: Scenarios) -> AndOrGraph:
        """Build the graph; each demonstration also went through the empty bracket and its finished product."""
        goals: dict[State, Counter[int]] = {}
        arcs: dict[State, Counter[int]] = {}
        empty = (EMPTY,) * len(layout.positions)
        for goal, row, following in zip(train.goals.tolist(), train.seen.tolist(), train.following, strict=True):
            finished = tuple(layout.types[goal].tolist())
            for state in {empty, tuple(row), finished}:
                goals.setdefault(state, Counter())[goal] += 1
            if following != EMPTY:
                arcs.setdefault(tuple(row), Counter())[int(following)] += 1
        nodes = {
            state: Node(
                state=state,
                goals=tuple(goals[state][goal] for goal in range(len(layout.goals))),
                arcs=tuple(arcs.get(state, Counter())[i] for i in range(len(layout.positions))),
            )
            for state in sorted(goals)
        }
        return AndOrGraph(layout, nodes)

    def node(self, seen: Ints) -> Node | None:
        """The OR node of a state (m,), None outside the graph."""
        return self.nodes.get(tuple(seen.tolist()))

    def belief(self, node: Node) -> Floats:
        """(z,) share of the demonstrations through a node that ended in each goal."""
        counts = np.array(node.goals, float)
        share: Floats = counts / counts.sum()
        return share

    def following(self, node: Node) -> Floats:
        """(n,) share of the part types on the arcs that leave a node; by what its goals still want, if none does."""
        belief = self.belief(node)
        still = np.array(node.state) == EMPTY
        arcs = np.array(node.arcs, float) if sum(node.arcs) else np.ones(len(node.arcs))
        weights = np.einsum("g,gnm,m->n", belief, self.layout.wanted, arcs * still)
        share: Floats = weights / max(float(weights.sum()), 1.0)
        return share


class AndOrPlanner:
    """Looks the state up in an AND/OR graph; outside the graph it names no goal and proposes nothing."""

    def __init__(self, product: Product, graph: AndOrGraph) -> None:
        self._layout = Layout.of(product)
        self._graph = graph

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        """The plan for a state."""
        layout, edges = self._layout, self._layout.encode(state)
        node = self._graph.node(np.where(edges.any(axis=0), edges.argmax(axis=0), EMPTY))
        if node is None:
            belief = dict.fromkeys(layout.goals, 0.0) | {UNKNOWN_GOAL: 1.0}
            return AssemblyPlan(belief, {}, None, dict.fromkeys(layout.parts, ()))
        goals = self._graph.belief(node)
        placements = np.tensordot(goals, layout.wanted, 1) * (1.0 - edges.any(axis=0))
        guidance = templated_guidance(layout, edges, layout.wanted[int(np.argmax(goals))])
        belief_and_none = np.append(goals, 0.0)
        return assembly_plan(layout, edges, Answer(belief_and_none, placements, self._graph.following(node), guidance))
