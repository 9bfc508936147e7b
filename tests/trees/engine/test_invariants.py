"""What the engine guarantees, whatever nodes do: in random trees with careless nodes, falling counts and a monitor.

A node is RUNNING only below RUNNING nodes, a leaf is terminated once for every time it was begun, and a node that needs
a guard is ticked only after one agreed in the same tick; where the check lets a tree pass, that is never put to use.
"""

from __future__ import annotations

import random
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

import pytest

from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.errors import NodeError, TraitError
from btxml.engine.hooks import Hook, Hooks, Mode, Position
from btxml.engine.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Control, Decorator, Node, TreeNode
from btxml.engine.status import Status
from btxml.engine.traits import Traits
from btxml.engine.tree import Tree
from btxml.files.checks.guarding import check_guards
from btxml.files.checks.structure import check_structure
from btxml.files.compile.registry import Registry
from btxml.files.loader import build
from btxml.files.parse.library import read_library
from tests.trees.conftest import Load

SIZE, TICKS = 16, 16
REFUSED = "no guard has agreed in this tick"
ENDS = (SUCCESS, FAILURE, SKIPPED)


class Drawn:
    """What the nodes of a tree answer, drawn for each case."""

    by: ClassVar[random.Random] = random.Random(0)


class Leaf(Node):
    """Answers at random, and counts."""

    open = 0

    def initialise(self) -> None:
        self.open += 1
        if Drawn.by.random() < 0.05:
            raise NodeError("not now")

    def update(self) -> Status:
        return Drawn.by.choice((*ENDS, RUNNING, RUNNING))

    def terminate(self, _new_status: Status) -> None:
        self.open -= 1
        if Drawn.by.random() < 0.05:
            raise NodeError("the brush is gone")


class Guard(Leaf):
    """Agrees, or does not; tells the tree's memory of this tick."""

    node_type = "Condition"
    traits = Traits(instant=True, guards=True)
    agreed: ClassVar[bool] = False

    def update(self) -> Status:
        if Drawn.by.random() < 0.3:
            return FAILURE
        Guard.agreed = True
        return SUCCESS


class Guarded(Leaf):
    """Must not be ticked unless a guard agreed."""

    traits = Traits(needs_guard=True)
    unasked: ClassVar[int] = 0

    def update(self) -> Status:
        Guarded.unasked += not Guard.agreed
        return super().update()


class Careless(Control):
    """Ticks some children, sometimes twice, halts some, and answers whatever it likes."""

    def run(self) -> Status:
        for child in Drawn.by.choices(self.children, k=2):
            child.halt() if Drawn.by.random() < 0.2 else child.execute()
        if Drawn.by.random() < 0.1:
            raise NodeError("lost")
        return Drawn.by.choice((*ENDS, RUNNING, IDLE))

    def on_halt(self) -> None:
        if Drawn.by.random() < 0.3:
            raise NodeError("cannot halt")
        if Drawn.by.random() < 0.3:
            self.children[0].execute()


class Stubborn(Decorator):
    """Keeps its status to itself, and leaves its child alone."""

    def run(self) -> Status:
        self.decorated.execute()
        return SUCCESS


