"""A policy that is trained on our own LeRobot export comes back into the cell and moves above a part."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pyarrow.parquet as parquet
import pytest
from onnx import TensorProto, helper, numpy_helper
from rich.console import Console

from bracket_cell.learned.inference.policy import ACTION, ENVIRONMENT, STATE, Policy
from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.replay import Replay
from bracket_cell.log.training.lerobot import write_lerobot
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_ground.errors import ModelError
from tests.cell.conftest import changed_configuration

ABOVE_M = 0.16
DEMONSTRATED, TRIED = 6, 20  # runs to learn from, parts to move above
NODES = '''
from bracket_ground.interfaces.perception import PartsView
from bracket_ground.interfaces.pose import Pose
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from bracket_cell.trees.nodes.poses import FramedPose
from bracket_cell.trees.nodes.services import CellNode

class NextPart(CellNode):
    """The seen parts one after the other; fails behind the last."""

    parts = InputPort(PartsView, "seen parts")
    index = OutputPort(int, "number of the part")
    above = OutputPort(FramedPose, "where the tool is above it")
    persistent = ("_next",)
    _next = 0

    def update(self):
        seen = self.parts.get().detections
        if self._next >= len(seen):
            return Status.FAILURE
        x, y, z = seen[self._next].world_from_part.position_m
        self.index.set(self._next)
        self.above.set(FramedPose("world", Pose((x, y, z + 0.16))))
        self.tools.journal.note("plan", required=self._next, graspable=1.0, solution="grasp")
        self._next += 1
        return Status.SUCCESS

class Arrived(CellNode):
    """Note where the tool is."""

    def update(self):
        x, y = self.services.tool_on_bench_m()
        z = self.tools.motion.kinematics.position_m(list(self.now.observation.arm.positions_rad))[2]
        self.tools.journal.note("verdict", subject="tool", decision="act", reason=f"{x} {y} {z}")
        return Status.SUCCESS
'''
TREE = """<root BTCPP_format="4" main_tree_to_execute="All">
  <BehaviorTree ID="All">
    <Sequence>
      <ActivateGripper/>
      <MoveTo pose="look"/>
      <LookAtTray parts="{parts}"/>
      <ForceSuccess>
        <KeepRunningUntilFailure>
          <Sequence>
            <NextPart parts="{parts}" index="{index}" above="{above}"/>
            MOVE
            <Arrived/>
          </Sequence>
        </KeepRunningUntilFailure>
      </ForceSuccess>
    </Sequence>
  </BehaviorTree>
</root>
"""
SHOWN = '<MoveToPose pose="{above}"/>'
LED = """<ReactiveSequence><GripperIsEmpty/>
  <RunPolicy file="FILE" parts="{parts}" index="{index}" zone_m="0.2;1.0;-0.8;0.5;0.05;0.8"/></ReactiveSequence>"""


def recorded(folder: Path, move: str, seed: int, *, pixels: bool = False) -> Log:
    """A run that goes above all parts that it sees."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "above.py").write_text(NODES)
    (folder / "above.xml").write_text(TREE.replace("MOVE", move))
    configuration = changed_configuration(folder / "config", "max_duration_s: 300.0", "max_duration_s: 90.0")
    options = RunOptions(
        folder / "above.xml", configuration, "g0", seed, log=folder / "log.mcap", nodes=(str(folder / "above.py"),),
        images=pixels, pixels=pixels, one_process=True,
    )  # fmt: skip
    outcome = run(options, Console(quiet=True)).outcome
    assert outcome.end == "finished", outcome.reason
    return read_log(folder / "log.mcap")


def samples(dataset: Path) -> tuple[Any, Any]:
    """(where the part stood, joints above it) of every motion in a data set: its last row before the next part."""
    parts, joints = [], []
    for file in sorted((dataset / "data").rglob("*.parquet")):
        rows = parquet.read_table(file).to_pydict()
        places = [tuple(row) for row in rows[ENVIRONMENT]]
        for at, place in enumerate(places):
            if any(place) and (at + 1 == len(places) or places[at + 1] != place):
                parts.append(place)
                joints.append(rows[STATE][at][:6])
    return np.array(parts), np.array(joints)


