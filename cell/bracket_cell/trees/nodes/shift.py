"""One bracket after the other: begin, notice what was taken away, end, and learn from what was finished."""

from __future__ import annotations

from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.vocabulary import ShownAs
from bracket_ground.errors import InputError
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.operator import Question
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.resume import ResumeState
from btxml.engine.errors import NodeError
from btxml.engine.node import FAILURE, SUCCESS
from btxml.engine.ports import InOutPort, InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

SETTLED_S = 1.0  # holes must look empty for so long
LEAST_PLACED_N = 3  # a bracket with fewer parts whose holes look empty again was cleared by hand


class WaitForEmptyBracket(CellNode):
    """Ask for an empty bracket, and wait until every hole is seen empty.

    The first bracket of a run may be one that was begun before: with the log of a run that was broken off, or where
    only some holes are filled.
    """

    traits = Traits(shown_as=ShownAs.AWAITS_BRACKET)
    persistent = ("_empty_s",)
    what_if = "if every hole were seen empty"

    _question: Question | None = None
    _empty_s: float | None = None

    def initialise(self) -> None:
        self._empty_s = None

    def update(self) -> Status:
        services = self.services
        view = services.now.observation.bench
        filled = filled_holes(self)
        if view is not None and filled is not None and self._goes_on(filled):
            self.feedback_message = Message(
                "goes on with the bracket that is there: {filled}", filled=" ".join(filled) or "still empty"
            )
            return Status.SUCCESS
        if view is None or filled is None or filled:
            self._empty_s = None
            self.feedback_message = (
                Message("still there: {filled}", filled=" ".join(filled)) if filled else "not all holes were seen yet"
            )
            if filled and self._question is None:
                todo = "take the bracket out and put an empty one in"
                self._question = services.ask("bracket", "the bracket is finished", todo=todo)
                services.now.show(message="waiting for an empty bracket")
            return Status.RUNNING
        self._empty_s = view.time_s if self._empty_s is None else self._empty_s
        return Status.SUCCESS if view.time_s - self._empty_s >= SETTLED_S else Status.RUNNING

    def terminate(self, new_status: Status) -> None:  # noqa: ARG002 - however it ends
        if self._question is not None:
            self.now.withdraw(self._question)
            self._question = None

    def _goes_on(self, filled: list[str]) -> bool:
        memory = self.memory
        if memory.brackets:
            return False
        product, view = self.tools.product, self.now.observation.bench
        there = {name: hole.part for name, hole in view.holes.items() if hole.part is not None} if view else {}
        whole = len(filled) == len(product.positions) or (product.varies and product.goal_of(there) is not None)
        return memory.left_off.under_way or (bool(filled) and not whole)


class BeginBracket(CellNode):
    """Count the brackets, and begin with an empty assembly graph, or where an interrupted run stopped."""

    number = InOutPort(int, "which bracket of the shift this is, from 1")
    state = OutputPort(AssemblyState, "what is placed so far")

    def update(self) -> Status:
        memory = self.memory
        memory.let_go = {}
        left, memory.left_off = memory.left_off, ResumeState()
        resumed = left.under_way
        number = left.bracket if resumed else max(self.number.get(), left.bracket) + 1
        self.number.set(number)
        self.state.set(left.state if resumed else AssemblyState({}))
        memory.brackets += 1
        job = self.now.observation.operator.job
        more = {**({"resumed": True} if resumed else {}), **({} if job is None else {"order": job.id})}
        self.tools.journal.note("bracket", number=number, edge="begin", **more)
        self.now.show(message=Message("bracket {number}", number=number), help_request=None)
        self.feedback_message = Message("bracket {number}", number=number)
        return Status.SUCCESS


