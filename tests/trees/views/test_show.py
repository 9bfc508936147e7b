"""What people and editors are told about trees and nodes; the test kit."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from btxml.engine.node import Node
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.files.compile.registry import BUILT_IN, Registry
from btxml.testing import TreeBench, alone, assert_ticks
from btxml.views.palette import groot_model, palette_list, palette_text
from btxml.views.picture import picture
from btxml.views.show import show_file


class Fetch(Node):
    """Fetch a part & wait (Alg. 1 line 9).

    More about it.
    """

    part = InputPort(str, "its type")
    tries = InputPort(int, "attempts", default=2)
    pose = OutputPort(tuple[float, ...], "where it was")

    def update(self) -> Status:
        self.pose.set((1.0, 2.0))
        self.feedback_message = f"has {self.part.get()}"
        return Status.SUCCESS


SVG = "{http://www.w3.org/2000/svg}"
XML = (
    '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Inner"><Fetch part="{p}"/></BehaviorTree>'
    '<BehaviorTree ID="Main"><Sequence name="job"><SubTree ID="Inner" p="o1"/><AlwaysFailure/></Sequence>'
    "</BehaviorTree></root>"
)


def test_a_file_is_shown_main_tree_first(write: Callable[[str], Path]) -> None:
    assert show_file(write(XML), Registry([Fetch])).splitlines() == [
        "Main  (main tree)",
        '└─ Sequence "job"',
        "   ├─ SubTree Inner  p=o1",
        "   └─ AlwaysFailure",
        "",
        "Inner",
        "└─ Fetch  part={p}",
    ]


def test_the_picture_holds_every_node_once_and_none_overlap(write: Callable[[str], Path]) -> None:
    root = ElementTree.fromstring(picture(write(XML), Registry([Fetch])))
    words = [text.text for text in root.iter(SVG + "text")]
    assert words == ["Main", "Sequence: job", "Inner", "p=o1", "AlwaysFailure", "Inner", "Fetch", "part={p}"]
    boxes = [[float(rect.get(key, "0")) for key in ("x", "y", "width", "height")] for rect in root.iter(SVG + "rect")]
    for one in range(len(boxes)):
        for other in range(one):
            (x, y, width, height), (x2, y2, width2, height2) = boxes[one], boxes[other]
            assert x >= x2 + width2 or x2 >= x + width or y >= y2 + height2 or y2 >= y + height


def test_the_palette_tells_name_meaning_and_ports() -> None:
    text = palette_text(Registry([Fetch]))
    assert text.index("Fetch  [Action]") < text.index("Sequence  [Control]")
    assert "    Fetch a part & wait (Alg. 1 line 9).\n    <- part: str, mandatory  (its type)\n" in text
    assert "    <- tries: int = 2  (attempts)\n    -> pose: tuple[float, ...]  (where it was)\n" in text


def test_every_node_of_the_language_says_what_it_means() -> None:
    for entry in palette_list(Registry()):
        assert entry["meaning"]
        assert all(port["meaning"] for port in entry["ports"])  # type: ignore[attr-defined]
    assert len(BUILT_IN) == 41  # SubTree is the 42nd node of BehaviorTree.CPP


def test_groot_model_is_read_back_and_leaves_built_in_nodes_out(write: Callable[[str], Path]) -> None:
    root = ElementTree.fromstring(groot_model(Registry([Fetch])))
    (model,) = root.iter("TreeNodesModel")
    assert [(node.tag, node.get("ID")) for node in model] == [("Action", "Fetch")]
    ports = {port.get("name"): (port.tag, port.get("type"), port.get("default")) for port in model[0][1:]}
    assert ports["tries"] == ("input_port", "int", "2")
    assert ports["pose"] == ("output_port", "tuple[float, ...]", None)
    assert "BehaviorTree" not in show_file(write(groot_model(Registry([Fetch]))), Registry())


def test_bench_runs_a_tree_with_scripted_leaves(write: Callable[[str], Path]) -> None:
    bench = TreeBench(write(XML), {"Fetch": "RRS"}, {"Fetch": {"pose": (0.0,)}}, registry=Registry([Fetch]))
    assert_ticks(bench, "RRFF")
    assert bench.events[:4] == ["start Fetch", "tick Fetch", "tick Fetch", "tick Fetch"]
    assert bench.started("Fetch") == 2
    with pytest.raises(AssertionError, match="answered F, not S"):
        assert_ticks(bench, "S")


def test_a_bench_refuses_names_that_nothing_has(write: Callable[[str], Path]) -> None:
    path = write(XML)
    with pytest.raises(ValueError, match="nothing is named 'Fetsch'; did you mean 'Fetch'"):
        TreeBench(path, {"Fetsch": "F"}, registry=Registry([Fetch]))
    with pytest.raises(ValueError, match="the tree has no 'Fetsch'; did you mean 'Fetch'"):
        TreeBench(path, registry=Registry([Fetch])).started("Fetsch")


TWICE = (
    '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence name="both">'
    '<SubTree ID="Get" name="left"/><SubTree ID="Get"/></Sequence></BehaviorTree>'
    '<BehaviorTree ID="Get"><Fallback><Fetch part="o1" pose="{pose}"/><Fetch name="again" part="o2" pose="{pose}"/>'
    "</Fallback></BehaviorTree></root>"
)


def test_a_bench_tells_nodes_of_one_name_apart_by_their_paths(write: Callable[[str], Path]) -> None:
    path = write(TWICE)
    answers = {"left/Fetch": "F", "Get/Fetch": "RS", "Get/again": "F"}
    bench = TreeBench(path, answers, {"left/again": {"pose": (1.0,)}}, registry=Registry([Fetch]))
    assert_ticks(bench, "RS")
    assert [bench.started(name) for name in ("left/Fetch", "left/again", "Get/Fetch", "Get/again")] == [1, 1, 1, 0]
    assert (bench.started("Fetch"), bench.started("again")) == (3, 1)
    paths = [node.full_path for node in bench.tree.nodes if node.name == "Fetch"]
    assert paths == ["left/Fetch::4", "Get::6/Fetch::8"]  # as log and monitor tell them
    again = TreeBench(path, {paths[1]: "F", "Get/again": "F", "Fetch": "S"}, registry=Registry([Fetch]))
    assert_ticks(again, "F")
    assert (again.started(paths[0]), again.started(paths[1])) == (1, 1)


@pytest.mark.parametrize("name", ["left/Fetsch", "both", "Fallback", "left"])
def test_a_bench_refuses_paths_that_no_leaf_has(write: Callable[[str], Path], name: str) -> None:
    path = write(TWICE)
    with pytest.raises(ValueError, match=f"nothing is named '{name}'; "):
        TreeBench(path, {name: "F"}, registry=Registry([Fetch]))
    with pytest.raises(ValueError, match=f"the tree has no '{name}'; "):
        TreeBench(path, registry=Registry([Fetch])).started(name)


def test_a_node_can_be_tested_alone() -> None:
    node = alone(Fetch("fetch"), part="o2")
    assert node.execute() is Status.SUCCESS
    assert node.feedback_message == "has o2"


def test_loading_a_tree_is_light() -> None:
    heavy = "numpy,cv2,mujoco,torch,onnxruntime,pinocchio,lark"
    modules = "sys, btxml.files.check, btxml.views.show, btxml.views.palette"
    code = f"import {modules}; print([m for m in '{heavy}'.split(',') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
