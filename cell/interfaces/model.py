"""Base of all configuration models: unknown keys are errors and values do not change after loading."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict

Location = tuple[str | int, ...]


class Model(BaseModel):
    """A part of a configuration file; field names carry their units."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Disagreement(ValueError):
    """Parts of a model do not fit together; raised by a model's validator.

    Attributes:
        places: (location within the model, what is wrong there) of every problem.
    """

    def __init__(self, places: Sequence[tuple[Location, str]]) -> None:
        self.places = tuple(places)
        super().__init__("; ".join(what for _, what in places))
