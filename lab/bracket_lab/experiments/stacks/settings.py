"""How networks for stacks are trained."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field

from bracket_ground.files.model import Model
from bracket_ground.interfaces.stacks import VMRD_CLASSES
from bracket_lab.learned.training.schedule import Schedule

Kind = Literal["default", "paper", "vmrn", "gvmrn_rf"]
LEARNED: tuple[Kind, ...] = ("default", "paper", "vmrn", "gvmrn_rf")
RULES = ("topmost", "always")
WHOLE = 1.0  # the share of the papers' networks
PAPER_HIDDEN = 2048  # of VMRN's fully connected layers
VMRD_PICTURES = 4233  # for training
MOST_EPOCHS = 4.0  # times as many as for VMRD


class StackTraining(Model):
    """Detector first, then planners on its frozen features.

    Attributes:
        classes: that there are, in their order.
        share: of the papers' networks: below 1 EfficientNet-Lite0 at 320 pixels instead of ResNet-101, and so much of
            the width of the heads.
        detector: its training; `epochs` is for as many pictures as VMRD has.
        heads: the planners' training, likewise.
    """

    classes: tuple[str, ...] = VMRD_CLASSES
    share: float = Field(default=0.125, ge=0.05, le=1)
    detector: Schedule = Schedule(epochs=8, batch=16, peak_rate=1e-3)
    heads: Schedule = Schedule(epochs=12, batch=16, peak_rate=1e-3)

    @property
    def hidden(self) -> int:
        """Width of the heads."""
        return round(PAPER_HIDDEN * self.share)

    def fit_to(self, pictures: int) -> StackTraining:
        """With more epochs the fewer pictures there are: as the root of how many are missing."""
        more = min(MOST_EPOCHS, max(1.0, math.sqrt(VMRD_PICTURES / max(1, pictures))))
        longer = {
            name: schedule.model_copy(update={"epochs": round(more * schedule.epochs)})
            for name, schedule in (("detector", self.detector), ("heads", self.heads))
        }
        return self.model_copy(update=longer)
