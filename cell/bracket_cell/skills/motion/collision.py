"""Collision checks of trajectories: arm, gripper and held part against bench and parts (Pinocchio and coal)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from itertools import product as pairs_of
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio

from bracket_cell.skills.motion.kinematics import Kinematics, LinkPlaces
from bracket_cell.skills.motion.outline import Shape, shapes
from bracket_cell.skills.motion.postures import axis_of
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.bench import Bench, Obstacle
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.urdf import FLANGE

CAMERA_SIZE_M = (0.050, 0.030, 0.030)
CAMERA_BEHIND_LENS_M = 0.020

STEP_M = 0.008  # between checks of a path: twice the margin, so that nothing in between is nearer than 0
ARC_RAD = 0.1  # a joint's turn in which a point goes nearly straight
COARSE_FIRST = (0, 4, 2, 6, 1, 5, 3, 7)  # offsets in a path, so that a contact is met soon
TABLE_M = (3.0, 3.0, 0.5)
RIM_THICKNESS_M = 0.008
LEAST_M = 0.001  # of a place that is a spot of the table
BIN_ROOM_M = 0.04  # around each part in a bin

HELD = "held part"
LEAST_DEPTH = 1e-9  # of a mesh, in its own units
LEAST_REACH_M = 0.05  # of what a joint carries: none is thinner
BASE_JOINTS = 2  # what base, shoulder and upper arm carry is not compared with what stands on the bench
WRIST_JOINTS = 3  # the last ones, whose links lie beside what the gripper holds
ALWAYS = 0.9  # share of postures in which two links touch that belong together
POSTURES = 40  # that tell: two links free in half of them are taken for such with a chance of 1e-7


@dataclass(frozen=True)
class Box:
    """A box that must not be touched, or that is carried along.

    Attributes:
        name: what the operator reads.
        pose: of the box's centre; in the world, or in the tool frame when it is carried.
        size_m: full extents.
    """

    name: str
    pose: Pose
    size_m: tuple[float, float, float]


class CollisionChecker:
    """Checks whole joint paths; what stands still on the bench is always an obstacle.

    Attributes:
        shapes: arm and gripper as they are checked, for drawing them.
        standing_m: see `standing_m`.
    """

    def __init__(
        self, kinematics: Kinematics, product: Product, bench: Bench, settings: MotionSettings | None = None
    ) -> None:
        self._settings = settings or MotionSettings()
        self._model = kinematics.model
        self._data = self._model.createData()
        self._tcp_m = self._settings.gripper.tcp_from_flange_m
        flange = self._model.frames[self._model.getFrameId(FLANGE)]
        self._wrist, self._wrist_from_flange = flange.parentJoint, flange.placement
        self._geometry = self._arm_geometry()
        self._add_tool(bench.wrist.mount.pose)
        self._arm_alone = self._geometry.copy()
        self._arm = tuple(item.parentJoint for item in self._geometry.geometryObjects)
        self.shapes: tuple[Shape, ...] = shapes(self._model, self._geometry)
        _add_pairs(self._geometry, _self_pairs(self._model, self._geometry, kinematics.limits_rad))
        for name, pose, shape in _standing(product, bench):
            self._add_obstacle(self._geometry, name, pose, shape)
        self.standing_m = standing_m(product, bench)

    @property
    def model(self) -> pinocchio.Model:
        """Of the arm."""
        return self._model

    def arm_with_part(self, radius_m: float) -> pinocchio.GeometryModel:
        """Arm and gripper with open fingers, and a sphere HELD around the TCP."""
        geometry = self._arm_alone.copy()
        self._open_fingers(geometry, self._settings.gripper.stroke_m)
        placement = self._on_flange((0.0, 0.0, self._tcp_m))
        geometry.addGeometryObject(pinocchio.GeometryObject(HELD, self._wrist, placement, coal.Sphere(radius_m)))
        return geometry

    def scene(
        self, opening_m: float, obstacles: Sequence[Box] = (), held: Sequence[Box] = (), margin_m: float = 0.0
    ) -> Scene:
        """The bench with what else is to be kept clear of.

        Args:
            opening_m: distance between the fingers.
            obstacles: more boxes to keep clear of, in the world frame.
            held: boxes that move with the tool, in the tool frame.
            margin_m: what comes nearer than this counts as touching.
        """
        geometry = self._geometry.copy()
        self._open_fingers(geometry, opening_m)
        for box in obstacles:
            self._add_obstacle(geometry, box.name, box.pose, coal.Box(*box.size_m))
        fixed = range(len(self._arm), len(geometry.geometryObjects))
        links = [number for number, joint in enumerate(self._arm) if joint <= self._wrist - WRIST_JOINTS]
        for number, box in enumerate(held):
            name = f"{box.name} in the gripper" + (f" ({number})" if number else "")
            placement = self._on_flange((0.0, 0.0, self._tcp_m)) * _se3(box.pose)
            own = geometry.addGeometryObject(
                pinocchio.GeometryObject(name, self._wrist, placement, coal.Box(*box.size_m))
            )
            for other in (*fixed, *links):
                geometry.addCollisionPair(pinocchio.CollisionPair(own, other))
        return Scene(self._model, geometry, margin_m)

    def first_contact(
        self,
        positions_rad: Array,
        opening_m: float,
        obstacles: Sequence[Box] = (),
        held: Sequence[Box] = (),
        margin_m: float = 0.0,
    ) -> str | None:
        """What touches first along a joint path (k, n), in words; None where the way is free; see `scene`."""
        return self.scene(opening_m, obstacles, held, margin_m).first_contact(positions_rad)

    def _open_fingers(self, geometry: pinocchio.GeometryModel, opening_m: float) -> None:
        for name, (centre, _) in self._settings.gripper.moving(opening_m).items():
            geometry.geometryObjects[geometry.getGeometryId(name)].placement = self._on_flange(centre)

    def _arm_geometry(self) -> pinocchio.GeometryModel:
        urdf = self._settings.robot.urdf_text
        _require_solid(urdf)
        drawn = pinocchio.buildGeomFromUrdfString(self._model, urdf, pinocchio.GeometryType.COLLISION)
        geometry, shapes_of = pinocchio.GeometryModel(), Counter[str]()
        for item in drawn.geometryObjects:
            shape = item.geometry
            if isinstance(shape, coal.BVHModelBase):
                shape.buildConvexHull(True, "Qt")
                shape = shape.convex
            link = self._model.frames[item.parentFrame].name
            name = f"{link} ({shapes_of[link]})" if shapes_of[link] else link
            shapes_of[link] += 1
            geometry.addGeometryObject(pinocchio.GeometryObject(name, item.parentJoint, item.placement, shape))
        return geometry

    def _add_tool(self, tool_from_camera: Pose) -> None:
        x, y, z = tool_from_camera.position_m
        gripper = self._settings.gripper
        boxes = {
            "palm": gripper.palm,
            **{name: ((0.0, 0.0, at[2]), size) for name, (at, size) in gripper.moving(0.0).items()},
            "camera": ((x, y, z + self._tcp_m - CAMERA_BEHIND_LENS_M), CAMERA_SIZE_M),
        }
        for name, (centre, size) in boxes.items():
            self._geometry.addGeometryObject(
                pinocchio.GeometryObject(name, self._wrist, self._on_flange(centre), coal.Box(*size))
            )

    def _on_flange(self, position_m: tuple[float, float, float]) -> pinocchio.SE3:
        return self._wrist_from_flange * pinocchio.SE3(np.eye(3), np.array(position_m))

    def _add_obstacle(
        self, geometry: pinocchio.GeometryModel, name: str, pose: Pose, shape: coal.CollisionGeometry
    ) -> None:
        own = geometry.addGeometryObject(pinocchio.GeometryObject(name, 0, _se3(pose), shape))
        for link, joint in enumerate(self._arm):
            if joint > BASE_JOINTS:
                geometry.addCollisionPair(pinocchio.CollisionPair(link, own))


@dataclass(frozen=True)
class Contact:
    """Two things that touch.

    Attributes:
        by_tool: what hangs on the last joint touches what stands: it does so however the arm leans.
    """

    words: str
    by_tool: bool


class Scene:
    """The arm among all that it must not touch, ready to be asked about many postures."""

    def __init__(self, model: pinocchio.Model, geometry: pinocchio.GeometryModel, margin_m: float) -> None:
        self._model, self._data = model, model.createData()
        self._geometry, self._results = geometry, geometry.createData()
        for request in self._results.collisionRequests:
            request.security_margin = margin_m
        self._near = pinocchio.BroadPhaseManager_NaiveCollisionManager(model, geometry, self._results)
        moving = [item for item in geometry.geometryObjects if item.parentJoint > 0]
        self._places = LinkPlaces(model, [box.parentJoint for box in moving], [box.placement for box in moving])
        self._corners = np.array([box_corners(box.geometry) for box in moving])
        self._carried = np.array([box.parentJoint for box in moving])
        self._points = model.frames[model.getFrameId(FLANGE)].placement.rotation[:, 2]

    def reaches_m(self, postures_rad: Array) -> Array:
        """(n,) how far the arm's points are from what each joint moves them about, at most in these postures (k, n)."""
        placed = self._places.at(postures_rad)
        corners_m = self._corners @ placed[..., :3, :3].swapaxes(-1, -2) + placed[..., None, :3, 3]
        reaches = np.full(self._model.nq, LEAST_REACH_M)
        for posture, points in zip(postures_rad, corners_m, strict=True):
            for number, (axis, at_m) in enumerate(self._axes(posture)):
                off = points[self._carried > number].reshape(-1, 3) - at_m
                far = np.linalg.norm(np.cross(off, axis), axis=1).max(initial=0.0) if axis.any() else 1.0
                reaches[number] = max(reaches[number], far)
        return reaches

    def tilts(self, postures_rad: Array) -> Array:
        """(2k, n) how the tool's axis tips over while each joint turns, in these postures (k, n)."""
        rows = []
        for posture in postures_rad:
            axes = np.array([axis for axis, _ in self._axes(posture)])
            tool = self._data.oMi[self._model.nq].rotation @ self._points
            across = np.linalg.svd(tool[np.newaxis])[2][1:]
            rows.append(across @ np.cross(axes, tool).T)
        return np.concatenate(rows)

    def tool_axis(self, joints_rad: Array) -> Array:
        """(3,) where the tool points in the world, in a posture (n,)."""
        pinocchio.forwardKinematics(self._model, self._data, joints_rad)
        axis: Array = self._data.oMi[self._model.nq].rotation @ self._points
        return axis

    def _axes(self, joints_rad: Array) -> list[tuple[Array, Array]]:
        """Of each joint: the axis that it turns about, 0 for one that slides, and a point of it, in the world."""
        pinocchio.forwardKinematics(self._model, self._data, joints_rad)
        places = (self._data.oMi[number] for number in range(1, self._model.njoints))
        return [
            (place.rotation @ axis_of(self._model, number)[3:], place.translation.copy())
            for number, place in enumerate(places, 1)
        ]

    def touches(self, joints_rad: Array) -> bool:
        """Whether anything does in a posture (n,)."""
        return bool(pinocchio.computeCollisions(self._model, self._data, self._near, joints_rad, True))

    def touches_pair_by_pair(self, joints_rad: Array) -> bool:
        """The same, slowly; of the pairs up to the first one that touches it is known then."""
        collides = pinocchio.computeCollisions
        return bool(collides(self._model, self._data, self._geometry, self._results, joints_rad, True))

    def contact(self, joints_rad: Array) -> Contact | None:
        """Which two things touch in a posture (n,)."""
        if not self.touches_pair_by_pair(joints_rad):
            return None
        pairs = zip(self._geometry.collisionPairs, self._results.collisionResults, strict=True)
        touching = next(pair for pair, result in pairs if result.isCollision())
        first, second = (self._geometry.geometryObjects[number] for number in (touching.first, touching.second))
        by_tool = first.parentJoint == self._model.njoints - 1 and second.parentJoint == 0
        return Contact(f"{first.name} would touch {second.name}".replace("_", " "), by_tool)

    def is_free(self, positions_rad: Array) -> bool:
        """Whether nothing touches along a joint path (k, n)."""
        rows = self.resampled(positions_rad)
        return not any(self.touches(joints) for offset in COARSE_FIRST for joints in rows[offset :: len(COARSE_FIRST)])

    def first_contact(self, positions_rad: Array) -> str | None:
        """What touches first along a joint path (k, n), in words; None where the way is free."""
        rows = self.resampled(positions_rad)
        found = next((self.contact(joints) for joints in rows if self.touches(joints)), None)
        return None if found is None else found.words

    def resampled(self, positions_rad: Array) -> Array:
        """A path (m, joints) through the same line, no point of the arm going farther than STEP_M from row to row."""
        rows = _interpolated(positions_rad, np.abs(np.diff(positions_rad, axis=0)).max(axis=1), ARC_RAD)
        placed = self._places.at(rows)
        corners_m = self._corners @ placed[..., :3, :3].swapaxes(-1, -2) + placed[..., None, :3, 3]
        ways_m = np.linalg.norm(np.diff(corners_m, axis=0), axis=3).max(axis=(1, 2), initial=0.0)
        return _interpolated(rows, ways_m, STEP_M)


