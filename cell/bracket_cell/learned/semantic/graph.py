"""The assembly graph as arrays: object nodes, position nodes, and an edge where a part has been put (section 3.1).

An edge joins two nodes; in which direction a graph network sends messages along it is a setting. With mean
aggregation and the direction that the paper prints (object to position) the object nodes hear nothing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.semantic import hypotheses
from bracket_cell.learned.semantic.hypotheses import Hypotheses
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.variants import Choice, places, types_of, written

Ints: TypeAlias = hypotheses.Ints
Floats: TypeAlias = hypotheses.Floats
Bools = NDArray[np.bool_]

EMPTY = -1  # stands where a position holds nothing


@dataclass(frozen=True)
class Layout:
    """A product's names and goals by index; n part types, m positions, z goals.

    Attributes:
        types: (z, m) part type at every position of every goal; of alternatives one, EMPTY where nothing goes.
        quantities: (n,) how many of each type the goal needs that needs most.
        choices: (z, m) what the product file says of every position of every goal.
        limits: by goal name, how many parts of a type it takes at most.
    """

    parts: tuple[str, ...]
    positions: tuple[str, ...]
    goals: tuple[str, ...]
    types: Ints
    quantities: Ints
    choices: tuple[tuple[Choice, ...], ...] = ()
    limits: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @staticmethod
    def of(product: Product) -> Layout:
        """The layout of a product."""
        parts = tuple(product.parts)
        placed = [product.goal_placements(goal) for goal in product.goals]
        types = [[parts.index(goal[at]) if at in goal else EMPTY for at in product.positions] for goal in placed]
        most = [product.most[part] for part in parts]
        choices, limits = tuple(product.goals.values()), product.goal_quantities
        return Layout(parts, product.positions, tuple(product.goals), np.array(types), np.array(most), choices, limits)

    @cached_property
    def hypotheses(self) -> Hypotheses:
        """The goals' arrangements."""
        return Hypotheses.of(self.parts, dict(zip(self.goals, self.choices, strict=True)), self.limits)

    def places(self, goal: int, edges: Floats) -> dict[str, tuple[str, ...]]:
        """By part type, the open positions of a goal that take it, beside what is placed (n, m)."""
        named = zip(self.positions, self.choices[goal], strict=True)
        accepted = {at: types for at, choice in named if (types := types_of(choice))}
        placed = {self.positions[at]: self.parts[part] for part, at in np.argwhere(edges)}
        stock = dict(zip(self.parts, self.quantities.tolist(), strict=True))
        return places(accepted, self.limits.get(self.goals[goal], {}), placed, stock)

    @cached_property
    def wanted(self) -> Floats:
        """(z, n, m) one where a type is right for a goal at a position."""
        right = np.zeros((len(self.goals), len(self.parts), len(self.positions)), np.float32)
        np.maximum.at(right, self.hypotheses.goal, self.hypotheses.accepted.astype(np.float32))
        return right

    @cached_property
    def words(self) -> tuple[str, ...]:
        """What the decoder can say: objects, positions, and the end of a plan."""
        return (*self.parts, *self.positions, "<end>")

    @property
    def vocabulary(self) -> dict[str, tuple[str, ...]]:
        """What weights are trained for, in the words of the product file."""
        goals = (f"{goal}: {' '.join(map(written, row))}" for goal, row in zip(self.goals, self.choices, strict=True))
        return {"parts": self.parts, "positions": self.positions, "goals": tuple(goals)}

    @property
    def sha256(self) -> str:
        """Hash of the vocabulary."""
        return hashlib.sha256(str(self.vocabulary).encode()).hexdigest()

    def encode(self, state: AssemblyState) -> Floats:
        """Edges (n, m) of the graph: one where a part of that type is at that position.

        Raises:
            ModelError: the state names a part or a position that the product does not have.
        """
        edges = np.zeros((len(self.parts), len(self.positions)), np.float32)
        for position, part in state.placed.items():
            if part not in self.parts or position not in self.positions:
                raise ModelError(
                    f"no {part!r} at {position!r} in this product; "
                    f"parts: {', '.join(self.parts)}; positions: {', '.join(self.positions)}"
                )
            edges[self.parts.index(part), self.positions.index(position)] = 1.0
        return edges

    def doubted(self, state: AssemblyState) -> Floats:
        """Edges (n, m) in which a position whose part is in doubt has the shares of the types that it may be."""
        edges = self.encode(state)
        for position, posterior in state.doubts.items():
            shares = np.array([max(0.0, posterior.get(part, 0.0)) for part in self.parts], np.float32)
            if position in state.placed and 0 < shares.sum() < np.inf:
                edges[:, self.positions.index(position)] = shares / shares.sum()
        return edges

    def state(self, seen: Ints) -> AssemblyState:
        """The state of one row (m,) of part types, EMPTY where nothing is."""
        filled = zip(self.positions, seen, strict=True)
        return AssemblyState({position: self.parts[part] for position, part in filled if part != EMPTY})


def one_hot(seen: Ints, parts: int) -> Floats:
    """Edges (..., n, m) of rows (..., m) of part types, none where a position is EMPTY."""
    edges: Floats = (seen[..., None, :] == np.arange(parts)[:, None]).astype(np.float32)
    return edges


def action_pairs(layout: Layout) -> list[tuple[int, int]]:
    """The assembly actions that a detector knows: every (part type, position) of some goal, sorted."""
    return [(int(part), int(position)) for part, position in np.argwhere(layout.wanted.any(axis=0))]
