"""The simulated cameras: geometry as the camera model says, frames on time, noise as configured."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from bracket_ground.contracts import camera as camera_contract
from bracket_ground.contracts.camera import CHECKS, Check
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.devices.clock import SimClock
from bracket_sim.rendering.camera import SimCamera
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup
from bracket_sim.rendering.studio import Studio
from bracket_sim.scene.clutter import standing
from bracket_sim.scene.look import Camera
from bracket_sim.scene.world import World, build_world
from tests.sim.conftest import MakeRig

CameraName = Literal["overhead", "wrist"]


@pytest.fixture
def looking(product: Product, bench: Bench) -> World:
    """One part of each type in the tray, arm at its look pose; and an o1 on the bracket."""
    x, y, _ = bench.tray.centre_m
    scene = [
        standing(product, bench.tray, "o1", (x + 0.05, y + 0.10), 0.4),
        standing(product, bench.tray, "o2", (x - 0.06, y), -0.7),
        standing(product, bench.tray, "o3", (x + 0.03, y - 0.11), 1.9),
        standing(product, bench.tray, "o1", (x, y), 0.0),
    ]
    world = build_world(product, bench, scene)
    hole = np.array([*product.bracket.holes_m["p6"], 0.0])
    px, py, pz = bench.bracket.pose.transform(hole)
    world.place(world.bodies[3], Pose((float(px), float(py), float(pz))))
    world.set_arm(bench.arm_look_rad)
    return world


def check_silhouette(world: World, camera: CameraName, part_index: int, tolerance_px: float) -> None:
    """The part's pixels reach as far as the camera model projects its solids."""
    setup = getattr(world.bench, camera)
    studio = Studio(world)
    image = studio.render(camera, setup.width_px, setup.height_px).astype(np.float64)
    studio.close()
    part = world.bodies[part_index]
    kind = world.product.parts[part.part]
    pose = world.part_pose(part)
    surface = pose.transform(np.concatenate([solid.points() for solid in kind.solids]))
    pixels = setup.model.project(world.camera_pose(camera), surface)
    left, top = pixels.min(axis=0)
    right, bottom = pixels.max(axis=0)
    main = int(np.argmax(kind.colour_rgb))
    painted = image[..., main] > 1.7 * np.delete(image, main, axis=2).max(axis=2)
    window = np.zeros_like(painted)
    window[int(top) - 6 : int(bottom) + 8, int(left) - 6 : int(right) + 8] = True
    rows, columns = np.nonzero(painted & window)
    seen = np.array([columns.min() - 0.5, rows.min() - 0.5, columns.max() + 0.5, rows.max() + 0.5])
    np.testing.assert_allclose(seen, [left, top, right, bottom], atol=tolerance_px)


@pytest.mark.parametrize("part_index", range(3))
def test_the_wrist_camera_sees_parts_where_the_model_says(looking: World, part_index: int) -> None:
    check_silhouette(looking, "wrist", part_index, 1.0)


def test_the_overhead_camera_sees_parts_where_the_model_says(looking: World) -> None:
    check_silhouette(looking, "overhead", 3, 1.0)


def test_holes_are_dark_and_the_plate_is_grey(looking: World) -> None:
    bench, product = looking.bench, looking.product
    studio = Studio(looking)
    image = studio.render("overhead", bench.overhead.width_px, bench.overhead.height_px)
    studio.close()
    for name, hole in product.bracket.holes_m.items():
        points = bench.bracket.pose.transform(np.array([[*hole, -0.01], [hole[0] + 0.035, hole[1], 0.0]]))
        pixels = np.rint(bench.overhead.model.project(bench.overhead.mount.pose, points)).astype(int)
        inside, beside = (image[row, column].astype(int) for column, row in pixels)
        assert beside.min() > 90
        assert beside.max() - beside.min() < 20
        if name != "p6":
            assert inside.max() < 40


def test_the_parked_arm_is_out_of_the_overhead_view(looking: World) -> None:
    setup = looking.bench.overhead
    studio = Studio(looking)
    looking.set_arm(looking.bench.arm_park_rad)
    parked = studio.render("overhead", setup.width_px, setup.height_px).astype(int)
    looking.set_arm((-2.6, *looking.bench.arm_park_rad[1:]))
    away = studio.render("overhead", setup.width_px, setup.height_px).astype(int)
    studio.close()
    changed = np.argwhere(np.abs(parked - away).max(axis=2) > 8)
    holes = looking.bench.bracket.pose.transform(
        np.array([[*hole, 0.0] for hole in looking.product.bracket.holes_m.values()])
    )
    leftmost = setup.model.project(setup.mount.pose, holes)[:, 0].min()
    assert not len(changed) or changed[:, 1].max() < leftmost - 30


def test_frames_come_on_time_and_without_gaps(make_rig: MakeRig) -> None:
    rig = make_rig(frames=True)
    camera, clock = rig.cell.devices.overhead, rig.cell.devices.clock
    times = {}
    for period in range(60):
        clock.sleep_until(period * 0.008)
        frame = camera.latest()
        assert frame is not None
        times[frame.sequence] = frame.time_s
    assert list(times) == list(range(8))
    for sequence, time_s in times.items():
        assert 0 <= time_s - sequence / 15 + 1e-9 < 0.008


def test_the_wrist_camera_sends_one_frame_for_each_trigger(make_rig: MakeRig) -> None:
    rig = make_rig()
    camera = rig.cell.devices.wrist
    rig.wait(0.2)
    assert camera.latest() is None
    camera.trigger()
    rig.wait(0.2)
    frame = camera.latest()
    assert frame is not None
    assert frame.sequence == 0
    assert frame.time_s == pytest.approx(0.208)
    expected = rig.cell.world.tool_pose() @ rig.cell.world.bench.wrist.mount.pose
    np.testing.assert_allclose(frame.world_from_camera.matrix, expected.matrix, atol=1e-6)


def test_noise_has_the_configured_strength_and_is_new_in_every_frame(product: Product, bench: Bench) -> None:
    world = build_world(product, bench, ())
    studio = Studio(world)
    noise = Camera(noise_levels=3.0, brightness_jitter=0.0, blur_px=0.0)
    sensors = {"overhead": SensorSetup(bench.overhead, noise, np.random.default_rng(0))}
    photographer = Photographer(world.model, sensors)
    camera = SimCamera("overhead", bench.overhead, world, photographer.take)
    clean = studio.render("overhead", bench.overhead.width_px, bench.overhead.height_px).astype(int)
    images = []
    for time_s in (0.0, 0.072):
        camera.observe(time_s)
        frame = camera.latest()
        assert frame is not None
        images.append(frame.image.astype(int))
    photographer.close()
    studio.close()
    bright = clean > 20
    assert (images[0] - clean)[bright].std() == pytest.approx(3.0, rel=0.05)
    assert (images[0] - images[1])[bright].std() == pytest.approx(3.0 * 2**0.5, rel=0.05)


@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS[:-1])
@pytest.mark.parametrize("name", ["overhead", "wrist"])
def test_contract(product: Product, bench: Bench, name: CameraName, check: Check) -> None:
    setup, world = getattr(bench, name), build_world(product, bench, [])
    image = np.zeros((setup.height_px, setup.width_px, 3), np.uint8)

    def take(exposure: Exposure) -> Frame:
        return Frame(name, exposure.sequence, exposure.time_s, image, exposure.world_from_camera)

    camera = SimCamera(name, setup, world, take)
    check(camera_contract.Bench(camera, SimClock(world, [], [camera]), (setup.width_px, setup.height_px)))
