"""The robot as data: its URDF, the limits of its joints, its tool; everything that must know an arm reads this."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo

from bracket_ground.files.files import read_text, shipped
from bracket_ground.files.model import Model
from bracket_ground.files.units import Point
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.gripper import DEFAULT as GRIPPER
from bracket_ground.interfaces.gripper import NamedGripper, default_gripper
from bracket_ground.interfaces.places import Mount
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.urdf import FLANGE, chain_to, finished, mounted, parsed, solid_links, turning_joints

PACKAGE = "package://"
FOLDER = shipped("bracket_cell.config", "robots")
DEFAULT = "ur10"
WORLD_FROM_BASE = np.diag([-1.0, -1.0, 1.0, 1.0])  # the base of such rows is turned by half a turn against the URDF
SAME_RAD = 1e-9  # two angles are the same
SPEEDS_UP_S, JERKS_S = 0.5, 0.125  # to the full speed, to the full acceleration, where no file says
MOST_SPEED = {"rad": 50.0, "m": 10.0}  # a second; a value in degrees or millimetres is beyond it
ASKEW = 0.1  # so far beside its nominal direction a joint's axis is that of another arm

Positive = Annotated[float, Field(gt=0, le=100_000)]
Values = tuple[Positive, ...]
Angle = Annotated[float, Field(ge=-1000, le=1000)]
Range = Positive | tuple[Angle, Angle]
Offsets = tuple[float, ...]


class Calibration(Model):
    """Denavit-Hartenberg rows of one arm, with its own corrections: `cell setup teach robot` writes them.

    Attributes:
        theta_rad: what is added to each joint's angle.
        a_m, d_m, alpha_rad: lengths and twist of each row.
    """

    theta_rad: Offsets
    a_m: Offsets
    d_m: Offsets
    alpha_rad: Offsets

    def frames(self, joints_rad: Sequence[float] | Array = (0.0,)) -> Iterator[Array]:
        """In the world: the frame (4, 4) about whose z each joint turns, then the flange."""
        frame: Array = WORLD_FROM_BASE
        angles = np.array(joints_rad) + self.theta_rad
        for angle, a, d, alpha in zip(angles, self.a_m, self.d_m, self.alpha_rad, strict=True):
            yield frame
            c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
            row = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]]
            frame = frame @ np.array(row)
        yield frame


class Servos(Model):
    """How the simulated joints are driven; worked out from their torques where it is not given.

    Attributes:
        stiffness_nm_rad, armature_kg_m2, damping_nm_s_rad: of each joint.
    """

    stiffness_nm_rad: Values
    armature_kg_m2: Values
    damping_nm_s_rad: Values


class MotionLimits(Model):
    """Limits of motion as they are set in the controller; what is left out is not limited there.

    Attributes:
        joint_rad_s: of each joint.
        tool_m_s, elbow_m_s: of the TCP and of the elbow.
        momentum_kg_m_s: of all that moves, with the tool.
    """

    joint_rad_s: Values = ()
    tool_m_s: Positive | None = None
    elbow_m_s: Positive | None = None
    momentum_kg_m_s: Positive | None = None


class ReducedLimits(MotionLimits):
    """The same in reduced mode; the TCP's speed is that of ISO 10218-1 where nothing is given."""

    tool_m_s: Positive | None = 0.25


class SafetyLimits(Model):
    """The controller's safety configuration: beyond a limit it stops the arm, so the driver slows down before.

    Attributes:
        normal: limits as a rule.
        reduced: limits in reduced mode.
    """

    normal: MotionLimits = Field(default_factory=MotionLimits)
    reduced: ReducedLimits = Field(default_factory=ReducedLimits)


