"""The names of a cell that ports take: part types, positions, goals, places, signals."""

from __future__ import annotations

from enum import StrEnum
from typing import ClassVar

from btxml.engine.vocabulary import Word


class Part(Word):
    """A part type of the product."""

    __slots__ = ()
    missing: ClassVar[str] = "the product has no part type"


class Hole(Word):
    """A position of the product, where a part belongs."""

    __slots__ = ()
    missing: ClassVar[str] = "the product has no position"


class Goal(Word):
    """A goal of the product: which part belongs where."""

    __slots__ = ()
    missing: ClassVar[str] = "the product has no goal"


class Location(Word):
    """A place of the bench with a name, where parts stand: a fixture, a chuck, a pallet."""

    __slots__ = ()
    missing: ClassVar[str] = "the bench has no place"


class Signal(Word):
    """A digital signal of the bench: an input or an output."""

    __slots__ = ()
    missing: ClassVar[str] = "the bench has no signal"


class OutputSignal(Signal):
    """A digital signal of the bench that can be set."""

    __slots__ = ()
    missing: ClassVar[str] = "the bench has no output signal"


class ShownAs(StrEnum):
    """What `traits.shown_as` of a node says: how viewers show people that it runs, whosever leaf it is."""

    GIVES_WAY = "gives way"  # waits for a hand to leave
    PLACES = "places"  # its success: the part is let go in its hole
    PUTS_BACK = "puts back"  # its success: the part is out of the gripper, and not in a hole
    AWAITS_PERSON = "awaits person"  # waits for what the person does
    AWAITS_HAND = "awaits hand"  # waits for a first hand to be seen
    AWAITS_BRACKET = "awaits bracket"  # waits for an empty bracket
    FINISHED = "finished"  # its success: the bracket is assembled
