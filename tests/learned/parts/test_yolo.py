"""A user's own ONNX detector: every usual output gives the same boxes, and what is none is refused."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.parts.yolo import read_boxes
from bracket_cell.settings import Perception
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.errors import ModelError, SettingError
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
ABOVE = Pose((BENCH.tray.centre_m[0], BENCH.tray.centre_m[1], 0.52), (0.0, 1.0, 0.0, 0.0))
SIDE = 640
SCALE = SIDE / BENCH.wrist.width_px
TOP = (SIDE - BENCH.wrist.height_px * SCALE) / 2
BOX = (200.0, 150.0, 260.0, 190.0)  # in the camera's image
IN_INPUT = [SCALE * BOX[0], SCALE * BOX[1] + TOP, SCALE * BOX[2], SCALE * BOX[3] + TOP]
NAMES = "{0: 'person', 1: 'O2'}"


def model(path: Path, answer: NDArray[np.float32], names: str | None = NAMES) -> Path:
    """A network that answers this, whatever it sees."""
    image = helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, "height", "width"])
    out = helper.make_tensor_value_info("output0", TensorProto.FLOAT, list(answer.shape))
    nothing = helper.make_node("ReduceSum", ["images"], ["sum"], keepdims=0)
    zero = helper.make_node("Mul", ["sum", "zero"], ["none"])
    add = helper.make_node("Add", ["answer", "none"], ["output0"])
    fixed = [numpy_helper.from_array(answer, "answer"), numpy_helper.from_array(np.zeros((), np.float32), "zero")]
    graph = helper.make_graph([nothing, zero, add], "boxes", [image], [out], fixed)
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    if names is not None:
        entry = made.metadata_props.add()
        entry.key, entry.value = "names", names
    onnx.save(made, path)
    return path


def by_middle() -> list[float]:
    left, top, right, bottom = IN_INPUT
    return [(left + right) / 2, (top + bottom) / 2, right - left, bottom - top]


def of_v8() -> NDArray[np.float32]:
    rows = np.zeros((6, 2000), np.float32)
    rows[:, 7] = [*by_middle(), 0.1, 0.9]
    rows[:, 8] = [*by_middle(), 0.1, 0.8]  # the same thing once more
    return rows[np.newaxis]


def of_v5() -> NDArray[np.float32]:
    rows = np.zeros((2000, 7), np.float32)
    rows[7] = [*by_middle(), 0.95, 0.1, 0.947]
    return rows[np.newaxis]


def with_suppression() -> NDArray[np.float32]:
    rows = np.zeros((300, 6), np.float32)
    rows[0] = [*IN_INPUT, 0.9, 1]
    return rows[np.newaxis]


def as_shares() -> NDArray[np.float32]:
    """Of RT-DETR, with as many columns as a file of two classes with its own suppression."""
    rows = np.zeros((300, 6), np.float32)
    rows[5] = [*(value / SIDE for value in by_middle()), 0.1, 0.9]
    return rows[np.newaxis]


def found(weights: Path) -> list[tuple[str, tuple[int, ...], bool, float]]:
    perception = Perception().with_detector("parts", "onnx", weights)
    image = np.full((BENCH.wrist.height_px, BENCH.wrist.width_px, 3), 90, np.uint8)
    seen = Detectors(BENCH, PRODUCT, perception).make("parts").detect(Frame("wrist", 0, 0.0, image, ABOVE))
    return [(one.part, one.box_px, one.upright, round(one.confidence, 2)) for one in seen]


ANSWERS = {"v8": of_v8(), "v5": of_v5(), "suppressed": with_suppression(), "rtdetr": as_shares()}


@pytest.mark.parametrize("answer", ANSWERS.values(), ids=ANSWERS)
def test_boxes_are_parts_that_nobody_knows_to_stand(tmp_path: Path, answer: NDArray[np.float32]) -> None:
    assert found(model(tmp_path / "own.onnx", answer)) == [("o2", tuple(map(int, BOX)), False, 0.9)]


def test_logits_and_boxes_of_transformers_are_read_alike() -> None:
    rows = as_shares()
    odds = np.log(np.maximum(rows[..., 4:], 1e-6) / (1 - rows[..., 4:]))
    size, path = (SIDE, SIDE), Path("own.onnx")
    one = read_boxes({"logits": odds, "pred_boxes": rows[..., :4]}, 2, size, path)
    other = read_boxes({"output0": rows}, 2, size, path)
    for a, b in zip(one, other, strict=True):
        assert np.allclose(np.asarray(a), np.asarray(b), atol=1e-3)
    with pytest.raises(ModelError, match="shape"):
        read_boxes({"logits": odds[..., :1], "pred_boxes": rows[..., :4]}, 2, size, path)


def test_a_class_that_is_no_part_is_an_unknown_thing(tmp_path: Path) -> None:
    answer = of_v8()
    answer[0, 4:, :] = answer[0, [5, 4], :]
    ((part, *_),) = found(model(tmp_path / "own.onnx", answer))
    assert part == "unknown"


@pytest.mark.parametrize(
    ("answer", "names", "said"),
    [
        (of_v8(), "{0: 'person', 1: 'dog'}", "knows person, dog, and none of this product's parts: o1, o2, o3"),
        (of_v8(), "__import__('os').getcwd()", "its `names` are no list of classes"),
        (of_v8(), "[]", "its `names` are no list of classes"),
    ],
)
def test_what_is_no_detector_of_these_parts_is_refused(
    tmp_path: Path, answer: NDArray[np.float32], names: str, said: str
) -> None:
    with pytest.raises(SettingError, match=said):
        found(model(tmp_path / "own.onnx", answer, names))


def test_an_output_of_another_shape_is_said_with_the_legal_ones(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"shape \(1, 9, 2000\); of 2 classes legal are \(1, 6, n\)"):
        found(model(tmp_path / "own.onnx", np.zeros((1, 9, 2000), np.float32)))


def test_without_names_the_classes_are_the_products_types(tmp_path: Path) -> None:
    answer = np.zeros((1, 7, 2000), np.float32)
    answer[0, :, 3] = [*by_middle(), 0.0, 0.0, 0.9]
    assert [part for part, *_ in found(model(tmp_path / "own.onnx", answer, None))] == ["o3"]


def test_a_file_must_be_named(tmp_path: Path) -> None:
    del tmp_path
    with pytest.raises(SettingError, match="needs a file of weights"):
        Detectors(BENCH, PRODUCT, Perception().with_detector("parts", "onnx")).make("parts")
