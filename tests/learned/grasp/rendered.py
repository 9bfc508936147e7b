"""Trays as the wrist camera sees them, for tests of the paper's grasp planner."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from bracket_cell.configuration import load_configuration
from bracket_cell.learned.grasp.boxes import boxes_of
from bracket_cell.learned.grasp.crops import Crops, View, load_crops, with_embeddings
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.planning import GraspPlan, GraspPlanner
from bracket_lab.drawing.trays import TrayCamera
from bracket_lab.learned.grasp.evaluate import embedded
from bracket_lab.learned.grasp.scenes import Scene
from bracket_lab.wiring.drawn_frames import crops_of_view
from tests.learned.grasp.layouts import PRODUCT, WEIGHTS

BENCH = load_configuration().bench


@lru_cache
def camera() -> TrayCamera:
    return TrayCamera(PRODUCT, BENCH)


def crops(views: Sequence[View]) -> list[Crops]:
    return [crops_of_view(BENCH, camera(), view) for view in views]


def look(scenes: list[Scene]) -> list[Scene]:
    """The scenes as the shipped network sees their crops."""
    return embedded(scenes, crops, load_crops(WEIGHTS / "grasp_paper_crops.onnx"))


class Seeing:
    """The paper's planner with eyes: what it is asked about stands where it was detected."""

    def __init__(self, planner: GraspPlanner) -> None:
        self._planner, self._network = planner, load_crops(WEIGHTS / "grasp_paper_crops.onnx")
        self._seen: tuple[tuple[PartDetection, ...], tuple[PartDetection, ...]] = ((), ())

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        if self._seen[0] is not parts:
            (found,) = crops([(boxes_of(parts, PRODUCT), parts)])
            assert found.dtype == np.uint8
            self._seen = parts, with_embeddings(parts, found, self._network)
        return self._planner.plan(self._seen[1], required)
