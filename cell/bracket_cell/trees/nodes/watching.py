"""Watching the person: from detector answers to the assembly graph (Alg. 1 lines 1-10)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.vocabulary import Goal, Hole
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.perception import Action, HoleView
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.resume import ResumeState
from btxml.engine.node import FAILURE, RUNNING, SUCCESS
from btxml.engine.ports import InOutPort, InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

EMPTY = "empty"


@dataclass(frozen=True)
class SeenAction:
    """An action of the person and since when it goes on.

    Attributes:
        started_s: time of the first frame of this action; tells two screws of the same part apart.
    """

    action: Action
    started_s: float


class StartGraph(CellNode):
    """Begin with an assembly graph without edges (Alg. 1 line 1).

    After an edit of the running tree, or where a run was broken off, go on with the graph so far.
    """

    state = OutputPort(AssemblyState, "what is placed so far")

    def update(self) -> Status:
        memory = self.memory
        memory.let_go = {}
        kept, memory.left_off = memory.left_off.state, ResumeState()
        if self.state.carried and self.state.entry:
            kept = self.state.entry.value
        self.state.set(kept)
        self.feedback_message = f"goes on with {len(kept.placed)} parts" if kept.placed else ""
        return Status.SUCCESS


class DetectAction(CellNode):
    """Wait for the next answer of the action detector (Alg. 1 lines 4-7)."""

    action = OutputPort(SeenAction, "what the person does, and since when")
    persistent = ("_sequence", "_seen")

    _sequence = -1
    _seen: SeenAction | None = None

    def update(self) -> Status:
        view = self.now.observation.bench
        if view is None or view.sequence == self._sequence:
            self.feedback_message = "waiting for the detector"
            return Status.RUNNING
        self._sequence = view.sequence
        if self._seen is None or not _same(self._seen.action, view.action):
            self._seen = SeenAction(view.action, view.time_s)
        else:
            self._seen = SeenAction(view.action, self._seen.started_s)
        self.action.set(self._seen)
        self.feedback_message = str(view.action)
        return Status.SUCCESS


class UpdateGraph(CellNode):
    """Set the edge (object, position) of a finished assembly action (Alg. 1 lines 8-10).

    An action whose part is in doubt sets none: the graph waits for what the hole shows.
    """

    action = InputPort(SeenAction, "what the person does")
    least = InputPort(float, "confidence from which on an action sets an edge", default=0.6)
    state = InOutPort(AssemblyState, "what is placed so far")

    def update(self) -> Status:
        action = self.action.get().action
        state = self.state.get()
        if action.kind == "assembly" and action.finished and action.part and action.position:
            if self.compare(action.confidence, "<", self.least):
                self.feedback_message = f"in doubt: {action}, {action.confidence:.2f}"
                return Status.SUCCESS
            if action.position not in state.placed:
                self.state.set(state.with_placement(action.part, action.position, _shares(action)))
                self.now.show(help_request=None)
                fields: dict[str, object] = {"posterior": dict(action.posterior)} if action.posterior else {}
                fields |= {"shown": True} if action.shown else {}  # the hole tells it, too
                self.tools.journal.note("belief", edge=[action.part, action.position], source="action", **fields)
            self.feedback_message = f"{action.part} is at {action.position}"
        return Status.SUCCESS


class ReconcileGraph(CellNode):
    """Correct the graph where holes have looked different for a while, for example after a part was taken out.

    Where a hole shows something else than the action that filled it said, it is looked at again for as long; then the
    graph follows it if it is read surely enough, and otherwise the person is asked. The log has both opinions.
    """

    state = InOutPort(AssemblyState, "what is placed so far")
    settle_s = InputPort(float, "how long a hole must look otherwise", default=1.5, least=0)
    sure = InputPort(float, "confidence from which on a hole is believed against an action", default=0.9)
    persistent = ("_differs", "_said", "_again_s", "_asked")

    def prepare(self) -> None:
        self._differs: dict[str, tuple[str | None, float]] = {}
        self._said: dict[str, Action] = {}  # finished assemblies that their holes have not shown yet
        self._again_s: dict[str, float] = {}  # since when a hole is looked at again
        self._asked: set[str] = set()  # holes that the person was asked about

    def update(self) -> Status:
        view = self.now.observation.bench
        state = self.state.get()
        placed = dict(state.placed)
        self._hear(view.action if view else None)
        unread = tuple(self._said)
        for position, hole in view.holes.items() if view else ():
            if self._settled(position, hole, placed.get(position)) and self._believed(position, hole, placed):
                placed.pop(position, None)
                if hole.part is not None:
                    placed[position] = hole.part
                self.tools.journal.note("belief", edge=[hole.part, position], source="seen hole")
        doubts = {
            position: shares
            for position, shares in state.doubts.items()
            if position in self._said and position in placed
        }
        if placed != dict(state.placed):
            self.now.show(help_request=None)
        if placed != dict(state.placed) or doubts != dict(state.doubts):
            now = replace(state.seen(placed, unread), doubts=doubts)
            if (now.taken_out, now.replaced) != (state.taken_out, state.replaced):
                self.tools.journal.note("belief", taken_out=dict(now.taken_out), replaced=dict(now.replaced))
            self.state.set(now)
        return Status.SUCCESS

    def _hear(self, action: Action | None) -> None:
        if action is not None and action.kind == "assembly" and action.finished and action.position:
            self._said[action.position] = action

    def _settled(self, position: str, hole: HoleView, believed: str | None) -> bool:
        said = self._said.get(position)
        if said is not None and hole.part == said.part:
            del self._said[position]  # from now on another look means that the part was taken away
        if hole.part == believed:
            self._differs.pop(position, None)
            self._again_s.pop(position, None)
            self._asked.discard(position)
            return False
        part, since_s = self._differs.get(position, (None, hole.seen_s))
        if position not in self._differs or part != hole.part:
            since_s = hole.seen_s
        self._differs[position] = (hole.part, since_s)
        return self.compare(hole.seen_s - since_s, ">=", self.settle_s)

    def _believed(self, position: str, hole: HoleView, placed: dict[str, str]) -> bool:
        """Whether a hole that looks otherwise is believed against the action that filled it, if one did."""
        said = self._said.get(position)
        if said is None or said.part != placed.get(position):
            return True
        if position not in self._again_s:
            self._again_s[position] = hole.seen_s
            self._note("looked at again", position, said, hole)
        if self.compare(hole.seen_s - self._again_s[position], "<", self.settle_s):
            self.feedback_message = Message("looks at {position} again", position=position)
            return False
        if self.compare(hole.confidence, ">=", self.sure):
            self._note("the hole is believed", position, said, hole)
            del self._said[position], self._again_s[position]
            return True
        if position not in self._asked:
            self._asked.add(position)
            self._note("asked", position, said, hole)
            text = Message(
                "what is in {position}? The hand seemed to place {part}, the hole shows {seen}",
                position=position,
                part=said.part,
                seen=hole.part or "nothing",
            )
            self.now.show(help_request=text)
            self.tools.journal.note("help", text=text)
        return False

    def _note(self, outcome: str, position: str, said: Action, hole: HoleView) -> None:
        self.tools.journal.note(
            "belief",
            contradiction=position,
            outcome=outcome,
            action={"part": said.part, "confidence": said.confidence, "posterior": dict(said.posterior)},
            hole={"part": hole.part, "confidence": hole.confidence, "seen_s": hole.seen_s},
        )


def _shares(action: Action) -> dict[str, float]:
    """How probable each type is at the position of an assembly; empty where the detector does not say."""
    end = f" at {action.position}"
    return {name.removesuffix(end): share for name, share in action.posterior.items() if name.endswith(end)}


def _same(one: Action, other: Action) -> bool:
    return (one.kind, one.part, one.position) == (other.kind, other.part, other.position)


class ReadHole(CellNode):
    """Wait for a clear view of a hole and tell what is in it."""

    position = InputPort(Hole, "the hole")
    timeout_s = InputPort(float, "longest wait for a clear view in [s]", default=3.0, least=0)
    part = OutputPort(str, f"type of the part in it, or '{EMPTY}'")
    upright = OutputPort(bool, "whether it stands straight")

    _begun_s = 0.0

    def initialise(self) -> None:
        self._begun_s = self.now.observation.time_s

    def update(self) -> Status:
        position, seen = self.position.get(), self.now.observation
        hole = seen.bench.holes.get(position) if seen.bench else None
        if hole is None or hole.seen_s <= self._begun_s:
            self.feedback_message = f"waits for a clear view of {position}"
            return FAILURE if self.compare(seen.time_s - self._begun_s, ">", self.timeout_s) else RUNNING
        self.part.set(hole.part or EMPTY)
        self.upright.set(hole.upright)
        self.feedback_message = f"{position}: {hole.part or EMPTY}{'' if hole.upright else ', tilted'}"
        return SUCCESS


class GoalPart(CellNode):
    """Output which part a goal has at a position."""

    traits = Traits(instant=True)

    goal = InputPort(Goal, "the goal")
    position = InputPort(Hole, "the hole")
    part = OutputPort(str, "type of the part that belongs there")

    def update(self) -> Status:
        part = self.tools.product.goal_placements(self.goal.get()).get(self.position.get())
        if part is None:
            self.feedback_message = f"{self.goal.get()} leaves {self.position.get()} empty"
            return FAILURE
        self.part.set(part)
        self.feedback_message = f"{part} belongs at {self.position.get()}"
        return SUCCESS
