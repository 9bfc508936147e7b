"""Crops of holes hold the hole in their middle; the threshold keeps filled holes from being called empty."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.holes.model import CROP_PX, VOTES, PlateHoleReader, hole_crops, squares_m
from bracket_cell.learned.inference.onnx_model import ModelCard
from bracket_ground.interfaces.frame import Frame

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
TYPES = tuple(PRODUCT.parts)
CARD = ModelCard(
    kind="holes.plate",
    vocabulary={"parts": TYPES},
    data_sha256="",
    command="",
    seed=0,
    config={"least_empty": 0.9, "least_filled": 0.9},
)


class Said:
    """A network whose answers are given."""

    path, card, outputs = Path("said"), CARD, ["kinds", "upright", "covered"]

    def __init__(self) -> None:
        self.kind, self.sure, self.upright, self.covered = 0, 0.99, 1.0, 0.0

    def run(self, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        count = len(inputs["crops"])
        kinds = np.full((count, len(TYPES) + 1), (1 - self.sure) / len(TYPES), np.float32)
        kinds[:, self.kind] = self.sure
        ones = np.ones(count, np.float32)
        return {"kinds": kinds, "upright": ones * self.upright, "covered": ones * self.covered}


def frame(number: int) -> Frame:
    setup = BENCH.overhead
    image = np.full((setup.height_px, setup.width_px, 3), 90, np.uint8)
    return Frame("overhead", number, number / 15, image, setup.mount.pose)


def watch(reader: PlateHoleReader, frames: range) -> dict[str, str | None]:
    for number in frames:
        views = reader.read(frame(number), None)
    return {position: view.part for position, view in views.items()}


def test_the_middle_of_a_crop_is_the_hole() -> None:
    model, camera = BENCH.overhead.model, BENCH.overhead.mount.pose
    image = np.zeros((model.height_px, model.width_px, 3), np.uint8)
    holes = np.array([[*xy, 0.0] for xy in PRODUCT.bracket.holes_m.values()])
    for column, row in np.rint(model.project(camera, BENCH.bracket.pose.transform(holes))).astype(int):
        image[row - 1 : row + 2, column - 1 : column + 2] = 255
    crops = hole_crops(image, model, camera, squares_m(BENCH, PRODUCT))
    assert crops.shape == (len(holes), 3, CROP_PX, CROP_PX)
    for crop in crops:
        rows, columns = np.nonzero(crop[0] > 0)
        assert abs(rows.mean() - (CROP_PX - 1) / 2) < 2
        assert abs(columns.mean() - (CROP_PX - 1) / 2) < 2


def test_a_view_follows_some_frames_in_a_row_and_stays_while_covered() -> None:
    said = Said()
    reader = PlateHoleReader(BENCH, PRODUCT, said)
    assert watch(reader, range(VOTES - 1)) == {}
    assert watch(reader, range(VOTES - 1, VOTES)) == dict.fromkeys(PRODUCT.positions)
    said.kind, said.covered = 1, 0.9
    assert watch(reader, range(10, 20)) == dict.fromkeys(PRODUCT.positions)
    said.covered = 0.0
    assert watch(reader, range(20, 20 + VOTES)) == dict.fromkeys(PRODUCT.positions, TYPES[0])


def test_what_is_not_sure_is_not_said() -> None:
    said = Said()
    said.sure = 0.85
    assert watch(PlateHoleReader(BENCH, PRODUCT, said), range(10)) == {}


def test_frames_that_are_doubtful_one_by_one_are_believed_together_and_a_wrong_one_changes_nothing() -> None:
    said = Said()
    reader = PlateHoleReader(BENCH, PRODUCT, said)
    empty = dict.fromkeys(PRODUCT.positions)
    for number, sure in enumerate((0.88, 0.99, 0.88)):
        said.sure = sure
        views = watch(reader, range(number, number + 1))
    assert views == empty
    said.kind, said.sure = 2, 0.99
    assert watch(reader, range(3, 4)) == empty
    said.kind = 0
    assert watch(reader, range(4, 10)) == empty


def test_emptiness_is_said_only_where_less_is_thought_to_hide_it() -> None:
    said = Said()
    said.covered = 0.65
    assert watch(PlateHoleReader(BENCH, PRODUCT, said), range(5)) == {}
    said.kind = 1
    assert watch(PlateHoleReader(BENCH, PRODUCT, said), range(5)) == dict.fromkeys(PRODUCT.positions, TYPES[0])


def test_what_seems_to_be_in_a_hole_that_the_robot_is_over_must_be_surely_there() -> None:
    """A part in the gripper above its hole was told as placed, at .62, and that cancelled its placement."""
    said = Said()
    said.card = CARD.model_copy(update={"config": {"least_empty": 0.9, "least_filled": 0.6}})
    reader = PlateHoleReader(BENCH, PRODUCT, said)
    assert watch(reader, range(VOTES)) == dict.fromkeys(PRODUCT.positions)
    over = squares_m(BENCH, PRODUCT)[0].mean(axis=0) + np.array([0.0, 0.0, 0.1])
    robot_m = (over + np.array([[x, y, z] for x in (-0.01, 0.01) for y in (-0.01, 0.01) for z in (0.0, 0.3)]))[None]
    said.kind, said.sure = 1, 0.7
    for number in range(10, 16):
        views = reader.read(frame(number).beside(robot_m), None)
    hidden, *others = PRODUCT.positions
    assert {position: view.part for position, view in views.items()} == {hidden: None} | dict.fromkeys(others, TYPES[0])
    said.sure = 0.97
    for number in range(20, 20 + VOTES):
        views = reader.read(frame(number).beside(robot_m), None)
    assert views[hidden].part == TYPES[0]
    said.kind = 0
    for number in range(30, 30 + VOTES):
        views = reader.read(frame(number).beside(robot_m), None)
    assert views[hidden].part is None
    said.kind, said.sure = 1, 0.7
    assert watch(reader, range(40, 40 + VOTES))[hidden] == TYPES[0]
