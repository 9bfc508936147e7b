"""MediaPipe's networks without MediaPipe: what is computed around them, and what is said where they are missing."""

import math
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.hands.joint import SKIN
from bracket_cell.learned.hands.mediapipe.hands import Landmarks, MediaPipeHands, apart, model_folder, network_file
from bracket_cell.learned.hands.mediapipe.palms import (
    ANCHORS,
    PLAIN,
    Palm,
    Roi,
    Tint,
    averaged,
    overlaps,
    square,
    wrapped,
)
from bracket_cell.learned.hands.mediapipe.tracker import MediaPipeReader, mediapipe_tracker
from bracket_cell.learned.hands.reading import ApparentSize, Reading
from bracket_cell.learned.hands.regions import Image
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.errors import InputError, ModelError
from bracket_ground.interfaces.pose import Array
from bracket_lab.experiments.mediapipe_fetch import fetch

HAND = np.array([[0.0, 0.0], *([[10.0 * finger, -40.0 - 15 * joint] for finger in range(-2, 3) for joint in range(4)])])


def turned(points: Array, angle_rad: float) -> Array:
    """Clockwise on the screen."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    found: Array = points @ np.array([[cosine, sine], [-sine, cosine]])
    return found


def landmarks(points: Array) -> Landmarks:
    return Landmarks(points, np.zeros((21, 3)), 1.0, 0.0)


def test_anchors_are_two_grids_row_by_row() -> None:
    assert ANCHORS.shape == (2016, 2)
    assert np.allclose(ANCHORS[:3], [[0.5 / 24, 0.5 / 24], [0.5 / 24, 0.5 / 24], [1.5 / 24, 0.5 / 24]])
    assert np.allclose(ANCHORS[1152], [0.5 / 12, 0.5 / 12])
    assert np.allclose(ANCHORS.mean(axis=0), 0.5)


def test_what_overlaps_is_averaged_by_scores_and_the_best_score_stays() -> None:
    box = np.array([[0.0, 0.0], [1.0, 1.0]])
    rows = np.stack([box, box + 0.1, box + 5.0])
    (score, first), (other, second) = averaged(np.array([0.6, 0.9, 0.7]), rows)
    assert (score, other) == (0.9, 0.7)
    assert np.allclose(first, (0.6 * rows[0] + 0.9 * rows[1]) / 1.5)
    assert np.allclose(second, rows[2])
    assert np.allclose(overlaps(box, rows), [1.0, 0.81 / 1.19, 0.0])


@pytest.mark.parametrize("angle_rad", [0.0, 0.7, -2.0, 3.0])
def test_regions_turn_with_the_hand(angle_rad: float) -> None:
    upright, other = landmarks(HAND).roi, landmarks(turned(HAND, angle_rad) + 300).roi
    assert upright.turn_rad == pytest.approx(0.0)
    assert wrapped(other.turn_rad - angle_rad) == pytest.approx(0.0, abs=1e-9)
    assert other.side_px == pytest.approx(upright.side_px)
    assert np.allclose(turned(upright.centre_px, angle_rad) + 300, other.centre_px)
    palm = Palm(1.0, np.array([0.0, -30.0, 50.0, 50.0]), HAND[[0, 5, 9, 13, 17, 1, 2]])
    keypoints = turned(palm.keypoints_px, angle_rad)
    middle = turned(palm.box_px[:2], angle_rad)
    assert np.allclose(
        Palm(1.0, np.array([*middle, 50.0, 50.0]), keypoints).roi.centre_px, turned(palm.roi.centre_px, angle_rad)
    )


def test_a_square_shows_what_its_shares_say() -> None:
    image = np.zeros((200, 300, 3), np.uint8)
    roi = Roi(np.array([150.0, 90.0]), 80.0, 0.5)
    spot = roi.outside(np.array([[0.25, -0.1]]))[0]
    cv2.circle(image, (round(spot[0]), round(spot[1])), 3, (255, 255, 255), -1)
    corners = roi.outside(np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]])).astype(np.float32)
    onto = cv2.getAffineTransform(corners, np.array([[0, 0], [224, 0], [0, 224]], np.float32))
    cut = square(image, onto, 224, cv2.BORDER_REPLICATE)[0, :, :, 0]
    row, column = (places.mean() for places in np.nonzero(cut > 0.5))
    assert (column / 224 - 0.5, row / 224 - 0.5) == (pytest.approx(0.25, abs=0.02), pytest.approx(-0.1, abs=0.02))


def test_one_hand_is_looked_at_once() -> None:
    first, near, far = (Roi(np.array([x, 50.0]), 40.0, 0.0) for x in (50.0, 55.0, 120.0))
    assert apart([first, near, far]) == [first, far]


@pytest.mark.parametrize(("tints", "hands"), [((PLAIN,), 0), ((PLAIN, SKIN), 1)])
def test_a_hand_as_white_as_no_skin_is_seen_in_a_tint(
    tints: Sequence[Tint], hands: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stands for networks that see what is redder than it is blue."""
    looked: list[Tint] = []

    def find(network: object, image: Image, least_score: float, tint: Tint) -> list[Palm]:  # noqa: ARG001
        looked.append(tint)
        return [Palm(0.9, np.array([50.0, 50.0, 20.0, 20.0]), np.array([[50.0, 60.0]] * 2 + [[50.0, 40.0]]))]

    def read(network: object, image: Image, roi: Roi, tint: Tint) -> Landmarks:  # noqa: ARG001
        return replace(landmarks(HAND + 50), presence=0.9 if tint[0] > tint[2] else 0.1)

    monkeypatch.setattr(OnnxModel, "load", lambda *_: None)
    monkeypatch.setattr("bracket_cell.learned.hands.mediapipe.hands.find_palms", find)
    monkeypatch.setattr("bracket_cell.learned.hands.mediapipe.hands.read_landmarks", read)
    seen, white = MediaPipeHands(Path(), "lite", 4, 0.2, tints), np.full((100, 100, 3), 255, np.uint8)
    assert len(seen.picture(white)) == hands
    assert looked == list(tints)
    assert [bool(seen.frame(white)) for _ in range(2)] == [bool(hands)] * 2
    assert looked[len(tints) :] == [tints[0], tints[-1]], "in a stream one look for palms a frame"


