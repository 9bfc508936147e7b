"""Depth images: spoilt as stereo spoils them, handed on between processes, and no change to the colours."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame, PendingFrame, apart
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.rendering.photographer import DISPARITY_PX, Exposure, Photographer, SensorSetup, Stereo
from bracket_sim.rendering.studio import visible_poses
from bracket_sim.scene.look import NOMINAL
from bracket_sim.scene.world import build_world

FAR_M, NEAR_M = 1.3, 1.0


def spoilt(bench: Bench, depths_m: np.ndarray[tuple[int, int], np.dtype[np.float32]], seed: int = 0) -> np.ndarray:
    return Stereo(bench.overhead, NOMINAL.camera, np.random.default_rng(seed)).spoil(depths_m)


def flat(bench: Bench, depth_m: float) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    return np.full((bench.overhead.height_px, bench.overhead.width_px), depth_m, np.float32)


def test_the_error_grows_with_the_square_of_the_distance(bench: Bench) -> None:
    spreads = []
    for depth_m in (0.7, 1.4):
        told = spoilt(bench, flat(bench, depth_m))
        spreads.append(float(told[told > 0].std()))
    assert spreads[1] / spreads[0] == pytest.approx(4, rel=0.1)
    assert spreads[1] == pytest.approx(1e3 * 1.4**2 * DISPARITY_PX / (425 * 0.05), rel=0.1)


def test_neighbours_err_alike_and_some_are_lost(bench: Bench) -> None:
    told = spoilt(bench, flat(bench, FAR_M)).astype(float)
    told[told == 0] = np.nan
    beside, away = (np.nanstd(told[:, step:] - told[:, :-step]) for step in (1, 30))
    assert beside < 0.5 * away
    assert 0.01 < np.isnan(told).mean() < 0.06


def test_what_is_near_is_fattened_and_hides_a_strip_from_the_second_camera(bench: Bench) -> None:
    depths_m = flat(bench, FAR_M)
    depths_m[100:200, 200:260] = NEAR_M
    told = spoilt(bench, depths_m)
    row = told[150]
    assert abs(float(np.median(row[261:262])) / 1e3 - NEAR_M) < 0.05, "two pixels beyond its edge"
    strip_px = bench.overhead.focal_px * 0.05 * (1 / NEAR_M - 1 / FAR_M)
    lost = (told[105:195, 180:200] == 0).mean(axis=0)
    assert lost[-3:].min() > 0.9
    assert lost[: 20 - int(strip_px) - 2].max() < 0.3


def test_what_is_too_near_is_not_known(bench: Bench) -> None:
    assert not spoilt(bench, flat(bench, 0.2)).any()


def test_steel_and_black_things_lose_their_depth_and_others_keep_it(product: Product, bench: Bench) -> None:
    """The table keeps its depth, so that only the chosen share of the things is lost."""
    shares = []
    for holes in (0.0, 0.6):
        world = build_world(product, bench)
        model = world.model
        model.geom_matid[:], model.geom_rgba[:, :3] = -1, 0.6
        plate = np.flatnonzero(np.linalg.norm(world.data.geom_xpos[:, :2] - bench.tray.centre_m[:2], axis=1) < 0.02)
        model.geom_rgba[plate, :3] = 0.05
        setup = bench.overhead.model_copy(update={"depth": True})
        look = NOMINAL.camera.model_copy(update={"depth_holes": holes})
        photographer = Photographer(model, {"overhead": SensorSetup(setup, look, np.random.default_rng(3))})
        pose = world.camera_pose("overhead")
        frame = photographer.take(Exposure("overhead", 0, 0.0, pose, (visible_poses(world.data),)))
        photographer.close()
        assert frame.depth_mm is not None
        corners = np.array(bench.tray.centre_m) + np.array([[-0.08, -0.08, 0.0], [0.08, 0.08, 0.0]])
        low, high = np.sort(bench.overhead.model.project(pose, corners), axis=0).astype(int)
        of_tray = frame.depth_mm[low[1] : high[1], low[0] : high[0]]
        shares.append((float((of_tray == 0).mean()), float((frame.depth_mm == 0).mean())))
    assert shares[0][0] < 0.1
    assert 0.45 < shares[1][0] < 0.75
    assert shares[1][1] < 0.35


def test_a_camera_with_depth_has_the_same_colours(product: Product, bench: Bench) -> None:
    world = build_world(product, bench)
    frames = []
    for depth in (False, True):
        setup = bench.overhead.model_copy(update={"depth": depth})
        photographer = Photographer(
            world.model, {"overhead": SensorSetup(setup, NOMINAL.camera, np.random.default_rng(3))}
        )
        pose = world.camera_pose("overhead")
        frames.append(photographer.take(Exposure("overhead", 0, 0.0, pose, (visible_poses(world.data),))))
        photographer.close()
    np.testing.assert_array_equal(frames[0].image, frames[1].image)
    assert frames[0].depth_mm is None
    depth_mm = frames[1].depth_mm
    assert depth_mm is not None
    table_mm = 1e3 * bench.overhead.mount.position_m[2]
    assert abs(float(np.median(depth_mm[depth_mm > 0])) - table_mm) < 30


def test_image_and_depth_travel_as_one_array() -> None:
    rng = np.random.default_rng(0)
    image, depth = rng.integers(0, 256, (6, 8, 3), np.uint8), rng.integers(0, 65536, (6, 8), np.uint16)
    whole = Frame("overhead", 0, 0.0, image, Pose((0.0, 0.0, 1.0)), depth_mm=depth)
    pending = PendingFrame("overhead", 0, 0.0, lambda: whole.pixels, whole.world_from_camera)
    for frame in (pending, pending.beside(None), pickle.loads(pickle.dumps(pending))):
        np.testing.assert_array_equal(frame.image, image)
        np.testing.assert_array_equal(frame.depth_mm, depth)
    colours = Frame("overhead", 0, 0.0, image, whole.world_from_camera)
    assert colours.pixels is image
    assert apart(image) == (image, None)


def test_the_wrist_camera_has_none(bench: Bench) -> None:
    values = bench.model_dump()
    values["wrist"]["depth"] = True
    with pytest.raises(ValueError, match="wrist"):
        Bench.model_validate(values)
