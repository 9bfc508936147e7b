"""Leaves that ask beyond the cell: they wait in a thread, can be cancelled, and a replay asks nobody."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest

from bracket_cell import load_cell, replay, run
from bracket_cell.trees.nodes.http_request import HttpRequest
from bracket_ground.interfaces.clock import ManualClock
from btxml.engine import outside
from btxml.engine.outside import CALLS_AT_ONCE, LoggedAnswers, Outside, when_cancelled
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from tests.trees.conftest import Load
from tests.trees.engine.test_py_trees import Kept

PATIENCE_S = 20.0
PORTS = ("y", -1, 99999)
NO_ADDRESS = ("", "ftp://a/", "http://[::1/", "http:///x", "http://a b/", *(f"http://x:{port}/" for port in PORTS))
LONG = f"http://{'a' * 70}.com/"


class Doubles(Outside):
    """Doubles a number, somewhere else."""

    number = InputPort(int, "what is doubled")
    result = OutputPort(int, "twice as much")
    asked: ClassVar[list[int]] = []
    may_go_on: ClassVar[threading.Event]
    cancelled: ClassVar[threading.Event]

    def question(self) -> Any:
        return self.number.get()

    def ask(self, question: Any) -> Any:
        self.asked.append(question)
        when_cancelled(self.cancelled.set)
        assert self.may_go_on.wait(PATIENCE_S)
        if question < 0:
            raise ValueError("too small")
        return object() if question == 0 else 2 * question


@pytest.fixture(autouse=True)
def _fresh() -> None:
    Doubles.asked.clear()
    Doubles.may_go_on, Doubles.cancelled = threading.Event(), threading.Event()


def until(tree: Tree, done: Callable[[], object] = lambda: True) -> Status:
    """Tick until something is so and the tree has ended, or for long enough."""
    status, clock = Status.RUNNING, ManualClock()
    for _ in range(100_000):
        status = tree.tick()
        if status is not Status.RUNNING and done():
            break
        threading.Event().wait(0.001)
        clock.sleep_until(clock.now_s() + 0.04)
    return status


def test_an_answer_is_taken_in_a_tick_and_noted(load: Load) -> None:
    to = Kept()
    tree = load('<Doubles number="4" result="{twice}"/>', Doubles, services=to)
    assert [tree.tick(), tree.tick()] == [Status.RUNNING] * 2
    Doubles.may_go_on.set()
    assert until(tree) is Status.SUCCESS
    assert tree.blackboard.entry("twice").value == 8
    ((topic, note),) = to.journal.take()
    assert (topic, note["question"], note["answer"]) == ("outside", "4", "8")
    assert isinstance(note["polls"], int)
    assert note["polls"] > 2


@pytest.mark.parametrize(("number", "told"), [(-1, "ValueError: too small"), (0, "object is no plain data")])
def test_what_goes_wrong_is_a_failure_and_an_entry(load: Load, number: int, told: str) -> None:
    tree = load(f'<Doubles number="{number}" error="{{why}}"/>', Doubles, services=Kept())
    Doubles.may_go_on.set()
    assert until(tree) is Status.FAILURE
    assert told in tree.blackboard.entry("why").value
    assert told in tree.nodes[0].feedback_message


def test_a_halt_and_the_limit_cancel_the_call(load: Load) -> None:
    to = Kept()
    tree = load('<Doubles number="4"/>', Doubles, services=to)
    while not Doubles.asked:
        tree.tick()
    tree.halt()
    assert Doubles.cancelled.wait(PATIENCE_S)
    assert [note.get("cancelled") for _, note in to.journal.take()] == [True]
    tree = load('<Doubles number="4" limit_s="0.01"/>', Doubles, services=to)
    assert until(tree) is Status.FAILURE
    assert "no answer within 0.01 s" in tree.nodes[0].feedback_message
    Doubles.may_go_on.set()


def test_who_finds_no_thread_free_waits(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(outside._free, "Doubles", threading.BoundedSemaphore(1))
    tree = load('<ParallelAll><Doubles number="1"/><Doubles number="2"/></ParallelAll>', Doubles)
    tree.tick()
    tree.tick()
    assert Doubles.asked in ([], [1])
    Doubles.may_go_on.set()
    assert until(tree) is Status.SUCCESS
    assert Doubles.asked == [1, 2]


class Hangs(Outside):
    """Asks a driver that does not come back, and that no cancelling ends."""

    def ask(self, question: Any) -> Any:  # noqa: ARG002
        Doubles.may_go_on.wait(PATIENCE_S)


def test_calls_that_do_not_come_back_starve_no_other_class(load: Load) -> None:
    hang = f"<ParallelAll>{'<Hangs/>' * CALLS_AT_ONCE}</ParallelAll>"
    load(hang, Hangs).tick()
    late = load('<Hangs limit_s="0.01"/>', Hangs)
    assert until(late) is Status.FAILURE
    assert late.nodes[0].feedback_message == "nobody was asked within 0.01 s: 16 earlier calls of Hangs do not end"
    other = load('<Doubles number="4"/>', Doubles)
    while not Doubles.asked:
        assert other.tick() is Status.RUNNING
    Doubles.may_go_on.set()
    assert until(other) is Status.SUCCESS


@pytest.mark.parametrize(
    ("body", "sent"), [('json:{"part": "o1"}', '{"part": "o1"}'), ("json:{}", "{}"), ("a b", "a b")]
)
def test_a_body_of_json_is_written_with_its_word(load: Load, body: str, sent: str) -> None:
    tree = load(f"<HttpRequest url='http://127.0.0.1:9/' body='{body}'/>", HttpRequest)
    node = tree.nodes[0]
    assert isinstance(node, HttpRequest)
    assert node.question()["body"] == sent


def told(to: Kept) -> list[Mapping[str, Any]]:
    return [dict(fields) for _, fields in to.journal.take()]


def test_a_replay_asks_nobody_and_a_changed_tree_has_the_same_answers(load: Load) -> None:
    to = Kept()
    body = '<Sequence><Doubles number="4" result="{a}"/><Doubles number="5" result="{b}"/></Sequence>'
    tree = load(body, Doubles, services=to)
    Doubles.may_go_on.set()
    until(tree)
    notes = told(to)
    Doubles.asked.clear()
    again = Kept(LoggedAnswers(notes))
    tree = load(body, Doubles, services=again)
    polls = sum(note["polls"] for note in notes) - 1
    assert [tree.tick() for _ in range(polls)] == [Status.RUNNING] * (polls - 1) + [Status.SUCCESS]
    assert told(again) == notes
    other = load('<Sequence><Doubles number="5" result="{b}"/><Doubles number="6"/></Sequence>', Doubles)
    other.setup(Kept(LoggedAnswers(notes)), ManualClock())
    assert until(other) is Status.FAILURE
    assert "the log has no answer to 6" in other.nodes[2].feedback_message
    assert other.blackboard.entry("b").value == 10
    assert Doubles.asked == []


class Warehouse(BaseHTTPRequestHandler):
    """Books parts, and counts."""

    booked: ClassVar[list[bytes]] = []

    def do_POST(self) -> None:
        self.booked.append(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(200 if self.path == "/book" else 404)
        self.end_headers()
        self.wfile.write(b"5 left")

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def warehouse() -> Iterator[str]:
    Warehouse.booked.clear()
    with ThreadingHTTPServer(("127.0.0.1", 0), Warehouse) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_server_is_asked(load: Load, warehouse: str) -> None:
    ports = 'method="POST" body="o1" status_code="{status}" result="{text}" error="{why}"'
    tree = load(f'<HttpRequest url="{warehouse}/book" {ports}/>', HttpRequest)
    assert until(tree) is Status.SUCCESS
    assert tree.blackboard.values() == {"status": 200, "text": "5 left", "why": ""}
    tree = load(f'<HttpRequest url="{warehouse}/nowhere" {ports}/>', HttpRequest)
    assert until(tree) is Status.FAILURE
    assert tree.blackboard.values()["why"] == "the server answered with status 404"
    tree = load(f'<HttpRequest url="{warehouse}/zwölf Stück?x=ö" {ports}/>', HttpRequest)
    assert until(tree) is Status.FAILURE
    assert tree.blackboard.values()["why"] == "the server answered with status 404"
    assert Warehouse.booked == [b"o1", b"o1", b"o1"]


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("http://127.0.0.1:9/", "http://127.0.0.1:9/: Connection refused"),
        *((url, f"'{url}' is no address; legal: http:// or https://, a host, :port, /path") for url in NO_ADDRESS),
        (LONG, f"{LONG} names no host that there can be"),
    ],
)
def test_a_server_that_is_not_there_is_a_failure(load: Load, url: str, why: str) -> None:
    tree = load(f'<HttpRequest url="{url}"/>', HttpRequest)
    assert until(tree) is Status.FAILURE
    assert tree.nodes[0].feedback_message == why


@pytest.mark.parametrize("replays", [2, pytest.param(10, marks=pytest.mark.slow)])
def test_a_run_and_its_replays_make_one_request(tmp_path: Path, warehouse: str, replays: int) -> None:
    tree = tmp_path / "book.xml"
    asks = f'<HttpRequest url="{warehouse}/book" method="POST" body="o1" result="{{left}}"/>'
    body = f"<Sequence>{asks}<ScriptCondition code=\"left == '5 left'\"/></Sequence>"
    tree.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Book">{body}</BehaviorTree></root>')
    done = run(load_cell("config/cell.yaml"), tree=tree, log=tmp_path / "run.mcap", goal="g0", seed=3)
    assert done.summary["finished"]
    assert [list(replay(tmp_path / "run.mcap")) for _ in range(replays)] == [[]] * replays
    assert Warehouse.booked == [b"o1"]
