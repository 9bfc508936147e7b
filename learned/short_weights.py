"""Weights of an ONNX file in half the space: kept as 16-bit numbers, computed with as 32-bit ones."""

from __future__ import annotations

from onnx import ModelProto, TensorProto, helper, numpy_helper

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
