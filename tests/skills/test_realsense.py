"""The RealSense driver against a made-up pyrealsense2 with the modes of a D435: depth by pixels of the colour image."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.runs import calibrating
from bracket_cell.skills.drivers import cameras
from bracket_cell.skills.drivers.settings import RealsenseSettings
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.frame import Frame

SIZES = ((424, 240), (640, 360), (640, 480), (848, 480), (1280, 720))
UNIT_M = 0.0001  # of a D405; a D435 has 1 mm
COLOUR, DEPTH = "colour", "depth"
PERIOD_S = 0.01


class Made:
    """Attributes by name, of anything that is asked for by a call without arguments."""

    def __init__(self, **told: Any) -> None:
        self.__dict__.update({name: (lambda *_, value=value: value) for name, value in told.items()})


class Config:
    def __init__(self) -> None:
        self.streams: dict[str, tuple[int, int]] = {}

    def enable_stream(self, stream: str, width: int, height: int, pixel: str, rate: int) -> None:
        del pixel, rate
        self.streams[stream] = width, height


def profile(stream: str, size: tuple[int, int]) -> Made:
    video = Made(width=size[0], height=size[1], fps=15)
    kind = {COLOUR: "rgb8", DEPTH: "z16"}[stream]
    return Made(stream_type=stream, format=kind, as_video_stream_profile=video)


class Pipeline:
    """Sends images; depths are of the depth sensor's own pixels until they are aligned."""

    aligned: bool
    number = 0
    model, coeffs = "inverse_brown_conrady", (0.0,) * 5  # of a D435's colour camera

    def start(self, config: Config) -> Made:
        if any(size not in SIZES for size in config.streams.values()):
            raise RuntimeError("Couldn't resolve requests")
        self.streams = config.streams
        options = SimpleNamespace(set_option=lambda *_: None)
        device = Made(first_color_sensor=options, first_depth_sensor=Made(get_depth_scale=UNIT_M))
        width, height = config.streams[COLOUR]
        told = {"fx": 615.2 * width / 640, "fy": 614.9 * width / 640, "ppx": 0.51 * width, "ppy": 0.49 * height}
        lens = SimpleNamespace(**told, model=self.model, coeffs=self.coeffs)
        video = Made(as_video_stream_profile=Made(get_intrinsics=lens))
        return Made(get_device=device, get_stream=video)

    def wait_for_frames(self, limit_ms: int) -> Made:
        del limit_ms
        time.sleep(PERIOD_S)
        self.number += 1
        width, height = self.streams[COLOUR]
        image = np.full((height, width, 3), self.number % 250, np.uint8)
        colour = Made(
            get_frame_number=self.number,
            get_frame_timestamp_domain="host",
            get_timestamp=1000 * time.time(),
            get_data=image,
        )
        return Made(get_color_frame=colour, get_depth_frame=None, size=(width, height))

    def stop(self) -> None:
        pass


