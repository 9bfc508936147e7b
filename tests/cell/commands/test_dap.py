"""An editor's debugger: breakpoints by line in a tree that runs, over the wire that editors speak."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BytesIO, FileIO
from itertools import product
from pathlib import Path
from queue import SimpleQueue
from subprocess import PIPE, Popen
from typing import IO, Any

import pytest

from bracket_cell.commands.dap import Adapter
from bracket_cell.commands.main import main
from bracket_cell.trees.loading import load_tree
from bracket_cell.viewing.monitor import Monitor
from bracket_cell.watching.observer import SentCommand, TickRecord
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import Command
from btxml.engine.node import Node
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.files.compile.registry import Registry
from tests.cell.fakes import Rig
from tests.cell.viewing.test_monitor import free_port

TREE = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence>
      <Script code="wait := 3"/>
      <!-- nothing stands here -->
      <SubTree ID="Pick" ticks="{wait}"/>
      <Work name="last" ticks="2"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Pick">
    <Work ticks="{ticks}"/>
  </BehaviorTree>
</root>
"""
SCRIPT, SUBTREE, LAST, PICK = 4, 6, 7, 11  # lines
LONG_S = 20.0


class Work(Node):
    """Run for some ticks."""

    ticks = InputPort(int, "how many")

    def initialise(self) -> None:
        self._left = self.ticks.get()

    def update(self) -> Status:
        self._left -= 1
        return Status.RUNNING if self._left else Status.SUCCESS


class Editor:
    """What an editor says, and hears."""

    def __init__(self, sink: IO[bytes], source: IO[bytes]) -> None:
        self._sink, self._source, self._asked = sink, source, 0
        self._inbox: SimpleQueue[dict[str, Any]] = SimpleQueue()
        self.events: list[dict[str, Any]] = []
        threading.Thread(target=self._listen, daemon=True).start()

    def ask(self, command: str, **arguments: Any) -> dict[str, Any]:
        """The answer's body.

        Raises:
            LookupError: it was refused, with these words.
        """
        self._asked += 1
        body = json.dumps({"seq": self._asked, "type": "request", "command": command, "arguments": arguments}).encode()
        self._sink.write(b"Content-Length: %d\r\n\r\n%b" % (len(body), body))
        self._sink.flush()
        while (told := self._inbox.get(timeout=LONG_S))["type"] == "event":
            self.events.append(told)
        assert told["request_seq"] == self._asked
        if not told["success"]:
            raise LookupError(told["message"])
        found: dict[str, Any] = told["body"]
        return found

    def hear(self, name: str) -> dict[str, Any]:
        """The next event of this name."""
        while not (found := [event for event in self.events if event["event"] == name]):
            self.events.append(self._inbox.get(timeout=LONG_S))
        self.events.remove(found[0])
        body: dict[str, Any] = found[0]["body"]
        return body

    def _listen(self) -> None:
        while head := self._source.readline():
            self._source.readline()
            self._inbox.put(json.loads(self._source.read(int(head.split(b":")[1]))))


@contextmanager
def adapted() -> Iterator[Editor]:
    """An editor with an adapter in this process."""
    (asks_end, asks), (answers_end, answers) = os.pipe(), os.pipe()
    with (  # closed from the last on: each reader finds its end
        os.fdopen(answers_end, "rb") as source,
        FileIO(asks_end) as heard,
        os.fdopen(asks, "wb") as sink,
        os.fdopen(answers, "wb") as told,
    ):
        adapter = Adapter(heard, told)
        thread = threading.Thread(target=adapter.serve)
        thread.start()
        editor = Editor(sink, source)
        try:
            yield editor
        finally:
            editor.ask("disconnect")
            thread.join(LONG_S)
            assert not thread.is_alive()
            sink.close()
            for listener in [one for one in threading.enumerate() if one.name == "debugger's request"]:
                listener.join(LONG_S)


def framed(body: bytes, length: int | None = None) -> bytes:
    return b"Content-Length: %d\r\n\r\n%b" % (len(body) if length is None else length, body)


