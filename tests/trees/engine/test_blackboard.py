"""Entries, remapping, constants and types."""

from __future__ import annotations

from enum import Enum

import pytest

from bracket_ground.errors import InputError
from btxml.engine.node import Node
from btxml.engine.ports import InOutPort, InputPort, OutputPort
from btxml.engine.status import Status
from btxml.files.compile.registry import Registry
from tests.trees.conftest import Load


class Colour(Enum):
    """An enum of ports."""

    RED = "red"
    BLUE = "blue"


class Take(Node):
    """Notes what it reads."""

    number = InputPort(int, "", default=7)
    ratio = InputPort(float, "", default=0.5)
    on = InputPort(bool, "", default=False)
    text = InputPort(str, "", default="none")
    colour = InputPort(Colour, "", default=Colour.RED)
    items = InputPort(list[str], "", default=[])
    sizes = InputPort(tuple[float, ...], "", default=())

    def update(self) -> Status:
        self.seen = {
            "number": self.number.get(),
            "ratio": self.ratio.get(),
            "on": self.on.get(),
            "text": self.text.get(),
            "colour": self.colour.get(),
            "items": self.items.get(),
            "sizes": self.sizes.get(),
        }
        return Status.SUCCESS


class Count(Node):
    """Writes, and counts its ticks in an entry."""

    total = InOutPort(int, "", unset_ok=True)
    out = OutputPort(str, "")

    def update(self) -> Status:
        self.total.set(self.total.get_or(0) + 1)
        self.out.set(f"n{self.total.get()}")
        return Status.SUCCESS


class Shows(Node):
    """Says a text."""

    text = InputPort(str, "")

    def update(self) -> Status:
        self.feedback_message = self.text.get()
        return Status.SUCCESS


def seen(load: Load, attributes: str) -> dict[str, object]:
    tree = load(f"<Take {attributes}/>", Take)
    assert tree.tick() is Status.SUCCESS
    leaf = tree.nodes[0]
    assert isinstance(leaf, Take)
    return leaf.seen


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        ('number="-3"', -3),
        ('ratio="2"', 2.0),
        ('ratio="1e-3"', 0.001),
        ('on="true"', True),
        ('on="0"', False),
        ('text="a;b"', "a;b"),
        ('text=""', ""),
        ('colour="BLUE"', Colour.BLUE),
        ('items="a;b"', ["a", "b"]),
        ('items=""', []),
        ('sizes="1;2.5"', (1.0, 2.5)),
    ],
)
def test_literals_take_the_type_of_the_port(load: Load, attribute: str, value: object) -> None:
    name = attribute.split("=")[0]
    read = seen(load, attribute)[name]
    assert read == value
    assert type(read) is type(value)


def test_defaults_hold_where_the_file_is_silent(load: Load) -> None:
    assert seen(load, "")["number"] == 7


def test_an_unset_entry_fails_the_node_with_a_reason(load: Load) -> None:
    tree = load('<Sequence><UnsetBlackboard key="n"/><Script code="m := n" _skipIf="false"/></Sequence>')
    assert tree.tick() is Status.FAILURE
    assert tree.nodes[2].feedback_message == "nothing has been written to {n} yet"


def test_subtrees_have_entries_of_their_own(load: Load) -> None:
    nodes = '<Sequence><Script code="n := 1"/><SubTree ID="Inner"/><ScriptCondition code="n == 1"/></Sequence>'
    more = '<BehaviorTree ID="Inner"><Script code="n := 2"/></BehaviorTree>'
    assert load(nodes, more=more).tick() is Status.SUCCESS


def test_remapping_joins_entries(load: Load) -> None:
    nodes = '<Sequence><Script code="a := 1; n := 5"/><SubTree ID="Inner" x="{a}" n="{=}" c="2" t="up"/></Sequence>'
    more = '<BehaviorTree ID="Inner"><Script code="x += c; n = 6; s := t .. \'!\'; @top := s"/></BehaviorTree>'
    tree = load(nodes, more=more)
    assert tree.tick() is Status.SUCCESS
    assert tree.blackboard.values() == {"a": 3, "n": 6, "top": "up!"}


def test_autoremap_joins_all_names_but_private_ones(load: Load) -> None:
    nodes = '<Sequence><Script code="a := 1; _p := 1"/><SubTree ID="Inner" _autoremap="true"/></Sequence>'
    more = '<BehaviorTree ID="Inner"><Script code="a := 2; b := 3; _p := 4"/></BehaviorTree>'
    tree = load(nodes, more=more)
    tree.tick()
    assert tree.blackboard.values() == {"a": 2, "_p": 1, "b": 3}


def test_models_give_subtrees_defaults(load: Load) -> None:
    model = '<TreeNodesModel><SubTree ID="Inner"><input_port name="speed" default="3"/></SubTree></TreeNodesModel>'
    more = model + '<BehaviorTree ID="Inner"><Script code="@seen := speed"/></BehaviorTree>'
    tree = load('<SubTree ID="Inner"/>', more=more)
    tree.tick()
    assert tree.blackboard.values() == {"seen": 3}


