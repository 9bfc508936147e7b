"""Whether wrist images are live: from where the robot took a part, the next image must show something else."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from bracket_ground.errors import DeviceFault
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import GripperState
from bracket_ground.interfaces.perception import PartDetection, PartsView
from bracket_ground.interfaces.pose import Pose


@dataclass(frozen=True)
class WristLimits:
    """When the wrist image is stuck. Origin: simulated assemblies of all looks; see tests/cell/running/test_wrist.py.

    Attributes:
        took_m: [m] between the tool and a detection, level with the bench, at which fingers that close take that part.
        back_m: [m] from where a part was taken at which it was put back, and no change is due.
        levels: [grey levels] by which a pixel, as the mean of 5 x 5, changes at least where a part has gone.
        least_changed: share of the part's box that changes so: fingers may have shoved another part into its place.
        apart_m: [m] between cameras from which an image shows other places of the part; then nothing is compared.
    """

    took_m: float = 0.04
    back_m: float = 0.05
    levels: float = 10.0
    least_changed: float = 0.1
    apart_m: float = 0.004


class WristFreshness:
    """Looks at the gripper in each tick, and at each wrist frame before a detector does."""

    def __init__(self, limits: WristLimits = WristLimits()) -> None:
        self._limits = limits
        self._before: Frame | None = None  # that `_taken` was seen in
        self._taken: PartDetection | None = None
        self._holding = False

    def see(self, fingers: GripperState, tool: Pose | None, parts: PartsView | None) -> None:
        """A tick: the gripper, world_from_tool, and what the last frame showed."""
        took, let_go = fingers.holding and not self._holding, self._holding and not fingers.holding
        self._holding = fingers.holding
        if took:
            of_before = parts is not None and self._before is not None and parts.sequence == self._before.sequence
            near = [
                one for one in (parts.detections if of_before else ()) if _apart_m(one, tool) <= self._limits.took_m
            ]
            self._taken = min(near, key=lambda one: _apart_m(one, tool), default=None)
        elif let_go and self._taken is not None and not _apart_m(self._taken, tool) > self._limits.back_m:
            self._taken = None

    def check(self, frame: Frame) -> Frame:
        """The frame, which may go to the detector.

        Raises:
            DeviceFault: it shows what the robot has taken away, as the frame before.
        """
        before, taken = self._before, self._taken
        if (
            before is not None
            and taken is not None
            and self._stands(before, frame)
            and not self._changed(before, frame)
        ):
            x, y, _ = taken.world_from_part.position_m
            raise DeviceFault(
                "camera wrist",
                Message(
                    "its image does not change: it still shows the part that was taken from ({x} {y})",
                    x=f"{x:.3f}",
                    y=f"{y:.3f}",
                ),
            )
        self._before, self._taken = frame, None
        return frame

    def _stands(self, before: Frame, frame: Frame) -> bool:
        here, there = (np.array(one.world_from_camera.position_m) for one in (before, frame))
        return float(np.linalg.norm(here - there)) <= self._limits.apart_m and before.image.shape == frame.image.shape

    def _changed(self, before: Frame, frame: Frame) -> bool:
        assert self._taken is not None
        left, top, right, bottom = (max(0, edge) for edge in self._taken.box_px)
        crops = [cv2.blur(one.image[top:bottom, left:right].astype(np.float32), (5, 5)) for one in (before, frame)]
        off = np.abs(crops[0] - crops[1]).max(axis=-1)
        return not off.size or float((off > self._limits.levels).mean()) >= self._limits.least_changed


def _apart_m(part: PartDetection, tool: Pose | None) -> float:
    """Between a part and a tool, level with the bench; infinite where the tool's place is not known."""
    if tool is None:
        return math.inf
    return math.dist(part.world_from_part.position_m[:2], tool.position_m[:2])
