"""Geometry of the gripper at a grasp, and how random tray scenes are drawn: all numbers of this package's labels.

The gripper comes straight down over the middle of a part, opened to the part's width plus a clearance on each
side, its fingers across the body's width, and closes. The numbers are the narrowest with which the skills go down.
"""

from __future__ import annotations

from pydantic import Field

from cell.interfaces.model import Model


class GripperGeometry(Model):
    """Outline of gripper and hand during descent and closing.

    Attributes:
        finger_width_m: along the tool's y, the body's longer side.
        finger_thickness_m: along the tool's x, across the body's width.
        clearance_m: gap between each finger and the body during descent.
        margin_m: least gap between a finger and a neighbour.
        grasp_depth_m: fingertips reach this far below the body's top ...
        bottom_gap_m: ... but stay this far above its bottom.
        below_gap_m: a neighbour must end this far below the fingertips, or the hand, to be passed over.
        finger_length_m: from the fingertips up to the lower side of the hand.
        hand_size_m: (tool x, tool y) extent of hand and knuckles above the fingers.
    """

    finger_width_m: float = Field(default=0.025, gt=0)
    finger_thickness_m: float = Field(default=0.012, gt=0)
    clearance_m: float = Field(default=0.004, gt=0)
    margin_m: float = Field(default=0.002, ge=0)
    grasp_depth_m: float = Field(default=0.030, gt=0)
    bottom_gap_m: float = Field(default=0.003, ge=0)
    below_gap_m: float = Field(default=0.004, ge=0)
    finger_length_m: float = Field(default=0.079, gt=0)
    hand_size_m: tuple[float, float] = (0.104, 0.076)


class DetectionNoise(Model):
    """Standard deviations of what the part detector answers: a few times those of the classical one in simulation.

    Attributes:
        position_m: of x and y, each.
        yaw_rad: heading.
        bottom_m: height of the body's bottom.
        size_m: length, width and height, each.
    """

    position_m: float = Field(default=0.001, ge=0)
    yaw_rad: float = Field(default=0.02, ge=0)
    bottom_m: float = Field(default=0.0005, ge=0)
    size_m: float = Field(default=0.0005, ge=0)


class SceneSettings(Model):
    """How cluttered scenes are drawn.

    Attributes:
        parts: fewest and most parts in a scene.
        nearest_gap_m, farthest_gap_m: gap between the bodies of a part and of the neighbour that it is put beside.
        tray_m: inner (x, y) extent of the tray; bodies lie inside.
    """

    parts: tuple[int, int] = (3, 6)
    nearest_gap_m: float = Field(default=0.003, ge=0)
    farthest_gap_m: float = Field(default=0.020, gt=0)
    tray_m: tuple[float, float] = (0.32, 0.40)
    gripper: GripperGeometry = GripperGeometry()
    noise: DetectionNoise = DetectionNoise()