def test_ports_pass_values_through_subtrees(load: Load) -> None:
    inner = '<SubTree ID="Inner" n="{total}"/>'
    nodes = f'<Sequence>{inner}{inner}<Take number="{{total}}"/></Sequence>'
    more = '<BehaviorTree ID="Inner"><Count total="{n}"/></BehaviorTree>'
    tree = load(nodes, Count, Take, more=more)
    tree.tick()
    assert tree.blackboard.values() == {"total": 2}


def test_two_trees_share_nothing(load: Load) -> None:
    first, second = load('<Script code="n := 1"/>'), load('<Script code="m := 1"/>')
    first.tick()
    assert second.blackboard.values() == {}


def test_ports_of_different_types_cannot_share_an_entry(load: Load) -> None:
    with pytest.raises(InputError, match=r"takes \{n\} as float; port 'total' of Count at .* has it as int"):
        load('<Sequence><Count total="{n}"/><Take ratio="{n}"/></Sequence>', Count, Take)


def test_strings_convert_where_they_are_read(load: Load) -> None:
    tree = load('<Sequence><Count total="{n}" out="{s}"/><Take number="{s}"/></Sequence>', Count, Take)
    assert tree.tick() is Status.FAILURE
    assert "'n1' is not an int" in tree.nodes[2].feedback_message


def test_a_script_cannot_break_the_type_of_a_port(load: Load) -> None:
    tree = load("<Sequence><Count total=\"{n}\"/><Script code=\"n = 'ma' .. 'ny'\"/></Sequence>", Count)
    assert tree.tick() is Status.FAILURE
    assert tree.nodes[2].feedback_message.startswith("{n} holds an int and cannot be written")


@pytest.mark.parametrize("code", ["count := 0", "count := 0; count += 1", "count := 0.5", "count := true"])
def test_a_port_that_shows_an_entry_does_not_make_it_a_text(code: str, load: Load) -> None:
    tree = load(
        f'<Sequence><Script code="{code}"/><Script code="count += 1"/><Shows text="{{count}}"/></Sequence>', Shows
    )
    assert tree.tick() is Status.SUCCESS
    assert isinstance(tree.blackboard.entry("count").value, int | float)


@pytest.mark.parametrize(("text", "read"), [("json:[1, 2.5]", (1.0, 2.5)), ("json:[]", ()), ("1;2.5", (1.0, 2.5))])
def test_a_list_may_be_written_as_json(text: str, read: tuple[float, ...], load: Load) -> None:
    tree = load(f'<Take sizes="{text}"/>', Take)
    tree.tick()
    assert tree.nodes[0].seen["sizes"] == read  # type: ignore[attr-defined]


@pytest.mark.parametrize("text", ["json:{}", "json:[", "json:[true, null]", "json:3"])
def test_json_that_is_no_list_of_the_ports_type_is_refused(text: str, load: Load) -> None:
    with pytest.raises(InputError):
        load(f"<Take sizes='{text}'/>", Take)


def test_a_number_that_a_port_writes_can_be_shown(load: Load) -> None:
    tree = load('<Sequence><Count total="{n}"/><Shows text="{n}"/></Sequence>', Count, Shows)
    assert tree.tick() is Status.SUCCESS
    assert tree.nodes[2].feedback_message == "1"


@pytest.mark.parametrize(("value", "shown"), [("true", "true"), ("2", "2"), ("0.5", "0.5"), ("'a'", "a")])
def test_a_port_of_text_shows_a_value_as_a_file_spells_it(value: str, shown: str, load: Load) -> None:
    tree = load(f'<Sequence><Script code="v := {value}"/><Shows text="{{v}}"/></Sequence>', Shows)
    assert tree.tick() is Status.SUCCESS
    assert tree.nodes[2].feedback_message == shown


@pytest.mark.parametrize("value", ["'many'", "0.5"])
def test_what_a_script_gives_a_port_that_cannot_take_it_is_refused_with_both_places(value: str, load: Load) -> None:
    with pytest.raises(InputError, match=r"(?s)'code' of Script gives \{n\}.*port 'number' of Take at .*takes an int"):
        load(f'<Sequence><Script code="n := {value}"/><Take number="{{n}}"/></Sequence>', Take)


def test_a_value_that_a_port_cannot_take_fails_the_node_that_reads_it(load: Load) -> None:
    tree = load('<Sequence><Script code="n := 1; n := n / 2.0"/><Take number="{n}"/></Sequence>', Take)
    assert tree.tick() is Status.FAILURE


def test_set_and_unset_take_bare_names(load: Load) -> None:
    nodes = '<Sequence><SetBlackboard value="4" output_key="n"/><ScriptCondition code="n == \'4\'"/></Sequence>'
    assert load(nodes).tick() is Status.SUCCESS


