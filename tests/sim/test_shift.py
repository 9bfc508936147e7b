"""The person between brackets: takes the finished one out, fills bins and tray, answers what the cell asks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.operator import Answer, OperatorOrder, Question
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from bracket_ground.interfaces.pose import Array, Pose
from bracket_sim.cell import SimCell
from bracket_sim.rendering.photographer import Exposure
from bracket_sim.rendering.studio import visible_poses
from bracket_sim.scene.jobs import NOT_LISTED, Jobs
from bracket_sim.scene.person import Person, ShiftHabits
from bracket_sim.scene.settings import SimSettings
from bracket_sim.truth.ground_truth_perception import SHIFTS_PX
from bracket_sim.truth.score import Placement
from bracket_sim.worker.worker import Worker
from tests.sim.worker_bench import bench, product

QUICK = ShiftHabits(answers_s=0.5, places_asked=0.0, fills_at_once=1.0)
SETTINGS = SimSettings(overlap=False, shift=True, person=Person(shift=QUICK))
G1 = product().goal_placements("g1")
HELP = Question(1, "help", "no o3", part="o3", answers=(Answer("done", ""), Answer("placed", "")))
EMPTY_PLEASE = Question(2, "bracket", "the bracket is finished")
TAKE_IT = Question(4, "choice", "take it", answers=(Answer("taken", ""), Answer("not needed", "")))
MEND = Question(5, "mend", "wrong", positions=("p2",), answers=(Answer("done", ""), Answer("right", "")))
WHERE = Question(
    7, "where", "where?", part="o1", answers=tuple(Answer(name, "") for name in (*product().positions, "placed"))
)
WHICH = Question(3, "goal", "which?", answers=(Answer("g0", "", product().goal_placements("g0")), Answer("g1", "", G1)))


@pytest.fixture
def cell() -> Iterator[SimCell]:
    made = SimCell(product(), bench(), SETTINGS, "virtual", "shift test", 5, "g1")
    yield made
    made.close()


@pytest.fixture
def blind() -> Iterator[SimCell]:
    """With a person who overlooks what is wrong."""
    overlooks = Person(shift=QUICK, lapses=Person().lapses.model_copy(update={"overlooks": 1.0}))
    settings = SETTINGS.model_copy(update={"person": overlooks})
    made = SimCell(product(), bench(), settings, "virtual", "blind shift test", 5, "g1", rendered=False)
    yield made
    made.close()


def person(cell: SimCell) -> Worker:
    assert cell.worker is not None
    return cell.worker


def settle(cell: SimCell, until_s: float) -> None:
    """Let the worker act without rendering frames."""
    while cell.world.time_s < until_s:
        person(cell).update(cell.world.time_s, 0.008)
        cell.stock.update(0.0, 0.0)
        cell.world.step_period()


def answered(cell: SimCell, within_s: float = 30.0) -> list[OperatorOrder]:
    """What the person presses first, within this time."""
    end_s = cell.world.time_s + within_s
    pressed: list[OperatorOrder] = []
    while not pressed and cell.world.time_s < end_s:
        settle(cell, cell.world.time_s + 0.1)
        pressed = person(cell).pressed()
    return pressed


def put_goal(cell: SimCell) -> None:
    """The goal's parts in the bracket: by turns the person's and the robot's."""
    left = {part: [body for body in cell.world.bodies if body.part == part] for part in product().parts}
    for number, (position, part) in enumerate(G1.items()):
        x, y = product().bracket.holes_m[position]
        cell.world.place(left[part].pop(-(number % 2)), bench().bracket.pose @ Pose((x, y, 0.0)))


def holes_m() -> list[Array]:
    return [bench().bracket.pose.transform(np.array([x, y, 0.0])) for x, y in product().bracket.holes_m.values()]


def in_tray(cell: SimCell) -> Counter[str]:
    middle, half = np.array(bench().tray.centre_m[:2]), np.array(bench().tray.size_m) / 2
    return Counter(
        body.part for body in cell.world.bodies if np.all(np.abs(cell.world.data.xpos[body.body][:2] - middle) < half)
    )


def test_without_pixels_fingertips_are_told_where_they_are_though_the_part_between_them_hides_them(
    blind: SimCell,
) -> None:
    """Else the hand that places a part is told half a hand away from the hole."""
    sight, worker = blind.sight, person(blind)
    assert sight is not None
    away_m = []
    while not any(act.fields["act"] == "release" and act.fields["position"] for act in worker.acts):
        settle(blind, blind.world.time_s + 0.04)
        at_s = blind.world.time_s
        pose = blind.world.camera_pose("overhead")
        hand = sight.track(sight.take(Exposure("overhead", round(at_s * 1000), at_s, pose, ())))
        if hand is not None and worker.hand.position_m[0] < 1.0:
            away_m.append(float(np.linalg.norm(np.array(hand.fingertips_m) - worker.hand.position_m[:2])))
    assert away_m
    assert max(away_m) < 0.02


