"""Frames that others tell on /tf and /tf_static."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any

import numpy as np

from bracket_cell.plant.dds import SENSOR, Node, Quality, taken
from bracket_cell.plant.ros_scene import TF
from bracket_ground.interfaces.pose import Pose

LOOKS_S = 0.05


class Frames:
    """Listens from now on; of a frame that is told anew the newest counts."""

    def __init__(self, node: Node) -> None:
        still = Quality(kept=100, lasting=True)
        self._readers = [node.subscription("/tf", TF, SENSOR), node.subscription("/tf_static", TF, still)]
        self._parents: dict[str, tuple[str, Pose]] = {}

    def pose(self, parent: str, child: str, limit_s: float) -> Pose | None:
        """parent_from_child; None where nobody tells it within the limit."""
        until_s = time.monotonic() + limit_s
        while (found := self._known(parent, child)) is None and time.monotonic() < until_s:
            time.sleep(LOOKS_S)
        return found

    def _known(self, parent: str, child: str) -> Pose | None:
        for reader in self._readers:
            for frame in [frame for message in taken(reader) for frame in message.transforms]:
                with suppress(ValueError):  # a damaged one tells nothing
                    pose = pose_of(frame.transform.translation, frame.transform.rotation)
                    self._parents[frame.child_frame_id.strip("/")] = frame.header.frame_id.strip("/"), pose
        (top, parent_here), (other, child_here) = self._root(parent), self._root(child)
        return parent_here.inverse() @ child_here if top == other else None

    def _root(self, frame: str) -> tuple[str, Pose]:
        """The frame that all hangs from, and root_from_frame; a ring is gone around once."""
        pose = Pose((0.0, 0.0, 0.0))
        for _ in self._parents:
            if frame not in self._parents:
                break
            frame, above = self._parents[frame]
            pose = above @ pose
        return frame, pose


def pose_of(position: Any, rotation: Any) -> Pose:
    """A pose of geometry_msgs; a quaternion of zeros is not turned.

    Raises:
        ValueError: a number is none.
    """
    at, turned = np.array([position.x, position.y, position.z]), [rotation.w, rotation.x, rotation.y, rotation.z]
    length = float(np.linalg.norm(turned))
    if not (np.isfinite(at).all() and np.isfinite(length)):
        raise ValueError("a pose has numbers that are none")
    w, x, y, z = (np.array(turned) / length).tolist() if length > 0 else (1.0, 0.0, 0.0, 0.0)
    return Pose((float(at[0]), float(at[1]), float(at[2])), (w, x, y, z))
