"""One case in BehaviorTree.CPP itself and in this engine: what leaves did, all statuses and the blackboard."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import IO, Any, Protocol

import behaviortreepy

from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.blackboard import UNSET
from btxml.engine.errors import NodeError, TreeFileError
from btxml.engine.node import FAILURE, RUNNING, SKIPPED, SUCCESS, Node
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry
from tests.trees.conftest import load_whatever_is_reached
from tests.trees.engine.random_trees import VARIABLES, Case

OURS = {"S": SUCCESS, "F": FAILURE, "R": RUNNING, "K": SKIPPED}
THEIRS = {
    "S": behaviortreepy.NodeStatus.SUCCESS,
    "F": behaviortreepy.NodeStatus.FAILURE,
    "R": behaviortreepy.NodeStatus.RUNNING,
    "K": behaviortreepy.NodeStatus.SKIPPED,
}
WORDS = {status.name: letter for letter, status in THEIRS.items()} | {"IDLE": "K"}
CHANGE = re.compile(rb"\[[\d.]+\]: (\S+) +\x1b\[\d+m(\w+)\x1b\[0m -> \x1b\[\d+m(\w+)\x1b\[0m")
IDLE_NAME = "IDLE"
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")

Change = tuple[str, str, str]


@dataclass
class Step:
    """What one tick, or one halt, did.

    Attributes:
        status: letter of the root's answer, "-" for a halt.
        events: starts, polls and halts of leaves, in order.
        changes: (node, old status, new status), in order.
        values: of the variables of the main tree, None where unset.
        skipped: nodes whose last answer was SKIPPED; only this engine tells.
    """

    status: str = "-"
    events: list[str] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    values: tuple[float | None, ...] = ()
    skipped: frozenset[str] = frozenset()


class Side(Protocol):
    """One of the two engines with the tree of a case."""

    def tick(self) -> Step: ...

    def halt(self) -> Step: ...

    def close(self) -> None: ...


class Refused(Exception):
    """The engine does not take the tree."""


class Answers:
    """The leaves' answers in turn, and what happened to the leaves."""

    def __init__(self, case: Case) -> None:
        self._answers = case.answers
        self._turns = dict.fromkeys(case.answers, 0)
        self.events: list[str] = []

    def letter(self, name: str, event: str) -> str:
        """The next answer; a leaf that runs cannot be skipped, so it succeeds instead."""
        self.events.append(f"{event} {name}")
        answers = self._answers[name]
        letter = answers[self._turns[name] % len(answers)]
        self._turns[name] += 1
        return "S" if letter == "K" and event == "poll" else letter

    def take(self) -> list[str]:
        events, self.events = self.events, []
        return events


class Original:
    """The original library; its log of statuses goes to standard output, where it is read.

    Attributes:
        late: changes that its timers made since the last step.
    """

    def __init__(self, case: Case, output: IO[bytes]) -> None:
        """Load the tree.

        Raises:
            Refused: the library does not.
        """
        self._answers = answers = Answers(case)
        self._output = output
        self._factory = factory = behaviortreepy.BehaviorTreeFactory()
        factory.register_simple_stateful_action(
            "Leaf",
            lambda node: THEIRS[answers.letter(node.name(), "start")],
            lambda node: THEIRS[answers.letter(node.name(), "poll")],
            lambda node: answers.events.append(f"halt {node.name()}"),
        )
        factory.register_simple_condition("Check", lambda node: THEIRS[answers.letter(node.name(), "start")])
        try:
            factory.register_behavior_tree_from_text(case.their_xml)
            self._tree = factory.create_tree("Main")
        except RuntimeError as error:
            raise Refused(str(error)) from None
        self._board = self._tree.root_blackboard()
        self._logger = behaviortreepy.StdCoutLogger(self._tree)
        self.late: list[Change] = []

    def tick(self) -> Step:
        return self._step(WORDS[self._tree.tick_exactly_once().name])

    def halt(self) -> Step:
        self._tree.halt_tree()
        return self._step("-")

    def close(self) -> None:
        """What the library's destructor still halts is not compared."""
        self._logger.set_enabled(False)

    def _step(self, letter: str) -> Step:
        self._logger.flush()
        changes = [*self.late, *read_changes(self._output)]
        self.late = []
        return Step(letter, self._answers.take(), changes, tuple(map(self._value, VARIABLES)))

    def _value(self, name: str) -> float | None:
        try:
            return float(self._board.get_double(name))
        except RuntimeError:
            return None


