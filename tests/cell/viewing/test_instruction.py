"""What a person is told follows from fields: what a node's traits say, and the placement that a verdict names."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest

from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.viewing.guidance import guidance_sentences
from bracket_cell.viewing.instruction import NEAR_S, OperatorGuide
from bracket_cell.watching.observer import SentCommand, TickRecord
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.faults import SafetyDecision
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import Action, BenchView, HandSample, HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from bracket_ground.interfaces.product import Product
from btxml.engine.node import StatusChange
from btxml.engine.status import Status
from tests import ROOT
from tests.trees.nodes.rig import EMPTY_GRIPPER, EMPTY_HOLES, PRODUCT, STANDING

OWN = """
from btxml import Node, Status
from btxml.engine.traits import Traits


class StandBackPlease(Node):
    \"\"\"Waits for a visitor.\"\"\"

    traits = Traits({traits})

    def update(self) -> Status:
        return Status.RUNNING
"""
TREE = """<root BTCPP_format="4" main_tree_to_execute="Mine">
  <BehaviorTree ID="Mine"><StandBackPlease name="PlacePart"/></BehaviorTree>
</root>"""


@pytest.mark.parametrize(("traits", "moment"), [('shown_as="gives way"', "waits"), ("", "unknown")])
def test_a_leaf_of_ones_own_that_gives_way_is_told(tmp_path: Path, traits: str, moment: str) -> None:
    """Its class and its name tell nothing: here it is named as a leaf of the library that places."""
    own, file = tmp_path / "own_leaves.py", tmp_path / "mine.xml"
    own.write_text(OWN.format(traits=traits))
    file.write_text(TREE)
    tree = load_tree(file, node_registry(PRODUCT, (str(own),)))
    instructor = OperatorGuide(PRODUCT, lambda: tree)
    seen = Observation(0, 0.0, replace(STANDING, moving=True), EMPTY_GRIPPER)
    display = Display(goal_belief={"g0": 1.0}, guidance={})
    running = StatusChange(tree.nodes[0].full_path, tree.nodes[0].uid, Status.INVALID, Status.RUNNING, "")
    verdict = ("verdict", {"part": "o2", "position": "p4", "decision": "act", "subject": "", "reason": ""})
    for number in range(2):
        instructor.take(
            TickRecord(
                replace(seen, tick=number, time_s=number * (NEAR_S + 0.6)),
                "RUNNING",
                (running,) * (number == 0),
                (verdict,) * (number == 0),  # type: ignore[arg-type]
                Command(display=display),
                SentCommand(),
                0.001,
                False,
                judgement=SafetyDecision(),
            )
        )
    assert instructor.next == ("o2", "p4")
    assert instructor.now().moment == moment


@pytest.mark.parametrize("at_nest", [None, "body", "pump"])
def test_a_sub_assembly_is_built_and_then_brought(at_nest: str | None) -> None:
    product = load_yaml(ROOT / "config" / "examples" / "subassembly" / "product.yaml", Product)
    tree = load_tree(ROOT / "trees" / "ahead.xml", node_registry(product))
    guide = OperatorGuide(product, lambda: tree)
    view = BenchView(0, 10.0, None, {}, Action("idle", 1.0), spots={"nest 0": HoleView(at_nest, 1.0, 10.0)})
    display = Display(goal_belief={"g0": 1.0}, guidance={"pump": ("p1",)})
    seen = Observation(0, 10.0, STANDING, EMPTY_GRIPPER, bench=view)
    rest = tuple(("belief", {"edge": ["o2", at], "source": "robot"}) for at in ("p2", "p3", "p4"))
    guide.take(TickRecord(seen, "RUNNING", (), rest, Command(display=display), SentCommand(), 0.001, False))  # type: ignore[arg-type]
    brought = at_nest == "pump"
    words = "Wait: I bring the pump to p1" if brought else "Build the pump at nest of body and cap"
    assert (str(guide.now().words), guide.now().bins) == (words, () if brought else ("body", "cap"))
    sentences = guidance_sentences(display.guidance, (), product, guide.done, guide.built)
    assert ("Build the pump (pump) at nest of body (body) and cap (cap)" in sentences) == (not brought)


@pytest.mark.parametrize(("fastened", "words"), [(True, "Now screw M8 at p1"), (False, "Turn the screw of p4")])
def test_a_screw_is_asked_for_where_the_product_has_one(fastened: bool, words: str) -> None:
    """Also of p1, whose fastening is done, a product that lists fastenings has no other screw."""
    product = load_yaml(ROOT / "config" / "examples" / "fastened" / "product.yaml", Product) if fastened else PRODUCT
    guide = OperatorGuide(product, lambda: load_tree(ROOT / "trees" / "ahead.xml", node_registry(product)))
    display = Display(goal_belief={"g0": 1.0}, guidance={"o3": ("p6",)})

    def told(number: int, *notes: object) -> str:
        view = BenchView(number, float(number), None, EMPTY_HOLES, Action("idle", 1.0))
        seen = Observation(number, float(number), STANDING, EMPTY_GRIPPER, bench=view)
        guide.take(TickRecord(seen, "RUNNING", (), notes, Command(display=display), SentCommand(), 0.001, False))  # type: ignore[arg-type]
        return str(guide.now().words)

    placed = [("belief", {"edge": [part, at], "source": "seen hole"}) for part, at in (("o1", "p1"), ("o2", "p4"))]
    assert told(0, *placed) == words
    assert ("screw" in told(1, ("belief", {"fastened": ("s1",)}))) == (not fastened)


@pytest.mark.parametrize("likeliest", [*PRODUCT.goals, UNKNOWN_GOAL])
def test_there_is_always_a_sentence(likeliest: str) -> None:
    """Also where what was placed fits no product, and while nobody has anything to do."""
    tree = load_tree(ROOT / "trees" / "shift.xml", node_registry(PRODUCT))
    for seed in range(100):
        drawn, guide = random.Random(seed), OperatorGuide(PRODUCT, lambda: tree)
        filled = drawn.sample(PRODUCT.positions, drawn.randrange(len(PRODUCT.positions)))
        edges = [("belief", {"edge": [drawn.choice(list(PRODUCT.parts)), at], "source": "seen hole"}) for at in filled]
        left = [at for at in PRODUCT.positions if at not in filled]
        guidance = {"o3": tuple(drawn.sample(left, drawn.randint(0, len(left))))}
        shown = Display(guidance, goal_belief={likeliest: 1.0})
        hand = HandSample(0.0, (200, 120, 290, 230), (0.7, 0.1), (0.8, 0.1), drawn.choice([None, *PRODUCT.parts]))
        bench = BenchView(0, 0.0, hand, EMPTY_HOLES, Action("transit", 0.9))
        for number in range(3):
            seen = Observation(number, 2.0 * number, STANDING, EMPTY_GRIPPER, bench)
            notes = tuple(edges) if number == 0 else (("belief", {"fastened": ()}),)
            guide.take(
                TickRecord(seen, "RUNNING", (), notes, Command(display=shown), SentCommand(), 0.001, False)  # type: ignore[arg-type]
            )
            assert guide.now().words, f"seed {seed}: {filled}, {guidance}"
