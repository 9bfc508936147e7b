"""Weights and their card survive the disk; anything else is a ModelError that says what is wrong."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference import onnx_model
from bracket_cell.learned.inference.onnx_model import ModelCard, OnnxModel, save_onnx, seal, sealed, without_digest
from bracket_ground.errors import ModelError

CARD = ModelCard(
    kind="test.root",
    config={"hidden": 3},
    vocabulary={"parts": ("o1", "o2")},
    data_sha256="00ff",
    scores={"success": 0.5},
    command="cell train test",
    seed=7,
)


def square_root() -> onnx.ModelProto:
    shape = ["n"]
    graph = helper.make_graph(
        [helper.make_node("Sqrt", ["x"], ["y"])],
        "root",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, shape)],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "sub" / "root.onnx"
    save_onnx(square_root(), path, CARD)
    return path


def test_the_card_and_the_network_come_back(saved: Path) -> None:
    model = OnnxModel.load(saved, "test.root")
    assert model.card == CARD
    assert np.allclose(model.run({"x": np.array([4.0, 9.0], np.float32)})["y"], [2.0, 3.0])
    assert [file.name for file in saved.parent.iterdir()] == ["root.onnx"]


def test_nothing_of_the_machine_that_exported_is_kept(tmp_path: Path) -> None:
    model = square_root()
    trace = model.graph.node[0].metadata_props.add()
    trace.key, trace.value = "pkg.torch.onnx.stack_trace", 'File "/home/someone/train.py", line 3'
    model.graph.output[0].doc_string = "/home/someone"
    save_onnx(model, tmp_path / "root.onnx", CARD)
    assert b"/home/someone" not in (tmp_path / "root.onnx").read_bytes()


def test_saving_again_replaces_the_card(saved: Path) -> None:
    save_onnx(onnx.load(saved), saved, CARD.model_copy(update={"seed": 8}))
    assert OnnxModel.load(saved, "test.root").card.seed == 8


def test_nan_never_comes_out(saved: Path) -> None:
    with pytest.raises(ModelError, match=r"output 'y' is not finite"):
        OnnxModel.load(saved, "test.root").run({"x": np.array([-1.0], np.float32)})


def test_inputs_that_do_not_fit(saved: Path) -> None:
    model = OnnxModel.load(saved, "test.root")
    for inputs in ({"z": np.ones(1, np.float32)}, {"x": np.ones((1, 2), np.float32)}, {"x": np.ones(1)}):
        with pytest.raises(ModelError, match=r"root\.onnx"):
            model.run(inputs)


def test_an_output_that_is_not_there_is_named(saved: Path) -> None:
    answers = OnnxModel.load(saved, "test.root").run({"x": np.ones(1, np.float32)})
    with pytest.raises(ModelError, match=r"root\.onnx: has no output 'heat', but y; take a copy"):
        answers["heat"]


def test_weights_that_never_answer_are_not_waited_for(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a log that is replayed: no signal ends such a call, Ctrl-C neither."""
    monkeypatch.setattr(onnx_model, "PATIENCE_S", 0.2)
    same = [helper.make_node("Identity", [name], [f"{name}_on"]) for name in ("go", "x")]
    turn = helper.make_tensor_value_info("turn", TensorProto.INT64, [])
    go, go_on = (helper.make_tensor_value_info(name, TensorProto.BOOL, []) for name in ("go", "go_on"))
    x, x_on = (helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n"]) for name in ("x", "x_on"))
    body = helper.make_graph(same, "body", [turn, go, x], [go_on, x_on])
    endless = square_root()
    endless.graph.node[0].CopyFrom(helper.make_node("Loop", ["", "", "x"], ["y"], body=body))
    save_onnx(endless, saved, CARD)
    with pytest.raises(ModelError, match=r"root\.onnx: does not answer for 0\.2 s"):
        OnnxModel.load(saved, "test.root").run({"x": np.ones(1, np.float32)})


def test_calls_begin_no_threads_of_their_own(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One begins and ends in .2 ms, in a busy machine in ten times that: as long as a small network takes."""
    model = OnnxModel.load(saved, "test.root")
    model.run({"x": np.ones(1, np.float32)})
    monkeypatch.setattr(threading.Thread, "start", lambda thread: pytest.fail(f"{thread} begins"))
    assert model.run({"x": np.ones(1, np.float32)})["y"] == [1.0]


def test_two_first_calls_at_once_may_begin_two_watches(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnx_model, "_watch", dict)  # another one for each that asks
    assert OnnxModel.load(saved, "test.root").run({"x": np.ones(1, np.float32)})["y"] == [1.0]


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "No such file"), (b"", "damaged"), (b"garbage" * 9, "damaged"), ("cut", "damaged"), ("bare", "model card")],
)
def test_files_that_are_no_model(saved: Path, content: bytes | str | None, message: str) -> None:
    path = saved.with_name("other.onnx")
    if content == "cut":
        path.write_bytes(saved.read_bytes()[:-40])
    elif content == "bare":
        path.write_bytes(square_root().SerializeToString())
    elif isinstance(content, bytes):
        path.write_bytes(content)
    with pytest.raises(ModelError, match=message):
        OnnxModel.load(path, "test.root")


@pytest.mark.parametrize("share", [0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0])
def test_one_changed_byte_is_refused(saved: Path, share: float) -> None:
    content = bytearray(saved.read_bytes())
    content[round(share * (len(content) - 1))] ^= 1
    saved.write_bytes(content)
    with pytest.raises(ModelError, match=r"damaged|digest"):
        OnnxModel.load(saved, "test.root")


def test_weights_without_a_digest_are_told_and_can_be_given_one(saved: Path) -> None:
    whole = saved.read_bytes()
    saved.write_bytes(without_digest(whole))
    with pytest.raises(ModelError, match=r"root\.onnx: holds no digest.*cell train test.*seal"):
        OnnxModel.load(saved, "test.root")
    seal(saved)
    assert saved.read_bytes() == whole
    assert OnnxModel.load(saved, "test.root").card == CARD


def test_all_shipped_weights_have_their_digest() -> None:
    files = sorted(WEIGHTS.glob("*.onnx"))
    assert len(files) > 10
    for path in files:
        content = path.read_bytes()
        assert sealed(without_digest(content)) == content, path


def test_another_kind(saved: Path) -> None:
    with pytest.raises(ModelError, match=r"'test\.root'.*'grasp\.pairs'"):
        OnnxModel.load(saved, "grasp.pairs")


def test_another_vocabulary_names_both(saved: Path) -> None:
    model = OnnxModel.load(saved, "test.root")
    model.require_vocabulary("parts", ("o1", "o2"))
    with pytest.raises(ModelError, match=r"\[o1; o2\].*\[a; b; c\]"):
        model.require_vocabulary("parts", ("a", "b", "c"))
