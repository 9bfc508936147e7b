"""Calibrates the cameras of a cell: the overhead camera as it hangs, the wrist camera from a few poses of the arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.learned.calibration.board import MORE, VIEWS, BoardReader, CharucoBoard
from bracket_cell.learned.calibration.check import WORLD, trouble
from bracket_cell.learned.calibration.solve import (
    Fit,
    Shot,
    fit_over_empty_plate,
    fit_wrist_camera,
    holes_off_m,
    too_few_holes,
)
from bracket_cell.runs.camera_delay import measured_delays_s
from bracket_cell.runs.slow_motion import move_to, next_frame, opened, placed
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_ground.errors import DeviceFault, counted
from bracket_ground.interfaces.bench import Bench, Calibration, CameraCalibration, CameraSetup
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.devices import Camera, Devices
from bracket_ground.interfaces.intrinsics import Lens
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

OVER_M = 0.34  # of the wrist camera, over the plate
ALONG = (-0.3, 0.0, 0.3)  # middles of the views, in lengths of the plate
TILTS_RAD = ((0.0, 0.0), (0.22, 0.0), (-0.22, 0.0), (0.0, 0.22), (0.0, -0.22))
QUARTERS = (0.2, math.pi / 2 - 0.25, -math.pi / 2 + 0.15)  # turns of the camera about its axis, against the look pose:
# edges that run along rows of pixels would be seen half a pixel off, all their points alike
MOST_VIEWS, LEAST_VIEWS = 9, 4
FRAMES = 3
SHOWN_S = 60.0  # in which another view of a board must be shown
FAR_M, FAR_RAD = 0.03, math.radians(4)  # from where the bench file says; then that is to be measured again
DOWN = Pose((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Calibrated:
    """One camera after a calibration.

    Attributes:
        off_m: how far the bench file's camera sees the holes off; at the wrist, how far the mount is off.
        trouble: why the result is not to be used; empty where it is good.
    """

    fit: Fit
    off_m: float
    trouble: str

    def as_json(self) -> dict[str, object]:
        """For programs."""
        fit = self.fit
        numbers = {"off_mm": round(1e3 * self.off_m, 3), "rms_px": round(fit.rms_px, 3)} if fit.images else {}
        return {**numbers, "edges": fit.edges, "holes": fit.holes, "images": fit.images, "trouble": self.trouble}

    @property
    def calibration(self) -> CameraCalibration:
        """For the file."""
        found = self.fit.setup
        seen = {name: getattr(found, name) for name in CameraCalibration.model_fields if name != "rms_px"}
        return CameraCalibration(**seen, rms_px=round(self.fit.rms_px, 3))


def calibrate(
    configuration: Configuration,
    product: Product,
    seed: int,
    overhead_only: bool,
    tell: Tell,
    slower: float = 1.0,
    board: CharucoBoard | None = None,
) -> tuple[Calibration | None, dict[str, Calibrated], dict[str, float]]:
    """Calibrate the cameras of a cell, from the lenses that a board shows, or that the cameras themselves know.

    Returns:
        what was found, None where some of it is not to be used; all about each camera; and how late the stamps of real
        cameras are, where the arm was seen to move.

    Raises:
        DeviceFault: a device could not be opened, or gave up, or the board was not seen well enough.
    """
    motion = MotionPlanner(product, configuration.bench.drawn, configuration.motion)
    delays_s: dict[str, float] = {}
    with opened(configuration, product, seed, slower) as devices:
        for role in ("overhead",) if overhead_only else ("overhead", "wrist"):
            camera: Camera = getattr(devices, role)
            lens = (
                getattr(camera, "lens", None) if board is None else shown_lens(camera, devices.clock, board, role, tell)
            )
            configuration = _seen_through(configuration, role, lens)
        cameras = {"overhead": calibrate_overhead(devices, configuration, product)}
        if not overhead_only and not cameras["overhead"].trouble:
            cameras["wrist"] = calibrate_wrist(devices, configuration, product, motion, tell)
            if known := stamped_delays_s(configuration):
                delays_s = _delays_s(devices, configuration, motion, known, tell)
    if any(calibrated.trouble for calibrated in cameras.values()):
        return None, cameras, delays_s
    return Calibration(**{name: calibrated.calibration for name, calibrated in cameras.items()}), cameras, delays_s


def shown_lens(camera: Camera, clock: Clock, board: CharucoBoard, role: str, tell: Tell) -> Lens:
    """The lens of a camera that a person shows a board to.

    Raises:
        DeviceFault: no frame came, or the views do not tell it.
    """
    reader, until_s = BoardReader(board), clock.now_s() + SHOWN_S
    tell(f"hold the board before the {role} camera, still, in {VIEWS} places: {MORE}")
    while len(reader.views) < VIEWS and clock.now_s() < until_s:
        if reader.add(next_frame(camera, clock).image):
            tell(f"view {len(reader.views)} of {VIEWS}")
            until_s = clock.now_s() + SHOWN_S
    try:
        lens, rms_px = reader.lens()
    except ValueError as error:
        raise DeviceFault(f"camera {role}", str(error)) from None
    tell(f"{role}: focal lengths {lens.focal_px:.1f} and {lens.focal_y_px:.1f} px, fit {rms_px:.2f} px")
    return lens


def _seen_through(configuration: Configuration, role: str, lens: Lens | None) -> Configuration:
    """The same cell, a camera of which has another lens."""
    if lens is None:
        return configuration
    bench = configuration.bench.drawn
    setup = getattr(bench, role).model_copy(update=lens.model_dump())
    return configuration.model_copy(update={"bench": bench.model_copy(update={role: setup})})


def stamped_delays_s(configuration: Configuration) -> dict[str, float]:
    """What the configuration says of how late each camera's stamps are, where its driver takes that off."""
    devices = {role: getattr(configuration.devices, role) for role in ("overhead", "wrist")}
    return {role: device.delay_s or 0.0 for role, device in devices.items() if hasattr(device, "delay_s")}


