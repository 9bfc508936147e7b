"""What a look's camera does to images, and when its frames come; the controller is told of none of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bracket_cell.learned.classical.grain import Grain
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.rendering.camera import Delivery, SimCamera
from bracket_sim.rendering.photographer import Exposure, Image, Photographer, Sensor, SensorSetup
from bracket_sim.rendering.studio import ScenePoses, Studio, visible_poses
from bracket_sim.scene.lens import Lens
from bracket_sim.scene.look import NOMINAL, Camera, Look, MountError, Mounts
from bracket_sim.scene.world import World, build_world

PERIOD_S = 0.008
CLEAN = {"noise_levels": 0.0, "brightness_jitter": 0.0, "blur_px": 0.0}


def spoiled(bench: Bench, image: Image, **knobs: float) -> Image:
    camera = Camera.model_validate({**CLEAN, **knobs})
    return Sensor(bench.overhead, camera, np.random.default_rng(0)).spoil(image)


@pytest.fixture
def picture(bench: Bench) -> Image:
    size = (bench.overhead.height_px, bench.overhead.width_px, 3)
    smooth = np.random.default_rng(1).integers(40, 120, (6, 8, 3)).astype(np.uint8)
    return np.kron(smooth, np.ones((size[0] // 6, size[1] // 8, 1), np.uint8))


def test_a_clean_camera_changes_nothing(bench: Bench, picture: Image) -> None:
    assert np.array_equal(spoiled(bench, picture), picture)


def test_brightness_and_white_balance_multiply(bench: Bench, picture: Image) -> None:
    image = spoiled(bench, picture, brightness_ev=1.0, red_gain=0.5, blue_gain=1.2).astype(float)
    np.testing.assert_allclose(image, np.minimum(picture * np.array([1.0, 2.0, 2.4]), 255), atol=1)


def test_jpeg_leaves_the_mean_and_loses_detail(bench: Bench, picture: Image) -> None:
    rough = np.random.default_rng(2).integers(0, 255, picture.shape).astype(np.uint8)
    errors = [np.abs(spoiled(bench, rough, jpeg=True, jpeg_quality=q).astype(int) - rough).mean() for q in (25, 80)]
    assert errors[0] > errors[1] > 1
    kept = spoiled(bench, picture, jpeg=True, jpeg_quality=80).astype(float)
    np.testing.assert_allclose(kept.mean(axis=(0, 1)), picture.mean(axis=(0, 1)), atol=1)


def test_noise_never_comes_again_even_after_jpeg(bench: Bench, picture: Image) -> None:
    sensor = Sensor(bench.overhead, Camera(jpeg=True, jpeg_quality=95), np.random.default_rng(2))
    grain, again = Grain(), 0
    for _ in range(520):
        grain.see(np.ascontiguousarray(sensor.spoil(picture)[::4, ::4]))
        again += grain.ago > 0
    assert again == 0


@pytest.mark.parametrize("k1", [-0.3, -0.06, 0.02])
def test_the_lens_puts_points_where_the_distortion_says(bench: Bench, k1: float) -> None:
    setup, camera = bench.overhead, Camera(distortion_k1=k1, focal_error=0.01)
    lens = Lens(setup, camera)
    middle = np.array([(setup.width_px - 1) / 2, (setup.height_px - 1) / 2])
    straight = np.array([0.25, -0.20])  # x / z, y / z of a point that is seen
    rendered = np.zeros((setup.height_px, setup.width_px, 3), np.uint8)
    column, row = np.rint(straight * lens.rendered_focal_px + middle).astype(int)
    rendered[row - 2 : row + 3, column - 2 : column + 3] = 255
    exact = (np.array([column, row]) - middle) / lens.rendered_focal_px
    expected = exact * (1 + k1 * (exact**2).sum()) * setup.focal_px * 1.01 + middle
    rows, columns = np.nonzero(lens.bend(rendered)[..., 0] > 127)
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected, atol=0.6)


def test_a_distorted_image_is_filled_to_its_corners(bench: Bench) -> None:
    lens = Lens(bench.overhead, Camera(distortion_k1=-0.4, distortion_k2=-0.1))
    ones = np.full((bench.overhead.height_px, bench.overhead.width_px, 3), 200, np.uint8)
    assert (lens.bend(ones) == 200).all()
    assert lens.rendered_focal_px < bench.overhead.focal_px


class Clockwork:
    """A camera that makes no images: only when frames come counts."""

    def __init__(self, bench: Bench, world: World, **knobs: float) -> None:
        self.exposures: list[Exposure] = []
        self.arrivals: dict[int, float] = {}
        delivery = Delivery(Camera.model_validate(knobs), 0.0, np.random.default_rng(3))
        self.camera = SimCamera("overhead", bench.overhead, world, self._take, delivery)

    def _take(self, exposure: Exposure) -> Frame:
        self.exposures.append(exposure)
        image = np.zeros((1, 1, 3), np.uint8)
        return Frame(exposure.camera, exposure.sequence, exposure.time_s, image, exposure.world_from_camera)

    def run(self, duration_s: float) -> None:
        for period in range(math.ceil(duration_s / PERIOD_S)):
            self.camera.observe(period * PERIOD_S)
            frame = self.camera.latest()
            if frame is not None:
                self.arrivals.setdefault(frame.sequence, period * PERIOD_S)


@pytest.fixture(scope="module")
def world(product: Product, bench: Bench) -> World:
    return build_world(product, bench, ())


def test_the_shutter_is_open_as_long_as_the_look_says(bench: Bench, world: World) -> None:
    camera = Clockwork(bench, world, exposure_s=0.024)
    camera.run(1.0)
    times = [exposure.time_s for exposure in camera.exposures]
    assert all(0 <= time_s - number / 15 + 1e-9 < PERIOD_S for number, time_s in enumerate(times))
    assert {len(exposure.moments) for exposure in camera.exposures[1:]} <= {3, 4}
    assert len(camera.exposures[0].moments) == 1  # the run begins


def test_dropped_frames_leave_gaps(bench: Bench, world: World) -> None:
    camera = Clockwork(bench, world, dropped_share=0.25)
    camera.run(20.0)
    assert 0.6 < len(camera.arrivals) / 300 < 0.9
    assert list(camera.arrivals) == sorted(camera.arrivals)
    assert max(camera.arrivals) > 290


def test_late_frames_come_late_and_never_go_back(bench: Bench, world: World) -> None:
    camera = Clockwork(bench, world, late_share=0.3, late_s=0.05)
    camera.run(20.0)
    delays = [
        round(camera.arrivals[e.sequence] - e.time_s, 3) for e in camera.exposures if e.sequence in camera.arrivals
    ]
    assert set(delays) == {0.0, 0.056}  # the first control period after .05 s
    assert 0.2 < sum(delay > 0 for delay in delays) / len(delays) < 0.4


def test_the_true_mount_moves_the_picture_and_not_what_the_controller_is_told(product: Product, bench: Bench) -> None:
    error = MountError(shift_m=0.02, shift_azimuth_rad=0.3, turn_rad=0.03, turn_azimuth_rad=1.0)
    pictures, frames = [], []
    for look in (NOMINAL, Look(mounts=Mounts(overhead=error, wrist=error))):
        world = build_world(product, bench, (), look=look)
        sensors = {"overhead": SensorSetup(bench.overhead, Camera.model_validate(CLEAN), np.random.default_rng(0))}
        photographer = Photographer(world.model, sensors)
        camera = SimCamera("overhead", bench.overhead, world, photographer.take)
        camera.observe(0.0)
        frame = camera.latest()
        assert frame is not None
        frames.append(frame)
        pictures.append(hole_px(frame.image, bench, error if look is not NOMINAL else MountError()))
        photographer.close()
    assert frames[0].world_from_camera == frames[1].world_from_camera == bench.overhead.mount.pose
    assert frames[0].image.shape == frames[1].image.shape
    assert all(dark for dark in pictures)
    assert not hole_px(frames[1].image, bench, MountError())


def test_what_moves_while_the_shutter_is_open_is_blurred_and_what_stands_is_drawn_once(
    product: Product, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = build_world(product, bench, ())
    sensors = {"overhead": SensorSetup(bench.overhead, Camera.model_validate(CLEAN), np.random.default_rng(0))}
    photographer, drawn = Photographer(world.model, sensors), list[object]()

    def moment(turn_rad: float) -> ScenePoses:
        first, *others = bench.arm_look_rad
        world.set_arm(np.array([first + turn_rad, *others]))
        return visible_poses(world.data)

    def taken(*moments: ScenePoses) -> Image:
        drawn.clear()
        return photographer.take(Exposure("overhead", 0, 0.0, bench.overhead.mount.pose, moments)).image

    def counted(*given: Any) -> Image:
        drawn.append(given)
        return clean(*given)

    clean = photographer._clean
    monkeypatch.setattr(photographer, "_clean", counted)
    moments = [moment(turn) for turn in (0.0, 0.01, 0.02)]
    single = [taken(one) for one in moments]
    np.testing.assert_allclose(taken(*moments), np.mean(single, axis=0), atol=0.51)
    assert len(drawn) == 3
    assert np.array_equal(taken(moments[0], moments[0]), single[0])
    assert len(drawn) == 1
    photographer.close()


def hole_px(image: Image, bench: Bench, error: MountError) -> bool:
    """Whether the first hole is dark where a camera with this error sees it."""
    point = bench.bracket.pose.transform(np.array([[0.0, 0.2, -0.006]]))
    column, row = np.rint(bench.overhead.model.project(error.apply(bench.overhead.mount.pose), point)[0]).astype(int)
    return bool(image[row - 1 : row + 2, column - 1 : column + 2].max() < 40)


def test_a_mount_without_error_is_the_believed_one(bench: Bench) -> None:
    pose = bench.wrist.mount.pose
    assert MountError().apply(pose) is pose
    turned = MountError(turn_rad=0.1, turn_elevation_rad=math.pi / 2).apply(Pose((0.0, 0.0, 0.0)))
    assert turned.yaw_rad == pytest.approx(0.1)


def test_the_wrist_camera_is_where_its_true_mount_is(product: Product, bench: Bench) -> None:
    error = MountError(shift_m=0.01, shift_elevation_rad=0.2, turn_rad=0.02)
    look = Look(mounts=Mounts(wrist=error))
    world = build_world(product, bench, (), look=look)
    true = world.tool_pose() @ error.apply(bench.wrist.mount.pose)
    np.testing.assert_allclose(world.data.cam("wrist").xpos, true.position_m, atol=1e-9)
    studio = Studio(world)
    assert studio.render("wrist", bench.wrist.width_px, bench.wrist.height_px).any()
    studio.close()
