"""The monitor, asked by clients: our own bytes, btview (a client from outside this project), BehaviorTree.CPP."""

from __future__ import annotations

import json
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar
from xml.etree import ElementTree

import msgspec
import pytest
import zmq
from btview.client import Groot2Client
from rich.console import Console

from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.viewing.door import GREETING_S
from bracket_cell.viewing.live_view import Keys, MonitorClient, Screen, view
from bracket_cell.viewing.monitor import Monitor
from bracket_cell.viewing.stepping import Stepper
from bracket_cell.viewing.tree_lines import Line
from bracket_cell.watching.observer import SentCommand, TickRecord
from bracket_cell.watching.why_now import Why
from bracket_ground.errors import InputError
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import Command
from btxml.engine.node import Node
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry
from btxml.views.groot2 import tree_xml
from tests import ROOT
from tests.cell.fakes import Rig

T = TypeVar("T")
HEADER = struct.Struct("<BBI")
TREE = (
    '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence name="job">'
    "<Script code=\"a := 3; text := 'x'\"/>"
    '<SubTree ID="Inner" name="first" p="{a}" q="7"/><Count steps="{a}"/></Sequence></BehaviorTree>'
    '<BehaviorTree ID="Inner"><Sequence><ScriptCondition code="p == 3 &amp;&amp; q == 7"/><Count steps="2"/>'
    "</Sequence></BehaviorTree></root>"
)
JOB, SCRIPT, INNER, CONDITION, FIRST, LAST = 1, 2, 3, 5, 6, 7


class Count(Node):
    """Count ticks."""

    steps = InputPort(int, "ticks until it succeeds")

    begun = 0
    ended = 0

    def initialise(self) -> None:
        self.begun += 1
        self._left = self.steps.get()

    def update(self) -> Status:
        self._left -= 1
        return Status.SUCCESS if self._left <= 0 else Status.RUNNING

    def terminate(self, new_status: Status) -> None:  # noqa: ARG002
        self.ended += 1


class Bench:
    """A monitored tree that is ticked by hand."""

    def __init__(self, path: Path, hooks: bool) -> None:
        self.port = free_port()
        self.tree: Tree = load_tree(path, Registry([Count]))
        self.tree.setup(None, ManualClock())
        self.monitor = Monitor(self.tree, Registry([Count]), self.port, hooks)
        self.observation = Rig().services.now.observation
        self._thread = ThreadPoolExecutor(1)

    def tick(self) -> Status:
        status = self.tree.tick()
        changes = tuple(self.tree.status_changes)
        self.monitor.tick(TickRecord(self.observation, status.name, changes, (), Command(), SentCommand(), 0.0, False))
        return status

    def ask(self, kind: str, body: bytes | None = None, protocol: int = 2) -> list[bytes]:
        frames = [HEADER.pack(protocol, ord(kind), 77)] + ([] if body is None else [body])
        return self.monitor.answer(frames)

    def served(self, request: Callable[[], T]) -> T:
        """What a client's blocking request gets while the monitor serves."""
        future: Future[T] = self._thread.submit(request)
        while not future.done():
            self.monitor.serve()
        return future.result()

    def statuses(self) -> dict[int, int]:
        return dict(struct.iter_unpack("<HB", self.ask("S")[1]))

    def close(self) -> None:
        self.monitor.abandon()
        self._thread.shutdown()


def free_port() -> int:
    """A port that is free together with the next one."""
    while True:
        with socket.socket() as one, socket.socket() as two:
            one.bind(("127.0.0.1", 0))
            port: int = one.getsockname()[1]
            try:
                two.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    benches: list[Bench] = []

    def make_bench(hooks: bool = False) -> Bench:
        path = tmp_path / "tree.xml"
        path.write_text(TREE)
        benches.append(Bench(path, hooks))
        return benches[-1]

    yield make_bench
    for bench in benches:
        bench.close()


