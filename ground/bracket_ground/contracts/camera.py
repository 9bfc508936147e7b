"""What every `Camera` must do, whatever makes its images; run by the tests of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.devices import Camera
from bracket_ground.interfaces.frame import Frame

TICK_S, PATIENCE_S = 0.040, 20.0


@dataclass
class Bench:
    """A camera with its clock, and how its images end and come again.

    Attributes:
        size_px: (width, height) of its images.
        unplug: no more images come; None where that cannot be.
        replug: they do again.
    """

    camera: Camera
    clock: Clock
    size_px: tuple[int, int]
    unplug: Callable[[], None] | None = None
    replug: Callable[[], None] | None = None

    def frames(self, count: int) -> list[Frame]:
        """So many new frames."""
        found: list[Frame] = []
        end_s = self.clock.now_s() + PATIENCE_S
        while len(found) < count:
            assert self.clock.now_s() < end_s, f"{len(found)} frames of {count}"
            self.camera.trigger()
            frame = self.camera.latest()
            if frame is not None and (not found or frame is not found[-1]):
                found.append(frame)
            self.clock.sleep_until(self.clock.now_s() + TICK_S / 4)
        return found

    def lost(self) -> str:
        """What it raises before long."""
        end_s = self.clock.now_s() + PATIENCE_S
        while self.clock.now_s() < end_s:
            try:
                self.camera.latest()
            except DeviceFault as error:
                return str(error)
            self.clock.sleep_until(self.clock.now_s() + TICK_S)
        raise AssertionError("never lost")


def check_images_are_of_the_size_of_the_bench_file(bench: Bench) -> None:
    for frame in bench.frames(2):
        assert frame.image.shape == (bench.size_px[1], bench.size_px[0], 3)
        assert frame.image.dtype == "uint8"


def check_numbers_and_stamps_increase(bench: Bench) -> None:
    frames = bench.frames(5)
    for before, after in pairwise(frames):
        assert after.sequence > before.sequence
        assert after.time_s > before.time_s


def check_no_stamp_is_of_a_time_to_come(bench: Bench) -> None:
    for _ in range(5):
        assert bench.frames(1)[0].time_s <= bench.clock.now_s()


def check_a_frame_stays_the_newest_until_another_comes(bench: Bench) -> None:
    frame = bench.frames(1)[0]
    newest = bench.camera.latest()
    assert newest is not None
    assert newest is frame or newest.time_s > frame.time_s


def check_a_lost_camera_says_so_and_comes_back(bench: Bench) -> None:
    assert bench.unplug is not None
    assert bench.replug is not None
    before = bench.frames(1)[0]
    bench.unplug()
    assert "camera" in bench.lost()
    bench.replug()
    end_s = bench.clock.now_s() + PATIENCE_S
    frame = None
    while frame is None or frame.time_s <= before.time_s:
        assert bench.clock.now_s() < end_s
        bench.clock.sleep_until(bench.clock.now_s() + TICK_S)
        try:
            bench.camera.trigger()
            frame = bench.camera.latest()
        except DeviceFault:
            continue


Check = Callable[[Bench], None]
CHECKS: tuple[Check, ...] = (
    check_images_are_of_the_size_of_the_bench_file,
    check_numbers_and_stamps_increase,
    check_no_stamp_is_of_a_time_to_come,
    check_a_frame_stays_the_newest_until_another_comes,
    check_a_lost_camera_says_so_and_comes_back,
)  # the last one where something can be unplugged
