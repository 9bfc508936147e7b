"""Whatever ends a tree: every leaf that was begun is terminated exactly once, and nothing is left RUNNING."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path
from typing import ClassVar

import pytest

from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.errors import NodeError
from btxml.engine.node import Node
from btxml.engine.status import Status
from btxml.files.compile.registry import Registry
from tests.trees.conftest import Load, load_whatever_is_reached

LETTERS = {"S": Status.SUCCESS, "F": Status.FAILURE, "R": Status.RUNNING}
CONTROLS = {
    **dict.fromkeys(
        ("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "ParallelAll", "Parallel"), (1, 4)
    ),
    **dict.fromkeys(("IfThenElse", "WhileDoElse"), (2, 3)),
    "TryCatch": (2, 4),
}
DECORATORS = (
    *("Inverter", "ForceSuccess", 'Repeat num_cycles="2"', 'RetryUntilSuccessful num_attempts="-1"'),
    *('Timeout msec="90"', 'Delay delay_msec="50"', "KeepRunningUntilFailure", 'RunOnce then_skip="false"'),
)


class Fault(Exception):
    """Raised by a leaf in a test."""


class Counted(Node):
    """Counts what is begun and what is terminated; answers at random, and may raise."""

    begun: ClassVar[Counter[str]] = Counter()
    ended: ClassVar[Counter[str]] = Counter()
    answers = random.Random(0)
    fault_rate = 0.0

    def initialise(self) -> None:
        assert self.begun[self.full_path] == self.ended[self.full_path]
        self.begun[self.full_path] += 1

    def update(self) -> Status:
        if self.answers.random() < self.fault_rate:
            raise Fault(self.name)
        return LETTERS[self.answers.choice("SFRR")]

    def terminate(self, _new_status: Status) -> None:
        self.ended[self.full_path] += 1


def random_tree(draw: random.Random, depth: int = 0) -> str:
    if depth > 4 or draw.random() < 0.2:
        return "<Counted/>"
    if draw.random() < 0.4:
        decorator = draw.choice(DECORATORS)
        return f"<{decorator}>{random_tree(draw, depth + 1)}</{decorator.split()[0]}>"
    tag, (low, high) = draw.choice(list(CONTROLS.items()))
    children = "".join(random_tree(draw, depth + 1) for _ in range(draw.randint(low, high)))
    return f"<{tag}>{children}</{tag}>"


def assert_halted_once(seed: int, fault_rate: float, path: Path) -> None:
    """Ticks, halts and faults at random: a begun leaf that does not run was terminated exactly once."""
    draw = random.Random(seed)
    path.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{random_tree(draw)}</BehaviorTree></root>')
    tree = load_whatever_is_reached(path, Registry([Counted]))
    clock = ManualClock()
    tree.setup(None, clock)
    Counted.begun, Counted.ended = Counter(), Counter()
    Counted.answers, Counted.fault_rate = draw, fault_rate
    for _ in range(12):
        clock.sleep_until(clock.now_s() + 0.04)
        try:
            if draw.random() < 0.15:
                tree.halt()
            else:
                tree.tick()
        except Fault:
            assert all(node.status is Status.INVALID for node in tree.nodes)
            assert Counted.begun == Counted.ended
        running = {node.full_path for node in tree.nodes if isinstance(node, Counted) and node.status is Status.RUNNING}
        assert Counted.begun - Counted.ended == Counter(dict.fromkeys(running, 1))
    tree.halt()
    assert Counted.begun == Counted.ended
    assert all(node.status is Status.INVALID for node in tree.nodes)


@pytest.mark.parametrize("fault_rate", [0.0, 0.02])
def test_every_begun_leaf_is_terminated_exactly_once(fault_rate: float, tmp_path: Path) -> None:
    for seed in range(250):
        assert_halted_once(seed, fault_rate, tmp_path / "tree.xml")


@pytest.mark.slow
@pytest.mark.parametrize("fault_rate", [0.0, 0.02])
def test_every_begun_leaf_of_ten_thousand_trees_is_terminated_exactly_once(fault_rate: float, tmp_path: Path) -> None:
    for seed in range(250, 5_250):
        assert_halted_once(seed, fault_rate, tmp_path / "tree.xml")


class Runs(Node):
    """Runs for ever and counts its ends."""

    ends = 0

    def update(self) -> Status:
        return Status.RUNNING

    def terminate(self, _new_status: Status) -> None:
        self.ends += 1


class Raises(Node):
    """Raises in its second tick, or when it is terminated."""

    ticks = 0

    def update(self) -> Status:
        self.ticks += 1
        if self.ticks > 1:
            raise Fault("update")
        return Status.RUNNING

    def terminate(self, _new_status: Status) -> None:
        if self.name == "twice":
            raise Fault("terminate")


def test_an_exception_leaves_the_tick_and_nothing_running(load: Load) -> None:
    tree = load('<ParallelAll><Runs name="a"/><Raises/><Runs name="b"/></ParallelAll>', Runs, Raises)
    tree.tick()
    with pytest.raises(Fault, match="update"):
        tree.tick()
    assert [node.ends for node in tree.nodes if isinstance(node, Runs)] == [1, 1]
    assert {node.status for node in tree.nodes} == {Status.INVALID}


def test_a_leaf_that_cannot_terminate_does_not_keep_others_from_it(load: Load) -> None:
    nodes = '<ParallelAll><Runs/><Raises name="twice"/><Sequence><Runs/></Sequence></ParallelAll>'
    tree = load(nodes, Runs, Raises)
    tree.tick()
    with pytest.raises(ExceptionGroup) as raised:
        tree.halt()
    assert [str(error) for error in raised.value.exceptions] == ["terminate"]
    assert [node.ends for node in tree.nodes if isinstance(node, Runs)] == [1, 1]
    assert {node.status for node in tree.nodes} == {Status.INVALID}


def test_halting_twice_terminates_once(load: Load) -> None:
    tree = load("<Sequence><Runs/></Sequence>", Runs)
    tree.tick()
    tree.halt()
    tree.halt()
    assert [node.ends for node in tree.nodes if isinstance(node, Runs)] == [1]


def test_halting_a_tree_that_never_ticked_does_nothing(load: Load) -> None:
    tree = load('<Sequence><Script code="n := 1" _onHalted="n := 2"/></Sequence>')
    tree.halt()
    assert tree.blackboard.values() == {}
    assert tree.status_changes == []


def test_on_halted_runs_once(load: Load) -> None:
    tree = load('<Sequence><Script code="n := 0"/><Runs _onHalted="n += 1"/></Sequence>', Runs)
    tree.tick()
    tree.halt()
    assert tree.blackboard.values() == {"n": 1}


class Silent(Runs):
    """Forgets to answer."""

    def update(self) -> Status:
        return None  # type: ignore[return-value]


def test_a_leaf_that_answers_nothing_is_named(load: Load) -> None:
    tree = load("<Sequence><Silent/></Sequence>", Silent)
    with pytest.raises(TypeError, match=r"Silent\.update answered None, not a Status"):
        tree.tick()
    assert {node.status for node in tree.nodes} == {Status.INVALID}


class Grumbles(Node):
    """Runs, and fails to clean up."""

    def update(self) -> Status:
        return Status.RUNNING

    def terminate(self, _new_status: Status) -> None:
        raise NodeError("the brush is gone")


def test_several_that_cannot_clean_up_leave_the_rest_of_the_tree_alone(load: Load) -> None:
    """Two NodeErrors in one halt: the Fallback goes on to its next child."""
    late = '<Sequence><Sleep msec="1"/><AlwaysFailure/></Sequence>'
    parallel = f'<Parallel failure_count="1"><Grumbles/><Grumbles/>{late}</Parallel>'
    clock = ManualClock()
    tree = load(f'<Fallback>{parallel}<AlwaysSuccess name="next"/></Fallback>', Grumbles, clock=clock)
    assert tree.tick() is Status.RUNNING
    clock.sleep_until(1.0)
    assert tree.tick() is Status.SUCCESS
    assert {node.feedback_message for node in tree.nodes if isinstance(node, Grumbles)} == {"the brush is gone"}
