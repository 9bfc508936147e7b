"""What the person should do now: one sentence, and the holes and bins that it means; the same on page and panel."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, Literal

from bracket_cell.production.bookkeeper import PERSON, Placements
from bracket_cell.trees.vocabulary import ShownAs
from bracket_cell.viewing.advice import ADVICE, ended_advice
from bracket_cell.viewing.guidance import build_words, one_of, step_words
from bracket_cell.watching.observer import Outcome, TickRecord
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.faults import HAND_TOO_NEAR, USUAL, Action, SafetyDecision
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.operator import Question
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from bracket_ground.interfaces.product import Product
from btxml.engine.node import StatusChange
from btxml.engine.tree import Tree

GuideState = Literal[
    "beginning", "unknown", "unsure", "sure", "brings", "waits", "question", "alarm", "paused", "finished", "over"
]
URGENT: tuple[GuideState, ...] = ("question", "alarm", "paused", "over")
STAYS_S = 0.6  # a sentence stands at least so long, unless an urgent one comes
NEAR_S = 0.4  # a hand is near for so long before the person is asked to take it away
LIKELY = 0.05  # goals below this are not told
HoleStatus = Literal["placed", "robot", "you", "open"]


@dataclass(frozen=True)
class Instruction:
    """What the person should do.

    Attributes:
        holes, bins: names of the holes, and part types of the bins, that are meant.
        tray: the tray is meant.
    """

    moment: GuideState
    words: str
    holes: tuple[str, ...] = ()
    bins: tuple[str, ...] = ()
    tray: bool = False


@dataclass(frozen=True)
class Hole:
    """What is known of one hole: one answer, which everything that is shown follows.

    Attributes:
        status: "placed": a part is in it; "robot": the robot brings one; "you": the person puts one in; "open": it is
            not known yet what belongs there.
        parts: the type, or of an open one all types that may belong there.
        who: who placed it, "robot" or "person"; empty where nothing is placed.
    """

    status: HoleStatus
    parts: tuple[str, ...]
    who: str = ""
    upright: bool = True


class OperatorGuide:
    """Follows a run, and says what the person should do.

    Args:
        tree: the one that runs now; an edited one may take over.

    Attributes:
        product: what is assembled.
        next: (part type, position) that the robot was allowed to place and goes to place; None for nothing.
        doubt: why the robot does not act, in words.
        fastened: names of the fastenings that are done.
        asks: whether something waits to be acknowledged.
    """

    def __init__(self, product: Product, tree: Callable[[], Tree]) -> None:
        self.product, self._tree = product, tree
        self._shown = _shown_as(tree())
        self._running: dict[int, str] = {}  # what the running nodes show, by uid
        self._seen: Observation | None = None
        self._judgement = SafetyDecision()
        self._since_s: dict[str, float] = {}  # by signal that is there
        self._display = Display()
        self.asks = False
        self._finished = ""  # what was shown when the bracket was assembled
        self._ended: Outcome | None = None
        self._near_since_s = math.inf
        self._put = False  # the robot let go of what it places, and has not seen it there yet
        self._loose = ""  # where the person placed a part whose screw was not turned since; of no product of fastenings
        self._told, self._told_s = Instruction("beginning", "Wait: the cell begins"), float("-inf")
        self._placements = Placements()
        self.next: tuple[str, str] | None = None
        self.doubt = ""
        self.fastened: tuple[str, ...] = ()

    def take(self, record: TickRecord) -> None:
        """One more tick."""
        self._seen = seen = record.observation
        self._judgement = record.judgement or SafetyDecision()
        self._since_s = {name: self._since_s.get(name, seen.time_s) for name, _ in self._judgement.reasons}
        self.asks = record.unacknowledged
        self._display = record.command.display or self._display
        if self._tree() is not self._shown[0]:
            self._shown = _shown_as(self._tree())
            self._running.clear()
        for change in record.changes:
            self._change(change)
        for topic, fields in record.notes:
            self._note(topic, fields)
        near = self._judgement.holding_faults == (HAND_TOO_NEAR,) or ShownAs.GIVES_WAY in self._running.values()
        self._near_since_s = min(self._near_since_s, seen.time_s) if near else math.inf
        if seen.bench is not None and seen.bench.action.kind == "screw":
            self._loose = ""
        if seen.bench is not None and self._loose and self._loose not in self.placed:
            self._loose = ""

    def _change(self, change: StatusChange) -> None:
        shown, ended = self._shown[1].get(change.uid), change.new.name
        self._running.pop(change.uid, None)
        if shown is not None and ended == "RUNNING":
            self._running[change.uid] = shown
        elif ended == "SUCCESS":
            self.next = None if shown == ShownAs.PUTS_BACK else self.next
            self._put |= shown == ShownAs.PLACES
            self._finished = self._display.message if shown == ShownAs.FINISHED else self._finished

    def end(self, outcome: Outcome) -> None:
        """The run is over."""
        self._ended = outcome

    @property
    def cause(self) -> tuple[str, str] | None:
        """The signal that was there first of those that hold the arm, with its words; where none holds it, the gravest.

        Others follow from it: a flood of alarms of one cause is one alarm (ISA-18.2).
        """
        reasons = [reason for reason in self._judgement.reasons if reason[0] not in USUAL]
        holding = [reason for reason in reasons if reason[0] in self._judgement.holding_faults]
        return min(
            holding, key=lambda reason: self._since_s.get(reason[0], math.inf), default=next(iter(reasons), None)
        )

    @property
    def placed(self) -> dict[str, str]:
        """Part type by position, as it is believed."""
        return self._placements.parts

    @property
    def done(self) -> set[str]:
        """Filled positions and finished fastenings."""
        return {*self.placed, *self.fastened}

    @property
    def built(self) -> set[str]:
        """Sub-assemblies that stand ready where they are built."""
        spots = self._seen.bench.spots if self._seen and self._seen.bench else {}
        return {*self.product.wholes} & {spot.part for spot in spots.values()}

    @property
    def _filled(self) -> Collection[str]:
        """Positions that get a part, in the likeliest goal."""
        likely = self._likely()[:1] if self.product.varies else []
        return self.product.accepted(likely[0]) if likely else self.product.positions

    @property
    def holes(self) -> dict[str, Hole]:
        """What is known of every hole."""
        view, goals = (None if self._seen is None else self._seen.bench), self._likely()
        wanted = {position: part for part, to in self._display.guidance.items() for position in to}
        found = {}
        for position in self.product.positions:
            if position in self.placed:
                hole = view.holes.get(position) if view is not None else None
                upright = hole is None or hole.upright
                found[position] = Hole("placed", (self.placed[position],), self._placements.by[position], upright)
            elif self.next is not None and self.next[1] == position:
                found[position] = Hole("robot", (self.next[0],))
            elif position in wanted and position not in self._display.any_part:
                found[position] = Hole("you", (wanted[position],))
            else:
                may = {part for goal in goals for part in self.product.accepted(goal).get(position, ())}
                found[position] = Hole("open", tuple(sorted(may)))
        return found

    def now(self) -> Instruction:
        """What the person should do; it stands for a moment, so that it can be read."""
        fresh, now_s = self._fresh(), 0.0 if self._seen is None else self._seen.time_s
        urgent = fresh.moment in URGENT or self._told.moment in ("question", "alarm", "paused")
        if fresh != self._told and (urgent or now_s - self._told_s >= STAYS_S):
            self._told, self._told_s = fresh, now_s
        return self._told

    def _note(self, topic: str, fields: dict[str, Any]) -> None:
        new = topic == "belief" and bool(fields.get("edge")) and fields["edge"][1] not in self.placed
        self._placements.note(topic, fields)
        if topic == "belief" and "fastened" in fields:
            self.fastened = tuple(fields["fastened"])
        elif topic == "belief" and fields.get("edge"):
            part, position = fields["edge"]
            if part is None:
                return
            if new and self._placements.by[position] == PERSON and not self.product.fastenings:
                self._loose = position
            if self.next is not None and self.next[1] == position:
                self.next, self._put = None, False
        elif topic == "verdict":
            part, position = fields.get("part"), fields.get("position")
            acts = fields.get("decision") == "act" and part is not None and position is not None
            self.doubt = "" if acts else fields.get("reason", "")
            if acts:
                self._put &= self.next == (part, position)
                self.next = (str(part), str(position))
            elif self.next == (part, position):
                self.next = None
        elif topic == "bracket" and fields["edge"] == "begin":
            self.next, self.doubt, self._loose, self._put = None, "", "", False
            self._finished, self.fastened = "", ()

    def _likely(self) -> list[str]:
        belief = self._display.goal_belief
        likely = [goal for goal in self.product.goals if belief.get(goal, 0.0 if belief else 1.0) >= LIKELY]
        return sorted(likely, key=lambda goal: -belief.get(goal, 0.0))

    def _fresh(self) -> Instruction:
        if self._ended is not None:
            stopped = self._judgement.action is Action.STOP and self._ended.arm_stands and self.cause
            signal = stopped[0] if stopped else ""
            do = Message(ended_advice(self._ended.end, signal))
            return Instruction("over", Message("The run is over. {do}", do=do))
        if self._seen is None:
            return self._told
        return self._trouble() or self._asked() or self._beginning() or self._robot() or self._work()

    def _trouble(self) -> Instruction | None:
        judged, seen = self._judgement, self._seen
        assert seen is not None
        cause = self.cause
        if self.asks and cause is not None:
            do = Message(ADVICE[cause[0]])
            return Instruction("alarm", Message("{do}. If all is well, press Acknowledge", do=do))
        if seen.operator.pause == "now":
            return Instruction("paused", "The robot stands still. Press Resume to go on")
        if [signal for signal, _ in judged.reasons] == [
            "bench_stale"
        ] and not self._display.goal_belief:  # the cameras begin
            return None
        if judged.new_path or cause is None or seen.bench is None:
            return None
        return Instruction("alarm", Message(ADVICE[cause[0]]))

    def _asked(self) -> Instruction | None:
        questions = self._display.questions
        if not questions:
            return None
        first = questions[0]
        moment: GuideState = "finished" if first.kind == "bracket" else "question"
        return Instruction(moment, self._question(first), first.positions, tray=first.kind == "help")

    def _question(self, question: Question) -> str:
        product, part = self.product, question.part
        if question.kind == "help":
            if not part:
                return Message("Please {todo}", todo=question.todo)
            return Message("I need the {part}: please {todo}", part=self._title(part), todo=question.todo)
        if question.kind == "mend":
            return Message("{holes}: please {todo}", holes=", ".join(question.positions), todo=question.todo)
        if question.kind == "goal":
            names = [answer.value for answer in question.answers]
            titles = ["a new one" if name == UNKNOWN_GOAL else product.goal_title(name) for name in names]
            return Message("Say which one you build: {goals}?", goals=one_of(titles))
        if question.kind == "where":
            at = one_of(list(question.positions))
            return Message("Say where the {part} goes: {holes}?", part=self._title(part), holes=at)
        if question.kind == "bracket":
            return "Take the bracket out, and put an empty one in"
        return Message("Please answer: {question}", question=question.reason)

    def _beginning(self) -> Instruction | None:
        running = set(self._running.values())
        if ShownAs.AWAITS_HAND in running:
            return Instruction("beginning", "Show your hand to the camera above")
        if self._finished and self._display.message == self._finished:
            return Instruction("finished", "Take the bracket out: it is finished")
        if ShownAs.AWAITS_BRACKET in running:
            return Instruction("beginning", "Wait: I look at the bracket")
        if not self._display.goal_belief:
            return Instruction("beginning", "Wait: the cell begins")
        if self._whole:
            return Instruction("finished", "Take your hand away: I look whether all is right")
        return None

    def _robot(self) -> Instruction | None:
        """Where the robot needs the bench for itself."""
        running, seen = set(self._running.values()), self._seen
        assert seen is not None
        near = seen.time_s - self._near_since_s >= NEAR_S
        if near and self.next is not None and not self._put:
            part, position = self.next
            words = "Take your hand away from {hole}: I wait"
            if ShownAs.PLACES in running or seen.gripper.holding:
                words = "Take your hand away from {hole}: I wait with the {part}"
            return Instruction("waits", Message(words, hole=position, part=self._title(part)), (position,))
        if near and seen.arm.moving:
            return Instruction("waits", "Take your hand away from the robot: I wait")
        if ShownAs.PLACES in running and self.next is not None:
            part, position = self.next
            words = Message("Wait: I put the {part} into {hole}", part=self._title(part), hole=position)
            return Instruction("brings", words, (position,))
        return None

    def _work(self) -> Instruction:
        """What the person does beside the robot."""
        task = self._task()
        if self.next is not None and self._put:
            return task if task.words else Instruction("brings", "Wait: I look whether it stands right")
        if self.next is None:
            waits = ShownAs.AWAITS_PERSON in self._running.values()
            if waits and task.words and self._loose in task.holes and not self._whole:
                return _also(task, "I bring the next part")
            return task
        part, position = self.next
        if not task.words:
            return self._brings(part, position)
        return _also(task, Message("I bring the {part} to {hole}", part=self._title(part), hole=position))

    def _task(self) -> Instruction:
        if due := self.product.unfastened(self._filled, self.done):
            words = Message("Now {step}", step=step_words(self.product, due[0]))
            return Instruction("sure", words, self.product.fastenings[due[0]].at)
        if self._loose:
            return Instruction("sure", Message("Turn the screw of {hole}", hole=self._loose), (self._loose,))
        holes, seen = self.holes, self._seen
        assert seen is not None
        ready = [at for at in holes if not self.product.missing_before(at, self.done, self._filled)]
        open_ones = {position: holes[position].parts[0] for position in ready if holes[position].status == "you"}
        mine = {position: part for position, part in open_ones.items() if part not in self.built}
        hand = seen.bench.hand if seen.bench is not None else None
        held = None if hand is None else hand.held_part
        other = self._any_part(tuple(at for at in ready if holes[at].status == "open"), holes)
        if mine and (held in (None, *mine.values()) or not other.words):
            position = next((at for at, part in mine.items() if held in (None, part)), next(iter(mine)))
            if whole := self.product.wholes.get(mine[position]):
                return Instruction("sure", build_words(self.product, mine[position], self._title), (), whole.made_of)
            words = Message("Place the {part} at {hole}", part=self._title(mine[position]), hole=position)
            return Instruction("sure", words, (position,), () if held == mine[position] else (mine[position],))
        if open_ones and self.next is None and not (mine or other.words):
            return self._brings(*next((part, position) for position, part in open_ones.items()))
        return other

    def _brings(self, part: str, position: str) -> Instruction:
        words = Message("Wait: I bring the {part} to {hole}", part=self._title(part), hole=position)
        return Instruction("brings", words, (position,))

    def _any_part(self, open_holes: tuple[str, ...], holes: dict[str, Hole]) -> Instruction:
        """What the person does where more than one part may belong into a hole; nothing where the robot is at it."""
        belief = self._display.goal_belief
        unknown = belief and max(belief, key=lambda goal: belief[goal]) == UNKNOWN_GOAL
        open_holes = tuple(at for at in open_holes if unknown or holes[at].parts)
        if not open_holes:
            return Instruction("sure", "")
        if unknown:
            return Instruction("unsure", "Place any part: this looks like no bracket that I know", open_holes)
        likely = [self.product.goal_title(goal) for goal in self._likely()]
        if not self.placed or len(likely) > 2:
            return Instruction("unknown", "Place any part: I cannot tell yet which bracket this is", open_holes)
        return Instruction("unsure", Message("Place any part: this is {goals}", goals=one_of(likely)), open_holes)

    @property
    def _whole(self) -> bool:
        """Whether nothing remains to be done, in the likeliest goal where slots may stay empty."""
        return self.done >= set(self.product.steps_of(self._filled))

    def _title(self, part: str) -> str:
        return self.product.parts[part].title if part in self.product.parts else part


def _shown_as(tree: Tree) -> tuple[Tree, dict[int, str]]:
    """A tree, and what its nodes show, by uid."""
    return tree, {node.uid: node.traits.shown_as for node in tree.nodes if node.traits.shown_as}


def _also(task: Instruction, words: str) -> Instruction:
    """A task with what the robot does meanwhile."""
    message = Message("{task}: {robot}", task=task.words, robot=words)
    return Instruction(task.moment, message, task.holes, task.bins, task.tray)