def test_two_classes_cannot_have_one_name() -> None:
    with pytest.raises(ValueError, match="two node classes are named Take"):
        Registry([Take, Take])


def test_an_entry_that_a_port_names_may_be_assigned_at_once(load: Load) -> None:
    tree = load('<Sequence><Script code="n = 2"/><Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat></Sequence>')
    assert [tree.tick() for _ in range(2)] == [Status.RUNNING, Status.SUCCESS]


@pytest.mark.parametrize("text", ["007", "1.10", "1e3", "+5", "1_000", " 5 ", "٣", "9" * 30])
def test_a_constant_for_a_port_of_text_keeps_its_text(load: Load, text: str) -> None:
    tree = load(
        f'<SubTree ID="Inner" t="{text}"/>', Take, more='<BehaviorTree ID="Inner"><Take text="{t}"/></BehaviorTree>'
    )
    assert tree.tick() is Status.SUCCESS
    leaf = tree.nodes[1]
    assert isinstance(leaf, Take)
    assert leaf.seen["text"] == text


@pytest.mark.parametrize(
    ("word", "joined"), [("True", True), ("TRUE", True), ("1", True), ("False", False), ("0", False)]
)
def test_every_spelling_of_true_remaps_all_names(load: Load, word: str, joined: bool) -> None:
    nodes = f'<Sequence><Script code="x := 1"/><SubTree ID="Inner" _autoremap="{word}"/></Sequence>'
    tree = load(nodes, more='<BehaviorTree ID="Inner"><Script code="x := 2"/></BehaviorTree>')
    tree.tick()
    assert tree.blackboard.values()["x"] == (2 if joined else 1)


@pytest.mark.parametrize("default", ["", ' default="7"'])
def test_a_declared_port_is_remapped_with_all_others(load: Load, default: str) -> None:
    model = f'<TreeNodesModel><SubTree ID="Inner"><input_port name="x"{default}/></SubTree></TreeNodesModel>'
    nodes = '<Sequence><Script code="x := 5"/><SubTree ID="Inner" _autoremap="true"/></Sequence>'
    more = model + '<BehaviorTree ID="Inner"><ScriptCondition code="x == 5"/></BehaviorTree>'
    assert load(nodes, more=more).tick() is Status.SUCCESS


def test_a_loop_leaves_the_list_of_its_writer_alone(load: Load) -> None:
    class Keeps(Node):
        """Writes a list that it keeps."""

        items = OutputPort(list[str], "")
        kept = ["a", "b"]  # noqa: RUF012  # shared on purpose

        def update(self) -> Status:
            self.items.set(self.kept)
            return Status.SUCCESS

    loop = '<LoopString queue="{q}" value="{v}"><AlwaysSuccess/></LoopString>'
    tree = load(
        f'<Sequence><Keeps items="{{q}}"/><SetBlackboard value="{{q}}" output_key="p"/>{loop}</Sequence>', Keeps
    )
    assert [tree.tick() for _ in range(3)] == [Status.RUNNING, Status.RUNNING, Status.SUCCESS]
    assert tree.blackboard.values()["q"] == []
    assert tree.blackboard.values()["p"] == Keeps.kept == ["a", "b"]


def test_a_switch_compares_numbers_as_scripts_do(load: Load) -> None:
    switch = (
        '<Switch2 variable="{v}" case_1="0.3" case_2="1_0"><AlwaysSuccess/><AlwaysSuccess/><AlwaysFailure/></Switch2>'
    )
    assert load(f'<Sequence><Script code="v := 0.1 + 0.2"/>{switch}</Sequence>').tick() is Status.SUCCESS
    assert load(f'<Sequence><Script code="v := 10"/>{switch}</Sequence>').tick() is Status.FAILURE


class Signal(Enum):
    """An enum with numbers."""

    OFF = 0
    STOP = 1
    GO = 2


class Show(Node):
    """Writes a member of an enum."""

    signal = OutputPort(Signal, "what it shows")

    def update(self) -> Status:
        self.signal.set(Signal.GO)
        return Status.SUCCESS


@pytest.mark.parametrize(
    "code",
    [
        *("c == GO", "c != STOP", "c == 2", "c &gt; STOP", "c + 1 == 3", "(c | 1) == 3", "c == 'GO'", "-c == -2", "c"),
        *("c := STOP; c == STOP", "c := STOP; c + c == 2", "c := OFF; !c", "c / 2 == 1", "c := 1; c &lt; GO"),
    ],
)
def test_an_entry_of_an_enum_counts_as_its_number(load: Load, code: str) -> None:
    """As in BehaviorTree.CPP, also where a port writes it."""
    condition = f'<ScriptCondition code="{code}"/>'
    tree = load(f'<Sequence><Show signal="{{c}}"/>{condition}</Sequence>', Show)
    assert tree.tick() is Status.SUCCESS, tree.why()
