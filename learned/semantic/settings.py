"""Settings of the semantic planner that a cell's configuration holds; free of everything heavy."""

from __future__ import annotations

from pydantic import Field

from cell.files.model import Model


class NewGoals(Model):
    """Expectation of goals that the product file does not list.

    Attributes:
        none_probability: that a bracket is none of the product's goals, before any was finished.
        listed_brackets: finished brackets that the product's own list counts for, all its goals together.
        discount: how much each learned goal adds to the expectation of further ones; 0 to 1.
    """

    none_probability: float = Field(default=0.02, gt=0, lt=1)
    listed_brackets: float = Field(default=4.0, gt=0)
    discount: float = Field(default=0.5, ge=0, lt=1)
