"""Data, networks and optimisers of the trained grasp planners; free of torch."""

from __future__ import annotations

from pydantic import Field

from cell.interfaces.model import Model
from learned.grasp.graph import EdgeKind
from learned.grasp.settings import SceneSettings


class TrainingSettings(Model):
    """Data and optimiser.

    Attributes:
        scenes: drawn from the train split.
        parts: fewest and most parts in a training scene; few, because moving parts away leaves few.
        test_scenes: drawn from the test split, for the scores on the model card.
        batch: parts, each as the required one, in a step.
        peak_rate: of the one-cycle schedule.
    """

    scenes: int = Field(gt=0)
    parts: tuple[int, int] = (1, 6)
    test_scenes: int = Field(default=1000, gt=0)
    epochs: int = Field(gt=0)
    batch: int = Field(gt=0)
    peak_rate: float = Field(gt=0)
    weight_decay: float = Field(default=0.01, ge=0)
    hidden: int = Field(gt=0)
    data: SceneSettings = SceneSettings()


class PairwiseSettings(TrainingSettings):
    """The pairwise planner: how many perceptrons its committee has."""

    scenes: int = Field(default=6000, gt=0)
    epochs: int = Field(default=30, gt=0)
    batch: int = Field(default=256, gt=0)
    peak_rate: float = Field(default=0.006, gt=0)
    hidden: int = Field(default=48, gt=0)
    members: int = Field(default=4, gt=0)


class PaperSettings(TrainingSettings):
    """The paper's planner: graph convolutions, and which reading of Eq. 4 weights the edges."""

    scenes: int = Field(default=6000, gt=0)
    epochs: int = Field(default=20, gt=0)
    batch: int = Field(default=128, gt=0)
    peak_rate: float = Field(default=0.004, gt=0)
    hidden: int = Field(default=64, gt=0)
    layers: int = Field(default=3, gt=0)
    edges: EdgeKind = "normalised"
