"""ONNX files that say what they are: weights with a model card in their metadata."""

from __future__ import annotations

import hashlib
import os
import re
import threading
import time
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
import onnxruntime
from numpy.typing import NDArray
from onnxruntime.capi import onnxruntime_pybind11_state as ort_errors
from pydantic import Field, JsonValue, ValidationError

from bracket_ground.errors import ModelError
from bracket_ground.files.files import regular, write_whole
from bracket_ground.files.model import Model

if TYPE_CHECKING:
    from onnx import ModelProto

CARD_KEY, DIGEST_KEY = "cell.model_card", "cell.sha256"
KEPT = 12  # files that stay open: more than a run needs
MOST_BYTES = 2**31  # of a file: protobuf reads no more
SIDE_PX = (32, 4096)  # of an image that a foreign file takes
SILENT = 4  # of ONNX Runtime: it writes nothing to the terminal; its errors are told by ours
BESIDE_KEY = "session.model_external_initializers_file_folder_path"  # where a file may read others: nowhere
CODES = re.compile(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ")
PATIENCE_S, LOOKED_AFTER_S = 20.0, 0.5  # with a network: a loop in a stranger's may have no end; how often that is seen
LOAD_ERRORS = (
    ort_errors.Fail,
    ort_errors.InvalidArgument,
    ort_errors.InvalidGraph,
    ort_errors.InvalidProtobuf,
    ort_errors.NotImplemented,
    ort_errors.RuntimeException,
)

Inputs = Mapping[str, NDArray[Any]]  # of a network, by name


class ModelCard(Model):
    """What a weights file is and where it comes from.

    Attributes:
        kind: which planner or detector reads it, e.g. "semantic.factored".
        config: settings of the network and of its training.
        vocabulary: lists of words by use, in the order of the network's inputs and outputs.
        data_sha256: hash of the data set that it was trained and tested on.
        scores: by name, as measured on held-out data.
        command: what was run to make it.
    """

    kind: str
    config: dict[str, JsonValue] = Field(default_factory=dict)
    vocabulary: dict[str, tuple[str, ...]]
    data_sha256: str
    scores: dict[str, float] = Field(default_factory=dict)
    command: str
    seed: int

    def require_vocabulary(self, path: Path, wanted: Mapping[str, tuple[str, ...]]) -> None:
        """Check that the file was trained for these words, by use.

        Raises:
            ModelError: it was trained for others; the message names both.
        """
        for use, words in wanted.items():
            known = self.vocabulary.get(use, ())
            if known != words:
                raise ModelError(
                    f"{path}: trained for {use} [{'; '.join(known)}], but the product has [{'; '.join(words)}]; "
                    "train again for this product (cell train; detectors: cell train --all) or choose another kind"
                )


def save_onnx(model: ModelProto, path: Path, card: ModelCard) -> None:
    """Write weights, card and digest to one file; a file that was there before stays whole until the new one is.

    What the exporter notes of its own work (stack traces with the paths of the machine that trained) is left out.

    Raises:
        InputError: the file cannot be written.
    """
    _remove_notes(model)
    for entry in [entry for entry in model.metadata_props if entry.key in (CARD_KEY, DIGEST_KEY)]:
        model.metadata_props.remove(entry)
    entry = model.metadata_props.add()
    entry.key, entry.value = CARD_KEY, card.model_dump_json()
    write_whole(path, sealed(model.SerializeToString()))


def sealed(content: bytes) -> bytes:
    """A model with the digest of all its bytes: one more metadata entry at its end, as protobuf may be appended to."""
    key, value = DIGEST_KEY.encode(), hashlib.sha256(content).hexdigest().encode()
    entry = bytes([0x0A, len(key)]) + key + bytes([0x12, len(value)]) + value
    return content + bytes([0x72, len(entry)]) + entry  # field 14 of ModelProto, metadata_props


def without_digest(content: bytes) -> bytes:
    """The bytes that a digest at the end is of; all of them where there is none."""
    return content[: content.rfind(DIGEST_KEY.encode()) - 4] if DIGEST_KEY.encode() in content else content


def digest_of(content: bytes) -> str:
    """By which logs know weights, with a digest in their file or without."""
    return hashlib.sha256(without_digest(content)).hexdigest()


def seal(path: Path) -> None:
    """Give a file without a digest one, for somebody who trusts it."""
    content = path.read_bytes()
    write_whole(path, sealed(without_digest(content)))


def _remove_notes(model: ModelProto) -> None:
    graph = model.graph
    for noted in (graph, *graph.node, *graph.input, *graph.output, *graph.value_info, *graph.initializer):
        noted.ClearField("metadata_props")
        noted.ClearField("doc_string")


class Network(Protocol):
    """What answers for a planner: weights in ONNX, or in training a network in torch.

    Attributes:
        outputs: their names.
    """

    path: Path
    card: ModelCard
    outputs: list[str]

    def run(self, inputs: Inputs) -> dict[str, NDArray[Any]]:
        """Outputs by name.

        Raises:
            ModelError: no answer follows from these inputs.
        """
        ...


class OnnxModel:
    """A loaded ONNX file: runs on one CPU thread and never hands out NaN.

    Attributes:
        inputs, outputs: their names.
        sha256: its digest, for logs.
    """

    def __init__(self, path: Path, card: ModelCard, session: onnxruntime.InferenceSession, sha256: str) -> None:
        self.path = path
        self.card = card
        self.sha256 = sha256
        self._session = session
        self.inputs = [input_.name for input_ in session.get_inputs()]
        self.outputs = [output.name for output in session.get_outputs()]

    @staticmethod
    def load(path: Path, kind: str) -> OnnxModel:
        """Read a file that `save_onnx` wrote.

        Args:
            kind: what `ModelCard.kind` must be.

        Raises:
            ModelError: the file is missing, damaged, changed, has no card or digest, or is of another kind.
        """
        opened = _opened(path)
        card = opened.card(path)
        if card.kind != kind:
            raise ModelError(f"{path}: holds a {card.kind!r} model, but a {kind!r} model is needed")
        return OnnxModel(path, card, opened.session, opened.sha256)

    @staticmethod
    def card_of(path: Path) -> ModelCard:
        """The card of a file of any kind.

        Raises:
            ModelError: the file is missing, damaged, or has no card.
        """
        return _opened(path).card(path)

    def require_vocabulary(self, use: str, wanted: tuple[str, ...]) -> None:
        """Check that the file was trained for these words.

        Raises:
            ModelError: it was trained for others; the message names both.
        """
        self.card.require_vocabulary(self.path, {use: wanted})

    def run(self, inputs: Inputs) -> dict[str, NDArray[Any]]:
        """Outputs by name.

        Raises:
            ModelError: the inputs do not fit the network, or an output is not finite.
        """
        return _Answers(self.path, self._session, self.outputs, inputs)


class ForeignModel:
    """An ONNX file of another program: one image in.

    Attributes:
        metadata: what its exporter wrote, as text.
    """

    def __init__(self, path: Path, session: onnxruntime.InferenceSession) -> None:
        self.path, self._session = path, session
        self.metadata: Mapping[str, str] = session.get_modelmeta().custom_metadata_map
        self._input, self._outputs = session.get_inputs()[0], [output.name for output in session.get_outputs()]

    @staticmethod
    def load(path: Path) -> ForeignModel:
        """Read a file.

        Raises:
            ModelError: it is missing, damaged, or takes no single image of 32-bit numbers.
        """
        session = _opened(path).session
        taken = [(each.type, each.shape) for each in session.get_inputs()]
        least, most = SIDE_PX
        if len(taken) != 1 or taken[0][0] != "tensor(float)" or not _is_image(taken[0][1]):
            told = ", ".join(f"{kind} {shape}" for kind, shape in taken) or "nothing"
            legal = f"one image (1, 3, height, width) of 32-bit numbers, each side {least} to {most}"
            raise ModelError(f"{path}: takes {told}, but must take {legal}")
        if not (given := [each.type for each in session.get_outputs()]) or not all(map(_is_numbers, given)):
            raise ModelError(f"{path}: gives {', '.join(given) or 'nothing'}, but must give numbers")
        return ForeignModel(path, session)

    def input_px(self, usual: int) -> tuple[int, int]:
        """(width, height) of the image that it takes; where the file leaves a side open, the usual one."""
        height, width = (side if isinstance(side, int) else usual for side in self._input.shape[2:])
        return width, height

    def run(self, image: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """All outputs by name, in their order.

        Raises:
            ModelError: no answer follows from this image, or it is not finite.
        """
        answers = _Answers(self.path, self._session, self._outputs, {self._input.name: image})
        return {name: np.asarray(values, np.float32) for name, values in answers.items()}


class _Answers(dict[str, NDArray[Any]]):
    """Outputs of a network by name; one that it has not is a ModelError, too.

    Raises:
        ModelError: no answer follows from these inputs, or not in time, or it is not finite.
    """

    def __init__(
        self, path: Path, session: onnxruntime.InferenceSession, outputs: Sequence[str], inputs: Inputs
    ) -> None:
        self._path, options = path, onnxruntime.RunOptions()
        options.log_severity_level = SILENT
        calls = _watch()
        calls[id(options)] = (time.monotonic() + PATIENCE_S, options)
        try:
            super().__init__(zip(outputs, session.run(outputs, dict(inputs), options), strict=True))
        except (ValueError, *LOAD_ERRORS) as error:
            what = f"does not answer for {PATIENCE_S:g} s" if options.terminate else _said(error)
            raise ModelError(f"{path}: {what}") from error
        finally:
            del calls[id(options)]
        if wrong := [name for name, values in self.items() if not np.isfinite(values).all()]:
            raise ModelError(f"{path}: output {wrong[0]!r} is not finite")

    def __missing__(self, name: str) -> NDArray[Any]:
        raise ModelError(f"{self._path}: has no output {name!r}, but {', '.join(self)}; take a copy, or train it again")


@cache
def _watch() -> dict[int, tuple[float, onnxruntime.RunOptions]]:
    """Calls of networks, by when each must have ended; one thread ends those that have not."""
    calls: dict[int, tuple[float, onnxruntime.RunOptions]] = {}

    def end_late() -> None:
        while True:
            time.sleep(LOOKED_AFTER_S)
            for until_s, options in tuple(calls.values()):
                options.terminate = options.terminate or time.monotonic() > until_s

    threading.Thread(target=end_late, name="calls of networks", daemon=True).start()
    return calls


os.register_at_fork(after_in_child=_watch.cache_clear)  # a thread is not forked


class _Opened(NamedTuple):
    """A file as it was when it was opened."""

    session: onnxruntime.InferenceSession
    sha256: str
    whole: bool  # it is as its digest says

    def card(self, path: Path) -> ModelCard:
        metadata = self.session.get_modelmeta().custom_metadata_map
        card = _card(path, metadata)
        if DIGEST_KEY not in metadata:
            seals = f"python -c \"from pathlib import Path; from {__name__} import seal; seal(Path('{path}'))\""
            raise ModelError(
                f"{path}: holds no digest: an older version wrote it, or it was changed. "
                f"Train it again ({card.command}), or, if you trust it, give it one: {seals}"
            )
        if not self.whole:
            raise ModelError(f"{path}: damaged: its bytes are not those of its digest; take a copy, or train it again")
        return card


def _opened(path: Path) -> _Opened:
    """The file's network; opened once, as checks before a run, the run and its log all ask for it."""
    try:
        return _opened_once(regular(path, MOST_BYTES).read_bytes())
    except OSError as error:
        raise ModelError(f"{path}: cannot read the weights: {error.strerror}") from error
    except LOAD_ERRORS as error:
        if "External data" in str(error):
            whole = "write all into one: onnx.save(onnx.load(FILE), WHOLE_FILE)"
            raise ModelError(f"{path}: has its numbers in another file, which is not read; {whole}") from error
        raise ModelError(f"{path}: not an ONNX file, or damaged: {_said(error)}") from error


@lru_cache(KEPT)
def _opened_once(content: bytes) -> _Opened:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = SILENT
    options.add_session_config_entry(BESIDE_KEY, os.devnull)
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    return _Opened(session, digest_of(content), sealed(without_digest(content)) == content)


def _said(error: Exception) -> str:
    """Of an error of ONNX Runtime, without its codes."""
    return CODES.sub("", str(error).splitlines()[0])


def _is_image(shape: Sequence[int | str | None]) -> bool:
    """Whether one image in colours fits; a side may be left open."""
    legal = zip(shape, ((1, 1), (3, 3), SIDE_PX, SIDE_PX), strict=False)
    return len(shape) == 4 and all(not isinstance(side, int) or low <= side <= high for side, (low, high) in legal)


def _is_numbers(kind: str) -> bool:
    return kind.startswith("tensor(") and kind != "tensor(string)"


def _card(path: Path, metadata: Mapping[str, str]) -> ModelCard:
    if CARD_KEY not in metadata:
        raise ModelError(f"{path}: an ONNX file without a model card ({CARD_KEY}), not one of this project")
    try:
        return ModelCard.model_validate_json(metadata[CARD_KEY])
    except ValidationError as error:
        raise ModelError(f"{path}: damaged model card: {error.errors()[0]['msg']}") from error