def _interpolated(positions_rad: Array, ways: Array, step: float) -> Array:
    """A path (m, joints) through the same line in even steps, by how long the ways (n - 1,) between its rows are."""
    travelled = np.concatenate([[0.0], np.cumsum(ways)])
    marks = np.linspace(0.0, travelled[-1], max(2, math.ceil(travelled[-1] / step) + 1))
    return np.column_stack([np.interp(marks, travelled, column) for column in positions_rad.T])


def box_corners(shape: coal.CollisionGeometry) -> Array:
    """Of the box (8, 3) around a shape, in its own frame."""
    shape.computeLocalAABB()
    low, high = shape.aabb_local.min_, shape.aabb_local.max_
    return np.array(list(pairs_of(*zip(low, high, strict=True))))


def standing_boxes(product: Product, bench: Bench) -> tuple[Box, ...]:
    """Table, bracket, tray and places with their rims, and the person's bins with what they may hold."""
    table = Box("the table", Pose((0.6, 0.0, -TABLE_M[2] / 2)), TABLE_M)
    bins = (_bin_box(product, bench, name) for name in product.assembled)
    tray = _with_rim("the tray", Pose(bench.tray.centre_m), bench.tray.size_m, bench.tray.wall_m)
    return (table, _bracket_box(product, bench), *tray, *bins, *_place_boxes(product, bench))


