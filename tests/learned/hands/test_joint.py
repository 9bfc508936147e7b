"""Two sources and one verdict, with readers that see what the test wants."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.hands.joint import JointReader
from bracket_cell.learned.hands.reading import Reading
from bracket_cell.learned.hands.regions import Image
from bracket_cell.settings import Perception
from bracket_cell.wiring.detectors import for_camera, with_detectors_for
from bracket_ground.interfaces.pose import Array

IMAGE = np.zeros((360, 480, 3), np.uint8)


def hand(x: float, y: float, confidence: float, **told: object) -> Reading:
    points = {name: np.array([x, y]) for name in ("palm", "pinch", "wrist")}
    plain = Reading(confidence, 0.1, 0.9, points, (x - 20, y - 20, x + 20, y + 20), (0.1, 0.05))
    return replace(plain, **told)  # type: ignore[arg-type]


class Ours:
    """The small networks."""

    def __init__(self, seen: Sequence[Reading], closer: Sequence[Reading] = ()) -> None:
        self._seen, self._closer = seen, closer

    def read(self, image: Image, expected_px: Sequence[Array]) -> list[Reading]:  # noqa: ARG002
        return list(self._seen)

    def read_at(self, image: Image, centres_px: Sequence[Array]) -> list[Reading]:  # noqa: ARG002
        return list(self._closer)


class Theirs:
    """MediaPipe's networks; `presence` is what they say of places that they are asked about."""

    def __init__(self, seen: Sequence[Reading], presence: float = 0.001) -> None:
        self._seen, self._presence = seen, presence

    def read(self, image: Image, expected_px: Sequence[Array]) -> list[Reading]:  # noqa: ARG002
        return list(self._seen)

    def read_at(self, image: Image, where: Reading) -> Reading:  # noqa: ARG002
        return replace(where, confidence=self._presence)


def told(ours: Ours, theirs: Theirs, expected_px: Sequence[Array] = ()) -> list[Reading]:
    return JointReader(ours, theirs).read(IMAGE, expected_px)  # type: ignore[arg-type]


def test_hands_that_either_sees_are_told_and_one_that_both_see_once() -> None:
    found = told(Ours([hand(100, 100, 0.7, held_part="o2")]), Theirs([hand(110, 95, 0.8), hand(300, 200, 0.9)]))
    assert [reading.confidence for reading in found] == [pytest.approx(1 - 0.3 * 0.2), 0.9]
    assert found[0].held_part == "o2"
    assert found[0].points_px["palm"].tolist() == [110, 95]  # the small networks were not sure where it is


def test_where_the_small_networks_are_sure_their_points_stand() -> None:
    (found,) = told(Ours([hand(100, 100, 0.97)]), Theirs([hand(110, 95, 0.8)]))
    assert found.points_px["palm"].tolist() == [100, 100]


@pytest.mark.parametrize(("presence", "confidence"), [(0.001, None), (0.2, 0.8), (0.8, 1 - 0.02 * 0.2)])
def test_what_the_small_networks_see_alone_is_as_sure_as_mediapipe_makes_it(
    presence: float, confidence: float | None
) -> None:
    """A lone screwdriver on steel was a hand of .97 to them; MediaPipe's landmarks gave it .001."""
    found = told(Ours([hand(100, 100, 0.98)]), Theirs([], presence))
    assert [reading.confidence for reading in found] == ([] if confidence is None else [pytest.approx(confidence)])


def test_a_hand_that_is_followed_is_not_asked_about_again() -> None:
    (found,) = told(Ours([hand(100, 100, 0.6)]), Theirs([]), [np.array([104.0, 100.0])])
    assert found.confidence == 0.6


def test_two_hands_that_work_together_stay_two() -> None:
    found = told(Ours([hand(100, 100, 0.9), hand(150, 100, 0.9)]), Theirs([hand(104, 98, 0.9), hand(148, 104, 0.9)]))
    assert len(found) == 2


def test_a_real_camera_has_both_where_mediapipe_was_fetched_and_the_rest_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    plain = Perception()
    perception, said = for_camera(plain, real=True)
    assert perception == plain
    assert "make hands" in said
    folder = tmp_path / "cell" / "mediapipe"
    folder.mkdir(parents=True)
    for name in ("palm", "landmark"):
        (folder / f"{name}_lite.onnx").write_bytes(b"")
    assert (for_camera(plain, real=True)[0].chosen("hands").kind, for_camera(plain, real=True)[1]) == ("both", "")
    chosen = plain.with_detector("hands", "mediapipe")
    assert for_camera(plain, real=False) == (plain, "")
    assert for_camera(chosen, real=True) == (chosen, "")


def test_the_simulated_cell_keeps_the_small_networks() -> None:
    configuration = load_configuration()
    perception = with_detectors_for(configuration, load_product(configuration))[0].perception
    assert perception.chosen("hands").kind == "slim"
