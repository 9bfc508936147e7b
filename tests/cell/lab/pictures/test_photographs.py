"""Hands of photographs on the bench: labels stay on the hand, wherever it is laid."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.commands.options import CONFIGURATION
from bracket_cell.configuration import load_configuration
from bracket_cell.learned.hands.mediapipe.hands import Landmarks
from bracket_cell.learned.hands.mediapipe.tracker import PALM_TO_WRIST_M, bench_points
from bracket_cell.learned.hands.records import HandRow
from bracket_ground.errors import InputError
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.hands.data import frames_of, load_hands
from bracket_lab.pictures.handless import Compositor
from bracket_lab.pictures.origins import Photograph, photographs_of
from bracket_lab.pictures.photographs import compose, cut_hands, write_photographs
from bracket_lab.pictures.worn import CutHand, dressed, gloved, with_tool

SETUP = load_configuration(CONFIGURATION).bench.overhead
SKIN, WALL = (220, 150, 120), (40, 90, 60)
FINGERS = [(-38, -10), (-20, -52), (0, -58), (18, -52), (34, -38)]  # tips, from the middle of the knuckles


def landmarks(wrist: Array, turn: float = 0.0) -> Array:
    """A flat hand of 21 points that points up, turned."""
    points = [np.array([0.0, 0.0])]
    for number, tip in enumerate(FINGERS):
        base = np.array([(-26.0, -20.0), (-18.0, -50.0), (-4.0, -54.0), (8.0, -52.0), (20.0, -46.0)][number])
        end = np.array([0.0, -52.0]) + np.array(tip) if number else np.array([-48.0, -52.0])
        points += [base + share * (end - base) for share in (0.0, 1 / 3, 2 / 3, 1.0)]
    cos, sin = np.cos(turn), np.sin(turn)
    turned: Array = np.array(points) @ np.array([[cos, sin], [-sin, cos]]) + wrist
    return turned


def photograph(points: Array) -> Image:
    """Skin before a wall."""
    image = np.full((300, 300, 3), WALL, np.uint8)
    for chain in ((0, 1, 2, 3, 4), (0, 5, 6, 7, 8), (0, 9, 10, 11, 12), (0, 13, 14, 15, 16), (0, 17, 18, 19, 20)):
        cv2.polylines(image, [points[list(chain)].round().astype(np.int32)], False, SKIN, 14)
    cv2.fillConvexPoly(image, cv2.convexHull(points[[0, 1, 5, 9, 13, 17]].round().astype(np.int32)), SKIN)
    return image


class Teacher:
    """Says where the hands are (MediaPipeHands)."""

    def __init__(self, *hands: Array) -> None:
        self._hands = hands

    def picture(self, image: Image) -> list[Landmarks]:  # noqa: ARG002
        return [Landmarks(points, np.zeros((21, 3)), 1.0, 0.1) for points in self._hands]


def cut(turn: float = 0.3) -> CutHand:
    points = landmarks(np.array([150.0, 200.0]), turn)
    return next(cut_hands(photograph(points), Teacher(points)))  # type: ignore[arg-type]


def test_a_hand_is_cut_out_of_its_photograph() -> None:
    hand = cut()
    at_palm, beside = bench_points(hand.points_px)["palm"].round().astype(int), (15, 15)
    assert hand.mask[at_palm[1], at_palm[0]] > 0.9
    assert hand.mask[beside[1], beside[0]] == 0
    assert np.abs(hand.behind[at_palm[1], at_palm[0]].astype(int) - WALL).max() < 60


def test_no_other_hand_of_the_photograph_stays_behind_a_hand() -> None:
    """Unlabelled, and mirrored beyond the photograph's edge, it would be learned as no hand."""
    one, other = landmarks(np.array([80.0, 200.0])), landmarks(np.array([220.0, 200.0]))
    image = photograph(one)
    image[:, 150:] = photograph(other)[:, 150:]
    for hand in cut_hands(image, Teacher(one, other)):  # type: ignore[arg-type]
        scale = hand.behind.shape[1] / image.shape[1]
        for points in (one, other):
            column, row = (bench_points(points)["palm"] * scale).round().astype(int)
            assert np.abs(hand.behind[row, column].astype(int) - WALL).max() < 60


def test_some_arms_are_as_bare_as_the_hand_and_others_in_a_sleeve() -> None:
    frame = np.full((SETUP.height_px, SETUP.width_px, 3), 90, np.uint8)
    skinned = []
    for seed in range(30):
        image, rows = compose(cut(), (frame, []), SETUP, np.random.default_rng(seed))
        palm, wrist = (np.array(rows[0].points_px[name]) for name in ("palm", "wrist"))
        column, row = (wrist + (wrist - palm)).round().astype(int)
        if 0 <= column < SETUP.width_px and 0 <= row < SETUP.height_px:
            arm, hand = image[row, column].astype(float), image[tuple(palm.round().astype(int)[::-1])].astype(float)
            skinned.append(bool(np.abs(arm / arm.sum() - hand / hand.sum()).max() < 0.03))
    assert 0.15 < np.mean(skinned) < 0.7


