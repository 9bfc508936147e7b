"""Why the robot does what it does now, in one sentence: the tree's own reason, the supervisor's hold, the guard's word.

Terminal, page, monitor and `cell log why` say the same, as all of them ask here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from bracket_cell.watching.observer import Observer, TickRecord
from bracket_ground.interfaces.faults import Action
from btxml.engine.node import TreeNode
from btxml.engine.tree import Tree
from btxml.engine.why import Reason

HOLDS = (Action.HOLD.name, Action.STOP.name)


@dataclass(frozen=True)
class Guarded:
    """The guard's last verdict, as its note has it, and what would have changed it."""

    subject: str = ""
    decision: str = ""
    reason: str = ""
    otherwise: str = ""


@dataclass(frozen=True)
class Why:
    """Why, at one moment.

    Attributes:
        reason: of the tree; None before its first tick.
        held: why the supervisor holds the robot; empty where it does not.
        guard: empty where nothing was judged yet.
        causes: comparisons that whoever decided noted last, as `Cause` has them, with the time [s].
    """

    reason: Reason | None = None
    held: str = ""
    guard: Guarded = Guarded()
    causes: tuple[Mapping[str, Any], ...] = ()

    def __str__(self) -> str:
        said = [f"held: {self.held}"] if self.held else []
        said += [] if self.reason is None else [str(self.reason)]
        if self.guard_counts:
            said.append(f"the guard: {self.guard.reason}")
        return "; ".join(said)

    @property
    def otherwise(self) -> str:
        """What would have changed it: "if ..."; empty where nothing is known."""
        if self.held:
            return f"if this were over: {self.held}"
        if self.guard_counts and self.guard.otherwise:
            return self.guard.otherwise
        return "" if self.reason is None else self.reason.otherwise

    @property
    def guard_counts(self) -> bool:
        """Whether the guard keeps the robot from something that its tree does not name by itself."""
        named = "" if self.reason is None else str(self.reason)
        return self.guard.decision not in ("", "act", "unguarded") and self.guard.reason not in named

    def plain(self) -> dict[str, Any]:
        """By name, for pages and `--json`."""
        return {
            "text": str(self),
            "otherwise": self.otherwise,
            "held": self.held,
            "guard": asdict(self.guard),
            "causes": [dict(cause) for cause in self.causes],
            "tree": None if self.reason is None else self.reason.plain(),
        }


class WhyNow(Observer):
    """Follows what a tree does not know itself: notes of the guard, and the supervisor.

    Args:
        tree: the one that runs now.
    """

    def __init__(self, tree: Callable[[], Tree]) -> None:
        self._tree = tree
        self._verdict = Guarded()
        self._held, self._held_by = "", ""
        self._causes: dict[str, dict[tuple[str, str], Mapping[str, Any]]] = {}

    def tick(self, record: TickRecord) -> None:
        judged = record.judgement
        holds = judged is not None and judged.action.name in HOLDS
        self._held = judged.words if judged is not None and holds else ""
        self._held_by = judged.reasons[0][0] if judged is not None and holds and judged.reasons else ""
        for topic, fields in record.notes:
            if topic == "cause":
                key = str(fields["parameter"]), str(fields["of"])
                noted = {**fields, "time_s": record.observation.time_s}
                self._causes.setdefault(str(fields["by"]), {})[key] = noted
            elif topic == "verdict":
                words = (str(fields.get(name, "")) for name in ("subject", "decision", "reason"))
                self._verdict = Guarded(*words)

    def __call__(self) -> Why:
        """Why, after the last tick."""
        tree, verdict = self._tree(), self._verdict
        reason = tree.why()
        if reason is not None and tree.nodes[reason.leaf.uid - 1].traits.claims:  # the robot acts: nothing keeps it
            return Why(reason, self._held, causes=self._noted(reason))
        what_if = _what_if(tree.nodes, verdict.reason) if verdict.reason else ""
        why = Why(reason, self._held, replace(verdict, otherwise=what_if))
        return replace(why, causes=self._noted(reason, verdict.subject if why.guard_counts else ""))

    def _noted(self, reason: Reason | None, subject: str = "") -> tuple[Mapping[str, Any], ...]:
        """What the supervisor compared that holds the robot, else the guard about a placement, else the node."""
        if self._held:
            return tuple(self._causes.get(f"supervisor {self._held_by}", {}).values())
        if subject:
            return tuple(cause for (_, of), cause in self._causes.get("guard", {}).items() if of == subject)
        return () if reason is None else tuple(self._causes.get(reason.leaf.path, {}).values())


def _what_if(nodes: Iterable[TreeNode], said: str) -> str:
    """What the node would have needed that said so last."""
    return next((node.what_if for node in nodes if node.what_if and node.feedback_message == said), "")
