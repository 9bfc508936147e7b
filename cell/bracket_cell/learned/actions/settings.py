"""Settings of the training of action detectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bracket_ground.files.model import Model
from bracket_ground.interfaces.perception import Action, ActionKind
from bracket_ground.interfaces.product import Product

KINDS: tuple[ActionKind, ...] = ("screw", "transit", "idle")


@dataclass(frozen=True)
class Classes:
    """Classes by number: part i at position p of m is i * m + p, then the three kinds that name no part.

    The default product has 18 that its goals contain (15 assemblies and three kinds); a person who errs does others.
    """

    parts: tuple[str, ...]
    positions: tuple[str, ...]

    @staticmethod
    def of(product: Product) -> Classes:
        """Those of a product."""
        return Classes(tuple(product.parts), tuple(product.positions))

    @property
    def names(self) -> tuple[str, ...]:
        """By number, as in "o1 at p3"."""
        return (*(f"{part} at {position}" for part in self.parts for position in self.positions), *KINDS)

    @property
    def assemblies(self) -> int:
        """How many of them are assemblies; they come first."""
        return len(self.parts) * len(self.positions)

    def number(self, kind: str, part: str | None, position: str | None) -> int:
        """Number of a class.

        Raises:
            ValueError: the product has no such class.
        """
        if kind != "assembly":
            return self.assemblies + KINDS.index(kind)
        if part not in self.parts or position not in self.positions:
            raise ValueError(f"{part} at {position}")
        return self.parts.index(part) * len(self.positions) + self.positions.index(position)

    def action(self, number: int, confidence: float) -> Action:
        """The action of a class."""
        if number >= self.assemblies:
            return Action(KINDS[number - self.assemblies], confidence)
        part, position = divmod(number, len(self.positions))
        return Action("assembly", confidence, self.parts[part], self.positions[position])

    def reports(self, confusion: NDArray[np.int64]) -> list[tuple[tuple[str, str], tuple[str, str]]]:
        """Assemblies that were named as assemblies, (part, position) as it was and as named, as often as counted.

        Args:
            confusion: (classes, classes) counts: rows as it was, columns as it was named.
        """
        pairs = [(part, position) for part in self.parts for position in self.positions]
        counts = confusion[: self.assemblies, : self.assemblies]
        return [(pairs[was], pairs[named]) for was, named in np.argwhere(counts) for _ in range(counts[was, named])]

    def of_goals(self, product: Product) -> NDArray[np.bool_]:
        """(classes,) which of them some goal contains, or name no part."""
        listed = np.zeros(len(self.names), bool)
        listed[self.assemblies :] = True
        for goal in product.goals:
            for position, part in product.goal_placements(goal).items():
                listed[self.number("assembly", part, position)] = True
        return listed


TRAINABLE = ("slim", "paper", "cnn_lstm", "hand", "lrcn", "track")
WHOLE_FRAMES = ("lrcn",)  # kinds that look at whole frames instead of track and crops


class ActionTraining(Model):
    """How a network learns.

    Attributes:
        epochs: passes through the segments.
        batch: segments in a step.
        learning_rate: its peak, of a one-cycle schedule.
        weight_decay: of all weights.
        share: of VGG16's channels, where the network has it.
        released_weight: of the loss of "the fingers have opened", against that of the class.
    """

    epochs: int = Field(default=24, ge=1)
    batch: int = Field(default=64, ge=2)
    learning_rate: float = Field(default=3e-3, gt=0)
    weight_decay: float = Field(default=1e-3, ge=0)
    share: float = Field(default=1.0, gt=0, le=1)
    released_weight: float = Field(default=0.5, ge=0)