class Align:
    def __init__(self, stream: str) -> None:
        assert stream == COLOUR

    def process(self, frames: Any) -> Made:
        width, height = frames.size()
        raw = np.full((height, width), 13000, np.uint16)
        raw[:, : width // 2] = 0
        return Made(get_color_frame=frames.get_color_frame(), get_depth_frame=Made(get_data=raw))


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    fake: Any = ModuleType("pyrealsense2")
    fake.stream = SimpleNamespace(color=COLOUR, depth=DEPTH)
    fake.format = SimpleNamespace(rgb8="rgb8", z16="z16")
    names = ("enable_auto_exposure", "enable_auto_white_balance", "exposure", "global_time_enabled")
    fake.option = SimpleNamespace(**{name: name for name in names})
    fake.distortion = SimpleNamespace(brown_conrady="brown_conrady")
    fake.timestamp_domain = SimpleNamespace(global_time="host")
    fake.pipeline, fake.config, fake.align = Pipeline, Config, Align
    sensor = Made(get_stream_profiles=[profile(stream, size) for stream in (COLOUR, DEPTH) for size in SIZES])
    fake.context = lambda: Made(query_devices=[Made(query_sensors=[sensor])])
    monkeypatch.setitem(sys.modules, "pyrealsense2", fake)
    monkeypatch.delitem(sys.modules, "bracket_cell.skills.drivers.realsense", raising=False)
    yield importlib.import_module("bracket_cell.skills.drivers.realsense")
    sys.modules.pop("bracket_cell.skills.drivers.realsense", None)


def bench_of(width: int, height: int, depth: bool) -> Bench:
    bench = load_configuration().bench
    size = {"width_px": width, "height_px": height, "depth": depth}
    return bench.model_copy(update={"overhead": bench.overhead.model_copy(update=size)})


def first_frame(camera: Any) -> Frame:
    until_s = time.monotonic() + 5
    while (frame := camera.latest()) is None and time.monotonic() < until_s:
        time.sleep(PERIOD_S)
    assert isinstance(frame, Frame)
    camera.close()
    return frame


def test_depths_come_in_millimetres_by_the_pixels_of_the_colours(driver: Any) -> None:
    frame = first_frame(driver.RealsenseCamera(RealsenseSettings(), WallClock(), bench_of(848, 480, True), "overhead"))
    assert frame.image.shape == (480, 848, 3)
    assert frame.depth_mm is not None
    assert frame.depth_mm.shape == (480, 848)
    assert not frame.depth_mm[:, :424].any()
    assert (frame.depth_mm[:, 424:] == 1300).all()


def test_a_bench_without_depth_gets_none(driver: Any) -> None:
    frame = first_frame(driver.RealsenseCamera(RealsenseSettings(), WallClock(), bench_of(640, 480, False), "overhead"))
    assert frame.depth_mm is None


def lens_of(driver: Any) -> Any:
    camera = driver.RealsenseCamera(RealsenseSettings(), WallClock(), bench_of(640, 480, False), "overhead")
    camera.close()
    return camera.lens


def test_the_lens_that_it_knows_is_told(driver: Any) -> None:
    lens = lens_of(driver)
    assert (lens.focal_px, lens.focal_y_px, lens.principal_px) == (615.2, 614.9, (0.51 * 640, 0.49 * 480))


@pytest.mark.parametrize(
    ("model", "k1", "known"),
    [("brown_conrady", 0.1, 0.1), ("inverse_brown_conrady", 0.1, None), ("brown_conrady", 9.0, None)],
)
def test_bends_of_another_model_are_not_taken_for_its_own(
    driver: Any, monkeypatch: pytest.MonkeyPatch, model: str, k1: float, known: float | None
) -> None:
    monkeypatch.setattr(Pipeline, "model", model)
    monkeypatch.setattr(Pipeline, "coeffs", (k1, 0.0, 0.0, 0.0, 0.0))
    assert getattr(lens_of(driver), "distortion_k1", None) == known


@pytest.mark.usefixtures("driver")
def test_the_doctor_compares_its_lens_with_the_bench() -> None:
    found = cameras.examine(RealsenseSettings(), WallClock(), bench_of(640, 480, False), "overhead")
    wrong = [check.remedy for check in found if "focal lengths 615.2, 614.9" in check.what]
    assert wrong == ["the bench file says focal_px: 530, focal_y_px: 530"]


def test_a_calibration_begins_with_the_lens_that_it_knows(driver: Any) -> None:
    configuration = load_configuration()
    lens = lens_of(driver)
    setup = calibrating._seen_through(configuration, "overhead", lens).bench.overhead
    assert (setup.model.focals_px == (615.2, 614.9)).all()
    assert setup.mount == configuration.bench.overhead.mount
    assert calibrating._seen_through(configuration, "overhead", None) is configuration


def test_a_size_that_it_has_not_is_refused_with_those_that_it_has(driver: Any) -> None:
    with pytest.raises(DeviceFault, match=r"it has no 480 x 360 at 15 .* legal: 424 x 240 at 15, .*640 x 480 at 15"):
        driver.RealsenseCamera(RealsenseSettings(), WallClock(), bench_of(480, 360, True), "overhead")


def test_a_camera_without_depths_says_so_where_the_bench_wants_them() -> None:
    class Colours:
        def grab(self) -> tuple[Any, float]:
            time.sleep(PERIOD_S)
            return np.zeros((48, 64, 3), np.uint8), 0.0

        def close(self) -> None:
            pass

    settings = RealsenseSettings(lost_s=0.2)
    camera = cameras.GrabbingCamera(settings, WallClock(), bench_of(64, 48, True), "overhead", lambda _: Colours())
    time.sleep(0.4)
    with pytest.raises(DeviceFault, match="sends no depths"):
        camera.latest()
    camera.close()


@pytest.mark.parametrize("stamp_s", [3600.0, -3600.0, float("nan"), -1.7e9])
def test_stamps_of_no_clock_of_this_machine_are_none(
    driver: Any, monkeypatch: pytest.MonkeyPatch, stamp_s: float
) -> None:
    usual = Pipeline.wait_for_frames

    def stamped(self: Pipeline, limit_ms: int) -> Made:
        time.sleep(0.03)
        frames: Any = usual(self, limit_ms)
        told = Made(get_timestamp=1000 * (time.time() + stamp_s))
        told.__dict__ = {**frames.get_color_frame().__dict__, **told.__dict__}
        return Made(get_color_frame=told)

    monkeypatch.setattr(Pipeline, "wait_for_frames", stamped)
    clock = WallClock()
    camera = driver.RealsenseCamera(RealsenseSettings(), clock, bench_of(640, 480, False), "overhead")
    frame = first_frame(camera)
    assert 0.0 <= clock.now_s() - frame.time_s < 5.0


def test_a_camera_that_sends_one_image_for_ever_is_opened_again(driver: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver, "FRAME_MS", 50)
    source = driver._Pipeline(RealsenseSettings(), bench_of(640, 480, False).overhead.drawn)
    calls = iter(range(10_000))

    def frozen(_: int) -> Made:
        time.sleep(PERIOD_S)
        assert next(calls) < 100, "for ever"
        return Made(get_color_frame=Made(get_frame_number=7))

    source._number, source._pipeline.wait_for_frames = 7, frozen
    with pytest.raises(OSError, match="one image again and again"):
        source.grab()


def test_whatever_it_raises_while_it_is_opened_is_a_fault(driver: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing() -> None:
        raise RuntimeError("failed to set power state")

    monkeypatch.setattr(driver.pyrealsense2, "context", nothing)
    with pytest.raises(DeviceFault, match="camera overhead: cannot be opened"):
        driver.RealsenseCamera(RealsenseSettings(), WallClock(), bench_of(641, 480, False), "overhead")


def test_a_camera_that_was_started_is_stopped_where_it_tells_no_lens(
    driver: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped: list[Pipeline] = []

    def began(self: Pipeline, config: Config) -> Made:
        def missing() -> None:
            raise RuntimeError("the device was unplugged")

        started = usual(self, config)
        started.get_stream = lambda _: missing()  # type: ignore[attr-defined]
        return started

    usual = Pipeline.start
    monkeypatch.setattr(Pipeline, "start", began)
    monkeypatch.setattr(Pipeline, "stop", lambda self: stopped.append(self))
    with pytest.raises(DeviceFault, match="cannot be opened"):
        driver.RealsenseCamera(RealsenseSettings(), WallClock(), bench_of(640, 480, False), "overhead")
    assert len(stopped) == 1, "nobody else could have opened it any more"
