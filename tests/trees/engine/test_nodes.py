"""Nodes of the language that the comparison with BehaviorTree.CPP cannot reach: time, queues, switches, clean-up."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from bracket_cell.recording.schemas import plain
from bracket_ground.errors import InputError
from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.node import SKIPPED, Node
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from tests.trees.conftest import Load


class Steps(Node):
    """Answers one letter a tick, and notes when it is halted."""

    answers = InputPort(str, "like RRS", default="R")
    halts = 0
    ticks = 0

    def update(self) -> Status:
        letters = self.answers.get()
        self.ticks += 1
        letter = letters[(self.ticks - 1) % len(letters)]
        return {"S": Status.SUCCESS, "F": Status.FAILURE, "R": Status.RUNNING, "K": SKIPPED}[letter]

    def terminate(self, new_status: Status) -> None:
        self.halts += new_status is Status.INVALID


class Fill(Node):
    """Writes a queue."""

    queue = OutputPort(list[int], "")

    def update(self) -> Status:
        self.queue.set([1, 2, 3])
        return Status.SUCCESS


def run(tree: Tree, clock: ManualClock, ticks: int, period_s: float = 0.125) -> str:
    letters = ""
    for _ in range(ticks):
        letters += {"SUCCESS": "S", "FAILURE": "F", "RUNNING": "R", "SKIPPED": "K"}[tree.tick().name]
        clock.sleep_until(clock.now_s() + period_s)
    return letters


def ticked(load: Load, nodes: str, ticks: int) -> str:
    clock = ManualClock(5.0)
    return run(load(nodes, Steps, Fill, clock=clock), clock, ticks)


def leaf(tree: Tree) -> Steps:
    return next(node for node in tree.nodes if isinstance(node, Steps))


def test_timeout_reads_the_injected_clock_and_halts_its_child(load: Load) -> None:
    clock = ManualClock(5.0)
    tree = load('<Timeout msec="250"><Steps/></Timeout>', Steps, clock=clock)
    assert run(tree, clock, 5) == "RRFRR"
    assert leaf(tree).halts == 1


def test_timeout_lets_a_child_finish(load: Load) -> None:
    assert ticked(load, '<Timeout msec="300"><Steps answers="RRS"/></Timeout>', 6) == "RRSRRS"


def test_delay_waits_before_the_first_tick_of_each_round(load: Load) -> None:
    assert ticked(load, '<Delay delay_msec="200"><Steps answers="RS"/></Delay>', 8) == "RRRSRRRS"


def test_sleep_runs_for_its_time(load: Load) -> None:
    assert ticked(load, '<Sleep msec="250"/>', 6) == "RRSRRS"


@pytest.mark.parametrize(
    ("start", "child"),
    [("v := 'b'", 1), ("v := 'c'", 2), ("v := 2", 3), ("v := 2.0", 3), ("v := 'SKIPPED'", 4), ("v := 'x'", 5)],
)
def test_switch_compares_strings_numbers_and_names(load: Load, start: str, child: int) -> None:
    scripts = "".join(f'<Script code="hit := {i}"/>' for i in range(1, 6))
    cases = 'case_1="b" case_2="c" case_3="2" case_4="SKIPPED"'
    tree = load(f'<Sequence><Script code="{start}"/><Switch4 variable="{{v}}" {cases}>{scripts}</Switch4></Sequence>')
    tree.tick()
    assert tree.blackboard.values()["hit"] == child


def test_switch_halts_the_branch_that_it_leaves(load: Load) -> None:
    nodes = (
        '<Parallel success_count="2"><Switch2 variable="{v}" case_1="0" case_2="1">'
        '<Steps/><Steps answers="S"/><AlwaysFailure/></Switch2><Script code="v := 1"/></Parallel>'
    )
    tree = load(nodes, Steps)
    tree.blackboard.entry("v").value = 0
    assert [tree.tick(), tree.tick()] == [Status.RUNNING, Status.SUCCESS]
    assert leaf(tree).halts == 1


@pytest.mark.parametrize("kind", ["Int", "Double", "String", "Bool"])
def test_loop_ticks_its_child_for_every_item(load: Load, kind: str) -> None:
    items = "true;false" if kind == "Bool" else "1;2"
    nodes = f'<Loop{kind} queue="{items}" value="{{v}}"><Script code="@n := v"/></Loop{kind}>'
    assert ticked(load, nodes, 6) == "RRSRRS"


def test_loop_uses_up_the_queue_of_an_entry(load: Load) -> None:
    nodes = (
        '<Sequence><Fill queue="{q}"/><Script code="sum := 0"/>'
        '<LoopInt queue="{q}" value="{v}" if_empty="FAILURE"><Script code="sum += v"/></LoopInt></Sequence>'
    )
    tree = load(nodes, Fill)
    assert [tree.tick() for _ in range(4)] == [Status.RUNNING] * 3 + [Status.FAILURE]
    assert (tree.blackboard.values()["sum"], tree.blackboard.values()["q"]) == (6, [])


def test_updates_are_seen_once(load: Load) -> None:
    nodes = (
        '<Sequence><Script code="n := 0; seen := 0"/><SkipUnlessUpdated entry="{n}"><Script code="seen += 1"/>'
        '</SkipUnlessUpdated><ForceSuccess><Sequence><WasEntryUpdated entry="n"/><Script code="seen += 10"/></Sequence>'
        '</ForceSuccess><WaitValueUpdate entry="{n}"><Script code="seen += 100"/></WaitValueUpdate></Sequence>'
    )
    tree = load(nodes)
    assert tree.tick() is Status.SUCCESS
    assert tree.blackboard.values()["seen"] == 111


def test_wait_value_update_waits(load: Load) -> None:
    model = '<TreeNodesModel><SubTree ID="Main"><inout_port name="n"/></SubTree></TreeNodesModel>'
    nodes = '<WaitValueUpdate entry="{n}"><Script code="n = 5" _post="done := 1"/></WaitValueUpdate>'
    tree = load(nodes, more=model)
    assert tree.tick() is Status.RUNNING
    tree.blackboard.entry("n").write(1)
    assert tree.tick() is Status.SUCCESS
    assert tree.blackboard.values() == {"n": 5, "done": 1}


def test_try_catch_cleans_up_and_fails(load: Load) -> None:
    assert (
        ticked(load, '<TryCatch><AlwaysSuccess/><Steps answers="RF"/><Steps answers="RS"/></TryCatch>', 6) == "RRFRRF"
    )
    assert ticked(load, "<TryCatch><AlwaysSuccess/><AlwaysFailure/></TryCatch>", 2) == "SS"


def test_try_catch_cleans_up_when_halted(load: Load) -> None:
    tree = load('<TryCatch catch_on_halt="true"><Steps/><Script code="cleaned := 1"/></TryCatch>', Steps)
    tree.tick()
    tree.halt()
    assert tree.blackboard.values() == {"cleaned": 1}
    assert {node.status for node in tree.nodes} == {Status.INVALID}


def test_a_skipped_repeat_counts_anew(load: Load) -> None:
    assert ticked(load, '<Repeat num_cycles="2"><Steps answers="SKSS"/></Repeat>', 4) == "RKRS"


@pytest.mark.parametrize("tag", ["IfThenElse", "WhileDoElse"])
def test_a_skipped_condition_skips_the_choice(load: Load, tag: str) -> None:
    nodes = f'<Fallback><{tag}><AlwaysSuccess _skipIf="true"/><AlwaysFailure/></{tag}><AlwaysSuccess/></Fallback>'
    assert ticked(load, nodes, 1) == "S"


def test_thresholds_that_cannot_be_reached_fail(load: Load) -> None:
    tree = load('<Parallel success_count="3"><AlwaysSuccess/><AlwaysSuccess/></Parallel>')
    assert tree.tick() is Status.FAILURE
    assert "2 children can neither succeed 3 times" in tree.root.feedback_message


def test_while_halts_a_running_node(load: Load) -> None:
    both = '<Parallel><Steps _while="n == 0"/><Script code="n := 1"/></Parallel>'
    nodes = f'<Sequence><Script code="n := 0"/>{both}</Sequence>'
    tree = load(nodes, Steps)
    assert tree.tick() is Status.RUNNING
    tree.blackboard.entry("n").write(1)
    assert tree.tick() is Status.SUCCESS
    assert leaf(tree).halts == 1


def test_a_failing_condition_script_fails_the_node(load: Load) -> None:
    tree = load('<Sequence><Script code="n := 0"/><UnsetBlackboard key="n"/><Steps _while="n == 0"/></Sequence>', Steps)
    assert tree.tick() is Status.FAILURE
    assert leaf(tree).feedback_message == "nothing has been written to {n} yet"
    assert leaf(tree).halts == 0


def test_changes_tell_paths_numbers_and_feedback(load: Load) -> None:
    tree = load('<Sequence name="top"><SubTree ID="In" name="inner"/></Sequence>', Steps, more=IN)
    tree.tick()
    assert [(change.path, change.uid, change.old.name, change.new.name) for change in tree.status_changes] == [
        ("top", 1, "INVALID", "RUNNING"),
        ("inner", 2, "INVALID", "RUNNING"),
        ("inner/Steps::3", 3, "INVALID", "RUNNING"),
    ]
    tree.tick()
    assert tree.status_changes == []
    tree.halt()
    assert {change.new for change in tree.status_changes} == {Status.INVALID}


def test_a_skipped_node_is_told_once_and_counts_as_idle(load: Load) -> None:
    steps = '<ReactiveSequence><Steps _skipIf="n == 0"/><Steps name="last"/></ReactiveSequence>'
    tree = load(f'<Sequence><Script code="n := 0"/>{steps}</Sequence>', Steps)
    told = []
    for n in (0, 0, 1):
        tree.blackboard.entry("n").write(n)
        tree.tick()
        told.append(
            [
                (status_change.old.name, status_change.new.name)
                for status_change in tree.status_changes
                if status_change.path == "Steps::4"
            ]
        )
    assert told == [[("INVALID", "SKIPPED")], [], [("SKIPPED", "RUNNING")]]
    tree.halt()
    assert {node.status for node in tree.nodes} == {Status.INVALID}


def test_a_leaf_learns_whether_it_was_skipped_or_halted(load: Load) -> None:
    class Notes(Steps):
        """Notes by what it was ended."""

        abstract = False
        ended = ""

        def terminate(self, new_status: Status) -> None:
            self.ended += {"SKIPPED": "K", "INVALID": "H"}[new_status.name]

    tree = load('<Notes answers="KR"/>', Notes)
    assert tree.tick() is SKIPPED
    assert tree.tick() is Status.RUNNING
    tree.halt()
    assert [node.ended for node in tree.nodes if isinstance(node, Notes)] == ["KH"]


def test_a_new_feedback_of_a_running_leaf_is_a_change(load: Load) -> None:
    class Talks(Node):
        """Says how far it is."""

        count = 0

        def update(self) -> Status:
            self.count += 1
            self.feedback_message = f"step {self.count // 2}"
            return Status.RUNNING

    tree = load("<Talks/>", Talks)
    told = []
    for _ in range(4):
        tree.tick()
        told.append([(change.old.name, change.feedback) for change in tree.status_changes])
    assert told == [[("INVALID", "step 0")], [("RUNNING", "step 1")], [], [("RUNNING", "step 2")]]


def test_the_same_change_is_the_same_object_and_is_encoded_once(load: Load) -> None:
    tree = load('<KeepRunningUntilFailure><AlwaysSuccess name="&lt;&quot;ä"/></KeepRunningUntilFailure>')
    told = []
    for _ in range(3):
        tree.tick()
        told.append(tree.status_changes)
        assert [json.loads(change.json) for change in told[-1]] == plain(told[-1])
    assert len(told[1]) == 2
    assert [id(change) for change in told[1]] == [id(change) for change in told[2]]


def test_feedback_that_is_new_in_every_tick_fills_no_memory(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    class Counts(Node):
        """Says something else in every tick."""

        def update(self) -> Status:
            self.feedback_message = str(int(self.feedback_message or 0) + 1)
            return Status.RUNNING

    monkeypatch.setattr("btxml.engine.tree.CACHE_LIMIT", 5)
    tree = load("<Counts/>", Counts)
    kept = []
    for number in range(1, 20):
        tree.tick()
        assert [change.feedback for change in tree.status_changes] == [str(number)]
        kept.append(len(tree._change_cache))
    assert max(kept) <= 6


def test_texts_of_all_files_are_kept_for_the_log(load: Load, tmp_path: Path) -> None:
    assert list(load("<AlwaysSuccess/>").texts) == [tmp_path / "tree.xml"]


IN = '<BehaviorTree ID="In"><Steps/></BehaviorTree>'


class Careless(Node):
    """Raises where it is asked to, and tells things that are no texts."""

    where = InputPort(str, "a method, or 'words'")

    def __init__(self, name: str) -> None:
        if name == "made":
            raise ZeroDivisionError("made")
        super().__init__(name)

    def _maybe(self, here: str) -> None:
        if self.where.get() == here:
            raise KeyError(here)

    def prepare(self) -> None:
        self._maybe("prepare")

    def initialise(self) -> None:
        self._maybe("initialise")

    def update(self) -> Status:
        self._maybe("update")
        self.feedback_message = ValueError("an error")  # type: ignore[assignment]
        self.what_if = b"bytes"  # type: ignore[assignment]
        return Status.FAILURE

    def terminate(self, new_status: Status) -> None:  # noqa: ARG002
        self._maybe("terminate")


@pytest.mark.parametrize("where", ["prepare", "initialise", "update", "terminate"])
def test_what_a_leaf_raises_names_the_leaf_and_its_line(load: Load, where: str) -> None:
    with pytest.raises(KeyError) as raised:
        load(f'<Inverter><Careless where="{where}"/></Inverter>', Careless).tick()
    (note,) = raised.value.__notes__
    assert re.fullmatch(r"in Careless \(\w+\.xml:\d+\), test_nodes\.py:\d+", note)


def test_a_leaf_that_cannot_be_made_is_a_mistake_of_its_line(load: Load) -> None:
    with pytest.raises(
        InputError, match=r"\.xml:\d+:\d+: Careless cannot be made: ZeroDivisionError: made; its __init"
    ):
        load('<Careless name="made" where=""/>', Careless)


def test_words_that_are_no_texts_are_told_as_texts(load: Load) -> None:
    tree = load('<Careless where="words"/>', Careless)
    assert tree.tick() is Status.FAILURE
    (change, *_) = (change for change in tree.status_changes if change.feedback)
    assert json.loads(change.json)["feedback"] == "an error"
    why = tree.why()
    assert why is not None
    assert (why.leaf.words, why.leaf.otherwise) == ("an error", "b'bytes'")
