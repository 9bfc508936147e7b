"""The bench as measured when the cell was set up: where arm, bracket, tray and cameras are (config/cell.yaml).

World frame: origin at the arm's base on the table top, x towards the person, z up. In [m] and [rad].
"""

from __future__ import annotations

from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from bracket_ground.files.model import Disagreement, Location, Model
from bracket_ground.files.units import Gap, Joints, Length, Point
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.intrinsics import Lens, with_intrinsics
from bracket_ground.interfaces.meshes import MeshFile, read_mesh
from bracket_ground.interfaces.places import FRAMES, BenchPlace, Mount
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.solid import Solid


class CameraCalibration(Lens):
    """How a camera was found to hang and to see.

    Attributes:
        mount: see `CameraSetup`.
        rms_px: by how much what was seen is off after the fit.
    """

    mount: Mount
    rms_px: float = Field(default=0.0, ge=0, le=100)


class Calibration(Model):
    """The file of `cell setup calibrate`: it takes over what the bench says of the cameras.

    Attributes:
        overhead, wrist: the cameras that were calibrated.
    """

    overhead: CameraCalibration | None = None
    wrist: CameraCalibration | None = None


class CameraSetup(Lens):
    """Calibration of a camera.

    Attributes:
        width_px, height_px: size of its images.
        intrinsics: file with lens and size of the images in place of their keys, relative to this one: camera_info of
            ROS, or OpenCV's FileStorage, as YAML.
        rate_hz: frames per second.
        triggered: it sends a frame only when asked.
        depth: it sends a depth image with each frame, as stereo cameras do; of the overhead camera only.
        mount: where it is: world_from_camera of a fixed camera, tool_from_camera of one on the wrist (tool: the TCP
            between the fingertips). Camera frame: x right, y down, z forward.
    """

    width_px: int = Field(ge=16, le=4096)
    height_px: int = Field(ge=16, le=4096)
    intrinsics: Path | None = None
    rate_hz: float = Field(ge=0.1, le=1000)
    triggered: bool = False
    depth: bool = False
    mount: Mount
    _drawn: CameraSetup | None = PrivateAttr(default=None)

    @model_validator(mode="before")
    @classmethod
    def _reads_intrinsics(cls, value: Any, info: ValidationInfo) -> Any:
        if not isinstance(value, dict) or not isinstance(value.get("intrinsics"), str):
            return value
        return with_intrinsics(value, Path((info.context or {}).get("folder", ".")))

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: Any) -> dict[str, Any]:
        """What a file of intrinsics may hold is not required."""
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        schema["required"] = [name for name in schema["required"] if name in ("rate_hz", "mount")]
        return schema

    @property
    def drawn(self) -> CameraSetup:
        """As the configuration file has it, whatever a calibration says: what the camera's driver is told."""
        return self._drawn or self

    def calibrated(self, found: CameraCalibration | None) -> CameraSetup:
        """With the mount and lens of a calibration."""
        if found is None:
            return self
        setup = self.model_copy(
            update={name: getattr(found, name) for name in type(found).model_fields if name != "rms_px"}
        )
        setup._drawn = self.drawn
        return setup

    def corrected(self, pose: Pose) -> Pose:
        """The camera's place by calibration, where its driver tells `pose` by the mount that it knows."""
        if self._drawn is None:
            return pose
        return pose @ self._drawn.mount.pose.inverse() @ self.mount.pose

    @property
    def model(self) -> CameraModel:
        return CameraModel(**{field.name: getattr(self, field.name) for field in fields(CameraModel)})


class Tray(Model):
    """A shallow tray; parts for the robot lie in it.

    Attributes:
        centre_m: middle of its floor's upper side.
        size_m: inner (x, y) extent.
        wall_m: height of its rim.
    """

    centre_m: Point
    size_m: tuple[Length, Length]
    wall_m: Gap


class Obstacle(Mount):
    """A thing that stands on the bench and is in the way: a box, a cylinder or a mesh, one of them.

    Attributes:
        position_m: of its middle (x, y, z); of a mesh, of the file's own origin.
        quaternion_wxyz: how it is turned, as a unit quaternion (w, x, y, z); not turned by default.
        name: what messages call it, as in "the camera post".
        box_m: extents along its x, y and z.
        cylinder_m: diameter, and length along its z.
        mesh: file (.stl or .obj, in metres), relative to this one; its convex hull is in the way.
    """

    name: str = Field(min_length=1, max_length=60)
    box_m: tuple[Length, Length, Length] | None = None
    cylinder_m: tuple[Length, Length] | None = None
    mesh: MeshFile | None = None

    @model_validator(mode="after")
    def _has_one_shape(self) -> Obstacle:
        shapes = {key: getattr(self, key) for key in ("box_m", "cylinder_m", "mesh")}
        if (given := sum(shape is not None for shape in shapes.values())) != 1:
            raise ValueError(f"{self.name} has {given} shapes; it needs one of {', '.join(shapes)}")
        return self

    @property
    def points_m(self) -> Array:
        """Points (n, 3) in the world whose convex hull it is; of a cylinder nearly."""
        if self.mesh is not None:
            return self.pose.transform(read_mesh(self.mesh).points_m)
        if self.box_m is not None:
            solid = Solid(solid="box", size_m=self.box_m, centre_m=(0.0, 0.0, 0.0))
        else:
            assert self.cylinder_m is not None
            across_m, along_m = self.cylinder_m
            solid = Solid(solid="cylinder", size_m=(across_m, across_m, along_m), centre_m=(0.0, 0.0, 0.0))
        return self.pose.transform(solid.points())