def train(dataset: Path, path: Path) -> None:
    """Ridge regression on random features of the part's place; as small as a policy can be."""
    parts, joints = samples(dataset)
    middle, spread = parts.mean(axis=0), parts.std(axis=0) + 0.02
    drawn = np.random.default_rng(0)
    weights, offsets = drawn.normal(0, 0.6, (3, 40)), drawn.normal(0, 0.6, 40)
    features = np.tanh((parts - middle) / spread @ weights + offsets)
    features = np.hstack([features, np.ones((len(parts), 1))])
    solved = np.linalg.solve(features.T @ features + 1e-6 * np.eye(41), features.T @ joints)
    constants = {
        "middle": middle, "spread": spread, "weights": weights, "offsets": offsets, "out": solved[:-1],
        "bias": solved[-1],
    }  # fmt: skip
    steps = [
        ("Sub", (ENVIRONMENT, "middle"), "a"), ("Div", ("a", "spread"), "b"), ("MatMul", ("b", "weights"), "c"),
        ("Add", ("c", "offsets"), "d"), ("Tanh", ("d",), "e"), ("MatMul", ("e", "out"), "f"),
        ("Add", ("f", "bias"), ACTION),
    ]  # fmt: skip
    graph = helper.make_graph(
        [helper.make_node(kind, list(inputs), [output]) for kind, inputs, output in steps],
        "above",
        [helper.make_tensor_value_info(ENVIRONMENT, TensorProto.FLOAT, [1, 3])],
        [helper.make_tensor_value_info(ACTION, TensorProto.FLOAT, [1, 6])],
        [numpy_helper.from_array(value.astype(np.float32), name) for name, value in constants.items()],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), str(path))


def errors_m(log: Log) -> list[float]:
    """Of every motion how far the tool is from the place above its part."""
    found, part = [], None
    for tick in log.ticks:
        for topic, fields in tick.notes:
            if topic == "plan" and "required" in fields:
                assert tick.observation.parts is not None
                part = tick.observation.parts.detections[fields["required"]].world_from_part.position_m
            elif topic == "verdict" and fields["subject"] == "tool":
                assert part is not None
                at = [float(word) for word in fields["reason"].split()]
                found.append(math.dist(at, (part[0], part[1], part[2] + ABOVE_M)))
    return found


@pytest.mark.slow  # 10 runs of the arm in physics: about a minute on a quiet core
def test_a_policy_of_our_own_export_moves_above_parts(tmp_path: Path) -> None:
    shown = [recorded(tmp_path / f"shown{seed}", SHOWN, seed) for seed in range(DEMONSTRATED)]
    write_lerobot(shown, tmp_path / "data")
    train(tmp_path / "data", tmp_path / "above.onnx")
    found: list[float] = []
    seed = 100
    while len(found) < TRIED:
        log = recorded(tmp_path / f"led{seed}", LED.replace("FILE", str(tmp_path / "above.onnx")), seed)
        found += errors_m(log)
        seed += 1
    assert sum(error < 0.010 for error in found[:TRIED]) >= 18, sorted(found[:TRIED])
    again = Replay(log, Changes(nodes=(str(tmp_path / f"led{seed - 1}" / "above.py"),))).run()
    assert again.identical, again.first


OVERHEAD, WRIST = "observation.images.overhead", "wrist"


def brightness(path: Path) -> None:
    """It turns the last joint to as many rad as the overhead image is bright, and a little as the wrist's."""
    nodes = [
        helper.make_node("ReduceMean", [OVERHEAD], ["bright"], keepdims=0),
        helper.make_node("ReduceMean", [WRIST], ["tray"], keepdims=0),
        helper.make_node("Mul", ["tray", "little"], ["more"]),
        helper.make_node("Add", ["bright", "more"], ["turn"]),
        helper.make_node("Reshape", ["turn", "one"], ["last"]),
        helper.make_node("Slice", [STATE, "from", "to", "along"], ["others"]),
        helper.make_node("Concat", ["others", "last"], [ACTION], axis=1),
    ]
    floats = {"little": np.full(1, 1e-5, np.float32)}
    integers = {"one": [1, 1], "from": [0], "to": [5], "along": [1]}
    constants = floats | {name: np.array(value, np.int64) for name, value in integers.items()}
    graph = helper.make_graph(
        nodes, "brightness",
        [
            helper.make_tensor_value_info(STATE, TensorProto.FLOAT, [1, 7]),
            helper.make_tensor_value_info(OVERHEAD, TensorProto.FLOAT, [1, 3, 48, 64]),
            helper.make_tensor_value_info(WRIST, TensorProto.FLOAT, [1, "height", "width", 3]),
        ],
        [helper.make_tensor_value_info(ACTION, TensorProto.FLOAT, [1, 6])],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )  # fmt: skip
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=9), str(path))


