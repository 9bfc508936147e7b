"""How stacks are drawn."""

from __future__ import annotations

from pydantic import Field, model_validator

from bracket_ground.files.model import Disagreement, Model

MOST_OBJECTS = 5


class StackSettings(Model):
    """Objects on a table, some on top of others.

    Attributes:
        fewest, most: objects of a scene.
        deepest: most relations in a chain; each scene's own limit is drawn from 1 to this.
        stacked_share: probability that an object, the first one aside, is set down on others.
        bridging_share: of those, the share that is laid across two.
        kinds: how many of the 31 kinds are drawn from, in VMRD's order.
        slanted_share: of the views that are not from right above.
    """

    fewest: int = Field(default=2, ge=1, le=MOST_OBJECTS)
    most: int = Field(default=MOST_OBJECTS, ge=1, le=MOST_OBJECTS)
    deepest: int = Field(default=4, ge=1, le=4)
    stacked_share: float = Field(default=0.85, ge=0, le=1)
    bridging_share: float = Field(default=0.15, ge=0, le=1)
    kinds: int = Field(default=31, ge=5, le=31)
    slanted_share: float = Field(default=0.6, ge=0, le=1)

    @model_validator(mode="after")
    def _in_order(self) -> StackSettings:
        if self.fewest > self.most:
            raise Disagreement([(("fewest",), f"fewest {self.fewest} is more than most {self.most}")])
        return self
