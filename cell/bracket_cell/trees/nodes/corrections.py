"""Mistakes that stay in the bracket: noticed, told to the person, and watched until they are mended."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from bracket_cell.trees.nodes.asking import Asks, against_order
from bracket_cell.trees.nodes.services import CellNode, Services
from bracket_ground.files.words.message import Message, listed
from bracket_ground.interfaces.operator import HELP_GIVEN, IS_RIGHT, Answer
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState
from bracket_ground.interfaces.product import Product
from btxml.engine.ports import InOutPort, InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

MistakeKind = Literal["wrong", "surplus", "crooked", "hidden"]
KINDS: tuple[MistakeKind, ...] = ("wrong", "surplus", "crooked", "hidden")  # in the order in which they are reported
TODO: dict[MistakeKind, tuple[str, str]] = {
    "wrong": ("take it out", "take them out"),
    "surplus": ("take it out", "take out what does not belong there, or say which one does not"),
    "crooked": ("set it straight", "set them straight"),
    "hidden": ("clear the view, or take out what does not belong there",) * 2,
}


@dataclass(frozen=True)
class Mistake:
    """Something in one hole that a person should mend.

    Attributes:
        kind: "wrong": the goal has another part there; "surplus": more such parts than a bracket takes; "crooked":
            the part does not stand straight; "hidden": nothing could be read there for a while.
        part: type of the part in the hole; None where that is not known.
        wanted: type of the part that belongs there; None where that is not known.
    """

    position: str
    kind: MistakeKind
    part: str | None = None
    wanted: str | None = None


Mistakes = tuple[Mistake, ...]


def mistakes_in(services: Services, plan: AssemblyPlan, state: AssemblyState) -> Mistakes:
    """What looks wrong now, by holes; without what a person said is right, and without what cannot be read."""
    view, product = services.now.observation.bench, services.tools.product
    holes = view.holes if view else {}
    seen = {name: hole for name, hole in holes.items() if hole.part and state.known_wrong.get(name) != hole.part}
    goal = services.tools.guard.sure_goal(plan, state)
    there = {name: hole.part for name, hole in seen.items() if hole.part is not None}
    wanted = product.goal_placements(goal, there) if goal is not None else {}
    return tuple(_judged(product, seen, wanted, state.kept))


def _judged(
    product: Product, seen: Mapping[str, HoleView], wanted: Mapping[str, str], kept: Mapping[str, str | None]
) -> Iterator[Mistake]:
    counts = Counter(hole.part for hole in seen.values())  # with what is kept: the others are too many then
    for position, hole in seen.items():
        part = hole.part
        if kept.get(position) == part:
            continue
        if part not in product.parts:
            yield Mistake(position, "surplus", part)
        elif wanted and wanted.get(position) != part:
            yield Mistake(position, "wrong" if position in wanted else "surplus", part, wanted.get(position))
        elif counts[part] > product.most[part] and not wanted:
            yield Mistake(position, "surplus", part)
        elif not hole.upright:
            yield Mistake(position, "crooked", part)


def reason_of(product: Product, mistakes: Mistakes) -> str:
    """What is wrong, for people."""
    kind, names = mistakes[0].kind, _listed([one.position for one in mistakes])
    if kind == "wrong":
        return listed(
            [
                Message(
                    "{position} holds the {part}, where this bracket needs the {wanted}",
                    position=one.position,
                    part=product.title(one.part or ""),
                    wanted=product.title(one.wanted or ""),
                )
                for one in mistakes
            ]
        )
    if kind == "surplus":
        there = Counter(one.part or "" for one in mistakes)
        takes = {part: product.most[part] for part in there}
        return listed(
            [
                Message("{names} holds the {part}, which is one too many", names=names, part=product.title(part))
                if there[part] == 1 and takes[part]
                else Message(
                    "{names} hold the {part}, and a bracket takes {takes} of them",
                    names=_listed([one.position for one in mistakes if one.part == part]),
                    part=product.title(part),
                    takes=takes[part] or "none",
                )
                for part in there
            ]
        )
    if kind == "crooked":
        return Message(
            "the {part} in {names} does not stand straight", part=product.title(mistakes[0].part or ""), names=names
        )
    return Message("I have not been able to see into {names} for a while", names=names)


def todo_of(mistakes: Mistakes) -> str:
    """What the person should do."""
    one, several = TODO[mistakes[0].kind]
    return one if len(mistakes) == 1 else several


def _listed(names: list[str]) -> str:
    if len(names) == 1:
        return names[0]
    return Message("{first} and {last}", first=", ".join(names[:-1]), last=names[-1])


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
        self._since_s = {one: self._since_s.get(one, view.holes[one.position].seen_s) for one in now}
        settled = [one for one in now if self.compare(self._stood_s(one), ">=", self.settle_s, one.position)]
        settled += self._hidden()
        for kind in KINDS:
            if told := tuple(one for one in settled if one.kind == kind):
                self.mistakes.set(told)
                self.feedback_message = reason_of(self.tools.product, told)
                return Status.SUCCESS
        self.feedback_message = f"watches {' '.join(one.position for one in now)}" if now else ""
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
        last_s = {name: view.holes[name].seen_s if name in view.holes else self._began_s for name in self._positions}
        return [
            Mistake(name, "hidden")
            for name, seen_s in last_s.items()
            if name not in kept and self.compare(view.time_s - seen_s, ">=", self.hidden_s, name)
        ]

    @property
    def _positions(self) -> tuple[str, ...]:
        return self.tools.product.positions


class AwaitMisfit(CellNode):
    """Wait until the placed parts have fitted no known product for a while: it is new, or something is wrong."""

    state = InputPort(AssemblyState, "what is placed so far, and which goal was named")
    settle_s = InputPort(float, "how long it must fit none", default=6.0, least=0)

    _since_s: float | None = None

    def initialise(self) -> None:
        self._since_s = None

    def update(self) -> Status:
        services, state = self.services, self.state.get()
        if state.told_goal is not None or not services.tools.guard.fits_none(state):
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
                tuple(one for one in self._asked if one is not named),
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
            answers += [Answer(one.position, Message("{position} is wrong", position=one.position)) for one in mistakes]
        if mistakes[0].kind != "hidden":
            answers.append(Answer(IS_RIGHT, "it is right so"))
        positions = tuple(one.position for one in mistakes)
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
        return next((one for one in self._asked if one.position == answer), None)

    def _in_vain(self) -> Status:
        self._before = self._standing(self._asked)
        return Status.FAILURE

    def _standing(self, mistakes: Mistakes) -> Mistakes:
        """Those that still look as they were told."""
        view = self.now.observation.bench
        holes = view.holes if view else {}
        now = mistakes_in(self.services, self.plan.get(), self.state.get())
        return tuple(
            one
            for one in mistakes
            if one in now
            or (one.kind == "hidden" and (one.position not in holes or holes[one.position].seen_s < self._asked_s))
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

    Where somebody is there to answer, a full bracket that is like no known product is not right before they say so.
    """

    state = InputPort(AssemblyState, "what is placed so far")
    plan = InputPort(AssemblyPlan, "belief over goals")
    node_type = "Condition"
    traits = Traits(instant=True)

    def update(self) -> Status:
        services, plan, state = self.services, self.plan.get(), self.state.get()
        if found := mistakes_in(services, plan, state):
            self.feedback_message = reason_of(services.tools.product, found[:1])
        elif services.now.observation.operator.present and services.tools.guard.asks_for_goal(plan, state):
            self.feedback_message = "it is not known which product this is"
        else:
            self.feedback_message = ""
            return Status.SUCCESS
        return Status.FAILURE


def keep(node: AskToMend | LeaveMistake, mistakes: Mistakes, why: str, known_wrong: bool = False) -> None:
    """Take it as it is from now on, in this bracket."""
    holes = {one.position: one.part for one in mistakes}
    state = node.state.get()
    known_wrong = known_wrong and mistakes[0].kind != "hidden"  # what cannot be read is not known
    wrong = {**state.known_wrong, **holes} if known_wrong else state.known_wrong
    node.state.set(replace(state, kept={**state.kept, **holes}, known_wrong=wrong))
    node.tools.journal.note("belief", kept=holes, known_wrong=known_wrong, reason=why)
    node.feedback_message = why