NODES = (Leaf, Guard, Guarded, Careless, Stubborn)
CONTROLS = (
    *("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "SequenceWithMemory", "AsyncSequence"),
    *("AsyncFallback", "ParallelAll", "Parallel", "IfThenElse", "WhileDoElse", "TryCatch", "Careless"),
)
DECORATORS = (
    *("Inverter", "ForceSuccess", "ForceFailure", "KeepRunningUntilFailure", "Stubborn"),
    *('Repeat num_cycles="{n}"', 'RetryUntilSuccessful num_attempts="{n}"', 'RunOnce then_skip="false"'),
    *('Timeout msec="200"', 'Delay delay_msec="80"', 'Precondition if="n &lt; 3" else="SUCCESS"'),
    *('WaitValueUpdate entry="{n}"', 'SkipUnlessUpdated entry="{n}"', 'LoopInt queue="1;2" value="{item}"'),
)
PORTS = {"Parallel": ' success_count="{n}" failure_count="1"', "TryCatch": ' catch_on_halt="true"'}
CONDITIONS = ("_skipIf", "_successIf", "_failureIf", "_while")
LEAVES = ("<Leaf/>", "<Leaf/>", "<Guard/>", "<Guarded/>", '<Script code="n = 1"/>', '<Script code="n = 4"/>')


class Drawer:
    """Draws the XML of a tree."""

    def __init__(self, draw: random.Random) -> None:
        self._draw, self._left = draw, draw.randint(4, SIZE)
        self.subtrees: list[str] = []

    def node(self, depth: int = 0) -> str:
        draw = self._draw
        self._left -= 1
        if self._left <= 0 or depth > 5 or draw.random() < 0.15:
            return draw.choice(LEAVES).replace("/>", f"{self._condition()}/>")
        if draw.random() < 0.65:
            tag = draw.choice((*CONTROLS, *("ReactiveSequence",) * 4, "WhileDoElse"))
            below = "".join(self.node(depth + 1) for _ in range(draw.randint(2, 3)))
            return f"<{tag}{PORTS.get(tag, '')}{self._condition()}>{below}</{tag}>"
        if draw.random() < 0.15:
            self.subtrees.append("")
            number = len(self.subtrees) - 1
            self.subtrees[number] = self.node(depth + 1)
            return f'<SubTree ID="T{number}" n="{{n}}"{self._condition()}/>'
        opened = draw.choice(DECORATORS)
        return f"<{opened}{self._condition()}>{self.node(depth + 1)}</{opened.split()[0]}>"

    def _condition(self) -> str:
        if self._draw.random() < 0.85:
            return ""
        return f' {self._draw.choice(CONDITIONS)}="n {self._draw.choice(("&gt;", "&lt;"))} {self._draw.randint(0, 4)}"'


def drawn(draw: random.Random, path: Path) -> tuple[Tree, bool] | None:
    """A tree that may lack guards, and whether the check lets it pass; None where something else is wrong with it."""
    drawer = Drawer(draw)
    body = f'<BehaviorTree ID="Main"><Sequence><Script code="n := 2"/>{drawer.node()}</Sequence></BehaviorTree>'
    others = "".join(f'<BehaviorTree ID="T{i}">{text}</BehaviorTree>' for i, text in enumerate(drawer.subtrees))
    path.write_text(f'<root BTCPP_format="4" main_tree_to_execute="Main">{body}{others}</root>')
    library, registry = read_library(path), Registry(NODES)
    problems = check_structure(library, registry)
    passes = not check_guards(library, registry)
    if any("without a guard" not in problem.what for problem in problems):
        return None
    tree, _ = build(library, registry, "Main", {})
    return tree, passes


def meddle(hooks: Hooks, draw: random.Random, uids: int) -> None:
    """One order of a monitor, where it is legal."""
    uid, position = draw.randint(1, uids), draw.choice(list(Position))
    with suppress(ValueError):
        if draw.random() < 0.5:
            answer = draw.choice(("SUCCESS", "FAILURE", "SKIPPED"))
            once = draw.random() < 0.5
            hooks.insert(
                Hook(uid=uid, mode=draw.choice(list(Mode)), once=once, position=position, desired_status=answer)
            )
        elif draw.random() < 0.5:
            hooks.unlock(uid, position, draw.choice(ENDS), draw.random() < 0.5)
        else:
            hooks.remove(uid, position)


def broken(seed: int, path: Path, monitor: bool) -> str | None:
    """The first thing that the engine promises and does not keep; "none" for a tree that nobody runs."""
    draw = Drawn.by = random.Random(seed)
    found = drawn(draw, path)
    if found is None:
        return "none"
    tree, passes = found
    clock = ManualClock()
    tree.setup(None, clock)
    hooks = Hooks(tree, lambda _: None)
    parents = {child: node for node in tree.nodes for child in node.children}
    careless: set[TreeNode] = set()  # what stands below such nodes, parents before their children
    for node in tree.nodes:
        if node in parents and (isinstance(parents[node], Careless) or parents[node] in careless):
            careless.add(node)
    Guarded.unasked = 0
    for turn in range(TICKS):
        if monitor and draw.random() < 0.5:
            meddle(hooks, draw, len(tree.nodes))
        clock.sleep_until(clock.now_s() + 0.04)
        Guard.agreed = False
        tree.halt() if draw.random() < 0.1 else tree.tick()
        hooks.ticked()
        for node in tree.nodes:
            if node.status is RUNNING and node in parents and parents[node].status is not RUNNING:
                return f"tick {turn}: {node.full_path} RUNNING below {parents[node].status.name}"
            if isinstance(node, Leaf) and node.open != (node.status is RUNNING):
                return f"tick {turn}: {node.full_path} begun {node.open} times, and {node.status.name}"
            if passes and not monitor and node not in careless and REFUSED in node.feedback_message:
                return f"tick {turn}: {node.full_path} was let pass by the check, and is without a guard"
        if Guarded.unasked and not monitor:
            return f"tick {turn}: ticked without a guard"
    return None


def assert_kept(seeds: range, path: Path, monitor: bool) -> None:
    outcomes = Counter[str]()
    for seed in seeds:
        what = broken(seed, path, monitor)
        outcomes["kept" if what is None else "none" if what == "none" else f"seed {seed}: {what}"] += 1
    assert set(outcomes) <= {"kept", "none"}, (outcomes, path.read_text())
    assert outcomes["kept"] > 0.8 * len(seeds)


@pytest.mark.parametrize("monitor", [False, True])
def test_the_engine_keeps_its_promises(monitor: bool, tmp_path: Path) -> None:
    assert_kept(range(300), tmp_path / "tree.xml", monitor)


@pytest.mark.slow
@pytest.mark.parametrize("monitor", [False, True])
def test_the_engine_keeps_its_promises_in_twenty_thousand_trees(monitor: bool, tmp_path: Path) -> None:
    assert_kept(range(1_000, 21_000), tmp_path / "tree.xml", monitor)


def test_a_retry_whose_number_falls_halts_its_child(load: Load) -> None:
    """BehaviorTree.CPP goes on with the next child, and the first one still runs."""

    class Runs(Leaf):
        """Runs for ever."""

        abstract = False

        def update(self) -> Status:
            return RUNNING

    Drawn.by = random.Random(1)
    lowers = '<Sequence><Sleep msec="100"/><Script code="n := 0"/><Sleep msec="9000"/></Sequence>'
    retry = '<RetryUntilSuccessful num_attempts="{n}"><Runs name="first"/></RetryUntilSuccessful>'
    both = f'<Parallel>{lowers}<Fallback>{retry}<Runs name="second"/></Fallback></Parallel>'
    clock = ManualClock()
    tree = load(f'<Sequence><Script code="n := 2"/>{both}</Sequence>', Runs, clock=clock)
    for _ in range(5):
        tree.tick()
        clock.sleep_until(clock.now_s() + 0.04)
    assert {node.name: (node.status.name, node.open) for node in tree.nodes if isinstance(node, Runs)} == {
        "first": ("INVALID", 0),
        "second": ("RUNNING", 1),
    }


def test_what_is_the_engines_own_cannot_be_overridden() -> None:
    for name in ("execute", "halt", "reset_children", "set_status"):
        with pytest.raises(TraitError, match=rf"Own\.{name} is the engine's own; override one of: run, on_halt"):
            type("Own", (Decorator,), {name: lambda _: None})
    with pytest.raises(TraitError, match=r"Own\.run is the engine's own"):
        type("Own", (Node,), {"run": lambda _: SUCCESS})
