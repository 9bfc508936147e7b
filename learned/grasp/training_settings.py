"""Data, networks and optimisers of the trained grasp planners; free of torch."""

from __future__ import annotations

from pydantic import Field

from cell.files.model import Model
from learned.grasp.graph import Attention, EdgeKind
from learned.grasp.settings import DetectionNoise, RelationFilter, SceneSettings


class TrainingSettings(Model):
    """Data and optimiser.

    Attributes:
        scenes: drawn from the train split.
        observations: times that every scene is detected, each time with a noise of its own.
        plain_share: of the observations have the detector's own noise; that of the others lies between it and
            `most_noise`, all levels (on a logarithmic scale) alike.
        parts: fewest and most parts in a training scene; few, because moving parts away leaves few.
        test_scenes: drawn from the test split, for the scores on the model card.
        batch: parts, each as the required one, in a step.
        peak_rate: of the one-cycle schedule.
    """

    scenes: int = Field(gt=0)
    observations: int = Field(default=4, gt=0)
    plain_share: float = Field(default=0.5, ge=0, le=1)
    most_noise: DetectionNoise = DetectionNoise(position_m=0.006, yaw_rad=0.2, bottom_m=0.006, size_m=0.006)
    parts: tuple[int, int] = (1, 6)
    test_scenes: int = Field(default=1000, gt=0)
    epochs: int = Field(gt=0)
    batch: int = Field(gt=0)
    peak_rate: float = Field(gt=0)
    weight_decay: float = Field(default=0.01, ge=0)
    hidden: int = Field(gt=0)
    data: SceneSettings = SceneSettings()


class PairwiseSettings(TrainingSettings):
    """The pairwise planner.

    Attributes:
        members: how many perceptrons its committee has.
        random_share: of the scenes have parts of random sizes, so that the network knows sizes instead of types.
    """

    scenes: int = Field(default=4000, gt=0)
    epochs: int = Field(default=12, gt=0)
    batch: int = Field(default=256, gt=0)
    peak_rate: float = Field(default=0.006, gt=0)
    hidden: int = Field(default=48, gt=0)
    members: int = Field(default=4, gt=0)
    random_share: float = Field(default=0.5, ge=0, le=1)


class PaperSettings(TrainingSettings):
    """The paper's planner, and what Table 2 compares it with.

    Attributes:
        batch: scenes in a step.
        loose_share: of the scenes are drawn as loose as the simulator's tray, the others as `data` says.
        crops: nodes have features of the images' crops.
        footprint_passes: crops by which a network learns where parts stand around a part, before all else.
        edges: which reading of Eq. 4 weights the edges; "none" weights them alike, "gcn" is the plain graph
            convolution without weights of its own for the node itself.
        filter_m: parts farther from each other have no edge.
        attention: how the decoder scores embedding, label and graspability of the nodes: by Eq. 7 as printed, by an
            additive score, or not at all.
    """

    scenes: int = Field(default=4000, gt=0)
    observations: int = Field(default=1, gt=0)
    epochs: int = Field(default=50, gt=0)
    batch: int = Field(default=32, gt=0)
    peak_rate: float = Field(default=0.003, gt=0)
    loose_share: float = Field(default=0.5, ge=0, le=1)
    crops: bool = True
    footprint_passes: int = Field(default=120_000, gt=0)
    hidden: int = Field(default=64, gt=0)
    layers: int = Field(default=3, gt=0)
    edges: EdgeKind = "normalised"
    filter_m: float | None = Field(default=None, gt=0)
    attention: Attention = "printed"


class RelationSettings(TrainingSettings):
    """GVMRN-RF, the pairwise relations of Table 2.

    Attributes:
        filter: which pairs have a relation: those whose boxes in the image meet, as in its paper, or near ones.
    """

    scenes: int = Field(default=427, gt=0)
    epochs: int = Field(default=60, gt=0)
    batch: int = Field(default=64, gt=0)
    peak_rate: float = Field(default=0.004, gt=0)
    hidden: int = Field(default=96, gt=0)
    filter: RelationFilter = "boxes"
