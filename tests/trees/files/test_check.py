"""Every mistake in a tree file is reported at its line and column, all at once."""

from __future__ import annotations

import cProfile
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from bracket_cell.trees.vocabulary import Hole, Part
from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.controls import ReactiveSequence
from btxml.engine.errors import TreeFileError
from btxml.engine.node import Control, Decorator, Node
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits
from btxml.files.check import check, findings
from btxml.files.compile.registry import Registry
from btxml.files.loader import load_tree

Write = Callable[..., Path]


class Place:
    """A type that cannot be written in a file."""


class See(Node):
    """Writes a place."""

    place = OutputPort(Place, "where")
    count = OutputPort(int, "how many")

    def update(self) -> Status:
        return Status.SUCCESS


class Go(Node):
    """Reads a place."""

    place = InputPort(Place, "where to")
    speed = InputPort(float, "in [m/s]", default=0.1)

    def update(self) -> Status:
        return Status.SUCCESS


class Put(Node):
    """Must not run without a guard."""

    traits = Traits(needs_guard=True)

    def update(self) -> Status:
        return Status.SUCCESS


class Allow(Node):
    """A guard."""

    traits = Traits(guards=True, instant=True)

    def update(self) -> Status:
        return Status.SUCCESS


REGISTRY = Registry([See, Go, Put, Allow])

