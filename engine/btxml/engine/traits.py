"""What is known of a node class before it runs: the checks of tree files read it, a tick does not."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

from btxml.engine.errors import TraitError
from btxml.engine.ports import Port
from btxml.engine.status import ANY, EITHER, Results


def _none_before(child: int) -> range:  # noqa: ARG001
    return range(0)


def _any_end(below: Sequence[Results], values: Mapping[str, str]) -> Results:  # noqa: ARG001
    return ANY if below else EITHER


def _no_barrier(child: int, below: Sequence[Results]) -> int | None:  # noqa: ARG001
    return None


def _possible(children: int, values: Mapping[str, str]) -> tuple[str, str] | None:  # noqa: ARG001
    return None


@dataclass(frozen=True)
class Traits:
    """What a class promises. A subclass with a record of its own says all of it: `replace(Base.traits, guards=True)`.

    Attributes:
        claims: devices that it commands while it runs, such as "arm"; two such nodes cannot run at once.
        gives, needs: what its success brings or asks about, and what must be so before it: "a part in the gripper".
        asked_again: while others command what it claims, it may be asked in every tick: it acts where it must.
        instant: it never answers RUNNING by itself, only while a child does.
        guards: its SUCCESS means that what needs a guard may go on.
        needs_guard: a tree file must let a guard be asked in every tick while this node runs.
        at_once: its children run at the same time.
        comes_back: it may tick a child again that ended, or whose elder siblings go on.
        succeeds_after: what its SUCCESS says about its children: "all" succeeded, "one" of them did, or "" nothing.
        asked_before: by the number of a child, those that are asked again in every tick while that one runs, and must
            have succeeded for it to run.
        results: how it can end, from how each of its children can, and its attributes in the file; more where in doubt.
        barrier: by the number of a child and how each can end, the elder one whose results keep it from ever being
            ticked; None where none does. Asked for one child after the other, up to the first that has a barrier.
        shown_as: what viewers show people while it runs or once it succeeded, in words that the program agrees on.
        impossible: by its number of children and its attributes, which of these asks for what they cannot do, and why.
    """

    claims: tuple[str, ...] = ()
    gives: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    asked_again: bool = False
    instant: bool = False
    guards: bool = False
    needs_guard: bool = False
    at_once: bool = False
    comes_back: bool = True
    shown_as: str = ""
    succeeds_after: Literal["all", "one", ""] = ""
    asked_before: Callable[[int], range] = _none_before
    results: Callable[[Sequence[Results], Mapping[str, str]], Results] = _any_end
    barrier: Callable[[int, Sequence[Results]], int | None] = _no_barrier
    impossible: Callable[[int, Mapping[str, str]], tuple[str, str] | None] = _possible


OVERRIDDEN = "run, on_halt of a control or decorator; prepare, initialise, update, terminate of a leaf"
FORMER = {**{field.name: field.name for field in fields(Traits)}, "never_succeeds": "results"}


def refuse_former(node: type) -> None:
    """Raises TraitError for a class that has a trait as an attribute of its own, as was the way once."""
    for name, value in vars(node).items():
        if name in FORMER and not isinstance(value, Port | property) and _is_trait(name, value):
            said = f"traits = Traits({FORMER[name]}=...)"
            raise TraitError(f"{node.__name__}.{name} is read by nothing: write {said}, from btxml.engine.traits")


def refuse_own(node: type, names: Sequence[str]) -> None:
    """Raises TraitError for a class, not one of the engine, that has a method in which the engine keeps its word."""
    if node.__module__.startswith("btxml.engine."):
        return
    for name in names:
        if name in vars(node):
            raise TraitError(f"{node.__name__}.{name} is the engine's own; override one of: {OVERRIDDEN}")


def _is_trait(name: str, value: Any) -> bool:
    """A leaf may have a method of such a name; a trait that was a method was one of the class."""
    if name in ("asked_before", "results", "barrier"):
        return isinstance(value, classmethod | staticmethod)
    return not callable(value)
