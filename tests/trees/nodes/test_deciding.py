"""Inferring, choosing, waiting for people, and getting at parts in clutter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bracket_cell.trees.nodes.clutter import CheckGraspability, DecodeSolution, FindPart, LookAtTray, part_and_others
from bracket_cell.trees.nodes.people import PersonAction, WaitForAction, WaitForHandClear, WaitForHandClearOfPart
from bracket_cell.trees.nodes.planning import ChoosePosition, DecodeGuidance, InferGoal
from bracket_cell.trees.nodes.watching import SeenAction
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.notes import ListJournal
from bracket_ground.interfaces.perception import Action, HandSample, HoleView, PartDetection
from bracket_ground.interfaces.planning import AssemblyState, GraspPlan
from bracket_ground.interfaces.pose import Pose
from btxml.engine.errors import NodeError
from btxml.engine.status import Status
from btxml.testing import alone
from tests.trees.nodes.rig import (
    BENCH,
    EMPTY_HOLES,
    PRODUCT,
    SURE,
    ScriptedGrasps,
    ScriptedPlanner,
    hand_at,
    see,
    seen_parts,
    services,
)

FREE = GraspPlan(0.9, (), False, "grasp")
BLOCKED = GraspPlan(0.1, (2,), False, "move c")
HELP = GraspPlan(0.0, (), True, "help")


@pytest.mark.parametrize(
    "answer",
    [
        ModelError("the file is damaged"),
        replace(SURE, goal_belief={"g0": float("nan"), "g1": 0.5, "g2": 0.5}),
        replace(SURE, guidance={"o1": ("p9",)}),
    ],
)
def test_a_planner_that_cannot_be_used_is_refused_and_the_rule_answers(answer: object) -> None:
    at = services(semantic=ScriptedPlanner(answer))  # type: ignore[arg-type]
    assert at.tools.infer(AssemblyState({})) is SURE
    assert isinstance(at.tools.journal, ListJournal)
    assert [fields["decision"] for topic, fields in at.tools.journal.notes if topic == "verdict"] == ["refused"]


def test_guidance_shows_what_all_likely_goals_share_and_any_part_elsewhere() -> None:
    open_goals = replace(
        SURE,
        goal_belief={"g0": 0.34, "g1": 0.33, "g2": 0.33},
        next_belief={("o1", "p1"): 0.97, ("o1", "p2"): 0.34, ("o2", "p4"): 0.34},
        guidance={"o1": ("p1", "p2"), "o2": ("p4",), "o3": ()},
    )
    at = services()
    node = DecodeGuidance("show")
    node.setup(services=at)
    for plan, guidance, any_part in (
        (open_goals, {"o1": ("p1",), "o3": ()}, ("p2", "p4")),
        (replace(open_goals, next_belief={}), {"o3": ()}, ("p1", "p2", "p4")),
        (SURE, SURE.guidance, ()),
    ):
        node.plan.entry.value = plan  # type: ignore[union-attr]
        assert node.update() is Status.SUCCESS
        shown = at.now.command.display
        assert shown is not None
        assert (shown.guidance, shown.any_part) == (guidance, any_part)
    assert at.tools.infer(AssemblyState({})).guidance == SURE.guidance, "the robot plans with all of it"


def test_a_state_is_inferred_once() -> None:
    at = services()
    node = InferGoal("infer")
    node.setup(services=at)
    for placed in ({}, {}, {"p1": "o1"}, {"p1": "o1"}):
        node.state.entry.value = AssemblyState(placed)  # type: ignore[union-attr]
        assert node.update() is Status.SUCCESS
    assert len(at.tools.semantic.asked) == 2  # type: ignore[attr-defined]


def test_the_first_position_that_the_guard_lets_pass_is_chosen() -> None:
    at = services()
    see(at, 1.0, holes={**EMPTY_HOLES, "p1": HoleView("o2", 1.0, 0.0)})
    node = ChoosePosition("choose")
    node.setup(services=at)
    for port, value in (("plan", SURE), ("state", AssemblyState({})), ("part", "o1"), ("positions", ["p1", "p2"])):
        getattr(node, port).entry.value = value
    assert node.update() is Status.SUCCESS
    assert node.position.entry.value == "p2"  # type: ignore[union-attr]


def test_a_screw_is_served_once() -> None:
    node = WaitForAction("wait")
    node.setup(services=services())
    node.awaited.entry.value = PersonAction.screw  # type: ignore[union-attr]
    assert node.update() is Status.RUNNING
    answers = []
    for kind, started_s in (("idle", 0.0), ("screw", 1.0), ("screw", 1.0), ("idle", 2.0), ("screw", 3.0)):
        node.action.entry.value = SeenAction(Action(kind, 1.0), started_s)  # type: ignore[union-attr, arg-type]
        answers.append(node.update())
    assert answers == [Status.RUNNING, Status.SUCCESS, Status.RUNNING, Status.RUNNING, Status.SUCCESS]


def test_who_lets_the_robot_wait_is_told_once_what_for() -> None:
    at = services()
    node = WaitForAction("wait")
    node.setup(services=at)
    node.awaited.entry.value = PersonAction.screw  # type: ignore[union-attr]
    told = []
    node.initialise()
    for time_s in (0.0, 10.0, 15.0, 20.0):
        see(at, time_s)
        node.update()
        told.append(at.now.display.message)
        at.now.show(message="")
    assert told == ["", "", "waiting until you turn a screw", ""]


def test_the_arm_waits_for_a_near_hand_and_for_a_fresh_view() -> None:
    at = services()
    node = WaitForHandClear("clear")
    node.setup(services=at)
    node.position.entry.value = "p3"  # type: ignore[union-attr]
    x, y, _ = BENCH.bracket.position_m
    y += PRODUCT.bracket.holes_m["p3"][1]
    assert node.update() is Status.RUNNING
    see(at, 1.0, hand=hand_at(x + 0.05, y))
    assert node.update() is Status.RUNNING
    see(at, 1.1, hand=hand_at(0.6, -0.2))
    assert node.update() is Status.RUNNING, "the arm would pass over this hand"
    see(at, 1.2, hand=hand_at(x + 0.35, y))
    assert node.update() is Status.SUCCESS
    at.now.observation = replace(at.now.observation, time_s=3.0)
    assert node.update() is Status.RUNNING


def test_a_hand_counts_as_where_it_will_be_and_so_much_of_the_way() -> None:
    at = services()
    x, y, _ = BENCH.bracket.position_m
    y += PRODUCT.bracket.holes_m["p3"][1]

    def answer(hand: HandSample, **ports: float) -> Status:
        node = WaitForHandClear("clear")
        node.setup(services=at)
        node.position.entry.value = "p3"  # type: ignore[union-attr]
        for name, value in ports.items():
            getattr(node, name).entry.value = value
        see(at, 1.0, hand=hand)
        return node.update()

    leaves = replace(hand_at(x + 0.15, y), velocity_m_s=(0.5, 0.0))
    comes = replace(hand_at(x + 0.3, y), velocity_m_s=(-0.5, 0.0))
    assert (answer(leaves), answer(comes)) == (Status.RUNNING, Status.SUCCESS)
    assert answer(leaves, lookahead_s=0.4) is Status.SUCCESS
    assert answer(comes, lookahead_s=0.4) is Status.RUNNING
    rests = hand_at(x, y)
    assert answer(rests, way_m=0.05) is Status.SUCCESS, "the arm is far away yet"
    assert answer(rests, way_m=5.0) is Status.RUNNING


def test_an_arm_on_its_way_goes_on_nearer_to_a_hand_and_begins_anew_once_it_was_clear_for_a_while() -> None:
    at = services()
    node = WaitForHandClear("clear")
    node.setup(services=at)
    node.position.entry.value = "p3"  # type: ignore[union-attr]
    for name, value in {"distance_m": 0.25, "goes_on_m": 0.2, "way_m": 0.0, "steady_s": 0.5}.items():
        getattr(node, name).entry.value = value
    x, y = at.tool_on_bench_m()

    def answer(time_s: float, away_m: float, speed_m_s: float = 0.0) -> Status:
        see(at, time_s, hand=replace(hand_at(x + away_m, y), velocity_m_s=(speed_m_s, 0.0)))
        return node.update()

    assert answer(1.0, 0.22) is Status.RUNNING
    assert answer(1.1, 0.26) is Status.RUNNING, "a hand that screws goes to and fro"
    assert answer(1.2, 0.26, 0.8) is Status.SUCCESS, "it leaves"
    assert answer(1.3, 0.22) is Status.SUCCESS
    assert answer(1.4, 0.18) is Status.RUNNING
    assert answer(1.5, 0.22) is Status.RUNNING
    assert answer(1.95, 0.26) is Status.RUNNING
    assert answer(2.05, 0.26) is Status.SUCCESS
    assert answer(5.0, 0.22) is Status.RUNNING, "since then nobody asked"


def test_the_arm_waits_for_a_hand_near_the_part_that_it_goes_to() -> None:
    at = services()
    node = WaitForHandClearOfPart("clear")
    node.setup(services=at)
    node.parts.entry.value, node.index.entry.value = seen_parts("o1", "o2"), 1  # type: ignore[union-attr]
    x, y, _ = seen_parts("o1", "o2").detections[1].world_from_part.position_m
    assert node.update() is Status.RUNNING
    for offset_m, expected in ((0.05, Status.RUNNING), (0.35, Status.SUCCESS)):
        see(at, 1.0, hand=hand_at(x + offset_m, y))
        assert node.update() is expected
    assert node.feedback_message == "the hand is near the way to o2 in the tray"


def test_looking_waits_for_an_answer_to_an_image_taken_after_the_question() -> None:
    old, new = replace(seen_parts("o1"), time_s=1.0), replace(seen_parts("o2"), time_s=2.1)
    at = services()
    at.now.observation = replace(at.now.observation, time_s=2.0, parts=old)
    node = LookAtTray("look")
    node.setup(services=at)
    node.initialise()
    assert at.now.command.look
    assert node.update() is Status.RUNNING
    at.now.observation = replace(at.now.observation, time_s=2.2, parts=new)
    assert node.update() is Status.SUCCESS
    assert node.parts.entry.value is new  # type: ignore[union-attr]


def test_a_frame_of_the_tray_that_does_not_come_is_asked_for_again() -> None:
    at = services()
    node: Any = alone(LookAtTray("look"), at)
    asked = []
    for tick in range(60):
        at.now.command = Command()
        at.now.observation = replace(at.now.observation, time_s=0.04 * tick, parts=None)
        node.execute()
        asked += [round(0.04 * tick, 2)] if at.now.command.look else []
    assert asked == pytest.approx([0.0, 0.44, 0.88, 1.32, 1.76, 2.2], abs=0.05)


def test_the_easiest_part_of_the_required_type_is_found() -> None:
    at = services(grasp=ScriptedGrasps({0: BLOCKED, 1: FREE, 2: HELP}))
    node = FindPart("find")
    node.setup(services=at)
    node.parts.entry.value = seen_parts("o1", "o1", "o2")  # type: ignore[union-attr]
    for part, expected in (("o1", Status.SUCCESS), ("o3", Status.FAILURE)):
        node.part.entry.value = part  # type: ignore[union-attr]
        assert node.update() is expected
    assert node.index.entry.value == 1  # type: ignore[union-attr]


def test_a_part_that_slipped_out_of_the_fingers_comes_after_the_others() -> None:
    at = services(grasp=ScriptedGrasps({0: FREE, 1: FREE, 2: FREE}))
    node: Any = alone(FindPart("find"), at, part="o1", parts=seen_parts("o1", "o1", "o2"))
    assert node.execute() is Status.SUCCESS
    assert node.index.entry.value == 0
    slipped = seen_parts("o1").detections[0]
    at.memory.failed_at(replace(slipped, world_from_part=Pose((0.407, -0.403, 0.016))))
    node.execute()
    assert node.index.entry.value == 1
    for _ in range(3):
        at.memory.failed_at(seen_parts("o1", "o1").detections[1])
    node.execute()
    assert node.index.entry.value == 0, "it is tried again where the others failed more often"


def test_a_blocked_part_is_decoded_to_its_blocker_and_help_fails() -> None:
    plans = {0: BLOCKED, 1: HELP, 2: FREE}
    at = services(grasp=ScriptedGrasps(plans), rule_grasp=ScriptedGrasps(plans))
    at.why_not_graspable = lambda parts, required: None if required == 2 else "no room"  # type: ignore[method-assign]  # noqa: ARG005
    view = seen_parts("o1", "o2", "o3")
    graspable, solution = [], []
    for index in range(3):
        check, decode = CheckGraspability("check"), DecodeSolution("decode")
        for node in (check, decode):
            node.setup(services=at)
            node.parts.entry.value, node.index.entry.value = view, index  # type: ignore[union-attr]
        graspable.append(check.update())
        solution.append((decode.update(), decode.feedback_message))
    assert graspable == [Status.FAILURE, Status.FAILURE, Status.SUCCESS]
    assert solution == [(Status.SUCCESS, "move c"), (Status.FAILURE, "help"), (Status.FAILURE, "grasp")]


def test_a_number_that_no_part_has_is_a_node_error() -> None:
    with pytest.raises(NodeError, match="part number 4 is not among the 2 seen parts"):
        part_and_others(seen_parts("o1", "o2"), 4)


def on_its_side(part: str, x_m: float) -> PartDetection:
    return PartDetection(part, 0.9, Pose((x_m, -0.4, 0.0)), (0.09, 0.05, 0.05), (0, 0, 1, 1), upright=False)


def test_a_type_of_which_all_lie_is_said_to_lie() -> None:
    view = replace(seen_parts("o1"), others=(on_its_side("o3", 0.6),))
    for part, said in (("o3", "lies on its side, or I cannot tell"), ("o2", "there is no")):
        at = services()
        node = FindPart("find")
        node.setup(services=at)
        node.parts.entry.value, node.part.entry.value = view, part  # type: ignore[union-attr]
        assert node.update() is Status.FAILURE
        assert any(said in reason for reason in at.memory.reasons), at.memory.reasons


@pytest.mark.parametrize(
    ("part", "said"), [("o3", "that lies on its side is in the way"), ("unknown", "something that I do not know lies")]
)
def test_what_lies_in_the_way_is_named_as_the_reason_of_the_call_for_help(part: str, said: str) -> None:
    at = services(grasp=ScriptedGrasps({0: HELP}), rule_grasp=ScriptedGrasps({0: HELP}))
    at.why_not_graspable = lambda parts, required: "o1: no room" if parts.others else None  # type: ignore[method-assign]  # noqa: ARG005
    node = DecodeSolution("decode")
    node.setup(services=at)
    node.parts.entry.value = replace(seen_parts("o1"), others=(on_its_side(part, 0.45),))  # type: ignore[union-attr]
    node.index.entry.value = 0  # type: ignore[union-attr]
    assert node.update() is Status.FAILURE
    assert any(said in reason for reason in at.memory.reasons), at.memory.reasons


def test_what_lies_is_among_the_others_that_the_arm_keeps_clear_of() -> None:
    view = replace(seen_parts("o1", "o2"), others=(on_its_side("o3", 0.6),))
    part, others = part_and_others(view, 1)
    assert (part.part, [other.part for other in others]) == ("o2", ["o1", "o3"])
    with pytest.raises(NodeError, match="part number 2 is not among the 2 seen parts"):
        part_and_others(view, 2)


def test_a_grasp_that_the_arm_cannot_do_is_refused_and_the_rule_answers() -> None:
    for rule, expected in ((BLOCKED, "move c"), (FREE, "help")):
        at = services(grasp=ScriptedGrasps({0: FREE}), rule_grasp=ScriptedGrasps({0: rule}))
        at.why_not_graspable = lambda parts, required: "no room for the fingers"  # type: ignore[method-assign]  # noqa: ARG005
        assert at.solve(seen_parts("o1", "o2", "o3"), 0).text == expected
        assert isinstance(at.tools.journal, ListJournal)
        assert ("verdict", "no room for the fingers") in [(t, f.get("reason")) for t, f in at.tools.journal.notes]


def test_help_with_a_part_that_the_arm_can_take_is_refused_and_the_rule_answers() -> None:
    for rule, expected in ((BLOCKED, "move c"), (HELP, "grasp")):
        at = services(grasp=ScriptedGrasps({0: HELP}), rule_grasp=ScriptedGrasps({0: rule}))
        assert at.solve(seen_parts("o1", "o2", "o3"), 0).text == expected
