"""Mistakes that stay in the bracket: noticed, told to the person, and watched until they are mended."""

from __future__ import annotations

from dataclasses import replace

from bracket_cell.trees.nodes.asking import Asks, against_order
from bracket_cell.trees.nodes.mistakes import KINDS, Mistake, Mistakes, mistakes_in, reason_of, todo_of
from bracket_cell.trees.nodes.services import CellNode
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.operator import HELP_GIVEN, IS_RIGHT, Answer
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState
from btxml.engine.ports import InOutPort, InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits


class AwaitMistake(CellNode):
    """Wait until something in the bracket has looked wrong for a while, and output which holes.

    A person who notices it mends it by themselves meanwhile. Mistakes of one kind are reported together.
    """

    state = InputPort(AssemblyState, "what is placed so far")
    plan = InputPort(AssemblyPlan, "belief over goals")
    settle_s = InputPort(float, "how long it must look wrong", default=6.0, least=0)
    hidden_s = InputPort(float, "how long nothing could be read in a hole", default=45.0, least=0)
    mistakes = OutputPort(tuple[Mistake, ...], "what is to be mended")
    persistent = ("_since_s", "_began_s")

    _began_s: float | None = None

    def prepare(self) -> None:
        self._since_s: dict[Mistake, float] = {}  # when each was first seen

    def update(self) -> Status:
        view = self.now.observation.bench
        if view is None:
            self.feedback_message = "no view of the bench yet"
            return Status.RUNNING
        self._began_s = view.time_s if self._began_s is None else self._began_s
        now = mistakes_in(self.services, self.plan.get(), self.state.get())
        self._since_s = {mistake: self._since_s.get(mistake, view.holes[mistake.position].seen_s) for mistake in now}
        settled = [
            mistake for mistake in now if self.compare(self._stood_s(mistake), ">=", self.settle_s, mistake.position)
        ]
        settled += self._hidden()
        for kind in KINDS:
            if mistakes := tuple(mistake for mistake in settled if mistake.kind == kind):
                self.mistakes.set(mistakes)
                self.feedback_message = reason_of(self.tools.product, mistakes)
                return Status.SUCCESS
        self.feedback_message = f"watches {' '.join(mistake.position for mistake in now)}" if now else ""
        return Status.RUNNING

    def _stood_s(self, mistake: Mistake) -> float:
        """How long it was seen so; a hole that a hand covers tells nothing new."""
        view = self.now.observation.bench
        assert view is not None
        return view.holes[mistake.position].seen_s - self._since_s[mistake]

    def _hidden(self) -> list[Mistake]:
        view, kept = self.now.observation.bench, self.state.get().kept
        assert view is not None
        assert self._began_s is not None
        if not self.tools.guard.wants_holes:
            return []
        product = self.tools.product
        covered = {below for slot, below in product.carried_by.items() if slot in self.state.get().placed}
        last_s = {name: view.holes[name].seen_s if name in view.holes else self._began_s for name in product.positions}
        return [
            Mistake(name, "hidden")
            for name, seen_s in last_s.items()
            if name not in {*kept, *covered} and self.compare(view.time_s - seen_s, ">=", self.hidden_s, name)
        ]


class AwaitMisfit(CellNode):
    """Wait until the placed parts have fitted no known product for a while, or another one before an exchange."""

    state = InputPort(AssemblyState, "what is placed so far, and which goal was named")
    settle_s = InputPort(float, "how long it must fit none", default=6.0, least=0)

    _since_s: float | None = None

    def initialise(self) -> None:
        self._since_s = None

    def update(self) -> Status:
        services, state = self.services, self.state.get()
        guard = services.tools.guard
        if state.told_goal is not None or not (guard.fits_none(state) or guard.before_exchange(state)):
            self._since_s = None
            self.feedback_message = ""
            return Status.RUNNING
        now_s = services.now.observation.time_s
        self._since_s = now_s if self._since_s is None else self._since_s
        self.feedback_message = "it fits no product that is known"
        return Status.SUCCESS if self.compare(now_s - self._since_s, ">=", self.settle_s) else Status.RUNNING


class AwaitContradiction(CellNode):
    """Wait until a person has contradicted for a while what was ordered: the work order, or the goal that was named."""

    state = InputPort(AssemblyState, "what is placed so far, and which goal was named")
    plan = InputPort(AssemblyPlan, "belief over goals")
    settle_s = InputPort(float, "how long it must contradict it", default=2.0)

    _since_s: float | None = None

    def initialise(self) -> None:
        self._since_s = None

    def update(self) -> Status:
        now_s, state = self.now.observation.time_s, self.state.get()
        against = state.told_goal is not None and self.tools.guard.contradicted(self.plan.get(), state)
        if not (against or against_order(self.services, state)):
            self._since_s = None
            return Status.RUNNING
        self._since_s = now_s if self._since_s is None else self._since_s
        return Status.SUCCESS if self.compare(now_s - self._since_s, ">=", self.settle_s) else Status.RUNNING


