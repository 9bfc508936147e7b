"""An AND/OR graph of assembly states from demonstrations: the planner that the paper argues against, as a planner.

An OR node is a state that some demonstration went through. A hyperarc is an action: it needs the assembly as it is
AND a part, and leads to the next state; of the arcs that leave a node one OR another can be taken. Leaves are the
finished products. Costs are all one: every open slot takes one action. The graph knows what was demonstrated and
nothing else: of a state that is none of its nodes, a misdetection or an order that nobody has shown, it says so.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from cell.errors import ModelError
from cell.files.files import write_whole
from cell.files.model import Model
from learned.inference.onnx_model import ModelCard
from learned.semantic.graph import EMPTY, Floats, Ints, Layout
from learned.semantic.scenarios import Scenarios

KIND = "semantic.and_or"
State = tuple[int, ...]


class Node(Model):
    """An OR node.

    Attributes:
        state: part type at every position, EMPTY where nothing is.
        goals: (z,) demonstrations that went through it, by the goal that they ended in.
        arcs: (m,) how often the next action filled each position.
    """

    state: State
    goals: tuple[int, ...]
    arcs: tuple[int, ...]


class AndOrFile(Model):
    """What a weights file holds: the model card and the nodes."""

    card: ModelCard
    nodes: tuple[Node, ...]


@dataclass(frozen=True)
class AndOrGraph:
    """The graph by state.

    Attributes:
        sha256: hash of the file that it comes from; empty where it comes from none.
    """

    layout: Layout
    card: ModelCard
    nodes: dict[State, Node]
    sha256: str = ""

    @staticmethod
    def of(layout: Layout, train: Scenarios, card: ModelCard) -> AndOrGraph:
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
        return AndOrGraph(layout, card, nodes)

    def save(self, path: Path) -> None:
        """Write card and nodes as JSON; a file that was there before stays whole until the new one is.

        Raises:
            InputError: the file cannot be written.
        """
        content = AndOrFile(card=self.card, nodes=tuple(self.nodes.values()))
        write_whole(path, content.model_dump_json().encode())

    @staticmethod
    def load(path: Path, layout: Layout) -> AndOrGraph:
        """Read a file that `save` wrote.

        Raises:
            ModelError: the file is missing, damaged, of another kind, or was made for another product.
        """
        try:
            content = path.read_bytes()
            read = AndOrFile.model_validate(json.loads(content))
        except OSError as error:
            raise ModelError(f"{path}: cannot read the graph: {error.strerror}") from error
        except (ValueError, ValidationError) as error:
            raise ModelError(f"{path}: no AND/OR graph, or damaged: {str(error).splitlines()[0]}") from error
        if read.card.kind != KIND:
            raise ModelError(f"{path}: holds a {read.card.kind!r} model, but a {KIND!r} model is needed")
        read.card.require_vocabulary(path, layout.vocabulary)
        wide = {(len(node.goals), len(node.arcs), len(node.state)) for node in read.nodes}
        m = len(layout.positions)
        if wide != {(len(layout.goals), m, m)}:
            raise ModelError(f"{path}: nodes do not fit the product")
        nodes = {node.state: node for node in read.nodes}
        return AndOrGraph(layout, read.card, nodes, hashlib.sha256(content).hexdigest())

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
