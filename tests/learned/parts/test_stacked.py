"""What lies on what, and how: features of pairs, poses from a network's numbers, and how a detector answers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cell.interfaces.pose import Pose
from learned.inference.onnx_model import ModelCard
from learned.parts.maps import CELLS, Peak
from learned.parts.stacked import LYING_KIND, PAIRS_KIND, StackReader, lying_pose, near_pairs, pair_features
from tests.learned.classical.scenes import PRODUCT

FEATURES = np.random.default_rng(0).normal(size=(32, CELLS[1], CELLS[0])).astype(np.float32)
TYPES = tuple(PRODUCT.parts)


def peak(kind: int, x: float, y: float, half: float, height_m: float = 0.0) -> Peak:
    box = np.array([x - half, y - half, x + half, y + half])
    return Peak(kind, 0.8, np.array([x, y]), box, 0.0, height_m, 0.2, (int(x) // 4, int(y) // 4))


LARGE, SMALL, APART = peak(2, 100, 100, 30), peak(0, 110, 100, 12, 0.06), peak(1, 250, 60, 20)


class Said:
    """A network that gives an answer to all."""

    path = Path("said")

    def __init__(self, kind: str, **answer: Any) -> None:
        self.card = ModelCard(
            kind=kind, config={}, vocabulary={"parts": TYPES}, data_sha256="", scores={}, command="", seed=0
        )
        self._answer = answer

    def run(self, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        rows = len(next(iter(inputs.values())))
        return {name: np.repeat(np.array([value], np.float32), rows, axis=0) for name, value in self._answer.items()}


def test_pairs_are_of_things_whose_boxes_meet_and_that_are_not_one_thing_told_twice() -> None:
    again = peak(1, 101, 100, 29)
    assert near_pairs([LARGE, SMALL, APART]).tolist() == [[0, 1], [1, 0]]
    assert near_pairs([LARGE, again]).tolist() == []
    assert near_pairs([]).shape == (0, 2)


def test_features_of_a_pair_tell_the_upper_one_first() -> None:
    found = [LARGE, SMALL]
    rows = pair_features(found, near_pairs(found), FEATURES, len(TYPES))
    assert rows.shape == (2, 3 * 32 + 2 * (len(TYPES) + 1 + 5) + 5)
    own = len(TYPES) + 1 + 5 + 32
    assert rows[0, :own] == pytest.approx(rows[1, own : 2 * own])
    assert rows[0, -1] == pytest.approx(-rows[1, -1])


@pytest.mark.parametrize(("logit", "told"), [(3.0, {1: pytest.approx(0.953, abs=1e-3)}), (-50.0, {1: 0.0})])
def test_each_peak_tells_what_it_may_lie_on(logit: float, told: dict[int, float]) -> None:
    reader = StackReader(PRODUCT.parts, Said(PAIRS_KIND, logits=logit), Said(LYING_KIND, lies=[[0.0] * 9]))
    assert reader.on([SMALL, LARGE, APART], FEATURES)[0] == pytest.approx(told, abs=1e-6)
    assert reader.on([SMALL, LARGE, APART], FEATURES)[2] == {}
    assert reader.on([], FEATURES) == []


def test_a_pose_is_that_whose_axes_and_middle_are_told_in_the_frame_of_the_crop() -> None:
    rng, kind = np.random.default_rng(1), PRODUCT.parts["o3"]
    for _ in range(5):
        w, a, b, c = rng.normal(size=4)
        norm = float(np.linalg.norm([w, a, b, c]))
        true = Pose((0.52, -0.41, 0.06), (w / norm, a / norm, b / norm, c / norm))
        place, yaw = np.array([0.515, -0.40, 0.05]), float(rng.uniform(-3, 3))
        crop = Pose.from_yaw((0.515, -0.40, 0.05), yaw).inverse()
        middle = crop.transform(true.transform(np.array([0.0, 0.0, kind.size_m[2] / 2])))
        turn = (crop @ true).rotation
        answer = np.concatenate([2 * turn[:, 0], turn[:, 1] + 0.3 * turn[:, 0], 100 * middle]).astype(np.float32)
        told = lying_pose(answer, place, yaw, kind)
        np.testing.assert_allclose(told.position_m, true.position_m, atol=1e-6)
        np.testing.assert_allclose(told.rotation, true.rotation, atol=1e-6)