class AskToMend(Asks):
    """Tell the person what is wrong in the bracket, and wait until the bench shows that it was mended.

    Of parts that are too many, the person may say which one does not belong there: then that one is asked about alone.
    Succeeds when it looks otherwise, or when the person says that it is right. Fails when it still looks the same
    though somebody says that it was mended, and when nobody answers in time.
    """

    mistakes = InputPort(tuple[Mistake, ...], "what is to be mended")
    plan = InputPort(AssemblyPlan, "belief over goals")
    state = InOutPort(AssemblyState, "what is placed so far, and what a person said is right")
    look_s = InputPort(
        float, "how long it is looked at again after somebody says that it was mended", default=3.0, least=0
    )
    wait_s = InputPort(float, "longest wait for it; 0 waits for ever", default=0.0, least=0)
    persistent = ("_before",)

    _before: Mistakes = ()  # what was asked about last, where that changed nothing
    _done_s: float | None = None

    _asked: Mistakes = ()

    def initialise(self) -> None:
        self._asked_s, self._done_s = self.now.observation.time_s, None
        self._asked = self._standing(self.mistakes.get())
        again, self._before = self._asked == self._before, ()
        if self._asked:
            self._ask("I asked this before, and it looks the same" if again else "")

    def update(self) -> Status:
        services = self.services
        if not self._standing(self._asked):
            self.feedback_message = "it looks otherwise now"
            return Status.SUCCESS
        answer = self.answered()
        if answer == IS_RIGHT:
            keep(self, self._asked, "a person says that it is right")
            return Status.SUCCESS
        if (named := self._named(answer)) is not None:
            keep(
                self,
                tuple(mistake for mistake in self._asked if mistake is not named),
                Message("a person says that {answer} is wrong", answer=answer),
            )
            self.terminate(Status.RUNNING)
            self._asked, self._asked_s = (named,), services.now.observation.time_s
            self._ask("")
        elif answer is not None:
            self._done_s = services.now.observation.time_s if self._done_s is None else self._done_s
            if self.compare(services.now.observation.time_s - self._done_s, ">=", self.look_s):
                self.feedback_message = "it still looks the same"
                return self._in_vain()
        elif self.wait_s.get() > 0 and self.late(self.wait_s.get()):
            return self._in_vain()
        return Status.RUNNING

    def _ask(self, tried: str) -> None:
        services, mistakes = self.services, self._asked
        reason, todo = reason_of(services.tools.product, mistakes), todo_of(mistakes)
        answers = [Answer(HELP_GIVEN, "done, look again")]
        if mistakes[0].kind == "surplus" and len(mistakes) > 1:
            answers += [
                Answer(mistake.position, Message("{position} is wrong", position=mistake.position))
                for mistake in mistakes
            ]
        if mistakes[0].kind != "hidden":
            answers.append(Answer(IS_RIGHT, "it is right so"))
        positions = tuple(mistake.position for mistake in mistakes)
        self._question = services.ask(
            "mend", reason, tried=tried, todo=todo, positions=positions, answers=tuple(answers)
        )
        services.now.show(help_request=Message("{reason}: {todo}", reason=reason, todo=todo))
        services.tools.journal.note(
            "help",
            text=Message("{reason}: {todo}", reason=reason, todo=todo),
            reason=reason,
            tried=tried,
            positions=list(positions),
        )
        self.feedback_message = reason

    def _named(self, answer: str | None) -> Mistake | None:
        """The one of several that a person says is wrong."""
        return next((mistake for mistake in self._asked if mistake.position == answer), None)

    def _in_vain(self) -> Status:
        self._before = self._standing(self._asked)
        return Status.FAILURE

    def _standing(self, mistakes: Mistakes) -> Mistakes:
        """Those that still look as they were told."""
        view = self.now.observation.bench
        holes = view.holes if view else {}
        now = mistakes_in(self.services, self.plan.get(), self.state.get())
        return tuple(
            mistake
            for mistake in mistakes
            if mistake in now
            or (
                mistake.kind == "hidden"
                and (mistake.position not in holes or holes[mistake.position].seen_s < self._asked_s)
            )
        )


class LeaveMistake(CellNode):
    """Accept a mistake that was not corrected: note that the bracket is wrong there, and do not ask again."""

    mistakes = InputPort(tuple[Mistake, ...], "what was to be mended")
    state = InOutPort(AssemblyState, "what is placed so far, and what stays as it is")

    def update(self) -> Status:
        keep(self, self.mistakes.get(), "it was not mended", known_wrong=True)
        return Status.SUCCESS


class BracketIsRight(CellNode):
    """Nothing in the bracket looks wrong, except what a person has accepted.

    A full bracket that is like no known product is not right before somebody says so.
    """

    state = InputPort(AssemblyState, "what is placed so far")
    plan = InputPort(AssemblyPlan, "belief over goals")
    node_type = "Condition"
    traits = Traits(instant=True)

    def update(self) -> Status:
        services, plan, state = self.services, self.plan.get(), self.state.get()
        if found := mistakes_in(services, plan, state):
            self.feedback_message = reason_of(services.tools.product, found[:1])
        elif services.tools.guard.asks_for_goal(plan, state):
            self.feedback_message = "it is not known which product this is"
        else:
            self.feedback_message = ""
            return Status.SUCCESS
        return Status.FAILURE


def keep(node: AskToMend | LeaveMistake, mistakes: Mistakes, why: str, known_wrong: bool = False) -> None:
    """Take it as it is from now on, in this bracket."""
    holes = {mistake.position: mistake.part for mistake in mistakes}
    state = node.state.get()
    known_wrong = known_wrong and mistakes[0].kind != "hidden"  # what cannot be read is not known
    wrong = {**state.known_wrong, **holes} if known_wrong else state.known_wrong
    node.state.set(replace(state, kept={**state.kept, **holes}, known_wrong=wrong))
    node.tools.journal.note("belief", kept=holes, known_wrong=known_wrong, reason=why)
    node.feedback_message = why
