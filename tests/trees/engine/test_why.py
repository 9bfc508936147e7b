"""Why a tree ended, or goes on: from the root down to the node that decided, for every node of the language."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.hooks import Hook, Hooks, Mode
from btxml.engine.node import Control, Node
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.engine.why import reason_of
from btxml.files.compile.registry import Registry
from btxml.files.loader import load_tree

FILE = """<root BTCPP_format="4" main_tree_to_execute="M">
<BehaviorTree ID="M"><Sequence>
{}
</Sequence></BehaviorTree>
<BehaviorTree ID="S"><Fallback>
<Timeout msec="50"><Sleep msec="90"/></Timeout>
<ScriptCondition code="x == 4"/>
</Fallback></BehaviorTree>
</root>"""
WRONG = "ScriptCondition (m.xml:3): '1 == 2' is false"
SLOW_WRONG = '<Sequence><Sleep msec="40"/><ScriptCondition code="1 == 2"/></Sequence>'
LATE = "Timeout (m.xml:3): time is up after 50 ms, while Sleep runs"
FAILS = {
    '<ScriptCondition code="1 == 2"/>': WRONG,
    '<Script code="n := 2"/><ScriptCondition code="n == 3"/>': "ScriptCondition (m.xml:3): 'n == 3' is false, n = 2",
    '<Script code="n := 1"/><UnsetBlackboard key="n"/><ScriptCondition code="n == 1"/>': (
        "ScriptCondition (m.xml:3): nothing has been written to {n} yet"
    ),
    '<RetryUntilSuccessful num_attempts="{n}"><AlwaysSuccess/></RetryUntilSuccessful>': (
        "RetryUntilSuccessful (m.xml:3): has 0 rounds: AlwaysSuccess is never ticked"
    ),
    f'<RetryUntilSuccessful num_attempts="2">{SLOW_WRONG}</RetryUntilSuccessful>': (
        f"{WRONG}; RetryUntilSuccessful (m.xml:3): 2 of 2 rounds"
    ),
    '<Inverter><Sleep msec="60"/></Inverter>': (
        "Sleep (m.xml:3): succeeded; Inverter (m.xml:3): makes that a failure"
    ),
    '<Inverter><Inverter><ScriptCondition code="1 == 2"/></Inverter></Inverter>': (
        f"{WRONG}; Inverter (m.xml:3): makes that a success; Inverter (m.xml:3): makes that a failure"
    ),
    '<ForceFailure><Sleep msec="60"/></ForceFailure>': (
        "Sleep (m.xml:3): succeeded; ForceFailure (m.xml:3): always fails, whatever is below it"
    ),
    '<Precondition if="1 == 2" else="FAILURE"><Sleep msec="60"/></Precondition>': (
        "Precondition (m.xml:3): '1 == 2' is false"
    ),
    '<Script code="n := 2"/><Sleep msec="60" _failureIf="n == 2"/>': (
        "Sleep (m.xml:3): _failureIf: 'n == 2' is true, n = 2"
    ),
    '<Timeout msec="50"><Sleep msec="900"/></Timeout>': LATE,
    '<Fallback><Timeout msec="50"><Sleep msec="900"/></Timeout><Sleep msec="40"/></Fallback>'
    '<ScriptCondition code="1 == 2"/>': WRONG,
    '<Fallback><ScriptCondition code="1 == 2"/><Timeout msec="50"><Sleep msec="900"/></Timeout></Fallback>': (
        f"{LATE}; also {WRONG}"
    ),
    f'<Fallback>{SLOW_WRONG}<ForceFailure><Sleep msec="40"/></ForceFailure></Fallback>': WRONG,
    f'<Fallback>{SLOW_WRONG}<Sequence><Sleep msec="40"/><AlwaysFailure/></Sequence></Fallback>': WRONG,
    '<AlwaysFailure name="given up"/>': "AlwaysFailure 'given up' (m.xml:3): always fails",
    f'<Parallel failure_count="2" success_count="2">{SLOW_WRONG}<Sleep msec="900"/>'
    '<Timeout msec="50"><Sleep msec="900"/></Timeout></Parallel>': (
        f"{LATE}; Parallel (m.xml:3): 2 of 3 failed: 2 must succeed, 2 may not fail; also {WRONG}"
    ),
    f'<ParallelAll max_failures="1">{SLOW_WRONG}<Sleep msec="200"/></ParallelAll>': (
        f"{WRONG}; ParallelAll (m.xml:3): 1 of 2 failed: 1 may not fail"
    ),
    '<IfThenElse><ScriptCondition code="1 == 2"/><AlwaysSuccess/></IfThenElse>': (
        f"{WRONG}; IfThenElse (m.xml:3): has no branch for that, and fails"
    ),
    '<Script code="n := 0"/><WhileDoElse><ScriptCondition code="(n += 1) &lt; 3"/><Sleep msec="900"/></WhileDoElse>': (
        "ScriptCondition (m.xml:3): '(n += 1) < 3' is false, n = 3; "
        "WhileDoElse (m.xml:3): has no branch for that, and fails"
    ),
    f'<TryCatch>{SLOW_WRONG}<Sleep msec="200"/></TryCatch>': WRONG,
    '<Switch2 variable="2" case_1="1" case_2="2"><AlwaysSuccess/><ScriptCondition code="1 == 2"/><AlwaysSuccess/>'
    "</Switch2>": f"{WRONG}; Switch2 (m.xml:3): its variable is '2'",
    f'<RetryUntilSuccessful num_attempts="3"><RunOnce then_skip="false">{SLOW_WRONG}</RunOnce>'
    "</RetryUntilSuccessful>": (
        f"{WRONG}; RunOnce (m.xml:3): did so the only time that it was ticked; "
        "RetryUntilSuccessful (m.xml:3): 3 of 3 rounds"
    ),
    '<LoopInt queue="1;2" value="{v}"><ScriptCondition code="v &lt; 2"/></LoopInt>': (
        "ScriptCondition (m.xml:3): 'v < 2' is false, v = 2"
    ),
    '<LoopInt queue="" value="{v}" if_empty="FAILURE"><AlwaysSuccess/></LoopInt>': (
        "LoopInt (m.xml:3): the queue is empty, so it failed"
    ),
    '<SubTree ID="S" x="3"/>': (
        "ScriptCondition (m.xml:7): 'x == 4' is false, x = 3; "
        "also Timeout (m.xml:6): time is up after 50 ms, while Sleep runs"
    ),
    '<Script code="n := 0"/><ReactiveSequence><ScriptCondition code="(n += 1) &lt; 3"/><Sleep msec="900"/>'
    "</ReactiveSequence>": "ScriptCondition (m.xml:3): '(n += 1) < 3' is false, n = 3",
    '<Script code="n := 1"/><WasEntryUpdated entry="{n}"/><Inverter><WasEntryUpdated entry="{n}"/></Inverter>': (
        "WasEntryUpdated (m.xml:3): {n} was written since it was asked last; Inverter (m.xml:3): makes that a failure"
    ),
    '<Script code="n := 0"/><KeepRunningUntilFailure><ScriptCondition code="(n += 1) &lt; 3"/>'
    "</KeepRunningUntilFailure>": "ScriptCondition (m.xml:3): '(n += 1) < 3' is false, n = 3",
}  # fmt: skip


class Silent(Node):
    """Succeeds where the lid is closed."""

    lid = InputPort(str, default="open")

    def update(self) -> Status:
        return Status.FAILURE


class Needs(Node):
    """Says what it needs."""

    def update(self) -> Status:
        self.feedback_message, self.what_if = "p4 is full", "if p4 were seen empty"
        return Status.FAILURE


class Stands(Node):
    """Says of all its kind what would let it succeed."""

    what_if = "if the arm stood"
    stands = InputPort(bool)

    def update(self) -> Status:
        return Status.SUCCESS if self.stands.get() else Status.FAILURE


class Talks(Node):
    """Runs, and says what it does."""

    def update(self) -> Status:
        self.feedback_message = "moving above o3"
        return Status.RUNNING


class AtMost(Control):
    """Fails where more than one child succeeded; says so."""

    def run(self) -> Status:
        good = sum(child.execute() is Status.SUCCESS for child in self.children)
        self.feedback_message = f"{good} succeeded" if good > 1 else ""
        return Status.SUCCESS if good == 1 else Status.FAILURE


def loaded(folder: Path, body: str, classes: tuple[type, ...] = ()) -> tuple[Tree, ManualClock]:
    file, clock = folder / "m.xml", ManualClock()
    file.write_text(FILE.format(body))
    tree = load_tree(file, Registry(classes), provided={"n": 0} if "{n}" in body and "Script" not in body else {})
    tree.setup(None, clock)
    return tree, clock


def ended(tree: Tree, clock: ManualClock, most: int = 60) -> Status:
    for _ in range(most):
        status = tree.tick()
        if status in (Status.SUCCESS, Status.FAILURE):
            return status
        clock.sleep_until(clock.now_s() + 0.04)
    return status


@pytest.mark.parametrize(("body", "told"), FAILS.items())
def test_a_failure_is_told_from_the_root_down(tmp_path: Path, body: str, told: str) -> None:
    tree, clock = loaded(tmp_path, body)
    assert ended(tree, clock) is Status.FAILURE
    why = tree.why()
    assert str(why) == told
    assert why is not None
    assert why.steps[0].path == tree.root.full_path
    assert reason_of(json.loads(json.dumps(why.plain()))) == why


def test_what_a_timeout_halted_is_told_with_its_words(tmp_path: Path) -> None:
    tree, clock = loaded(tmp_path, '<Timeout msec="50"><Talks/></Timeout>', (Talks,))
    ended(tree, clock)
    assert str(tree.why()) == "Timeout (m.xml:3): time is up after 50 ms, while Talks runs (moving above o3)"


def test_the_values_are_those_of_the_moment_in_which_it_decided(tmp_path: Path) -> None:
    later = '<Sequence><Script code="n := 7"/><AlwaysFailure/></Sequence>'
    body = f'<Script code="n := 2"/><Fallback><ScriptCondition code="n == 3"/>{later}</Fallback>'
    tree, clock = loaded(tmp_path, body)
    ended(tree, clock)
    assert str(tree.why()) == "ScriptCondition (m.xml:3): 'n == 3' is false, n = 2"


def test_a_node_of_ones_own_is_told_by_its_words_or_by_what_it_is(tmp_path: Path) -> None:
    for body, told, otherwise in (
        ("<Silent/>", "Silent (m.xml:3): failed without a word: Succeeds where the lid is closed", ""),
        ("<Needs/>", "Needs (m.xml:3): p4 is full", "if p4 were seen empty"),
        ("<AtMost><AlwaysSuccess/><AlwaysSuccess/></AtMost>", "AtMost (m.xml:3): 2 succeeded", ""),
        ("<AtMost><Needs/></AtMost>", "Needs (m.xml:3): p4 is full", "if p4 were seen empty"),
    ):
        tree, clock = loaded(tmp_path, body, (Silent, Needs, AtMost))
        ended(tree, clock)
        why = tree.why()
        assert why is not None
        assert (str(why), why.otherwise) == (told, otherwise)


def test_what_would_have_changed_it_is_told(tmp_path: Path) -> None:
    for body, otherwise in (
        ('<Script code="n := 2"/><ScriptCondition code="n == 3"/>', "if 'n == 3' were true"),
        ('<Timeout msec="50"><Sleep msec="900"/></Timeout>', "if Sleep had ended within 50 ms"),
        ('<ScriptCondition code="1 == 2"/>', ""),
    ):
        tree, clock = loaded(tmp_path, body)
        ended(tree, clock)
        why = tree.why()
        assert why is not None
        assert why.otherwise == otherwise


def test_a_monitor_that_answered_in_a_nodes_place_is_named(tmp_path: Path) -> None:
    tree, clock = loaded(tmp_path, '<Sleep msec="60"/>')
    Hooks(tree, lambda _: None).insert(Hook(2, mode=Mode.REPLACE, desired_status="FAILURE"))
    assert ended(tree, clock) is Status.FAILURE
    assert str(tree.why()) == "Sleep (m.xml:3): a monitor answered FAILURE in its place"


def test_while_it_runs_the_sentence_names_what_runs_and_what_let_it(tmp_path: Path) -> None:
    for body, told in (
        ('<Sleep msec="900"/>', "Sleep (m.xml:3): waits 900 ms"),
        (
            '<Fallback><ScriptCondition code="1 == 2"/><Sleep msec="900"/></Fallback>',
            f"Sleep (m.xml:3): waits 900 ms; as {WRONG}",
        ),
        (
            '<Parallel><Sleep msec="800"/><Sleep msec="900"/></Parallel>',
            "Sleep (m.xml:3): waits 900 ms",
        ),
        ('<Delay delay_msec="500"><Silent/></Delay>', "Delay (m.xml:3): waits 500 ms before Silent"),
    ):
        tree, clock = loaded(tmp_path, body, (Silent,))
        assert tree.why() is None
        assert ended(tree, clock, 2) is Status.RUNNING
        assert str(tree.why()) == told


def test_what_would_let_a_node_succeed_is_told_where_it_did_not(tmp_path: Path) -> None:
    found = []
    for stands in ("true", "false"):
        tree, clock = loaded(tmp_path, f'<Stands stands="{stands}"/>', (Stands,))
        ended(tree, clock)
        reason = tree.why()
        found.append("" if reason is None else reason.otherwise)
    assert found == ["", "if the arm stood"]


def test_what_changes_nothing_has_no_word_in_what_would(tmp_path: Path) -> None:
    again = "KeepRunningUntilFailure"
    beside = f'<{again}><ForceSuccess><Stands stands="false"/></ForceSuccess></{again}>'
    tree, clock = loaded(tmp_path, f'<Parallel success_count="2">{beside}<Talks/></Parallel>', (Stands, Talks))
    ended(tree, clock, 2)
    reason = tree.why()
    assert reason is not None
    assert (str(reason), reason.otherwise) == ("Talks (m.xml:3): moving above o3", "")
