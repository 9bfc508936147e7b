"""Settings of classical perception (section `perception` of config/cell.yaml)."""

from __future__ import annotations

from typing import ClassVar

from bracket_ground.files.model import Model
from bracket_ground.files.units import Rgb


class ClassicalLimits:
    """What the classical detectors assume about the bench and how sure they must be. Origin: chosen on drawn pictures.

    Attributes:
        hand_height_m: [m] of fingers above the table, where pixels of the hand are put on the bench.
        hand_area_m2: [m2] of skin at least that count as a hand.
        settle_frames: equal readings in a row before a hole's view changes.
        upright_tolerance_m: [m] from a part's middle to its hole up to which it stands straight.
        at_hole_m: [m] from fingertips to a hole, along the bench, up to which the hand works at it.
        still_m: [m] by which the fingertips of a hand that rests spread over a quarter of a second at most.
        report_s: [s] for which a finished assembly is reported.
        tray_margin_m: [m] outside the tray up to which parts still count.
    """

    hand_height_m: ClassVar[float] = 0.10
    hand_area_m2: ClassVar[float] = 0.002
    settle_frames: ClassVar[int] = 3
    upright_tolerance_m: ClassVar[float] = 0.010
    at_hole_m: ClassVar[float] = 0.045
    still_m: ClassVar[float] = 0.006
    report_s: ClassVar[float] = 0.7
    tray_margin_m: ClassVar[float] = 0.06


class PerceptionSettings(ClassicalLimits, Model):
    """What the classical detectors must know of the person.

    Attributes:
        skin_rgb: colour of the hand, or of its glove, in full light.
    """

    skin_rgb: Rgb = (0.87, 0.64, 0.50)