class Judge:
    """The library's newest version, in a process of its own; see judge.cpp and `make judge`."""

    def __init__(self, program: Path) -> None:
        self._process = subprocess.Popen(
            [program, *VARIABLES], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def load(self, case: Case) -> Judge:
        """Load the tree of a case.

        Raises:
            Refused: the library does not.
        """
        xml = case.xml.encode()
        self._say(f"tree {len(xml)}\n{case.xml}")
        for name, letters in case.answers.items():
            self._say(f"answers {name} {letters}")
        for kind, words in self._ask("load"):
            if kind == "refused":
                raise Refused(words)
        return self

    def tick(self) -> Step:
        return self._step("tick")

    def halt(self) -> Step:
        return self._step("halt")

    def close(self) -> None:
        """The next case takes its place."""

    def end(self) -> None:
        """End the process."""
        self._process.communicate()

    def _step(self, word: str) -> Step:
        step, values = Step(), list[float | None]()
        for kind, words in self._ask(word):
            if kind == "raised":
                raise RuntimeError(words)
            if kind == "status":
                step.status = WORDS[words]
            elif kind == "event":
                step.events.append(words)
            elif kind == "change":
                name, old, new = words.split(" ")
                old, new = (IDLE_NAME if one == "SKIPPED" else one for one in (old, new))
                step.changes += [(name, old, new)] if old != new else []
            elif kind == "value":
                text = words.split(" ")[1]
                values.append(None if text == "-" else float(text))
        step.values = tuple(values)
        return step

    def _say(self, text: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{text}\n")

    def _ask(self, word: str) -> list[tuple[str, str]]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._say(word)
        self._process.stdin.flush()
        lines = iter(self._process.stdout.readline, ".\n")
        told = []
        for line in lines:
            assert line, "the judge has ended"
            kind, _, words = line.rstrip("\n").partition(" ")
            told.append((kind, words))
        return told


class Colour(Enum):
    """An enum of the judge's."""

    RED = 1
    GREEN = 2
    BLUE = 5


TYPED: Mapping[str, Any] = {
    **{"Int": int, "Double": float, "Bool": bool, "Text": str, "Colour": Colour},
    **{"Ints": list[int], "Doubles": list[float], "Texts": list[str]},
}
WRITTEN: Mapping[str, Any] = {"Int": 7, "Double": 1.5, "Bool": True, "Text": "12", "Colour": Colour.GREEN}


def typed_nodes(answers: Answers) -> list[type[Node]]:
    """The judge's leaves with typed ports."""
    made: list[type[Node]] = []

    def read(node: Any, ports: Iterable[str]) -> Status:
        values, status = [], SUCCESS
        for port in ports:
            try:
                values.append(_shown(getattr(node, port).get()))
            except NodeError:
                values.append("-")
                status = FAILURE
        answers.events.append(f"read {node.name} {' '.join(values)}")
        return status

    for name, kind in TYPED.items():
        ports = {"v": InputPort(kind, "a value"), "update": lambda node: read(node, ["v"])}
        made.append(type(f"Read{name}", (Node,), {"__doc__": "Reads.", **ports}))
    for name, value in WRITTEN.items():

        def write(node: Any, value: Any = value) -> Status:
            node.v.set(value)
            return SUCCESS

        made.append(
            type(f"Write{name}", (Node,), {"__doc__": "Writes.", "v": OutputPort(TYPED[name]), "update": write})
        )
    own = {"n": InputPort(int, default="{=}"), "m": InputPort(int, default="{@n}")}
    made.append(type("ReadOwn", (Node,), {"__doc__": "Reads.", **own, "update": lambda node: read(node, ["n", "m"])}))
    return made


def _shown(value: Any) -> str:
    """As the judge prints it."""
    if isinstance(value, list | tuple):
        return "".join(f"{_shown(one)};" for one in value)
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:g}" if isinstance(value, float) else str(value)


class Ours:
    """This engine."""

    def __init__(self, case: Case, path: Path, clock: ManualClock, judged: bool = False) -> None:
        """Load the tree; judged, with the judge's own leaves, whose enum scripts and Switches know.

        Raises:
            Refused: this engine does not.
        """
        self._answers = answers = Answers(case)

        class Leaf(Node):
            """Answers what the case says."""

            def update(self) -> Status:
                return OURS[answers.letter(self.name, "poll" if self.status is RUNNING else "start")]

            def terminate(self, new_status: Status) -> None:
                if new_status is Status.INVALID and self.status is RUNNING:
                    answers.events.append(f"halt {self.name}")

        class Check(Leaf):
            """The same, as a condition."""

        path.write_text(case.xml)
        try:
            self._tree = load_whatever_is_reached(
                path, Registry([Leaf, Check, *(typed_nodes(answers) if judged else ())])
            )
        except TreeFileError as error:
            raise Refused(str(error)) from None
        self._tree.setup(None, clock)
        self._skipped: set[str] = set()
        _note_skips(self._tree, self._skipped)

    def tick(self) -> Step:
        status = self._tree.tick()
        return self._step({value: letter for letter, value in OURS.items()}[status])

    def halt(self) -> Step:
        self._tree.halt()
        return self._step("-")

    def _step(self, letter: str) -> Step:
        names = [node.name for node in self._tree.nodes]
        changes = [
            (names[status_change.uid - 1], _word(status_change.old), _word(status_change.new))
            for status_change in self._tree.status_changes
            if _word(status_change.old) != _word(status_change.new)
        ]
        values = tuple(map(self._value, VARIABLES))
        return Step(letter, self._answers.take(), changes, values, frozenset(self._skipped))

    def _value(self, name: str) -> float | None:
        value = self._tree.blackboard.entry(name).value
        if value is UNSET or isinstance(value, list | tuple):
            return None
        value = value.value if isinstance(value, Enum) else value
        begins = NUMBER.match(value) if isinstance(value, str) else None  # the library reads a text as far as it can
        return (float(begins[0]) if begins else None) if isinstance(value, str) else float(value)


def differences(one: Step, other: Step, mine: dict[str, str], theirs: dict[str, str], in_order: bool) -> list[str]:
    """Where this engine's step differs from the library's.

    Args:
        mine, theirs: statuses of all nodes so far by name, brought up to date here.
        in_order: every single change is compared, too, in order.
    """
    found = [
        f"{name}: {a} here, {b} there"
        for name, a, b in (
            ("status", one.status, other.status),
            ("leaves", one.events, other.events),
            ("blackboard", one.values, other.values),
            ("changes", one.changes if in_order else None, other.changes if in_order else None),
        )
        if a != b
    ]
    mine |= {name: new for name, _, new in one.changes}
    theirs |= {name: new for name, _, new in other.changes}
    for name in mine.keys() | theirs.keys():
        here, there = mine.get(name, IDLE_NAME), theirs.get(name, IDLE_NAME)
        # The library leaves a control RUNNING that was skipped; here it is idle.
        skipped = here == IDLE_NAME and there == "RUNNING" and name in one.skipped
        if here != there and not skipped:
            found.append(f"{name} is {here} here, {there} there")
    return found


def read_changes(output: IO[bytes]) -> list[Change]:
    """What the library logged since this was last asked, but for the nodes that are only there."""
    found = CHANGE.findall(output.read())
    return [(name.decode(), old.decode(), new.decode()) for name, old, new in found if not name.startswith(b"~")]


@contextmanager
def standard_output() -> Iterator[IO[bytes]]:
    """What anything in this process writes to standard output meanwhile can be read from here."""
    with tempfile.TemporaryFile(buffering=0) as output, Path(f"/proc/self/fd/{output.fileno()}").open("rb") as reader:
        before = os.dup(1)
        os.dup2(output.fileno(), 1)
        try:
            yield reader
        finally:
            os.dup2(before, 1)
            os.close(before)


def judged(
    case: Case, path: Path, load: Callable[[Case], Side], in_order: bool, typed: bool = False
) -> tuple[str, list[str]]:
    """How a case ends beside the library: equal, differs, raised there, or refused; and its differences.

    Args:
        load: the library's engine with the tree of a case, or `Refused`.
        typed: with the judge's own leaves.
    """
    there, ours, theirs = "", None, None
    try:
        theirs = load(case)
    except Refused as error:
        there = str(error)
    try:
        ours = Ours(case, path, ManualClock(), typed)
    except Refused as error:
        return ("refused by both" if there else "refused here"), [str(error), there]
    if theirs is None:
        return "refused there", [there]
    try:
        return _first_difference(case, ours, theirs, in_order)
    finally:
        theirs.close()


def compare(case: Case, path: Path, in_order: bool) -> list[str] | None:
    """Differences from version 4.8 in the first step that has any; None where both sides refuse the tree."""
    with standard_output() as output:
        kind, found = judged(case, path, lambda case: Original(case, output), in_order)
    if kind == "refused by both":
        return None
    return [] if kind in ("equal", "raised there") else [kind, *found]


def both(
    case: Case, path: Path, clock: ManualClock, output: IO[bytes]
) -> tuple[Ours | None, Original | None, list[str]]:
    """The case in both engines, None where one refuses it, and why."""
    refusals: list[str] = []
    ours = theirs = None
    try:
        theirs = Original(case, output)
    except Refused as error:
        refusals.append(f"refused there: {error}")
    try:
        ours = Ours(case, path, clock)
    except Refused as error:
        refusals.append(f"refused here: {error}")
    return ours, theirs, refusals


def _first_difference(case: Case, ours: Ours, theirs: Side, in_order: bool) -> tuple[str, list[str]]:
    """A failing script is an exception there, and a failure here: after it nothing can be compared."""
    here: dict[str, str] = {}
    there: dict[str, str] = {}
    for turn in range(case.ticks):
        for word in ("halt",) * (turn in case.halts) + ("tick",):
            try:
                other = theirs.halt() if word == "halt" else theirs.tick()
            except RuntimeError as error:
                return "raised there", [f"{word} {turn}", str(error)]
            one = ours.halt() if word == "halt" else ours.tick()
            if found := differences(one, other, here, there, in_order):
                return "differs", [f"{word} {turn}", *found]
    return "equal", []


def _note_skips(tree: Tree, skipped: set[str]) -> None:
    """Keep the names of the nodes whose last answer was SKIPPED."""
    for node in tree.nodes:
        vars(node)["execute"] = _noting(node.name, node.execute, skipped)


def _noting(name: str, execute: Callable[[], Status], skipped: set[str]) -> Callable[[], Status]:
    def noted() -> Status:
        status = execute()
        (skipped.add if status is SKIPPED else skipped.discard)(name)
        return status

    return noted


def _word(status: Status) -> str:
    """As the library shows it: a node that it skips stays idle."""
    return IDLE_NAME if status in (Status.INVALID, SKIPPED) else status.name
