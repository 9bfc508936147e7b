"""Photographs without hands: what they show is none, and what a hand shows stays as it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.commands.options import CONFIGURATION
from bracket_cell.configuration import load_configuration
from bracket_cell.learned.hands.mediapipe.hands import Landmarks
from bracket_cell.learned.hands.reading import Reading
from bracket_cell.learned.hands.records import HandRow
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.hands.data import frames_of, load_hands
from bracket_lab.pictures.handless import Compositor, filling, lay, write_handless
from bracket_lab.pictures.origins import Photograph
from tests.cell.lab.pictures.test_photographs import landmarks

SETUP = load_configuration(CONFIGURATION).bench.overhead
SIZE = (SETUP.height_px, SETUP.width_px, 3)


def photograph(seed: int, shape: tuple[int, int] = (500, 300)) -> Image:
    return np.random.default_rng(seed).integers(0, 255, (*shape, 3), np.uint8)


class Teacher:
    """Sees a hand in every dark photograph (MediaPipeHands)."""

    def picture(self, image: Image) -> list[Landmarks]:
        dark = image.mean() < 20
        return [Landmarks(landmarks(np.array([50.0, 50.0])), np.zeros((21, 3)), 1.0, 0.1)] if dark else []


class Tracker:
    """Takes one place of every image for a hand (HandReader)."""

    def read(self, image: Image, expected_px: Sequence[Array] = ()) -> list[Reading]:  # noqa: ARG002
        points = dict.fromkeys(("palm", "pinch"), np.array([200.0, 100.0]))
        return [Reading(0.9, 0.1, 0.9, points, (0, 0, 1, 1), (0.1, 0.1))]


@pytest.mark.parametrize("shape", [(40, 900), (900, 40), (360, 480), (2000, 3000)])
def test_a_part_of_a_photograph_fills_the_image(shape: tuple[int, int]) -> None:
    image = filling(photograph(0, shape), SETUP, np.random.default_rng(1))
    assert image.shape == SIZE
    assert image.std() > 1


@pytest.mark.parametrize("seed", range(8))
def test_pieces_lie_beside_the_hands_of_a_frame_and_not_on_them(seed: int) -> None:
    frame, box = np.zeros(SIZE, np.uint8), (150.0, 100.0, 260.0, 240.0)
    hand = HandRow(box_px=box)
    image, places = lay(photograph(seed), frame, [hand], SETUP, np.random.default_rng(seed))
    left, top, right, bottom = (int(value) for value in box)
    assert image[top:bottom, left:right].max() == 0
    assert image.max() > 0
    assert all(0 <= x <= SETUP.width_px and 0 <= y <= SETUP.height_px for x, y in places)


def test_what_the_tracker_takes_for_a_hand_is_learned_as_none(tmp_path: Path) -> None:
    taken = [Photograph(tmp_path / f"{number}.png") for number in range(3)]
    for number, each in enumerate(taken):
        cv2.imwrite(str(each.file), photograph(number) // (1 if number else 20))
    folder = DataFolder(tmp_path / "data", "test")
    used = write_handless(taken, Tracker(), Compositor(Teacher(), SETUP, folder, [], 2, 0))  # type: ignore[arg-type]
    assert used == taken[1:]
    rows = [frame.row for frame in frames_of(tmp_path / "data")]
    assert [(len(row.hands), row.decoys_px) for row in rows] == [(0, ((200.0, 100.0),))] * 4
    data = load_hands([tmp_path / "data"], SETUP, ("o1",), 0)
    assert not data.facts.any()
    near = np.abs(data.centres_px - (200.0, 100.0)).max(axis=1) < 0.5 * data.regions.side_px
    assert set(data.frames[near]) == {0, 1, 2, 3}