def test_the_answer_repeats_the_header_and_names_the_tree(make: Callable[..., Bench]) -> None:
    bench = make()
    head, xml = bench.ask("T")
    assert head[:6] == HEADER.pack(2, ord("T"), 77)
    assert len(head) == 22
    assert bench.ask("S")[0][6:] == head[6:]
    root = ElementTree.fromstring(xml)
    uids = [
        int(element.get("_uid", 0))
        for tree in root.iter("BehaviorTree")
        for element in tree.iter()
        if element is not tree
    ]
    assert sorted(uids) == list(range(1, len(bench.tree.nodes) + 1))
    assert [tree.get("_fullpath") for tree in root.iter("BehaviorTree")] == ["", "first"]
    models = {model.get("ID") for model in root.find("TreeNodesModel") or ()}
    assert {"Count", "Sequence", "ScriptCondition"} <= models


def test_statuses_follow_the_ticks(make: Callable[..., Bench]) -> None:
    bench = make()
    assert set(bench.statuses().values()) == {0}
    bench.tick()
    running, success = 1, 2
    found = bench.statuses()
    assert (found[JOB], found[INNER], found[FIRST]) == (running, running, running)
    assert (found[SCRIPT], found[CONDITION], found[LAST]) == (success, success, 0)
    bench.tick()
    found = bench.statuses()
    assert (found[SCRIPT], found[INNER], found[LAST]) == (success, success, running)
    assert found[FIRST] == 10 + success  # idle again, and what it was before
    while bench.tick() is Status.RUNNING:
        pass
    assert bench.statuses()[JOB] == 10 + success


def test_a_remapped_entry_stands_only_in_the_outer_tree(make: Callable[..., Bench]) -> None:
    bench = make()
    bench.tick()
    assert msgspec.msgpack.decode(bench.ask("B", b"Main;first;nowhere")[1]) == {
        "Main": {"a": 3, "text": "x"},
        "first": {"q": 7},
    }


def test_a_text_that_cannot_be_sent_leaves_the_other_entries_be(make: Callable[..., Bench]) -> None:
    bench = make()
    bench.tick()
    bench.tree.blackboard.entry("half").value = "a \ud800"
    found = msgspec.msgpack.decode(bench.ask("B")[1])["Main"]
    assert found["half"] == "a ?"
    assert found["a"] == 3


def test_transitions_are_recorded_between_start_and_stop(make: Callable[..., Bench]) -> None:
    bench = make()
    assert bench.ask("t")[1] == b""
    assert bench.ask("r", b"start")[1].isdigit()
    bench.tick()
    bench.ask("r", b"stop")
    bench.tick()
    records = bench.ask("t")[1]
    assert len(records) % 9 == 0
    told = [struct.unpack("<HB", records[i + 6 : i + 9]) for i in range(0, len(records), 9)]
    assert told[0] == (JOB, 1)
    assert (SCRIPT, 2) in told
    assert LAST not in [uid for uid, _ in told]
    assert bench.ask("t")[1] == b""


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ([b""], b"0 bytes"),
        ([b"\x02S"], b"2 bytes"),
        ([HEADER.pack(3, ord("S"), 1)], b"not 3"),
        ([HEADER.pack(2, ord("?"), 1)], b"unknown request"),
        ([HEADER.pack(2, 255, 1)], b"unknown request"),
        ([HEADER.pack(2, ord("r"), 1), b"now"], b"start or stop"),
        ([HEADER.pack(2, ord("I"), 1), b"{}"], b"uid"),
        ([HEADER.pack(2, ord("I"), 1), b'{"uid": 99}'], b"no node 99"),
        ([HEADER.pack(2, ord("I"), 1), b"[" * 30_000], b"of another kind"),
        ([HEADER.pack(2, ord("R"), 1), b"\xff\xfe"], b"is no JSON"),
        ([HEADER.pack(2, ord("R"), 1), b'{"uid": 1, "position": 0}'], b"no hook"),
        ([HEADER.pack(2, ord("U"), 1), b'{"uid": 1}'], b"lacks position, desired_status"),
        ([HEADER.pack(2, ord("R"), 1), b"[]"], b"an object with fields"),
        ([HEADER.pack(2, ord("R"), 1), b'{"uid": 1e999, "position": 0}'], b"uid is inf"),
        ([HEADER.pack(2, ord("U"), 1), b'{"uid": 1e999, "position": 0}'], b"lacks desired_status"),
    ],
)
def test_a_malformed_request_gets_an_error(make: Callable[..., Bench], frames: list[bytes], words: bytes) -> None:
    bench = make(hooks=True)
    head, text = bench.monitor.answer(frames)
    assert head == b"error"
    assert words in text
    assert len(bench.ask("S")) == 2


