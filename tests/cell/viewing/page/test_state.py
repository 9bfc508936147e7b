"""What the operator's page shows, without a server."""

from __future__ import annotations

from dataclasses import replace

from bracket_cell.production.book import Book, RunRow
from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.production.samples import Samples
from bracket_cell.running.observers import Announcer
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.viewing.page.state import PageState
from bracket_cell.watching.observer import SentCommand, TickRecord
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.observation import Observation
from tests import ROOT
from tests.cell.viewing.page.rig import MODEL
from tests.trees.nodes.rig import EMPTY_GRIPPER, PRODUCT, STANDING

HELD = SafetyDecision(Action.HOLD, 0.0, (("arm_off_path", "a joint is 0.030 rad off its path"),), ("arm_off_path",))


def test_an_alarm_says_when_it_waits_for_somebody_to_acknowledge_it_and_until_then() -> None:
    tree = load_tree(ROOT / "trees" / "shift.xml", node_registry(PRODUCT))
    state, announcer = PageState(MODEL, {}, tree, Bookkeeper(Book(), RunRow(""))), Announcer()
    shown = []
    for number, (judgement, unacknowledged, acknowledged) in enumerate(
        (
            (HELD, False, False),
            (HELD, True, False),
            (HELD, True, False),
            (HELD, False, True),
            (HELD, True, False),  # it was off its path again for long
            (SafetyDecision(), False, False),
            (HELD, False, False),
        )
    ):
        if (news := announcer.news(judgement, 0.04 * number, unacknowledged)) is not None:
            state.say(0.0, *news)
        seen = replace(Observation(number, 0.04 * number, STANDING, EMPTY_GRIPPER), acknowledged=acknowledged)
        record = TickRecord(
            seen, "RUNNING", (), (), Command(), SentCommand(), 0.001, False, None, judgement, 0.0, unacknowledged
        )
        state.take(record)
        told = state.now(record)
        assert len(told["alarms"]) <= 1, "the sentence says that it waits"
        shown.append(told["asks"])
    assert shown == [False, True, True, False, True, False, False]


def test_the_safety_mode_of_the_arm_is_on_the_page_and_among_the_numbers() -> None:
    tree = load_tree(ROOT / "trees" / "shift.xml", node_registry(PRODUCT))
    book = Book()
    keeper = Bookkeeper(book, RunRow(""))
    state = PageState(MODEL, {}, tree, keeper)
    arm = replace(STANDING, mode="safeguard_stop", reason="the controller is in tp three position enabling stop")
    seen = Observation(0, 0.0, arm, EMPTY_GRIPPER)
    record = TickRecord(seen, "RUNNING", (), (), Command(), SentCommand(), 0.001, False, None, HELD, 0.0, False)
    state.take(record)
    keeper.tick(record)
    assert state.now(record)["robot"]["safety"] == [arm.mode, arm.reason]
    told = {labels["mode"]: value for name, labels, value in Samples(book, keeper)() if name == "cell_arm_safety"}
    assert (told["safeguard_stop"], sum(told.values())) == (1.0, 1.0)
    assert {"normal", "reduced", "emergency_stop"} < set(told)