# The mark ^ stands where the mistake must be reported.
BAD_NODES = [
    ("^<Sequense><AlwaysSuccess/></Sequense>", "there is no node 'Sequense'; did you mean 'Sequence'"),
    ("^<sequence><AlwaysSuccess/></sequence>", "did you mean 'Sequence'"),
    ("^<SequenceStar><AlwaysSuccess/></SequenceStar>", "no node 'SequenceStar'; did you mean 'SequenceWithMemory'"),
    ("^<BlackboardCheckInt/>", "there is no node 'BlackboardCheckInt'; use Precondition"),
    ("^<Xyzzy/>", "there is no node 'Xyzzy'; `cell nodes` lists all nodes"),
    ('<Action ^ID="Goo"/>', "there is no node 'Goo'; did you mean 'Go'"),
    ("^<Action/>", "this <Action> has no ID"),
    ("^<Sequence/>", "Sequence has 0 children; it takes at least 1"),
    ("^<Inverter/>", "Inverter has 0 children; it takes 1"),
    ("^<Inverter><AlwaysSuccess/><AlwaysSuccess/></Inverter>", "Inverter has 2 children; it takes 1"),
    ("^<AlwaysSuccess><AlwaysSuccess/></AlwaysSuccess>", "AlwaysSuccess has 1 child; it takes 0"),
    ("^<IfThenElse><AlwaysSuccess/></IfThenElse>", "IfThenElse has 1 child; it takes 2 to 3"),
    ('^<Switch2 variable="{=}" case_1="a" case_2="b"><AlwaysSuccess/></Switch2>', "Switch2 has 1 child; it takes 3"),
    ("^<Repeat><AlwaysSuccess/></Repeat>", "Repeat needs port 'num_cycles'; num_cycles: int or {entry}"),
    ("^<Go/>", "Go needs port 'place'; place: an entry"),
    (
        '<Repeat ^cycles="3" num_cycles="1"><AlwaysSuccess/></Repeat>',
        "Repeat has no port 'cycles'; did you mean 'num_cy",
    ),
    ('<AlwaysSuccess ^ID="x"/>', "AlwaysSuccess has no port 'ID'"),
    ('<Repeat num_cycles="^three"><AlwaysSuccess/></Repeat>', "'three' is not an int; like 42"),
    ('<Repeat num_cycles="^1.5"><AlwaysSuccess/></Repeat>', "'1.5' is not an int"),
    ('<RunOnce then_skip="^maybe"><AlwaysSuccess/></RunOnce>', "'maybe' is not a bool; true or false"),
    (
        '<Precondition if="true" else="^FAIL"><AlwaysSuccess/></Precondition>',
        "'FAIL' is not a valid Status; one of SUCCESS, FAIL",
    ),
    ('<LoopInt queue="^1;x" value="{v}"><AlwaysSuccess/></LoopInt>', "'x' is not an int"),
    ('<Go ^place="home"/>', "port 'place' takes a Place, which cannot be written here; connect it"),
    ('<See ^count="5"/>', "port 'count' is an output and '5' is not an entry"),
    ('<See count="^{}"/>', "'' is not the name of an entry"),
    ('<See count="^{a b}"/>', "'a b' is not the name of an entry"),
    ('<Sequence><See place="{p}"/><Go place="{p}" speed="^fast"/></Sequence>', "'fast' is not a float; like 0.5"),
    ('<Go ^place="{nowhere}"/>', "port 'place' of Go reads {nowhere}, which nothing writes"),
    ('<Sequence><See count="{p}"/><Go ^place="{p}"/></Sequence>', "takes {p} as Place; port 'count' of See at"),
    ('<AlwaysSuccess ^_skipif="true"/>', "there is no attribute '_skipif' here; did you mean '_skipIf'"),
    ('<AlwaysSuccess ^_autoremap="true"/>', "there is no attribute '_autoremap' here"),
    ('<Script code="a := ^"/>', "bad script: the script ends where a number"),
    ('<Script code="a := 1 ^b"/>', "bad script: 'b' stands where an operator or ';' is expected"),
    ('<Script code="a := (1 + 2^"/>', "bad script: the script ends where ')' is expected"),
    ('<Script code="a := ^\'open"/>', "bad script: the text 'open has no end; close it with '"),
    ('<Script code="1 ^:= 2"/>', "bad script: ':=' needs a name on its left"),
    ('<Script code="a := 1 ^# 2"/>', "bad script: '#' has no meaning here"),
    ('<Script code="^"/>', "bad script: the script is empty"),
    ('<Script code="^SUCCESS := 1"/>', "'SUCCESS' is an enum name and cannot be written"),
    ('<Script code="a := true ? 1 ^"/>', "the script ends where ':' is expected"),
    ('<AlwaysSuccess _while="a &lt; ^"/>', "bad script: the script ends"),
    ('<ScriptCondition code="^missing &gt; 1"/>', "'code' of ScriptCondition reads {missing}, which nothing writes"),
    ('<AlwaysSuccess _skipIf="1 == ^missing"/>', "'_skipIf' of AlwaysSuccess reads {missing}"),
    ('<SubTree ^ID="Othr"/>', "there is no BehaviorTree 'Othr'; did you mean 'Other'"),
    ("^<SubTree/>", "this SubTree has no ID; legal: Main, Other"),
    ('<SubTree ID="Other">^<AlwaysSuccess/></SubTree>', "a SubTree has no children here"),
    ('<SubTree ID="Other" _autoremap="^yes"/>', "'yes' is not a bool"),
    ('<SubTree ID="Other" x="^{a b}"/>', "'a b' is not the name of an entry"),
    ('^<SubTree ID="Main"/>', "this SubTree contains itself: Main > Main"),
    ("<Sequence>\n  <AlwaysSuccess/>\n\t^<Oops/>\n</Sequence>", "there is no node 'Oops'"),
    ('<!-- äöü --><Sequence name="äöü">^<Oops/><AlwaysSuccess/></Sequence>', "there is no node 'Oops'"),
    (
        "<ReactiveSequence><AsyncSequence><AlwaysSuccess/></AsyncSequence>^<AsyncSequence><AlwaysSuccess/></AsyncSequence>"
        "</ReactiveSequence>",
        "ReactiveSequence has a second asynchronous child",
    ),
    (
        "<Fallback><AlwaysSuccess/>^<Allow/></Fallback>",
        "Allow is never ticked: AlwaysSuccess at line 2 before it always",
    ),
    (
        "<Sequence><ForceFailure><Allow/></ForceFailure>^<Allow/></Sequence>",
        "ForceFailure at line 2 before it always f",
    ),
    (
        "<Sequence><KeepRunningUntilFailure><ForceSuccess><Allow/></ForceSuccess></KeepRunningUntilFailure>^<Allow/>"
        "</Sequence>",
        "Allow is never ticked: KeepRunningUntilFailure at line 2 before it never ends",
    ),
    (
        '<ReactiveSequence><Repeat num_cycles="-1"><Allow/></Repeat>^<Allow/></ReactiveSequence>',
        "Repeat at line 2 before it always fails",
    ),
    (
        '<Fallback><RetryUntilSuccessful num_attempts="-1"><Allow/></RetryUntilSuccessful>^<Allow/></Fallback>',
        "RetryUntilSuccessful at line 2 before it always succeeds",
    ),
    (
        '<Fallback><SubTree ID="Other"/>^<Allow/></Fallback>',
        "Allow is never ticked: SubTree at line 2 before it always",
    ),
    ("<IfThenElse><AlwaysFailure/>^<Allow/><Allow/></IfThenElse>", "AlwaysFailure at line 2 before it always fails"),
    ("<WhileDoElse><AlwaysSuccess/><Allow/>^<Allow/></WhileDoElse>", "AlwaysSuccess at line 2 before it always succ"),
    (
        "^<Put/>",
        "Put runs without a guard that is asked in every tick; put it into a ReactiveSequence behind one of: Allow",
    ),
    ("<Sequence><Allow/>^<Put/></Sequence>", "Put runs without a guard that is asked in every tick"),
    ("<ReactiveSequence>^<Put/><Allow/></ReactiveSequence>", "Put runs without a guard"),
    ("<ReactiveSequence><ForceSuccess><Allow/></ForceSuccess>^<Put/></ReactiveSequence>", "Put runs without a guard"),
    ('<ReactiveSequence><Allow _skipIf="1 &gt; 2"/>^<Put/></ReactiveSequence>', "Put runs without a guard"),
    (
        '<ReactiveSequence><Fallback><Script code="a := 1"/><Allow/></Fallback>^<Put/></ReactiveSequence>',
        "Put runs without a guard",
    ),
    ("<WhileDoElse><Allow/><AlwaysSuccess/>^<Put/></WhileDoElse>", "Put runs without a guard"),
    (
        '<Sequence><Go ^place="{p}"/><See place="{p}"/></Sequence>',
        "port 'place' of Go reads {p} before anything has written it; port 'place' of See at ",
    ),
    (
        "<Sequence><Script code=\"n := ^m; m := 1\"/><Script code='m := 2'/></Sequence>",
        "'code' of Script reads {m} before",
    ),
    ('<Script code="^n += 1"/>', "reads {n} before anything has written it; give it a first value before"),
    ('<Script code="^n = 1"/>', "assigns {n} before anything has made it; write :=, which makes it"),
    ('<Repeat num_cycles="^1_0"><AlwaysSuccess/></Repeat>', "'1_0' is not an int"),
    ('<Repeat num_cycles="^٣"><AlwaysSuccess/></Repeat>', "'٣' is not an int"),
    ('<Repeat num_cycles="^99999999999999999999"><AlwaysSuccess/></Repeat>', "is not an int"),
    (
        '<Inverter _while="^n &lt; 3"><Script code="n := 1"/></Inverter>',
        "'_while' of Inverter reads {n} before anything has written it; 'code' of Script at ",
    ),
    (
        '<Sequence><Repeat num_cycles="9"><Script code="^n += 1"/></Repeat><Script code="n := 0"/></Sequence>',
        "'code' of Script reads {n} before anything has written it; 'code' of Script at ",
    ),
    (
        '<Fallback><Repeat num_cycles="3"><Go ^place="{p}"/></Repeat><Sequence><See place="{p}"/><Go place="{p}"/>'
        "</Sequence></Fallback>",
        "port 'place' of Go reads {p} before",
    ),
]
MAIN = '<BehaviorTree ID="Main">{}</BehaviorTree><BehaviorTree ID="Other"><AlwaysSuccess/></BehaviorTree>'
GOOD = '<BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree>'
BAD_FILES = [
    ("^<tree/>", "this is no tree file: its outermost element is <tree>; must be <root>"),
    (f'<root ^BTCPP_format="5">{GOOD}</root>', "BTCPP_format is '5'"),
    (f'<root BTCPP_format="4" ^main_tree="Main">{GOOD}</root>', "did you mean 'main_tree_to_execute'"),
    (f'<root BTCPP_format="4" ^main_tree_to_execute="Mian">{GOOD}</root>', "names 'Mian'.*did you mean 'Main'"),
    (f'<root BTCPP_format="4">^<Behaviortree/>{GOOD}</root>', "<Behaviortree> cannot stand in <root>"),
    (
        f'<root BTCPP_format="4">^<BehaviorTree><AlwaysSuccess/></BehaviorTree>{GOOD}</root>',
        "this BehaviorTree has no ID",
    ),
    ('<root BTCPP_format="4"><BehaviorTree ^id="A"><AlwaysSuccess/></BehaviorTree></root>', "did you mean 'ID'?"),
    ('<root BTCPP_format="4">^<BehaviorTree ID="Main"/></root>', "has 0 nodes directly below it"),
    (f'<root BTCPP_format="4">{GOOD}{GOOD.replace("ID", "^ID")}</root>', "a BehaviorTree 'Main' is already defined at"),
    (
        f'<root BTCPP_format="4">{GOOD.replace("<Be", "^<Be").replace("<Al", "<AlwaysFailure/><Al")}</root>',
        "has 2 nodes",
    ),
    (f'<root BTCPP_format="4">^<include/>{GOOD}</root>', "this include has no path"),
    (f'<root BTCPP_format="4"><include ^path="no.xml"/>{GOOD}</root>', "the included file no.xml cannot be used"),
    (f'<root BTCPP_format="4"><include ^path="../no_such.xml"/>{GOOD}</root>', "cannot be used"),
    (f'<root BTCPP_format="4"><include ^path="/etc/passwd"/>{GOOD}</root>', "cannot be used"),
    (f'<root BTCPP_format="4"><include ^path="bad.xml"/>{GOOD}</root>', "'bad.xml' includes itself"),
    (
        f'<root BTCPP_format="4">{GOOD}<BehaviorTree ID="B">^',
        "the file ends, and <BehaviorTree> of line 1 is not closed; add </BehaviorTree>",
    ),
    (f'<root BTCPP_format="4">{GOOD}^</wrong>', "</wrong> closes <root> of line 1; </root> must come first"),
    (f'<root BTCPP_format="4">{GOOD}^words</root>', "text 'words' stands between elements"),
    (f'^<!DOCTYPE root [<!ENTITY a "b">]><root BTCPP_format="4">{GOOD}</root>', "entities are refused"),
    (
        '<root BTCPP_format="4"><BehaviorTree ID="A"><SubTree ID="B"/></BehaviorTree>'
        '<BehaviorTree ID="B">^<SubTree ID="A"/></BehaviorTree></root>',
        "this SubTree contains itself: A > B > A",
    ),
    (
        '<root BTCPP_format="4" main_tree_to_execute="Main"><TreeNodesModel><SubTree ID="Fetch"><input_port name="part"'
        '/></SubTree></TreeNodesModel><BehaviorTree ID="Main">^<SubTree ID="Fetch"/></BehaviorTree>'
        '<BehaviorTree ID="Fetch"><AlwaysSuccess/></BehaviorTree></root>',
        "SubTree 'Fetch' needs port 'part'",
    ),
    (
        f'<root BTCPP_format="4"><TreeNodesModel><SubTree ID="Main">^<port name="a"/></SubTree></TreeNodesModel>'
        f"{GOOD}</root>",
        "<port> is not a port",
    ),
]


