"""An arm by its file alone: what is wrong or missing, what touches at rest, what it reaches of a bench; a drawing."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from pathlib import Path

import numpy as np
import pinocchio

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.runs.bench_view import BenchView
from bracket_cell.skills.motion.collision import CollisionChecker
from bracket_cell.skills.motion.outline import Shape
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.skills.motion.postures import misplaced_flange
from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.files.files import read_text
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import RobotModel, complete, load_robot
from bracket_ground.interfaces.urdf import element, likely_flange

URDF, XACRO, SRDF = ".urdf", ".xacro", ".srdf"
SIZE_PX, EDGE_PX = 700, 40
FROM = np.array([[-0.6, 0.8, 0.0], [-0.4, -0.3, 0.866], [0.69, 0.52, 0.5]])  # right, up and towards who looks
SOLID = np.array([[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]])  # sides of a box


def is_robot(file: Path) -> bool:
    """Whether a file describes an arm: a URDF, or YAML that names one."""
    from bracket_ground.files.yaml_file import has_key

    return file.suffix in (URDF, XACRO, SRDF) or (file.suffix in (".yaml", ".yml") and has_key(file, "urdf"))


@dataclass
class RobotView:
    """Looks at an arm on the bench of a configuration; nothing is opened.

    Attributes:
        file: a robot's file, or a URDF, whose flange is guessed.
        problems: what keeps the arm from being used, or is out of its reach, in words.
        remarks: what was found, in words.
        picture: SVG of the arm at rest.

    Raises:
        InputError: with all that is wrong with its file.
    """

    file: Path
    config: Path
    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    picture: str = ""

    def __post_init__(self) -> None:
        try:
            robot = self._robot()
            self._look_at(robot)
        except (ValueError, IndexError, RuntimeError) as error:  # the libraries' own about a shape or an inertia
            if isinstance(error, InputError):
                raise
            words = " ".join(str(error).split()) or type(error).__name__
            for said in (self.file, self.file.resolve()):
                words = words.removeprefix(f"{said}: ")
            raise InputError(Problem(Place(self.file), words)) from None

    def _robot(self) -> RobotModel:
        if self.file.suffix not in (URDF, XACRO, SRDF):
            return load_robot(self.file.name, self.file.parent)
        flange = likely_flange(element(read_text(self.file), self.file))
        self.remarks.append(f"the flange is taken to be {flange!r}: `flange` of a robot's file names another")
        return complete(RobotModel(name=self.file.stem, urdf=str(self.file.resolve()), flange=flange))

    def _look_at(self, robot: RobotModel) -> None:
        configuration = load_configuration(self.config, rested=False)
        product = load_product(configuration, self.config)
        bench = configuration.bench.model_copy(update={"arm_look_rad": (), "arm_park_rad": ()})
        motion = MotionPlanner(product, bench, configuration.motion.of(robot, *configuration.timing_s))
        self.remarks += [*robot.remarks, *_joints(robot), *_unknown(robot)]
        home = motion.kinematics.usual_rad
        at_rest = _Posed(CollisionChecker(motion.kinematics, product, bench, motion.settings), home)
        tool_m = ", ".join(f"{value:.2f}" for value in motion.kinematics.position_m(home))
        self.remarks.append(f"at rest the tool is at ({tool_m}) m: {at_rest.touching or 'nothing touches'}")
        view = BenchView(bench, product, motion)
        self.problems += [*misplaced_flange(robot), *view.problems]
        self.remarks += view.remarks
        self.picture = at_rest.svg


def _joints(robot: RobotModel) -> list[str]:
    least, most = robot.limits_rad
    rows = zip(robot.joint_names, least, most, robot.speed_rad_s, strict=True)
    return [f"{name}: {low:.2f} to {high:.2f}, at most {speed:.2f} a second" for name, low, high, speed in rows]


def _unknown(robot: RobotModel) -> list[str]:
    """What was not said and has a default."""
    torques = [] if all(robot.torques_nm) else ["torque_nm (of the simulated joints)"]
    given = ("acceleration_rad_s2", "jerk_rad_s3", "home_rad")
    missing = [*(name for name in given if name not in robot.model_fields_set), *torques]
    return [f"not given, and chosen by the program: {', '.join(missing)}"] if missing else []


class _Posed:
    """An arm with its gripper in one posture."""

    def __init__(self, checker: CollisionChecker, joints_rad: Array) -> None:
        self._model, self._geometry = checker.model, checker.arm_with_part(0.001)
        self._shapes, self._joints_rad = checker.shapes, joints_rad

    @cached_property
    def touching(self) -> str:
        """Which shapes touch of links that do not carry each other, in words; empty where none do."""
        items = self._geometry.geometryObjects
        for first, second in combinations(range(len(items) - 1), 2):
            if abs(items[first].parentJoint - items[second].parentJoint) > 1:
                self._geometry.addCollisionPair(pinocchio.CollisionPair(first, second))
        results, data = self._geometry.createData(), self._model.createData()
        pinocchio.computeCollisions(self._model, data, self._geometry, results, self._joints_rad, False)
        pairs = zip(self._geometry.collisionPairs, results.collisionResults, strict=True)
        found = [(items[pair.first].name, items[pair.second].name) for pair, met in pairs if met.isCollision()]
        return ", ".join(f"{first} touches {second}" for first, second in found)

    @cached_property
    def svg(self) -> str:
        """The drawing, seen from the front and above; what is nearer hides what is behind it."""
        data = self._model.createData()
        pinocchio.framesForwardKinematics(self._model, data, self._joints_rad)
        faces = [face for shape, place in zip(self._shapes, self._places(data), strict=True)
                 for face in _faces(shape, place)]  # fmt: skip
        faces.sort(key=lambda face: float((face @ FROM[2]).mean()))
        return _document([face @ FROM.T for face in faces])

    def _places(self, data: pinocchio.Data) -> list[Array]:
        items = self._geometry.geometryObjects[: len(self._shapes)]
        return [(data.oMi[item.parentJoint] * item.placement).homogeneous for item in items]


def _faces(shape: Shape, place: Array) -> list[Array]:
    """Corners (k, 3) of each face in the world."""
    points_m, triangles = shape.points_m, shape.triangles
    if shape.box_m is not None:
        points_m = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(shape.box_m) / 2
        triangles = SOLID
    placed = points_m @ place[:3, :3].T + place[:3, 3]
    return [placed[face] for face in triangles]


def _document(faces: list[Array]) -> str:
    """Faces (k, 3) as who looks has them, the farthest first, in an image of SIZE_PX."""
    flat = np.concatenate(faces)[:, :2]
    low, size = flat.min(axis=0), float(np.ptp(flat, axis=0).max()) or 1.0
    scale = (SIZE_PX - 2 * EDGE_PX) / size
    drawn = []
    for face in faces:
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        light = abs(normal[2] + normal[1] / 2) / (np.linalg.norm(normal) * 1.12 + 1e-12)
        points = EDGE_PX + scale * (face[:, :2] - low)
        shown = " ".join(f"{x:.1f},{SIZE_PX - y:.1f}" for x, y in points)
        drawn.append(f'<polygon points="{shown}" fill="hsl(210,25%,{30 + 50 * light:.0f}%)"/>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE_PX} {SIZE_PX}" width="{SIZE_PX}" '
        f'height="{SIZE_PX}"><rect width="100%" height="100%" fill="white"/>' + "".join(drawn) + "</svg>\n"
    )
