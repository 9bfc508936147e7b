"""Pick from and place at places with names, on an ideal robot; and what is counted and noted there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.nodes.places import BuiltBeside, CountAt, NoteAt, Pick, Place
from bracket_cell.trees.nodes.planning import judge
from bracket_cell.trees.nodes.services import Services
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.perception import Action, BenchView, HoleView
from bracket_ground.interfaces.places import BenchPlace
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState
from btxml.engine.node import TreeNode
from btxml.engine.status import Status
from btxml.testing import alone
from tests import ROOT
from tests.skills.ideal_robot import IdealRobot
from tests.trees.nodes.rig import services

FILE = ROOT / "config" / "examples" / "tending" / "cell.yaml"
CONFIGURATION = load_configuration(FILE)
PRODUCT, BENCH = load_product(CONFIGURATION, FILE), CONFIGURATION.bench
O1_M = PRODUCT.parts["o1"].size_m[1]


def known(bench: Bench = BENCH, **changes: Any) -> Services:
    motion = MotionPlanner(PRODUCT, bench, CONFIGURATION.motion)
    made = services(bench=bench, motion=motion, **changes)
    for name in bench.places:
        made.at_place(name)
    return made


def run(node: TreeNode, to: Services, robot: IdealRobot, ticks: int = 3000) -> Status:
    node.setup(services=to)
    for _ in range(ticks):
        to.now.observation, to.now.command = robot.observe(), Command()
        status = node.execute()
        robot.act(to.now.command)
        if status is not Status.RUNNING:
            return status
    raise AssertionError(node.feedback_message)


def fails(node: TreeNode, to: Services, robot: IdealRobot, why: str) -> None:
    assert run(node, to, robot) is Status.FAILURE
    assert why in node.feedback_message


def there(to: Services, name: str) -> list[str | None]:
    return [None if place is None else place.part for place in to.memory.places[name]]


def test_a_part_goes_from_the_fixture_into_the_chuck_and_is_known_there() -> None:
    to, robot = known(), IdealRobot(BENCH.arm_park_rad, part_m=O1_M)
    assert run(alone(Pick(), source="fixture"), to, robot) is Status.SUCCESS
    assert (there(to, "fixture"), to.memory.held_part) == ([None, "o2", "o2", "o1"], "o1")
    assert run(alone(Place(), part="o1", at="chuck"), to, robot) is Status.SUCCESS
    assert there(to, "chuck") == ["o1"]
    assert not robot.observe().gripper.holding
    tool = to.tools.motion.kinematics.forward(np.array(robot.observe().arm.positions_rad))
    assert tool.position_m[1] < BENCH.places["chuck"].position_m[1] - 0.15, "it leaves the machine by its front"


@pytest.mark.parametrize(("wanted", "spot"), [("o2", 1), ("o1", 0)])
def test_the_first_spot_with_the_type_is_taken(wanted: str, spot: int) -> None:
    to, robot = known(), IdealRobot(BENCH.arm_park_rad, part_m=PRODUCT.parts[wanted].size_m[1])
    assert run(alone(Pick(), wanted=wanted, source="fixture"), to, robot) is Status.SUCCESS
    assert there(to, "fixture")[spot] is None


def test_a_place_that_is_felt_is_tried_spot_by_spot() -> None:
    spots = BenchPlace(position_m=(0.30, 0.42, 0.04), holds=("o1",), columns=2, pitch_m=(0.11, 0.1), known_by="felt")
    bench = BENCH.model_copy(update={"places": {"stop": spots}})
    to, robot = known(bench), IdealRobot(BENCH.arm_park_rad, part_m=None)
    assert there(to, "stop") == ["o1", "o1"]
    assert run(alone(Pick(), source="stop"), to, robot) is Status.FAILURE
    assert there(to, "stop") == [None, None], "fingers that closed on nothing have felt that"


def test_a_full_place_and_an_empty_one_fail_with_words_and_nothing_moves() -> None:
    to, robot = known(), IdealRobot(BENCH.arm_park_rad)
    fails(alone(Pick(), source="chuck"), to, robot, "no part at chuck")
    run(alone(NoteAt(), place="chuck", now_there="o2"), to, robot)
    fails(alone(Place(), part="o1", at="chuck"), to, robot, "no free spot at chuck")
    fails(alone(Place(), part="o3", at="pallet"), to, robot, "o3 does not belong at pallet")
    assert all(command.follow is None for command in robot.sent)
    assert "no free spot at chuck" in to.memory.reasons


def test_what_others_did_is_noted_and_counted() -> None:
    to, robot = known(), IdealRobot(BENCH.arm_park_rad)
    count = alone(CountAt(), place="fixture")
    assert run(count, to, robot) is Status.SUCCESS
    assert count.feedback_message == "4 at fixture, 0 free"
    run(alone(NoteAt(), place="fixture", now_there="empty;o2"), to, robot)
    assert there(to, "fixture") == [None, "o2", None, None]
    fails(alone(NoteAt(), place="fixture", now_there="o9"), to, robot, "fixture has 4 spots")


NEST = BenchPlace(position_m=(0.45, 0.3, 0.036), seat="hole", rows=2, known_by="seen", filled=("o2", "o1"))


def looked_at(to: Services, time_s: float, *parts: str | None) -> list[str | None]:
    """What is known of the nest when the camera has seen this of its spots at this time."""
    spots = {f"nest {number}": HoleView(part, 1.0, time_s) for number, part in enumerate(parts)}
    view = BenchView(1, time_s, None, {}, Action("idle", 1.0), spots=spots)
    to.now.observation = replace(to.now.observation, time_s=time_s, bench=view)
    return [None if detection is None else detection.part for detection in to.at_place("nest")]


def test_at_a_place_that_is_seen_the_camera_counts_once_it_saw_it_after_what_the_robot_did() -> None:
    to = known(BENCH.model_copy(update={"places": {"nest": NEST}}))
    assert there(to, "nest") == ["o2", "o1"], "as the file says, until it was seen"
    assert looked_at(to, 1.0, None, "o1") == [None, "o1"]
    assert looked_at(to, 2.0, "o3") == ["o3", "o1"], "what is hidden stays as it was"
    to.now.observation = replace(to.now.observation, time_s=3.0)
    to.note_at("nest", 0, None)
    late = replace(to.now.observation.bench or BenchView(0, 0, None, {}, Action("idle", 1.0)), time_s=2.9)
    to.now.observation = replace(to.now.observation, bench=late)
    assert to.at_place("nest")[0] is None, "the view is older than the robot's act"
    assert looked_at(to, 3.2, "o1", "o1") == ["o1", "o1"]


def test_what_stands_at_places_is_kept_clear_of() -> None:
    to = known()
    standing = [detection.part for detection in to.memory.standing]
    assert sorted(standing) == ["o1", "o1", "o2", "o2"]


def test_names_of_places_are_those_of_the_configuration(tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M"><Sequence>'
        '<Pick from="fixtur"/><MoveToPose pose="pallet: 0 0 0.2"/></Sequence></BehaviorTree></root>'
    )
    with pytest.raises(InputError, match=r"the bench has no place 'fixtur'.*fixture") as refused:
        load_tree(file, node_registry(PRODUCT, configuration=CONFIGURATION))
    assert "MoveToPose" not in str(refused.value)


def test_a_sub_assembly_is_taken_from_where_it_was_built_once_it_stands_there() -> None:
    file = ROOT / "config" / "examples" / "subassembly" / "cell.yaml"
    configuration = load_configuration(file)
    product, bench = load_product(configuration, file), configuration.bench
    to = services(product=product, bench=bench, motion=MotionPlanner(product, bench, configuration.motion))
    node = alone(BuiltBeside(), part="pump")
    node.setup(services=to)
    assert node.execute() is Status.FAILURE
    state = AssemblyState({})
    plan = AssemblyPlan({"g0": 1.0}, {("pump", "p1"): 1.0}, "pump", {"pump": ("p1",)})
    waits = judge(to, plan, state, "pump", "p1")
    assert (waits.decision, str(waits.reason)) == ("wait", "no pump is built at nest")
    to.note_at("nest", 0, to.standing_at("nest", 0, "body"))
    assert node.execute() is Status.FAILURE, "the body alone is none"
    to.note_at("nest", 0, to.standing_at("nest", 0, "pump"))
    assert node.execute() is Status.SUCCESS
    assert "built" not in str(judge(to, plan, state, "pump", "p1").reason)
    robot = IdealRobot(bench.arm_park_rad, part_m=product.parts["pump"].size_m[1])
    assert run(alone(Pick(), source="nest", wanted="pump"), to, robot) is Status.SUCCESS
    assert to.memory.held_part == "pump"
