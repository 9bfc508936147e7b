"""TensorFlow Lite graphs as ONNX: the dozen operators that MediaPipe's hand networks are made of. Not for run time.

TensorFlow keeps images as (n, height, width, channels), ONNX wants (n, channels, height, width): one Transpose at the
input, and one before each Reshape. Weights stay half-precision, with a Cast.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import onnx
import tflite
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from bracket_ground.errors import ModelError

OPSET = 17
SAME = 0  # padding
RELU, RELU6 = 1, 3  # fused activations
TYPES = {
    tflite.TensorType.FLOAT32: np.float32,
    tflite.TensorType.FLOAT16: np.float16,
    tflite.TensorType.INT32: np.int32,
}


def to_onnx(content: bytes, name: str) -> onnx.ModelProto:
    """Convert a graph with one image as its input.

    Args:
        content: of a .tflite file.
        name: of the graph, for messages.

    Raises:
        ModelError: it has an operator or a type that is not known here.
    """
    return _Conversion(content, name).model()


class _Conversion:
    """One graph on its way; values are named by the number of their tensor."""

    def __init__(self, content: bytes, name: str) -> None:
        self._model = tflite.Model.GetRootAsModel(content, 0)
        self._graph, self._name = self._model.Subgraphs(0), name
        self._nodes: list[onnx.NodeProto] = []
        self._initialisers: list[onnx.TensorProto] = []
        self._constants: dict[int, NDArray[Any]] = {}
        self._four: set[int] = set()  # tensors that are kept as (n, channels, height, width)

    def model(self) -> onnx.ModelProto:
        """The converted graph, checked."""
        graph = self._graph
        source = graph.Inputs(0)
        shape = [int(size) for size in graph.Tensors(source).ShapeAsNumpy()]
        self._add("Transpose", ["image"], self._value(source), perm=[0, 3, 1, 2])
        self._four.add(source)
        for index in range(graph.OperatorsLength()):
            self._convert(graph.Operators(index))
        outputs = []
        for number in range(graph.OutputsLength()):
            index = graph.Outputs(number)
            label = graph.Tensors(index).Name().decode()
            self._add("Identity", [self._value(index)], label)
            sizes = [int(size) for size in graph.Tensors(index).ShapeAsNumpy()]
            outputs.append(helper.make_tensor_value_info(label, TensorProto.FLOAT, sizes))
        inputs = [helper.make_tensor_value_info("image", TensorProto.FLOAT, shape)]
        converted = helper.make_graph(self._nodes, self._name, inputs, outputs, self._initialisers)
        model = helper.make_model(converted, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=9)
        onnx.checker.check_model(model)
        return model

    def _convert(self, operator: Any) -> None:
        code = self._model.OperatorCodes(operator.OpcodeIndex())
        kind = tflite.opcode2name(max(code.BuiltinCode(), code.DeprecatedBuiltinCode()))
        handler = "_add_" if kind == "ADD" else f"_{kind.lower()}"
        converter: Callable[[Any, list[int], int], None] | None = getattr(self, handler, None)
        if converter is None:
            raise ModelError(f"{self._name}: operator {kind} is not known here; another version of the networks?")
        inputs = [int(index) for index in operator.InputsAsNumpy()]
        converter(operator, inputs, int(operator.Outputs(0)))

    def _dequantize(self, _: Any, inputs: list[int], out: int) -> None:
        self._constants[out] = self._constant(inputs[0])

    def _conv_2d(self, operator: Any, inputs: list[int], out: int) -> None:
        options = _options(operator, tflite.Conv2DOptions)
        weights = self._constant(inputs[1]).transpose(0, 3, 1, 2)
        self._convolve(options, inputs, weights, 1, out)

    def _depthwise_conv_2d(self, operator: Any, inputs: list[int], out: int) -> None:
        options = _options(operator, tflite.DepthwiseConv2DOptions)
        weights = self._constant(inputs[1]).transpose(3, 0, 1, 2)
        self._convolve(options, inputs, weights, len(weights), out)

    def _convolve(self, options: Any, inputs: list[int], weights: NDArray[Any], group: int, out: int) -> None:
        names = [self._value(inputs[0]), self._initialiser(weights), self._initialiser(self._constant(inputs[2]))]
        result = self._before_activation(options, out)
        self._add(
            "Conv",
            names,
            result,
            auto_pad="SAME_UPPER" if options.Padding() == SAME else "VALID",
            strides=[options.StrideH(), options.StrideW()],
            dilations=[options.DilationHFactor(), options.DilationWFactor()],
            group=group,
        )
        self._activate(options, result, out)
        self._four.add(out)

    def _max_pool_2d(self, operator: Any, inputs: list[int], out: int) -> None:
        options = _options(operator, tflite.Pool2DOptions)
        self._add(
            "MaxPool",
            [self._value(inputs[0])],
            self._value(out),
            auto_pad="SAME_UPPER" if options.Padding() == SAME else "VALID",
            kernel_shape=[options.FilterHeight(), options.FilterWidth()],
            strides=[options.StrideH(), options.StrideW()],
        )
        self._four.add(out)

    def _add_(self, operator: Any, inputs: list[int], out: int) -> None:
        options = _options(operator, tflite.AddOptions)
        result = self._before_activation(options, out)
        self._add("Add", [self._value(index) for index in inputs], result)
        self._activate(options, result, out)
        self._same_layout(inputs[0], out)

    def _prelu(self, _: Any, inputs: list[int], out: int) -> None:
        """max(x, 0) - slope * max(-x, 0): as convolutions, since ONNX Runtime leaves its layout for a PRelu."""
        value, result = self._value(inputs[0]), self._value(out)
        slopes = self._constant(inputs[1]).reshape(-1, 1, 1, 1)
        self._add("Relu", [value], f"{result}_above")
        self._scale(value, -np.ones_like(slopes), f"{result}_turned")
        self._add("Relu", [f"{result}_turned"], f"{result}_below")
        self._scale(f"{result}_below", -slopes, f"{result}_scaled")
        self._add("Add", [f"{result}_scaled", f"{result}_above"], result)
        self._four.add(out)

    def _scale(self, value: str, factors: NDArray[Any], result: str) -> None:
        """Each channel by its own factor (channels, 1, 1, 1)."""
        self._add("Conv", [value, self._initialiser(factors)], result, group=len(factors))

    def _pad(self, _: Any, inputs: list[int], out: int) -> None:
        """More channels, of zeros: as a convolution, too."""
        amounts = self._constant(inputs[1])
        channels = int(self._graph.Tensors(inputs[0]).ShapeAsNumpy()[3])
        if amounts[:3].any() or amounts[3, 0]:
            raise ModelError(f"{self._name}: a PAD of more than channels is not known here; another version?")
        same = np.eye(channels + amounts[3, 1], channels, dtype=np.float16)
        self._add("Conv", [self._value(inputs[0]), self._initialiser(same[..., None, None])], self._value(out))
        self._four.add(out)

    def _resize_bilinear(self, operator: Any, inputs: list[int], out: int) -> None:
        half = _options(operator, tflite.ResizeBilinearOptions).HalfPixelCenters()
        batch, height, width, channels = (int(size) for size in self._graph.Tensors(out).ShapeAsNumpy())
        sizes = self._initialiser(np.array([batch, channels, height, width], np.int64))
        mode = "half_pixel" if half else "asymmetric"
        names = [self._value(inputs[0]), "", "", sizes]
        self._add("Resize", names, self._value(out), mode="linear", coordinate_transformation_mode=mode)
        self._four.add(out)

    def _mean(self, operator: Any, inputs: list[int], out: int) -> None:
        keep = int(_options(operator, tflite.ReducerOptions).KeepDims())
        axes = sorted({1: 2, 2: 3, 3: 1}[int(axis)] for axis in self._constant(inputs[1]).reshape(-1))
        self._add("ReduceMean", [self._value(inputs[0])], self._value(out), axes=axes, keepdims=keep)
        if keep:
            self._four.add(out)

    def _fully_connected(self, operator: Any, inputs: list[int], out: int) -> None:
        options = _options(operator, tflite.FullyConnectedOptions)
        flat = f"{self._value(out)}_flat"
        self._add("Flatten", [self._rows(inputs[0])], flat, axis=1)
        names = [flat, *(self._initialiser(self._constant(index)) for index in inputs[1:])]
        result = self._before_activation(options, out)
        self._add("Gemm", names, result, transB=1)
        self._activate(options, result, out)

    def _logistic(self, _: Any, inputs: list[int], out: int) -> None:
        self._add("Sigmoid", [self._value(inputs[0])], self._value(out))
        self._same_layout(inputs[0], out)

    def _reshape(self, _: Any, inputs: list[int], out: int) -> None:
        shape = self._initialiser(self._graph.Tensors(out).ShapeAsNumpy().astype(np.int64))
        self._add("Reshape", [self._rows(inputs[0]), shape], self._value(out))

    def _concatenation(self, operator: Any, inputs: list[int], out: int) -> None:
        axis = int(_options(operator, tflite.ConcatenationOptions).Axis())
        names = [self._rows(index) for index in inputs]
        self._add("Concat", names, self._value(out), axis=axis)

    def _rows(self, index: int) -> str:
        """A value in TensorFlow's layout."""
        if index not in self._four:
            return self._value(index)
        name = f"{self._value(index)}_rows_{len(self._nodes)}"
        self._add("Transpose", [self._value(index)], name, perm=[0, 2, 3, 1])
        return name

    def _same_layout(self, before: int, after: int) -> None:
        if before in self._four:
            self._four.add(after)

    def _before_activation(self, options: Any, out: int) -> str:
        return f"{self._value(out)}_raw" if options.FusedActivationFunction() else self._value(out)

    def _activate(self, options: Any, result: str, out: int) -> None:
        function = options.FusedActivationFunction()
        if function == RELU6:
            zero, six = self._initialiser(np.float32(0)), self._initialiser(np.float32(6))
            self._add("Clip", [result, zero, six], self._value(out))
        elif function == RELU:
            self._add("Relu", [result], self._value(out))
        elif function:
            raise ModelError(f"{self._name}: activation {function} is not known here; another version of the networks?")

    def _add(self, kind: str, inputs: list[str], output: str, **attributes: Any) -> None:
        self._nodes.append(helper.make_node(kind, inputs, [output], **attributes))

    def _value(self, index: int) -> str:
        return f"t{index}"

    def _initialiser(self, values: Any) -> str:
        """Name of a constant; halves are stored as such and cast when the file is loaded."""
        array = np.ascontiguousarray(values) if np.ndim(values) else np.asarray(values)
        name = f"c{len(self._initialisers)}"
        self._initialisers.append(numpy_helper.from_array(array, name))
        if array.dtype != np.float16:
            return name
        self._add("Cast", [name], f"{name}_float", to=TensorProto.FLOAT)
        return f"{name}_float"

    def _constant(self, index: int) -> NDArray[Any]:
        if index in self._constants:
            return self._constants[index]
        tensor = self._graph.Tensors(index)
        data = self._model.Buffers(tensor.Buffer()).DataAsNumpy()
        kind = TYPES.get(tensor.Type())
        if kind is None or isinstance(data, int):
            raise ModelError(f"{self._name}: tensor {index} is of no known type; another version of the networks?")
        found: NDArray[Any] = np.frombuffer(data.tobytes(), kind).reshape(tensor.ShapeAsNumpy())
        self._constants[index] = found
        return found


def _options(operator: Any, kind: Any) -> Any:
    """The operator's own settings."""
    table = operator.BuiltinOptions()
    options = kind()
    options.Init(table.Bytes, table.Pos)
    return options
