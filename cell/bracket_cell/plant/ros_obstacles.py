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
BOX, SPHERE = 1, 2  # shape_msgs/SolidPrimitive
NUMBERS = {BOX: 3, SPHERE: 1, 3: 2, 4: 2}  # of each type; 3 and 4 are cylinders and cones: height, radius
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
        except ValidationError as error:
            wrong = error.errors()[0]
            where = ".".join(map(str, wrong["loc"])) or "it"
            left_out.append(f"{thing.id}: {where} is {wrong['input']!r}, which bench.obstacles does not take")
        except ValueError as error:
            left_out.append(f"{thing.id}: {error}")
        left_out += [f"{thing.id}: a plane has no end"] * len(thing.planes)
    if answer.scene.world.octomap.octomap.data:
        left_out.append("the octomap: it changes with what the cameras see")
    return found, left_out


def _shapes(thing: Any) -> Iterator[tuple[Pose, dict[str, Any]]]:
    """Pose and size of each shape; raises ValueError of one that is none."""
    own = pose_of(thing.pose.position, thing.pose.orientation)
    if len(thing.primitives) != len(thing.primitive_poses) or len(thing.meshes) != len(thing.mesh_poses):
        raise ValueError("it has not as many poses as shapes")
    for solid, at in zip(thing.primitives, thing.primitive_poses, strict=True):
        if len(solid.dimensions) < NUMBERS.get(solid.type, 0) or solid.type not in NUMBERS:
            raise ValueError(f"a shape of type {solid.type} with {len(solid.dimensions)} numbers is not known")
        yield own @ pose_of(at.position, at.orientation), _size(solid.type, list(solid.dimensions))
    for mesh, at in zip(thing.meshes, thing.mesh_poses, strict=True):
        if not mesh.vertices:
            raise ValueError("a mesh has no corners")
        points = np.array([[point.x, point.y, point.z] for point in mesh.vertices])
        low, high = points.min(axis=0), points.max(axis=0)
        middle = Pose(tuple(((low + high) / 2).tolist()))
        yield own @ pose_of(at.position, at.orientation) @ middle, {"box_m": tuple((high - low).tolist())}


def _size(kind: int, numbers: list[float]) -> dict[str, Any]:
    """A box by its extents, all else by the cylinder around it."""
    if kind == BOX:
        return {"box_m": tuple(numbers)}
    radius_m, height_m = (numbers[0], 2 * numbers[0]) if kind == SPHERE else (numbers[1], numbers[0])
    return {"cylinder_m": (2 * radius_m, height_m)}


def _obstacle(name: str, base: Pose, pose: Pose, size: dict[str, Any]) -> Obstacle:
    placed = base @ pose
    at = {"position_m": placed.position_m, "quaternion_wxyz": placed.quaternion_wxyz}
    return Obstacle.model_validate({"name": name or "an obstacle", **at, **size})
