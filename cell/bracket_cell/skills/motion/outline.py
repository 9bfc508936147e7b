"""The arm and its gripper as simple shapes in the frames of their links, for drawing them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import coal
import numpy as np
import pinocchio
from numpy.typing import NDArray

from bracket_cell.skills.motion.postures import axis_of, slides
from bracket_ground.interfaces.bench import Bench, Obstacle
from bracket_ground.interfaces.pose import Array, Pose

BASE, WORLD = "base_link", "world"
ROUND = 4  # faces in a quarter of a turn, where a round shape is drawn


@dataclass(frozen=True)
class Joint:
    """A joint between two links.

    Attributes:
        parent, child: names of the links' frames.
        parent_from_child: at 0.
        axis: unit vector in the child's frame about which it turns, or along which it slides.
        slides: it does.
    """

    parent: str
    child: str
    parent_from_child: Pose
    axis: tuple[float, float, float]
    slides: bool = False


@dataclass(frozen=True, eq=False)
class Shape:
    """A box or a convex hull that moves with a link.

    Attributes:
        name: of the part of the robot.
        frame: of the link.
        frame_from_shape: where it is in that frame.
        box_m: full extents of a box, else None.
        points_m: (n, 3) corners of a hull, empty for a box.
        triangles: (k, 3) numbers of corners.
    """

    name: str
    frame: str
    frame_from_shape: Pose
    box_m: tuple[float, float, float] | None = None
    points_m: Array = field(default_factory=lambda: np.empty((0, 3)), repr=False)
    triangles: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 3), np.int64), repr=False)


def chain(model: pinocchio.Model) -> tuple[Joint, ...]:
    """The joints from base to wrist, in the order of joint angles."""
    links, found = _links(model), []
    for number in range(1, model.njoints):
        along = slides(model, number)
        x, y, z = axis_of(model, number)[:3] if along else axis_of(model, number)[3:]
        pose = Pose.from_matrix(model.jointPlacements[number].homogeneous)
        found.append(Joint(links[model.parents[number]], links[number], pose, (float(x), float(y), float(z)), along))
    return tuple(found)


def shapes(model: pinocchio.Model, geometry: pinocchio.GeometryModel) -> tuple[Shape, ...]:
    """What of a collision geometry belongs to the robot."""
    links = _links(model)
    return tuple(_shape(item, links[item.parentJoint]) for item in geometry.geometryObjects)


def obstacle_shapes(bench: Bench) -> tuple[Shape, ...]:
    """The obstacles of a bench, in the world: boxes as they are, all else as convex hulls."""
    return tuple(_obstacle(obstacle) for obstacle in bench.obstacles)


def _obstacle(obstacle: Obstacle) -> Shape:
    if obstacle.box_m is not None:
        return Shape(obstacle.name, WORLD, obstacle.pose, obstacle.box_m)
    points = coal.StdVec_Vec3s()
    for point in obstacle.points_m:
        points.append(point)
    hull = coal.Convex.convexHull(points, True, "Qt")
    return _shape(pinocchio.GeometryObject(obstacle.name, 0, pinocchio.SE3.Identity(), hull), WORLD)


def _shape(item: pinocchio.GeometryObject, frame: str) -> Shape:
    pose = Pose.from_matrix(item.placement.homogeneous)
    if isinstance(item.geometry, coal.Box):
        x, y, z = (2 * float(half) for half in item.geometry.halfSide)
        return Shape(item.name, frame, pose, (x, y, z))
    hull = item.geometry if isinstance(item.geometry, coal.ConvexBase) else _turned(item.geometry)
    points = np.array([hull.point(number) for number in range(hull.num_points)])
    corners = (hull.polygons(number) for number in range(hull.num_polygons))
    triangles = np.array([[corner[0], corner[1], corner[2]] for corner in corners], np.int64)
    return Shape(item.name, frame, pose, None, points, triangles)


def _turned(shape: coal.ShapeBase) -> coal.ConvexBase:
    """Hull around a cylinder, a cone, a sphere or a capsule: its outline (radius, height) turned about z."""
    half, radius = getattr(shape, "halfLength", 0.0), shape.radius
    if isinstance(shape, coal.Cylinder):
        outline = np.array([[radius, -half], [radius, half]])
    elif isinstance(shape, coal.Cone):
        outline = np.array([[radius, -half], [0.0, half]])
    else:
        angles = np.linspace(-math.pi / 2, math.pi / 2, 2 * ROUND)
        rise = np.sign(angles) * half
        outline = np.column_stack([radius * np.cos(angles), radius * np.sin(angles) + rise])
    points = coal.StdVec_Vec3s()
    for turn in np.arange(4 * ROUND) * math.pi / (2 * ROUND):
        for away, height in outline:
            points.append(np.array([away * math.cos(turn), away * math.sin(turn), height]))
    return coal.Convex.convexHull(points, True, "Qt")


def _links(model: pinocchio.Model) -> dict[int, str]:
    """The link that stands in each joint's own frame, by number of the joint."""
    found = {0: BASE}
    for frame in model.frames:
        own = frame.type == pinocchio.FrameType.BODY and frame.placement.isIdentity()
        if own and frame.parentJoint:
            found.setdefault(frame.parentJoint, frame.name)
    return found
