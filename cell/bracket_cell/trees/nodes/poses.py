"""From poses as tree files write them to poses in the world."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bracket_cell.trees.nodes.services import Services
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.places import FRAMES
from bracket_ground.interfaces.pose import FINGERS_DOWN, Pose
from bracket_ground.interfaces.product import Product
from btxml.engine.errors import NodeError
from btxml.engine.literals import number_in

WORLD, TRAY, BRACKET, TOOL = FRAMES
FARTHEST_M = 10.0
STEP_S = 1e-3  # over which a speed is told from places
BRACKET_GAP_M = 0.10  # nothing is let go this near to the bracket's middle line but by PlacePart, which is guarded


@dataclass(frozen=True)
class FramedPose:
    """A pose in a frame of the cell.

    Attributes:
        frame: world (the arm's base), tray (middle of its floor), bracket (its upper side), tool (where the tool is,
            z upwards), a position of the product, or a place of the bench.
        pose: frame_from_this in [m]; not turned, z points upwards.
    """

    frame: str
    pose: Pose

    missing: ClassVar[str] = "the cell has no frame"
    like: ClassVar[str] = "like 'tray: 0.1 0.0 0.05; 0 0 90': frame, metres, then degrees about x, y and z"

    @classmethod
    def from_text(cls, text: str) -> FramedPose:
        """What a tree file writes.

        Raises:
            ValueError: it writes no pose.
        """
        frame, colon, rest = text.partition(":")
        place, _, turn = rest.partition(";")
        if not colon or not frame.strip():
            raise ValueError("the frame is missing")
        metres = _numbers(place, "metres", FARTHEST_M)
        degrees = _numbers(turn, "degrees", 360.0) if turn.strip() else (0.0, 0.0, 0.0)
        return cls(frame.strip(), _turned(metres, degrees))

    @staticmethod
    def name_in(value: object) -> str:
        """The frame that a value, or the text of one, names."""
        return value.frame if isinstance(value, FramedPose) else str(value).partition(":")[0].strip()

    def __str__(self) -> str:
        x, y, z = self.pose.position_m
        heading = math.degrees(self.pose.yaw_rad)
        return f"{self.frame}: {x:.3f} {y:.3f} {z:.3f}" + (f"; 0 0 {heading:.1f}" if abs(heading) >= 0.05 else "")


def _numbers(text: str, unit: str, most: float) -> tuple[float, float, float]:
    words = text.split()
    numbers = [number_in(word) for word in words]
    if len(words) != 3 or any(number is None or abs(number) > most for number in numbers):
        raise ValueError(f"'{text.strip()}' is not three numbers of {unit} up to {most:g}")
    x, y, z = (float(number) for number in numbers if number is not None)
    return x, y, z


def _turned(metres: tuple[float, float, float], degrees: tuple[float, float, float]) -> Pose:
    """Turned about the fixed axes x, then y, then z (roll, pitch, yaw)."""
    (a, b, c), (d, e, f) = (
        [math.cos(math.radians(angle)) for angle in degrees],
        [math.sin(math.radians(angle)) for angle in degrees],
    )
    about_x = np.array([[1, 0, 0], [0, a, -d], [0, d, a]])
    about_y = np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]])
    about_z = np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]])
    matrix = np.eye(4)
    matrix[:3, :3] = about_z @ about_y @ about_x
    matrix[:3, 3] = metres
    return Pose.from_matrix(matrix)


def frame_pose(services: Services, frame: str) -> Pose:
    """world_from_frame.

    Raises:
        NodeError: the cell has no such frame.
    """
    bench, product = services.tools.bench, services.tools.product
    if frame == TOOL:
        return tool_pose(services)
    if (fixed := fixed_frame(bench, product, frame)) is not None:
        return fixed
    legal = ", ".join((*FRAMES, *product.positions, *bench.places))
    raise NodeError(f"the cell has no frame '{frame}'; one of {legal}")


def fixed_frame(bench: Bench, product: Product, frame: str) -> Pose | None:
    """world_from_frame of what stands still; None for the tool, and where there is no such frame."""
    if frame in product.bracket.holes_m:
        return bench.bracket.pose @ Pose(product.slot_m(frame))
    if frame in bench.places:
        return bench.places[frame].pose
    return {WORLD: Pose((0.0, 0.0, 0.0)), TRAY: Pose(bench.tray.centre_m), BRACKET: bench.bracket.pose}.get(frame)


def tool_pose(services: Services) -> Pose:
    """Where the tool (TCP) is, its z upwards as in files."""
    joints = np.array(services.now.observation.arm.positions_rad)
    return services.tools.motion.kinematics.forward(joints) @ FINGERS_DOWN


def world_pose(services: Services, pose: FramedPose) -> Pose:
    """The pose in the world, z as the file has it."""
    return frame_pose(services, pose.frame) @ pose.pose


def world_from_tool(services: Services, pose: FramedPose) -> Pose:
    """Where the tool goes for a pose of a file: not turned, the fingers point down."""
    return world_pose(services, pose) @ FINGERS_DOWN


def near_bracket(bench: Bench, product: Product, world: Pose) -> bool:
    """Whether a part that is let go there could fall into a hole."""
    x, y, _ = (bench.bracket.pose.inverse() @ world).position_m
    holes = product.bracket.holes_m.values()
    return any(abs(x - hole_x) < BRACKET_GAP_M and abs(y - hole_y) < BRACKET_GAP_M for hole_x, hole_y in holes)


def tool_speed_m_s(services: Services) -> float:
    """How fast the tool (TCP) moves, by what the joints measured."""
    arm, kinematics = services.now.observation.arm, services.tools.motion.kinematics
    joints, soon = np.array(arm.positions_rad), np.array(arm.velocities_rad_s) * STEP_S
    return float(np.linalg.norm(kinematics.position_m(joints + soon) - kinematics.position_m(joints))) / STEP_S
