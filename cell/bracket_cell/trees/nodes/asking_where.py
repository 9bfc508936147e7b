"""Asking where a part goes, of a product that nobody knows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from bracket_cell.trees.nodes.asking import Asks
from bracket_cell.trees.nodes.pointing import Pointing
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.operator import PLACED_BY_HAND, Answer
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState, Placement
from btxml.engine.ports import InOutPort, InputPort
from btxml.engine.status import Status


class AskPosition(Asks):
    """Ask where a part goes, if the person builds an unknown product and places nothing for a while.

    Asked is for one type of part after the other, as long as the person wants to place it by hand: first for the one in
    the gripper, then for the rarest. A hand that points at an open hole answers, too.
    Succeeds when a position is told and the plan follows it. Fails at once where the goal is known, where the rest
    follows from what is placed, or where nobody is there; and when the person goes on, or nobody answers in time.
    """

    plan = InputPort(AssemblyPlan, "belief and plans")
    state = InOutPort(AssemblyState, "what is placed so far, and what a person said")
    settle_s = InputPort(float, "how long nothing must have been placed", default=6.0, least=0)
    wait_s = InputPort(float, "longest wait for an answer", default=60.0, least=0)
    points_s = InputPort(float, "how long a hand points at a hole to answer; 0: it does not", default=2.0, least=0)

    _placed: Mapping[str, str] = {}
    _part = ""
    _told: Placement | None = None
    _pointing: Pointing | None = None  # learns from all looks whether held parts are told

    def initialise(self) -> None:
        self._asked_s, self._placed = self.now.observation.time_s, self.state.get().placed
        self._told = None
        self._by_hand: set[str] = set()  # types that the person places
        self._pointing = self._pointing or Pointing(self.tools.product, self.tools.bench, self.points_s.get())

    def update(self) -> Status:
        assert self._pointing is not None
        legal = () if self._question is None else self._question.positions
        pointed = self._pointing.at(self.now.observation.bench, legal)
        if self._told is not None:
            return self.planned(self.plan.get().next_belief.get(self._told) == 1.0)
        services, part = self.services, self._next_part()
        if part is None:
            return Status.FAILURE
        if self.state.get().placed != self._placed:
            self.feedback_message = "the person goes on"
            return Status.FAILURE
        if self._question is None:
            if self._by_hand or self.compare(services.now.observation.time_s - self._asked_s, ">=", self.settle_s):
                self._ask(part)
            return Status.RUNNING
        answer = self.answered() or pointed
        if answer == PLACED_BY_HAND or services.now.observation.operator.newest("place", self._asked_s) is not None:
            self._by_hand.add(self._part)
            self.terminate(Status.RUNNING)
        elif answer is not None:
            self._tell(answer, "pointing" if answer == pointed else "answer")
            return Status.RUNNING
        return Status.FAILURE if self.late(self.wait_s.get()) else Status.RUNNING

    def _next_part(self) -> str | None:
        """The type to ask for."""
        services, state = self.services, self.state.get()
        held = services.memory.held_part if services.now.observation.gripper.holding else None
        needed = Counter(services.tools.product.most)
        needed.subtract(Counter(state.placed.values()))
        left = sorted((part for part in needed if needed[part] > 0), key=lambda part: (part != held, needed[part]))
        asked = [part for part in left if part not in self._by_hand]
        if state.told_goal != UNKNOWN_GOAL:
            self.feedback_message = "nobody said that this is a new product"
        elif len(left) < 2 or services.tools.guard.sure_of_next(self.plan.get(), held if held in left else None):
            self.feedback_message = "it follows from what is placed"
        elif not services.now.observation.operator.present:
            self.feedback_message = "nobody to ask"
        elif not asked:
            self.feedback_message = "the person places the rest"
        else:
            return asked[0]
        return None

    def _ask(self, part: str) -> None:
        services, state = self.services, self.state.get()
        positions = tuple(name for name in services.tools.product.positions if name not in state.placed)
        title = services.tools.product.title(part)
        listed = Message("{first} or {last}", first=", ".join(positions[:-1]), last=positions[-1])
        reason = Message("where does the {title} go: {listed}?", title=title, listed=listed)
        answers = (*(Answer(name, name) for name in positions), Answer(PLACED_BY_HAND, "I place it myself"))
        self._part, self._asked_s = part, services.now.observation.time_s
        self._question = services.ask(
            "where", reason, todo="say where I should put it", part=part, positions=positions, answers=answers
        )
        services.now.show(help_request=reason)
        services.tools.journal.note("help", text=reason, part=part, positions=list(positions))
        self.feedback_message = reason

    def _tell(self, position: str, source: str) -> None:
        self._told, state = (self._part, position), self.state.get()
        self.state.set(replace(state, told_parts={**state.told_parts, position: self._part}))
        self.tools.journal.note("belief", told_part=[self._part, position], source=source)
        self.feedback_message = Message("{part} goes to {position}", part=self._part, position=position)