def test_a_finished_bracket_goes_out_is_judged_and_everything_is_filled_again(cell: SimCell) -> None:
    put_goal(cell)
    person(cell).show(Display(questions=(EMPTY_PLEASE,)))
    began_s = cell.world.time_s
    while not cell.devices.finished() and cell.world.time_s < began_s + 25:
        settle(cell, cell.world.time_s + 0.1)
    assert [report["correct"] for report in cell.devices.finished()] == [True]
    assert cell.score.placements() == {}
    wanted = Counter({name: part.quantity for name, part in product().parts.items()})
    while in_tray(cell) != wanted and cell.world.time_s < began_s + 60:
        settle(cell, cell.world.time_s + 0.1)
    assert in_tray(cell) == wanted


def test_help_sets_the_part_into_the_tray_and_says_so(cell: SimCell) -> None:
    body = next(body for body in cell.world.bodies if body.part == "o3" and body.owner == "robot")
    cell.world.place(body, Pose((0.2, 0.6, 0.03)))
    assert in_tray(cell)["o3"] == 0
    person(cell).show(Display(help_request="o3", questions=(HELP,)))
    pressed = answered(cell)
    assert [(order.kind, order.value, order.question) for order in pressed] == [("answer", "done", 1)]
    assert in_tray(cell)["o3"] == 1


def test_a_wrong_part_that_the_cell_tells_of_is_taken_out_and_what_is_right_is_said_to_be(blind: SimCell) -> None:
    cell = blind
    body = next(body for body in cell.world.bodies if body.part == "o3" and body.owner == "robot")
    x, y = product().bracket.holes_m["p2"]
    cell.world.place(body, bench().bracket.pose @ Pose((x, y, 0.0)))
    person(cell).show(Display(questions=(MEND,)))
    pressed = answered(cell)
    assert pressed == [OperatorOrder("answer", "done", MEND.number)]
    assert cell.score.placements().get("p2") != Placement("o3", True, None)
    wanted = next(body for body in cell.world.bodies if body.part == G1["p2"] and body.owner == "robot")
    cell.world.place(wanted, bench().bracket.pose @ Pose((x, y, 0.0)))
    person(cell).show(Display())
    person(cell).show(Display(questions=(replace(MEND, number=6),)))
    assert answered(cell) == [OperatorOrder("answer", "right", 6)]


def test_where_a_part_goes_is_told_by_what_is_built_unless_the_person_has_such_a_part(cell: SimCell) -> None:
    person(cell).show(Display(questions=(WHERE,)))
    assert answered(cell, 5.0) == [OperatorOrder("answer", "placed", WHERE.number)]
    for body in cell.world.bodies:
        if body.part == "o1" and body.owner == "person":
            cell.world.place(body, Pose((0.2, 0.6, 0.03)))
    right = next(position for position in product().positions if G1[position] == "o1")
    person(cell).show(Display())
    person(cell).show(Display(questions=(replace(WHERE, number=8),)))
    assert answered(cell) == [OperatorOrder("answer", right, 8)]


@pytest.mark.parametrize("inattentive", [False, True])
def test_a_wrong_part_of_the_robot_is_taken_out_where_it_is_noticed(
    cell: SimCell, blind: SimCell, inattentive: bool
) -> None:
    cell = blind if inattentive else cell
    body = next(body for body in cell.world.bodies if body.part == "o3" and body.owner == "robot")
    x, y = product().bracket.holes_m["p2"]
    cell.world.place(body, bench().bracket.pose @ Pose((x, y, 0.0)))
    settle(cell, cell.world.time_s + 6.0)
    taken = [act.fields for act in person(cell).acts if act.fields.get("act") == "take away"]
    assert taken == ([] if inattentive else [{"act": "take away", "part": "o3", "position": "p2"}])


@pytest.mark.long
def test_a_trouble_that_waits_for_somebody_is_acknowledged_again_and_again_until_it_is_gone(cell: SimCell) -> None:
    person(cell).alarm("protective stop; acknowledge it when it may go on")
    for _ in range(2):
        assert [order.kind for order in answered(cell, within_s=120.0)] == ["acknowledge"]
    person(cell).alarm("")
    assert [order.kind for order in answered(cell, within_s=120.0)] == ["resume"], "and then lets the cell go on"
    settle(cell, cell.world.time_s + 60.0)
    assert not person(cell).pressed()


def test_what_the_robot_puts_down_before_the_bracket_is_taken_when_asked(cell: SimCell) -> None:
    brought = next(body for body in cell.world.bodies if body.part == "o2" and body.owner == "robot")
    cell.world.place(brought, Pose((0.86, -0.16, product().parts["o2"].peg_length_m)))
    person(cell).show(Display(questions=(TAKE_IT,)))
    pressed = answered(cell)
    assert pressed == [OperatorOrder("answer", "taken", TAKE_IT.number)]
    assert [act.fields["part"] for act in person(cell).acts if act.fields.get("act") == "brought"] == ["o2"]
    assert any(np.linalg.norm(cell.world.data.xpos[brought.body] - hole) < 0.003 for hole in holes_m())