def _delays_s(
    devices: Devices, configuration: Configuration, motion: MotionPlanner, known: Mapping[str, float], tell: Tell
) -> dict[str, float]:
    """How late the stamps of cameras are, from a swing of the arm at the look pose; and back to park."""
    tell("the arm swings to and fro, for the cameras' delay")
    move_to(devices, motion, np.array(configuration.bench.arm_look_rad))
    left = measured_delays_s(devices, motion)
    move_to(devices, motion, np.array(configuration.bench.arm_park_rad))
    return {role: max(0.0, round(known[role] + value, 3)) for role, value in left.items() if role in known}


def calibrate_overhead(devices: Devices, configuration: Configuration, product: Product) -> Calibrated:
    """From some frames of the empty bracket; nothing moves.

    Raises:
        DeviceFault: no frame came.
    """
    bench = configuration.bench.drawn
    shots = [Shot(next_frame(devices.overhead, devices.clock).image, WORLD) for _ in range(FRAMES)]
    fit = fit_over_empty_plate(shots, bench.overhead, bench, product)
    off_m = holes_off_m(bench.overhead, fit.setup, bench, product) if fit.images else math.inf
    found = trouble(fit, FRAMES, bench, product) or _far(bench.overhead, fit)
    if not found and too_few_holes(fit, product):
        found = f"{fit.holes // FRAMES} of {len(product.bracket.holes_m)} holes are seen; all of them must be empty"
    return Calibrated(fit, off_m, found)


def calibrate_wrist(
    devices: Devices, configuration: Configuration, product: Product, motion: MotionPlanner, tell: Tell
) -> Calibrated:
    """From images of the plate out of several poses; the arm moves there slowly, and back.

    Raises:
        DeviceFault: the arm cannot get there or does not answer, or no frame came.
    """
    bench = configuration.bench.drawn
    mount, shots = bench.wrist.mount.pose, []
    park = np.array(devices.arm.state().positions_rad)
    for joints in wrist_views(bench, product, motion):
        move_to(devices, motion, joints)
        frame = placed(next_frame(devices.wrist, devices.clock), devices, motion)
        shots.append(Shot(frame.image, frame.world_from_camera @ mount.inverse()))
        tell(f"view {len(shots)}")
    move_to(devices, motion, park)
    if len(shots) < LEAST_VIEWS:
        raise DeviceFault("arm", f"{counted(len(shots), 'view')} of the bracket in reach; {LEAST_VIEWS} are needed")
    fit = fit_wrist_camera(shots, bench, product)
    off_m = math.dist(fit.setup.mount.position_m, bench.wrist.mount.position_m)
    return Calibrated(fit, off_m, trouble(fit, LEAST_VIEWS, bench, product) or _far(bench.wrist, fit))


def _far(setup: CameraSetup, fit: Fit) -> str:
    """Why the camera cannot hang there; empty where it can."""
    off = setup.mount.pose.inverse() @ fit.setup.mount.pose
    shift_m, turn_rad = float(np.linalg.norm(off.position_m)), 2 * math.acos(min(1.0, abs(off.quaternion_wxyz[0])))
    if shift_m <= FAR_M and turn_rad <= FAR_RAD:
        return ""
    where = f"{1e3 * shift_m:.0f} mm and {math.degrees(turn_rad):.1f} degrees from where the bench file says"
    return f"the camera seems to hang {where}; measure its mount again"


def wrist_views(bench: Bench, product: Product, motion: MotionPlanner) -> Iterator[Array]:
    """Joints from which the wrist camera sees the plate, as different as they can be."""
    load, near = Load(motion.open_m), np.array(bench.arm_look_rad)
    looks = motion.kinematics.forward(near) @ bench.wrist.mount.pose
    found = 0
    holes = np.array(list(product.bracket.holes_m.values()))
    middle, length = holes.mean(axis=0), float(np.ptp(holes, axis=0).max())
    along = np.eye(2)[int(np.ptp(holes, axis=0).argmax())]
    for number, tilt in enumerate(TILTS_RAD):
        for place in ALONG:
            target = bench.bracket.pose.transform(np.array([*(middle + place * length * along), 0.0]))
            for quarter in QUARTERS[number % 2 :: 2] if number else QUARTERS:
                camera = _camera_over(target, looks.yaw_rad + quarter, tilt)
                reached = motion.reach([camera @ bench.wrist.mount.pose.inverse()], near, load)
                if not isinstance(reached, str) and found < MOST_VIEWS:
                    found += 1
                    yield reached[1]
                    break


def _camera_over(target_m: Array, yaw_rad: float, tilt_rad: tuple[float, float]) -> Pose:
    """A camera that looks at a place from OVER_M above, tilted about its own two level axes."""
    a, b = (angle / 2 for angle in tilt_rad)
    tilted = Pose((0, 0, 0), (math.cos(a), math.sin(a), 0, 0)) @ Pose((0, 0, 0), (math.cos(b), 0, math.sin(b), 0))
    turned = Pose.from_yaw((0, 0, 0), yaw_rad) @ DOWN @ tilted
    away = turned.rotation @ np.array([0.0, 0.0, -OVER_M])
    x, y, z = (float(value) for value in target_m + away)
    return Pose((x, y, z), turned.quaternion_wxyz)