def standing_m(product: Product, bench: Bench) -> dict[str, Array]:
    """Corners (8, 3) of boxes around all that stands on the bench, by name."""
    return {name: pose.transform(box_corners(shape)) for name, pose, shape in _standing(product, bench)}


def _standing(product: Product, bench: Bench) -> Iterator[tuple[str, Pose, coal.CollisionGeometry]]:
    for box in standing_boxes(product, bench):
        yield box.name, box.pose, coal.Box(*box.size_m)
    for obstacle in bench.obstacles:
        yield obstacle.name, *placed(obstacle)


def part_box(part: PartDetection, product: Product, name: str) -> Box:
    """A seen part that stands on its peg, as one box down to the floor; what lies is a box on it already."""
    below_m = product.parts[part.part].peg_length_m if part.upright else 0.0
    return body_box(name, part.world_from_part, part.size_m, below_m)


def body_box(name: str, pose: Pose, size_m: tuple[float, float, float], below_m: float = 0.0) -> Box:
    """A body given by its part frame as one box, reaching `below_m` under its bottom."""
    length, width, height = size_m
    centre = pose @ Pose((0.0, 0.0, (height - below_m) / 2))
    return Box(name, centre, (length, width, height + below_m))


def placed(obstacle: Obstacle) -> tuple[Pose, coal.CollisionGeometry]:
    """An obstacle's pose and shape."""
    if obstacle.box_m is not None:
        return obstacle.pose, coal.Box(*obstacle.box_m)
    if obstacle.cylinder_m is not None:
        return obstacle.pose, coal.Cylinder(obstacle.cylinder_m[0] / 2, obstacle.cylinder_m[1])
    points = coal.StdVec_Vec3s()
    for point in obstacle.points_m:
        points.append(point)
    return Pose((0.0, 0.0, 0.0)), coal.Convex.convexHull(points, True, "Qt")


