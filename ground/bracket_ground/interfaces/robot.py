"""The robot as data: its URDF, the limits of its joints, its tool; everything that must know an arm reads this."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, ValidationInfo

from bracket_ground.files.files import read_text, shipped
from bracket_ground.files.model import Model
from bracket_ground.files.units import Point
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.bench import JOINTS
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.urdf import FLANGE, chain_to, named_alike, parsed, turning_joints

PACKAGE = "package://"
FOLDER = shipped("bracket_cell.config", "robots")
DEFAULT = "ur10"
WORLD_FROM_BASE = np.diag([-1.0, -1.0, 1.0, 1.0])  # the base of such rows is turned by half a turn against the URDF
SAME_RAD = 1e-9  # two angles are the same
ASKEW = 0.1  # so far beside its nominal direction a joint's axis is that of another arm

Positive = Annotated[float, Field(gt=0, le=1000)]
SixValues = tuple[Positive, Positive, Positive, Positive, Positive, Positive]
Angle = Annotated[float, Field(ge=-1000, le=1000)]
Range = Positive | tuple[Angle, Angle]
SixRanges = tuple[Range, Range, Range, Range, Range, Range]


SixOffsets = tuple[float, float, float, float, float, float]


class Calibration(Model):
    """Denavit-Hartenberg rows of one arm, with its own corrections: `cell setup teach robot` writes them.

    Attributes:
        theta_rad: what is added to each joint's angle.
        a_m, d_m, alpha_rad: lengths and twist of each row.
    """

    theta_rad: SixOffsets
    a_m: SixOffsets
    d_m: SixOffsets
    alpha_rad: SixOffsets

    def frames(self, joints_rad: Sequence[float] | Array = (0.0,) * 6) -> Iterator[Array]:
        """In the world: the frame (4, 4) about whose z each joint turns, then the flange."""
        frame: Array = WORLD_FROM_BASE
        angles = np.array(joints_rad) + self.theta_rad
        for angle, a, d, alpha in zip(angles, self.a_m, self.d_m, self.alpha_rad, strict=True):
            yield frame
            c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
            row = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]]
            frame = frame @ np.array(row)
        yield frame


class Tool(Model):
    """What is mounted on the flange.

    Attributes:
        tcp_from_flange_m: distance of the tool frame (TCP) from the flange, along the flange's z.
        fingertip_beyond_tcp_m: fingertips reach this far below the TCP.
    """

    tcp_from_flange_m: float = Field(default=0.156, gt=0, le=1)
    fingertip_beyond_tcp_m: float = Field(default=0.008, ge=0, le=1)


class RobotModel(Model):
    """A six-joint arm with its tool; values of joints from the base to the last wrist.

    Attributes:
        name: for messages.
        urdf: file of the arm, whose flange six revolute joints turn; relative to this file, or package://ROBOT/... of a
            robot that is shipped. Its meshes: relative to the URDF, or package://PACKAGE/..., where PACKAGE is shipped
            or a folder that the URDF lies in.
        flange: link of the URDF that the gripper is mounted on, its z away from the arm.
        origins_m: place (x, y, z) of joints in their parents' links, where it is another than in the URDF.
        calibration: the arm's own; without one it is as its maker publishes.
        range_rad: how far each joint turns, each way, or [least, most]; within the URDF's limits, which count alone
            where nothing is given.
        speed_rad_s: how fast each joint can turn, by the data sheet.
        acceleration_rad_s2: how soon each joint may be that fast.
        tool: what is mounted on the flange.
    """

    name: str
    urdf: str
    flange: str = FLANGE
    origins_m: dict[str, Point] = Field(default_factory=dict)
    calibration: Calibration | None = None
    range_rad: SixRanges | None = None
    speed_rad_s: SixValues
    acceleration_rad_s2: SixValues
    tool: Tool = Tool()

    @property
    def limits_rad(self) -> Array:
        """(2, 6) the least and the most of each joint."""
        return _limits_rad(self.urdf_text, self.range_rad)

    def within(self, joints_rad: Array) -> NDArray[np.bool_]:
        """Which joints (..., 6) are within their limits."""
        least, most = self.limits_rad
        inside: NDArray[np.bool_] = (joints_rad >= least - SAME_RAD) & (joints_rad <= most + SAME_RAD)
        return inside

    @property
    def urdf_text(self) -> str:
        """The URDF with this robot's origins and whole paths of meshes, without visual ones, which nothing needs."""
        return _urdf_text(self.urdf, self.flange, tuple(self.origins_m.items()), self.calibration)


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
    check_arm(robot)  # what is wrong with it is said now
    return robot


def check_arm(robot: RobotModel) -> None:
    """Raise ValueError, with all that is wrong, for a robot that the program cannot move."""
    if wrong := [*_wrong_limits(robot)]:
        raise ValueError(f"{robot.urdf}: {'; '.join(wrong)}")


def _wrong_limits(robot: RobotModel) -> Iterator[str]:
    least, most = robot.limits_rad
    for joint, low, high in zip(JOINTS, least, most, strict=True):
        if not low < high:
            yield f"{joint}: no angle is within its limits, {low:g} to {high:g} rad"


def shipped_robots() -> list[str]:
    """Names of the robots that come with the program."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


@cache
def default_robot() -> RobotModel:
    """The UR10."""
    return load_robot(DEFAULT)


def _named(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, RobotModel):
        return value
    if not isinstance(value, str):
        raise ValueError(f"input should be {', '.join(shipped_robots())}, or a robot file")
    return load_robot(value, Path((info.context or {}).get("folder", ".")))


NamedRobot = Annotated[RobotModel, BeforeValidator(_named, json_schema_input_type=str)]


@cache
def _urdf_text(
    urdf: str, flange: str, origins_m: tuple[tuple[str, Point], ...], calibration: Calibration | None
) -> str:
    path = FOLDER / urdf.removeprefix(PACKAGE) if urdf.startswith(PACKAGE) else Path(urdf).resolve()
    text = re.sub(r"<visual>.*?</visual>", "", read_text(path), flags=re.DOTALL)
    text = re.sub(r'(<mesh[^>]*?filename=")([^"]+)', lambda found: found[1] + str(_mesh(found[2], path)), text)
    text = named_alike(parsed(_moved(text, dict(origins_m)), path, flange), flange)
    return text if calibration is None else _calibrated(text, calibration)


def _mesh(name: str, urdf: Path) -> Path:
    """Where a mesh of a URDF lies.

    Raises:
        ValueError: nowhere.
    """
    package, _, inside = name.removeprefix(PACKAGE).partition("/")
    named = (folder / inside for folder in (FOLDER / package, *urdf.parents) if folder.name == package)
    places = [*named] if name.startswith(PACKAGE) else [urdf.parent / name.removeprefix("file://")]
    for place in places:
        if place.is_file():
            return place
    raise ValueError(f"{urdf}: there is no mesh {name}; looked for: {', '.join(map(str, places))}")


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
def _limits_rad(urdf_text: str, range_rad: tuple[Range, ...] | None) -> Array:
    """(2, n) the narrower of the URDF's limits, which check_arm found there, and those of the robot's file."""
    drawn = [joint.find("limit") for joint in turning_joints(ElementTree.fromstring(urdf_text))]
    own = np.array(
        [[float(limit.get(side, 0.0)) for limit in drawn if limit is not None] for side in ("lower", "upper")]
    )
    if range_rad is None:
        return own
    asked = np.array([one if isinstance(one, tuple) else (-one, one) for one in range_rad]).T
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