def test_missing_networks_are_said_with_what_fetches_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    configuration = load_configuration()
    assert model_folder() == tmp_path / "cell" / "mediapipe"
    weights = network_file(model_folder(), "landmark", "lite")
    with pytest.raises(ModelError, match="make hands"):
        mediapipe_tracker(
            configuration.bench,
            load_product(configuration),
            {"hands": weights, "hands.closer": WEIGHTS / "hands_slim.onnx"},
        )


class FlatHand:
    """MediaPipeHands that see one flat hand, always."""

    def __init__(self) -> None:
        fan = [(0.0, 0.0)] + [(finger * 9.0 - 18.0, -20.0 - 7.0 * joint) for finger in range(5) for joint in range(4)]
        self.points = np.array(fan) + np.array([240.0, 180.0])

    def picture(self, image: Image) -> list[Landmarks]:  # noqa: ARG002
        return [Landmarks(self.points, np.zeros((21, 3)), 0.97, 0.1)]


class Closer:
    """A closer look that sees a hand so far from where it is asked to look, and what it holds."""

    def __init__(self, off_px: float) -> None:
        self._off = off_px

    def read_at(self, image: Image, centres_px: Sequence[Array]) -> list[Reading]:  # noqa: ARG002
        points = dict.fromkeys(("palm", "pinch", "held"), centres_px[0] + (self._off, 0.0))
        size = ApparentSize(-3.1, 0.02, (0.01, 0.01))
        return [Reading(0.4, 0.9, 0.9, points, (0, 0, 1, 1), (0.15, 0.12), held_part="o2", size=size)]


@pytest.mark.parametrize(("off_px", "completed"), [(4.0, True), (60.0, False)])
def test_heights_and_what_is_held_come_from_a_closer_look_and_points_from_mediapipe(
    off_px: float, completed: bool
) -> None:
    setup, image = load_configuration().bench.overhead, np.zeros((360, 480, 3), np.uint8)
    plain = MediaPipeReader(setup, FlatHand()).read(image)[0]  # type: ignore[arg-type]
    seen = MediaPipeReader(setup, FlatHand(), Closer(off_px)).read(image)[0]  # type: ignore[arg-type]
    assert seen.points_px["palm"] == pytest.approx(plain.points_px["palm"])
    assert (seen.confidence, seen.left) == (plain.confidence, plain.left)
    assert (seen.held_part == "o2", seen.heights_m == (0.15, 0.12), "held" in seen.points_px) == (completed,) * 3


def test_a_wheel_of_something_else_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    wheel = tmp_path / "other.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("other-1.dist-info/LICENSE", "text")
    (tmp_path / "no.whl").write_text("no archive")
    with pytest.raises(InputError, match="holds no mediapipe"):
        fetch(tmp_path / "out", wheel)
    with pytest.raises(InputError, match="cannot be read as a wheel"):
        fetch(tmp_path / "out", tmp_path / "no.whl")
    with zipfile.ZipFile(wheel, "a") as archive:
        for name in ("palm_detection/palm_detection", "hand_landmark/hand_landmark"):
            for size in ("lite", "full"):
                archive.writestr(f"mediapipe/modules/{name}_{size}.tflite", b"no graph")
    with pytest.raises(InputError, match="is not that of"):
        fetch(tmp_path / "out", wheel)
    assert not (tmp_path / "out").exists()