@pytest.mark.parametrize("seed", range(6))
def test_points_lie_on_the_hand_that_is_seen(seed: int) -> None:
    frame = np.full((SETUP.height_px, SETUP.width_px, 3), 90, np.uint8)
    image, rows = compose(cut(), (frame, []), SETUP, np.random.default_rng(seed))
    assert len(rows) == 1
    column, row = (round(value) for value in rows[0].points_px["palm"])
    skin = image[row, column].astype(float)
    assert skin[0] > skin[2] + 20  # skin is red, the frame grey
    left, top, right, bottom = rows[0].box_px
    assert 0 <= left < right <= SETUP.width_px
    assert 0 <= top < bottom <= SETUP.height_px


@pytest.mark.long
def test_a_hand_is_as_large_as_hands_at_the_bench_are() -> None:
    lengths = []
    for seed in range(40):
        _, rows = compose(cut(), None, SETUP, np.random.default_rng(seed))
        points = rows[0].points_px
        lengths.append(np.linalg.norm(np.subtract(points["palm"], points["wrist"])))
    low_px, high_px = (SETUP.focal_px * PALM_TO_WRIST_M / (SETUP.mount.position_m[2] - height) for height in (0.0, 0.3))
    assert low_px < float(np.median(lengths)) < high_px


def test_what_the_new_hand_hides_of_another_shows_less() -> None:
    under = HandRow(box_px=(0.0, 0.0, float(SETUP.width_px), float(SETUP.height_px)), visible=1.0)
    frame = np.zeros((SETUP.height_px, SETUP.width_px, 3), np.uint8)
    _, rows = compose(cut(), (frame, [under]), SETUP, np.random.default_rng(0))
    assert 0.5 < rows[1].visible < 1.0


def test_rows_are_learned_from(tmp_path: Path) -> None:
    points = landmarks(np.array([150.0, 200.0]), 0.3)
    cv2.imwrite(str(tmp_path / "hand.png"), photograph(points)[..., ::-1])
    folder = DataFolder(tmp_path / "data", "test")
    compositor = Compositor(Teacher(points), SETUP, folder, [], 1, 3)  # type: ignore[arg-type]
    taken = Photograph(tmp_path / "hand.png", "gestures", "CC-BY-4.0")
    assert write_photographs([taken], compositor) == [taken]
    assert len(frames_of(tmp_path / "data")) == 1
    data = load_hands([tmp_path / "data"], SETUP, ("o1",), 0)
    assert data.photographs == {"gestures": "1 (CC-BY-4.0)"}
    seen = np.flatnonzero(data.facts[:, 0] == 1)
    assert not np.isnan(data.log_angles[seen]).any()  # how large it seems is known,
    assert np.isnan(data.heights_m[seen]).all()  # how high it is, nobody knows


def test_a_folder_without_photographs_is_told(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("none")
    with pytest.raises(InputError, match=r"holds no photographs; legal are \.png"):
        photographs_of(tmp_path)
    assert list(cut_hands(np.zeros((50, 50, 3), np.uint8), Teacher())) == []  # type: ignore[arg-type]


def test_a_glove_hides_the_skins_colour_and_keeps_what_lies_around() -> None:
    hand = cut()
    worn = gloved(hand, (40, 120, 200))
    inside, outside = hand.mask > 0.99, hand.mask == 0
    red, _, blue = worn.image[inside].astype(float).mean(axis=0)
    assert blue > 2 * red
    assert (worn.image[outside] == hand.image[outside]).all()
    assert (worn.mask == hand.mask).all()


def test_a_tool_reaches_beyond_the_fingers_and_is_laid_onto_the_bench_with_the_hand() -> None:
    hand = cut()
    named = bench_points(hand.points_px)
    for seed in range(5):
        held = with_tool(hand, named["palm"], named["pinch"], np.random.default_rng(seed))
        column, row = (named["pinch"] + 0.6 * (named["pinch"] - named["palm"])).round().astype(int)
        assert hand.mask[row, column] < 0.5 < held.mask[row, column]
        assert (held.points_px == hand.points_px).all()


def test_some_hands_wear_and_hold_something_and_the_same_seed_gives_the_same() -> None:
    hand = cut()
    named = bench_points(hand.points_px)
    changed = []
    for seed in range(60):
        one, same = (dressed(hand, named["palm"], named["pinch"], np.random.default_rng(seed)) for _ in range(2))
        assert (one.image == same.image).all()
        changed.append((bool((one.image != hand.image).any()), bool((one.mask != hand.mask).any())))
    shares = np.mean(changed, axis=0)
    assert 0.35 < shares[0] < 0.75
    assert 0.1 < shares[1] < 0.5


def test_hands_of_all_sizes_are_laid_onto_benches() -> None:
    lengths = []
    for seed in range(60):
        _, rows = compose(cut(), None, SETUP, np.random.default_rng(seed))
        points = rows[0].points_px
        lengths.append(np.linalg.norm(np.subtract(points["palm"], points["wrist"])))
    usual = float(np.median(lengths))
    assert min(lengths) < 0.8 * usual
    assert max(lengths) > 1.45 * usual
