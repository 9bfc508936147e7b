"""Generated people: whole assemblies in the order of somebody's habits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from cell.interfaces.model import Model
from cell.interfaces.product import Product
from learned.semantic.dataset import Demonstration, PlacementRecord, demonstrations_of
from learned.semantic.graph import EMPTY, Floats, Ints, Layout
from learned.semantic.scenarios import Scenarios, scenarios


class HabitSettings(Model):
    """How people differ from chance, and from each other.

    Attributes:
        strength: standard deviation of log-preferences; 0 is any order alike, 1 makes a liked slot e times as likely
            to be next as a usual one.
        goal_share: share of the variance that depends on the goal; the rest is positions and types liked always.
        person_share: share of the variance that is one person's own.
        people_n: how many people demonstrate.
    """

    strength: float = Field(default=1.0, ge=0)
    goal_share: float = Field(default=0.5, ge=0, le=1)
    person_share: float = Field(default=0.2, ge=0, le=1)
    people_n: int = Field(default=4, ge=1)


@dataclass(frozen=True)
class People:
    """People who fill slots one after the other, each open one with odds exp(preference) (Plackett and Luce).

    Attributes:
        preferences: (people, z, m).
    """

    layout: Layout
    preferences: Floats

    @staticmethod
    def drawn(layout: Layout, settings: HabitSettings, rng: np.random.Generator) -> People:
        """Random people."""
        goals, positions = layout.types.shape
        people = settings.people_n

        def habit() -> Floats:
            liked = (rng.standard_normal(positions) + rng.standard_normal(len(layout.parts))[layout.types]) / np.sqrt(2)
            own = rng.standard_normal((goals, positions))
            mixed: Floats = np.sqrt(1.0 - settings.goal_share) * liked + np.sqrt(settings.goal_share) * own
            return mixed

        common = np.sqrt(1.0 - settings.person_share) * habit()
        personal = np.sqrt(settings.person_share) * np.array([habit() for _ in range(people)])
        return People(layout, settings.strength * (common + personal))

    def orders(self, goals: Ints, rng: np.random.Generator) -> Ints:
        """(B, m) positions in the order in which a random person fills them, for goals (B,)."""
        person = rng.integers(len(self.preferences), size=len(goals))
        preferred = self.preferences[person, goals]
        order: Ints = np.argsort(-(preferred + rng.gumbel(size=preferred.shape)), axis=1)
        return order

    def set_probabilities(self) -> Floats:
        """(z, 2^m) probability that these slots (bits) are filled after as many placements, mean over people."""
        odds = np.exp(self.preferences)
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


def whole_demonstrations(people: People, count: int, rng: np.random.Generator) -> list[Demonstration]:
    """Complete assemblies of random goals."""
    layout = people.layout
    goals = rng.integers(len(layout.goals), size=count)
    return [
        Demonstration(
            goal=layout.goals[goal],
            placements=tuple(
                PlacementRecord(part=layout.parts[layout.types[goal, i]], position=layout.positions[i]) for i in order
            ),
        )
        for goal, order in zip(goals, people.orders(goals, rng), strict=True)
    ]


def runs(people: People, count: int, depth: int, rng: np.random.Generator) -> tuple[Scenarios, Ints]:
    """States after 1 .. `depth` placements of `count` assemblies, and the number of placements of each."""
    layout = people.layout
    goals = rng.integers(len(layout.goals), size=count)
    ranks = np.argsort(people.orders(goals, rng), axis=1)
    steps = np.repeat(np.arange(1, depth + 1), count)
    rows = np.tile(np.arange(count), depth)
    seen = np.where(ranks[rows] < steps[:, None], layout.types[goals[rows]], EMPTY)
    following = np.argmax(ranks[rows] == steps[:, None], axis=1)
    return Scenarios(goals[rows], seen, following), steps


def generated_demonstrations(product: Product, count: int, strength: float, seed: int) -> list[Demonstration]:
    """Whole assemblies of random goals by random people with habits of this strength."""
    rng = np.random.default_rng(seed)
    people = People.drawn(Layout.of(product), HabitSettings(strength=strength), rng)
    return whole_demonstrations(people, count, rng)


def scenario_demonstrations(product: Product, seed: int) -> list[Demonstration]:
    """The paper's scenarios: every partial state of every goal, and what followed it."""
    layout = Layout.of(product)
    return demonstrations_of(layout, scenarios(layout, seed))
