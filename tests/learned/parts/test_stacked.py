"""What lies on what, and how: who may carry whom, poses from a network's numbers, and how a detector answers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_cell.learned.inference.onnx_model import ModelCard
from bracket_cell.learned.parts.stacked import STACKED_KIND, StackReader, Told, carriers, lying_pose, meeting
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.resting_pose import SIDES, rest_on
from tests.learned.classical.scenes import BENCH, PRODUCT

LARGE, SMALL, APART = ([70, 70, 130, 130], [98, 88, 122, 112], [230, 40, 270, 80])
TOP, BELOW, FREE = Told(0.9, 0.05, None), Told(0.1, 0.8, None), Told(0.1, 0.1, None)


def boxes(*sides: list[int]) -> list[Array]:
    return [np.array(side, float) for side in sides]


class Said:
    """A network that gives the same answer to all."""

    path = Path("said")

    def __init__(self, parts: tuple[str, ...], **answer: Any) -> None:
        told: dict[str, Any] = {"config": {}, "data_sha256": "", "scores": {}, "command": "", "seed": 0}
        self.card = ModelCard(kind=STACKED_KIND, vocabulary={"parts": parts}, **told)
        self._answer = answer

    def run(self, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        rows = len(inputs["crops"])
        return {name: np.repeat(np.array([value], np.float32), rows, axis=0) for name, value in self._answer.items()}


def test_what_lies_on_top_lies_on_what_carries_and_shares_its_box() -> None:
    assert carriers([TOP, BELOW, FREE], boxes(SMALL, LARGE, APART)) == [(1,), (), ()]
    assert carriers([FREE, BELOW], boxes(SMALL, LARGE)) == [(), ()], "nothing is told to lie on top"
    assert carriers([TOP, BELOW], boxes(APART, LARGE)) == [(), ()], "there is nothing below it"
    assert carriers([], []) == []


def test_what_seems_to_carry_most_is_taken_where_nothing_surely_does_and_all_that_surely_do() -> None:
    doubtful = replace(FREE, carrying=0.2)
    assert carriers([TOP, FREE, doubtful], boxes(SMALL, LARGE, [60, 80, 120, 120]))[0] == (2,)
    assert carriers([TOP, BELOW, BELOW], boxes(SMALL, LARGE, [60, 80, 120, 120]))[0] == (1, 2)


def test_one_thing_told_twice_lies_not_on_itself_and_two_not_on_each_other() -> None:
    assert carriers([TOP, BELOW], boxes(LARGE, [71, 70, 130, 131])) == [(), ()]
    both = Told(0.8, 0.7, None)
    assert carriers([both, replace(both, on_top=0.9)], boxes(SMALL, LARGE)) == [(), (0,)]


def test_only_what_meets_others_is_looked_at() -> None:
    assert meeting(boxes(SMALL, LARGE, APART)) == [0, 1]
    assert meeting(boxes(APART, LARGE)) == []


@pytest.mark.parametrize("side", SIDES)
def test_a_pose_is_the_resting_one_nearest_to_what_is_told_in_the_frame_of_the_crop(side: str) -> None:
    kind = PRODUCT.parts["o3"]
    rest = rest_on(kind, side)
    assert rest is not None
    for heading in (-2.0, 0.4, 1.7):
        true = Pose.from_yaw((0.52, -0.41, 0.03), heading) @ rest
        crop = Pose.from_yaw((0.515, -0.40, 0.05), 0.7).inverse()
        middle = crop.transform(true.transform(np.array([0.0, 0.0, kind.size_m[2] / 2])))
        turn = (crop @ true).rotation
        leaning = np.array([[1.0, 0.0, 0.0], [0.0, 0.98, -0.199], [0.0, 0.199, 0.98]]) @ turn
        for told in (turn, leaning):
            answer = np.concatenate([2 * told[:, 0], told[:, 1] + 0.3 * told[:, 0], 100 * middle]).astype(np.float32)
            pose = lying_pose(answer, np.array([0.515, -0.40, 0.05]), 0.7, kind)
            assert np.trace(pose.rotation.T @ true.rotation) > 1 + 2 * math.cos(math.radians(8))
            body = np.array([0.0, 0.0, kind.size_m[2] / 2])
            np.testing.assert_allclose(pose.transform(body), true.transform(body), atol=1e-6)


def test_a_reader_tells_probabilities_and_how_known_things_lie() -> None:
    lies = [[1, 0, 0, 0, 0, 1, 0, 0, 1.0]] * 3
    reader = StackReader(PRODUCT.parts, cast(Any, Said(tuple(PRODUCT.parts), lies=lies, stacked=[2.0, -2.0])))
    image = np.zeros((BENCH.wrist.height_px, BENCH.wrist.width_px, 3), np.uint8)
    frame = Frame("wrist", 0, 0.0, image, Pose((0.56, -0.38, 0.52), (0.0, 0.7071, 0.7071, 0.0)))
    place = np.array([0.56, -0.38, 0.02])
    part, unknown = reader.read(frame, BENCH.wrist.model, [0, 3], [place, place], [0.0, 0.0])
    assert [part.on_top, part.carrying] == pytest.approx([0.881, 0.119], abs=1e-3)
    assert part.lies is not None
    middle = part.lies.transform(np.array([0.0, 0.0, PRODUCT.parts["o1"].size_m[2] / 2]))
    assert middle == pytest.approx((0.56, -0.38, 0.02 + 0.01))
    assert unknown.lies is None
    assert reader.read(frame, BENCH.wrist.model, [], [], []) == []