@pytest.mark.parametrize("kind", list("IRUAXD"))
def test_hooks_are_refused_unless_asked_for(make: Callable[..., Bench], kind: str) -> None:
    head, text = make().ask(kind, b'{"uid": 6, "mode": 1, "desired_status": "FAILURE"}')
    assert head == b"error"
    assert b"--open breakpoints" in text


def test_a_replaced_node_is_not_ticked(make: Callable[..., Bench]) -> None:
    bench = make(hooks=True)
    first = bench.tree.nodes[FIRST - 1]
    assert isinstance(first, Count)
    order = {"uid": FIRST, "mode": 1, "once": True, "desired_status": "FAILURE", "position": 0}
    assert len(bench.ask("I", json.dumps(order).encode())) == 1
    assert json.loads(bench.ask("D")[1])[0]["uid"] == FIRST
    assert bench.tick() is Status.FAILURE
    assert first.begun == 0
    assert json.loads(bench.ask("D")[1]) == []
    assert bench.tick() is Status.RUNNING
    assert first.begun == 1


def test_hooks_rest_while_nobody_asks_and_act_again_with_the_next_request(
    make: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make(hooks=True)
    order = {"uid": FIRST, "mode": 1, "desired_status": "FAILURE", "position": 0}
    bench.ask("I", json.dumps(order).encode())
    monkeypatch.setattr("bracket_cell.viewing.monitor.HOOKS_REST_AFTER_S", -1.0)
    bench.monitor.serve()
    assert json.loads(bench.ask("D")[1])[0]["enabled"] is False
    assert bench.tick() is Status.RUNNING
    monkeypatch.undo()
    client = MonitorClient(bench.port)
    try:
        bench.served(client.statuses)
    finally:
        client.close()
    assert json.loads(bench.ask("D")[1])[0]["enabled"] is True


def test_a_breakpoint_waits_and_the_loop_goes_on(make: Callable[..., Bench]) -> None:
    bench = make(hooks=True)
    first = bench.tree.nodes[FIRST - 1]
    assert isinstance(first, Count)
    context = zmq.Context()
    news = context.socket(zmq.SUB)
    news.setsockopt(zmq.RCVTIMEO, 5000)
    news.subscribe(b"")
    news.connect(f"tcp://127.0.0.1:{bench.port + 1}")
    try:
        while not news.poll(10):  # a subscription takes a moment to arrive: reach the breakpoint until it is heard
            bench.tree.halt()
            bench.ask("I", json.dumps({"uid": FIRST, "position": 0}).encode())
            assert bench.tick() is Status.RUNNING
        head, body = news.recv_multipart()
        assert (len(head), head[1:2], body) == (HEADER.size, b"N", str(FIRST).encode())
        assert first.begun == 0
        unlock = {"uid": FIRST, "position": 0, "desired_status": "SKIPPED", "remove_when_done": True}
        assert len(bench.ask("U", json.dumps(unlock).encode())) == 1
        bench.tick()
        assert first.begun == 1
        bench.tree.halt()
        assert first.ended == 1
    finally:
        context.destroy(linger=0)


def test_a_client_from_outside_shows_the_tree(make: Callable[..., Bench]) -> None:
    bench = make()
    bench.tick()
    client: Any = Groot2Client(port=bench.port, timeout_ms=60_000)
    try:
        tree = bench.served(client.fetch_tree)
        shown = {node.uid: node.name for node in tree.walk()}
        assert shown == {node.uid: node.name for node in bench.tree.nodes}
        states = bench.served(client.poll).statuses
        assert {uid for uid, state in states.items() if state.status.name == "RUNNING"} == {JOB, INNER, 4, FIRST}
        assert bench.served(lambda: client.fetch_blackboard(["Main"])) == {"Main": {"a": 3, "text": "x"}}
    finally:
        client.close()


def test_the_terminal_view_names_every_node(make: Callable[..., Bench]) -> None:
    bench = make()
    bench.tick()
    client = MonitorClient(bench.port)
    try:
        shown = view(bench.served(client.tree), bench.served(client.statuses), bench.served(client.blackboards))
    finally:
        client.close()
    console = Console(file=StringIO(), width=100, record=True)
    console.print(shown)
    text = console.export_text()
    assert "▶ job" in text
    assert "✔ Script" in text
    assert "first  (Inner)" in text
    assert "▶ Count" in text
    assert "text" in text


def test_the_terminal_view_fits_any_window_and_keeps_what_runs() -> None:
    rounds = "".join(f'<Sequence name="done {n}"><AlwaysSuccess/><AlwaysSuccess/></Sequence>' for n in range(30))
    xml = ElementTree.fromstring(
        '<root><BehaviorTree ID="Main" _fullpath=""><Sequence name="job" _uid="1">'
        + rounds
        + '<Wait name="the one that runs" _uid="2"/>'
        + rounds
        + "</Sequence></BehaviorTree></root>"
    )
    said = {2: "waits for: screw"}
    for rows in (8, 12, 24, 50, 400):
        shown = view(xml, {1: 1, 2: 1}, {"Main": {f"e{n}": "x" * 200 for n in range(40)}}, said, (60, rows))
        console = Console(file=StringIO(), width=60, record=True)
        console.print(shown)
        text = console.export_text()
        assert "▶ the one that runs  (Wait)  waits for: screw" in text
        assert text.count("\n") <= rows
    assert "done 29" in text


def test_the_view_of_the_shipped_tree_names_its_running_leaf_on_24_rows() -> None:
    registry = node_registry()
    tree = load_tree(ROOT / "trees" / "assemble.xml", registry)
    leaf = next(node for node in tree.nodes if type(node).__name__ == "PlacePart")
    xml = ElementTree.fromstring(tree_xml(tree, registry))
    console = Console(file=StringIO(), width=80, record=True)
    console.print(view(xml, {leaf.uid: 1}, {}, {}, (80, 24)))
    text = console.export_text()
    assert "▶ PlacePart" in text
    assert text.count("\n") <= 24


def test_behaviortree_cpp_loads_what_is_served(make: Callable[..., Bench]) -> None:
    behaviortreepy = pytest.importorskip("behaviortreepy")
    factory = behaviortreepy.BehaviorTreeFactory()
    factory.register_simple_action("Count", lambda *_: behaviortreepy.NodeStatus.SUCCESS)
    xml = make().ask("T")[1].decode()
    factory.register_behavior_tree_from_text(xml)
    assert set(factory.registered_behavior_trees()) == {"Main", "Inner"}


def test_the_assembly_tree_is_served_whole() -> None:
    registry = node_registry()
    tree = load_tree(ROOT / "trees" / "assemble.xml", registry)
    monitor = Monitor(tree, registry, free_port())
    try:
        root = ElementTree.fromstring(monitor.answer([HEADER.pack(2, ord("T"), 1)])[1])
    finally:
        monitor.abandon()
    uids = [element.get("_uid") for element in root.iter() if element.get("_uid")]
    assert sorted(map(int, uids)) == list(range(1, len(tree.nodes) + 1))  # type: ignore[arg-type]


def test_a_port_in_use_is_bad_input(make: Callable[..., Bench]) -> None:
    bench = make()
    with pytest.raises(InputError, match="--open monitor=PORT"):
        Monitor(bench.tree, Registry([Count]), bench.port)


def test_several_hooks_may_come_in_one_request(make: Callable[..., Bench]) -> None:
    monitor = make(hooks=True).monitor
    hooks = b'[{"uid": 1, "mode": 1}, {"uid": 2, "mode": 1}]'
    assert monitor.answer([HEADER.pack(2, ord("I"), 1), hooks])[0] != b"error"
    dump = json.loads(monitor.answer([HEADER.pack(2, ord("D"), 1)])[1])
    assert [hook["uid"] for hook in dump] == [1, 2]
    assert monitor.answer([HEADER.pack(2, ord("I"), 1), b'[{"uid": 1}, {"uid": 0}]'])[0] == b"error"


def test_a_person_pauses_a_tree_and_lets_its_actions_begin_one_by_one(make: Callable[..., Bench]) -> None:
    bench = make(hooks=True)
    client = MonitorClient(bench.port)
    stepper = Stepper(bench.served(client.tree), lambda kind, body: bench.served(lambda: client.order(kind, body)))

    def ticked(key: str = "") -> dict[int, int]:
        said = bench.served(client.said)
        if key:
            stepper.press(key, said)
        stepper.keep(bench.statuses(), said)
        bench.tick()
        return bench.statuses()

    try:
        running = 1
        assert ticked("p")[CONDITION] == 0  # the script before it does not begin
        assert bench.served(client.said) == {SCRIPT: "waits at a breakpoint"}
        found = ticked("s")
        assert (found[SCRIPT], found[FIRST]) == (2, 0)  # the condition passes, the next action waits
        assert found[INNER] == running
        assert ticked()[FIRST] == 0
        assert ticked("s")[FIRST] == running
        assert ticked()[FIRST] == 10 + 2  # what was let begin runs to its end
        assert bench.statuses()[LAST] == 0
        assert ticked("p")[LAST] == running
        assert (stepper.paused, stepper.message) == (False, "goes on")
    finally:
        client.close()


def test_a_breakpoint_is_set_by_a_nodes_name_stays_and_is_taken_away_by_it(make: Callable[..., Bench]) -> None:
    bench = make(hooks=True)
    client = MonitorClient(bench.port)
    stepper = Stepper(bench.served(client.tree), lambda kind, body: bench.served(lambda: client.order(kind, body)))
    try:
        stepper.stop_at("Cuont")
        assert stepper.message == "there is no node 'Cuont'; near to it: Count"
        stepper.stop_at("count")
        assert {hook["uid"] for hook in json.loads(bench.ask("D")[1])} == {FIRST, LAST}
        bench.tick()
        said = bench.served(client.said)
        assert said[FIRST] == "waits at a breakpoint"
        stepper.press("s", said)
        assert stepper.message == "Count may begin"
        bench.tick()
        assert bench.statuses()[FIRST] == 1
        assert {hook["uid"] for hook in json.loads(bench.ask("D")[1])} == {FIRST, LAST}
        stepper.stop_at("Count")
        assert json.loads(bench.ask("D")[1]) == []
    finally:
        client.close()


def test_the_screen_shows_what_runs_scrolls_and_takes_a_name() -> None:
    screen = Screen()
    lines = [Line(0, "job", 1, 3, runs=True), Line(1, "Pick", 1, 0, runs=True, said="going down", place="Fetch")]
    lines += [Line(1, f"Idle{number}", 0, 0, runs=False) for number in range(30)]
    assert [row.plain for row in screen.rows(lines, 10)] == ["▶ Pick  going down  (Fetch)"]
    screen.press("t")
    assert len(screen.rows(lines, 10)) == 10
    screen.press("\x1b[6~")
    assert screen.rows(lines, 10)[0].plain.strip() == "○ Idle8"
    assert [screen.press(key) for key in ("b", *"Pq", "\x7f", "x", "\r")] == ["", "", "", "", "", "Px"]
    assert screen.typing is None


def test_a_monitor_tells_why_in_the_words_of_the_tree(make: Callable[..., Bench]) -> None:
    bench = make()
    client = MonitorClient(bench.port)
    try:
        bench.tick()
        assert bench.served(client.why) == str(bench.tree.why())
        assert "Count" in bench.served(client.why)
    finally:
        client.close()


@pytest.mark.long
@pytest.mark.parametrize("begun", [b"", b"\xff", b"\xff\0\0\0\0\0\0\0\x01\x7f", b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"])
def test_half_greetings_take_no_more_than_their_places(make: Callable[..., Bench], begun: bytes) -> None:
    bench = make()
    with ExitStack() as stack:
        ports = (bench.port, bench.port + 1)
        crowd = [stack.enter_context(socket.create_connection(("127.0.0.1", ports[n % 2]), 5)) for n in range(200)]
        for one in crowd:
            with suppress(ConnectionError):
                one.sendall(begun)
        client = MonitorClient(bench.port)
        stack.callback(client.close)
        assert bench.served(client.statuses) == bench.statuses()
        for one in crowd:
            one.settimeout(4 * GREETING_S)
            with suppress(ConnectionError):
                while one.recv(64):
                    pass


def test_a_flood_of_questions_holds_up_no_tick(make: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch) -> None:
    """A reason is found anew a few times a second, and what takes long is answered in a later tick."""
    bench, asked = make(), list[float]()

    def slow() -> Why:
        asked.append(time.monotonic())
        time.sleep(0.01)
        return Why()

    bench.tick()
    bench.monitor._why_now = slow  # type: ignore[assignment]
    assert len({bench.ask("w")[1] for _ in range(100)}) == 1
    assert len(asked) == 1
    answered = list[bytes]()

    def answer(request: list[bytes]) -> list[bytes]:
        answered.append(request[0])
        time.sleep(0.01)
        return [b""]

    monkeypatch.setattr(bench.monitor, "answer", answer)
    with ExitStack() as stack:
        context = zmq.Context()
        stack.callback(context.destroy, 0)
        for _ in range(10):
            client = stack.enter_context(context.socket(zmq.REQ))
            client.connect(f"tcp://127.0.0.1:{bench.port}")
            client.send(HEADER.pack(2, ord("w"), 1))
        until_s = time.monotonic() + 10
        while not answered and time.monotonic() < until_s:
            bench.monitor.serve()
        before = len(answered)
        time.sleep(0.3)
        bench.monitor.serve()
        assert len(answered) == before + 1


def test_a_view_waits_until_a_run_begins() -> None:
    client, waited = MonitorClient(free_port()), list[str]()
    try:
        with pytest.raises(InputError, match="nothing answers"):
            client.awaited(0.0, lambda: waited.append("told"))
        assert waited == []
    finally:
        client.close()


def test_who_leaves_takes_the_breakpoints_along(make: Callable[..., Bench]) -> None:
    bench = make(hooks=True)
    client = MonitorClient(bench.port)
    stepper = Stepper(bench.served(client.tree), lambda kind, body: bench.served(lambda: client.order(kind, body)))
    try:
        stepper.leave()
        stepper.press("p", {})
        stepper.keep(bench.statuses(), {})
        assert json.loads(bench.ask("D")[1])
        stepper.leave()
        assert json.loads(bench.ask("D")[1]) == []
    finally:
        client.close()


def test_breakpoints_of_a_view_that_was_killed_end_and_those_of_others_stay(
    make: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make(hooks=True)
    other = {"uid": LAST, "mode": 0, "desired_status": "SKIPPED", "position": 0}
    bench.ask("I", json.dumps(other).encode())
    client = MonitorClient(bench.port)
    stepper = Stepper(bench.served(client.tree), lambda kind, body: bench.served(lambda: client.order(kind, body)))
    try:
        bench.served(client.said)
        stepper.press("p", {})
        stepper.keep(bench.statuses(), {})
        assert len(json.loads(bench.ask("D")[1])) > 1
    finally:
        client.close()  # without a word
    monkeypatch.setattr("bracket_cell.viewing.monitor.HOOKS_REST_AFTER_S", -1.0)
    bench.monitor.serve()
    monkeypatch.undo()
    assert {hook["uid"] for hook in json.loads(bench.ask("D")[1])} == {LAST}
    again = MonitorClient(bench.port)
    try:
        bench.served(again.statuses)
    finally:
        again.close()
    assert [hook["enabled"] for hook in json.loads(bench.ask("D")[1])] == [True]


def test_only_nodes_that_are_asked_are_said_to_wait_at_a_breakpoint(make: Callable[..., Bench]) -> None:
    bench = make(hooks=True)
    bench.ask("I", json.dumps({"uid": FIRST}).encode())
    waiting = {FIRST: "waits at a breakpoint"}
    bench.tick()
    assert json.loads(bench.ask("F")[1]).items() >= {str(uid): text for uid, text in waiting.items()}.items()
    bench.tree.halt()
    bench.ask("I", json.dumps({"uid": SCRIPT}).encode())
    bench.tick()
    said = json.loads(bench.ask("F")[1])
    assert said[str(SCRIPT)] == waiting[FIRST]
    assert said.get(str(FIRST)) != waiting[FIRST]


def test_a_node_that_waits_at_a_breakpoint_is_marked_and_never_folded() -> None:
    rounds = "".join(f'<Sequence name="done {n}"><AlwaysSuccess/><AlwaysSuccess/></Sequence>' for n in range(30))
    step = '<Fallback name="held" _uid="3"><Wait name="step" _uid="2"/></Fallback>'
    xml = ElementTree.fromstring(
        f'<root><BehaviorTree ID="Main" _fullpath=""><Sequence name="job" _uid="1">{rounds}{step}{rounds}</Sequence>'
        "</BehaviorTree></root>"
    )
    console = Console(file=StringIO(), width=60, record=True)
    console.print(view(xml, {1: 1, 2: 2}, {}, {2: "waits at a breakpoint"}, (60, 12)))
    assert "‖ step  (Wait)  waits at a breakpoint" in console.export_text()


def test_a_client_asks_on_after_a_request_that_was_broken_off(make: Callable[..., Bench]) -> None:
    bench = make()
    client = MonitorClient(bench.port)
    try:
        client._socket.send_multipart([HEADER.pack(2, ord("S"), 1)])  # as where Ctrl-C comes before the answer
        assert bench.served(client.statuses) == bench.statuses()
    finally:
        client.close()


def test_steps_go_in_turn_to_all_that_wait() -> None:
    xml = ElementTree.fromstring(
        '<root><BehaviorTree ID="Main" _fullpath=""><Parallel _uid="1"><Look _uid="2"/><Move name="to park" _uid="3"/>'
        '</Parallel></BehaviorTree><TreeNodesModel><Action ID="Look"/><Action ID="Move"/></TreeNodesModel></root>'
    )
    sent: list[tuple[str, object]] = []
    stepper = Stepper(xml, lambda kind, body: sent.append((kind, json.loads(body))))
    stepper.press("p", {})
    stepper.keep({}, {})
    stepped = []
    for _ in range(4):
        said = {2: "waits at a breakpoint", 3: "waits at a breakpoint"}
        stepper.keep({}, said)
        stepper.press("s", said)
        stepped.append(stepper.message)
        said[2 if stepper.message.startswith("Look") else 3] = "works"
        stepper.keep({}, said)  # it begins, ends at once, and waits again
    assert stepped == ["Look may begin; next: to park", "to park may begin; next: Look"] * 2


def test_the_names_of_entries_are_shown_beside_long_values() -> None:
    xml = ElementTree.fromstring('<root><BehaviorTree ID="Main" _fullpath=""><Wait _uid="1"/></BehaviorTree></root>')
    console = Console(file=StringIO(), width=80, record=True)
    entries = {"Main": {"graph": "x" * 300}, "Help::27/Fetch::33/ClearAndGrasp::40/FindGraspable::51": {"tries": 3}}
    console.print(view(xml, {1: 1}, entries, {}, (80, 24)))
    text = console.export_text()
    assert "graph  xxx" in text
    assert "tries  3" in text
    assert "FindGraspable::51" in text


def test_a_pause_is_refused_where_hooks_are_off(make: Callable[..., Bench]) -> None:
    bench = make()
    client = MonitorClient(bench.port)
    stepper = Stepper(bench.served(client.tree), lambda kind, body: bench.served(lambda: client.order(kind, body)))
    try:
        stepper.press("p", {})
        stepper.keep(bench.statuses(), {})
        assert not stepper.paused
        assert "--open breakpoints turns them on" in stepper.message
        assert bench.tick() is Status.RUNNING
    finally:
        client.close()


def test_keys_come_from_a_terminal_and_nowhere_else() -> None:
    first, second = os.openpty()
    os.write(first, b"ps\n")
    assert Keys(second).pressed(1.0).startswith("ps")
    assert Keys(None).pressed(0.0) == ""
    os.close(first)
    os.close(second)