def assert_reported(folder: Path, marked: str, message: str) -> None:
    head = marked[: marked.index("^")]
    line, column = head.count("\n") + 1, len(head) - (head.rfind("\n") + 1) + 1
    path = folder / "bad.xml"
    path.write_text(marked.replace("^", "", 1))
    problems = check([path], REGISTRY)
    first = problems[0]
    assert re.search(message if ".*" in message else re.escape(message), str(first))
    assert (first.place.file.name, first.place.line, first.place.column) == ("bad.xml", line, column)


@pytest.mark.parametrize(("nodes", "message"), BAD_NODES)
def test_bad_nodes_are_reported_where_they_stand(tmp_path: Path, nodes: str, message: str) -> None:
    root = '<root BTCPP_format="4" main_tree_to_execute="Main">\n  '
    assert_reported(tmp_path, root + MAIN.format(nodes) + "</root>", message)


@pytest.mark.parametrize(("text", "message"), BAD_FILES)
def test_bad_files_are_reported_where_they_are_wrong(tmp_path: Path, text: str, message: str) -> None:
    assert_reported(tmp_path, text, message)


def test_all_mistakes_are_reported_at_once_and_in_order(write: Write) -> None:
    nodes = '<Sequence><Oops/><Go speed="x"/><Sequence/><Script code="="/></Sequence>'
    problems = check([write(MAIN.format(nodes))], REGISTRY)
    assert [problem.what.split()[0] for problem in problems] == ["there", "Go", "'x'", "Sequence", "bad"]
    with pytest.raises(TreeFileError) as raised:
        load_tree(problems[0].place.file, REGISTRY)
    assert list(raised.value.problems) == problems


