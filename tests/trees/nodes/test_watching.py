"""From detector answers to the assembly graph."""

from __future__ import annotations

from dataclasses import replace

from bracket_cell.trees.nodes.watching import DetectAction, ReconcileGraph, SeenAction, UpdateGraph
from bracket_ground.interfaces.notes import ListJournal
from bracket_ground.interfaces.perception import Action, HoleView
from bracket_ground.interfaces.planning import AssemblyState
from btxml.engine.status import Status
from tests.trees.nodes.rig import EMPTY_HOLES, IDLE, see, services

PLACED = Action("assembly", 0.9, "o1", "p2", finished=True)


def test_each_answer_of_the_detector_counts_once() -> None:
    at = services()
    node = DetectAction("detect")
    node.setup(services=at)
    assert node.update() is Status.RUNNING
    see(at, 0.1)
    assert node.update() is Status.SUCCESS
    assert node.update() is Status.RUNNING


def test_an_action_that_goes_on_keeps_its_start() -> None:
    at = services()
    node = DetectAction("detect")
    node.setup(services=at)
    starts = []
    for time_s, kind in ((0.1, "idle"), (0.2, "screw"), (0.3, "screw"), (0.4, "idle"), (0.5, "screw")):
        see(at, time_s, action=Action(kind, 1.0))  # type: ignore[arg-type]
        node.update()
        starts.append(node.action.entry.value.started_s)  # type: ignore[union-attr]
    assert starts == [0.1, 0.2, 0.2, 0.4, 0.5]


def test_only_a_finished_assembly_action_sets_an_edge() -> None:
    at = services()
    for action, edges in (
        (IDLE, {}),
        (Action("assembly", 0.9, "o1", "p2", finished=False), {}),
        (PLACED, {"p2": "o1"}),
        (Action("assembly", 0.45, "o1", "p2", finished=True), {}),
        (Action("assembly", 0.9, "o2", "p2", finished=True), {"p2": "o1"}),
    ):
        node = UpdateGraph("update")
        node.setup(services=at)
        before = AssemblyState(edges if action.part == "o2" else {})
        node.state.entry.value = before  # type: ignore[union-attr]
        node.action.entry.value = SeenAction(action, 0.0)  # type: ignore[union-attr]
        assert node.update() is Status.SUCCESS
        assert dict(node.state.get().placed) == edges


def test_the_log_says_that_a_hole_told_the_placement_first() -> None:
    for action, shown in ((PLACED, None), (replace(PLACED, shown=True), True)):
        at = services()
        node = UpdateGraph("update")
        node.setup(services=at)
        node.state.entry.value = AssemblyState({})  # type: ignore[union-attr]
        node.action.entry.value = SeenAction(action, 0.0)  # type: ignore[union-attr]
        node.update()
        assert isinstance(at.tools.journal, ListJournal)
        (noted,) = (fields for topic, fields in at.tools.journal.notes if topic == "belief")
        assert (noted["source"], noted.get("shown")) == ("action", shown)


def test_the_doubt_of_an_action_stays_until_its_hole_shows_the_part() -> None:
    at = services()
    shares = {"o1": 0.7, "o2": 0.3}
    action = replace(PLACED, posterior={f"{part} at p2": share for part, share in shares.items()} | {"screw": 0.0})
    update, reconcile = UpdateGraph("update"), ReconcileGraph("reconcile")
    state, doubts = AssemblyState({}), []
    for node in (update, reconcile):
        node.setup(services=at)
    for number in range(3):
        see(
            at,
            float(number),
            holes=EMPTY_HOLES | ({"p2": HoleView("o1", 1.0, number)} if number == 2 else {}),
            action=action,
        )
        update.action.entry.value = SeenAction(action, 0.0)  # type: ignore[union-attr]
        for one in (update, reconcile):
            one.state.entry.value = state  # type: ignore[union-attr]
            one.update()
            state = one.state.get()
        doubts.append(dict(state.doubts))
    assert dict(state.placed) == {"p2": "o1"}
    assert doubts == [{"p2": shares}, {"p2": shares}, {}]


