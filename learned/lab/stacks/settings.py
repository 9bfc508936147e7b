"""How networks for stacks are trained."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cell.files.model import Model
from cell.interfaces.stacks import VMRD_CLASSES
from learned.training.schedule import Schedule

Kind = Literal["default", "paper", "vmrn", "gvmrn_rf"]
LEARNED: tuple[Kind, ...] = ("default", "paper", "vmrn", "gvmrn_rf")
RULES = ("topmost", "always")
WHOLE = 1.0  # the share of the papers' networks
PAPER_HIDDEN = 2048  # of VMRN's fully connected layers


class StackTraining(Model):
    """Detector first, then planners on its frozen features.

    Attributes:
        classes: that there are, in their order.
        share: of the papers' networks: below 1 a MobileNet at 320 pixels instead of ResNet-101 with FPN, and so much of
            the width of the heads.
        detector: its training; with `epochs` for as many pictures as VMRD has, and more the fewer there are.
        heads: the planners' training.
    """

    classes: tuple[str, ...] = VMRD_CLASSES
    share: float = Field(default=0.125, ge=0.05, le=1)
    detector: Schedule = Schedule(epochs=8, batch=8, peak_rate=1e-3)
    heads: Schedule = Schedule(epochs=25, batch=16, peak_rate=1e-3)

    @property
    def hidden(self) -> int:
        """Width of the heads."""
        return round(PAPER_HIDDEN * self.share)


PAPER_IA = {"vmrn": 0.658, "gvmrn_rf": 0.688, "paper": 0.62}  # Table 4 of the paper, on VMRD's photographs