def answers_of(log: Log) -> list[dict[str, Any]]:
    """What the policies of a run answered, or why they did not."""
    return [fields for tick in log.ticks for topic, fields in tick.notes if topic == "outside"]


@pytest.mark.slow  # a rendered run and its replay
def test_a_policy_sees_images_and_its_replay_needs_neither_them_nor_its_file(tmp_path: Path) -> None:
    brightness(tmp_path / "bright.onnx")
    log = recorded(tmp_path / "led", LED.replace("FILE", str(tmp_path / "bright.onnx")), 3, pixels=True)
    told = [json.loads(answer["answer"]) for answer in answers_of(log)]
    assert len(told) >= 2, "it is asked again until the arm stands where it wants it"
    assert set(told[0]["frames"]) == {"overhead", "wrist"}
    assert told[1]["frames"]["overhead"] > told[0]["frames"]["overhead"]
    assert told[1]["frames"]["wrist"] > told[0]["frames"]["wrist"], "the wrist camera was asked for a new image"
    stands = log.ticks[-1].observation.arm.positions_rad
    assert stands[5] == pytest.approx(told[-1]["actions"][0][5], abs=0.02)
    shown = Frames(log).newest_of("overhead", 1e6)
    assert shown is not None
    assert stands[5] == pytest.approx(shown.image().mean() / 255, abs=0.05)
    (tmp_path / "bright.onnx").unlink()
    again = Replay(log, Changes(nodes=(str(tmp_path / "led" / "above.py"),))).run()
    assert again.identical, again.first


def test_without_images_a_policy_that_wants_some_has_no_answer(tmp_path: Path) -> None:
    brightness(tmp_path / "bright.onnx")
    log = recorded(tmp_path / "led", LED.replace("FILE", str(tmp_path / "bright.onnx")), 3)
    [told] = answers_of(log)
    assert "wants images of overhead and wrist, and this run makes none" in told["error"]
    again = Replay(log, Changes(nodes=(str(tmp_path / "led" / "above.py"),))).run()
    assert again.identical, again.first


@pytest.mark.parametrize(("shape", "answers"), [((1, 7), (1, 6)), ((1, 3, 7), (3, 6)), ((1, 4, 5), (4, 4))])
def test_a_chunk_of_actions_or_of_steps_is_taken(
    shape: tuple[int, ...], answers: tuple[int, ...], tmp_path: Path
) -> None:
    """As ACT and diffusion policies answer: several actions at once."""
    chunk = numpy_helper.from_array(np.arange(math.prod(shape), dtype=np.float32).reshape(shape) / 100, "chunk")
    nothing = numpy_helper.from_array(np.zeros(1, np.float32), "nothing")
    nodes = [
        helper.make_node("ReduceSum", ["state"], ["sum"], keepdims=0),
        helper.make_node("Mul", ["sum", "nothing"], ["none"]),
        helper.make_node("Add", ["chunk", "none"], [ACTION]),
    ]
    graph = helper.make_graph(
        nodes, "chunks",
        [helper.make_tensor_value_info("state", TensorProto.FLOAT, [1, 7])],
        [helper.make_tensor_value_info(ACTION, TensorProto.FLOAT, list(shape))], [chunk, nothing],
    )  # fmt: skip
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), tmp_path / "p")
    told = Policy(tmp_path / "p", 6).actions({"state": np.zeros(7)})
    assert told.shape == answers
    assert told[0, 1] == pytest.approx(0.01)


def test_what_a_policy_wants_to_see_is_checked_by_name(tmp_path: Path) -> None:
    for name, size, why in (("pixels", 3, "'pixels' of 3"), (STATE, 5, "of 5 numbers")):
        graph = helper.make_graph(
            [helper.make_node("Identity", [name], [ACTION])], "x",
            [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, size])],
            [helper.make_tensor_value_info(ACTION, TensorProto.FLOAT, [1, size])],
        )  # fmt: skip
        onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), tmp_path / "p")
        with pytest.raises(ModelError, match=why):
            Policy(tmp_path / "p", 6)
    (tmp_path / "p").write_bytes(b"no network")
    with pytest.raises(ModelError, match="is no ONNX file"):
        Policy(tmp_path / "p", 6)
