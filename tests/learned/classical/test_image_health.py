"""A camera that cannot be believed says so; a hand that vanished is not a hand that left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from cell.interfaces.perception import Frame
from learned.classical.image_health import ImageHealth, TrackHealth
from tests.integration.cell_rig import BENCH, PRODUCT, with_person
from tests.learned.classical.scenes import classical_bench_watcher

Image = NDArray[np.uint8]
SOUND, SPOILED = 20, 60


@pytest.fixture(scope="module")
def frames() -> Iterator[list[Frame]]:
    """Three seconds of a person at work."""
    seen: list[Frame] = []
    with with_person("g0", 5) as cell:
        clock, camera = cell.devices.clock, cell.devices.overhead
        while len(seen) < SOUND + SPOILED:
            clock.sleep_until(clock.now_s() + 0.04)
            frame = camera.latest()
            if frame is not None and (not seen or frame.sequence > seen[-1].sequence):
                image = np.array(frame.image)
                seen.append(Frame(frame.camera, frame.sequence, frame.time_s, image, frame.world_from_camera))
        yield seen


def scaled(factor: float, *channels: float) -> Callable[[Image], Image]:
    return lambda image: np.clip(image * factor * np.array(channels or (1.0,)), 0, 255).astype(np.uint8)


SPOILS: dict[str, tuple[Callable[[Image], Image], str]] = {
    "black": (scaled(0.0), "dark"),
    "white": (lambda image: np.full_like(image, 255), "bright"),
    "grey": (lambda image: np.full_like(image, 128), "without contrast"),
    "gain 1.5": (scaled(1.5), "brighter"),
    "half the light": (scaled(0.5), "darker"),
    "red and blue swapped": (lambda image: np.ascontiguousarray(image[..., ::-1]), "discoloured"),
    "cold light": (scaled(1.0, 0.8, 1.0, 1.25), "discoloured"),
    "out of focus": (lambda image: np.asarray(cv2.GaussianBlur(image, (0, 0), 3), np.uint8), "blurred"),
    "pushed aside": (lambda image: np.roll(image, 12, axis=1), "moved"),
    "pushed far": (lambda image: np.roll(image, 40, axis=0), "moved"),
}


@pytest.mark.parametrize("name", sorted(SPOILS))
def test_a_spoiled_image_is_found_and_named(frames: list[Frame], name: str) -> None:
    spoil, words = SPOILS[name]
    health = ImageHealth(BENCH, PRODUCT)
    assert [health.judge(frame) for frame in frames[:SOUND]] == [""] * SOUND
    told = [
        health.judge(Frame("overhead", f.sequence, f.time_s, spoil(f.image), f.world_from_camera))
        for f in frames[SOUND:]
    ]
    last = told[-1] if words == "moved" else told[0]
    assert last.startswith(words)
    if words != "moved":
        assert all(told)


def test_a_frozen_image_with_new_numbers_and_stamps_is_found(frames: list[Frame]) -> None:
    health = ImageHealth(BENCH, PRODUCT)
    told = [
        health.judge(Frame("overhead", f.sequence, f.time_s, frames[0].image, f.world_from_camera)) for f in frames[:6]
    ]
    assert told == ["", *["frozen"] * 5]


def test_an_image_that_is_black_from_the_start_is_found() -> None:
    health = ImageHealth(BENCH, PRODUCT)
    black = np.zeros((BENCH.overhead.height_px, BENCH.overhead.width_px, 3), np.uint8)
    assert health.judge(Frame("overhead", 0, 0.0, black, BENCH.overhead.mount.pose)) == "dark"


@pytest.mark.parametrize("blur_px", [3.5, 5])
def test_a_lens_that_is_out_of_focus_from_the_start_is_found(frames: list[Frame], blur_px: float) -> None:
    health = ImageHealth(BENCH, PRODUCT)
    blurred = [replace(frame, image=np.asarray(cv2.GaussianBlur(frame.image, (0, 0), blur_px))) for frame in frames]
    told = [health.judge(frame) for frame in blurred]
    assert told[:5] == [""] * 5  # an arm over the edges looks like that for a moment
    assert told.count("blurred") > 0.8 * len(told)
    assert set(told) == {"", "blurred"}


def test_the_watcher_hands_health_and_speed_on(frames: list[Frame]) -> None:
    watcher = classical_bench_watcher(BENCH, PRODUCT)
    views = [watcher.watch(frame) for frame in frames]
    assert {view.health for view in views} == {""}
    assert {view.hand_unknown for view in views} == {""}
    speeds = [view.hand.speed_m_s for view in views if view.hand is not None and view.hand.velocity_m_s is not None]
    assert len(speeds) > 30
    assert 0.2 < max(speed for speed in speeds if speed is not None) < 2.0


def track(*boxes: tuple[int, int, int, int] | None) -> list[str]:
    """What is said of a hand seen in these boxes, 15 a second."""
    health = TrackHealth(BENCH)
    return [
        health.unknown(number / 15, None if box is None else (0.7 + 0.01 * number, 0.1), box or (0, 0, 0, 0))
        for number, box in enumerate(boxes)
    ]


def test_a_hand_that_vanishes_in_mid_view_is_unknown_until_it_is_seen_again() -> None:
    middle = (200, 100, 260, 200)
    told = track(None, middle, middle, None, None, None, middle, None)
    assert told == ["", "", "", *["it vanished inside the view"] * 3, "", "it vanished inside the view"]


def test_a_hand_that_leaves_by_the_edge_is_gone() -> None:
    assert track((200, 250, 260, 320), (200, 290, 260, 357), None, None) == [""] * 4


def test_a_fast_hand_that_passes_the_edge_between_two_frames_is_gone() -> None:
    assert track((200, 180, 260, 240), (200, 230, 260, 290), (200, 280, 260, 340), None) == [""] * 4


def test_a_hand_that_was_all_in_view_cannot_leave_between_two_frames() -> None:
    """Its wrist touches the edge always; when all of it vanishes at once, something covers it."""
    reaching = (200, 100, 260, 358)
    assert track(reaching, reaching, None, None) == ["", "", *["it vanished inside the view"] * 2]


def test_it_is_told_by_which_edge_a_hand_left() -> None:
    health = TrackHealth(BENCH)
    for number, box in enumerate([(60, 100, 120, 160), (30, 100, 90, 160), (2, 100, 60, 160)]):
        health.unknown(number / 15, (0.7, 0.1), box)
        assert health.left_by == ()
    for number in (3, 4, 60):
        assert health.unknown(number / 15, None, (0, 0, 0, 0)) == ""
        assert health.left_by == ("left",)
    health.unknown(61 / 15, (0.7, 0.1), (2, 100, 60, 160))
    assert health.left_by == ()
