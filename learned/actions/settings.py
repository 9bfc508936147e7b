"""Settings of the training of action detectors."""

from __future__ import annotations

from pydantic import Field

from cell.interfaces.model import Model

TRAINABLE = ("slim", "paper", "cnn_lstm", "hand", "lrcn", "track")
WHOLE_FRAMES = ("lrcn",)  # kinds that look at whole frames instead of track and crops


class ActionTraining(Model):
    """How a network learns.

    Attributes:
        epochs: passes through the segments.
        batch: segments in a step.
        learning_rate: its peak, of a one-cycle schedule.
        weight_decay: of all weights.
        share: of VGG16's channels, where the network has it.
        released_weight: of the loss of "the fingers have opened", against that of the class.
    """

    epochs: int = Field(default=24, ge=1)
    batch: int = Field(default=64, ge=2)
    learning_rate: float = Field(default=3e-3, gt=0)
    weight_decay: float = Field(default=1e-3, ge=0)
    share: float = Field(default=1.0, gt=0, le=1)
    released_weight: float = Field(default=0.5, ge=0)
