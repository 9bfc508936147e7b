"""Why a tree ended, or goes on: from the root down to the node that decided, by what each node makes of its children.

What a node makes of them is its own (`TreeNode.decision`); nothing is worked out before somebody asks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from btxml.engine.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status

if TYPE_CHECKING:
    from btxml.engine.node import TreeNode

VERBS = {SUCCESS: "succeeded", FAILURE: "failed", RUNNING: "runs", SKIPPED: "is skipped", IDLE: "was halted"}
BESIDE_N = 2  # others that a sentence names
ALWAYS = {SUCCESS: "always succeeds", FAILURE: "always fails", SKIPPED: "is always skipped"}
Changes = Iterable[tuple["TreeNode", Status, Status, str]]


class Decision(NamedTuple):
    """What made a node answer as it did.

    Attributes:
        by: children whose answers made it, the one that counts most last; none where it was the node itself.
        words: what the node makes of them, or why it decided itself.
        otherwise: what would have changed its answer, where it decided itself: "if ...".
        fixed: it answers so whatever happens.
    """

    by: Sequence[TreeNode] = ()
    words: str = ""
    otherwise: str = ""
    fixed: bool = False


@dataclass(slots=True)
class Past:
    """What is known of a node after its parent has forgotten it.

    Attributes:
        answer: how it ended last; IDLE where it was halted.
        answered, begun, left: ticks in which it ended last, began last, and went back to idle.
    """

    answer: Status | None = None
    answered: int = -1
    begun: int = -1
    left: int = -1


class History:
    """The past of all nodes of a tree."""

    def __init__(self) -> None:
        self._past: dict[int, Past] = {}

    def follow(self, changes: Changes, tick: int) -> None:
        """One more tick or halt."""
        past = self._past
        for node, old, new, _ in changes:
            if new is old:
                continue
            known = past.get(node.uid)
            if known is None:
                known = past[node.uid] = Past()
            if new is IDLE:
                known.left = tick
                if old is not RUNNING:
                    continue
            elif old is not RUNNING:
                known.begun = tick
            if new is not RUNNING:
                known.answer, known.answered = new, tick

    def of(self, node: TreeNode) -> Past:
        """What is known of a node."""
        return self._past.get(node.uid) or Past()

    def answer(self, child: TreeNode, parent: TreeNode) -> Status | None:
        """What a child answered in the round in which its parent is, or was last; None where it was not asked."""
        if child.status is not IDLE:
            return child.status
        past = self.of(child)
        return past.answer if past.answer is not None and past.left >= self.of(parent).begun else None

    def those(self, parent: TreeNode, *answers: Status) -> list[TreeNode]:
        """Children that answered so in that round, in their order."""
        return [child for child in parent.children if self.answer(child, parent) in answers]

    def halted_below(self, node: TreeNode) -> Iterator[TreeNode]:
        """Leaves that ran when it ended, and were halted by that."""
        for child in node.children:
            past = self.of(child)
            if past.answer is IDLE and past.left >= self.of(node).answered:
                yield from [child] if not child.children else self.halted_below(child)


@dataclass(frozen=True)
class Step:
    """A node on the way from the root to what decided.

    Attributes:
        node: its tag.
        file, line: where the tree file has it; empty and 0 where it was made in no file.
        status: what it answered, by name.
        words: what it said, or what it made of its children.
        otherwise: what would have changed its answer: "if ...".
        fixed: it answers so whatever happens.
    """

    path: str
    uid: int
    node: str
    name: str
    file: str
    line: int
    status: str
    words: str = ""
    otherwise: str = ""
    fixed: bool = False

    def __str__(self) -> str:
        place = f" ({self.file}:{self.line})" if self.line else ""
        name = self.node if self.name in (self.node, "") else f"{self.node} '{self.name}'"
        return f"{name}{place}: {self.words or VERBS[Status[self.status]]}"


@dataclass(frozen=True)
class Reason:
    """Why a node answered as it did.

    Attributes:
        steps: from that node to what decided, at least one.
        beside: what decided together with it, or had to be so before it.
    """

    steps: tuple[Step, ...]
    beside: tuple[Reason, ...] = ()

    @property
    def leaf(self) -> Step:
        """What decided."""
        return self.steps[-1]

    @property
    def otherwise(self) -> str:
        """What would have changed the answer: "if ..."."""
        own = next((step.otherwise for step in reversed(self.steps) if step.otherwise), "")
        others = (reason.otherwise for reason in reversed(self.beside) if reason.tells and self._counts(reason))
        return own or next(filter(None, others), "")

    def __str__(self) -> str:
        """One sentence, like "MoveTo (a.xml:3): no way to park; Inverter (a.xml:2) makes that a failure"."""
        above = [str(step) for step in reversed(self.steps[:-1]) if step.words]
        word = "as" if self.leaf.status == RUNNING.name else "also"
        beside = [f"{word} {reason.leaf}" for reason in self.beside if reason.tells and self._counts(reason)]
        return "; ".join([str(self.leaf), *above, *beside[-BESIDE_N:]])

    @property
    def fixed(self) -> bool:
        """Whether it was so whatever happened."""
        return any(step.fixed for step in self.steps)

    @property
    def tells(self) -> bool:
        """Whether what decided said something that could have been otherwise."""
        leaf = self.leaf
        forced = self.fixed and leaf.status != self.steps[0].status
        return not (leaf.fixed or forced) and bool(leaf.words) and leaf.words not in VERBS.values()

    def _counts(self, beside: Reason) -> bool:
        """What runs beside a node that runs has nothing to do with it; what was asked before it has."""
        runs = self.leaf.status == RUNNING.name
        return beside.leaf != self.leaf and not (runs and beside.leaf.status == RUNNING.name)

    def plain(self) -> dict[str, Any]:
        """The record that logs, `--json` and pages have."""
        return {
            "text": str(self),
            "otherwise": self.otherwise,
            **{name: value for name, value in vars(self.leaf).items() if name not in ("otherwise", "fixed")},
            "steps": [vars(step) for step in self.steps],
            "beside": [reason.plain() for reason in self.beside],
        }


def reason_of(plain: Mapping[str, Any]) -> Reason:
    """A reason from its record."""
    return Reason(tuple(Step(**step) for step in plain["steps"]), tuple(map(reason_of, plain["beside"])))


Placed = Callable[["TreeNode", str], tuple[str, int]]


def explain(node: TreeNode, answer: Status, history: History, place: Placed) -> Reason:
    """Why a node answered so.

    Args:
        place: file and line of a node, or of one of its attributes.
    """
    base, attribute = decided(node, answer, history)
    file, line = place(node, attribute)
    step = Step(
        node.full_path, node.uid, _tag(node), node.name, file, line, answer.name, base.words, base.otherwise, base.fixed
    )
    if not base.by:
        return Reason((step,))
    answers = (history.answer(child, node) or history.of(child).answer or IDLE for child in base.by)
    below = [explain(child, answer, history, place) for child, answer in zip(base.by, answers, strict=True)]
    last = next((reason for reason in reversed(below) if not reason.fixed), below[-1])
    beside = (*(reason for reason in below if reason is not last), *last.beside)
    return Reason((step, *last.steps), beside)


def decided(node: TreeNode, answer: Status, history: History) -> tuple[Decision, str]:
    """What made a node answer so, and the attribute of the file that did, if one did."""
    if (replaced := getattr(vars(node).get("execute"), "replaced", None)) is not None:
        return Decision((), f"a monitor answered {replaced.name} in its place", "if the monitor had let it be"), ""
    if node.conditions is not None and answer is not RUNNING and (cause := node.conditions.decided) is not None:
        name, evaluated = cause
        return Decision((), f"{name}: {evaluated}", evaluated.otherwise), name
    if answer is FAILURE and node.raised:
        return Decision((), node.feedback_message, node.what_if), ""
    return node.decision(answer, history), ""


def _tag(node: TreeNode) -> str:
    return node.tag or type(node).__name__
