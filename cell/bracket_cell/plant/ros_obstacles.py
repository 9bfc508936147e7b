"""What stands on the bench by MoveIt's planning scene: its service get_planning_scene is asked once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import ValidationError

from bracket_cell.plant.dds import Node
from bracket_cell.plant.ros_frames import Frames, pose_of
from bracket_cell.plant.ros_services import Caller
from bracket_cell.plant.ros_types import message
from bracket_cell.skills.drivers.settings import Ros2ArmSettings
from bracket_cell.skills.motion.outline import BASE
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Obstacle
from bracket_ground.interfaces.pose import Pose

SERVICE = "moveit_msgs/srv/GetPlanningScene"
GEOMETRY = 16 | 8  # PlanningSceneComponents: WORLD_OBJECT_GEOMETRY, WORLD_OBJECT_NAMES
ANSWER_S, TOLD_S = 5.0, 2.0  # of move_group; of a frame on /tf_static


def planning_scene(settings: Ros2ArmSettings) -> tuple[list[Obstacle], list[str]]:
    """Obstacles in the frame of the arm's base, and what was left out, in words.

    Spheres, cones and meshes are taken by the box or cylinder around them.

    Raises:
        InputError: no move_group answers.
    """
    node, name = Node(settings), f"{settings.namespace}/get_planning_scene"
    frames, caller = Frames(node), Caller(node, name, SERVICE, settings.middleware)
    answer = caller.call(ANSWER_S, components=message("moveit_msgs/msg/PlanningSceneComponents")(GEOMETRY))
    if answer is None:
        raise InputError(f"no node answers {name} in domain {settings.domain}: is move_group running?")
    found, left_out = list[Obstacle](), list[str]()
    for thing in answer.scene.world.collision_objects:
        frame = thing.header.frame_id.strip("/")
        base = frames.pose(f"{settings.prefix}{BASE}", frame, TOLD_S)
        if base is None:
            left_out.append(f"{thing.id}: /tf tells no way from {settings.prefix}{BASE} to its frame {frame!r}")
            continue
        try:
            found += [_obstacle(thing.id, base, *shape) for shape in _shapes(thing)]
        except (ValidationError, ValueError, IndexError) as error:
            left_out.append(f"{thing.id}: {str(error).splitlines()[0]}")
        left_out += [f"{thing.id}: a plane has no end"] * len(thing.planes)
    if answer.scene.world.octomap.octomap.data:
        left_out.append("the octomap: it changes with what the cameras see")
    return found, left_out


def _shapes(thing: Any) -> Iterator[tuple[Pose, dict[str, Any]]]:
    """Pose and size of each shape; raises ValueError of one that is none."""
    own = pose_of(thing.pose.position, thing.pose.orientation)
    for solid, at in zip(thing.primitives, thing.primitive_poses, strict=True):
        pose, size = own @ pose_of(at.position, at.orientation), list(solid.dimensions)
        match solid.type:  # shape_msgs/SolidPrimitive: box, sphere, cylinder, cone
            case 1:
                yield pose, {"box_m": tuple(size)}
            case 2:
                yield pose, {"cylinder_m": (2 * size[0], 2 * size[0])}
            case 3 | 4:
                yield pose, {"cylinder_m": (2 * size[1], size[0])}
            case kind:
                raise ValueError(f"a shape of type {kind} is not known")
    for mesh, at in zip(thing.meshes, thing.mesh_poses, strict=True):
        points = np.array([[point.x, point.y, point.z] for point in mesh.vertices])
        low, high = points.min(axis=0), points.max(axis=0)
        middle = Pose(tuple(((low + high) / 2).tolist()))
        yield own @ pose_of(at.position, at.orientation) @ middle, {"box_m": tuple((high - low).tolist())}


def _obstacle(name: str, base: Pose, pose: Pose, size: dict[str, Any]) -> Obstacle:
    placed = base @ pose
    at = {"position_m": placed.position_m, "quaternion_wxyz": placed.quaternion_wxyz}
    return Obstacle.model_validate({"name": name or "an obstacle", **at, **size})
