"""Settings of classical perception (section `perception` of config/cell.yaml)."""

from __future__ import annotations

from pydantic import Field

from bracket_ground.files.model import Model
from bracket_ground.files.units import Rgb


class PerceptionSettings(Model):
    """What the detectors assume about the bench and how sure they must be.

    Attributes:
        skin_rgb: colour of the hand in full light.
        hand_height_m: typical height of fingers above the table, where pixels of the hand are put on the bench.
        hand_area_m2: least area of skin that counts as a hand.
        settle_frames: equal readings in a row before a hole's view changes.
        upright_tolerance_m: distance of a part's middle from its hole up to which it stands straight.
        at_hole_m: distance from fingertips to a hole, along the bench, up to which the hand works at it.
        still_m: spread of the fingertips over a quarter of a second up to which the hand rests.
        report_s: how long a finished assembly is reported.
        tray_margin_m: parts this far outside the tray still count.
    """

    skin_rgb: Rgb = (0.87, 0.64, 0.50)
    hand_height_m: float = Field(default=0.10, ge=0, le=1)
    hand_area_m2: float = Field(default=0.002, gt=0, le=0.05)
    settle_frames: int = Field(default=3, ge=1, le=100)
    upright_tolerance_m: float = Field(default=0.010, gt=0, le=0.1)
    at_hole_m: float = Field(default=0.045, gt=0, le=0.5)
    still_m: float = Field(default=0.006, gt=0, le=0.1)
    report_s: float = Field(default=0.7, gt=0, le=10)
    tray_margin_m: float = Field(default=0.06, ge=0, le=0.5)
