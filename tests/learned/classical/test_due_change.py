"""Images that are older than their stamps, or copies: where the arm moved they must change."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_cell.learned.classical.due_change import DueChange
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose

RATE_HZ, ROWS, COLUMNS = 15.0, 90, 120
SIDE, STEP = 30, 3  # small pixels: of the arm, and by which it moves in a frame
ROBOT = np.zeros((1, 1, 3))
CHANCE = np.random.default_rng(3)
TABLE = CHANCE.integers(100, 140, (ROWS, COLUMNS, 3))
SKIN = CHANCE.integers(30, 90, (SIDE, SIDE, 3))


def place(number: int) -> int:
    """Left side of the arm, which stands, goes over the bench, stands and goes back."""
    moved = min(max(number - 10, 0), 25) - min(max(number - 50, 0), 25)
    return 5 + STEP * moved


def image(number: int, hand: int | None = None) -> NDArray[np.uint8]:
    """The bench with the arm, and a hand that trembles at a column."""
    drawn = TABLE + np.random.default_rng(number + 100).integers(-3, 4, TABLE.shape)
    left = place(max(number, 0))
    drawn[20 : 20 + SIDE, left : left + SIDE] = SKIN
    if hand is not None:
        drawn[25:45, hand : hand + 12] = 200 + 40 * (number % 2)
    return drawn.astype(np.uint8)


def outline(number: int, left_px: int = 4, right_px: int = 4) -> NDArray[np.uint8]:
    """So many small pixels wider than the arm to its left and to its right."""
    mask = np.zeros((ROWS, COLUMNS), np.uint8)
    left = place(number)
    mask[16 : 24 + SIDE, max(0, left - left_px) : left + SIDE + right_px] = 1
    return mask


def judged(behind: int = 0, hand: int | None = None, known: bool = True, frozen: int = 999) -> tuple[str, str]:
    """What is said of images that are a number of frames behind their stamps, or of one image from a frame on."""
    due = DueChange(np.ones((ROWS, COLUMNS), bool))
    for number in range(90):
        small = image(number - behind, hand)
        if number >= frozen:
            small = (image(frozen) + np.random.default_rng(number).integers(-1, 2, small.shape)).astype(np.uint8)
        frame = Frame("overhead", number, number / RATE_HZ, small, Pose((0, 0, 1)), ROBOT if known else None)
        due.see(frame, small, outline(number))
        if number == frozen + 7:
            assert due.stuck == "not changing where the robot moves"
    return due.late, due.stuck


@pytest.mark.parametrize("hand", [None, 10, 80])
@pytest.mark.parametrize("behind", [0, 1])
def test_images_in_time_are_neither_late_nor_stuck_whatever_a_hand_does(behind: int, hand: int | None) -> None:
    assert judged(behind, hand) == ("", "")


@pytest.mark.parametrize("behind", [4, 5, 8, 12])
def test_images_of_a_buffer_are_noticed_once_the_arm_moves(behind: int) -> None:
    late, stuck = judged(behind)
    assert late.startswith("the image is late: the arm is seen where it was") or stuck


def test_a_frozen_image_is_stuck_within_eight_frames_of_motion_and_for_as_long_as_it_is_frozen() -> None:
    assert judged(frozen=20)[1] == "not changing where the robot moves"


def test_an_arm_that_fills_little_of_its_boxes_is_seen_by_what_changes_inside_them() -> None:
    assert not any(stuck for _, stuck in judged_in_wide_boxes(14, 4))


@pytest.mark.parametrize("behind", [0, 1, 5, 8])
@pytest.mark.parametrize("empty", [(0, 14), (14, 0)])
def test_an_image_is_late_only_where_boxes_that_are_empty_ahead_had_left_long_before(
    behind: int, empty: tuple[int, int]
) -> None:
    assert any(late for late, _ in judged_in_wide_boxes(*empty, behind)) == (behind > 1)


def judged_in_wide_boxes(left: int, right: int, behind: int = 0) -> list[tuple[str, str]]:
    """What is said of each image where the arm's boxes are wider than it by so many small pixels."""
    due, said = DueChange(np.ones((ROWS, COLUMNS), bool)), []
    for number in range(90):
        small = image(number - behind)
        frame = Frame("overhead", number, number / RATE_HZ, small, Pose((0, 0, 1)), ROBOT)
        due.see(frame, small, outline(number, left, right))
        said.append((due.late, due.stuck))
    return said


def test_without_the_arms_place_nothing_is_said() -> None:
    assert judged(8, known=False) == ("", "")