def _bracket_box(product: Product, bench: Bench) -> Box:
    holes = np.array(list(product.bracket.holes_m.values()))
    low, high = holes.min(axis=0) - product.bracket.margin_m, holes.max(axis=0) + product.bracket.margin_m
    top = bench.bracket.position_m[2]
    middle = (low + high) / 2
    pose = bench.bracket.pose @ Pose((float(middle[0]), float(middle[1]), -top / 2))
    return Box("the bracket", pose, (float(high[0] - low[0]), float(high[1] - low[1]), top))


def _bin_box(product: Product, bench: Bench, name: str) -> Box:
    part = product.parts[name]
    x, y, floor = bench.bins_m[name]
    height = floor + part.peg_length_m + part.size_m[2]
    size = (part.size_m[0] + BIN_ROOM_M, (part.size_m[1] + BIN_ROOM_M) * part.quantity, height)
    return Box(f"the bin of {part.title}s", Pose((x, y, height / 2)), size)


def _place_boxes(product: Product, bench: Bench) -> Iterator[Box]:
    for name, place in bench.places.items():
        size_m = place.size_m(product.longest_m(place.holds))
        yield from _with_rim(name, place.pose, size_m, place.wall_m)


def _with_rim(name: str, pose: Pose, size_m: tuple[float, float], wall_m: float) -> tuple[Box, ...]:
    """What stands on the table, up to its upper side, and the rim around that."""
    (length, width), floor, thick = size_m, max(pose.position_m[2], LEAST_M), RIM_THICKNESS_M
    foot = Box(name, pose @ Pose((0.0, 0.0, -floor / 2)), (length, width, floor))
    if wall_m == 0:
        return (foot,)
    height, outer_length, outer_width = floor + wall_m, length + 2 * thick, width + 2 * thick
    middle = (wall_m - floor) / 2
    walls = [
        ((-(length + thick) / 2, 0.0, middle), (thick, outer_width, height)),
        (((length + thick) / 2, 0.0, middle), (thick, outer_width, height)),
        ((0.0, -(width + thick) / 2, middle), (outer_length, thick, height)),
        ((0.0, (width + thick) / 2, middle), (outer_length, thick, height)),
    ]
    rim = (Box(f"{name}'s rim ({number})", pose @ Pose(at), size) for number, (at, size) in enumerate(walls))
    return (foot, *rim)


