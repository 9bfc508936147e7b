"""Networks in torch where weights files are meant: asked like an ONNX file, and exported to one. Imports torch."""

from __future__ import annotations

import io
import logging
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import ModelProto, TensorProto, helper, numpy_helper
from onnxruntime.quantization import CalibrationDataReader, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process
from pydantic import JsonValue
from torch import nn

from bracket_cell.learned.inference.onnx_model import Inputs, ModelCard, OnnxModel, save_onnx
from bracket_ground.errors import ModelError

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


TOLERANCE = 1e-5  # ONNX and torch agree within
Answers = Mapping[str, NDArray[Any]]
Differences = Callable[[Answers, Answers], Iterable[tuple[str, float]]]  # of found and expected, by name of the output
_OPSET = 20


class TorchModel:
    """A network that has not been exported; `bracket_cell.learned.inference.onnx_model.Network` says what it can do."""

    def __init__(self, network: nn.Module, outputs: Iterable[str], card: ModelCard) -> None:
        self.path = Path("a network in memory")
        self.card = card
        self.outputs = list(outputs)
        self._network = network

    def run(self, inputs: Inputs) -> dict[str, NDArray[Any]]:
        """Outputs by name; inputs in the order of the network's arguments."""
        with torch.no_grad():
            found = self._network(*(torch.from_numpy(values) for values in inputs.values()))
        values = found if isinstance(found, tuple) else (found,)
        return {name: value.numpy() for name, value in zip(self.outputs, values, strict=True)}


def begin_with(network: nn.Module, weights: Path, kind: str) -> None:
    """Give a network the numbers that its like was exported with.

    What was normalised over batches was folded into the layer before: it stays so, and only its offset is learned.

    Raises:
        ModelError: they are of another kind, shape, or no weights.
    """
    OnnxModel.load(weights, kind)
    tensors = {value.name.removesuffix(".short"): value for value in onnx.load(weights).graph.initializer}

    def fill(name: str, value: torch.Tensor) -> None:
        held = tensors.get(name)
        if held is None or tuple(held.dims) != tuple(value.shape):
            raise ModelError(f"{weights}: holds no {name} of {tuple(value.shape)}: training cannot begin with it")
        value.data.copy_(torch.from_numpy(numpy_helper.to_array(held).astype(np.float32)))

    folded = {name: module for name, module in network.named_modules() if isinstance(module, nn.BatchNorm2d)}
    for name, norm in folded.items():
        nn.init.ones_(norm.weight)
        norm.running_mean, norm.running_var = torch.zeros_like(norm.bias), torch.ones_like(norm.bias) - norm.eps
        fill(f"{name.rpartition('.')[0]}.0.weight_bias", norm.bias)
        norm.eval()
    for name, value in network.named_parameters():
        if name.rpartition(".")[0] not in folded:
            fill(name, value)


def write_weights(
    model: TorchModel,
    out: Path,
    samples: Iterable[Inputs],
    score: Callable[[], dict[str, float]],
    *,
    any_rows: bool = False,
    tolerance: float = TOLERANCE,
    differences: Differences | None = None,
    told: Mapping[str, JsonValue] | None = None,
    short: bool = False,
    met_with: Sequence[Inputs] = (),
) -> dict[str, float]:
    """Export a network to `out`, compare the file with torch, score it, and write the scores onto its card.

    Args:
        samples: inputs on which ONNX and torch must agree; the first one tells the exporter their shapes.
        score: scores of the planner that reads `out`.
        any_rows: inputs may have any number of rows.
        tolerance: by which outputs of file and network may differ.
        differences: how far two answers are apart; by default the largest difference of each output.
        told: what else the card's config says; read after `score`, which may fill it.
        short: keep weights as 16-bit numbers.
        met_with: such inputs as the network will meet with; if there are any, it computes with 8-bit numbers for them,
            which is not compared with torch.

    Returns:
        The scores.

    Raises:
        ModelError: an output differs by more than that.
    """
    samples = list(samples)
    program = _export(model, samples[0], any_rows)
    if short:
        shorten(program)
    save_onnx(program, out, model.card)
    _compare(OnnxModel.load(out, model.card.kind), model, samples, tolerance, differences or _largest)
    if met_with:
        program = quantised(program, met_with)
        save_onnx(program, out, model.card)
    scores = score()
    config = {**model.card.config, **(told or {})}
    save_onnx(program, out, model.card.model_copy(update={"scores": scores, "config": config}))
    return scores


def _compare(
    written: OnnxModel, model: TorchModel, samples: Iterable[Inputs], tolerance: float, differences: Differences
) -> None:
    for inputs in samples:
        for name, difference in differences(written.run(inputs), model.run(inputs)):
            if not difference <= tolerance:
                what = f"output {name} differs from torch by {difference:.1e}, more than {tolerance}"
                raise ModelError(f"{written.path}: {what}")


def _largest(found: Answers, expected: Answers) -> Iterator[tuple[str, float]]:
    for name, value in found.items():
        yield name, float(np.abs(value - expected[name]).max())


def _export(model: TorchModel, inputs: Inputs, any_rows: bool) -> Any:
    """The ONNX program; what the exporter says of its own insides reaches nobody."""
    for name in ("torch.onnx", "torch.utils.flop_counter", "onnxscript", "onnx_ir"):
        logging.getLogger(name).setLevel(logging.ERROR)
    rows = {name: {0: torch.export.Dim.DYNAMIC} for name in inputs} if any_rows else None
    words = io.StringIO()
    with warnings.catch_warnings(), redirect_stdout(words), redirect_stderr(words):
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            model._network,
            tuple(torch.from_numpy(values) for values in inputs.values()),
            input_names=list(inputs),
            output_names=model.outputs,
            dynamic_shapes=rows,
            dynamo=True,
            opset_version=_OPSET,
            verbose=False,
        )
    if program is None:
        raise ModelError("torch exported nothing")
    return program.model_proto
