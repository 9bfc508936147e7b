"""Settings of the semantic planners: what a cell says of goals, and how the networks learn."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from bracket_ground.files.model import Model

DETECTION_ERROR = 0.045  # the paper's action detector with three goals
Direction = Literal["position_to_object", "object_to_position", "both"]


class NewGoals(Model):
    """Expectation of goals that the product file does not list.

    Attributes:
        none_probability: that a bracket is none of the product's goals, before any was finished: from then on the
            share is learned. The more probable, the later the robot acts.
    """

    listed_brackets: ClassVar[float] = 4.0  # finished brackets that the product's own list counts for
    discount: ClassVar[float] = 0.5  # that each learned goal adds to the expectation of further ones
    none_probability: float = Field(default=0.02, gt=0, lt=1)


class FactoredSettings(Model):
    """Settings of training and of the noise model, as found on validation scenarios.

    Attributes:
        error: share of placements that the detector gets wrong.
        habit_scale: prior standard deviation of what a goal adds to the habits that all goals share.
        shared_scale: prior standard deviation of the habits that all goals share, by position and by type.
        goal_pseudo_n: demonstrations of every goal imagined beforehand, so that rare goals stay possible.
    """

    steps: int = Field(default=300, gt=0)
    learning_rate: float = Field(default=0.05, gt=0)
    weight_decay: float = Field(default=0.0, ge=0)
    error: float = Field(default=DETECTION_ERROR, gt=0, lt=1)
    habit_scale: float = Field(default=0.3, gt=0)
    shared_scale: float = Field(default=0.5, gt=0)
    goal_pseudo_n: float = Field(default=50.0, gt=0)


class PaperSettings(Model):
    """Settings of network and training, as found on validation scenarios.

    Attributes:
        direction: the way that messages take along an edge; the paper prints object_to_position.
        aggregation: how a node sums up its neighbours' messages; the paper prints the mean.
        start: what the decoder starts from beside the goal: the graph's embedding, or the object node's as printed.
        noise: share of the placements that are misdetected while training; more than the detector's makes plans
            generalise better from few scenarios.
    """

    hidden: int = Field(default=64, gt=0)
    layers: int = Field(default=2, ge=1)
    direction: Direction = "position_to_object"
    aggregation: str = Field(default="sum", pattern="^(mean|sum)$")
    start: Literal["graph", "object"] = "graph"
    steps: int = Field(default=600, gt=0)
    learning_rate: float = Field(default=5e-3, gt=0)
    weight_decay: float = Field(default=0.0, ge=0)
    noise: float = Field(default=0.1, ge=0, lt=1)
