"""Asking people: for help with a part, or which goal is built; and hearing what an operator says unasked."""

from __future__ import annotations

import math

from bracket_cell.trees.nodes.services import CellNode, Services
from bracket_ground.files.words.message import Message, listed
from bracket_ground.interfaces.operator import HELP_GIVEN, PLACED_BY_HAND, Answer, Question
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from btxml.engine.ports import InOutPort, InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

TRAY_MARGIN_M = 0.05
LIKELIEST_N = 4  # goals that a question offers
PLANNED_S, SURE = 1.0, 0.99  # within so long a plan follows what was said; so probable is what was told


class Asks(CellNode):
    """Base of nodes that put a question to people: it is withdrawn however the node ends."""

    abstract = True
    what_if = "if somebody answered"

    _question: Question | None = None
    _asked_s = 0.0
    _said_s: float | None = None

    def answered(self) -> str | None:
        """What somebody answered, None as long as nobody did."""
        return None if self._question is None else self.now.observation.operator.answer(self._question.number)

    def planned(self, known: bool) -> Status:
        """Succeeds when the plan knows what was said, and after a while in any case: some planners take nothing in."""
        now_s = self.now.observation.time_s
        self._said_s = now_s if self._said_s is None else self._said_s
        return Status.SUCCESS if known or now_s - self._said_s > PLANNED_S else Status.RUNNING

    def late(self, wait_s: float) -> bool:
        """Whether nobody answered in time; then it is said."""
        if self.now.observation.time_s - self._asked_s <= wait_s:
            return False
        self.feedback_message = Message("nobody answered within {wait_s} s", wait_s=f"{wait_s:g}")
        return True

    def terminate(self, new_status: Status) -> None:  # noqa: ARG002 - however it ends
        self._said_s = None
        if self._question is not None:
            self.now.withdraw(self._question)
            self.now.show(help_request=None)
            self._question = None


class AskForHelp(Asks):
    """Ask the person to do what the robot cannot (Alg. 2: "help"), and wait for it as long as the tree says.

    Succeeds when help was given, and the robot should try again: somebody says so, or a hand was in the tray and left.
    Fails when the person places the part, says so, or nobody answers in time.
    """

    text = InputPort(str, "what to ask", least=1)
    part = InputPort(str, "type of the part concerned", default="")
    wait_s = InputPort(float, "longest wait for help; 0 asks and goes on", default=0.0, least=0)

    _standing = 0
    _hand_there = False

    def initialise(self) -> None:
        services, part = self.services, self.part.get()
        title = services.tools.product.title(part)
        reasons, services.memory.reasons = services.memory.reasons, {}
        reason = next(reversed(list(reasons)), "")
        times = "{why} ({count} times)"
        tried = listed([Message(times, why=why, count=count) for why, count in reasons.items() if count > 1])
        text = listed([words for words in (title if part else "", reason, self.text.get()) if words], ": ")
        services.now.show(help_request=text)
        services.tools.journal.note("help", text=text, part=part, reason=reason, tried=tried)
        self.feedback_message = text
        self._asked_s, self._standing, self._hand_there = services.now.observation.time_s, self._placed(), False
        if self.wait_s.get() > 0:
            todo = self.text.get()
            answers = (Answer(HELP_GIVEN, "done, look again"), Answer(PLACED_BY_HAND, "I place it myself"))
            asked = reason or (Message("I need help with the {title}", title=title) if part else todo)
            self._question = services.ask("help", asked, tried=tried, todo=todo, part=part, answers=answers)

    def update(self) -> Status:
        services = self.services
        if self._question is None:
            return Status.SUCCESS
        answer = self.answered()
        if answer == HELP_GIVEN or self._hand_was_in_tray():
            self.feedback_message = "help was given" if answer else "somebody was at the tray"
            return Status.SUCCESS
        placing = services.now.observation.operator.newest("place", self._asked_s)
        if answer == PLACED_BY_HAND or placing is not None or self._placed() > self._standing:
            self.feedback_message = "the person places it"
            return Status.FAILURE
        return Status.FAILURE if self.late(self.wait_s.get()) else Status.RUNNING

    def _placed(self) -> int:
        """In how many holes such a part is seen."""
        view, part = self.now.observation.bench, self.part.get()
        return sum(hole.part == part for hole in view.holes.values()) if view and part else 0

    def _hand_was_in_tray(self) -> bool:
        view, tray = self.now.observation.bench, self.tools.bench.tray
        if view is None or view.hand_unknown:
            return False
        if view.hand is None:
            return self._hand_there
        offsets = (abs(a - b) for a, b in zip(view.hand.fingertips_m, tray.centre_m, strict=False))
        there = all(off < size / 2 + TRAY_MARGIN_M for off, size in zip(offsets, tray.size_m, strict=True))
        was, self._hand_there = self._hand_there, self._hand_there or there
        return was and not there


