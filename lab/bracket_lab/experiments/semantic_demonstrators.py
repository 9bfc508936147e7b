"""Generated demonstrators: whole assemblies in the order of somebody's habits."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from bracket_cell.learned.semantic.graph import Floats, Layout
from bracket_cell.learned.semantic.records import Demonstration, PlacementRecord
from bracket_ground.files.model import Model
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.semantic.data import demonstrations_of
from bracket_lab.learned.semantic.scenarios import Demonstrators, scenarios


class HabitSettings(Model):
    """How demonstrators differ from chance, and from each other.

    Attributes:
        strength: standard deviation of log-preferences; 0 is any order alike, 1 makes a liked slot e times as likely
            to be next as a usual one.
        goal_share: share of the variance that depends on the goal; the rest is positions and types liked always.
        own_share: share of the variance that is one demonstrator's own.
        demonstrators_n: how many demonstrators demonstrate.
    """

    strength: float = Field(default=1.0, ge=0)
    goal_share: float = Field(default=0.5, ge=0, le=1)
    own_share: float = Field(default=0.2, ge=0, le=1)
    demonstrators_n: int = Field(default=4, ge=1)


def drawn_demonstrators(layout: Layout, settings: HabitSettings, rng: np.random.Generator) -> Demonstrators:
    """Random demonstrators."""
    goals, positions = layout.types.shape
    demonstrators = settings.demonstrators_n

    def habit() -> Floats:
        liked = (rng.standard_normal(positions) + rng.standard_normal(len(layout.parts))[layout.types]) / np.sqrt(2)
        own = rng.standard_normal((goals, positions))
        mixed: Floats = np.sqrt(1.0 - settings.goal_share) * liked + np.sqrt(settings.goal_share) * own
        return mixed

    common = np.sqrt(1.0 - settings.own_share) * habit()
    personal = np.sqrt(settings.own_share) * np.array([habit() for _ in range(demonstrators)])
    return Demonstrators(layout, settings.strength * (common + personal))


def set_probabilities(demonstrators: Demonstrators) -> Floats:
    """(z, 2^m) probability that these slots (bits) are filled after as many placements, mean over demonstrators."""
    odds = np.exp(demonstrators.preferences)
    people, goals, m = odds.shape
    probability = np.zeros((people, goals, 2**m))
    probability[:, :, 0] = 1.0
    for filled in range(2**m):
        still = [i for i in range(m) if not filled >> i & 1]
        total = odds[:, :, still].sum(axis=2)
        for i in still:
            probability[:, :, filled | 1 << i] += probability[:, :, filled] * odds[:, :, i] / total
    mean: Floats = probability.mean(axis=0)
    return mean


def whole_demonstrations(demonstrators: Demonstrators, count: int, rng: np.random.Generator) -> list[Demonstration]:
    """Complete assemblies of random goals."""
    layout = demonstrators.layout
    goals = rng.integers(len(layout.goals), size=count)
    return [
        Demonstration(
            goal=layout.goals[goal],
            placements=tuple(
                PlacementRecord(part=layout.parts[layout.types[goal, i]], position=layout.positions[i]) for i in order
            ),
        )
        for goal, order in zip(goals, demonstrators.orders(goals, rng), strict=True)
    ]


def generated_demonstrations(product: Product, count: int, strength: float, seed: int) -> list[Demonstration]:
    """Whole assemblies of random goals by random demonstrators with habits of this strength."""
    rng = np.random.default_rng(seed)
    demonstrators = drawn_demonstrators(Layout.of(product), HabitSettings(strength=strength), rng)
    return whole_demonstrations(demonstrators, count, rng)


def scenario_demonstrations(product: Product, seed: int) -> list[Demonstration]:
    """The paper's scenarios: every partial state of every goal, and what followed it."""
    layout = Layout.of(product)
    return demonstrations_of(layout, scenarios(layout, seed))
