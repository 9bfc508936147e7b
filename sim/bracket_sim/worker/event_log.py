"""What the hand really did: actions without gaps, and what the person did besides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.perception import ActionKind

KEPT = 1000  # of each sort; a shift has many more


@dataclass(frozen=True)
class ActionEvent:
    """Truth for labelling: an action of the hand begins or ends.

    Attributes:
        part, position: of an assembly action, which lasts from grasp to release.
    """

    time_s: float
    kind: ActionKind
    edge: Literal["start", "end"]
    part: str | None = None
    position: str | None = None

    def truth(self) -> TruthEvent:
        """The same for the log."""
        fields = {"action": self.kind, "edge": self.edge, "part": self.part, "position": self.position}
        return TruthEvent(self.time_s, "action", fields)


class EventLog:
    """Collects what happens at the time that it was told last.

    Of what `news` told only the newest is kept, so that a shift of many hours needs no more memory than one bracket.

    Attributes:
        time_s: now.
        actions: which follow each other without gaps.
        acts: releases, habits and mistakes.
        doing: the action that goes on: kind, part, position.
    """

    def __init__(self) -> None:
        self.time_s = 0.0
        self.actions: list[ActionEvent] = []
        self.acts: list[TruthEvent] = []
        self.doing: tuple[ActionKind, str | None, str | None] | None = None
        self._told = 0, 0

    def begin(self, kind: ActionKind, part: str | None = None, position: str | None = None) -> None:
        """Note that one action ends and another begins."""
        if self.doing == (kind, part, position):
            return
        if self.doing is not None:
            self.actions.append(ActionEvent(self.time_s, self.doing[0], "end", *self.doing[1:]))
        self.doing = (kind, part, position)
        self.actions.append(ActionEvent(self.time_s, kind, "start", part, position))

    def note(self, act: str, **fields: object) -> None:
        """Note what the person does besides."""
        self.acts.append(TruthEvent(self.time_s, "act", {"act": act, **fields}))

    def news(self) -> list[TruthEvent]:
        """Actions and acts since the last call, in order."""
        actions, acts = self.actions[self._told[0] :], self.acts[self._told[1] :]
        del self.actions[:-KEPT], self.acts[:-KEPT]
        self._told = len(self.actions), len(self.acts)
        return sorted([*(action.truth() for action in actions), *acts], key=lambda event: event.time_s)
