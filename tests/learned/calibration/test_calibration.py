"""Cameras that hang elsewhere than believed are found by images of the plate; who sees the holes off says so."""

from __future__ import annotations

import math
import pickle
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product, simulated
from bracket_cell.learned.calibration.check import (
    EVERY_S,
    LOOKS,
    WORLD,
    CalibrationCheck,
    TrayCheck,
    tray_off_m,
    trouble,
)
from bracket_cell.learned.calibration.landmarks import PlateModel
from bracket_cell.learned.calibration.solve import Shot, fit_camera, fit_over_empty_plate, holes_off_m, too_few_holes
from bracket_ground.interfaces.bench import Calibration, CameraCalibration, CameraSetup
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample
from bracket_ground.interfaces.places import Mount
from bracket_ground.interfaces.pose import Pose
from bracket_lab.drawing.sight import true_calibration, true_camera
from bracket_lab.evaluations.holes_and_parts import calibrated_bench
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup
from bracket_sim.rendering.studio import visible_poses
from bracket_sim.scene.look import Look, MountError, Mounts
from bracket_sim.scene.settings import settings_of
from bracket_sim.scene.world import build_world

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
FARTHER = MountError(shift_m=0.01, shift_azimuth_rad=1.0, turn_rad=math.radians(1), turn_azimuth_rad=-0.6)


@cache
def seen(error: MountError) -> tuple[Frame, CameraSetup]:
    """A frame by a camera that hangs so far from where it is believed, and that camera."""
    look = Look(mounts=Mounts(overhead=error, wrist=error))
    world = build_world(PRODUCT, BENCH, None, None, None, look)
    sensor = SensorSetup(BENCH.overhead, look.camera, np.random.default_rng(1))
    photographer = Photographer(world.model, {"overhead": sensor})
    pose = world.camera_pose("overhead")
    frame = photographer.take(Exposure("overhead", 0, 0.0, pose, (visible_poses(world.data),)))
    photographer.close()
    true = true_camera(world, "overhead", BENCH.overhead)
    mount = Mount(position_m=true["position_m"], quaternion_wxyz=true["quaternion_wxyz"])
    return frame, BENCH.overhead.model_copy(update={"mount": mount})


def test_a_camera_a_centimetre_and_a_degree_off_is_found_to_a_millimetre_and_a_half_at_the_holes() -> None:
    frame, true = seen(FARTHER)
    fit = fit_camera([Shot(frame.image, WORLD)], BENCH.overhead, BENCH, PRODUCT)
    assert holes_off_m(BENCH.overhead, true, BENCH, PRODUCT) > 0.008
    assert holes_off_m(fit.setup, true, BENCH, PRODUCT) < 0.0015
    assert trouble(fit, 1, BENCH, PRODUCT) == ""


def test_a_camera_that_hangs_where_it_is_believed_stays_there_for_what_is_high_over_the_table_too() -> None:
    """Points of an edge err together, as it lies between rows of pixels: fitted one by one they tilt the camera."""
    frame, true = seen(MountError())
    found = fit_over_empty_plate([Shot(frame.image, WORLD)], BENCH.overhead, BENCH, PRODUCT).setup
    columns, rows = np.meshgrid(np.linspace(40, 440, 5), np.linspace(40, 320, 5))
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    for height_m in (0.0, 0.2):
        views = (setup.model.onto_plane(setup.mount.pose, pixels, height_m) for setup in (found, true))
        assert float(np.median(np.linalg.norm(np.subtract(*views), axis=1))) < 0.0006, height_m


@pytest.mark.parametrize("azimuth_rad", [-2.0, 0.0, 1.5])
def test_a_camera_that_hangs_further_off_than_the_search_reaches_is_found_by_the_empty_holes(
    azimuth_rad: float,
) -> None:
    far = MountError(shift_m=0.015, shift_azimuth_rad=azimuth_rad, turn_rad=0.021, turn_azimuth_rad=azimuth_rad + 1.6)
    frame, true = seen(far)
    fit = fit_over_empty_plate([Shot(frame.image, WORLD)], BENCH.overhead, BENCH, PRODUCT)
    assert holes_off_m(BENCH.overhead, true, BENCH, PRODUCT) > 0.03
    assert holes_off_m(fit.setup, true, BENCH, PRODUCT) < 0.0015
    assert not too_few_holes(fit, PRODUCT)


