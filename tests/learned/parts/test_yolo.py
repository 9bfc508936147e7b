"""A user's own ONNX detector: every usual output gives the same boxes, and what is none is refused."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.inference import onnx_model
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


def told(column: int, value: float) -> NDArray[np.float32]:
    """The same with another number in the row of the part."""
    rows = with_suppression()
    rows[0, 0, column] = value
    return rows


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
    for wrong in (odds[..., :1], odds[0, 0]):
        with pytest.raises(ModelError, match="shape"):
            read_boxes({"logits": wrong, "pred_boxes": rows[..., :4]}, 2, size, path)


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
        (of_v8(), "{1000000000: 'o1'}", "its `names` are no list of classes"),
        (of_v8() * 9, NAMES, r"tells scores up to 8\.1; legal are 0 to 1"),
        (told(5, 7.0), NAMES, "tells a class 7, but has 2 names; legal are 0 to 1"),
        (told(5, 1e30), NAMES, r"tells a class 1e\+30"),
        (told(2, 20.0), NAMES, r"tells a box \(267, 280, 20, 333\)"),
        (told(3, 3e38), NAMES, "tells a box"),
    ],
)
def test_what_is_no_detector_of_these_parts_is_refused(
    tmp_path: Path, answer: NDArray[np.float32], names: str, said: str
) -> None:
    with pytest.raises(SettingError, match=said):
        found(model(tmp_path / "own.onnx", answer, names))


def test_an_output_of_another_shape_is_said_with_the_legal_ones(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"shape \(1, 9, 2000\); of 2 classes legal are \(1, 6, n\)"):
        found(model(tmp_path / "own.onnx", np.zeros((1, 9, 2000), np.float32)))


def test_without_names_the_classes_are_the_products_types(tmp_path: Path) -> None:
    answer = np.zeros((1, 7, 2000), np.float32)
    answer[0, :, 3] = [*by_middle(), 0.0, 0.0, 0.9]
    assert [part for part, *_ in found(model(tmp_path / "own.onnx", answer, None))] == ["o3"]


def test_a_file_must_be_named(tmp_path: Path) -> None:
    del tmp_path
    with pytest.raises(SettingError, match="needs a file of weights"):
        Detectors(BENCH, PRODUCT, Perception().with_detector("parts", "onnx")).make("parts")


@pytest.mark.parametrize(
    ("shape", "kind", "said"),
    [
        ([1, SIDE, SIDE, 3], TensorProto.FLOAT, r"takes tensor\(float\) \[1, 640, 640, 3\], but must take"),
        ([4, 3, SIDE, SIDE], TensorProto.FLOAT, "one image"),
        ([1, 3, 0, 0], TensorProto.FLOAT, "each side 32 to 4096"),
        ([1, 3, 200000, 200000], TensorProto.FLOAT, "each side 32 to 4096"),
        ([1, 3, SIDE, SIDE], TensorProto.FLOAT16, r"takes tensor\(float16\)"),
    ],
)
def test_what_takes_no_such_image_is_refused_before_a_run(
    tmp_path: Path, shape: list[int], kind: int, said: str
) -> None:
    with pytest.raises(SettingError, match=said):
        found(bare(tmp_path / "own.onnx", [helper.make_node("Identity", ["images"], ["out"])], shape, kind))


def test_a_file_that_reads_others_or_has_no_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(onnx_model, "PATIENCE_S", 0.2)
    (tmp_path / "numbers").write_bytes(bytes(64))
    beside = TensorProto(name="more", data_type=TensorProto.FLOAT, dims=[16], data_location=TensorProto.EXTERNAL)
    for key, value in {"location": "numbers", "offset": "0", "length": "64"}.items():
        entry = beside.external_data.add()
        entry.key, entry.value = key, value
    add = helper.make_node("Add", ["images", "more"], ["out"])
    with pytest.raises(SettingError, match=r"own\.onnx: has its numbers in another file, which is not read"):
        found(bare(tmp_path / "own.onnx", [add], fixed=[beside]))
    ways: list[tuple[str, int, list[int] | None]] = [("go", TensorProto.BOOL, []), ("x", TensorProto.FLOAT, None)]
    inside = [helper.make_tensor_value_info(*way) for way in [("turn", TensorProto.INT64, []), *ways]]
    outside = [helper.make_tensor_value_info(f"{name}_on", kind, shape) for name, kind, shape in ways]
    same = [helper.make_node("Identity", [name], [f"{name}_on"]) for name, _, _ in ways]
    body = helper.make_graph(same, "body", inside, outside)
    fixed = [numpy_helper.from_array(np.array(2**62), "turns"), numpy_helper.from_array(np.array(True), "first")]
    loop = helper.make_node("Loop", ["turns", "first", "images"], ["out"], body=body)
    with pytest.raises(SettingError, match=r"own\.onnx: does not answer for 0\.2 s"):
        found(bare(tmp_path / "own.onnx", [loop], fixed=fixed))
    assert capfd.readouterr() == ("", "")


def test_many_boxes_are_no_long_work(tmp_path: Path) -> None:
    rows = np.full((1, 6, 100_000), 0.9, np.float32)
    rows[0, :4] = np.random.default_rng(0).uniform(1, SIDE, (4, 100_000))
    begun_s = time.process_time()
    assert found(model(tmp_path / "own.onnx", rows))
    assert time.process_time() - begun_s < 20


def bare(
    path: Path,
    nodes: list[onnx.NodeProto],
    shape: Sequence[int | str] = (1, 3, "height", "width"),
    kind: int = TensorProto.FLOAT,
    fixed: Sequence[TensorProto] = (),
) -> Path:
    """A network of these nodes, from `images` to `out`."""
    image, out = (helper.make_tensor_value_info(*way) for way in (("images", kind, shape), ("out", kind, None)))
    graph = helper.make_graph(nodes, "bare", [image], [out], list(fixed))
    opsets = [helper.make_opsetid("", 17)]
    path.write_bytes(helper.make_model(graph, opset_imports=opsets, ir_version=9).SerializeToString())
    return path