def test_the_graph_follows_what_holes_look_like_for_a_while() -> None:
    at = services()
    node = ReconcileGraph("reconcile")
    node.setup(services=at)
    node.state.entry.value = AssemblyState({"p1": "o3"})  # type: ignore[union-attr]
    for time_s in (0.0, 1.0, 2.0):
        holes = {**EMPTY_HOLES, "p1": HoleView(None, 1.0, time_s), "p4": HoleView("o2", 1.0, time_s)}
        see(at, time_s, holes=holes)
        node.update()
        settled = {"p4": "o2"} if time_s >= 1.5 else {"p1": "o3"}
        assert dict(node.state.get().placed) == settled


def contradiction(confidence: float, part: str | None) -> tuple[list[str], dict[str, str], str | None]:
    """A hole that shows something else than the action said: outcomes in the log, the graph at last, the question."""
    at = services()
    node = ReconcileGraph("reconcile")
    node.setup(services=at)
    node.state.entry.value = AssemblyState({"p2": "o1"})  # type: ignore[union-attr]
    asked = None
    for number in range(9):
        time_s = 0.5 * number
        holes = {**EMPTY_HOLES, "p2": HoleView(part, confidence, time_s)}
        see(at, time_s, holes=holes, action=PLACED if number == 0 else IDLE)
        node.update()
        asked = at.now.display.help_request or asked
    notes = [fields for topic, fields in at.tools.journal.notes if topic == "belief" and "contradiction" in fields]  # type: ignore[attr-defined]
    assert all(note["action"]["part"] == "o1" and note["hole"]["part"] == part for note in notes)
    return [note["outcome"] for note in notes], dict(node.state.get().placed), asked


def test_a_sure_hole_is_looked_at_again_and_then_believed_against_the_action() -> None:
    assert contradiction(0.97, "o2") == (["looked at again", "the hole is believed"], {"p2": "o2"}, None)
    assert contradiction(0.97, None) == (["looked at again", "the hole is believed"], {}, None)


def test_an_unsure_hole_that_contradicts_the_action_is_asked_about() -> None:
    outcomes, placed, asked = contradiction(0.7, "o2")
    assert outcomes == ["looked at again", "asked"]
    assert placed == {"p2": "o1"}  # unknown is no empty hole
    assert "p2" in (asked or "")
    assert "o1" in (asked or "")


def test_a_part_that_was_seen_in_its_hole_and_is_taken_away_contradicts_nobody() -> None:
    at = services()
    node = ReconcileGraph("reconcile")
    node.setup(services=at)
    node.state.entry.value = AssemblyState({"p2": "o1"})  # type: ignore[union-attr]
    for number in range(10):
        part = "o1" if number < 4 else None
        holes = {**EMPTY_HOLES, "p2": HoleView(part, 1.0, 0.5 * number)}
        see(at, 0.5 * number, holes=holes, action=PLACED if number == 0 else IDLE)
        node.update()
    assert not node.state.get().placed
    assert not [fields for _, fields in at.tools.journal.notes if "contradiction" in fields]  # type: ignore[attr-defined]


def test_a_hole_that_is_covered_changes_nothing() -> None:
    at = services()
    node = ReconcileGraph("reconcile")
    node.setup(services=at)
    node.state.entry.value = AssemblyState({})  # type: ignore[union-attr]
    for time_s in (0.0, 1.0, 2.0, 3.0):
        see(at, time_s, holes={**EMPTY_HOLES, "p4": HoleView("o2", 1.0, seen_s=0.0)})
        node.update()
    assert not node.state.get().placed


def test_what_a_person_exchanges_is_remembered_and_told_in_the_log_where_its_hole_had_shown_it() -> None:
    at = services()
    node = ReconcileGraph("reconcile")
    node.setup(services=at)
    node.state.entry.value = AssemblyState({"p2": "o1", "p3": "o2"})  # type: ignore[union-attr]
    for number in range(16):
        part = "o1" if number < 4 else None if number < 8 else "o3"
        holes = {**EMPTY_HOLES, "p2": HoleView(part, 1.0, 0.5 * number), "p3": HoleView(None, 1.0, 0.5 * number)}
        see(at, 0.5 * number, holes=holes, action=replace(PLACED, part="o2", position="p3") if number == 0 else IDLE)
        node.update()
    state = node.state.get()
    assert (state.placed, state.replaced) == ({"p2": "o3"}, {"p2": "o1"}), "nobody ever saw a part in p3"
    assert isinstance(at.tools.journal, ListJournal)
    told = [
        fields["replaced"] for topic, fields in at.tools.journal.notes if topic == "belief" and "replaced" in fields
    ]
    assert told == [{"p2": "o1"}]
