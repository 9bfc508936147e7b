"""Layers of an ONNX file that compute with 8-bit numbers: about half the time, and a quarter of the space."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import onnx
from numpy.typing import NDArray
from onnx import ModelProto, TensorProto, helper, numpy_helper
from onnxruntime.quantization import CalibrationDataReader, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from bracket_cell.learned.inference.onnx_model import Inputs

LEAST_SIZE = 1024  # of a tensor that is worth it; biases are few, and sums of much


def shorten(model: ModelProto) -> None:
    """Keep the large tensors as 16-bit numbers, in place; whoever opens the file makes 32-bit ones of them again."""
    graph = model.graph
    casts = []
    for tensor in graph.initializer:
        values = numpy_helper.to_array(tensor)
        if tensor.data_type != TensorProto.FLOAT or values.size < LEAST_SIZE:
            continue
        name, kept = tensor.name, f"{tensor.name}.short"
        tensor.CopyFrom(numpy_helper.from_array(values.astype("float16"), kept))
        casts.append(helper.make_node("Cast", [kept], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)


LAYERS = ("Conv", "Gemm")
SHAPED = ("Reshape", "Sigmoid", "Softmax")  # what may come between a last layer and an answer


def quantised(model: ModelProto, met_with: Iterable[Inputs]) -> ModelProto:
    """The same network with 8-bit layers (static quantisation), except the last ones: answers keep their fine steps.

    Weights take 7 bits, as processors without VNNI instructions add two products in 16.

    Args:
        met_with: inputs as the network will meet with them; their largest and smallest values give the ranges.
    """
    with tempfile.TemporaryDirectory() as folder:
        plain, out = Path(folder) / "plain.onnx", Path(folder) / "quantised.onnx"
        level = logging.getLogger().level
        logging.getLogger().setLevel(logging.ERROR)  # it gives advice on what was just done
        try:
            quant_pre_process(model, plain)
            last = _last_layers(onnx.load(plain))
            quantize_static(
                plain,
                out,
                _Reader(met_with),
                nodes_to_exclude=last,
                activation_type=QuantType.QUInt8,  # half as slow as signed ones
                weight_type=QuantType.QInt8,
                per_channel=True,
                reduce_range=True,
            )
        finally:
            logging.getLogger().setLevel(level)
        return onnx.load(out)


class _Reader(CalibrationDataReader):  # type: ignore[misc]  # it has no types
    def __init__(self, met_with: Iterable[Inputs]) -> None:
        self._left = iter(met_with)

    def get_next(self) -> dict[str, NDArray[Any]] | None:
        """The next inputs; None at the end."""
        inputs = next(self._left, None)
        return None if inputs is None else dict(inputs)


def _last_layers(model: ModelProto) -> list[str]:
    """Names of the layers that give the answers."""
    wanted, found = {output.name for output in model.graph.output}, []
    for node in reversed(model.graph.node):
        if wanted.isdisjoint(node.output):
            continue
        if node.op_type in LAYERS:
            found.append(node.name)
        elif node.op_type in SHAPED:
            wanted.update(node.input)
    return found
