"""The guard: a learned plan is a proposal, checked before anything moves."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from pydantic import Field

from bracket_cell.trees.outlook import Looks, Outlook, after_looks, waiting_s
from bracket_ground.files.model import Model
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState, Placement, SemanticPlanner
from bracket_ground.interfaces.product import Product
from btxml.engine.causes import compared

Decision = Literal["act", "wait", "ask"]
TOLD = "if somebody said which goal it is"
MOVED = "the robot decides by two costs now: write wrong_act_s and question_s [s], or leave the key out"


class GuardSettings(Model):
    """What the guard weighs: it acts, asks or waits, whichever is expected to cost least time.

    Attributes:
        wrong_act_s: what a wrong act costs [s]: the part comes out again, and people trust the robot less. Never more
            than question_s / wrong_act_s of the acts of a kind are expected to be wrong: from there on it is cheaper
            to ask, and where nobody answers the robot waits.
        question_s: what a question costs [s], until it is answered. It is asked if a person can answer: in a shift and
            beside the operator's page.
        placement_s: what it costs to wait for one more part of the person [s].
        left_in_share: of the robot's wrong parts, how many people leave where they are. The more, the less what the
            robot placed itself speaks for the goal that it guessed: at 1 not at all, at 0 as much as people's parts.
        holes: what says that a hole is empty: seen, a reading of the camera, or graph, the assembly graph where nothing
            was read, as in the paper, whose cell reads no holes: the robot may then put a part onto another.
    """

    wrong_act_s: float = Field(default=300.0, ge=1, le=1e5)
    question_s: float = Field(default=30.0, ge=0.1, le=1e4)
    placement_s: float = Field(default=8.0, ge=0.1, le=1e3)
    left_in_share: float = Field(default=0.0, ge=0, le=1)
    holes: Literal["seen", "graph"] = "seen"
    moved: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("act_probability", "doubt_probability", "ask_probability", "wrong_share"), MOVED
    )

    @property
    def act_probability(self) -> float:
        """Least probability of a placement at which a wrong act is expected to cost no more than a question."""
        return max(0.0, 1.0 - self.question_s / self.wrong_act_s)


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

    def __init__(self, product: Product, settings: GuardSettings) -> None:
        self.product = self._product = product
        self._settings = settings
        self._looked: tuple[AssemblyPlan, AssemblyState, Looks] | None = None

    @property
    def sure_probability(self) -> float:
        """From which a placement is right by the costs, whatever the goal is."""
        return self._settings.act_probability

    @property
    def wants_holes(self) -> bool:
        """Whether a hole must have been read: what nothing was read of is unknown."""
        return self._settings.holes == "seen"

    def planned(self, planner: SemanticPlanner, state: AssemblyState) -> AssemblyPlan:
        """A planner's answer, in which the robot's own parts count as much as people look at them.

        Raises:
            ModelError: the planner cannot answer.
        """
        share, by_people = self._settings.left_in_share, state.by_people
        if state.told_goal is not None or share == 0.0 or by_people.placed == state.placed:
            return planner.plan(state)
        return planner.plan(by_people).left_in(self._product, state, share)

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
        waited_s: float = 0.0,
    ) -> Verdict:
        """Whether the robot may put `part` into `position` now.

        Args:
            may_ask: somebody is there who answers.
            waited_s: since a part was placed last.
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
        if not reachable:
            words = Message("the arm cannot reach {position} with {part}", position=position, part=part)
            return Verdict("ask", words, f"if {position} were within reach")
        return self._cheapest(plan, state, (part, position), may_ask, waited_s)

    def outlook(self, plan: AssemblyPlan, state: AssemblyState, may_ask: bool = True, waited_s: float = 0.0) -> Outlook:
        """What acting, waiting and asking are expected to cost."""
        settings, looked = self._settings, self._looked
        if looked is None or looked[0] is not plan or looked[1] != state:
            looks = after_looks(self._product, plan, state, settings.wrong_act_s, settings.question_s)
            self._looked = looked = plan, state, looks
        placements = plan.next_belief.values() if self.unclear(plan, state) is None else ()
        return Outlook(
            act_s=min(map(self._risk_s, placements), default=math.inf),
            wait_s=waiting_s(looked[2], settings.placement_s, waited_s if state.placed else 0.0),
            ask_s=settings.question_s if may_ask and state.told_goal is None else math.inf,
            after_one_s=next((cost_s for number, cost_s in looked[2] if number == 1), math.inf),
        )

    def _cheapest(
        self, plan: AssemblyPlan, state: AssemblyState, placement: Placement, may_ask: bool, waited_s: float
    ) -> Verdict:
        """Act, ask or wait; never act where a question would be cheaper, even if nobody answers it."""
        probability = plan.next_belief.get(placement, 0.0)
        risk_s, outlook = self._risk_s(probability), self.outlook(plan, state, may_ask, waited_s)
        most_s = min(self._settings.question_s, outlook.wait_s)
        least = 1.0 - most_s / self._settings.wrong_act_s
        words = Message("{part} at {position}", part=placement[0], position=placement[1])
        if (unclear := self.unclear(plan, state)) is not None:
            return Verdict("ask" if self._asks(outlook, str(words)) else "wait", unclear, TOLD)
        if self._compared("most_risk_s", risk_s, "<=", most_s, str(words)):
            reason = Message("{placement} has probability {probability:.2f}", placement=words, probability=probability)
            return Verdict("act", reason, f"if {words} had less than {least:.3f}")
        if self._asks(outlook, str(words)):
            question = "is this {goal}? Acting may cost {act_s:.0f} s, waiting {wait_s:.0f} s, a question {ask_s:.0f} s"
            return Verdict("ask", Message(question, goal=plan.goal, **vars(outlook)), TOLD)
        too_low = "{placement} has probability {probability:.3f} < {least:.3f}"
        reason = Message(too_low, placement=words, probability=probability, least=least)
        return Verdict("wait", reason, f"if {words} had at least {least:.3f}")

    def asks_for_goal(
        self, plan: AssemblyPlan, state: AssemblyState, may_ask: bool = True, waited_s: float = 0.0
    ) -> bool:
        """Whether a person should say which goal is built, as that costs less than to act or to wait.

        So it is, too, where a person showed that it is not the most probable one, see AssemblyState. What fits no known
        goal may have been misread, which further parts show: where none is missing it is asked whatever that costs.
        """
        if self.contradicted(plan, state) or state.told_goal is not None:
            return self.contradicted(plan, state)
        known = plan.goal in self._product.goals
        filled = self._product.accepted(plan.goal) if known else self._product.positions
        if not set(filled) <= state.placed.keys():
            return self._asks(self.outlook(plan, state, may_ask, waited_s), "goal")
        return plan.goal == UNKNOWN_GOAL or self.unclear(plan, state) is not None

    def unlisted_s(self, plan: AssemblyPlan) -> float:
        """What it is expected to cost to take a bracket for a known product."""
        return self._settings.wrong_act_s * plan.goal_belief.get(UNKNOWN_GOAL, 0.0)

    def sure_of_next(self, plan: AssemblyPlan, part: str | None = None) -> bool:
        """Whether a placement, of this type if one is named, is so probable that the robot may act, or ask about it."""
        beliefs = (belief for (name, _), belief in plan.next_belief.items() if part in (None, name))
        return self._likely(max(beliefs, default=0.0), part or "any part")

    def fits_none(self, state: AssemblyState) -> bool:
        """Whether no known goal has every placed part where it is, and nothing that was taken out again."""
        fitting = (goal for goal in self._product.goals if self._product.fits(goal, state.placed))
        return all(_has_taken_out(self._product.accepted(goal), state) for goal in fitting)

    def unclear(self, plan: AssemblyPlan, state: AssemblyState) -> Message | None:
        """Why the parts do not tell which product it is; None where they do, or where a person said it."""
        if state.told_goal is not None:
            return None
        if (before := self.before_exchange(state)) is not None:
            at = ", ".join(sorted(state.replaced.keys() & state.placed.keys()))
            return Message("this fitted {goal} before a person exchanged {at}", goal=before, at=at)
        if self.fits_none(state) and self.sure_goal(plan, state) is None:
            return Message("what is in the bracket fits no product that I know")
        return None

    def before_exchange(self, state: AssemblyState) -> str | None:
        """A known goal that only parts which people exchanged speak against: a swap looks like a mistake mended."""
        before = {at: part for at, part in state.replaced.items() if at in state.placed and at not in state.by_robot}
        for goal in self._product.goals if before else ():
            right = self._product.accepted(goal)
            undone = {at: part for at, part in before.items() if state.placed[at] not in right.get(at, ())}
            if undone and goal not in state.denied and self._product.fits(goal, {**state.placed, **undone}):
                return goal
        return None

    def sure_goal(self, plan: AssemblyPlan, state: AssemblyState) -> str | None:
        """The goal that a person told, or that is probable enough to act on; None where it is none that is known."""
        goal = plan.goal if state.told_goal is None else state.told_goal
        sure = state.told_goal is not None or self._likely(plan.goal_belief[goal], goal)
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
        if goal in state.denied:
            return True
        wanted = self._product.accepted(goal)
        if state.told_goal is not None:
            return any(wanted.get(position) == (part,) for position, part in state.against_told.items())
        right = {at: part for at, part in state.confirmed.items() if state.placed.get(at, part) == part}
        otherwise = any(part not in wanted.get(position, ()) for position, part in right.items())
        return otherwise or _has_taken_out(wanted, state)

    def _asks(self, outlook: Outlook, of: str) -> bool:
        """Whether a question is the cheapest."""
        return self._compared("asking_s", outlook.ask_s, "<", min(outlook.act_s, outlook.wait_s), of)

    def _likely(self, probability: float, of: str) -> bool:
        return self._compared("act_probability", probability, ">=", self._settings.act_probability, of)

    def _compared(self, parameter: str, measured: float, relation: str, limit: float, of: str) -> bool:
        """Expected costs [s] and probabilities, noted with the two costs of the configuration that make them."""
        costs = {"guard.wrong_act_s": self._settings.wrong_act_s, "guard.question_s": self._settings.question_s}
        return compared("guard", parameter, measured, relation, limit, "configuration, guard", of, **costs)

    def _risk_s(self, probability: float) -> float:
        """What it costs to make a placement that is right with this probability."""
        return self._settings.wrong_act_s * max(0.0, 1.0 - probability)

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
