"""What a class says of itself: one record, and a clear word for the attributes of before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from bracket_cell.trees.nodes.placing import PlacePart
from bracket_cell.trees.vocabulary import ShownAs
from btxml.engine.controls import ReactiveSequence, SequenceWithMemory
from btxml.engine.errors import TraitError
from btxml.engine.node import Node
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits


class Waits(Node):
    """A leaf without a word about itself."""

    def update(self) -> Status:
        return Status.RUNNING


def test_a_class_has_the_traits_of_its_base_until_it_has_its_own() -> None:
    assert Waits.traits == Node.traits == Traits()
    assert PlacePart.traits == Traits(claims=("arm", "gripper"), needs_guard=True, shown_as=ShownAs.PLACES)
    assert SequenceWithMemory.traits.succeeds_after == ""
    assert list(ReactiveSequence.traits.asked_before(2)) == [0, 1]
    assert replace(Waits.traits, instant=True).instant


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("instant", True, "Old.instant is read by nothing: write traits = Traits(instant=...), from"),
        ("claims", ("arm",), "write traits = Traits(claims=...)"),
        ("never_succeeds", True, "write traits = Traits(results=...)"),
        ("results", classmethod(lambda *_: frozenset()), "write traits = Traits(results=...)"),
    ],
)
def test_a_trait_as_an_attribute_of_its_own_is_refused(name: str, value: object, told: str) -> None:
    with pytest.raises(TraitError) as raised:
        type("Old", (Node,), {name: value})
    assert told in str(raised.value)


def test_ports_and_methods_of_a_leaf_may_have_such_names() -> None:
    class Counts(Node):
        """Counts."""

        guards = InputPort(int, "how many guards there are")

        def results(self) -> Sequence[int]:
            """What was counted."""
            return [self.guards.get()]

        @property
        def instant(self) -> bool:
            """Whether there are none."""
            return not self.guards.get()

    assert Counts.traits == Traits()
