"""Settings of the training of the part detector."""

from __future__ import annotations

from pydantic import Field

from bracket_ground.files.model import Model
from bracket_lab.learned.training.schedule import MOST_EPOCHS, Schedule

BACKBONES = ("resnet101", "resnet50", "resnet18")  # of Faster R-CNN, the paper's first
NARROW = "resnet18"  # the one of which a share of the channels can be had


class CentreTraining(Schedule):
    """Training of the centre net.

    Attributes:
        widths: channels at a half, a quarter, an eighth and a sixteenth of the input.
        features: channels of the features that are read at a peak.
    """

    widths: tuple[int, int, int, int] = (16, 32, 64, 96)
    features: int = Field(default=32, ge=8, le=256)
    epochs: int = Field(default=8, ge=1, le=MOST_EPOCHS)
    batch: int = Field(default=8, ge=1, le=256)
    peak_rate: float = Field(default=2.5e-3, gt=0, le=1)


class PoseTraining(Schedule):
    """Training of the pose net.

    Attributes:
        widths: channels at a half, a quarter and an eighth of the crop.
        hidden: width of the layer that all answers are read from.
        off_m, off_rad: standard deviations of what it learns to correct.
    """

    widths: tuple[int, int, int] = (24, 40, 64)
    hidden: int = Field(default=96, ge=8, le=1024)
    off_m: float = Field(default=0.004, gt=0, le=0.02)
    off_rad: float = Field(default=0.12, gt=0, le=0.5)
    batch: int = Field(default=32, ge=1, le=1024)


class StackTraining(Schedule):
    """Training of the network that tells what lies on what, and how.

    Attributes:
        widths: channels at a half, a quarter and an eighth of the crop.
        hidden: width of the layer that all answers are read from.
        off_m, off_rad: standard deviations of what it learns to correct, beside the centre net's own errors.
    """

    widths: tuple[int, int, int] = (24, 48, 96)
    hidden: int = Field(default=192, ge=8, le=1024)
    epochs: int = Field(default=30, ge=1, le=MOST_EPOCHS)
    batch: int = Field(default=32, ge=1, le=1024)
    off_m: float = Field(default=0.004, ge=0, le=0.02)
    off_rad: float = Field(default=0.3, ge=0, le=3.2)


class RcnnTraining(Model):
    """Training of a Faster R-CNN: AdamW with a one-cycle schedule.

    Attributes:
        backbone: one of BACKBONES.
        share: of the channels of ResNet-18, its pyramid and the head.
        steps: each of a batch of images.
        batch: images in a step.
        peak_rate: learning rate.
        weight_decay: of all weights.
    """

    backbone: str = BACKBONES[0]
    share: float = Field(default=1.0, gt=0, le=1)
    steps: int = Field(default=2000, ge=1)
    batch: int = Field(default=4, ge=1)
    peak_rate: float = Field(default=2e-3, gt=0, le=1)
    weight_decay: float = Field(default=1e-4, ge=0)
