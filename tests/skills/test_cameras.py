"""Camera drivers against twins, films and logs: the contract, and what a camera does wrong."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import cv2
import numpy as np
import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.skills.drivers import cameras
from bracket_cell.skills.drivers.cameras import FileCamera, StreamCamera, V4l2Camera
from bracket_cell.skills.drivers.settings import FileSettings, StreamSettings, V4l2Settings
from bracket_ground.contracts import camera as camera_contract
from bracket_ground.contracts.camera import CHECKS, Check
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_sim.twin.cameras import MjpegServer, TwinCamera

SIZE = 64, 48
PERIOD_S = 0.02


def small_bench(**wrist: Any) -> Bench:
    bench = load_configuration().bench
    size = {"width_px": SIZE[0], "height_px": SIZE[1], "rate_hz": 1 / PERIOD_S}
    cut = {name: getattr(bench, name).model_copy(update=size) for name in ("overhead", "wrist")}
    cut["wrist"] = cut["wrist"].model_copy(update=wrist)
    return bench.model_copy(update=cut)


class Shooting:
    """A server that is sent a new image every period."""

    def __init__(self) -> None:
        self.server = MjpegServer("camera", "127.0.0.1", 0)
        self.url = f"http://127.0.0.1:{self.server.port}/"
        self.number, self._ended, self._paused = 0, threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._shoot, daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        self._paused.set()
        self.server.replug()

    def replug(self) -> None:
        self._paused.clear()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.server.close()

    def _shoot(self) -> None:
        while not self._ended.wait(PERIOD_S):
            if not self._paused.is_set():
                self.number += 1
                self.server.send(numbered(self.number))


def numbered(number: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """An image whose grey level tells its number, 8 levels a step."""
    return np.full((SIZE[1], SIZE[0], 3), number * 8 % 256, np.uint8)


def number_of(frame: Frame) -> int:
    return round(float(frame.image.mean()) / 8)


@pytest.fixture
def shooting() -> Iterator[Shooting]:
    made = Shooting()
    yield made
    made.close()


@contextmanager
def streamed(shooting: Shooting, role: str = "overhead", **more: Any) -> Iterator[camera_contract.Bench]:
    settings, clock = StreamSettings(url=shooting.url, **more), WallClock()
    camera = StreamCamera(settings, clock, small_bench(), role)
    yield camera_contract.Bench(camera, clock, SIZE, shooting.unplug, shooting.replug)
    camera.close()


def film(folder: Path, count: int = 20) -> Path:
    path = folder / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 1 / PERIOD_S, SIZE)
    for number in range(count):
        writer.write(numbered(number))
    writer.release()
    return path


@pytest.mark.long
@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize("role", ["overhead", "wrist"])
def test_contract_of_a_stream(shooting: Shooting, role: str, check: Check) -> None:
    with streamed(shooting, role) as bench:
        check(bench)


@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS[:-1])
def test_contract_of_a_film(tmp_path: Path, check: Check) -> None:
    clock = WallClock()
    camera = FileCamera(FileSettings(path=film(tmp_path)), clock, small_bench(), "overhead")
    check(camera_contract.Bench(camera, clock, SIZE))
    camera.close()


def test_a_film_without_repeat_ends(tmp_path: Path) -> None:
    clock = WallClock()
    camera = FileCamera(FileSettings(path=film(tmp_path), repeat=False), clock, small_bench(), "overhead")
    assert "the film is over" in camera_contract.Bench(camera, clock, SIZE).lost()
    camera.close()


def test_a_still_picture_is_a_film_that_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cameras, "RETRY_S", 60.0)  # it is not opened anew
    camera = FileCamera(FileSettings(path=film(tmp_path, 1), lost_s=10.0), WallClock(), small_bench(), "overhead")
    seen = set[float]()
    while len(seen) < 4:
        frame = camera.latest()
        seen |= set() if frame is None else {frame.time_s}
    camera.close()


def test_a_pipe_is_no_film(tmp_path: Path) -> None:
    os.mkfifo(path := tmp_path / "film.avi")
    with pytest.raises(DeviceFault, match=r"cannot be opened: .*film\.avi is no file"):
        FileCamera(FileSettings(path=path), WallClock(), small_bench(), "overhead")
    (told,) = cameras.examine(FileSettings(path=path), WallClock(), small_bench(), "overhead")
    assert told.remedy.endswith("is no file"), "a film has no cable"


def test_a_list_of_other_films_is_no_film(tmp_path: Path) -> None:
    """FFmpeg would play what it names, whatever its own name is."""
    (path := tmp_path / "list.mp4").write_text(f"ffconcat version 1.0\nfile {film(tmp_path).name}\n")
    with pytest.raises(DeviceFault, match=r"list\.mp4 is a list of other files, not a film"):
        FileCamera(FileSettings(path=path), WallClock(), small_bench(), "overhead")


def test_frames_that_waited_in_a_buffer_are_not_taken_for_new_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    waits = [False] * 5 + [True] + [False] * 3
    given: list[int] = []
    go_on = threading.Event()

    class Buffered:
        def grab(self) -> tuple[Any, None]:
            if len(given) == len(waits) or waits[len(given)]:
                go_on.wait(0.2)
            if len(given) == len(waits):
                raise OSError("over")
            given.append(len(given))
            return numbered(given[-1]), None

        def close(self) -> None:
            pass

    monkeypatch.setattr(cameras, "RETRY_S", 60.0)
    settings, clock = StreamSettings(url="http://nobody/", lost_s=60), WallClock()
    camera = cameras.GrabbingCamera(settings, clock, small_bench(), "overhead", lambda _: Buffered())
    frame = camera_contract.Bench(camera, clock, SIZE).frames(1)[0]
    assert number_of(frame) == 5
    camera.close()


class Spoiled:
    """Sends one good image, then what a driver may raise; opened again, it is sound."""

    spoils: ClassVar[list[Exception]] = []

    def __init__(self) -> None:
        self._count = 0

    def grab(self) -> tuple[Any, float]:
        time.sleep(PERIOD_S)
        self._count += 1
        if self._count > 1 and self.spoils:
            raise self.spoils[0]
        return numbered(self._count), 0.0

    def close(self) -> None:
        if self.spoils:
            raise RuntimeError(f"cannot stop after {self.spoils.pop()}")


@pytest.mark.parametrize("spoils", [cv2.error("grey image"), RuntimeError("no frame"), ValueError("odd\nshape")])
def test_a_thread_that_meets_anything_says_so_and_opens_the_camera_again(spoils: Exception) -> None:
    Spoiled.spoils = [spoils]
    settings, clock = StreamSettings(url="http://nobody/", lost_s=0.1), WallClock()
    camera = cameras.GrabbingCamera(settings, clock, small_bench(), "overhead", lambda _: Spoiled())
    bench = camera_contract.Bench(camera, clock, SIZE)
    told = bench.lost()
    assert f"{type(spoils).__name__}: {' '.join(str(spoils).split())}; RuntimeError: cannot stop" in told
    clock.sleep_until(clock.now_s() + 0.3)
    assert len(bench.frames(3)) == 3
    camera.close()


@pytest.mark.parametrize("image", [np.zeros(SIZE[::-1], np.uint8), np.zeros((0, 0, 3), np.uint8)])
def test_a_grey_or_empty_image_is_told_in_words(monkeypatch: pytest.MonkeyPatch, image: Any) -> None:
    capture = SimpleNamespace(isOpened=lambda: True, read=lambda: (True, image), release=lambda: None)
    monkeypatch.setattr(cv2, "VideoCapture", lambda *_: capture)
    settings, clock = StreamSettings(url="http://nobody/", lost_s=0.1), WallClock()
    camera = StreamCamera(settings, clock, small_bench(), "overhead")
    told = camera_contract.Bench(camera, clock, SIZE).lost()
    assert f"it sends no colour images: their shape is {image.shape}" in told
    camera.close()


def test_a_camera_that_waits_for_an_image_is_closed_within_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    waiting, closed = threading.Event(), threading.Event()

    class Silent:
        def grab(self) -> tuple[Any, None]:
            waiting.wait(20)
            raise OSError("over")

        def close(self) -> None:
            closed.set()

    monkeypatch.setattr(cameras, "CLOSES_S", 0.1)
    settings = StreamSettings(url="http://nobody/")
    camera = cameras.GrabbingCamera(settings, WallClock(), small_bench(), "overhead", lambda _: Silent())
    began_s = time.monotonic()
    camera.close()
    assert time.monotonic() - began_s < 5
    waiting.set()
    assert closed.wait(5), "it is let go of when its driver returns"


def test_the_delay_that_was_measured_is_taken_off_the_stamp(shooting: Shooting) -> None:
    with streamed(shooting, delay_s=0.5) as bench:
        frame = bench.frames(1)[0]
        assert frame.time_s <= bench.clock.now_s() - 0.5


def test_a_triggered_camera_hands_out_what_was_taken_after_the_trigger(shooting: Shooting) -> None:
    clock = WallClock()
    camera = StreamCamera(StreamSettings(url=shooting.url), clock, small_bench(triggered=True), "wrist")
    bench = camera_contract.Bench(camera, clock, SIZE)
    first = bench.frames(1)[0]
    while shooting.number < 20:
        clock.sleep_until(clock.now_s() + 0.02)
        assert camera.latest() is not None
    assert camera.latest() is first or first.time_s > 0
    asked_s = clock.now_s()
    bench.frames(2)
    newest = camera.latest()
    assert newest is not None
    assert newest.time_s > asked_s
    assert newest.at_tool
    camera.close()


def test_images_of_another_size_are_refused(shooting: Shooting) -> None:
    clock = WallClock()
    camera = StreamCamera(StreamSettings(url=shooting.url), clock, load_configuration().bench, "overhead")
    told = camera_contract.Bench(camera, clock, SIZE).lost()
    assert "64 x 48 pixels, the bench file says 480 x 360" in told
    camera.close()


def test_nobody_at_the_other_end(tmp_path: Path) -> None:
    clock, bench = WallClock(), small_bench()
    with pytest.raises(DeviceFault, match="camera overhead: cannot be opened"):
        StreamCamera(StreamSettings(url="http://127.0.0.1:1/"), clock, bench, "overhead")
    with pytest.raises(DeviceFault, match="camera wrist: cannot be opened"):
        FileCamera(FileSettings(path=tmp_path / "none.avi"), clock, bench, "wrist")
    with pytest.raises(DeviceFault, match="camera wrist: cannot be opened"):
        V4l2Camera(V4l2Settings(device=str(tmp_path / "video0")), clock, bench, "wrist")


class FakeVideo:
    """A USB camera: takes what it is set to but for what `refuses` names."""

    refuses: ClassVar[dict[int, float]] = {}

    def __init__(self, what: str, *_: object) -> None:
        self.what, self.settings = what, dict[int, float]()

    def isOpened(self) -> bool:
        return True

    def set(self, setting: int, value: float) -> bool:
        self.settings[setting] = value
        return True

    def get(self, setting: int) -> float:
        return self.refuses.get(setting, self.settings.get(setting, 0.0))

    def read(self) -> tuple[bool, Any]:
        threading.Event().wait(PERIOD_S)
        return True, numbered(1)

    def release(self) -> None:
        pass


def test_a_usb_camera_is_opened_by_its_id_with_exposure_and_focus_fixed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", FakeVideo)
    (tmp_path / "by-id").symlink_to(tmp_path / "video7")
    settings = V4l2Settings(device=str(tmp_path / "by-id"), exposure=80, focus=30)
    camera = V4l2Camera(settings, WallClock(), small_bench(), "overhead")
    capture: Any = camera._source.capture  # type: ignore[union-attr]
    assert capture.what == str(tmp_path / "video7")
    assert capture.settings[cv2.CAP_PROP_EXPOSURE] == 80
    assert (capture.settings[cv2.CAP_PROP_AUTOFOCUS], capture.settings[cv2.CAP_PROP_FOCUS]) == (0, 30)
    assert next(iter(capture.settings)) == cv2.CAP_PROP_FOURCC
    camera.close()


def test_a_usb_camera_that_keeps_its_own_exposure_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", FakeVideo)
    monkeypatch.setattr(FakeVideo, "refuses", {cv2.CAP_PROP_AUTO_EXPOSURE: 3.0})
    with pytest.raises(DeviceFault, match=r"takes no fixed exposure \(auto_exposure\) of 1: it has 3"):
        V4l2Camera(V4l2Settings(device="/dev/video0"), WallClock(), small_bench(), "overhead")


def test_a_camera_with_a_buffer_tells_old_images_with_new_stamps(shooting: Shooting) -> None:
    """Nothing in the stream tells: whoever sees the arm move must notice."""
    with streamed(shooting) as bench:
        bench.frames(10)
        shooting.server.behind = 8
        bench.frames(3)
        frame = bench.frames(1)[0]
        assert bench.clock.now_s() - frame.time_s < 1.0
        assert shooting.number % 32 != number_of(frame)


def test_a_twin_s_camera_sends_each_frame_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that comes between the end of a wait and the look at what is new."""

    class Cell:
        def __init__(self) -> None:
            self.frame, self.looks = Frame("overhead", 0, 0.0, numbered(1), Pose((0, 0, 0))), list[Any]()
            camera = SimpleNamespace(latest=lambda: self.frame, trigger=lambda: None)
            world = SimpleNamespace(bench=small_bench())
            self.sim = SimpleNamespace(devices=SimpleNamespace(overhead=camera), world=world)

        def each_period(self, look: Any) -> None:
            self.looks.append(look)

    cell, sent, both = Cell(), list[Any](), threading.Event()

    def send(_: Any, image: Any) -> None:
        sent.append(int(image[0, 0, 0]))
        if len(sent) == 1:
            cell.frame = Frame("overhead", 1, 0.1, numbered(2), Pose((0, 0, 0)))
            cell.looks[0](0.1)
            cell.looks[0](0.2)  # the event is set once more for what is sent next
        both.set()

    monkeypatch.setattr(TwinCamera, "send", send)
    camera = TwinCamera(cell, "overhead", "127.0.0.1", 0)  # type: ignore[arg-type]
    clear = camera._photographer._due.clear

    def late_clear() -> None:
        clear()
        camera._photographer._due.set() if len(sent) == 1 else None

    camera._photographer._due.clear = late_clear  # type: ignore[method-assign]
    cell.looks[0](0.0)
    assert both.wait(5.0)
    end_s = time.monotonic() + 5.0
    while len(sent) < 2 and time.monotonic() < end_s:
        time.sleep(0.005)
    time.sleep(0.05)
    camera.close()
    assert sent == [8, 16]
