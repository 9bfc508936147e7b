"""A wrist image that still shows what the robot has taken away is stuck, whatever noise is on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bracket_cell.running.wrist_freshness import WristFreshness
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetection, PartsView
from bracket_ground.interfaces.pose import Pose
from tests.cell.running.test_own_body import fingers

BRACKET = Pose((0.1, 0.5, 0.1))
LOOK = Pose((0.5, 0.2, 0.4))
PART = PartDetection("o1", 0.9, Pose((0.50, 0.20, 0.0)), (0.04, 0.03, 0.03), (40, 30, 60, 50))
OTHER = replace(PART, world_from_part=Pose((0.60, 0.20, 0.0)), box_px=(100, 30, 120, 50))


def image(*parts: PartDetection, noise: float = 0.0, seed: int = 0) -> NDArray[np.uint8]:
    """A tray with bright parts."""
    rng = np.random.default_rng(seed)
    made = np.full((120, 160, 3), 90.0)
    for part in parts:
        left, top, right, bottom = part.box_px
        made[top:bottom, left:right] = (180.0, 150.0, 60.0)
    return np.clip(made + rng.normal(0.0, noise, made.shape), 0, 255).astype(np.uint8)


def frame(sequence: int, pixels: NDArray[np.uint8], place: Pose = LOOK) -> Frame:
    return Frame("wrist", sequence, float(sequence), pixels, place)


def taken(let_go: Pose = BRACKET) -> WristFreshness:
    """A frame was seen, and then PART was gripped and let go of somewhere."""
    fresh = WristFreshness()
    fresh.check(frame(1, image(PART, OTHER, noise=2.0)))
    view = PartsView(1, 1.0, (OTHER, PART))
    for holding, tool in ((False, LOOK), (True, Pose((0.505, 0.2, 0.02))), (True, let_go), (False, let_go)):
        fresh.see(fingers(holding=holding), tool, view)
    return fresh


@settings(deadline=None)
@given(noise=st.floats(0.0, 8.0), seed=st.integers(0, 999))
def test_the_part_that_was_taken_is_still_shown(noise: float, seed: int) -> None:
    with pytest.raises(DeviceFault, match=r"still shows the part that was taken from \(0\.500 0\.200\)"):
        taken().check(frame(2, image(PART, OTHER, noise=noise, seed=seed)))


@settings(deadline=None)
@given(noise=st.floats(0.0, 8.0), seed=st.integers(0, 999))
def test_it_is_gone(noise: float, seed: int) -> None:
    fresh = taken()
    fresh.check(frame(2, image(OTHER, noise=noise, seed=seed)))
    fresh.check(frame(3, image(OTHER, noise=noise, seed=seed)))  # nothing was taken since


def test_it_stays_stuck_until_an_image_shows_the_change() -> None:
    fresh = taken()
    for number in (2, 3):
        with pytest.raises(DeviceFault):
            fresh.check(frame(number, image(PART, OTHER)))
    fresh.check(frame(4, image(OTHER)))


def test_a_part_that_was_put_back_may_be_seen_again() -> None:
    taken(let_go=PART.world_from_part).check(frame(2, image(PART, OTHER)))


def test_from_another_place_nothing_is_compared() -> None:
    taken().check(frame(2, image(PART, OTHER), Pose((0.52, 0.2, 0.4))))


def test_what_was_never_seen_is_not_missed() -> None:
    fresh = WristFreshness()
    fresh.see(fingers(holding=True), LOOK, None)
    fresh.see(fingers(holding=False), None, None)
    fresh.check(frame(1, image(PART)))
