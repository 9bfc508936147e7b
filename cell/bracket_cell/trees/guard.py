"""The guard: a learned plan is a proposal, checked before anything moves."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from bracket_ground.files.model import Model
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from bracket_ground.interfaces.product import Product

Decision = Literal["act", "wait", "ask"]
TOLD = "if somebody said which goal it is"


class GuardSettings(Model):
    """Thresholds of the guard.

    Attributes:
        act_probability: least posterior of the next (part, position) at which the robot acts.
        wrong_share: share of acts that may be wrong, as the semantic planner itself expects. If it knows goals that the
            product does not list, the robot may need a higher probability to act, and asks or waits below it; 1 never.
        ask_probability: posterior of "none of these goals" from which the robot asks.
        doubt_probability: posterior of "none of these goals" from which the robot asks which goal it is instead of
            acting, until it gets an answer; 1 never asks. It counts if a person can answer: in a shift and
            beside the operator's page.
        holes: what says that a hole is empty: seen, a reading of the camera, or graph, the assembly graph where nothing
            was read, as in the paper, whose cell reads no holes: the robot may then put a part onto another.
    """

    act_probability: float = Field(default=0.9, ge=0.01, le=1)
    wrong_share: float = Field(default=0.02, ge=0.001, le=1)
    ask_probability: float = Field(default=0.5, ge=0.01, le=1)
    doubt_probability: float = Field(default=0.01, ge=0.001, le=1)
    holes: Literal["seen", "graph"] = "seen"


@dataclass(frozen=True)
class Verdict:
    """What the guard decided about one placement, and why.

    Attributes:
        otherwise: what would have changed it: "if ...".
    """

    decision: Decision
    reason: str
    otherwise: str = ""


class Guard:
    """Judges plans and placements against the product, the seen occupancy, the belief and the arm's reach."""

    def __init__(self, product: Product, settings: GuardSettings, act_probability: float | None = None) -> None:
        """Args:
        act_probability: from which the robot acts unasked, where the goals that are known ask for more than the
            settings' own.
        """
        self._product = product
        self._settings = settings
        self._act_probability = settings.act_probability if act_probability is None else act_probability

    @property
    def sure_probability(self) -> float:
        """From which a placement is right by the settings, whatever the goal is."""
        return self._settings.act_probability

    @property
    def wants_holes(self) -> bool:
        """Whether a hole must have been read: what nothing was read of is unknown."""
        return self._settings.holes == "seen"

    def refusal(self, plan: AssemblyPlan, state: AssemblyState) -> str | None:
        """Why this plan cannot be used at all, or None: NaN, words outside the vocabulary, impossible positions."""
        return (
            self._bad_belief(plan.goal_belief) or self._bad_placements(plan) or self._bad_guidance(plan.guidance, state)
        )

    def judge(
        self,
        plan: AssemblyPlan,
        state: AssemblyState,
        holes: Mapping[str, HoleView],
        part: str,
        position: str,
        reachable: bool,
        may_ask: bool = True,
    ) -> Verdict:
        """Whether the robot may put `part` into `position` now.

        Args:
            may_ask: somebody is there who answers: a doubt about the goal is asked instead of acted on.
        """
        if self.contradicted(plan, state):
            goal = plan.goal if state.told_goal is None else state.told_goal
            words = Message("this was taken for {goal}, and a person showed that it is another", goal=goal)
            return Verdict("ask", words, TOLD)
        if state.taken_out.get(position) == part:
            words = Message("a person took {part} out of {position}", part=part, position=position)
            return Verdict("wait", words, f"if a person put something into {position}")
        empty = f"if {position} were seen empty"
        if position in state.placed:
            words = Message("{position} already holds {part}", position=position, part=state.placed[position])
            return Verdict("wait", words, empty)
        if self._remaining(state)[part] <= 0:
            words = Message("no {part} remains to be placed", part=part)
            return Verdict("wait", words, f"if a {part} were taken out again")
        if first := self._comes_first(plan, state, position):
            words = Message("{first} comes before {position}", first=", ".join(first), position=position)
            return Verdict("wait", words, f"if {', '.join(first)} were done")
        hole = holes.get(position)
        if hole is None and self.wants_holes:
            return Verdict("wait", Message("{position} has not been seen yet", position=position), empty)
        if hole is not None and hole.part is not None:
            words = Message("{position} is seen to hold {part}", position=position, part=hole.part)
            return Verdict("wait", words, empty)
        unknown = plan.goal_belief.get(UNKNOWN_GOAL, 0.0)
        if unknown >= self._settings.ask_probability and state.told_goal is None:
            words = Message("this looks like no known goal (probability {unknown:.2f})", unknown=unknown)
            return Verdict("ask", words, f"if that were below {self._settings.ask_probability}, or {TOLD[3:]}")
        probability, least = plan.next_belief.get((part, position), 0.0), self._settings.act_probability
        placement = Message("{part} at {position}", part=part, position=position)
        too_low = "{placement} has probability {probability:.2f} < {least}"
        if probability < least:
            words = Message(too_low, placement=placement, probability=probability, least=least)
            return Verdict("wait", words, f"if {placement} had at least {least}")
        if not reachable:
            words = Message("the arm cannot reach {position} with {part}", position=position, part=part)
            return Verdict("ask", words, f"if {position} were within reach")
        if may_ask and state.told_goal is None and self._doubts(unknown, probability):
            question = "is this {goal}? A goal that I do not know has probability {unknown:.3f}"
            return Verdict("ask", Message(question, goal=plan.goal, unknown=unknown), TOLD)
        if probability < self._act_probability:
            least = self._act_probability
            too_low = "{placement} has probability {probability:.3f} < {least:.3f}, as many goals are in use"
            words = Message(too_low, placement=placement, probability=probability, least=least)
            return Verdict("wait", words, f"if {placement} had at least {least:.3f}")
        words = Message("{placement} has probability {probability:.2f}", placement=placement, probability=probability)
        return Verdict("act", words, f"if {placement} had less than {least}")

    def asks_for_goal(self, plan: AssemblyPlan, state: AssemblyState) -> bool:
        """Whether a person should say which goal is built: it looks like none, or the first act would be a guess.

        So it is where what is placed fits no known goal, and none is so probable that something must be wrong; and
        where a person showed that it is not the most probable one, see AssemblyState.
        """
        unknown = plan.goal_belief.get(UNKNOWN_GOAL, 0.0)
        if self.contradicted(plan, state) or state.told_goal is not None:
            return self.contradicted(plan, state)
        if self.fits_none(state) and self.sure_goal(plan, state) is None:
            return True
        best = max(plan.next_belief.values(), default=0.0)
        return unknown >= self._settings.ask_probability or (self.sure_of_next(plan) and self._doubts(unknown, best))

    def sure_of_next(self, plan: AssemblyPlan, part: str | None = None) -> bool:
        """Whether a placement, of this type if one is named, is so probable that the robot may act, or ask about it."""
        beliefs = (belief for (name, _), belief in plan.next_belief.items() if part in (None, name))
        return max(beliefs, default=0.0) >= self._settings.act_probability

    def fits_none(self, state: AssemblyState) -> bool:
        """Whether no known goal has every placed part where it is, and nothing that was taken out again."""
        fitting = (goal for goal in self._product.goals if self._product.fits(goal, state.placed))
        return all(_has_taken_out(self._product.accepted(goal), state) for goal in fitting)

    def sure_goal(self, plan: AssemblyPlan, state: AssemblyState) -> str | None:
        """The goal that a person told, or that is probable enough to act on; None where it is none that is known."""
        goal = plan.goal if state.told_goal is None else state.told_goal
        sure = state.told_goal is not None or plan.goal_belief[goal] >= self._settings.act_probability
        if self.contradicted(plan, state):
            return None
        return goal if sure and goal in self._product.goals else None

    def contradicted(self, plan: AssemblyPlan, state: AssemblyState) -> bool:
        """Whether a person showed that it is another goal than was said, or than is believed, where nothing was said.

        It was shown by a word, or by taking out what the robot placed. What somebody says later counts more.
        """
        goal = plan.goal if state.told_goal is None else state.told_goal
        if goal not in self._product.goals:
            return False
        wanted = self._product.accepted(goal)
        if state.told_goal is not None:
            return any(wanted.get(position) == (part,) for position, part in state.against_told.items())
        right = {at: part for at, part in state.confirmed.items() if state.placed.get(at, part) == part}
        otherwise = any(part not in wanted.get(position, ()) for position, part in right.items())
        return otherwise or _has_taken_out(wanted, state)

    def _doubts(self, unknown: float, best: float) -> bool:
        """Whether to ask rather than act: it may be none of the known goals, or another one of many."""
        doubt = self._settings.doubt_probability
        return doubt < 1 and (unknown >= doubt or best < self._act_probability)

    def _remaining(self, state: AssemblyState) -> Counter[str]:
        needed = Counter(self._product.most)
        needed.subtract(Counter(state.placed.values()))
        return needed

    def _comes_first(self, plan: AssemblyPlan, state: AssemblyState, position: str) -> list[str]:
        """Steps that precede a placement, and are not done yet."""
        goal = plan.goal if state.told_goal is None else state.told_goal
        filled = self._product.accepted(goal) if goal in self._product.goals else None
        return self._product.missing_before(position, {*state.placed, *state.fastened}, filled)

    def _bad_belief(self, belief: Mapping[str, float]) -> str | None:
        legal = {*self._product.goals, UNKNOWN_GOAL}
        if words := sorted(set(belief) - legal):
            return f"unknown goals {words}"
        if not all(_is_probability(value) for value in belief.values()):
            return f"goal belief {dict(belief)} holds a value outside 0..1"
        if not math.isclose(sum(belief.values()), 1.0, abs_tol=1e-3):
            return f"goal belief sums to {sum(belief.values()):.3f}"
        return None

    def _bad_placements(self, plan: AssemblyPlan) -> str | None:
        for (part, position), value in plan.next_belief.items():
            if part not in self._product.parts or position not in self._product.positions:
                return f"unknown placement {part} at {position}"
            if not _is_probability(value):
                return f"belief of {part} at {position} is {value}"
        if plan.next_part is not None and plan.next_part not in self._product.parts:
            return f"unknown next part {plan.next_part}"
        return None

    def _bad_guidance(self, guidance: Mapping[str, tuple[str, ...]], state: AssemblyState) -> str | None:
        remaining = self._remaining(state)
        for part, positions in guidance.items():
            if part not in self._product.parts:
                return f"plan for unknown part {part}"
            if words := [position for position in positions if position not in self._product.positions]:
                return f"plan for {part} names unknown positions {words}"
            if taken := [position for position in positions if position in state.placed]:
                return f"plan for {part} names filled positions {taken}"
            if len(set(positions)) != len(positions) or len(positions) > max(remaining[part], 0):
                return f"plan for {part} names {list(positions)}, but {remaining[part]} remain"
        return None


def _has_taken_out(wanted: Mapping[str, tuple[str, ...]], state: AssemblyState) -> bool:
    """Whether a goal has nothing else where a person took something out again; it names what it takes by position."""
    return any(wanted.get(position) == (part,) for position, part in state.taken_out.items())


def _is_probability(value: float) -> bool:
    return math.isfinite(value) and -1e-6 <= value <= 1 + 1e-6
