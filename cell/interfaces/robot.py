"""The robot as data: its URDF, the limits of its joints, its tool; everything that must know an arm reads this."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationInfo

from cell.files.files import read_text, shipped
from cell.files.model import Model
from cell.files.units import Point
from cell.files.yaml_file import load_yaml

PACKAGE = "package://"
FOLDER = shipped("config", "robots")
DEFAULT = "ur10"

Positive = Annotated[float, Field(gt=0, le=1000)]
SixValues = tuple[Positive, Positive, Positive, Positive, Positive, Positive]


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
        urdf: file of the arm, with the flange as `tool0` and the links' names of a UR; relative to this file, or
            package://ROBOT/... of a robot that is shipped. Its meshes: relative to the URDF, or package://PACKAGE/...,
            where PACKAGE is shipped or a folder that the URDF lies in.
        origins_m: place (x, y, z) of joints in their parents' links, where it is another than in the URDF.
        range_rad: how far each joint turns, each way.
        speed_rad_s: how fast each joint can turn, by the data sheet.
        acceleration_rad_s2: how soon each joint may be that fast.
        tool: what is mounted on the flange.
    """

    name: str
    urdf: str
    origins_m: dict[str, Point] = Field(default_factory=dict)
    range_rad: SixValues
    speed_rad_s: SixValues
    acceleration_rad_s2: SixValues
    tool: Tool = Tool()

    @property
    def urdf_text(self) -> str:
        """The URDF with this robot's origins and whole paths of meshes, without visual ones, which nothing needs."""
        return _urdf_text(self.urdf, tuple(self.origins_m.items()))


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
    assert robot.urdf_text  # what is wrong with it is said now
    return robot


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
def _urdf_text(urdf: str, origins_m: tuple[tuple[str, Point], ...]) -> str:
    path = FOLDER / urdf.removeprefix(PACKAGE) if urdf.startswith(PACKAGE) else Path(urdf).resolve()
    text = re.sub(r"<visual>.*?</visual>", "", read_text(path), flags=re.DOTALL)
    text = re.sub(r'(<mesh[^>]*?filename=")([^"]+)', lambda found: found[1] + str(_mesh(found[2], path)), text)
    return _moved(text, dict(origins_m))


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