def _add_pairs(geometry: pinocchio.GeometryModel, pairs: Iterable[tuple[int, int]]) -> None:
    for first, second in pairs:
        geometry.addCollisionPair(pinocchio.CollisionPair(first, second))


def _require_solid(urdf_text: str) -> None:
    """Check that the meshes of a URDF can be read and have a volume, which their hulls need.

    Raises:
        ValueError: with those of which one is no such mesh.
    """
    names = dict.fromkeys(mesh.get("filename", "") for mesh in ElementTree.fromstring(urdf_text).iter("mesh"))
    if wrong := [name for name in names if not _is_solid(name)]:
        raise ValueError(f"{', '.join(wrong)}: no mesh that can be read and has a volume (STL, OBJ or Collada)")


def _is_solid(mesh: str) -> bool:
    try:
        points = coal.MeshLoader().load(mesh, np.ones(3)).vertices()
    except (ValueError, IndexError, RuntimeError):
        return False
    return bool(np.isfinite(points).all()) and np.linalg.matrix_rank(points - points[0], tol=LEAST_DEPTH) == 3


def _self_pairs(model: pinocchio.Model, geometry: pinocchio.GeometryModel, limits_rad: Array) -> list[tuple[int, int]]:
    """Shapes of the arm that can meet: neither neighbours on the chain nor such as touch in nearly all postures."""
    joints = [item.parentJoint for item in geometry.geometryObjects]
    pairs = [(a, b) for a, b in combinations(range(len(joints)), 2) if abs(joints[a] - joints[b]) > 1]
    tried = geometry.copy()
    _add_pairs(tried, pairs)
    data, results, touching = model.createData(), tried.createData(), np.zeros(len(pairs))
    low, high = limits_rad
    for posture in np.random.default_rng(0).uniform(low, high, (POSTURES, len(low))):
        pinocchio.computeCollisions(model, data, tried, results, posture, False)
        touching += [result.isCollision() for result in results.collisionResults]
    return [pair for pair, often in zip(pairs, touching / POSTURES, strict=True) if often < ALWAYS]


def _se3(pose: Pose) -> pinocchio.SE3:
    return pinocchio.SE3(pose.rotation, np.array(pose.position_m))
