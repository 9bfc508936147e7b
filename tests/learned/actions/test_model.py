"""The detector puts together what the network says of the hand, and what the holes show."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from bracket_cell.learned.actions.model import TrainedActionDetector
from bracket_cell.learned.actions.settings import Classes
from bracket_cell.learned.inference.onnx_model import ModelCard
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, Action, HandSample, HoleView, Segment
from tests.learned.actions.drawn import BENCH, HOLES_M, PRODUCT

CLASSES = Classes.of(PRODUCT)
AT = PRODUCT.positions.index("p2")
Hand = tuple[float, str | None]


class Says:
    """A network that says the same of every segment; of an assembly, that the fingers are closed."""

    outputs = ("logits", "released")
    path = Path("says.onnx")
    card = ModelCard(
        kind="actions.slim",
        config={"track_features": 8},
        vocabulary={"parts": CLASSES.parts, "positions": CLASSES.positions},
        data_sha256="",
        command="",
        seed=0,
    )

    def __init__(self, name: str = "o1 at p2") -> None:
        self._number = CLASSES.names.index(name)

    def require_vocabulary(self, use: str, words: tuple[str, ...]) -> None:
        self.card.require_vocabulary(self.path, {use: words})

    def run(self, inputs: object) -> dict[str, np.ndarray]:
        del inputs
        logits = np.zeros((1, len(CLASSES.names)), np.float32)
        logits[0, self._number] = 8.0
        return {"logits": logits, "released": np.array([-6.0], np.float32)}


def actions(holes: list[HoleView], hands: Sequence[Hand] = (), says: str = "o1 at p2") -> list[Action]:
    """What is answered, a frame for each look at p2.

    Args:
        hands: distance from p2 [m] and what is held, for each frame; by default it stays over p2, and holds nothing.
    """
    camera = BENCH.overhead
    image = np.full((camera.height_px, camera.width_px, 3), 70, np.uint8)
    detector = TrainedActionDetector(BENCH, PRODUCT, Says(says))  # type: ignore[arg-type]
    still: Hand = (0.0, None)
    track = [still] * SEGMENT_FRAMES + list(hands or [still] * len(holes))
    found = []
    for number, hole in enumerate(holes):
        times_s = [(number - SEGMENT_FRAMES + 1 + index) / 15 for index in range(SEGMENT_FRAMES)]
        frames = tuple(Frame("overhead", number, time_s, image, camera.mount.pose) for time_s in times_s)
        seen = zip(times_s, track[number + 1 :], strict=False)
        found.append(detector.detect(Segment(frames, tuple(sample(*one) for one in seen)), {"p2": hole}))
    return found


def sample(time_s: float, hand: Hand) -> HandSample:
    (x, y), (off_m, held) = HOLES_M[AT], hand
    return HandSample(time_s, (0, 0, 9, 9), (x + off_m, y), (x + off_m + 0.1, y), held_part=held)


def looks(*parts: str | None) -> list[HoleView]:
    return [HoleView(part, 0.97, number / 15) for number, part in enumerate(parts)]


def test_a_hole_that_the_hand_has_filled_finishes_the_action_once_and_says_so() -> None:
    found = actions(looks(*[None] * 5, *["o1"] * 40))
    finished = [number for number, action in enumerate(found) if action.finished]
    assert finished[0] == 36  # 2 s after the second look: the fingers do not open
    assert finished == list(range(finished[0], finished[-1] + 1))
    told = found[finished[0]]
    assert (told.part, told.position, told.shown) == ("o1", "p2", True)
    assert told.confidence > 0.95


def test_a_hole_that_stays_empty_or_shows_another_part_finishes_nothing() -> None:
    assert not any(action.finished for action in actions(looks(*[None] * 25)))
    assert not any(action.finished for action in actions(looks(*[None] * 5, *["o2"] * 20)))


def test_a_part_that_falls_into_its_hole_while_the_hand_seems_to_pass_finishes_the_action_once() -> None:
    falls = looks(*[None] * 20, *["o1"] * 60)
    passes = [*[(0.01, "o1")] * 20, *[(0.07, None)] * 60]
    finished = [number for number, action in enumerate(actions(falls, passes, "transit")) if action.finished]
    assert finished[0] == 21  # the second look: two in a row show a part
    assert finished == list(range(finished[0], finished[-1] + 1))
    assert not any(action.finished for action in actions(falls, [(0.07, None)] * 80, "transit"))  # the robot's, say


def test_a_part_that_fell_is_not_told_again_when_the_hand_comes_back_to_press_it_home() -> None:
    falls = looks(*[None] * 20, *["o1"] * 60)
    returns = [*[(0.01, "o1")] * 20, *[(0.07, None)] * 5, *[(0.01, None)] * 55]
    told = [action.finished for action in actions(falls, returns, "transit")]
    assert sum(now and not before for before, now in pairwise(told)) == 1
