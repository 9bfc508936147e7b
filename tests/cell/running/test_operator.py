"""The operator channel: what may be said, and what the cell knows of it afterwards."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bracket_cell.running.fault_checks import FaultReport
from bracket_cell.running.operator import KEPT, WAITING, OperatorChannel
from bracket_cell.running.supervisor import Supervisor
from bracket_ground.errors import InputError
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.faults import Action, Fault
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.operator import Answer, OperatorOrder, Question, WorkOrder
from btxml.engine.status import Status
from tests.cell.fakes import Rig
from tests.trees.nodes.rig import EMPTY_GRIPPER, STANDING

ASKED = Question(3, "goal", "which one?", answers=(Answer("g0", "g0"), Answer("none of these", "a new one")))


def channel() -> OperatorChannel:
    made = OperatorChannel(("g0", "g1"), present=True, brackets=4)
    made.shown(Display(questions=(ASKED,)))
    return made


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (OperatorOrder("dance"), "no order 'dance'; legal: acknowledge, answer"),  # type: ignore[arg-type]
        (OperatorOrder("pause", "later"), "'now' or 'after part'"),
        (OperatorOrder("goal", "g9"), "no goal 'g9'; legal: g0, g1, none of these"),
        (OperatorOrder("answer", "g0", 7), "no question 7 is asked now; questions: 3"),
        (OperatorOrder("answer", "g1", 3), "legal: g0, none of these"),
    ],
)
def test_what_makes_no_sense_is_refused_in_words(order: OperatorOrder, words: str) -> None:
    with pytest.raises(InputError, match=words.replace("(", r"\(")):
        channel().put(order)


def test_a_text_is_taken_as_it_is_written() -> None:
    made = channel()
    made.shown(Display(questions=(Question(5, "text", "which batch?"),)))
    made.put(OperatorOrder("answer", "Batch 7b", 5))
    assert made.take(1.0).answer(5) == "Batch 7b"
    for wrong in ("", "  ", "a\nb", 201 * "x"):
        with pytest.raises(InputError, match="a line of 1 to 200 letters"):
            made.put(OperatorOrder("answer", wrong, 5))


def test_an_answer_is_known_from_the_next_tick_on() -> None:
    made = channel()
    made.put(OperatorOrder("answer", "g0", 3))
    assert made.take(1.0).answer(3) == "g0"
    assert made.take(2.0).answer(3) == "g0"
    assert made.take(2.0).answer(4) is None


def test_statements_are_found_by_kind_and_time() -> None:
    made = channel()
    made.put(OperatorOrder("goal", "g1"))
    state = made.take(5.0)
    said = state.newest("goal", after_s=4.0)
    assert said is not None
    assert (said.value, said.time_s) == ("g1", 5.0)
    assert state.newest("goal", after_s=5.0) is None


def test_pause_resume_and_the_end_of_a_shift() -> None:
    made = channel()
    assert made.take(0.0).brackets == 4
    made.put(OperatorOrder("pause", "now"))
    assert made.take(1.0).pause == "now"
    made.put(OperatorOrder("pause", "after part"))
    assert made.take(2.0).pause == "after part"
    made.put(OperatorOrder("resume"))
    made.put(OperatorOrder("finish"))
    assert (made.take(3.0).pause, made.take(3.0).brackets) == ("none", 0)


def test_what_is_pressed_at_the_bench_counts_unless_it_makes_no_sense() -> None:
    made = channel()
    state = made.take(1.0, [OperatorOrder("answer", "g0", 9), OperatorOrder("answer", "g0", 3)])
    assert [order.question for order in state.said] == [3]


def test_memory_is_bounded() -> None:
    made = channel()
    for _ in range(WAITING):
        made.put(OperatorOrder("place", "o1"))
    with pytest.raises(InputError, match="too many"):
        made.put(OperatorOrder("place", "o1"))
    assert len(made.take(1.0).said) == KEPT


def test_an_acknowledgement_and_a_stop_reach_the_controller() -> None:
    rig = Rig()

    def act(tick: int) -> Status:
        if tick == 2:
            rig.operator.put(OperatorOrder("acknowledge"))
        if tick == 5:
            rig.operator.put(OperatorOrder("stop"))
        return Status.RUNNING

    outcome, _ = rig.run(act)
    assert (outcome.end, outcome.reason) == ("interrupted", "stopped by the operator")
    acknowledged = [record.observation.acknowledged for record in rig.observer.records]
    assert acknowledged.index(True) == 3
    assert sum(acknowledged) == 1


def test_a_pause_holds_the_arm_and_clears_by_itself() -> None:
    seen = Rig().controller.observe()
    supervisor = Supervisor((), {})
    paused = replace(seen, operator=replace(seen.operator, pause="now"))
    judgement = supervisor.judge(paused)
    assert (judgement.action, judgement.speed_scale) == (Action.HOLD, 0.0)
    assert judgement.words == "paused by the operator"
    assert supervisor.judge(seen).action is Action.RUN
    assert supervisor.judge(replace(seen, operator=replace(seen.operator, pause="after part"))).action is Action.RUN


@pytest.mark.parametrize("value", ["9", "101", "fast", "", "5.5"])
def test_a_speed_beyond_its_range_is_refused(value: str) -> None:
    with pytest.raises(InputError, match="a speed is 10 to 100 percent"):
        OperatorChannel().put(OperatorOrder("speed", value))


def test_a_slower_speed_takes_from_what_separation_allows_and_never_adds() -> None:
    made = OperatorChannel()
    made.put(OperatorOrder("speed", "50"))
    slow = replace(Observation(0, 0.0, STANDING, EMPTY_GRIPPER), operator=made.take(0.0))
    near = Fault(signal="hand_near", action="slow", clear="itself")

    def found(*_: object) -> FaultReport:
        return FaultReport("near", 0.3)

    assert Supervisor((), {}).judge(slow).speed_scale == 0.5
    assert Supervisor((near,), {"hand_near": found}).judge(slow).speed_scale == 0.3


@pytest.mark.parametrize(
    ("order", "why"),
    [
        (OperatorOrder("resume"), "nothing is paused"),
        (OperatorOrder("acknowledge"), "nothing waits to be acknowledged"),
        (OperatorOrder("place"), "no part is asked for"),
        (OperatorOrder("finish"), "this run makes one bracket"),
    ],
)
def test_who_presses_what_would_change_nothing_hears_why(order: OperatorOrder, why: str) -> None:
    with pytest.raises(InputError, match=why):
        OperatorChannel(shift=False).press(order)


def test_a_work_order_is_known_from_the_next_tick_on() -> None:
    made = OperatorChannel(("g0", "g1"))
    made.press(OperatorOrder("job", '{"id": "A", "variant": "g1", "amount": 2}'))
    assert made.take(0.0).job == WorkOrder("A", "g1", 2)
    with pytest.raises(InputError, match="variant is 'g7'; legal: g0, g1"):
        made.press(OperatorOrder("job", '{"variant": "g7"}'))
