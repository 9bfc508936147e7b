"""Weights that a file keeps as 16-bit numbers give the answers of 32-bit ones."""

from typing import Any

import numpy as np
import onnxruntime
import pytest

onnx = pytest.importorskip("onnx")

from onnx import TensorProto, helper, numpy_helper  # noqa: E402

from bracket_lab.learned.training.torch_model import LEAST_SIZE, shorten  # noqa: E402

pytestmark = pytest.mark.torch  # comes with the training's packages

SIDE = 64


def layer() -> Any:
    rng = np.random.default_rng(0)
    weights = rng.normal(0.0, 0.1, (SIDE, SIDE)).astype(np.float32)
    offsets = rng.normal(0.0, 0.1, SIDE).astype(np.float32)
    kept = [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(offsets, "offsets")]
    nodes = [helper.make_node("Gemm", ["seen", "weights", "offsets"], ["told"])]
    seen, told = (helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, SIDE]) for name in ("seen", "told"))
    graph = helper.make_graph(nodes, "layer", [seen], [told], kept)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=9)


def answer(model: Any) -> np.ndarray:
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    (told,) = session.run(None, {"seen": np.linspace(-1, 1, SIDE, dtype=np.float32)[np.newaxis]})
    return np.asarray(told)


def test_large_tensors_take_half_the_space_and_answers_hardly_change() -> None:
    long, short = layer(), layer()
    shorten(short)
    onnx.checker.check_model(short, full_check=True)
    assert len(short.SerializeToString()) < 0.6 * len(long.SerializeToString())
    assert answer(short) == pytest.approx(answer(long), abs=2e-3)


def test_small_tensors_stay_as_they_are() -> None:
    short = layer()
    shorten(short)
    kinds = {tensor.name: tensor.data_type for tensor in short.graph.initializer}
    assert kinds == {"weights.short": TensorProto.FLOAT16, "offsets": TensorProto.FLOAT}
    assert SIDE < LEAST_SIZE


def test_a_file_that_is_short_already_stays_as_it_is() -> None:
    once = layer()
    shorten(once)
    twice = onnx.ModelProto()
    twice.CopyFrom(once)
    shorten(twice)
    assert twice == once
