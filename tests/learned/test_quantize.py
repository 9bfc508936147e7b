"""A network that computes with 8-bit numbers answers as it did, in a quarter of the space."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import onnxruntime
import pytest

onnx = pytest.importorskip("onnx")

from onnx import TensorProto, helper, numpy_helper  # noqa: E402

from bracket_lab.learned.training.torch_model import quantised  # noqa: E402

pytestmark = pytest.mark.torch  # comes with the training's packages

CHANNELS, SIDE = 16, 12
LAYERS = ("first", "second", "heat")
RNG = np.random.default_rng(0)
MET_WITH = [{"image": RNG.normal(0, 1, (1, CHANNELS, SIDE, SIDE)).astype(np.float32)} for _ in range(4)]


def network() -> Any:
    """Two convolutions, and a last one whose answers are probabilities."""
    kept, nodes, seen = [], [], "image"
    for layer in LAYERS:
        weights = RNG.normal(0, 0.1, (CHANNELS, CHANNELS, 3, 3)).astype(np.float32)
        kept.append(numpy_helper.from_array(weights, f"{layer}.weights"))
        convolution = helper.make_node("Conv", [seen, f"{layer}.weights"], [layer], layer, pads=[1, 1, 1, 1])
        seen = f"{layer}.told"
        nodes += [convolution, helper.make_node("Sigmoid" if layer == "heat" else "Relu", [layer], [seen])]
    shape = [1, CHANNELS, SIDE, SIDE]
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name in ("image", seen)]
    graph = helper.make_graph(nodes, "network", ends[:1], ends[1:], kept)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=9)


def answers(model: Any, inputs: Sequence[Any]) -> np.ndarray:
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return np.array([session.run(None, input_)[0] for input_ in inputs])


def test_answers_hardly_change_and_weights_take_less_space() -> None:
    plain = network()
    short = quantised(plain, MET_WITH)
    assert answers(short, MET_WITH) == pytest.approx(answers(plain, MET_WITH), abs=0.05)
    sizes = {tensor.name: len(tensor.raw_data) for tensor in short.graph.initializer}
    assert sum(sizes.values()) < 0.55 * sum(len(tensor.raw_data) for tensor in plain.graph.initializer)
    assert sizes["heat.weights"] == len(plain.graph.initializer[-1].raw_data)  # the last layer stays


def test_the_same_inputs_give_the_same_file() -> None:
    plain = network()
    assert quantised(plain, MET_WITH) == quantised(plain, MET_WITH)


def test_ranges_follow_from_what_is_met_with() -> None:
    plain = network()
    narrow = quantised(plain, [{"image": 0.1 * MET_WITH[0]["image"]}])
    off = [
        np.abs(answers(model, MET_WITH) - answers(plain, MET_WITH)).max()
        for model in (narrow, quantised(plain, MET_WITH))
    ]
    assert off[0] > 2 * off[1]
