"""The same random tree in BehaviorTree.CPP itself and in this engine, with leaves that follow a script."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import behaviortreepy
from py_trees.common import Status

from cell.interfaces.clock import ManualClock
from cell.interfaces.errors import InputError
from trees.loader import load_tree
from trees.node import FAILURE, RUNNING, SKIPPED, SUCCESS, Node
from trees.registry import Registry

OURS = {"S": SUCCESS, "F": FAILURE, "R": RUNNING, "K": SKIPPED}
THEIRS = {
    "S": behaviortreepy.NodeStatus.SUCCESS,
    "F": behaviortreepy.NodeStatus.FAILURE,
    "R": behaviortreepy.NodeStatus.RUNNING,
    "K": behaviortreepy.NodeStatus.SKIPPED,
}
WORDS = {status.name: letter for letter, status in THEIRS.items()} | {"IDLE": "K"}
REFUSED = ["refused"]
VARIABLES = ("x", "y")
CONDITIONS = (
    *("x > 1", "y == 0", "x != y", "x + y < 4", "x - y > 0", "true", "x == 0 || y > 2", "x * 2 >= y + 1", "!(x == y)"),
    *("-1 < x < 3", "x > 0 && y > 0 || x <= y", "'a' < 'b'", "'s' .. 't' == 'st'"),
    *("(2 | 1) == 3 && (6 ^ 3) == 5", "x > 1 ? y > 1 : y == 0", "-x + 0x2 > 0", "(~1) == -2", "6 & 3 == 2"),
)
CONTROLS = (
    *("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "SequenceWithMemory", "AsyncSequence"),
    *("AsyncFallback", "Parallel", "ParallelAll", "IfThenElse", "WhileDoElse", "Switch"),
)
ATTRIBUTES_BEFORE = ("_failureIf", "_successIf")
ATTRIBUTES_AFTER = ("_onSuccess", "_onFailure", "_post")
DECORATORS = (
    *("Inverter", "ForceSuccess", "ForceFailure", "KeepRunningUntilFailure", "Repeat", "RunOnce", "SubTree"),
    *("RetryUntilSuccessful", "Precondition", "Loop"),
)
ASSIGNMENTS = (
    "x := x + 1",
    "y := x - y",
    "x = 0",
    "y += 1; x := y > 2 ? 0 : x",
    "y -= 1",
    "x *= 2; x := x > 9 ? 1 : x",
)


@dataclass(frozen=True)
class Case:
    """A tree, the answers of its leaves in turn, and the ticks before which it is halted."""

    xml: str
    answers: Mapping[str, str]
    halts: frozenset[int]
    ticks: int


class Generator:
    """Random trees of everything that both sides support."""

    def __init__(self, seed: int, size: int, skips: bool = True, scripts: bool = True) -> None:
        self._random = random.Random(seed)
        self._left = size
        self._skips = skips  # whether nodes at this point of the tree may be skipped
        self._scripts = scripts
        self._subtrees: list[str] = []
        self.answers: dict[str, str] = {}

    def case(self, ticks: int = 20) -> Case:
        tree = self._node(0)
        subtrees = "".join(f'<BehaviorTree ID="T{i}">{body}</BehaviorTree>' for i, body in enumerate(self._subtrees))
        start = '<Script code="x := 0; y := 0"/>'
        main = f'<BehaviorTree ID="Main"><Sequence><RunOnce>{start}</RunOnce>{tree}</Sequence></BehaviorTree>'
        xml = f'<root BTCPP_format="4" main_tree_to_execute="Main">{main}{subtrees}</root>'
        halts = frozenset(i for i in range(1, ticks) if self._random.random() < 0.1)
        return Case(xml, self.answers, halts, ticks)

    def _node(self, depth: int) -> str:
        self._left -= 1
        draw = self._random.random()
        if depth > 6 or self._left <= 0 or draw < 0.25:
            return self._leaf()
        return self._control(depth) if draw < 0.7 else self._decorator(depth)

    def _leaf(self) -> str:
        draw = self._random.random()
        if self._scripts and draw < 0.1:
            return f'<Script code="{self._random.choice(ASSIGNMENTS)}"{self._leaf_conditions()}/>'
        if self._scripts and draw < 0.2:
            code = _escaped(self._random.choice(CONDITIONS))
            return f'<ScriptCondition code="{code}"/>'
        if draw < 0.25:
            return self._random.choice(("<AlwaysSuccess/>", "<AlwaysFailure/>"))
        name = f"leaf{len(self.answers)}"
        letters = "SSSFFRRR" + ("K" if self._skips else "")
        self.answers[name] = "".join(self._random.choices(letters, k=self._random.randint(1, 9)))
        return f'<Leaf name="{name}"{self._leaf_conditions()}/>'

    def _check(self) -> str:
        """A condition: the library does not tick a finished action again before it is reset, as a py_trees leaf is."""
        name = f"leaf{len(self.answers)}"
        self.answers[name] = "".join(self._random.choices("SF", k=self._random.randint(1, 9)))
        return f'<Check name="{name}"/>'

    def _control(self, depth: int) -> str:
        tag = self._random.choice(CONTROLS)
        if tag in ("IfThenElse", "WhileDoElse"):
            branches = [self._node(depth + 1) for _ in range(self._random.randint(1, 2))]
            return self._element(tag, "", [self._check(), *branches])
        if tag == "Switch":
            return self._switch(depth)
        children = [self._node(depth + 1) for _ in range(self._random.randint(1, 4))]
        ports = ""
        if tag == "Parallel":
            ports = f' success_count="{self._count(children)}" failure_count="{self._count(children)}"'
        if tag == "ParallelAll":
            ports = f' max_failures="{self._count(children)}"'
        return self._element(tag, ports, children)

    def _switch(self, depth: int) -> str:
        """Switch2 to Switch6 on a number that scripts change, an enum name or a text."""
        cases = self._random.randint(2, 6)
        variable, values = self._random.choice(
            (("{x}", ("0", "1", "2", "-1", "3", "5")), ("red", ("red", "blue", "RED", "", "1", "x")))
        )
        ports = f' variable="{variable}"'
        for number in range(1, cases + 1):
            ports += f' case_{number}="{self._random.choice(values)}"'
        return self._element(f"Switch{cases}", ports, [self._node(depth + 1) for _ in range(cases + 1)])

    def _count(self, children: list[str]) -> int:
        return self._random.choice((-1, self._random.randint(1, len(children))))

    def _decorator(self, depth: int) -> str:
        tag = self._random.choice(DECORATORS)
        if tag == "Precondition":
            return self._precondition()
        if tag == "SubTree":
            self._subtrees.append("")
            number = len(self._subtrees) - 1
            self._subtrees[number] = self._node(depth + 1)
            remap = self._random.choice(('x="{x}" y="{y}"', '_autoremap="true"', 'x="{=}" y="{=}"', 'x="{y}" y="{x}"'))
            return f'<SubTree ID="T{number}" {remap}{self._leaf_conditions()}/>'
        if tag == "Loop":
            return self._loop(depth)
        if tag in ("Repeat", "RetryUntilSuccessful"):
            return self._rounds(tag, depth)
        ports = ""
        if tag == "RunOnce":
            ports = f' then_skip="{self._random.choice(("true", "false")) if self._skips else "false"}"'
        return self._element(tag, ports, [self._node(depth + 1)])

    def _rounds(self, tag: str, depth: int) -> str:
        """Nothing below is skipped: the library keeps the count of a skipped Repeat, this engine begins anew."""
        before, self._skips = self._skips, False
        port = "num_cycles" if tag == "Repeat" else "num_attempts"
        element = self._element(tag, f' {port}="{self._random.randint(1, 4)}"', [self._node(depth + 1)])
        self._skips = before
        return element

    def _loop(self, depth: int) -> str:
        """A queue that the file spells out."""
        kind, items = self._random.choice(
            (("Int", "1;2;3"), ("Double", "0.5;2"), ("Bool", "true;false"), ("String", "a;b"))
        )
        number = sum(text.count("<Loop") for text in self._subtrees) + len(self.answers)
        ports = (
            f' queue="{items}" value="{{item{kind}{number}}}" if_empty="{self._random.choice(("SUCCESS", "FAILURE"))}"'
        )
        return self._element(f"Loop{kind}", ports, [self._node(depth + 1)])

    def _precondition(self) -> str:
        """Only with a child that finishes at once: the library does not ask again after a halt, this engine does."""
        if not self._scripts:
            return self._leaf()
        condition = self._random.choice(("x > 1", "y == 0", "x != y"))
        otherwise = self._random.choice(("FAILURE", "SUCCESS", "RUNNING", "SKIPPED")[: 4 if self._skips else 3])
        child = self._random.choice((self._check(), f'<Script code="{self._random.choice(ASSIGNMENTS)}"/>'))
        return self._element("Precondition", f' if="{condition}" else="{otherwise}"', [child])

    def _element(self, tag: str, ports: str, children: list[str]) -> str:
        """The library leaves a skipped control RUNNING, so that it does not ask the first three conditions again."""
        attributes = ("_while", *ATTRIBUTES_AFTER) if self._skips else (*ATTRIBUTES_BEFORE, *ATTRIBUTES_AFTER)
        return f"<{tag}{ports}{self._conditions(attributes)}>{''.join(children)}</{tag}>"

    def _leaf_conditions(self) -> str:
        skips = ("_skipIf", "_while") if self._skips else ()
        return self._conditions((*skips, *ATTRIBUTES_BEFORE, *ATTRIBUTES_AFTER))

    def _conditions(self, attributes: tuple[str, ...]) -> str:
        if not self._scripts or self._random.random() > 0.2:
            return ""
        name = self._random.choice(attributes)
        code = self._random.choice(ASSIGNMENTS if name in ATTRIBUTES_AFTER else CONDITIONS)
        return f' {name}="{_escaped(code)}"'


def _escaped(code: str) -> str:
    return code.replace("&", "&amp;").replace("<", "&lt;")


def run_theirs(case: Case) -> list[str]:
    """Leaf events, root status and blackboard of every tick, from the original library."""
    log: list[str] = []
    turns = dict.fromkeys(case.answers, 0)

    def answer(node: behaviortreepy.TreeNode, event: str) -> behaviortreepy.NodeStatus:
        name = node.name()
        log.append(f"{event} {name}")
        return THEIRS[_letter(case, turns, name, event)]

    factory = behaviortreepy.BehaviorTreeFactory()
    factory.register_simple_stateful_action(
        "Leaf",
        lambda node: answer(node, "start"),
        lambda node: answer(node, "poll"),
        lambda node: log.append(f"halt {node.name()}"),
    )
    factory.register_simple_condition("Check", lambda node: answer(node, "start"))
    try:
        factory.register_behavior_tree_from_text(case.xml)
        tree = factory.create_tree("Main")
    except RuntimeError:
        return REFUSED
    board = tree.root_blackboard()
    for turn in range(case.ticks):
        if turn in case.halts:
            tree.halt_tree()
            log.append("halted")
        status = WORDS[tree.tick_exactly_once().name]
        log.append(f"{turn}: {status} " + " ".join(str(int(board.get_double(key))) for key in VARIABLES))
    return list(log)  # what the library's destructor still halts is not compared


def run_ours(case: Case, path: Path) -> list[str]:
    """The same from this engine."""
    log: list[str] = []
    turns = dict.fromkeys(case.answers, 0)

    class Leaf(Node):
        """Answers what the case says."""

        def update(self) -> Status:
            event = "poll" if self.status is RUNNING else "start"
            log.append(f"{event} {self.name}")
            return OURS[_letter(case, turns, self.name, event)]

        def terminate(self, new_status: Status) -> None:
            if new_status is Status.INVALID and self.status is RUNNING:
                log.append(f"halt {self.name}")

    class Check(Leaf):
        """The same, as a condition."""

    path.write_text(case.xml)
    try:
        tree = load_tree(path, Registry([Leaf, Check]))
    except InputError:
        return REFUSED
    tree.setup(None, ManualClock())
    letters = {status: letter for letter, status in OURS.items()}
    for turn in range(case.ticks):
        if turn in case.halts:
            tree.halt()
            log.append("halted")
        status = letters[tree.tick()]
        log.append(f"{turn}: {status} " + " ".join(str(tree.blackboard.entry(key).value) for key in VARIABLES))
    return log


def _letter(case: Case, turns: dict[str, int], name: str, event: str) -> str:
    """A leaf's next answer; one that runs cannot be skipped, so it succeeds instead."""
    answers = case.answers[name]
    letter = answers[turns[name] % len(answers)]
    turns[name] += 1
    return "S" if letter == "K" and event == "poll" else letter
