"""The open list of goals: the product's own and those learned from finished brackets, in a file that a person can edit.

How probable a goal is before anything is placed follows the two-parameter Chinese restaurant process (Pitman and Yor):
a goal that ended n of N brackets has the weight n - d, and "none of these" the weight a + d K, K being how many goals
were learned. So a goal is believed in the more often it was finished, and something new the more often it came.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from pydantic import Field, ValidationError

from bracket_cell.learned.semantic.graph import Floats
from bracket_cell.learned.semantic.settings import NewGoals
from bracket_ground.errors import InputError
from bracket_ground.files.files import write_whole
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.variants import EMPTY, Choice, completed, written

SHOWN_BRACKETS = 3  # a goal that somebody showed counts as much as this many finished brackets
_HEAD = """# Goals as they were finished: the part type at every position, and how many brackets ended so.
# Goals that the product file does not list were learned; rename, correct or remove them as you like.
"""


class FinishedGoal(Model):
    """A goal, and how many brackets ended so."""

    parts: tuple[str, ...]
    finished: int = Field(ge=0)


class GoalFile(Model):
    """What was finished of one product."""

    format: Literal["cell.goals"] = "cell.goals"
    version: Literal[1] = 1
    product: str
    positions: tuple[str, ...]
    goals: dict[str, FinishedGoal] = Field(default_factory=dict)


@dataclass(frozen=True)
class OpenGoals:
    """Goals that are known, and what is expected of others.

    Attributes:
        listed: the product as its file has it.
        finished: by goal name, the part type at every position and how many brackets ended so.
    """

    listed: Product
    finished: dict[str, FinishedGoal]
    settings: NewGoals = field(default_factory=NewGoals)

    @staticmethod
    def of(product: Product, settings: NewGoals | None = None) -> OpenGoals:
        """The product's own goals, none of them finished yet."""
        return OpenGoals(product, {}, settings or NewGoals())

    @staticmethod
    def load(path: Path, product: Product, settings: NewGoals | None = None) -> OpenGoals:
        """Goals of a file; a file that is not there yet holds none.

        Raises:
            InputError: the file is damaged, of another product, or names goals that its parts cannot make.
        """
        if not path.exists():
            return OpenGoals.of(product, settings)
        read = load_yaml(path, GoalFile)
        if (read.product, read.positions) != (product.name, product.positions):
            raise InputError(
                f"{path}: goals of {read.product!r} with positions {', '.join(read.positions)}, but the product is "
                f"{product.name!r} with positions {', '.join(product.positions)}"
            )
        found = OpenGoals(product, read.goals, settings or NewGoals())
        found.check(path)
        return found

    def check(self, path: Path) -> None:
        """Check that the product can end in all of these goals.

        Args:
            path: of the file, for messages.

        Raises:
            InputError: it cannot.
        """
        for name, goal in self.finished.items():
            if name in self.listed.goals and name not in self.listed.goals_listed_as(goal.parts):
                listed = " ".join(map(written, self.listed.goals[name]))
                raise InputError(f"{path}: goal {name} is {listed} in the product file")
        try:
            _ = self.product
        except ValidationError as error:
            raise InputError(f"{path}: {error.errors()[0]['msg'].removeprefix('Value error, ')}") from error
        for name, goal in self.learned.items():
            if why := self._unlike(goal.parts):
                raise InputError(f"{path}: goal {name} {why}")

    def save(self, path: Path) -> None:
        """Write the file; one that was there before stays whole until the new one is.

        Raises:
            InputError: the file cannot be written.
        """
        content = GoalFile(product=self.listed.name, positions=self.listed.positions, goals=self.finished)
        text = _HEAD + yaml.safe_dump(content.model_dump(mode="json"), sort_keys=False, default_flow_style=None)
        write_whole(path, text.encode())

    @property
    def learned(self) -> dict[str, FinishedGoal]:
        """Goals that the product file does not list, and that some bracket ended in."""
        return {name: goal for name, goal in self.finished.items() if name not in self.listed.goals and goal.finished}

    @property
    def product(self) -> Product:
        """The product with the learned goals after its own.

        Raises:
            ValidationError: a learned goal does not fit the product.
        """
        goals = self.listed.goals | {name: goal.parts for name, goal in self.learned.items()}
        titles = {name: title for name, title in self.listed.goal_titles.items() if name in goals}
        return Product.model_validate({**self.listed.model_dump(), "goals": goals, "goal_titles": titles})

    def prior(self, share: Floats | None = None) -> Floats:
        """(z + 1,) probability of the goals in the order of `product`, and of none of them.

        Args:
            share: (z listed,) how the listed goals share what is expected of them; all alike by default.
        """
        settings, listed = self.settings, self.listed.goals
        share = np.full(len(listed), 1.0 / len(listed)) if share is None else share
        own = [
            settings.listed_brackets * part + (self.finished[name].finished if name in self.finished else 0)
            for name, part in zip(listed, share, strict=True)
        ]
        learned = [goal.finished - settings.discount for goal in self.learned.values()]
        concentration = settings.listed_brackets * settings.none_probability / (1.0 - settings.none_probability)
        weights = np.array([*own, *learned, concentration + settings.discount * len(learned)])
        prior: Floats = weights / weights.sum()
        return prior

    def with_bracket(self, parts: tuple[str, ...]) -> OpenGoals:
        """The goals after one more finished bracket, of known or of new arrangement.

        Raises:
            InputError: no bracket of this product ends so.
        """
        known = self._known
        free = next(f"new{i}" for i in range(1, len(known) + 2) if f"new{i}" not in known)
        return self._after(free, parts, 1, "a finished bracket")

    def with_goal(self, name: str, parts: tuple[str, ...]) -> OpenGoals:
        """The goals with one that somebody showed; a known one keeps its name.

        Raises:
            InputError: no bracket of this product ends so, or another goal has this name.
        """
        if name in self._known and self.name_of(parts) != name:
            listed = " ".join(map(written, self._known[name]))
            raise InputError(f"goal {name} is {listed} already; give this one another name")
        return self._after(name, parts, SHOWN_BRACKETS, "the goal that was shown")

    def name_of(self, parts: tuple[str, ...]) -> str | None:
        """The known goal that an arrangement makes; None for a new one."""
        learned = (name for name, goal in self.finished.items() if goal.parts == parts)
        return next(iter((*self.product.goals_listed_as(parts), *learned)), None)

    def _unlike(self, parts: tuple[str, ...]) -> str:
        """Why an arrangement is none of this product's, though every part is; empty where it may be."""
        there = Counter(part for part in parts if part != EMPTY)
        quantities = {part: there[part] for part in self.listed.parts}
        for goal in self.listed.goals:
            accepted = self.listed.accepted(goal)
            if len(accepted) == there.total() and completed(accepted, quantities, {}) is not None:
                return ""
        listed = ", ".join(f"{count} x {part}" for part, count in sorted(there.items()))
        return "" if self.listed.varies else f"needs {listed}, and no listed goal does"

    @property
    def _known(self) -> dict[str, tuple[Choice, ...]]:
        return {**self.product.goals, **{name: goal.parts for name, goal in self.finished.items()}}

    def _after(self, name: str, parts: tuple[str, ...], brackets: int, what: str) -> OpenGoals:
        """With a number of further brackets of an arrangement; one that is not known takes the name."""
        name = self.name_of(parts) or name
        before = self.finished[name].finished if name in self.finished else 0
        finished = self.finished | {name: FinishedGoal(parts=parts, finished=before + brackets)}
        after = OpenGoals(self.listed, finished, self.settings)
        after.check(Path(what))
        return after
