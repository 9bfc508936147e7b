"""From poses as tree files write them to poses in the world."""

from __future__ import annotations

import numpy as np

from cell.interfaces.pose import Pose
from trees.engine.errors import NodeError
from trees.framed_pose import BRACKET, FRAMES, TOOL, TRAY, WORLD, FramedPose
from trees.nodes.services import Services

FINGERS_DOWN = Pose((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))  # a pose's z points upwards, the tool's along the fingers
BRACKET_GAP_M = 0.10  # nothing is let go this near to the bracket's middle line but by PlacePart, which is guarded


def frame_pose(services: Services, frame: str) -> Pose:
    """world_from_frame.

    Raises:
        NodeError: the cell has no such frame.
    """
    bench, product = services.bench, services.product
    if frame == WORLD:
        return Pose((0.0, 0.0, 0.0))
    if frame == TRAY:
        return Pose(bench.tray.centre_m)
    if frame == BRACKET:
        return bench.bracket.pose
    if frame == TOOL:
        return tool_pose(services)
    if frame in product.bracket.holes_m:
        x, y = product.bracket.holes_m[frame]
        return bench.bracket.pose @ Pose((x, y, 0.0))
    raise NodeError(f"the cell has no frame '{frame}'; one of {', '.join((*FRAMES, *product.positions))}")


def tool_pose(services: Services) -> Pose:
    """Where the tool (TCP) is, its z upwards as in files."""
    joints = np.array(services.observation.arm.positions_rad)
    return services.motion.kinematics.forward(joints) @ FINGERS_DOWN


def world_pose(services: Services, pose: FramedPose) -> Pose:
    """The pose in the world, z as the file has it."""
    return frame_pose(services, pose.frame) @ pose.pose


def world_from_tool(services: Services, pose: FramedPose) -> Pose:
    """Where the tool goes for a pose of a file: not turned, the fingers point down."""
    return world_pose(services, pose) @ FINGERS_DOWN


def near_bracket(services: Services, world: Pose) -> bool:
    """Whether a part that is let go there could fall into a hole."""
    x, y, _ = (services.bench.bracket.pose.inverse() @ world).position_m
    holes = services.product.bracket.holes_m.values()
    return any(abs(x - hole_x) < BRACKET_GAP_M and abs(y - hole_y) < BRACKET_GAP_M for hole_x, hole_y in holes)