def test_five_of_six_holes_are_not_taken_for_their_neighbours() -> None:
    seed = 906_015  # an end hole is too dark to be seen; one hole further along, as many holes and more edges were seen
    hard = simulated(load_configuration(), "hard")
    world = build_world(PRODUCT, BENCH, None, None, None, settings_of(hard.devices.simulation).look.draw(seed))
    true = BENCH.overhead.calibrated(true_calibration(world, "overhead", BENCH.overhead))
    found = calibrated_bench(hard, PRODUCT, seed, world).overhead
    assert holes_off_m(BENCH.overhead, true, BENCH, PRODUCT) > 0.03
    assert holes_off_m(found, true, BENCH, PRODUCT) < 0.0015


@pytest.mark.long
@pytest.mark.parametrize(
    "seeds",  # the last one was lost
    [(830_800, 811_012), pytest.param((830_800, 830_801, 830_802, 830_803, 811_012), marks=pytest.mark.slow)],
)
def test_lit_walls_of_holes_do_not_pull_the_wrist_camera_aside(seeds: tuple[int, ...]) -> None:
    assert np.mean([wrist_off_m(seed) for seed in seeds]) < 0.0015


@pytest.mark.parametrize(
    "seed", [837_082, pytest.param(837_112, marks=pytest.mark.slow)]
)  # 111 mm off; and a lens that no bench may have
def test_a_wrist_camera_that_is_lost_at_first_is_found_from_elsewhere(seed: int) -> None:
    assert wrist_off_m(seed) < 0.004


def wrist_off_m(seed: int) -> float:
    """How far a calibrated wrist camera of the look "hard" sees the middle of the tray off."""
    hard = simulated(load_configuration(), "hard")
    world = build_world(PRODUCT, BENCH, None, None, None, settings_of(hard.devices.simulation).look.draw(seed))
    believed = calibrated_bench(hard, PRODUCT, seed, world)
    true = BENCH.model_copy(update={"wrist": BENCH.wrist.calibrated(true_calibration(world, "wrist", BENCH.wrist))})
    world.set_arm(BENCH.arm_look_rad)
    tool, floor = world.tool_pose(), BENCH.tray.centre_m
    pixels = true.wrist.model.project(tool @ true.wrist.mount.pose, np.array([floor]))
    seen_m = believed.wrist.model.onto_plane(tool @ believed.wrist.mount.pose, pixels, floor[2])
    return float(np.linalg.norm(seen_m - floor))


def test_a_plate_whose_holes_are_not_seen_is_no_empty_one() -> None:
    frame, _ = seen(MountError())
    image = frame.image.copy()
    for column, row in BENCH.overhead.model.project(
        BENCH.overhead.mount.pose, PlateModel.of(BENCH, PRODUCT).holes_m
    ).round():
        image[int(row) - 6 : int(row) + 7, int(column) - 6 : int(column) + 7] = 110
    fit = fit_over_empty_plate([Shot(image, WORLD)], BENCH.overhead, BENCH, PRODUCT)
    assert too_few_holes(fit, PRODUCT)


def test_an_image_without_a_plate_calibrates_nothing() -> None:
    blank = np.full((BENCH.overhead.height_px, BENCH.overhead.width_px, 3), 90, np.uint8)
    fit = fit_camera([Shot(blank, WORLD)], BENCH.overhead, BENCH, PRODUCT)
    assert fit.images == 0
    assert math.isinf(fit.rms_px)
    assert "seen in 0 of 1" in trouble(fit, 1, BENCH, PRODUCT)


@pytest.mark.parametrize(("error", "words"), [(MountError(), ""), (MountError(shift_m=0.02), "mm off")])
def test_a_shift_beyond_the_limit_is_told_after_looks_that_agree(error: MountError, words: str) -> None:
    frame, _ = seen(error)
    check = CalibrationCheck(BENCH, PRODUCT)
    told = [check.judge(at(frame, 0.3 * number), AWAY) for number in range(10)]
    assert told[0] == ""
    assert words in told[-1]
    assert bool(told[-1]) == bool(words)


