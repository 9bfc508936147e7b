"""Working beside a person: wait for what they do, keep clear of the hand, ask."""

from __future__ import annotations

import math

import numpy as np
from py_trees.common import Status

from trees.nodes.services import CellNode
from trees.nodes.watching import SeenAction
from trees.ports import InputPort


class WaitForAction(CellNode):
    """Wait until the person begins an action of one kind; each one counts once (Alg. 1 line 9)."""

    kind = InputPort(str, "screw, assembly, transit or idle")
    action = InputPort(SeenAction, "what the person does")

    _served_s = -math.inf

    def update(self) -> Status:
        seen = self.action.get_or(None)
        if seen is None or seen.action.kind != self.kind.get() or seen.started_s <= self._served_s:
            self.feedback_message = f"waits for: {self.kind.get()}"
            return Status.RUNNING
        self._served_s = seen.started_s
        self.feedback_message = ""
        return Status.SUCCESS


class WaitForHandClear(CellNode):
    """Wait while the hand is near a position, or while nothing is known of the hand."""

    position = InputPort(str, "position that the arm goes to")
    distance_m = InputPort(float, "how near is too near", default=0.18)
    stale_s = InputPort(float, "oldest acceptable view of the bench", default=0.5)

    def update(self) -> Status:
        view = self.services.observation.bench
        if view is None or self.services.observation.time_s - view.time_s > self.stale_s.get():
            self.feedback_message = "no fresh view of the bench"
            return Status.RUNNING
        if view.hand is None:
            return Status.SUCCESS
        bench, product = self.services.bench, self.services.product
        hole_m = np.array([*product.bracket.holes_m[self.position.get()], 0.0])
        x, y, _ = bench.bracket.pose.transform(hole_m)
        nearest = min(math.dist((x, y), point) for point in (view.hand.fingertips_m, view.hand.palm_m))
        if nearest >= self.distance_m.get():
            return Status.SUCCESS
        self.feedback_message = f"the hand is near {self.position.get()}"
        self.services.show(message=f"waiting: {self.feedback_message}")
        return Status.RUNNING


class AskForHelp(CellNode):
    """Ask the person to do what the robot cannot (Alg. 2: "help")."""

    text = InputPort(str, "what to ask")
    part = InputPort(str, "type of the part concerned", default="")

    def update(self) -> Status:
        part = self.part.get()
        text = f"{part}: {self.text.get()}" if part else self.text.get()
        self.services.show(help_request=text)
        self.services.journal.note("help", text=text)
        self.feedback_message = text
        return Status.SUCCESS
