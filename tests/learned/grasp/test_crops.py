"""Crops of the wrist image: what is around a part, at a fixed scale, turned with it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.learned.grasp.boxes import boxes_of
from bracket_cell.learned.grasp.crops import CROP_PX, STEP_M, CropReader, Crops, load_crops
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from tests.learned.grasp.layouts import PRODUCT, WEIGHTS, moved, standing
from tests.learned.grasp.rendered import BENCH, camera, crops


def seen(*parts: PartDetection) -> Crops:
    (found,) = crops([(boxes_of(parts, PRODUCT), parts)])
    return found


def test_a_part_is_in_the_middle_of_its_crop_and_as_large_as_it_is() -> None:
    (crop,) = seen(standing("o1", 0.03, 0.05, 0.7))
    red = crop[0].astype(int) - crop[1:3].max(axis=0) > 60
    rows, columns = np.nonzero(red)
    assert abs(rows.mean() - (CROP_PX - 1) / 2) < 1.5
    assert abs(columns.mean() - (CROP_PX - 1) / 2) < 1.5
    length, width, _ = PRODUCT.parts["o1"].size_m
    assert abs(np.ptp(columns) + 1 - length / STEP_M) <= 2
    assert abs(np.ptp(rows) + 1 - width / STEP_M) <= 2


def test_a_neighbour_is_where_it_stands_seen_from_the_part() -> None:
    parts = (standing("o1", 0.0, 0.0, 1.0), moved(standing("o2", 0.0, 0.045), 0.0, 0.0, 1.0))
    crop = seen(*parts)[0].astype(int)
    blue = crop[2] - crop[:2].max(axis=0) > 60
    assert blue[CROP_PX // 2 + 7 :].mean() > 5 * blue[: CROP_PX // 2].mean()  # rows go along the part's y axis


def test_a_crop_from_the_other_end_is_turned_by_half_a_turn() -> None:
    part, other = standing("o1", 0.02, 0.03, 0.4), standing("o2", 0.05, 0.06, 1.0)
    back = replace(part, world_from_part=part.world_from_part @ Pose.from_yaw((0.0, 0.0, 0.0), math.pi))
    boxes = boxes_of((part, other), PRODUCT)
    there, again = crops([(boxes, (part,)), (boxes, (back,))])
    assert np.abs(there[0, 3:].astype(int) - (255 - again[0, 3:, ::-1, ::-1].astype(int))).max() <= 1
    assert np.abs(there[0, :3].astype(int) - again[0, :3, ::-1, ::-1].astype(int)).mean() < 2


def test_lines_of_sight_lean_towards_the_camera() -> None:
    """From a place they lead, times the height, to where the camera is."""
    part = standing("o1", 0.08, -0.11, 0.6)
    world = Pose(BENCH.tray.centre_m) @ part.world_from_part
    _, eye = camera().take([("o1", world)])
    lean = seen(part)[0, 3:] / 127.5 - 1
    row, column = 5, 40
    height = eye.position_m[2] - world.position_m[2]
    place = (np.array([column, row]) - (CROP_PX - 1) / 2) * STEP_M + lean[:, row, column] * height
    assert world.transform(np.array([*place, height])) == pytest.approx(np.array(eye.position_m), abs=0.004)


def test_the_detector_hands_over_features_of_the_crops() -> None:
    part = standing("o3", 0.0, 0.0, 0.3)
    place = Pose(BENCH.tray.centre_m)
    found = replace(part, world_from_part=place @ part.world_from_part)
    image, eye = camera().take([("o3", found.world_from_part)])

    class Detector:
        def detect(self, frame: Frame) -> tuple[PartDetection, ...]:  # noqa: ARG002
            return (found,)

    network = load_crops(WEIGHTS / "grasp_paper_crops.onnx")
    (told,) = CropReader(Detector(), BENCH, network).detect(Frame("wrist", 0, 0.0, image, eye))
    expected = network.run({"crops": seen(part)})["embedding"][0]
    assert np.allclose(told.embedding, expected, atol=1e-3)
    assert told.world_from_part == found.world_from_part
