"""Faster R-CNN's regions and boxes without torch: which are kept, and how a part stands that a box is around."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference.onnx_model import Inputs, ModelCard, OnnxModel
from bracket_cell.learned.parts.maps import INPUT_PX, surface_of
from bracket_cell.learned.parts.model import POSE_KIND
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_lab.learned.parts.boxes import HEAD_KIND, KIND, REGIONS, TURNS, BoxPartDetector, boxed, surest_regions

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
CAMERA = BENCH.wrist.model
ABOVE = Pose((BENCH.tray.centre_m[0], BENCH.tray.centre_m[1], 0.52), (0.0, 1.0, 0.0, 0.0))


class Scripted:
    """A network that always answers the same."""

    def __init__(self, kind: str, answer: dict[str, NDArray[Any]]) -> None:
        self.path, self.outputs, self._answer = Path(kind), list(answer), answer
        vocabulary = {"parts": tuple(PRODUCT.parts)}
        self.card = ModelCard(kind=kind, vocabulary=vocabulary, data_sha256="", command="", seed=0)

    def run(self, inputs: Inputs) -> dict[str, NDArray[Any]]:  # noqa: ARG002
        return self._answer


def test_regions_are_inside_the_image_and_none_stands_for_another() -> None:
    boxes = np.array([[10, 10, 50, 50], [11, 11, 51, 51], [-20, 100, 30, 140], [200, 200, 200, 230]], np.float32)
    found = surest_regions(np.array([0.6, 0.9, 0.8, 0.7], np.float32), boxes)
    assert found.shape == (REGIONS, 4)
    assert found[:2].tolist() == [[11, 11, 51, 51], [0, 100, 30, 140]]
    assert (found >= 0).all()
    assert (found <= [*INPUT_PX, *INPUT_PX]).all()


def test_boxes_come_by_type_the_surest_first_and_once() -> None:
    shares = np.array([[0.1, 0.8, 0.05, 0.05], [0.2, 0.7, 0.05, 0.05], [0.0, 0.0, 0.0, 1.0]], np.float32)
    one, other = [10.0, 10.0, 50.0, 40.0], [100.0, 100.0, 140.0, 120.0]
    boxes = np.array([[one] * 4, [one] * 4, [other] * 4], np.float32)
    found = boxed(shares, boxes)
    assert [(peak.kind, round(peak.score, 2)) for peak in found] == [(2, 1.0), (0, 0.8)]
    assert found[0].centre_px.tolist() == [120.0, 110.0]


@pytest.mark.parametrize("turn_rad", [0.0, 0.5, 1.3, 2.2])
def test_where_no_box_tells_how_a_part_is_turned_every_direction_is_near_one_that_is_tried(turn_rad: float) -> None:
    """The pose net learned to correct .12 rad (one standard deviation); what is tried is at most .2 rad off."""
    detector = BoxPartDetector(
        BENCH,
        PRODUCT,
        Scripted(KIND, {}),
        Scripted(HEAD_KIND, {}),
        OnnxModel.load(WEIGHTS / "parts_centre_pose.onnx", POSE_KIND),
    )
    for kind in PRODUCT.parts.values():
        whole = math.pi if kind.alike_after_half_turn else 2 * math.pi
        tried = np.array(detector._turns(kind))
        off = np.abs((tried - turn_rad + whole / 2) % whole - whole / 2)
        assert off.min() <= math.pi / TURNS / 2 + 1e-9
        assert len(tried) == round(TURNS * whole / math.pi)


def test_a_box_around_nothing_that_stands_is_told_as_something_that_lies() -> None:
    name, kind = next(iter(PRODUCT.parts.items()))
    pose = Pose.from_yaw((*BENCH.tray.centre_m[:2], BENCH.tray.centre_m[2] + kind.peg_length_m), 0.3)
    seen = CAMERA.project(ABOVE, pose.transform(surface_of(kind))) * INPUT_PX[0] / CAMERA.width_px
    box = np.concatenate([seen.min(axis=0), seen.max(axis=0)]).astype(np.float32)
    regions = {"scores": np.ones(1, np.float32), "boxes": box[np.newaxis], "features": np.zeros((1, 1, 1, 1))}
    shares = np.zeros((1, len(PRODUCT.parts) + 2), np.float32)
    shares[0, 1] = 0.9
    head = {"shares": shares, "boxes": np.tile(box, (1, shares.shape[1], 1))}
    pose_net = OnnxModel.load(WEIGHTS / "parts_centre_pose.onnx", POSE_KIND)
    detector = BoxPartDetector(BENCH, PRODUCT, Scripted(KIND, regions), Scripted(HEAD_KIND, head), pose_net)
    grey = np.full((CAMERA.height_px, CAMERA.width_px, 3), 120, np.uint8)
    (found,) = detector.detect(Frame("wrist", 0, 0.0, grey, ABOVE))
    assert (found.part, found.upright) == (name, False)
    assert found.confidence == pytest.approx(0.9)
    assert np.hypot(*(np.array(found.world_from_part.position_m) - pose.position_m)[:2]) < 0.02