def test_a_camera_that_is_pushed_during_the_run_is_noticed_within_a_minute_and_not_behind_a_hand() -> None:
    sound, _ = seen(MountError())
    pushed, _ = seen(MountError(shift_m=0.02))
    check = CalibrationCheck(BENCH, PRODUCT)
    for number in range(6):
        assert check.judge(at(sound, float(number)), AWAY) == ""
    for number in range(20):
        assert check.judge(at(pushed, EVERY_S + 2 + number), OVER_PLATE) == ""
    told = [check.judge(at(pushed, EVERY_S + 30 + number), None) for number in range(5)]
    assert "run `cell setup calibrate`" in told[-1]


def test_a_plate_that_is_nearly_full_is_not_taken_for_a_pushed_camera() -> None:
    """Seed 931001 of `varied`, with a person who errs: the run was stopped, "the holes 16 mm off"."""
    configuration = simulated(CONFIGURATION, "varied", None)
    bench = calibrated_bench(configuration, PRODUCT, 931_001)
    stored = cv2.imread(str(Path(__file__).parent / "plate_nearly_full.jpg"))
    assert stored is not None
    image = np.asarray(cv2.cvtColor(stored, cv2.COLOR_BGR2RGB), np.uint8)
    check = CalibrationCheck(bench, PRODUCT)
    frames = (Frame("overhead", number, float(number), image, bench.overhead.mount.pose) for number in range(LOOKS + 1))
    assert [check.judge(frame, AWAY) for frame in frames] == [""] * (LOOKS + 1)


@pytest.mark.parametrize("shift_m", [0.0, 0.004, 0.02])
@pytest.mark.parametrize("azimuth_rad", [0.0, 1.2])
def test_the_wrist_camera_is_judged_by_the_rim_of_the_tray(shift_m: float, azimuth_rad: float) -> None:
    look = Look(mounts=Mounts(wrist=MountError(shift_m=shift_m, shift_azimuth_rad=azimuth_rad)))
    world = build_world(PRODUCT, BENCH, None, None, None, look)
    world.set_arm(BENCH.arm_look_rad)
    photographer = Photographer(world.model, {"wrist": SensorSetup(BENCH.wrist, look.camera, np.random.default_rng(1))})
    check = TrayCheck(BENCH)
    told = []
    for number in range(LOOKS):
        exposure = Exposure("wrist", number, 3.0 * number, world.camera_pose("wrist"), (visible_poses(world.data),))
        told.append(check.judge(photographer.take(exposure)))
    off = tray_off_m(photographer.take(exposure).image, exposure.world_from_camera, BENCH)
    photographer.close()
    assert off is not None
    assert float(np.linalg.norm(off)) == pytest.approx(shift_m, abs=0.001)
    assert told[:-1] == [""] * (LOOKS - 1)
    assert ("run `cell setup calibrate`" in told[-1]) == (shift_m > 0.01)


OVER_PLATE = HandSample(0.0, (240, 100, 330, 260), (0.72, 0.1), (0.8, 0.1))
AWAY = HandSample(0.0, (400, 300, 470, 359), (1.1, 0.4), (1.2, 0.4))


def at(frame: Frame, time_s: float) -> Frame:
    return Frame(frame.camera, frame.sequence, time_s, frame.image, frame.world_from_camera)


def test_the_driver_keeps_its_mount_and_what_it_tells_is_corrected() -> None:
    found = Mount(position_m=(0.01, -0.08, -0.12), quaternion_wxyz=(1.0, 0.0, 0.0, 0.0))
    calibration = Calibration(wrist=CameraCalibration(mount=found, focal_px=421.0, distortion_k1=-0.02))
    bench = pickle.loads(pickle.dumps(BENCH.calibrated(calibration)))
    assert bench.drawn == BENCH
    assert bench.overhead == BENCH.overhead
    assert bench.wrist.model.distortion_k1 == -0.02
    tool = Pose.from_yaw((0.5, 0.1, 0.3), 0.4)
    told = tool @ BENCH.wrist.mount.pose
    corrected, wanted = bench.wrist.corrected(told), tool @ found.pose
    assert np.allclose(corrected.matrix, wanted.matrix)
    assert BENCH.wrist.corrected(told) is told
