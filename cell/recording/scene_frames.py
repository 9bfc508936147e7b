"""Coordinate frames for viewers: what stands still, and the arm's links by their joint angles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import matmul

import numpy as np
from foxglove import messages

from cell.interfaces.observation import ArmState, GripperState
from cell.interfaces.pose import Array, Pose
from skills.kinematics import Kinematics
from skills.outline import BASE, Joint, Shape, chain

WORLD, BRACKET, TRAY, TOOL = "world", "bracket", "tray", "tool"
FINGER_SIDES = {"finger_left": 1.0, "finger_right": -1.0}

Rotation = tuple[float, float, float, float]


def timestamp(stamp_ns: int) -> messages.Timestamp:
    """Clock time in the form of Foxglove's messages."""
    return messages.Timestamp(sec=stamp_ns // 1_000_000_000, nsec=stamp_ns % 1_000_000_000)


def pose_message(pose: Pose) -> messages.Pose:
    """A pose in the form of Foxglove's messages."""
    x, y, z = pose.position_m
    qw, qx, qy, qz = pose.quaternion_wxyz
    return messages.Pose(
        position=messages.Vector3(x=x, y=y, z=z), orientation=messages.Quaternion(x=qx, y=qy, z=qz, w=qw)
    )


def transform(stamp_ns: int, parent: str, child: str, pose: Pose) -> messages.FrameTransform:
    """`parent_from_child` as a message."""
    return _transform(timestamp(stamp_ns), parent, child, pose.position_m, pose.quaternion_wxyz)


def still_frames(stamp_ns: int, frames: Mapping[str, Pose]) -> messages.FrameTransforms:
    """Frames that do not move, by name, in the world."""
    return messages.FrameTransforms(
        transforms=[transform(stamp_ns, WORLD, name, pose) for name, pose in {BASE: Pose((0, 0, 0)), **frames}.items()]
    )


class RobotFrames:
    """Frames of links, tool and fingers; plain arithmetic, as it is done in every tick in which the arm moves."""

    def __init__(self, kinematics: Kinematics, shapes: Sequence[Shape]) -> None:
        self._joints = chain(kinematics.model)
        wrist = self._joints[-1].child
        world_from_wrist = reduce(matmul, (joint.parent_from_child for joint in self._joints))
        tool = world_from_wrist.inverse() @ kinematics.forward(np.zeros(len(self._joints)))
        self._tool = (wrist, TOOL, tool.position_m, tool.quaternion_wxyz)
        self._fingers = [_Finger.of(shape) for shape in shapes if shape.name in FINGER_SIDES]

    def message(self, stamp_ns: int, arm: ArmState, gripper: GripperState) -> messages.FrameTransforms:
        """All of them at joint angles and an opening."""
        stamp = timestamp(stamp_ns)
        found = [
            _transform(stamp, joint.parent, joint.child, joint.parent_from_child.position_m, _turned(joint, angle))
            for joint, angle in zip(self._joints, arm.positions_rad, strict=True)
        ]
        found.append(_transform(stamp, *self._tool))
        for finger in self._fingers:
            position_m = finger.at(gripper.opening_m)
            found.append(_transform(stamp, finger.parent, finger.name, position_m, finger.rotation))
        return messages.FrameTransforms(transforms=found)


@dataclass(frozen=True)
class _Finger:
    """A finger slides on a line in its parent's frame: `closed_m` plus the opening times `slope`."""

    name: str
    parent: str
    closed_m: tuple[float, float, float]
    slope: tuple[float, float, float]
    rotation: Rotation

    @staticmethod
    def of(shape: Shape) -> _Finger:
        assert shape.box_m is not None
        pose = shape.frame_from_shape
        slope = FINGER_SIDES[shape.name] / 2 * pose.rotation[:, 0]
        closed = np.array(pose.position_m) + shape.box_m[0] * slope
        return _Finger(shape.name, shape.frame, _triple(closed), _triple(slope), pose.quaternion_wxyz)

    def at(self, opening_m: float) -> tuple[float, float, float]:
        (x, y, z), (dx, dy, dz) = self.closed_m, self.slope
        return x + opening_m * dx, y + opening_m * dy, z + opening_m * dz


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _turned(joint: Joint, angle_rad: float) -> Rotation:
    """Quaternion wxyz of the child in its parent."""
    aw, ax, ay, az = joint.parent_from_child.quaternion_wxyz
    sin = math.sin(angle_rad / 2)
    bw, (bx, by, bz) = math.cos(angle_rad / 2), (sin * value for value in joint.axis)
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def _transform(
    stamp: messages.Timestamp, parent: str, child: str, position_m: tuple[float, float, float], rotation: Rotation
) -> messages.FrameTransform:
    x, y, z = position_m
    qw, qx, qy, qz = rotation
    return messages.FrameTransform(
        timestamp=stamp,
        parent_frame_id=parent,
        child_frame_id=child,
        translation=messages.Vector3(x=x, y=y, z=z),
        rotation=messages.Quaternion(x=qx, y=qy, z=qz, w=qw),
    )
