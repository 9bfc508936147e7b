"""The assembly graph as arrays: object nodes, position nodes, and an edge where a part has been put (section 3.1).

An edge joins two nodes; in which direction a graph network sends messages along it is a setting. With mean
aggregation and the direction that the paper prints (object to position) the object nodes hear nothing.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import ModelError
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.product import Product

Ints = NDArray[np.int64]
Floats = NDArray[np.floating[Any]]
Bools = NDArray[np.bool_]

EMPTY = -1  # stands where a position holds nothing


@dataclass(frozen=True)
class Layout:
    """A product's names and goals by index; n part types, m positions, z goals.

    Attributes:
        types: (z, m) part type at every position of every goal.
        quantities: (n,) how many of each type one product needs.
    """

    parts: tuple[str, ...]
    positions: tuple[str, ...]
    goals: tuple[str, ...]
    types: Ints
    quantities: Ints

    @staticmethod
    def of(product: Product) -> Layout:
        """The layout of a product."""
        parts = tuple(product.parts)
        types = [[parts.index(part) for part in goal] for goal in product.goals.values()]
        quantities = [part.quantity for part in product.parts.values()]
        return Layout(parts, product.positions, tuple(product.goals), np.array(types), np.array(quantities))

    @cached_property
    def wanted(self) -> Floats:
        """(z, n, m) one where a goal wants a type at a position."""
        return one_hot(self.types, len(self.parts))

    @cached_property
    def words(self) -> tuple[str, ...]:
        """What the decoder can say: objects, positions, and the end of a plan."""
        return (*self.parts, *self.positions, "<end>")

    @property
    def vocabulary(self) -> dict[str, tuple[str, ...]]:
        """What weights are trained for, in the words of the product file."""
        goals = (
            f"{goal}: {' '.join(self.parts[i] for i in row)}" for goal, row in zip(self.goals, self.types, strict=True)
        )
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
        for position, told in state.doubts.items():
            shares = np.array([max(0.0, told.get(part, 0.0)) for part in self.parts], np.float32)
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
    positions = range(len(layout.positions))
    return sorted({(int(row[position]), position) for row in layout.types for position in positions})