def test_one_mistake_hides_no_other(write: Write) -> None:
    """Names, circles, scripts, guards, reach, order and types are all told of one file, and nothing that follows."""
    nodes = (
        '<Sequence>\n<Oops out="{made}"/>\n<SubTree ID="Round"/>\n<Script code="n := "/>\n<Script code="a = n"/>\n'
        '<Put/>\n<Go place="{made}"/>\n<Go place="{nowhere}"/>\n<AlwaysFailure/>\n<AlwaysSuccess/>\n</Sequence>'
    )
    more = '\n<BehaviorTree ID="Round"><SubTree ID="Round"/></BehaviorTree>'
    root = '<root BTCPP_format="4" main_tree_to_execute="Main">'
    problems = check([write(f'{root}<BehaviorTree ID="Main">{nodes}</BehaviorTree>{more}</root>')], REGISTRY)
    assert [(problem.place.line, problem.what.split()[0]) for problem in problems] == [
        *((2, "there"), (4, "bad"), (5, "'code'"), (6, "Put"), (8, "port"), (10, "AlwaysSuccess"), (12, "this"))
    ]


def test_a_file_that_breaks_off_is_checked_up_to_there(write: Write) -> None:
    text = (
        '<root BTCPP_format="4">\n<BehaviorTree ID="Main">\n<Sequence>\n<Oops/>\n<SubTree ID="Far"/>\n</BehaviorTree>'
    )
    problems = check([write(text)], REGISTRY)
    assert [str(problem).split("tree.xml:")[1] for problem in problems] == [
        "4:1: there is no node 'Oops'; `cell nodes` lists all nodes",
        "6:1: </BehaviorTree> closes <Sequence> of line 3; </Sequence> must come first",
    ]


INNER = '<BehaviorTree ID="Fetch"><Sequence><SubTree ID="Drive" to="{spot}"/></Sequence></BehaviorTree>'
DRIVE = '<BehaviorTree ID="Drive"><Go place="{to}"/></BehaviorTree>'


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            '<SubTree ID="Fetch" ^spott="{p}"/>',
            "SubTree 'Fetch' reads no 'spott'; did you mean 'spot', which port 'place'",
        ),
        ('<SubTree ID="Fetch" ^spto="o1"/>', "SubTree 'Fetch' reads no 'spto'; did you mean 'spot'"),
        ('<SubTree ID="Fetch" ^spot="{q}"/>', "'spot' of SubTree 'Fetch' reads {q}, which nothing writes"),
        ('^<SubTree ID="Fetch"/>', "SubTree 'Fetch' needs 'spot', and nothing passes it; port 'place' of Go at"),
    ],
)
def test_a_mistake_in_a_call_is_told_at_the_call(write: Write, tmp_path: Path, call: str, message: str) -> None:
    write(INNER + DRIVE, "shipped.xml")
    root = '<root BTCPP_format="4" main_tree_to_execute="Main"><include path="shipped.xml"/><BehaviorTree ID="Main">'
    assert_reported(tmp_path, f'{root}<Sequence><See place="{{p}}"/>\n{call}</Sequence></BehaviorTree></root>', message)


def test_mistakes_in_included_files_name_that_file(write: Write) -> None:
    write('<BehaviorTree ID="Part">\n<Oops/></BehaviorTree>', "part.xml")
    path = write('<root BTCPP_format="4" main_tree_to_execute="Main"><include path="part.xml"/>' + GOOD + "</root>")
    (problem,) = check([path], REGISTRY)
    assert str(problem).startswith(f"{path.parent / 'part.xml'}:2:1: there is no node 'Oops'")


def test_types_are_checked_across_subtrees(write: Write) -> None:
    path = write(
        '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence><See count="{n}"/>'
        '<SubTree ID="Inner" p="{n}"/></Sequence></BehaviorTree>\n'
        '<BehaviorTree ID="Inner"><Go place="{p}"/></BehaviorTree></root>'
    )
    (problem,) = check([path], REGISTRY)
    assert (problem.place.line, problem.place.column) == (2, 30)
    assert "as Place" in problem.what