@pytest.mark.parametrize(
    "said",
    [
        framed(b"{x}"), b"Content-Length: much\r\n\r\n", b"\xff\n", framed(b"{}", -5), framed(b"{}", 10**14),
        framed(b"{}", 10**23), framed(b"[" * 200_000), framed(b"[1]"), framed(b"7"), framed(b"null"), framed(b"{}"),
        framed(b"\xff{}"), b"x" * 3_000_000,
    ],
    ids=lambda said: repr(said[:45]),
)  # fmt: skip
def test_an_editor_that_says_something_else_is_left(said: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    asks_end, asks = os.pipe()
    with FileIO(asks_end) as heard, BytesIO() as told, os.fdopen(asks, "wb") as sink:
        thread = threading.Thread(target=Adapter(heard, told).serve)
        thread.start()
        sink.write(said)
        sink.close()
        thread.join(LONG_S)
        assert not thread.is_alive()
    assert "Traceback" not in capsys.readouterr().err


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    path = tmp_path / "tree.xml"
    path.write_text(TREE)
    return path


@pytest.fixture
def port(tree: Path) -> Iterator[int]:
    """The monitor's of a run that ticks once and again, and begins when somebody looks."""
    port, over = free_port(), threading.Event()
    loaded = load_tree(tree, Registry([Work]))
    loaded.setup(None, ManualClock())
    monitor = Monitor(loaded, Registry([Work]), port, with_hooks=True)
    observation = Rig().services.now.observation

    def run() -> None:
        monitor.await_view()
        while not over.wait(0.01):
            status = loaded.tick()
            changes = tuple(loaded.status_changes)
            monitor.tick(TickRecord(observation, status.name, changes, (), Command(), SentCommand(), 0.0, False))
        monitor.abandon()

    thread = threading.Thread(target=run)
    thread.start()
    yield port
    over.set()
    thread.join()


def begun(editor: Editor, port: int, tree: Path, *lines: int) -> list[dict[str, Any]]:
    """Attach with breakpoints at these lines; what the editor is told of them once the run is there."""
    editor.ask("initialize")
    editor.ask("attach", port=port)
    editor.hear("initialized")
    wanted = [{"line": line} for line in lines]
    told = editor.ask("setBreakpoints", source={"path": str(tree)}, breakpoints=wanted)["breakpoints"]
    assert [one["verified"] for one in told] == [False] * len(lines)
    editor.ask("configurationDone")
    return [editor.hear("breakpoint")["breakpoint"] for _ in lines]


def line_of(editor: Editor, thread: int) -> int:
    line: int = editor.ask("stackTrace", threadId=thread)["stackFrames"][0]["line"]
    return line


def test_the_first_node_waits_at_a_breakpoint_with_path_and_blackboard(port: int, tree: Path) -> None:
    with adapted() as editor:
        told = begun(editor, port, tree, SCRIPT, SCRIPT + 1, 99)
        assert [(one["verified"], one["line"]) for one in told] == [(True, SCRIPT), (True, SUBTREE), (False, 99)]
        stopped = editor.hear("stopped")
        assert stopped["reason"] == "breakpoint"
        assert line_of(editor, stopped["threadId"]) == SCRIPT
        with pytest.raises(LookupError, match="no blackboard has an entry 'wait'"):
            editor.ask("evaluate", expression="{wait}", frameId=2)
        editor.ask("continue", threadId=stopped["threadId"])
        stopped = editor.hear("stopped")
        frames = editor.ask("stackTrace", threadId=stopped["threadId"])["stackFrames"]
        assert [(frame["name"], frame["line"]) for frame in frames] == [("Pick", SUBTREE), ("Sequence", 3)]
        assert {frame["source"]["path"] for frame in frames} == {str(tree)}
        assert editor.ask("evaluate", expression="{wait}", frameId=frames[0]["id"])["result"] == "3"
        scopes = editor.ask("scopes", frameId=frames[0]["id"])["scopes"]
        variables = editor.ask("variables", variablesReference=scopes[0]["variablesReference"])["variables"]
        assert {variable["name"]: variable["value"] for variable in variables} == {"wait": "3"}


def test_a_node_of_many_ticks_waits_once_before_it_begins(port: int, tree: Path) -> None:
    with adapted() as editor:
        begun(editor, port, tree, PICK, LAST)
        for line in (PICK, LAST, PICK, LAST):
            thread = editor.hear("stopped")["threadId"]
            assert line_of(editor, thread) == line
            editor.ask("continue", threadId=thread)


def test_a_pause_and_steps_stop_at_each_action_in_turn(port: int, tree: Path) -> None:
    with adapted() as editor:
        begun(editor, port, tree, SCRIPT)
        thread = editor.hear("stopped")["threadId"]
        for line in (PICK, LAST, SCRIPT, PICK):
            editor.ask("next", threadId=thread)
            stopped = editor.hear("stopped")
            thread = stopped["threadId"]
            assert line_of(editor, thread) == line
            assert stopped["reason"] == ("breakpoint" if line == SCRIPT else "step")
        editor.ask("continue", threadId=thread)
        assert line_of(editor, editor.hear("stopped")["threadId"]) == SCRIPT


def test_what_the_nodes_of_each_line_do_is_told_where_it_changes(port: int, tree: Path) -> None:
    with adapted() as editor:
        begun(editor, port, tree, LAST)
        editor.hear("stopped")
        told: dict[str, dict[str, int]] = {}
        while told.get(str(tree), {}).get(str(PICK)) != 12:
            told = editor.hear("cell.statuses")
        assert told[str(tree)] == {"3": 1, str(SCRIPT): 2, str(SUBTREE): 2, str(LAST): 0, str(PICK): 12}


def test_who_leaves_lets_the_run_go_on(port: int, tree: Path) -> None:
    with adapted() as editor:
        begun(editor, port, tree, SCRIPT)
        editor.hear("stopped")
    with adapted() as editor:
        begun(editor, port, tree)
        while {"3", str(LAST)} - {line for line, code in editor.hear("cell.statuses")[str(tree)].items() if code == 1}:
            pass


@pytest.mark.parametrize(
    ("command", "words"),
    [("threads", "launch or attach comes first"), ("attach", "is no number"), ("launch", "program")],
)
def test_a_request_that_makes_no_sense_is_refused_with_words(command: str, words: str) -> None:
    with adapted() as editor, pytest.raises(LookupError, match=words):
        editor.ask(command, port=[])


ODD: tuple[Any, ...] = (None, 7, -1, "x", [], {}, [None], {"path": 5}, {"path": "/nowhere"}, [{"line": "x"}], 1e99)


@pytest.mark.parametrize(
    ("command", "keys"),
    [
        ("setBreakpoints", ("source", "breakpoints")), ("threads", ()), ("stackTrace", ("threadId", "startFrame")),
        ("scopes", ("frameId",)), ("variables", ("variablesReference",)), ("evaluate", ("expression", "frameId")),
        ("pause", ("threadId",)), ("continue", ("threadId",)), ("next", ("threadId",)), ("stepIn", ("threadId",)),
    ],
)  # fmt: skip
def test_odd_arguments_are_answered(port: int, tree: Path, command: str, keys: tuple[str, ...]) -> None:
    with adapted() as editor:
        begun(editor, port, tree, SCRIPT)
        for values in product(ODD, repeat=len(keys)):
            with suppress(LookupError):
                editor.ask(command, **dict(zip(keys, values, strict=True)))


@pytest.mark.slow
def test_an_editor_launches_a_run_stops_it_before_its_first_action_and_sees_it_end(tmp_path: Path) -> None:
    assert main(["init", str(tmp_path / "cell")]) == 0
    file = tmp_path / "cell" / "trees" / "mine.xml"
    body = '<Sequence>\n<ActivateGripper/>\n<MoveTo pose="park"/>\n</Sequence>'
    file.write_text(
        f'<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M">{body}</BehaviorTree></root>'
    )
    command = [sys.executable, "-m", "bracket_cell", "dap"]
    with Popen(command, cwd=tmp_path / "cell", stdin=PIPE, stdout=PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        editor = Editor(process.stdin, process.stdout)
        editor.ask("initialize")
        editor.ask("launch", program=str(file), args=["--look", "none"])
        editor.hear("initialized")
        editor.ask("setBreakpoints", source={"path": str(file)}, breakpoints=[{"line": 2}])
        editor.ask("configurationDone")
        thread = editor.hear("stopped")["threadId"]
        assert line_of(editor, thread) == 2
        editor.ask("continue", threadId=thread)
        assert editor.hear("exited") == {"exitCode": 0}
        assert any("finished" in event["body"]["output"] for event in editor.events if event["event"] == "output")
        editor.ask("disconnect")
        assert process.wait(LONG_S) == 0