class BracketTaken(CellNode):
    """Several parts were in the bracket, and now all holes look empty: somebody took it away."""

    state = InputPort(AssemblyState, "what is placed so far")
    number = InputPort(int, "which bracket of the shift this is")
    settle_s = InputPort(float, "how long the holes must look empty", default=1.0, least=0)
    persistent = ("_bracket", "_most", "_empty_s")
    node_type = "Condition"
    traits = Traits(instant=True)

    _bracket = 0
    _most = 0
    _empty_s: float | None = None

    def update(self) -> Status:
        if self.number.get() != self._bracket:
            self._bracket, self._most, self._empty_s = self.number.get(), 0, None
        self._most = max(self._most, len(self.state.get().placed))
        view = self.now.observation.bench
        if self._most < LEAST_PLACED_N or view is None or filled_holes(self) != []:
            self._empty_s = None
            self.feedback_message = ""
            return Status.FAILURE
        self._empty_s = view.time_s if self._empty_s is None else self._empty_s
        if self.compare(view.time_s - self._empty_s, "<", self.settle_s):
            return Status.FAILURE
        self.feedback_message = "the bracket was taken away before it was finished"
        return Status.SUCCESS


class EndBracket(CellNode):
    """Note how a bracket ended and which work order it serves, and learn its goal if every hole was seen filled."""

    number = InputPort(int, "which bracket of the shift this is")
    state = InputPort(AssemblyState, "what is placed so far")

    def update(self) -> Status:
        services = self.services
        view, placed, kept = services.now.observation.bench, self.state.get().placed, self.state.get().kept
        seen = [
            view.holes[name].part if view and name in view.holes else None for name in services.tools.product.positions
        ]
        jobs, product = services.now.observation.operator.jobs, services.tools.product
        there = {at: part for at, part in zip(product.positions, seen, strict=True) if part is not None}
        finished = len(there) == len(seen) or product.goal_of(there) is not None
        learned = services.learn(product.as_listed(there)) if finished and not kept else None
        served = [job.id for job in jobs if finished and job.variant in product.goals]
        served = [job.id for job in jobs if job.id in served and product.goal_placements(job.variant, there) == there]
        self.feedback_message = Message(
            "bracket {number} {value}", number=self.number.get(), value="finished" if finished else "taken away"
        )
        services.tools.journal.note(
            "bracket",
            number=self.number.get(),
            edge="end",
            finished=finished,
            placed=dict(placed),
            goal=learned,
            known_wrong=list(self.state.get().known_wrong),
            **({"order": served[0]} if served else {}),
        )
        return Status.SUCCESS


class ShiftIsOver(CellNode):
    """As many brackets are done as were asked for."""

    number = InputPort(int, "which bracket of the shift was the last")
    node_type = "Condition"
    traits = Traits(instant=True)

    def update(self) -> Status:
        wanted = self.now.observation.operator.brackets
        done = self.number.get()
        self.feedback_message = Message(
            "{done} of {value} done", done=done, value="any number" if wanted is None else max(wanted, done)
        )
        return Status.SUCCESS if wanted is not None and done >= wanted else Status.FAILURE


def filled_holes(node: CellNode) -> list[str] | None:
    """Names of the holes that are seen filled; None as long as some were never seen."""
    view = node.services.now.observation.bench
    positions = node.tools.product.positions
    if view is None or any(name not in view.holes for name in positions):
        return None
    return [name for name in positions if view.holes[name].part is not None]


class TeachGoal(CellNode):
    """Note what is assembled as a goal; fails while the cameras see something else in a hole than expected."""

    name_given = InputPort(str, "name for the goal", name="goal")
    state = InputPort(AssemblyState, "what is placed so far")

    def update(self) -> Status:
        services, placed, seen = self.services, self.state.get().placed, self.now.observation.bench
        product = services.tools.product
        for position in product.positions:
            hole = seen.holes.get(position) if seen is not None else None
            open_one = product.varies and hole is not None and hole.part is None and position not in placed
            if open_one:
                continue
            if hole is None or hole.part is None or hole.part != placed.get(position) or not hole.upright:
                self.feedback_message = f"{position} is not sure: {placed.get(position, 'nothing')} is believed there"
                return FAILURE
        if services.tools.teach is None:
            raise NodeError("goals are kept nowhere: set planners.semantic.goals in the configuration")
        parts = product.as_listed(placed)
        try:
            name = services.tools.teach(self.name_given.get(), parts)
        except InputError as error:
            raise NodeError(str(error)) from None
        self.feedback_message = f"goal {name}: {' '.join(parts)}"
        services.now.show(message=Message("learned goal {name}", name=name))
        services.tools.journal.note("belief", goal=name, parts=list(parts), source="shown")
        return SUCCESS