class RobotModel(Model):
    """An arm with its tool; values of joints from the base to the flange, of a linear axis in [m] instead of [rad].

    Attributes:
        name: for messages.
        urdf: file of the arm, whose flange six joints or more move; relative to this file, or package://ROBOT/... of a
            robot that is shipped. Its meshes: relative to the URDF, or package://PACKAGE/..., where PACKAGE is shipped
            or a folder that the URDF lies in. A link whose mesh is missing is a thick line in simulation; a real arm is
            refused.
        flange: link of the URDF that the gripper is mounted on, its z away from the arm; what hangs on it is left out.
        mount: where the arm's base is in the world, the table's top at z = 0; at the origin by default.
        origins_m: place (x, y, z) of joints in their parents' links, where it is another than in the URDF.
        calibration: the arm's own; without one it is as its maker publishes.
        range_rad: how far each joint turns, each way, or [least, most]; within the URDF's limits, which count alone
            where nothing is given.
        speed_rad_s: how fast each joint can turn, by the data sheet; as in the URDF where it is left out.
        acceleration_rad_s2: how soon each joint may be that fast, and how it brakes; by default within half a second.
        jerk_rad_s3: how soon each joint may speed up so; by default within an eighth of a second.
        torque_nm: of each joint at most; as in the URDF where it is left out.
        home_rad: a usual posture, with the tool down, that others are kept near to; found where it is left out,
            or beyond the limits.
        servos: of the simulated joints.
        safety: limits that are set in the controller's safety configuration.
        gripper: what is mounted on the flange: a gripper that is shipped, or a gripper file, relative to this file.
    """

    moved: ClassVar[Mapping[str, str]] = {"tool": "the gripper's file has the tool frame: gripper: FILE"}
    name: str
    urdf: str
    flange: str = FLANGE
    mount: Mount | None = None
    origins_m: dict[str, Point] = Field(default_factory=dict)
    calibration: Calibration | None = None
    range_rad: tuple[Range, ...] | None = None
    speed_rad_s: Values = ()
    acceleration_rad_s2: Values = ()
    jerk_rad_s3: Values = ()
    torque_nm: Values = ()
    home_rad: tuple[Angle, ...] = ()
    servos: Servos | None = None
    safety: SafetyLimits = Field(default_factory=SafetyLimits)
    gripper: NamedGripper = Field(default_factory=default_gripper, json_schema_extra={"default": GRIPPER})
    _version: tuple[int, ...] = PrivateAttr(())  # of the URDF's file as it was loaded; edited, it is another arm's

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Of the joints in the URDF."""
        return _joints(self.urdf_text)

    @property
    def joints(self) -> tuple[str, ...]:
        """What messages and logs call the joints."""
        return tuple(name.removesuffix("_joint") for name in self.joint_names)

    @property
    def units(self) -> tuple[str, ...]:
        """Of the joints: rad, or m of a linear axis."""
        return _units(self.urdf_text)

    @property
    def limits_rad(self) -> Array:
        """(2, n) the least and the most of each joint."""
        return _limits_rad(self.urdf_text, self.range_rad)

    @property
    def torques_nm(self) -> tuple[float, ...]:
        """That each joint has at most; 0 where nobody says."""
        return self.torque_nm or _of_limits(self.urdf_text, "effort")

    def within(self, joints_rad: Array) -> NDArray[np.bool_]:
        """Which joints (..., n) are within their limits."""
        least, most = self.limits_rad
        inside: NDArray[np.bool_] = (joints_rad >= least - SAME_RAD) & (joints_rad <= most + SAME_RAD)
        return inside

    @property
    def moving_kg(self) -> float:
        """Of all links that the joints move, as the URDF has it; 0 where it has no masses."""
        return _moving_kg(self.urdf_text)

    @property
    def urdf_text(self) -> str:
        """The URDF of this very arm where it is mounted, with whole paths of meshes; the collision shapes alone."""
        return self._drawn.text

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was taken for granted about the arm, in words."""
        inside = self.within(np.array(self.home_rad or self.limits_rad[0]))
        beyond = [joint for joint, free in zip(self.joints, inside, strict=True) if not free]
        ignored = [f"home_rad is beyond the limits of {', '.join(beyond)}: another one is found"] if beyond else []
        return (*self._drawn.remarks, *ignored)

    @property
    def unshaped(self) -> tuple[str, ...]:
        """Links whose collision meshes are missing: thick lines stand for them."""
        return self._drawn.unshaped

    @property
    def _drawn(self) -> Drawn:
        return drawn(self.urdf, self.flange, tuple(self.origins_m.items()), self.calibration, self.mount, self._version)


def load_robot(name: str, folder: Path = Path()) -> RobotModel:
    """A robot that is shipped, by its name, or a robot file.

    Args:
        folder: where files are looked for.

    Raises:
        ValueError: there is none, or its URDF lacks a joint.
        InputError: with every problem of its file, or there is no such URDF.
    """
    path = FOLDER / f"{name}.yaml" if name in shipped_robots() else folder / name
    if not path.is_file():
        raise ValueError(f"unknown robot; legal: {', '.join(shipped_robots())}, or a robot file")
    robot = load_yaml(path, RobotModel)
    if not robot.urdf.startswith(PACKAGE):
        robot = robot.model_copy(update={"urdf": str(path.parent / robot.urdf)})
    return complete(robot, str(path))


