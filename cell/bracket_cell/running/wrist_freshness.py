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
        self._before: Frame | None = None
        self._taken: list[PartDetection] = []  # since that frame, which shows them
        self._held: PartDetection | None = None
        self._holding = False

    def see(self, fingers: GripperState, tool: Pose | None, parts: PartsView | None) -> None:
        """A tick: the gripper, world_from_tool, and what the last frame showed."""
        took, let_go = fingers.holding and not self._holding, self._holding and not fingers.holding
        self._holding = fingers.holding
        if took:
            of_before = parts is not None and self._before is not None and parts.sequence == self._before.sequence
            seen = parts.detections if parts is not None and of_before else ()
            near = [part for part in seen if _apart_m(part, tool) <= self._limits.took_m]
            self._held = min(near, key=lambda part: _apart_m(part, tool), default=None)
        elif let_go and self._held is not None:
            if _apart_m(self._held, tool) > self._limits.back_m:
                self._taken.append(self._held)
            self._held = None

    def check(self, frame: Frame) -> Frame:
        """The frame, which may go to the detector.

        Raises:
            DeviceFault: it shows all that the robot has taken away, as the frame before.
        """
        if self._taken and self._stands(frame) and not any(self._changed(part, frame) for part in self._taken):
            x, y, _ = self._taken[-1].world_from_part.position_m
            words = Message("its image still shows the part that was taken from ({x} {y})", x=f"{x:.3f}", y=f"{y:.3f}")
            raise DeviceFault("camera wrist", words)
        self._before, self._taken = frame, []
        return frame

    def _stands(self, frame: Frame) -> bool:
        """Whether this frame was taken from where the one before was."""
        before = self._before
        if before is None or before.image.shape != frame.image.shape:
            return False
        apart_m = math.dist(before.world_from_camera.position_m, frame.world_from_camera.position_m)
        return apart_m <= self._limits.apart_m

    def _changed(self, part: PartDetection, frame: Frame) -> bool:
        """Whether a frame shows something else than the one before where a part was."""
        assert self._before is not None
        left, top, right, bottom = (max(0, edge) for edge in part.box_px)
        crops = [shown.image[top:bottom, left:right].astype(np.float32) for shown in (self._before, frame)]
        if not crops[0].size:
            return True
        off = np.abs(cv2.blur(crops[0], (5, 5)) - cv2.blur(crops[1], (5, 5))).max(axis=-1)
        return float((off > self._limits.levels).mean()) >= self._limits.least_changed


def _apart_m(part: PartDetection, tool: Pose | None) -> float:
    """Between a part and a tool, level with the bench; infinite where the tool's place is not known."""
    if tool is None:
        return math.inf
    return math.dist(part.world_from_part.position_m[:2], tool.position_m[:2])
