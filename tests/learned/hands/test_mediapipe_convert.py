"""MediaPipe's graphs as ONNX: the same numbers, by operators that ONNX Runtime keeps in its own layout."""

from __future__ import annotations

from collections.abc import Sequence

import flatbuffers
import numpy as np
import onnxruntime
import pytest
import tflite
from numpy.typing import NDArray

from bracket_ground.errors import ModelError
from bracket_lab.experiments.mediapipe_convert import to_onnx

Values = NDArray[np.generic]
TYPES = {"float32": tflite.TensorType.FLOAT32, "int32": tflite.TensorType.INT32}


def graph(operator: int, image: tuple[int, ...], constant: Values, out: tuple[int, ...]) -> bytes:
    """A TensorFlow Lite file of one operator, of an image and a constant."""
    builder = flatbuffers.Builder(1024)

    def several(start: object, of: Sequence[int]) -> int:
        start(builder, len(of))  # type: ignore[operator]
        for each in reversed(of):
            builder.PrependUOffsetTRelative(each)
        return int(builder.EndVector())

    def buffer(content: bytes) -> int:
        data = builder.CreateByteVector(content)
        tflite.BufferStart(builder)
        tflite.BufferAddData(builder, data)
        return int(tflite.BufferEnd(builder))

    def tensor(shape: tuple[int, ...], number: int, kind: int, name: str) -> int:
        sizes, named = builder.CreateNumpyVector(np.array(shape, np.int32)), builder.CreateString(name)
        tflite.TensorStart(builder)
        tflite.TensorAddShape(builder, sizes)
        tflite.TensorAddType(builder, kind)
        tflite.TensorAddBuffer(builder, number)
        tflite.TensorAddName(builder, named)
        return int(tflite.TensorEnd(builder))

    buffers = several(tflite.ModelStartBuffersVector, [buffer(b""), buffer(constant.tobytes())])
    kinds = tflite.TensorType.FLOAT32, TYPES[constant.dtype.name], tflite.TensorType.FLOAT32
    shapes, numbers, names = (image, constant.shape, out), (0, 1, 0), ("image", "constant", "found")
    told = zip(shapes, numbers, kinds, names, strict=True)
    tensors = several(tflite.SubGraphStartTensorsVector, [tensor(*each) for each in told])
    taken, given, first = (builder.CreateNumpyVector(np.array(at, np.int32)) for at in ([0, 1], [2], [0]))
    tflite.OperatorStart(builder)
    tflite.OperatorAddInputs(builder, taken)
    tflite.OperatorAddOutputs(builder, given)
    operators = several(tflite.SubGraphStartOperatorsVector, [int(tflite.OperatorEnd(builder))])
    tflite.SubGraphStart(builder)
    tflite.SubGraphAddTensors(builder, tensors)
    tflite.SubGraphAddInputs(builder, first)
    tflite.SubGraphAddOutputs(builder, given)
    tflite.SubGraphAddOperators(builder, operators)
    graphs = several(tflite.ModelStartSubgraphsVector, [int(tflite.SubGraphEnd(builder))])
    tflite.OperatorCodeStart(builder)
    tflite.OperatorCodeAddDeprecatedBuiltinCode(builder, operator)
    codes = several(tflite.ModelStartOperatorCodesVector, [int(tflite.OperatorCodeEnd(builder))])
    tflite.ModelStart(builder)
    tflite.ModelAddVersion(builder, 3)
    tflite.ModelAddOperatorCodes(builder, codes)
    tflite.ModelAddSubgraphs(builder, graphs)
    tflite.ModelAddBuffers(builder, buffers)
    builder.Finish(tflite.ModelEnd(builder))
    return bytes(builder.Output())


def answer(content: bytes, image: Values) -> Values:
    """The converted graph's, in ONNX's layout as MediaPipe's are read: rows first."""
    session = onnxruntime.InferenceSession(to_onnx(content, "small").SerializeToString())
    return np.asarray(session.run(None, {"image": image})[0]).transpose(0, 2, 3, 1)


IMAGE = np.random.default_rng(3).normal(size=(1, 4, 6, 16)).astype(np.float32)


def test_a_slope_a_channel_is_exact_and_no_prelu() -> None:
    slopes = np.linspace(-0.5, 1.5, 16, dtype=np.float32).reshape(1, 1, 16)
    content = graph(tflite.BuiltinOperator.PRELU, IMAGE.shape, slopes, IMAGE.shape)
    assert np.array_equal(answer(content, IMAGE), np.where(IMAGE > 0, IMAGE, slopes * IMAGE))
    assert "PRelu" not in {node.op_type for node in to_onnx(content, "small").graph.node}, "half of a frame's time"


def test_more_channels_are_zeros() -> None:
    amounts = np.array([[0, 0], [0, 0], [0, 0], [0, 8]], np.int32)
    content = graph(tflite.BuiltinOperator.PAD, IMAGE.shape, amounts, (1, 4, 6, 24))
    assert np.array_equal(answer(content, IMAGE), np.pad(IMAGE, [(0, 0), (0, 0), (0, 0), (0, 8)]))


def test_a_border_is_refused() -> None:
    amounts = np.array([[0, 0], [1, 1], [0, 0], [0, 0]], np.int32)
    with pytest.raises(ModelError, match="small: a PAD of more than channels is not known here"):
        to_onnx(graph(tflite.BuiltinOperator.PAD, IMAGE.shape, amounts, (1, 6, 6, 16)), "small")