class Bench(Model):
    """Everything that stands still.

    Attributes:
        bracket: world_from_bracket; origin on the upper side, holes where the product says (`bracket.holes_m`).
        tray: where the parts for the robot lie.
        bins_m: by part type, where the person keeps parts of their own (x, y, z).
        hand_rest_m: where the person's hand rests (x, y, z).
        overhead: the fixed camera that sees bracket and hands.
        wrist: the camera beside the gripper, which looks into the tray.
        arm_park_rad: joints away from bracket and person; found where they are left out.
        arm_look_rad: joints from which the wrist camera sees the tray; found where they are left out.
        obstacles: what else stands there and the arm goes around.
        places: where else parts stand, by names of your own: fixtures, nests, a chuck, a conveyor's stop, pallets.
    """

    bracket: Mount
    tray: Tray
    bins_m: dict[str, Point]
    hand_rest_m: Point
    overhead: CameraSetup
    wrist: CameraSetup
    arm_park_rad: Joints = ()
    arm_look_rad: Joints = ()
    obstacles: tuple[Obstacle, ...] = ()
    places: dict[str, BenchPlace] = Field(default_factory=dict)

    @property
    def drawn(self) -> Bench:
        """With the cameras as the configuration file has them, whatever a calibration says."""
        return self.model_copy(update={"overhead": self.overhead.drawn, "wrist": self.wrist.drawn})

    def calibrated(self, found: Calibration) -> Bench:
        """With the cameras of a calibration."""
        cameras = {"overhead": self.overhead.calibrated(found.overhead), "wrist": self.wrist.calibrated(found.wrist)}
        return self.model_copy(update=cameras)

    @model_validator(mode="after")
    def _axes_meet_images(self) -> Bench:
        problems: list[tuple[Location, str]] = []
        for name, camera in (("overhead", self.overhead), ("wrist", self.wrist)):
            (column, row), (width, height) = camera.model.middle_px, (camera.width_px, camera.height_px)
            if not (0 <= column < width and 0 <= row < height):
                what = f"({column:g}, {row:g}) is outside the image of {width} x {height} px"
                problems.append(((name, "principal_px"), what))
        if problems:
            raise Disagreement(problems)
        return self

    @model_validator(mode="after")
    def _the_overhead_camera_runs_by_itself(self) -> Bench:
        if self.overhead.triggered:
            raise Disagreement(
                [(("overhead", "triggered"), "nothing asks the overhead camera for frames: it must be false")]
            )
        return self

    @model_validator(mode="after")
    def _obstacles_have_names_of_their_own(self) -> Bench:
        often = Counter(obstacle.name for obstacle in self.obstacles)
        twice = [number for number, obstacle in enumerate(self.obstacles) if often[obstacle.name] > 1]
        if twice:
            what = "there are two obstacles of the name {!r}; give each its own"
            places = [(("obstacles", number, "name"), what.format(self.obstacles[number].name)) for number in twice[1:]]
            raise Disagreement(places)
        return self

    @model_validator(mode="after")
    def _seen_places_are_in_view(self) -> Bench:
        camera, mount = self.overhead.model, self.overhead.mount.pose
        problems: list[tuple[Location, str]] = []
        for name, place in self.places.items():
            if place.known_by == "seen":
                spots = np.array([place.spot(number).position_m for number in range(len(place.spots_m))])
                pixels = camera.project(mount, spots)
                inside = ((pixels >= 0) & (pixels < (camera.width_px, camera.height_px))).all(axis=1)
                if not inside.all():
                    what = f"the overhead camera does not see spot {int(np.argmin(inside))}"
                    problems.append((("places", name, "known_by"), f"{what}; legal: counted, felt"))
        if problems:
            raise Disagreement(problems)
        return self

    @model_validator(mode="after")
    def _places_are_no_frames(self) -> Bench:
        what = "{!r} is a frame already; give the place another name"
        if taken := [(("places", name), what.format(name)) for name in self.places if name in FRAMES]:
            raise Disagreement(taken)
        return self

    @model_validator(mode="after")
    def _only_the_overhead_camera_has_depth(self) -> Bench:
        if self.wrist.depth:
            raise Disagreement([(("wrist", "depth"), "nobody reads depths of the wrist camera: it must be false")])
        return self