def complete(robot: RobotModel, file: str = "") -> RobotModel:
    """The same with speeds, accelerations and jerks of each joint.

    Args:
        file: the robot's own, for messages.

    Raises:
        ValueError: with all that is wrong with it, as the program cannot move it.
    """
    if (path := _file(robot.urdf)).is_file():
        found = path.stat()
        robot._version = found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size
    speeds = robot.speed_rad_s or _of_limits(robot.urdf_text, "velocity")
    accelerations = robot.acceleration_rad_s2 or tuple(speed / SPEEDS_UP_S for speed in speeds)
    jerks = robot.jerk_rad_s3 or tuple(acceleration / JERKS_S for acceleration in accelerations)
    if wrong := [*_wrong(robot, speeds)]:
        told = {whose: "; ".join(what for own, what in wrong if own is whose) for whose, _ in wrong}
        raise ValueError("; ".join(f"{(whose and file) or robot.urdf}: {what}" for whose, what in told.items()))
    values = {"speed_rad_s": speeds, "acceleration_rad_s2": accelerations, "jerk_rad_s3": jerks}
    made = RobotModel.model_construct(robot.model_fields_set, **{**dict(robot), **values})
    made._version = robot._version
    return made


def _wrong(robot: RobotModel, speeds: Sequence[float]) -> Iterator[tuple[bool, str]]:
    """What keeps the program from moving the arm, and whether the robot's own file says it, not the URDF."""
    count = len(robot.joints)
    limits = {f"safety.{mode}.joint_rad_s": of.joint_rad_s for mode, of in robot.safety}
    rows = ("range_rad", "speed_rad_s", "acceleration_rad_s2", "jerk_rad_s3", "torque_nm", "home_rad")
    given = {**{name: getattr(robot, name) for name in rows}, **dict(robot.servos or ()), **limits}
    for name, values in given.items():
        if values and len(values) != count:
            yield True, f"{name} has {len(values)} values, the arm has {count} joints: {', '.join(robot.joints)}"
    if robot.range_rad is not None and len(robot.range_rad) != count:
        return
    for joint, low, high, unit in zip(robot.joints, *robot.limits_rad, robot.units, strict=True):
        if not low < high:
            yield robot.range_rad is not None, f"{joint}: no value is within its limits, {low:g} to {high:g} {unit}"
    if not robot.moving_kg and any(limits.momentum_kg_m_s for _, limits in robot.safety):
        yield True, "safety: momentum_kg_m_s, and the URDF has no masses to work it out by"
    if still := [joint for joint, speed in zip(robot.joints, speeds, strict=False) if not speed > 0]:
        yield False, f"{', '.join(still)}: no speed, neither as velocity here nor as speed_rad_s in the robot's file"
    for unit, most in MOST_SPEED.items():
        told = zip(robot.joints, speeds, robot.units, strict=False)
        if fast := [joint for joint, speed, of in told if of == unit and speed > most]:
            yield bool(robot.speed_rad_s), f"{', '.join(fast)}: faster than any arm, must be at most {most:g} {unit}/s"


def shipped_robots() -> list[str]:
    """Names of the robots that come with the program."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


@cache
def default_robot() -> RobotModel:
    """That is meant where no file says."""
    return load_robot(DEFAULT)


def _named(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, RobotModel):
        return value
    if not isinstance(value, str):
        raise ValueError(f"input should be {', '.join(shipped_robots())}, or a robot file")
    return load_robot(value, Path((info.context or {}).get("folder", ".")))


NamedRobot = Annotated[RobotModel, BeforeValidator(_named, json_schema_input_type=str)]


class Drawn(NamedTuple):
    """A URDF as the program reads it.

    Attributes:
        text: the URDF.
        remarks: what was taken for granted, in words.
        unshaped: links whose meshes are missing.
    """

    text: str
    remarks: tuple[str, ...]
    unshaped: tuple[str, ...]


@cache
def drawn(
    urdf: str,
    flange: str,
    origins_m: tuple[tuple[str, Point], ...] = (),
    calibration: Calibration | None = None,
    mount: Mount | None = None,
    _version: tuple[int, ...] = (),
) -> Drawn:
    """The URDF of an arm; see `RobotModel`. A file that was edited is read again.

    Raises:
        ValueError: with what is wrong with it.
        InputError: it cannot be read.
    """
    path = _file(urdf)
    text = _moved(read_text(path), dict(origins_m))
    root, still = parsed(text, path, flange)
    remarks = [f"{', '.join(still)}: held at 0, as nothing moves them"] * bool(still)
    taken, unshaped = solid_links(root, lambda name: _mesh(name, path))
    text = finished(root, flange)
    text = text if calibration is None else _calibrated(text, calibration)
    return Drawn(text if mount is None else _mounted(text, mount), (*remarks, *taken), unshaped)


def _file(urdf: str) -> Path:
    return FOLDER / urdf.removeprefix(PACKAGE) if urdf.startswith(PACKAGE) else Path(urdf).resolve()


def _mounted(text: str, mount: Mount) -> str:
    """A URDF with the arm's base elsewhere in the world."""
    from pinocchio import rpy

    angles = rpy.matrixToRpy(mount.pose.rotation)
    return mounted(text, *(" ".join(map(repr, map(float, values))) for values in (mount.position_m, angles)))


