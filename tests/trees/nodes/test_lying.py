"""Finding parts that lie, taking them, and what is known of a part that is held as it lay."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.nodes.ahead import HoldsNeededPart
from bracket_cell.trees.nodes.clutter import LookAtTray, lies_on_its_side
from bracket_cell.trees.nodes.lying import FindLying, SetUpright
from bracket_cell.trees.nodes.moving import IdentifyHeldPart
from bracket_cell.trees.nodes.services import Services
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection, PartsView
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import Progress, SkillStatus
from btxml.engine.errors import NodeError
from btxml.engine.status import Status
from btxml.testing import alone
from tests.trees.nodes.rig import BENCH, HOLDING, PRODUCT, seen_parts, services


def lying(part: str, x_m: float, confidence: float = 0.9, *, told: bool = True) -> PartDetection:
    place = Pose((x_m, -0.4, 0.004))
    lies = Pose((x_m, -0.4, 0.02), (0.5**0.5, 0.5**0.5, 0.0, 0.0)) if told else None
    return PartDetection(part, confidence, place, (0.09, 0.05, 0.05), (0, 0, 1, 1), upright=False, lies=lies)


def found(to: Services, view: PartsView, **ports: Any) -> int | None:
    node: Any = alone(FindLying("find"), to, parts=view, **ports)
    return node.index.entry.value if node.update() is Status.SUCCESS else None


VIEW = replace(seen_parts("o1"), others=(lying("o3", 0.5, told=False), lying("o2", 0.6), lying("o2", 0.72, 0.95)))


def test_a_part_that_lies_is_found_by_its_type_where_it_is_known_how_it_lies() -> None:
    assert found(services(), VIEW, part="o2") == 3  # the surer one
    assert found(services(), VIEW) == 3
    assert found(services(), VIEW, part="o3") is None
    assert found(services(), VIEW, part="o1") is None


def test_what_lies_near_another_part_is_found_the_nearest_first() -> None:
    assert found(services(), VIEW, near=0, within_m=0.25) == 2
    assert found(services(), VIEW, near=0, within_m=0.1) is None
    with pytest.raises(NodeError, match="part number 7 is not among the 4 seen parts"):
        found(services(), VIEW, near=7)


def test_one_that_was_tried_in_vain_comes_last_and_then_not_at_all() -> None:
    to = services()
    to.memory.failed_at(VIEW.seen[3])
    assert found(to, VIEW, part="o2") == 2
    to.memory.failed_at(VIEW.seen[2])
    assert found(to, VIEW, part="o2", tries=1) is None
    to.memory.failed_at(VIEW.seen[3])
    to.memory.failed_at(VIEW.seen[2])
    assert found(to, VIEW, part="o2") is None


@pytest.mark.parametrize("index", [0, 1, 9])
def test_a_part_that_stands_or_of_which_nobody_knows_how_it_lies_is_not_set_upright(index: int) -> None:
    node: Any = alone(SetUpright("set"), services(), parts=VIEW, index=index)
    with pytest.raises(NodeError, match=f"part number {index} is none that is seen to lie"):
        node.initialise()


class Turned:
    """A skill that succeeds at once."""

    def poll(self, observation: Observation, command: Command) -> Progress:  # noqa: ARG002
        return Progress(SkillStatus.SUCCESS, "o2 stands upright")

    def halt(self, command: Command) -> None:
        """Nothing to stop."""


def test_a_part_that_was_set_upright_is_no_reason_to_ask_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bracket_cell.skills.lying.SetUpright", lambda *_: Turned())
    to = services()
    to.memory.failed(lies_on_its_side(PRODUCT.title("o2")))
    to.memory.failed_at(VIEW.seen[2])
    node: Any = alone(SetUpright("set"), to, parts=VIEW, index=3)
    node.initialise()
    assert (to.memory.held_part, to.memory.held_lying, to.memory.tray_parts) == ("o2", True, VIEW.seen[:3])
    assert node.update() is Status.SUCCESS
    assert not to.memory.reasons
    assert found(to, VIEW, near=0, within_m=0.25, tries=1) == 2  # what was in vain may go well now


def test_a_type_that_is_seen_lying_however_often_it_was_set_upright_is_turned_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What turns it is wrong about how it lies: each further try would end the same way, and nobody would be asked."""
    monkeypatch.setattr("bracket_cell.skills.lying.SetUpright", lambda *_: Turned())
    to = services()
    for turn in range(3):
        view = replace(VIEW, others=(lying("o2", 0.5 + 0.05 * turn),))  # each time it was put elsewhere
        assert found(to, view, part="o2") == 1
        node: Any = alone(SetUpright("set"), to, parts=view, index=1)
        node.initialise()
        assert node.update() is Status.SUCCESS
    assert found(to, VIEW, part="o2") is None
    assert found(to, VIEW) is None
    assert list(to.memory.reasons)[-1] == "I turned the globe valve (o2) 3 times, and still see it lie on its side"
    look(to, seen_parts("o2"))
    assert found(to, VIEW, part="o2") == 3


def look(to: Services, view: PartsView) -> None:
    """The robot looks at the tray, and sees this."""
    node: Any = alone(LookAtTray("look"), to)
    node.initialise()
    to.now.observation = replace(to.now.observation, parts=replace(view, time_s=to.now.observation.time_s + 1.0))
    assert node.update() is Status.SUCCESS


def test_a_part_that_is_held_as_it_lay_is_none_that_a_hole_needs() -> None:
    to = services(held_part="o2")
    to.now.observation = replace(to.now.observation, gripper=HOLDING)
    node: Any = alone(HoldsNeededPart("holds"), to, state=AssemblyState({}))
    assert node.update() is Status.SUCCESS
    to.memory.held_lying = True
    assert node.update() is Status.FAILURE
    assert node.feedback_message == "o2 is held as it lay, and fits into no hole so"


def test_a_run_that_begins_with_a_leaning_tool_does_not_know_how_it_holds_the_part() -> None:
    planner = MotionPlanner(PRODUCT, BENCH)
    to = services(motion=planner, held_part="o2")
    for tilt, known in ((0.0, Status.SUCCESS), (0.6, Status.FAILURE)):
        joints = np.array(BENCH.arm_park_rad) + tilt * np.eye(6)[3]
        arm = replace(to.now.observation.arm, positions_rad=cast(Any, tuple(joints)))
        to.now.observation = replace(to.now.observation, arm=arm, gripper=HOLDING)
        node = IdentifyHeldPart("identify")
        node.setup(services=to)
        assert node.update() is known
    assert list(to.memory.reasons) == ["I do not know how I hold it"]
