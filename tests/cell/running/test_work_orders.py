"""Work orders: what a queue takes, what it refuses and where, and what it does to a belief."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bracket_cell.production.book import Book, RunRow
from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.running.work_orders import LOOK_S, WorkOrders
from bracket_cell.watching.observer import SentCommand, TickRecord
from bracket_ground.errors import InputError
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.notes import Topic
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from tests.trees.nodes.rig import EMPTY_GRIPPER, PRODUCT, STANDING

GOALS = {goal: PRODUCT.goal_title(goal) for goal in PRODUCT.goals}
Note = tuple[Topic, dict[str, object]]


def written(path: Path, *lines: object) -> Path:
    """A file with these lines more."""
    with path.open("a", encoding="utf-8") as file:
        file.writelines((line if isinstance(line, str) else json.dumps(line)) + "\n" for line in lines)
    return path


def test_the_next_order_is_the_one_that_is_due_first(tmp_path: Path) -> None:
    path = written(
        tmp_path / "orders.jsonl", {"variant": "g0"}, {"id": "B", "variant": "g1", "due": "2026-01-02T08:00"}
    )
    assert [order.id for order in WorkOrders(GOALS, path).open(0.0)] == ["B", "1"]


def test_a_file_may_grow_change_and_cancel_and_that_is_told(tmp_path: Path) -> None:
    path = written(tmp_path / "orders.jsonl", {"id": "A", "variant": "g0"}, {"id": "B", "variant": "g1"})
    orders = WorkOrders(GOALS, path)
    assert orders.news == []
    orders.open(0.0)
    written(path, {"id": "A", "amount": 3}, {"id": "B", "cancelled": True}, {"id": "C", "variant": "nine"})
    assert [order.amount for order in orders.open(LOOK_S / 2)] == [1, 1], "it is looked at now and then"
    assert [(order.id, order.amount) for order in orders.open(LOOK_S)] == [("A", 3)]
    assert orders.news[:2] == [f"work order A was changed: 3 of {GOALS['g0']}", "work order B was cancelled"]
    assert f"{path}:5: this is no work order: variant is 'nine'; legal: g0 ({GOALS['g0']}), g1" in orders.news[2]


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("{", "it is no JSON from character 2 on, where nothing stands; a line is an order, as {"),
        ("id;variant;amount", """it is no JSON from character 1 on, where 'id;varian' stands; a line is an order"""),
        ('{"variant": "g0"},\r', "it is no JSON from character 18 on, where ',' stands"),
        ('{"id": "A", "variant": "g0", "id": "B"}', "it has a key twice"),
        ({"variant": "g0", "due": 20261126140000}, 'due is 20261126140000, not text, as "2026-11-26T14:00"'),
        ({"id": 1234567890123, "variant": "g0"}, 'id is 1234567890123, not text, as "A17"'),
        ([], "keys id, variant, amount, due, cancelled"),
        ({"variant": "g0", "amuont": 2}, "no key 'amuont'; legal: id, variant, amount, due, cancelled"),
        ({"variant": "g0", "amount": True}, "amount is true, not a whole number"),
        ({"variant": "g0", "amount": 0}, "legal: 1 to 100000"),
        ({"variant": "g0", "due": "soon"}, "write it as 2026-11-26T14:00"),
        ({"id": "", "variant": "g0"}, "it has 1 to 60 letters"),
        ({"amount": 2}, "variant is ''; legal: g0"),
        ({"variant": "g0", "due": None}, "due is null, not text"),
        ("9" * 5000, "it is an object with the keys"),
        ('{"variant": "g0"', "it is no JSON from character 17 on, where nothing stands"),
    ],
)
def test_a_line_that_is_no_order_is_told_with_its_place(tmp_path: Path, line: object, what: str) -> None:
    path = written(tmp_path / "orders.jsonl", {"variant": "g0"}, line)
    with pytest.raises(InputError) as told:
        WorkOrders(GOALS, path)
    assert str(told.value).startswith(f"{path}:2: this is no work order: ")
    assert what in str(told.value)


def test_of_many_lines_that_are_no_orders_the_first_are_told(tmp_path: Path) -> None:
    path = written(tmp_path / "orders.jsonl", {"id": "A", "variant": "g0"}, *["none"] * 300)
    with pytest.raises(InputError) as refused:
        WorkOrders(GOALS, path)
    assert str(refused.value).count("this is no work order") == 20
    assert str(refused.value).count("a line is an order, as {") == 1
    assert f"{path}:22: lines from here on were not read" in str(refused.value)
    queue = WorkOrders(GOALS, written(tmp_path / "grows.jsonl", {"id": "A", "variant": "g0"}))
    queue.open(0.0)
    written(tmp_path / "grows.jsonl", *["none"] * 300)
    queue.open(LOOK_S)
    assert len(queue.news) == 21


def test_a_line_that_is_edited_changes_its_order_and_the_others_stay(tmp_path: Path) -> None:
    path = written(tmp_path / "orders.jsonl", {"id": "A", "variant": "g0", "amount": 3}, {"variant": "g1"})
    orders = WorkOrders(GOALS, path)
    orders.open(0.0)
    path.write_text(path.read_text().replace('"amount": 3', '"amount": 5'))
    assert [(order.id, order.amount) for order in orders.open(LOOK_S)] == [("A", 5), ("1", 1)]
    path.write_text("")  # as an editor leaves it for a moment
    orders.open(2 * LOOK_S)
    written(path, {"id": "B", "variant": "g2"}, {"id": "A", "variant": "g0", "amount": 5}, {"variant": "g1"})
    assert [order.id for order in orders.open(3 * LOOK_S)] == ["A", "1", "B"]


def test_a_file_that_goes_away_is_told_once_and_its_orders_stay(tmp_path: Path) -> None:
    path = written(tmp_path / "orders.jsonl", {"id": "A", "variant": "g0"})
    orders = WorkOrders(GOALS, path)
    path.unlink()
    assert [[order.id for order in orders.open(number * LOOK_S)] for number in range(3)] == [["A"]] * 3
    assert orders.news == [f"{path}: cannot be read: No such file or directory; the orders that are known stay"]


def test_the_file_of_a_cell_with_a_book_names_its_orders_as_every_run_reads_it(tmp_path: Path) -> None:
    path, book = written(tmp_path / "orders.jsonl", {"id": "A", "variant": "g0"}), Book(tmp_path / "book.sqlite")
    for _ in range(2):
        assert [order.id for order in WorkOrders(GOALS, path, book).open(0.0)] == ["A"]
    with pytest.raises(InputError, match=r"orders.jsonl:2: this is no work order: id is missing"):
        WorkOrders(GOALS, written(path, {"variant": "g1"}), book)


def test_a_file_of_an_editor_that_marks_utf_8_is_read(tmp_path: Path) -> None:
    path = tmp_path / "orders.jsonl"
    path.write_text('{"variant": "g1"}\r\n', encoding="utf-8-sig")
    assert [order.variant for order in WorkOrders(GOALS, path).open(0.0)] == ["g1"]


def test_times_in_any_writing_are_told_apart(tmp_path: Path) -> None:
    dues = {"a": "2026-11-26 14:00", "b": "20261125T1400", "c": "2026-11-24T14:00:30+00:00", "d": "2026-11-26T13:59"}
    path = written(
        tmp_path / "orders.jsonl", *({"id": name, "variant": "g0", "due": due} for name, due in dues.items())
    )
    found = WorkOrders(GOALS, path).open(0.0)
    assert [order.id for order in found] == ["c", "b", "d", "a"]
    assert {len(order.due) for order in found} == {len("2026-11-26T14:00")}


def test_a_file_that_is_missing_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        WorkOrders(GOALS, tmp_path / "none.jsonl")


def test_a_finished_bracket_counts_once_for_its_order() -> None:
    keeper = Bookkeeper(Book(), RunRow(""))
    orders = WorkOrders(GOALS, book=keeper.book)
    orders.put('{"id": "A", "variant": "g0", "amount": 2}')
    begin: Note = ("bracket", {"number": 1, "edge": "begin", "order": "A"})
    end: Note = ("bracket", {"number": 1, "edge": "end", "finished": True, "goal": "g0", "order": "A"})
    taken: Note = ("bracket", {"number": 2, "edge": "end", "finished": False, "goal": None})
    seen = Observation(0, 0.0, STANDING, EMPTY_GRIPPER)
    keeper.tick(TickRecord(seen, "RUNNING", (), (begin, end, taken), Command(), SentCommand(), 0.001, False))
    assert [(order.id, order.done) for order in orders.open(0.0)] == [("A", 1)]


def test_a_later_run_goes_on_with_the_orders_of_its_book() -> None:
    keeper = Bookkeeper(Book(), RunRow(""))
    WorkOrders(GOALS, book=keeper.book).put(json.dumps({"id": "A", "variant": GOALS["g1"], "amount": 2}))
    later = WorkOrders(GOALS, book=keeper.book)
    assert [(order.id, order.variant, order.done) for order in later.open(0.0)] == [("A", "g1", 0)]
    later.put('{"id": "A", "cancelled": true}')
    assert later.open(0.0) == ()


def plan_of(belief: dict[str, float], state: AssemblyState) -> AssemblyPlan:
    """A plan that follows from a belief as those of planners do."""
    nexts: dict[tuple[str, str], float] = {}
    for goal in GOALS:
        for position, part in PRODUCT.goal_placements(goal).items():
            if position not in state.placed:
                nexts[part, position] = nexts.get((part, position), 0.0) + belief[goal]
    return AssemblyPlan(belief, nexts, "o1", {})


EVEN = {"g0": 0.33, "g1": 0.33, "g2": 0.32, UNKNOWN_GOAL: 0.02}


def test_before_anything_is_placed_the_order_is_believed() -> None:
    state = AssemblyState({})
    plan = plan_of(EVEN, state).expecting("g1", PRODUCT, state)
    assert plan.goal == "g1"
    assert plan.goal_belief["g1"] > 0.9
    assert sum(plan.goal_belief.values()) == pytest.approx(1.0)
    wanted = PRODUCT.goal_placements("g1")
    assert {position: part for part, to in plan.guidance.items() for position in to} == wanted
    assert all(plan.next_belief[part, position] > 0.9 for position, part in wanted.items())


def test_what_is_placed_decides_against_the_order() -> None:
    state = AssemblyState({"p1": "o1", "p2": "o1", "p3": "o1"})
    plan = plan_of({"g0": 0.995, "g1": 1e-6, "g2": 0.003, UNKNOWN_GOAL: 0.002}, state).expecting("g1", PRODUCT, state)
    assert plan.goal == "g0"
    assert plan.goal_belief["g1"] < 0.01


def test_what_a_person_said_stands_above_the_order() -> None:
    state = AssemblyState({}, told_goal="g0")
    told = plan_of({"g0": 1.0, "g1": 0.0, "g2": 0.0, UNKNOWN_GOAL: 0.0}, state)
    assert told.expecting("g1", PRODUCT, state) is told
