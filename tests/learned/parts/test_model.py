"""The shipped part detector on rendered trays: what stands is found where it is, what lies is not taken for it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_cell.configuration import load_configuration, load_product, simulated
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference.onnx_model import Network, OnnxModel
from bracket_cell.learned.parts.maps import UPRIGHT, overlap
from bracket_cell.learned.parts.model import CENTRE_KIND, POSE_KIND, SAME_BOX, CentrePartDetector, pose_file
from bracket_ground.errors import DeviceFault, ModelError
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_lab.drawing.objects import write_objects
from bracket_lab.drawing.sight import mixed_clutter
from bracket_lab.learned.parts.data import Scene, load_scenes
from bracket_lab.learned.parts.evaluate import Findings, evaluate_parts
from bracket_sim.scene.settings import settings_of

CONFIGURATION = simulated(load_configuration(), "nominal")
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
SHIPPED = WEIGHTS / "parts_centre.onnx"
FIRST_SEED = 810_000


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> list[Scene]:
    path = tmp_path_factory.mktemp("trays") / "new"
    folder = DataFolder(path, "test")
    settings = settings_of(CONFIGURATION.devices.simulation)
    for seed in range(FIRST_SEED, FIRST_SEED + 6):
        mixed = settings.model_copy(update={"clutter": mixed_clutter(settings.clutter, seed)})
        write_objects(PRODUCT, BENCH, mixed, seed, folder)
    return load_scenes([path], PRODUCT)


def test_standing_parts_are_found_to_two_millimetres(scenes: list[Scene]) -> None:
    findings = Findings()
    evaluate_parts(scenes, CentrePartDetector.load(BENCH, PRODUCT, SHIPPED), PRODUCT, findings)
    scores = findings.scores(PRODUCT)
    assert scores["map_50"] > 0.9
    assert scores["missed"] <= 0.05
    assert scores["position_mm_p50"] < 1.0
    assert scores["position_mm_p95"] < 2.5
    assert scores["yaw_deg_p50"] < 1.0


def test_answers_have_what_a_planner_needs(scenes: list[Scene]) -> None:
    detector = CentrePartDetector.load(BENCH, PRODUCT, SHIPPED)
    found = [
        detection
        for scene in scenes
        for detection in detector.detect(Frame("wrist", 0, 0.0, scene.image, scene.believed))
    ]
    assert {len(detection.embedding) for detection in found} == {len(found[0].embedding)}
    for detection in found:
        assert math.isfinite(detection.confidence)
        assert 0 < detection.confidence <= 1
        assert detection.part in PRODUCT.parts or not detection.upright
        left, top, right, bottom = detection.box_px
        assert left < right
        assert top < bottom


def test_what_stands_is_nothing_else_too(scenes: list[Scene]) -> None:
    detector = CentrePartDetector.load(BENCH, PRODUCT, SHIPPED)
    for scene in scenes:
        found = detector.detect(Frame("wrist", 0, 0.0, scene.image, scene.believed))
        standing, others = (
            [np.array(detection.box_px, float) for detection in found if detection.upright == up]
            for up in (True, False)
        )
        assert all(overlap(one, other) < SAME_BOX for one in standing for other in others)


class Doubtful:
    """A centre net that cannot tell whether things stand."""

    def __init__(self, centre: Network, up: float) -> None:
        self.path, self.card, self.outputs = centre.path, centre.card, centre.outputs
        self._centre, self._odds = centre, math.log(up / (1 - up))

    def run(self, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        maps = self._centre.run(inputs)
        maps["further"][:, UPRIGHT] = self._odds
        return maps


def test_the_closer_look_tells_what_stands_where_the_first_is_in_doubt(scenes: list[Scene]) -> None:
    centre, pose = OnnxModel.load(SHIPPED, CENTRE_KIND), OnnxModel.load(pose_file(SHIPPED), POSE_KIND)
    findings = Findings()
    evaluate_parts(scenes, CentrePartDetector(BENCH, PRODUCT, Doubtful(centre, 0.3), pose), PRODUCT, findings)
    scores = findings.scores(PRODUCT)
    assert scores["posture"] > 0.9
    assert scores["missed"] <= 0.1


def test_a_camera_that_does_not_look_down_sees_nothing_and_a_wrong_size_is_a_fault() -> None:
    detector = CentrePartDetector.load(BENCH, PRODUCT, SHIPPED)
    setup = BENCH.wrist
    image = np.full((setup.height_px, setup.width_px, 3), 90, np.uint8)
    assert detector.detect(Frame("wrist", 0, 0.0, image, Pose((0.5, -0.4, 0.5)))) == ()
    with pytest.raises(DeviceFault, match="must be 480 x 360"):
        detector.detect(Frame("wrist", 0, 0.0, image[::2], Pose((0.5, -0.4, 0.5))))


def test_weights_that_are_missing_are_told(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"nothing\.onnx"):
        CentrePartDetector.load(BENCH, PRODUCT, tmp_path / "nothing.onnx")
