"""The bench as measured when the cell was set up: where arm, bracket, tray and cameras are (config/cell.yaml).

World frame: origin at the arm's base on the table top, x towards the person, z up. In [m] and [rad].
"""

from __future__ import annotations

from pydantic import Field

from cell.interfaces.camera_model import CameraModel
from cell.interfaces.model import Model
from cell.interfaces.pose import Pose

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


class Mount(Model):
    """A fixed pose.

    Attributes:
        position_m: (x, y, z).
        quaternion_wxyz: how it is turned, as a unit quaternion (w, x, y, z); not turned by default.
    """

    position_m: tuple[float, float, float]
    quaternion_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        return Pose(self.position_m, self.quaternion_wxyz)


class CameraSetup(Model):
    """Calibration of a camera.

    Attributes:
        width_px, height_px: size of its images.
        focal_px: focal length, the same along both axes; images are undistorted, their middle is the principal point.
        rate_hz: frames per second.
        triggered: it sends a frame only when asked.
        mount: where it is: world_from_camera of a fixed camera, tool_from_camera of one on the wrist (tool: the TCP
            between the fingertips). Camera frame: x right, y down, z forward.
    """

    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    focal_px: float = Field(gt=0)
    rate_hz: float = Field(gt=0)
    triggered: bool = False
    mount: Mount

    @property
    def model(self) -> CameraModel:
        return CameraModel(self.width_px, self.height_px, self.focal_px)


class Tray(Model):
    """A shallow tray; parts for the robot lie in it.

    Attributes:
        centre_m: middle of its floor's upper side.
        size_m: inner (x, y) extent.
        wall_m: height of its rim.
    """

    centre_m: tuple[float, float, float]
    size_m: tuple[float, float]
    wall_m: float


class Bench(Model):
    """Everything that stands still.

    Attributes:
        bracket: world_from_bracket; origin on the upper side, holes where the product says (`bracket.holes_m`).
        tray: where the parts for the robot lie.
        bins_m: by part type, where the person keeps parts of their own (x, y, z).
        hand_rest_m: where the person's hand rests (x, y, z).
        overhead: the fixed camera that sees bracket and hands.
        wrist: the camera beside the gripper, which looks into the tray.
        arm_park_rad: joints out of the overhead view.
        arm_look_rad: joints from which the wrist camera sees the tray.
    """

    bracket: Mount
    tray: Tray
    bins_m: dict[str, tuple[float, float, float]]
    hand_rest_m: tuple[float, float, float]
    overhead: CameraSetup
    wrist: CameraSetup
    arm_park_rad: tuple[float, float, float, float, float, float]
    arm_look_rad: tuple[float, float, float, float, float, float]
