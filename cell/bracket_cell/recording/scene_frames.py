"""What detectors found, drawn over camera images by viewers: hand, holes and parts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import matmul

import numpy as np
from foxglove import messages

from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.outline import BASE, Joint, Shape, chain
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.observation import ArmState, GripperState
from bracket_ground.interfaces.perception import BenchView, HoleView, PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

WORLD, BRACKET, TRAY, TOOL = "world", "bracket", "tray", "tool"
FINGER_SIDES = {"finger_left": 1.0, "finger_right": -1.0}

Rotation = tuple[float, float, float, float]
YELLOW, WHITE, GREY, RED = (1.0, 0.86, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0), (0.7, 0.7, 0.7, 1.0), (1.0, 0.2, 0.2, 1.0)
SHADE = messages.Color(r=0.0, g=0.0, b=0.0, a=0.55)
FONT_PX = 12.0
LINE_PX = 2.0
Box = tuple[int, int, int, int]
Colour = tuple[float, float, float, float]


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
            _transform(stamp, joint.parent, joint.child, *_moved(joint, angle))
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


def _moved(joint: Joint, value: float) -> tuple[tuple[float, float, float], Rotation]:
    """Position and quaternion wxyz of the child in its parent, at an angle in [rad], or a way in [m]."""
    if not joint.slides:
        return joint.parent_from_child.position_m, _turned(joint, value)
    at = joint.parent_from_child.transform(value * np.array(joint.axis))
    return _triple(at), joint.parent_from_child.quaternion_wxyz


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


class HoleMarks:
    """Where the bracket's holes are in the overhead image, and what is read in them."""

    def __init__(self, product: Product, bench: Bench) -> None:
        holes_m = np.array([[x, y, 0.0] for x, y in product.bracket.holes_m.values()])
        camera = bench.overhead
        pixels = camera.model.project(camera.mount.pose, bench.bracket.pose.transform(holes_m))
        self._centres = dict(zip(product.positions, pixels.tolist(), strict=True))
        depth_m = camera.mount.position_m[2] - bench.bracket.position_m[2]
        widest_m = max(part.peg_diameter_m for part in product.parts.values())
        self._diameter_px = camera.focal_px * (widest_m + 2 * product.bracket.hole_clearance_m) / depth_m
        self._colours: dict[str | None, Colour] = {name: (*p.colour_rgb, 1.0) for name, p in product.parts.items()}

    @property
    def boxes_px(self) -> dict[str, tuple[float, float, float, float]]:
        """(left, top, right, bottom) around each hole, by position."""
        half = self._diameter_px / 2
        return {name: (x - half, y - half, x + half, y + half) for name, (x, y) in self._centres.items()}

    def message(self, stamp_ns: int, holes: Mapping[str, HoleView]) -> messages.ImageAnnotations:
        """Circles and names; grey where a hole was never seen, red where a part is tilted."""
        stamp, circles, texts = timestamp(stamp_ns), [], []
        for position, (x, y) in self._centres.items():
            hole = holes.get(position)
            tilted = hole is not None and not hole.upright
            colour = GREY if hole is None else RED if tilted else self._colours.get(hole.part, WHITE)
            circles.append(
                messages.CircleAnnotation(
                    timestamp=stamp,
                    position=messages.Point2(x=x, y=y),
                    diameter=self._diameter_px,
                    thickness=LINE_PX,
                    outline_color=colour_message(colour),
                )
            )
            read = "?" if hole is None else f"{hole.part or '-'}{' tilted' if tilted else ''}"
            texts.append(_text(stamp, x + self._diameter_px * 0.8, y + FONT_PX / 2, f"{position} {read}", WHITE))
        return messages.ImageAnnotations(timestamp=stamp, circles=circles, texts=texts)


def hand_overlay(stamp_ns: int, view: BenchView) -> messages.ImageAnnotations:
    """The hand's box with what it holds, and the action; empties the overlay where no hand is seen."""
    stamp, hand = timestamp(stamp_ns), view.hand
    action = _text(stamp, 6.0, 16.0, f"{view.action} {view.action.confidence:.2f}", WHITE)
    if hand is None:
        return messages.ImageAnnotations(timestamp=stamp, texts=[action])
    label = _text(stamp, hand.box_px[0], hand.box_px[1] - 3.0, f"hand, holds {hand.held_part or 'nothing'}", YELLOW)
    return messages.ImageAnnotations(timestamp=stamp, points=[_box(stamp, hand.box_px, YELLOW)], texts=[action, label])


def parts_overlay(stamp_ns: int, product: Product, parts: Sequence[PartDetection]) -> messages.ImageAnnotations:
    """A box and a label for each part in the wrist image, numbered as in the plans of the log."""
    stamp = timestamp(stamp_ns)
    return messages.ImageAnnotations(
        timestamp=stamp,
        points=[_box(stamp, part.box_px, (*product.parts[part.part].colour_rgb, 1.0)) for part in parts],
        texts=[
            _text(stamp, part.box_px[0], part.box_px[1] - 3.0, f"{number}: {part.part} {part.confidence:.2f}", WHITE)
            for number, part in enumerate(parts)
        ],
    )


def _box(stamp: messages.Timestamp, box_px: Box, colour: Colour) -> messages.PointsAnnotation:
    left, top, right, bottom = box_px
    corners = ((left, top), (right, top), (right, bottom), (left, bottom))
    return messages.PointsAnnotation(
        timestamp=stamp,
        type=messages.PointsAnnotationType.LineLoop,
        points=[messages.Point2(x=x, y=y) for x, y in corners],
        outline_color=colour_message(colour),
        thickness=LINE_PX,
    )


def _text(stamp: messages.Timestamp, x: float, y: float, text: str, colour: Colour) -> messages.TextAnnotation:
    return messages.TextAnnotation(
        timestamp=stamp,
        position=messages.Point2(x=x, y=y),
        text=text,
        font_size=FONT_PX,
        text_color=colour_message(colour),
        background_color=SHADE,
    )


def colour_message(rgba: Colour) -> messages.Color:
    """A colour for viewers."""
    red, green, blue, alpha = rgba
    return messages.Color(r=red, g=green, b=blue, a=alpha)
