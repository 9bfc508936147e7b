"""Settings of the training of the hole reader."""

from __future__ import annotations

from pydantic import Field

from bracket_lab.learned.training.schedule import Schedule


class HoleTraining(Schedule):
    """Training of the network that reads holes.

    Attributes:
        widths: channels at a half, a quarter and an eighth of the crop.
        hidden: width of the layer that all answers are read from.
        off_m, off_rad: standard deviations of the camera's calibration errors that it learns to live with.
        validation_share: of recordings, kept for the calibration of probabilities.
        most_called_empty: share of filled holes that may be called empty, from which the least probability follows.
        most_misnamed: share of holes that may be said to hold a part that they do not hold.
        astray_share: of parts that lie, lean or stand beside their hole, as they are met with. There are more of them
            in training data, and probabilities are chosen as if there were not.
    """

    widths: tuple[int, int, int] = (16, 32, 48)
    hidden: int = Field(default=64, ge=8, le=1024)
    off_m: float = Field(default=0.0015, ge=0, le=0.02)
    off_rad: float = Field(default=0.002, ge=0, le=0.1)
    epochs: int = Field(default=14, ge=1, le=1000)
    batch: int = Field(default=10, ge=1, le=256)  # images, each with all its holes
    peak_rate: float = Field(default=3e-3, gt=0, le=1)
    weight_decay: float = Field(default=3e-4, ge=0, le=1)
    validation_share: float = Field(default=0.15, gt=0, lt=1)
    most_called_empty: float = Field(default=0.0005, gt=0, le=0.1)
    most_misnamed: float = Field(default=0.004, gt=0, le=0.1)
    astray_share: float = Field(default=0.15, gt=0, lt=1)