def test_order_is_checked_through_subtrees_and_when_loading(write: Write) -> None:
    path = write(
        '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence>\n'
        '<SubTree ID="Drive" p="{a}"/><See place="{a}"/><SubTree ID="Drive" p="{a}"/></Sequence></BehaviorTree>\n'
        '<BehaviorTree ID="Drive"><Go place="{p}"/></BehaviorTree></root>'
    )
    (problem,) = check([path], REGISTRY)
    assert (problem.place.line, problem.place.column) == (3, 30)
    assert f"port 'place' of See at {path}:2:35 is the first to write it" in str(problem)
    with pytest.raises(TreeFileError, match="before anything has written it"):
        load_tree(path, REGISTRY)


@pytest.mark.parametrize(
    "nodes",
    [
        '<Repeat num_cycles="2"><Fallback><Go place="{p}"/><See place="{p}"/></Fallback></Repeat>',
        '<ReactiveFallback><Go place="{p}"/><See place="{p}"/></ReactiveFallback>',
        '<Parallel><Sequence><Sleep msec="50"/><Go place="{p}"/></Sequence><See place="{p}"/></Parallel>',
        '<Sequence _onSuccess="m := n"><Script code="n := 1"/></Sequence>',
        '<Fallback><WaitValueUpdate entry="{n}"><AlwaysFailure/></WaitValueUpdate><Script code="n := 1"/></Fallback>',
        '<Sequence><Switch2 variable="{n}" case_1="1" case_2="2"><Allow/><Allow/><Allow/></Switch2>'
        '<Script code="n := 1"/></Sequence>',
    ],
)
def test_what_may_be_written_before_is_no_mistake(write: Write, nodes: str) -> None:
    assert check([write(MAIN.format(nodes))], REGISTRY) == []


def test_a_child_that_is_never_ticked_is_refused_when_loading(write: Write) -> None:
    path = write('<BehaviorTree ID="M"><Fallback><AlwaysSuccess/><Allow/></Fallback></BehaviorTree>')
    with pytest.raises(TreeFileError, match="Allow is never ticked"):
        load_tree(path, REGISTRY)


def test_constants_are_checked_against_the_ports_of_a_subtree(write: Write) -> None:
    path = write(
        '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">\n<SubTree ID="Inner" n="many"/>'
        '</BehaviorTree><BehaviorTree ID="Inner"><Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat></BehaviorTree>'
        "</root>"
    )
    (problem,) = check([path], REGISTRY)
    assert (problem.place.line, problem.place.column) == (2, 21)
    assert "'many' is not an int" in problem.what


@pytest.mark.parametrize(
    "nodes",
    [
        "<ReactiveSequence><Allow/><Put/></ReactiveSequence>",
        "<ReactiveSequence><Inverter><AlwaysFailure/></Inverter><Sequence><Allow/></Sequence><Put/></ReactiveSequence>",
        "<ReactiveSequence><ReactiveFallback><Allow/><Sequence><AlwaysSuccess/><Allow/></Sequence></ReactiveFallback>"
        "<Sequence><Delay delay_msec='5'><Put/></Delay></Sequence></ReactiveSequence>",
        "<WhileDoElse><Allow/><Put/></WhileDoElse>",
        '<ReactiveSequence><SubTree ID="Ask"/><SubTree ID="Act"/></ReactiveSequence>',
    ],
)
def test_a_guard_asked_in_every_tick_is_enough(write: Write, nodes: str) -> None:
    more = '<BehaviorTree ID="Ask"><Allow/></BehaviorTree><BehaviorTree ID="Act"><Put/></BehaviorTree>'
    more = more if "SubTree" in nodes else ""
    path = write(
        f'<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M">{nodes}</BehaviorTree>{more}</root>'
    )
    assert check([path], REGISTRY) == []


def test_a_subtree_needs_the_guard_wherever_it_is_called(write: Write) -> None:
    path = write(
        '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M"><Sequence><ReactiveSequence><Allow/>'
        '<SubTree ID="Act"/></ReactiveSequence><SubTree ID="Act"/></Sequence></BehaviorTree>\n'
        '<BehaviorTree ID="Act"><Put/></BehaviorTree></root>'
    )
    (problem,) = check([path], REGISTRY)
    assert (problem.place.line, problem.place.column) == (2, 24)
    with pytest.raises(TreeFileError, match="without a guard"):
        load_tree(path, REGISTRY)


@pytest.mark.parametrize(
    "nodes",
    [
        "<Fallback><Inverter><Allow/></Inverter><Allow/></Fallback>",
        '<Sequence><AlwaysFailure _skipIf="1 &lt; 2"/><Allow/></Sequence>',
        '<Fallback><Timeout msec="5"><AlwaysSuccess/></Timeout><Allow/></Fallback>',
        '<Sequence><Precondition if="1 &lt; 2" else="SKIPPED"><AlwaysFailure/></Precondition><Allow/></Sequence>',
        "<Parallel><KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure><Allow/></Parallel>",
        '<Sequence><Repeat num_cycles="0"><AlwaysFailure/></Repeat><Allow/></Sequence>',
    ],
)
def test_what_may_be_reached_is_no_mistake(write: Write, nodes: str) -> None:
    assert check([write(MAIN.format(nodes))], REGISTRY) == []


def test_declared_inputs_of_the_main_tree_come_from_outside(write: Write) -> None:
    model = '<TreeNodesModel><SubTree ID="Main"><input_port name="place"/></SubTree></TreeNodesModel>'
    assert check([write(model + '<BehaviorTree ID="Main"><Go place="{place}"/></BehaviorTree>')], REGISTRY) == []


