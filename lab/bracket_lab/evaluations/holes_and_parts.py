"""Scores of hole readers and part detectors on images of the simulated cell, whose labels are the truth."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.learned.calibration.check import WORLD
from bracket_cell.learned.calibration.solve import Shot, fit_over_empty_plate, fit_wrist_camera
from bracket_cell.learned.holes.model import VOTES, Reading
from bracket_cell.learned.parts.maps import overlap, surface_of
from bracket_cell.runs.calibrating import wrist_views
from bracket_cell.skills.motion.grasp_pose import tool_down
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.bench import Bench, CameraCalibration
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HoleReader, PartDetector
from bracket_ground.interfaces.places import Mount
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.plates import write_plates
from bracket_lab.drawing.sight import sometimes_steel
from bracket_lab.drawing.trays import CAMERA, TrayCamera
from bracket_lab.learned.holes.evaluate import HoleFindings, Plate, evaluate_holes, load_plates
from bracket_lab.learned.parts.data import Scene
from bracket_lab.learned.parts.evaluate import Findings, evaluate_parts, intervals, together
from bracket_lab.learned.scores import share
from bracket_lab.wiring.drawn_frames import tray_scenes
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup
from bracket_sim.rendering.studio import visible_poses
from bracket_sim.scene.settings import settings_of
from bracket_sim.scene.world import World, build_world

FOUND_IOU = 0.5  # of the boxes, as in mAP@.5
SPOT_M = 0.02  # parts are moved by so much from their share of the tray


def score_tilted(task: Task, seeds: Sequence[int], tilt_deg: float) -> dict[str, object]:
    """Shares of parts found as what they are, and of those that are told to stand, so that a robot grasps them.

    Args:
        seeds: an image each.
    """
    bench, product = task.configuration.bench, task.product
    detector: PartDetector = task.detectors(bench, "parts").make("parts")
    camera, found, stands = TrayCamera(product, bench), 0, 0
    for seed in seeds:
        rng = np.random.default_rng([seed, round(tilt_deg)])
        parts = list(tilted(product, bench, math.radians(tilt_deg), rng))
        image, world_from_camera = camera.take(parts)
        answers = detector.detect(Frame(CAMERA, seed, 0.0, image, world_from_camera))
        for name, pose in parts:
            surface_m = pose.transform(surface_of(product.parts[name]))
            surface = bench.wrist.model.project(world_from_camera, surface_m)
            box = np.concatenate([surface.min(axis=0), surface.max(axis=0)])
            own = [answer for answer in answers if answer.part == name]
            there = [detection for detection in own if overlap(np.array(detection.box_px, float), box) >= FOUND_IOU]
            found += bool(there)
            stands += any(detection.upright for detection in there)
    count = len(seeds) * len(product.parts)
    return {"tilt_deg": tilt_deg, "found": share(found, count), "stands": share(stands, count)}


def tilted(product: Product, bench: Bench, tilt_rad: float, rng: np.random.Generator) -> Iterator[tuple[str, Pose]]:
    """Type and world_from_part of a part of each type, in a row along the tray."""
    x_m, y_m, floor_m = bench.tray.centre_m
    places = np.linspace(-0.5, 0.5, len(product.parts) + 2)[1:-1] * bench.tray.size_m[1]
    for (name, kind), place_m in zip(product.parts.items(), rng.permutation(places), strict=True):
        off_m = rng.uniform(-SPOT_M, SPOT_M, 2)
        pose = _turned(tilt_rad, *rng.uniform(-math.pi, math.pi, 2))
        lowest_m = float(pose.transform(surface_of(kind))[:, 2].min())
        where_m = (x_m + off_m[0], y_m + place_m + off_m[1], floor_m - lowest_m)
        yield name, Pose(where_m, pose.quaternion_wxyz)


def _turned(tilt_rad: float, towards_rad: float, yaw_rad: float) -> Pose:
    """At the origin: turned by a yaw, then tilted towards a direction."""
    half = tilt_rad / 2
    axis = (math.cos(half), -math.sin(half) * math.sin(towards_rad), math.sin(half) * math.cos(towards_rad), 0.0)
    return Pose((0.0, 0.0, 0.0), axis) @ Pose.from_yaw((0.0, 0.0, 0.0), yaw_rad)


Cameras = Literal["calibrated", "believed", "true"]
FRAMES = VOTES  # in a row of each still of the plate, each with noise of its own


@dataclass(frozen=True)
class Task:
    """What is evaluated.

    Attributes:
        kind: of detector, as in the configuration.
        weights: of it; the configured ones where None.
        cameras: which mounts and lenses the detector believes in: those that a calibration finds in each look, those
            of the bench file, or the true ones.
        steel_share: of recordings whose parts are of bare steel.
    """

    configuration: Configuration
    product: Product
    kind: str
    weights: Path | None = None
    cameras: Cameras = "calibrated"
    steel_share: float = 0.0

    def detectors(self, bench: Bench, what: str) -> Detectors:
        """Makes the chosen detector for a bench."""
        perception = self.configuration.perception.with_detector(what, self.kind, self.weights)
        return Detectors(bench, self.product, perception)


def score_parts(task: Task, seeds: Sequence[int], mixed: bool) -> dict[str, float]:
    """Scores on one tray for each seed, by name, with their intervals.

    Args:
        mixed: some parts lie or are stacked, and some objects are unknown.
    """
    each = []
    for scene in tray_scenes(task.configuration, task.product, seeds, mixed=mixed, steel_share=task.steel_share):
        bench = _bench(task, int(scene.log.removeprefix("seed")), scene)
        detector: PartDetector = task.detectors(bench, "parts").make("parts")
        view = replace(
            scene,
            believed=scene.world_from_camera if task.cameras == "true" else bench.wrist.corrected(scene.believed),
        )
        each.append(Findings())
        evaluate_parts([view], detector, task.product, each[-1])
    return together(each).scores(task.product) | intervals(each, task.product)


def score_holes(task: Task, seeds: Sequence[int], stills: int) -> dict[str, float]:
    """Scores on some stills of the plate for each seed, by name; a reader watches each for some frames."""
    findings = HoleFindings()
    for seed in seeds:
        plates = _plates(task, seed, stills)
        detectors = task.detectors(_bench(task, seed, plates[0]), "holes")
        for first in range(0, len(plates), FRAMES):
            reader: HoleReader = detectors.make("holes")
            evaluate_holes(plates[first : first + FRAMES], partial(_watch, reader), findings)
    return findings.scores()


def _watch(reader: HoleReader, plates: Sequence[Plate]) -> Mapping[str, Reading | None]:
    for number, plate in enumerate(plates):
        views = reader.read(Frame("overhead", number, number / 15, plate.image, plate.believed), None)
    return {name: Reading(view.part, view.upright, view.confidence) for name, view in views.items()}


def _plates(task: Task, seed: int, stills: int) -> list[Plate]:
    kinematics = Kinematics(task.configuration.motion)

    def reach(tool_m: Array, yaw_rad: float) -> Array | None:
        return kinematics.inverse(tool_down(list(tool_m), yaw_rad))

    kinds = sometimes_steel(task.product, task.steel_share, seed)
    with tempfile.TemporaryDirectory(prefix="cell-eval-") as name:
        folder, configuration = DataFolder(Path(name) / "plates", "cell lab eval holes"), task.configuration
        write_plates(
            kinds,
            configuration.bench,
            settings_of(configuration.devices.simulation),
            seed,
            folder,
            stills,
            reach,
            FRAMES,
        )
        return load_plates([Path(name) / "plates"], task.product)


def _bench(task: Task, seed: int, seen: Scene | Plate) -> Bench:
    """The bench with the cameras that the detector believes in."""
    bench = task.configuration.bench
    if task.cameras == "calibrated":
        return calibrated_bench(task.configuration, task.product, seed)
    if task.cameras == "believed":
        return bench
    lens = {"focal_px": seen.camera.focal_px, "distortion_k1": seen.camera.distortion_k1}
    if isinstance(seen, Scene):
        return bench.model_copy(update={"wrist": bench.wrist.model_copy(update=lens)})
    pose = seen.world_from_camera
    mount = Mount(position_m=pose.position_m, quaternion_wxyz=pose.quaternion_wxyz)
    return bench.model_copy(update={"overhead": bench.overhead.model_copy(update={**lens, "mount": mount})})


def _world(configuration: Configuration, product: Product, seed: int) -> World:
    look = settings_of(configuration.devices.simulation).look.draw(seed)
    return build_world(product, configuration.bench, None, None, None, look)


def calibrated_bench(configuration: Configuration, product: Product, seed: int, world: World | None = None) -> Bench:
    """The bench as `cell setup calibrate` would leave it in the look of a seed, from the same images."""
    bench = configuration.bench
    world = world or _world(configuration, product, seed)
    camera, rng = world.look.camera, np.random.default_rng([seed, 9])
    setups = {"overhead": bench.overhead, "wrist": bench.wrist}
    photographer = Photographer(world.model, {name: SensorSetup(setup, camera, rng) for name, setup in setups.items()})

    def shot(name: str, number: int, base: Pose) -> Shot:
        exposure = Exposure(name, number, 0.0, world.camera_pose(name), (visible_poses(world.data),))
        return Shot(photographer.take(exposure).image, base)

    overhead = fit_over_empty_plate([shot("overhead", 0, WORLD)], bench.overhead, bench, product)
    shots = []
    for number, joints in enumerate(wrist_views(bench, product, MotionPlanner(product, bench, configuration.motion))):
        world.set_arm(joints)
        shots.append(shot("wrist", number, world.tool_pose()))
    photographer.close()
    wrist = fit_wrist_camera(shots, bench, product)
    found = {"overhead": overhead.setup, "wrist": wrist.setup}
    cameras = {
        name: setups[name].calibrated(
            CameraCalibration(mount=camera.mount, focal_px=camera.focal_px, distortion_k1=camera.distortion_k1)
        )
        for name, camera in found.items()
    }
    return bench.model_copy(update=cameras)
