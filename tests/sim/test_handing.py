"""What a person does beside a robot that gives and takes, and in a file of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bracket_ground.files.files import shipped
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.grasping import PAD_WIDTH_M
from bracket_ground.interfaces.pose import Pose
from bracket_sim.scene.hand import TIP_RADIUS_M, hand_rest_m
from bracket_sim.scene.person import Lapses, Leaving, Person, ScrewHabits, load_person
from bracket_sim.worker.hand_primitives import TIP_AHEAD_M
from bracket_sim.worker.worker_sight import SeenPart
from tests.sim.worker_bench import Shift, bench, product, world_of

FILES = sorted(Path(shipped("bracket_cell.config", "people")).glob("*.yaml"))
QUIET = ScrewHabits(probability=0.0, unscrewed_limit=9)


def shift_of(person: Person, seed: int = 0) -> Shift:
    return Shift("g0", seed, person, world_of(person, seed))


def acts(shift: Shift) -> list[object]:
    return [event.fields["act"] for event in shift.worker.acts]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_shipped_person_has_a_name_and_differs_from_the_careful_one(file: Path) -> None:
    assert load_person(file.stem) == load_person(str(file)) != Person()


def test_a_left_hand_rests_on_the_left_and_fills_the_bracket_all_the_same() -> None:
    person = load_person("left_handed").model_copy(update={"screw": QUIET})
    shift = shift_of(person)
    assert hand_rest_m(bench(), person)[1] < bench().bracket.position_m[1] < hand_rest_m(bench())[1]
    assert np.allclose(shift.worker.hand.position_m, hand_rest_m(bench(), person), atol=0.01)
    assert shift.until(lambda: len(shift.placed()) == 1, 20.0)


def test_who_walks_off_is_out_of_the_view_and_comes_back() -> None:
    shift = shift_of(Person(leaving=Leaving(leaves=1.0, away_s=(5.0, 5.0)), screw=QUIET))
    assert shift.until(lambda: "leaves" in acts(shift), 30.0)
    assert shift.until(lambda: float(shift.worker.hand.position_m[0]) > 1.7, 10.0)
    assert shift.until(lambda: "comes back" in acts(shift), 10.0)
    assert shift.until(lambda: len(shift.placed()) == 2, 30.0)


def test_who_swaps_leaves_a_wrong_part_and_does_not_notice() -> None:
    shift = shift_of(Person(lapses=Lapses(swaps=1.0), screw=QUIET))
    assert shift.until(lambda: "swap" in acts(shift), 40.0)
    wanted = product().goal_placements("g0")

    def wrong() -> list[str]:
        return [position for position, part in shift.placed().items() if part != wanted[position]]

    assert shift.until(lambda: bool(wrong()), 30.0)


def test_a_wish_of_the_robot_without_an_arm_is_none() -> None:
    shift = shift_of(Person(screw=QUIET))
    shift.worker.show(Display(message="please put o2 between the fingers"))
    assert shift.until(lambda: len(shift.placed()) == 1, 20.0)
    assert "give" not in acts(shift)


@pytest.mark.parametrize("part", product().parts)
@pytest.mark.parametrize("yaw_rad", [0.0, np.pi])
def test_fingertips_pinch_a_part_ahead_of_fingers_that_hold_it(
    part: str, yaw_rad: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fingertips that close on the fingers push them off the part, which falls."""
    work = shift_of(Person()).worker._work
    held = Pose.from_yaw((0.93, 0.20, 0.19), yaw_rad)
    tool_m = np.array(held.position_m) + np.array([0.0, 0.0, 0.011])
    monkeypatch.setattr(work._sight, "tool", lambda: (tool_m, None))
    grip_m, _, _ = work._beside_fingers(SeenPart("held", part, held, 0.0))
    tips_m = grip_m[0] - tool_m[0] - TIP_AHEAD_M - TIP_RADIUS_M
    assert tips_m >= PAD_WIDTH_M / 2


@pytest.mark.parametrize("part", product().parts)
def test_a_part_is_seen_held_out_wherever_along_its_height_it_is_gripped(
    part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    shift = shift_of(Person())
    sight = shift.worker._sight
    body = next(one for one in shift.world.bodies if one.part == part)
    tool_m = np.array(shift.world.part_pose(body).position_m) + np.array([0.0, 0.0, product().parts[part].size_m[2]])
    monkeypatch.setattr(sight, "held_out_m", lambda **_: tool_m)
    held = sight.handed(part)
    assert held is not None
    assert held.body == body.name
    monkeypatch.setattr(sight, "held_out_m", lambda **_: tool_m + np.array([0.0, 0.0, 0.06]))
    assert sight.handed(part) is None


@pytest.mark.parametrize("part", product().parts)
def test_a_part_that_is_given_leaves_room_for_the_fingers_that_take_it(
    part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fingers that close on a part close on the fingertips beside it, too, where these are too near."""
    work, kind = shift_of(Person()).worker._work, product().parts[part]
    at_m = work._hand.position_m - np.array(work._gripping.place(part)[0])
    held = SeenPart("held", part, Pose.from_yaw((at_m[0], at_m[1], at_m[2]), 0.0), 0.0)
    monkeypatch.setattr(work._sight, "part", lambda _: held)
    tool_m = np.array([0.93, 0.20, 0.20])
    target_m = work._between_fingers("held", tool_m)
    tips_m = work._hand_for("held", target_m)[0][0] - tool_m[0] - TIP_AHEAD_M - TIP_RADIUS_M
    assert tips_m >= PAD_WIDTH_M / 2
    assert target_m[0] - kind.size_m[0] / 2 < tool_m[0] - 0.005
