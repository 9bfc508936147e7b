"""The detector puts together what the network says of the hand, and what the holes show."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cell.interfaces.perception import SEGMENT_FRAMES, Action, Frame, HandSample, HoleView, Segment
from learned.actions.classes import Classes
from learned.actions.detector import TrainedActionDetector
from learned.onnx_model import ModelCard
from tests.learned.actions.drawn import BENCH, HOLES_M, PRODUCT

CLASSES = Classes.of(PRODUCT)
AT = PRODUCT.positions.index("p2")


class Says:
    """A network that says the same of every segment: "o1 at p2", with fingers that are closed."""

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

    def require_vocabulary(self, use: str, words: tuple[str, ...]) -> None:
        self.card.require_vocabulary(self.path, {use: words})

    def run(self, inputs: object) -> dict[str, np.ndarray]:
        del inputs
        logits = np.zeros((1, len(CLASSES.names)), np.float32)
        logits[0, CLASSES.number("assembly", "o1", "p2")] = 8.0
        return {"logits": logits, "released": np.array([-6.0], np.float32)}


def actions(holes: list[HoleView]) -> list[Action]:
    """What is answered while the hand stays over p2, a frame for each look at the hole."""
    camera = BENCH.overhead
    image = np.full((camera.height_px, camera.width_px, 3), 70, np.uint8)
    x, y = HOLES_M[AT]
    detector = TrainedActionDetector(BENCH, PRODUCT, Says())  # type: ignore[arg-type]
    found = []
    for number, hole in enumerate(holes):
        times_s = [(number - SEGMENT_FRAMES + 1 + index) / 15 for index in range(SEGMENT_FRAMES)]
        frames = tuple(Frame("overhead", number, time_s, image, camera.mount.pose) for time_s in times_s)
        hands = tuple(HandSample(time_s, (0, 0, 9, 9), (x, y), (x + 0.1, y)) for time_s in times_s)
        found.append(detector.detect(Segment(frames, hands), {"p2": hole}))
    return found


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