def test_what_groot2_adds_when_it_saves_is_no_mistake(write: Write) -> None:
    path = write(
        '<?xml version="1.0" encoding="UTF-8"?><root BTCPP_format="4" main_tree_to_execute="M" project_name="cell">'
        '<BehaviorTree ID="M" _fullpath="" _description="the cell"><Sequence name="all" _uid="1"><See place="{p}"'
        ' _description="look"/><SubTree ID="Drive" p="{p}" _autoremap="false" name="away" _fullpath="away"/></Sequence>'
        '</BehaviorTree><BehaviorTree ID="Drive"><Go place="{p}"/></BehaviorTree>'
        '<!-- Description of Node Models (Groot) --><TreeNodesModel><Action ID="Go" editable="true"><input_port '
        'name="place" type="Place">where to</input_port><MetadataFields><Metadata a="b"/></MetadataFields></Action>'
        '<SubTree ID="Drive" editable="true"><MetadataFields><Metadata a="b"/></MetadataFields><input_port name="p"/>'
        "</SubTree></TreeNodesModel></root>"
    )
    assert check([path], REGISTRY) == []


def test_a_file_for_inclusion_needs_no_main_tree(write: Write) -> None:
    path = write(MAIN.format("<AlwaysSuccess/>"))
    assert check([path], REGISTRY) == []
    with pytest.raises(TreeFileError, match="the file does not say which BehaviorTree to run"):
        load_tree(path, REGISTRY)


HEAD = '<root BTCPP_format="4">'
WHOLE = HEAD + '<BehaviorTree ID="M"><Sequence>{}</Sequence></BehaviorTree></root>'
HOSTILE = {
    "entities": '<!DOCTYPE r [<!ENTITY a "x"><!ENTITY b "&a;&a;&a;&a;">]><root BTCPP_format="4">&b;</root>',
    "deep": HEAD + '<BehaviorTree ID="M">' + "<Inverter>" * 20_000,
    "deep and many lines": HEAD + "<Inverter>" * 990 + "\n" * 900_000 + "<Oops/>" + "</Inverter>" * 990 + "</root>",
    "strangers": HEAD + "<a/>" * 200_000 + "</root>",
    "nodes": WHOLE.format("<Sequenc/>" * 90_000),
    "unknown nodes": WHOLE.format("<Sequenc/>" * 9_000),
    "attributes": "<root " + " ".join(f'a{i}="{i}"' for i in range(60_000)) + "/>",
    "many attributes": WHOLE.format(("<Go " + " ".join(f'a{i}="1"' for i in range(99)) + "/>") * 1_000),
    "includes": HEAD + "<include path='x'/>" * 5_000 + "</root>",
    "large": " " * 2_000_000,
    "long name": WHOLE.format("<" + "A" * 900_000 + "/>"),
    "brackets": WHOLE.format('<Script code="' + "(" * 9_000 + '"/>'),
    "signs": WHOLE.format('<Script code="a := ' + "-" * 9_000 + '1"/>'),
    "long script": WHOLE.format('<Script code="a := ' + "a+" * 40_000 + '1"/>'),
    "many operators": WHOLE.format('<Script code="a := ' + "1+" * 1_000 + '1"/>'),
    "many statements": WHOLE.format(('<Script code="' + "a := 'b';" * 66 + '"/>') * 1_000),
    "unwritten": WHOLE.format("".join(f'<Script code="x{i} := y{i}"/>' for i in range(4_900))),
    "one entry": WHOLE.format('<Script code="n += 1"/>' * 4_900),
    "guards": WHOLE.format("<Put/>" * 4_900),
    "unreachable": WHOLE.format("<Fallback>" * 900 + "<AlwaysSuccess/>" + "<Allow/></Fallback>" * 900),
    "doubling": '<root BTCPP_format="4" main_tree_to_execute="T0">'
    + "".join(
        f'<BehaviorTree ID="T{i}"><Sequence>' + f'<SubTree ID="T{i + 1}"/>' * 2 + "</Sequence></BehaviorTree>"
        for i in range(60)
    )
    + '<BehaviorTree ID="T60"><AlwaysSuccess/></BehaviorTree></root>',
    "circle": HEAD
    + "".join(f'<BehaviorTree ID="T{i}"><SubTree ID="T{(i + 1) % 3_000}"/></BehaviorTree>' for i in range(3_000))
    + "</root>",
    "star": WHOLE.format("".join(f'<SubTree ID="T{i}"/>' for i in range(3_000))).removesuffix("</root>")
    + "".join(f'<BehaviorTree ID="T{i}"><AlwaysSuccess/></BehaviorTree>' for i in range(3_000))
    + "</root>",
}
TIMES_A_GOOD_FILE = 60  # the worst hostile file takes 6 times as long; on a busy machine a reading is thrice that


@pytest.fixture(scope="module")
def good_file_s(tmp_path_factory: pytest.TempPathFactory) -> float:
    """CPU time [s] that this machine needs for a large file without mistakes, best of three."""
    path = tmp_path_factory.mktemp("good") / "tree.xml"
    path.write_text(WHOLE.format("<AlwaysSuccess/>" * 4_900))
    return min(checked_s(path, bad=False) for _ in range(3))