class AskOperator(Asks):
    """Ask the person a question, and wait for one of its answers, or for any text; fails without one.

    A text may have up to 200 characters.
    """

    text = InputPort(str, "what to ask", least=1)
    answers = InputPort(list[str], "what may be answered: yes;no; empty for any text", default=["done"])
    wait_s = InputPort(float, "longest wait in [s]; 0 waits for ever", default=60.0, least=0)
    answer = OutputPort(str, "what was answered")

    def initialise(self) -> None:
        text, answers = self.text.get(), tuple(Answer(words, words) for words in self.answers.get())
        self._asked_s = self.now.observation.time_s
        self._question = self.services.ask("choice" if answers else "text", text, todo=text, answers=answers)
        self.now.show(help_request=text)
        self.tools.journal.note("help", text=text, answers=[answer.value for answer in answers])
        self.feedback_message = Message("asks: {text}", text=text)

    def update(self) -> Status:
        said, wait_s = self.answered(), self.wait_s.get()
        if said is not None:
            self.answer.set(said)
            self.feedback_message = Message("answered: {said}", said=said)
            return Status.SUCCESS
        return Status.FAILURE if wait_s > 0 and self.late(wait_s) else Status.RUNNING


class AskWhichGoal(Asks):
    """Ask which product is built, if no known one fits or the first act would be a guess.

    Succeeds when it is told and the plan follows it, or when the doubt has gone by itself; fails at once where there is
    nothing to ask or nobody to answer, and when no answer comes in time. Two such nodes ask one question.
    """

    plan = InputPort(AssemblyPlan, "belief over goals")
    state = InOutPort(AssemblyState, "what is placed so far, and which goal was named")
    wait_s = InputPort(float, "longest wait for an answer", default=60.0, least=0)
    unattended = InputPort(bool, "ask even if no person is known to be there", default=False)
    order = InputPort(bool, "ask where what is placed contradicts the work order, too", default=False)

    _asks = False  # this node, or another one the same

    def initialise(self) -> None:
        self._asked_s, self._asks = self.now.observation.time_s, False

    def update(self) -> Status:
        services, plan, state = self.services, self.plan.get(), self.state.get()
        answer = self.answered()
        guard = services.tools.guard
        if self._asks and answer is not None and (state.told_goal is None or guard.contradicted(plan, state)):
            tell_goal(self, state, answer)
            state = self.state.get()
        if self._asks and (goal := state.told_goal) is not None and not guard.contradicted(plan, state):
            self.feedback_message = Message("it is {told}", told=goal)
            return self.planned(plan.goal_belief.get(goal, 0.0) > SURE)
        against = self.order.get() and against_order(services, state)
        if not (against or guard.asks_for_goal(plan, state, waited_s=services.waited_s)):
            self.feedback_message = "the goal is clear by now" if self._asks else "nothing to ask"
            return Status.SUCCESS if self._asks else Status.FAILURE
        if not (services.now.observation.operator.present or self.unattended.get()):
            self.feedback_message = "nobody to ask"
            return Status.FAILURE
        if not any(question.kind == "goal" for question in services.now.display.questions):
            self._ask(plan, state)
        self._asks = True
        return Status.FAILURE if self.late(self.wait_s.get()) else Status.RUNNING

    def _ask(self, plan: AssemblyPlan, state: AssemblyState) -> None:
        services, belief = self.services, plan.goal_belief
        product = services.tools.product
        ranked = sorted(product.goals, key=lambda goal: -belief.get(goal, 0.0))[:LIKELIEST_N]
        answers = [
            Answer(
                goal,
                Message("{goal} ({share})", goal=product.goal_title(goal), share=f"{belief.get(goal, 0.0):.0%}"),
                product.goal_placements(goal, state.placed),
            )
            for goal in ranked
        ]
        answers.append(Answer(UNKNOWN_GOAL, "a new one"))
        goal = product.goal_title(plan.goal if state.told_goal is None else state.told_goal)
        doubt = "I am not sure that this is {goal}: a product that I do not know has probability {unknown:.2f}"
        reason: str = Message(doubt, goal=goal, unknown=belief.get(UNKNOWN_GOAL, 0.0))
        job = services.now.observation.operator.job
        if job is not None and self.order.get() and against_order(services, state):
            title = product.goal_title
            words = "work order {id} wants {wanted}, and this looks like {goal}"
            reason = Message(words, id=job.id, wanted=title(job.variant), goal=title(plan.goal))
            if plan.goal == job.variant:
                reason = Message("what is placed contradicts work order {id}", id=job.id)
        elif plan.goal == UNKNOWN_GOAL:
            reason = Message("this looks like no product that I know")
        elif state.denied:
            reason = "you said that it is not what I took it for"
        elif state.taken_out:
            reason = Message("I took this for {goal}, and what I placed was taken out again", goal=goal)
        elif (unclear := services.tools.guard.unclear(plan, state)) is not None:
            reason = unclear
        self._question = services.ask("goal", reason, todo="say which one you build", answers=tuple(answers))
        services.now.show(help_request=Message("{reason}; which one is it?", reason=reason))
        outlook = services.tools.guard.outlook(plan, state, waited_s=services.waited_s)
        costs = {name: round(cost_s, 1) for name, cost_s in vars(outlook).items() if math.isfinite(cost_s)}
        services.tools.journal.note("help", text=reason, goals=ranked, belief=dict(belief), costs=costs)
        self.feedback_message = reason