def test_what_nobody_needs_is_left_where_the_robot_put_it(cell: SimCell) -> None:
    put_goal(cell)
    brought = [body for body in cell.world.bodies if body.part == "o1"][2]  # neither first nor last: not in the bracket
    cell.world.place(brought, Pose((0.86, -0.16, product().parts["o1"].peg_length_m)))
    person(cell).show(Display(questions=(TAKE_IT,)))
    pressed = answered(cell)
    assert pressed == [OperatorOrder("answer", "not needed", TAKE_IT.number)]


def test_a_person_who_lacks_a_part_screws_again_and_again_until_somebody_asks(cell: SimCell) -> None:
    put_goal(cell)
    cell.stock.take([body for body in cell.world.bodies if body.part == "o3"])
    settle(cell, cell.world.time_s + 40.0)
    assert sum(event.kind == "screw" and event.edge == "start" for event in person(cell).events) >= 2


def test_the_person_tells_truly_which_goal_it_is(cell: SimCell) -> None:
    person(cell).show(Display(questions=(WHICH,)))
    pressed = answered(cell)
    assert pressed[0].value == "g1"


def test_jobs_of_a_shift_hold_one_arrangement_that_nobody_listed() -> None:
    jobs = Jobs(product(), "random", 0.3, np.random.default_rng(1))
    drawn = [jobs.next() for _ in range(100)]
    unlisted = {tuple(job.placements.values()) for job in drawn if job.goal == NOT_LISTED}
    assert len(unlisted) == 1
    assert not unlisted & set(product().goals.values())
    assert 15 < sum(job.goal == NOT_LISTED for job in drawn) < 45
    assert {job.goal for job in drawn} == {NOT_LISTED, *product().goals}
    assert Counter(next(iter(unlisted))) == Counter(product().goals["g0"])


def test_one_goal_is_one_goal() -> None:
    jobs = Jobs(product(), "g2", 0.3, np.random.default_rng(1))
    assert {jobs.next().goal for _ in range(20)} == {"g2"}
    assert UNKNOWN_GOAL not in product().goals


def test_people_take_turns_a_bracket_each() -> None:
    slow, quick = Person(shift=QUICK, pace=(0.5, 0.5)), Person(shift=QUICK, pace=(1.5, 1.5))
    settings = SETTINGS.model_copy(update={"person": slow, "people": (slow, quick)})
    made = SimCell(product(), bench(), settings, "virtual", "turns test", 5, "g1")
    try:
        worker, paces = person(made), []
        for _ in range(4):
            paces.append(worker._work.pace)
            worker._change_job()
        assert paces == [0.5, 1.5, 0.5, 1.5]
        told = [event.fields["pace"] for event in worker.acts if event.fields["act"] == "person"]
        assert told == [0.5, 1.5, 0.5, 1.5, 0.5], "the log says who is there"
    finally:
        made.close()


def test_what_fell_over_on_the_bench_is_picked_up(cell: SimCell) -> None:
    lying = Pose((0.75, 0.05, 0.09), (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0))
    theirs = next(body for body in cell.world.bodies if body.part == "o3" and body.owner == "robot")
    own = next(body for body in cell.world.bodies if body.part == "o1" and body.owner == "person")
    cell.world.place(theirs, lying)
    cell.world.place(own, Pose((0.9, -0.2, 0.03), lying.quaternion_wxyz))
    settle(cell, cell.world.time_s + 0.5)
    assert {body.name for body in cell.stock.fallen()} == {theirs.name, own.name}
    began_s = cell.world.time_s
    while cell.stock.fallen() and cell.world.time_s < began_s + 60:
        settle(cell, cell.world.time_s + 0.1)
    acts = [act.fields for act in person(cell).acts if act.fields.get("act") == "tidy up"]
    assert [sorted(act["parts"]) for act in acts] == [["o1", "o3"]]  # type: ignore[call-overload]
    settle(cell, cell.world.time_s + 8.0)
    assert in_tray(cell)["o3"] == 1


def test_no_image_comes_again_for_minutes(blind: SimCell) -> None:
    assert blind.sight is not None
    seen = blind.world.camera_pose("overhead"), (visible_poses(blind.world.data),)
    images = [
        blind.sight.take(Exposure("overhead", number, 0.0, *seen)).image.tobytes()
        for number in range(0, 8192, SHIFTS_PX)
    ]
    assert len(set(images)) == len(images)


def test_a_part_between_the_fingers_is_in_no_hole(blind: SimCell, monkeypatch: pytest.MonkeyPatch) -> None:
    world, part, (x, y) = blind.world, blind.world.bodies[0], product().bracket.holes_m["p1"]

    def seen_at_p1(number: int) -> str | None:
        assert blind.sight is not None
        exposure = Exposure("overhead", number, 0.0, world.camera_pose("overhead"), (visible_poses(world.data),))
        return blind.sight.read(blind.sight.take(exposure), None)["p1"].part

    assert seen_at_p1(0) is None
    world.place(part, world.bench.bracket.pose @ Pose((x, y, 0.010)))
    world.update_poses()
    with monkeypatch.context() as held:
        held.setattr(world, "held", lambda: part)
        assert seen_at_p1(1) is None
    assert seen_at_p1(2) == part.part