def checked_s(path: Path, bad: bool) -> float:
    begun_s = time.process_time()
    assert bool(check([path], REGISTRY)) == bad
    return time.process_time() - begun_s


@pytest.mark.parametrize("wide", ["Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "Parallel"])
def test_the_work_of_a_check_grows_with_the_children_not_with_their_square(tmp_path: Path, wide: str) -> None:
    """Calls are counted, as times vary with what else the machine does."""
    status = "AlwaysFailure" if "Fallback" in wide else "AlwaysSuccess"

    def calls(children: int) -> int:
        path = tmp_path / f"{children}.xml"
        many = f"<{status}/>" * children
        path.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="M"><{wide}>{many}</{wide}></BehaviorTree></root>')
        profile = cProfile.Profile()
        assert profile.runcall(check, [path], REGISTRY) == []
        return sum(entry.callcount for entry in profile.getstats())

    assert calls(1_200) <= 3 * calls(600)


@pytest.mark.long
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_quickly(write: Write, name: str, good_file_s: float) -> None:
    assert checked_s(write(HOSTILE[name]), bad=True) < TIMES_A_GOOD_FILE * good_file_s


def test_what_is_no_file_is_refused() -> None:
    assert [str(problem) for problem in check([Path("/dev/zero")], REGISTRY)] == [
        "/dev/zero: this is not a file; give the path of a tree file"
    ]


def test_a_thousand_levels_are_refused_and_nine_hundred_run(write: Write) -> None:
    def chain(levels: int) -> Path:
        return write(
            f'<BehaviorTree ID="M">{"<Inverter>" * levels}<AlwaysSuccess/>{"</Inverter>" * levels}</BehaviorTree>'
        )

    assert check([chain(1_000)], REGISTRY)
    tree = load_tree(chain(900), REGISTRY)
    assert tree.tick() is Status.SUCCESS
    tree.halt()


SLEEP = '<Sleep msec="60000"/>'
GUARDED = [
    (f"<ReactiveSequence><Sequence><Allow/>{SLEEP}</Sequence><Put/></ReactiveSequence>", False),
    (f"<ReactiveSequence><Sequence>{SLEEP}<Allow/></Sequence><Put/></ReactiveSequence>", True),
    ("<ReactiveSequence><Sequence><Allow/><Script code='n := 1'/></Sequence><Put/></ReactiveSequence>", True),
    ("<ReactiveSequence><AsyncSequence><Allow/><AlwaysSuccess/></AsyncSequence><Put/></ReactiveSequence>", False),
    ("<ReactiveSequence><AsyncSequence><AlwaysSuccess/><Allow/></AsyncSequence><Put/></ReactiveSequence>", True),
    ('<ReactiveSequence><Allow/><TryCatch catch_on_halt="1"><Allow/><Put/></TryCatch></ReactiveSequence>', False),
    ('<ReactiveSequence><Allow/><TryCatch catch_on_halt="0"><Allow/><Put/></TryCatch></ReactiveSequence>', True),
    (f"<ReactiveSequence><ReactiveSequence><Allow/>{SLEEP}</ReactiveSequence><Put/></ReactiveSequence>", True),
    (
        f"<ReactiveSequence><Fallback><Sequence><Allow/>{SLEEP}</Sequence><Allow/></Fallback><Put/></ReactiveSequence>",
        False,
    ),
    (f"<WhileDoElse><Sequence>{SLEEP}<Allow/></Sequence><Put/></WhileDoElse>", False),
    ("<WhileDoElse><Sequence><AlwaysSuccess/><Allow/></Sequence><Put/></WhileDoElse>", True),
    ("<AllAtOnce><Allow/><Put/></AllAtOnce>", True),
    ("<Reactive2><Allow/><Put/></Reactive2>", False),
]


class AllAtOnce(ReactiveSequence):
    """A control of one's own that asks again like its base."""


class Reactive2(Control):
    """A control of one's own that says nothing of what it asks again."""

    def run(self) -> Status:
        return Status.FAILURE


class Not(Decorator):
    """A decorator of one's own."""

    def run(self) -> Status:
        return Status.FAILURE


@pytest.mark.parametrize(("nodes", "sound"), GUARDED)
def test_a_guard_counts_where_its_verdict_is_of_this_tick(write: Write, nodes: str, sound: bool) -> None:
    problems = check(
        [write(f'<BehaviorTree ID="Main">{nodes}</BehaviorTree>')], Registry([Put, Allow, AllAtOnce, Reactive2])
    )
    assert [problem.what for problem in problems] == (
        [] if sound else ["Put runs without a guard that is asked in every tick"]
    )


@pytest.mark.parametrize(
    "nodes",
    [
        "<Fallback><Not><AlwaysSuccess/></Not><AlwaysSuccess/></Fallback>",
        "<Not><Sequence><Script code='m := v' _skipIf='true'/><Script code='v := 1'/></Sequence></Not>",
        '<Sequence><Script code="n := 1"/><Fallback><Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>'
        "<AlwaysSuccess/></Fallback></Sequence>",
    ],
)
def test_nothing_is_guessed_of_controls_and_decorators_of_ones_own(write: Write, nodes: str) -> None:
    assert check([write(f'<BehaviorTree ID="Main">{nodes}</BehaviorTree>')], Registry([Not])) == []


class Bolt(Node):
    """Takes names of the product."""

    part = InputPort(Part, "type")
    hole = InputPort(Hole, "where")

    def update(self) -> Status:
        self.feedback_message = f"{self.part.get()} {self.hole.get()}"
        return Status.SUCCESS


NAMED = Registry([Bolt], words={Part: ("o1", "o2"), Hole: ("p1", "p2")})


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        ('<Bolt part="o1" hole="^p99"/>', "the product has no position 'p99'; one of p1, p2"),
        ('<Bolt part="^p1" hole="p1"/>', "the product has no part type 'p1'; one of o1, o2"),
        (
            '<SubTree ID="Inner" ^h="p9"/>',
            "the product has no position 'p9'; port 'hole' of Bolt at .* takes one of p1, p2",
        ),
        ('<Sequence><Script code="x := 1; ^h := \'p9\'"/><Bolt part="o1" hole="{h}"/></Sequence>', "no position 'p9'"),
        ('<Sequence><Script code="h := \'\' .. 1"/><Bolt part="{h}" ^hole="{h}"/></Sequence>', "takes {h} as Hole; "),
    ],
)
def test_names_are_those_of_the_product(write: Write, nodes: str, message: str) -> None:
    inner = '<BehaviorTree ID="Inner"><Bolt part="o1" hole="{h}"/></BehaviorTree>'
    root = '<root BTCPP_format="4" main_tree_to_execute="Main">'
    text = f'{root}<BehaviorTree ID="Main">{nodes}</BehaviorTree>{inner}</root>'
    (problem,) = check([write(text.replace("^", ""))], NAMED)
    assert re.search(message, str(problem))
    assert problem.place.column == text.index("^") + 1
    if "as Hole" not in message:
        assert check([problem.place.file], Registry([Bolt])) == []  # without a product any name passes


