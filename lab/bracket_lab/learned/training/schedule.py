"""How long and how fast a network is trained."""

from __future__ import annotations

from pydantic import Field

from bracket_ground.files.model import Model

MOST_EPOCHS = 1000


class Schedule(Model):
    """Of AdamW with a one-cycle schedule.

    Attributes:
        epochs: how often each example is seen.
        batch: examples of a step.
        peak_rate: largest learning rate.
    """

    epochs: int = Field(default=10, ge=1, le=MOST_EPOCHS)
    batch: int = Field(default=8, ge=1, le=1024)
    peak_rate: float = Field(default=2e-3, gt=0, le=1)
    weight_decay: float = Field(default=1e-4, ge=0, le=1)