def _mesh(name: str, urdf: Path) -> Path | None:
    """Where a mesh of a URDF lies; None where it lies nowhere."""
    package, _, inside = name.removeprefix(PACKAGE).partition("/")
    named = (folder / inside for folder in (FOLDER / package, *urdf.parents) if folder.name == package)
    places = [*named] if name.startswith(PACKAGE) else [urdf.parent / name.removeprefix("file://")]
    return next((place for place in places if place.is_file()), None)


def _moved(text: str, origins_m: Mapping[str, Point]) -> str:
    """A URDF whose joints stand at other origins.

    Raises:
        ValueError: it has no such joint.
    """
    for joint, place in origins_m.items():
        own = rf'(<joint name="{re.escape(joint)}" type=.*?<origin[^>]*?xyz=")[^"]*'
        at = " ".join(map(str, place))
        text, found = re.subn(own, rf"\g<1>{at}", text, count=1, flags=re.DOTALL)
        if not found:
            raise ValueError(f"the URDF has no joint {joint!r}")
    return text


def _calibrated(text: str, calibration: Calibration) -> str:
    """A URDF whose joints turn about the axes of one arm; each link is moved as little as that allows.

    Rows of nearly parallel joints may tell of tens of metres that cancel: an axis counts as a line, wherever on it the
    controller has its frame.

    Raises:
        ValueError: these are no joints of such an arm.
    """
    from pinocchio import rpy  # half a second that nobody else needs

    root = ElementTree.fromstring(text)
    parent = nominal = np.eye(4)
    frames = calibration.frames()
    for joint in chain_to(root):
        origin = joint.find("origin")
        assert origin is not None
        at, angles = (np.array(origin.get(name, "0 0 0").split(), float) for name in ("xyz", "rpy"))
        nominal = nominal @ _placed(rpy.rpyToMatrix(angles), at)
        axis = joint.find("axis")
        if axis is None and joint.find(f"child[@link='{FLANGE}']") is None:
            continue
        frame = next(frames, np.eye(4))
        if axis is not None:
            frame = _on_axis(nominal, np.array(axis.get("xyz", "").split(), float), frame)
        step, parent = np.linalg.inv(parent) @ frame, frame
        origin.set("xyz", " ".join(map(repr, step[:3, 3].tolist())))
        origin.set("rpy", " ".join(map(repr, rpy.matrixToRpy(step[:3, :3]).tolist())))
    return ElementTree.tostring(root, encoding="unicode")


@cache
def _joints(urdf_text: str) -> tuple[str, ...]:
    return tuple(joint.get("name", "") for joint in turning_joints(ElementTree.fromstring(urdf_text)))


@cache
def _units(urdf_text: str) -> tuple[str, ...]:
    kinds = [joint.get("type") for joint in turning_joints(ElementTree.fromstring(urdf_text))]
    return tuple("m" if kind == "prismatic" else "rad" for kind in kinds)


@cache
def _of_limits(urdf_text: str, name: str) -> tuple[float, ...]:
    """A value of the joints' limits in the URDF; 0 where there is none."""
    limits = [joint.find("limit") for joint in turning_joints(ElementTree.fromstring(urdf_text))]
    return tuple(float(limit.get(name, 0.0)) for limit in limits if limit is not None)


@cache
def _moving_kg(urdf_text: str) -> float:
    root = ElementTree.fromstring(urdf_text)
    turned = {child.get("link") for joint in turning_joints(root) for child in joint.iter("child")}
    masses = [link.find("inertial/mass") for link in root.iter("link") if link.get("name") in turned]
    return sum(float(mass.get("value", 0.0)) for mass in masses if mass is not None)


@cache
def _limits_rad(urdf_text: str, range_rad: tuple[Range, ...] | None) -> Array:
    """(2, n) the narrower of the URDF's limits, which `parsed` found there, and those of the robot's file."""
    own = np.array([_of_limits(urdf_text, side) for side in ("lower", "upper")])
    if range_rad is None:
        return own
    asked = np.array([span if isinstance(span, tuple) else (-span, span) for span in range_rad]).T
    return np.array([np.maximum(own[0], asked[0]), np.minimum(own[1], asked[1])])


def _on_axis(nominal: Array, axis: Array, frame: Array) -> Array:
    """The frame (4, 4) nearest to a nominal one whose axis (3,) lies on the z of another frame."""
    before, now = nominal[:3, :3] @ axis, frame[:3, 2]
    turn = np.cross(before, now)
    if np.linalg.norm(turn) > ASKEW or before @ now < 0:
        raise ValueError("the calibration is not one of such an arm")
    x, y, z = turn
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = np.eye(3) + cross + cross @ cross / (1 + before @ now)
    along = now * (now @ (nominal[:3, 3] - frame[:3, 3]))
    return _placed(turned @ nominal[:3, :3], frame[:3, 3] + along)


def _placed(turn: Array, at: Array) -> Array:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = turn, at
    return frame