def test_a_name_that_turns_up_in_a_run_fails_the_node(write: Write) -> None:
    bolt = '<Fallback><Bolt part="o1" hole="{h}"/><AlwaysSuccess/></Fallback>'
    loop = f'<LoopString queue="p1;p9" value="{{h}}">{bolt}</LoopString>'
    tree = load_tree(write(f'<BehaviorTree ID="Main">{loop}</BehaviorTree>'), NAMED)
    tree.setup(None, ManualClock())
    told = [tree.tick() and tree.nodes[2].feedback_message for _ in range(2)]
    assert told == ["o1 p1", "port hole: the product has no position 'p9'; one of p1, p2"]


def test_what_editors_write_for_themselves_is_noted_and_loads(write: Write) -> None:
    text = (
        '<root license="mine">\n<BehaviorTree _favorite="true" name="x">\n<Sequence _collapsed="true">\n'
        "<AlwaysSuccess/></Sequence>\n</BehaviorTree>\n</root>"
    )
    path = write(text)
    problems, _, notes = findings([path], REGISTRY)
    assert problems == []
    assert [(note.place.line, note.what.split(";")[0]) for note in notes] == [
        (1, "BTCPP_format is missing"),
        (1, "<root> has no attribute 'license'"),
        (2, "<BehaviorTree> has no attribute '_favorite'"),
        (2, "<BehaviorTree> has no attribute 'name'"),
        (3, "'_collapsed' means nothing here"),
    ]
    assert load_tree(path, REGISTRY).name == "BehaviorTree"


def test_a_file_may_be_included_on_several_ways(write: Write) -> None:
    root = '<root BTCPP_format="4" main_tree_to_execute="Main">'
    write('<BehaviorTree ID="D"><AlwaysSuccess/></BehaviorTree>', "d.xml")
    for name in "bc":
        write(
            f'<include path="d.xml"/><BehaviorTree ID="{name.upper()}"><SubTree ID="D"/></BehaviorTree>', f"{name}.xml"
        )
    main = '<BehaviorTree ID="Main"><Sequence><SubTree ID="B"/><SubTree ID="C"/></Sequence></BehaviorTree>'
    path = write(f'{root}<include path="b.xml"/><include path="c.xml"/>{main}</root>')
    assert check([path], REGISTRY) == []
    write('<include path="tree.xml"/><BehaviorTree ID="D"><AlwaysSuccess/></BehaviorTree>', "d.xml")
    assert check([path], REGISTRY) == []


class Arm(Node):
    """Moves the arm."""

    traits = Traits(claims=("arm",))

    def update(self) -> Status:
        return Status.RUNNING


@pytest.mark.parametrize(
    ("nodes", "told"),
    [
        ("<Parallel><Arm/>^<Arm/></Parallel>", True),
        ('<ParallelAll max_failures="1"><Arm/>^<Sequence><SubTree ID="Inner"/></Sequence></ParallelAll>', True),
        ("<Parallel><Sequence><Arm/><Arm/></Sequence><AlwaysSuccess/></Parallel>", False),
        ("<Fallback><Arm/><Arm/></Fallback>", False),
    ],
)
def test_two_branches_that_run_at_once_do_not_command_one_device(write: Write, nodes: str, told: bool) -> None:
    root = '<root BTCPP_format="4" main_tree_to_execute="Main">'
    text = f'{root}<BehaviorTree ID="Main">{nodes}</BehaviorTree><BehaviorTree ID="Inner"><Arm/></BehaviorTree></root>'
    problems = check([write(text.replace("^", ""))], Registry([Arm]))
    assert [problem.what for problem in problems] == ["Arm commands the arm while Arm may"] * told
    assert [problem.place.column for problem in problems] == [text.find("^") + 1] * told
