"""The open list of goals: the product's own and those learned from finished brackets, in a file that a person can edit.

How probable a goal is before anything is placed follows the two-parameter Chinese restaurant process (Pitman and Yor):
a goal that ended n of N brackets has the weight n - d, and "none of these" the weight a + d K, K being how many goals
were learned. So a goal is believed in the more often it was finished, and something new the more often it came.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from pydantic import Field

from cell.interfaces.errors import InputError
from cell.interfaces.model import Model
from cell.interfaces.product import Product
from cell.interfaces.yaml_file import load_yaml
from learned.semantic.graph import Floats

_HEAD = """# Goals as they were finished: the part type at every position, and how many brackets ended so.
# Goals that the product file does not list were learned; rename, correct or remove them as you like.
"""


class NewGoals(Model):
    """What is expected of goals that nobody listed.

    Attributes:
        none_probability: that a bracket is none of the product's goals, before any was finished.
        listed_brackets: finished brackets that the product's own list counts for, all its goals together.
        discount: how much each learned goal adds to the expectation of further ones; 0 to 1.
    """

    none_probability: float = Field(default=0.02, gt=0, lt=1)
    listed_brackets: float = Field(default=10.0, gt=0)
    discount: float = Field(default=0.5, ge=0, lt=1)


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
    settings: NewGoals = NewGoals()

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
        for name, goal in read.goals.items():
            if name in product.goals and product.goals[name] != goal.parts:
                raise InputError(f"{path}: goal {name} is {' '.join(product.goals[name])} in the product file")
        try:
            _ = found.product
        except ValueError as error:
            raise InputError(f"{path}: {error}") from error
        return found

    def save(self, path: Path) -> None:
        """Write the file; one that was there before stays whole until the new one is.

        Raises:
            InputError: the file cannot be written.
        """
        content = GoalFile(product=self.listed.name, positions=self.listed.positions, goals=self.finished)
        text = _HEAD + yaml.safe_dump(content.model_dump(mode="json"), sort_keys=False, default_flow_style=None)
        partial = path.with_name(path.name + ".partial")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            partial.write_text(text, encoding="utf-8")
            partial.replace(path)
        except OSError as error:
            raise InputError(f"{path}: cannot write the goals: {error.strerror}") from error

    @property
    def learned(self) -> dict[str, FinishedGoal]:
        """Goals that the product file does not list, and that some bracket ended in."""
        return {name: goal for name, goal in self.finished.items() if name not in self.listed.goals and goal.finished}

    @property
    def product(self) -> Product:
        """The product with the learned goals after its own.

        Raises:
            ValueError: a learned goal does not fit the product.
        """
        goals = self.listed.goals | {name: goal.parts for name, goal in self.learned.items()}
        return Product.model_validate({**self.listed.model_dump(), "goals": goals})

    @property
    def prior(self) -> Floats:
        """(z + 1,) probability of the goals in the order of `product`, and of none of them."""
        settings, listed = self.settings, self.listed.goals
        share = settings.listed_brackets / len(listed)
        own = [share + (self.finished[name].finished if name in self.finished else 0) for name in listed]
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
        known = self.product.goals | {name: goal.parts for name, goal in self.finished.items()}
        name = next((name for name, goal in known.items() if goal == parts), None)
        if name is None:
            name = next(f"new{i}" for i in range(1, len(known) + 2) if f"new{i}" not in known)
        before = self.finished[name].finished if name in self.finished else 0
        finished = self.finished | {name: FinishedGoal(parts=parts, finished=before + 1)}
        after = OpenGoals(self.listed, finished, self.settings)
        try:
            _ = after.product
        except ValueError as error:
            raise InputError(f"a bracket with {' '.join(parts)} is none of {self.listed.name}: {error}") from error
        return after