class HearOperator(CellNode):
    """Take over which goal the operator says is being built, or is not; each statement counts once."""

    state = InOutPort(AssemblyState, "what is placed so far, and which goal was named")
    persistent = ("_heard_s",)
    traits = Traits(instant=True)

    _heard_s = -math.inf

    def update(self) -> Status:
        operator, heard_s = self.now.observation.operator, self._heard_s
        if (other := operator.newest("other", heard_s)) is not None:
            self._heard_s = other.time_s
            self.state.set(self.state.get().without(other.value))
            self.tools.journal.note("belief", denied=other.value)
            self.feedback_message = Message("the operator says that it is not {goal}", goal=other.value)
        if (said := operator.newest("goal", heard_s)) is not None:
            self._heard_s = max(self._heard_s, said.time_s)
            tell_goal(self, self.state.get(), said.value)
            self.feedback_message = Message("the operator says {goal}", goal=said.value)
        return Status.SUCCESS


class WaitWhilePaused(CellNode):
    """Begin nothing new while the operator wants a pause."""

    def update(self) -> Status:
        if self.now.observation.operator.pause == "none":
            return Status.SUCCESS
        self.feedback_message = "paused by the operator"
        self.now.show(message=self.feedback_message)
        return Status.RUNNING


def against_order(services: Services, state: AssemblyState) -> bool:
    """Whether a hole shows another part than the work order wants there, and nobody said which goal it is."""
    job, view = services.now.observation.operator.job, services.now.observation.bench
    product = services.tools.product
    if job is None or view is None or state.told_goal is not None or job.variant not in product.goals:
        return False
    wanted = product.goal_placements(job.variant, state.placed)
    seen = {at: hole.part for at, hole in view.holes.items() if hole.part in product.parts}
    return any(state.placed.get(at) == part != wanted.get(at) for at, part in seen.items())


def tell_goal(node: AskWhichGoal | HearOperator, state: AssemblyState, goal: str) -> None:
    """Write into the state of the assembly what a person said of its goal."""
    node.state.set(state.with_goal(goal))
    node.tools.journal.note("belief", told=goal)
