"""What the nodes work with: product, planners, guard and motion, and the observation and command of the tick."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cell.errors import ModelError
from cell.interfaces.bench import Bench
from cell.interfaces.clock import Clock
from cell.interfaces.command import Command, Display
from cell.interfaces.notes import Journal
from cell.interfaces.observation import Observation
from cell.interfaces.operator import Question, QuestionKind
from cell.interfaces.perception import PartDetection, PartsView
from cell.interfaces.planning import AssemblyPlan, AssemblyState, GraspPlan, GraspPlanner, SemanticPlanner
from cell.interfaces.product import Product
from cell.interfaces.resume import LeftOff
from trees.engine.node import Node
from trees.guard import Guard
from trees.nodes.files import Files, WorkingFolder

# Skills load kinematics and collision checking; who only checks or shows a tree file does not wait for them.
if TYPE_CHECKING:
    from skills.motion.planner import MotionPlanner

IN_VAIN_N, SAME_SPOT_M = 12, 0.015  # failed grasps that are remembered; parts so near to each other are the same
GRASPABLE = 0.5  # probability from which a plan says that a part can be grasped


@dataclass
class Services:
    """Given to every node by `Tree.setup`; the controller renews `observation` and `command` before each tick.

    Attributes:
        semantic, grasp: the chosen planners, usually learned.
        rule_semantic, rule_grasp: rule-based planners that answer where the chosen ones cannot be used.
        held_part: type of the part that was picked last; whether it is still held, the gripper tells.
        held_lying: that part was taken as it lay, and is still held so.
        tray_parts: what stands or lies in the tray as last seen, without what was taken since.
        files: tables and saved values of the user.
        teach: notes a goal, its name and the part at every position, where goals are kept, and says under which name;
            None where they are kept nowhere.
        put_down: what the robot stood elsewhere in this run; no camera looks there.
        reasons: why the robot could not get a part, and how often, since it asked last; the last one is the newest.
        learn: tells the planners how a bracket was finished, so that they know its goal from then on.
        left_off: what a run that was broken off knew, until this one has gone on with it; None for a new beginning.
        brackets: how many were begun in this run.
        in_vain: parts as they were seen when a grasp failed, the newest last.
        turned: by type, how often one that lay was turned since any of them was seen to stand.
        unplaced: by type and position, how often in a row a part did not go in.
        tray_seen_s: when that was seen; None where it is not known, as something else was moved or a grasp failed.
    """

    product: Product
    bench: Bench
    clock: Clock
    motion: MotionPlanner
    semantic: SemanticPlanner
    rule_semantic: SemanticPlanner
    grasp: GraspPlanner
    rule_grasp: GraspPlanner
    guard: Guard
    journal: Journal
    observation: Observation
    command: Command = field(default_factory=Command)
    display: Display = field(default_factory=Display)
    held_part: str | None = None
    held_lying: bool = False
    tray_parts: tuple[PartDetection, ...] = ()
    put_down: tuple[PartDetection, ...] = ()
    files: Files = field(default_factory=WorkingFolder)
    teach: Callable[[str, tuple[str, ...]], str] | None = None
    reasons: Counter[str] = field(default_factory=Counter)
    learn: Callable[[Services, tuple[str, ...]], str | None] = lambda *_: None
    left_off: LeftOff | None = None
    brackets: int = 0
    in_vain: tuple[PartDetection, ...] = ()
    turned: Counter[str] = field(default_factory=Counter)
    unplaced: Counter[tuple[str, str]] = field(default_factory=Counter)
    _asked: int = 0
    tray_seen_s: float | None = None
    _reachable: dict[tuple[str, str], bool] = field(default_factory=dict)
    _solved: dict[int, GraspPlan] = field(default_factory=dict)
    _solved_view: PartsView | None = None

    @property
    def standing(self) -> tuple[PartDetection, ...]:
        """All parts that the arm keeps clear of, beside those in holes."""
        return self.tray_parts + self.put_down

    def show(self, **changes: Any) -> None:
        """Change what the person is shown; fields as in Display."""
        changed = replace(self.display, **changes)
        if changed != self.display:
            self.display = changed
            self.command.display = changed

    def ask(self, kind: QuestionKind, reason: str, **details: Any) -> Question:
        """Ask a person; the question stands until it is withdrawn.

        Args:
            details: further fields of the question.
        """
        self._asked += 1
        question = Question(self._asked, kind, reason, **details)
        self.show(questions=(*self.display.questions, question))
        return question

    def withdraw(self, question: Question) -> None:
        """Ask no longer."""
        self.show(questions=tuple(one for one in self.display.questions if one.number != question.number))

    def takes(self, part: PartDetection, others: tuple[PartDetection, ...], *, lying: bool = False) -> None:
        """Note what the gripper is about to take; while it holds something, it takes nothing."""
        self.tray_seen_s = None
        if not self.observation.gripper.holding:
            self.held_part, self.tray_parts, self.held_lying = part.part, others, lying

    def failed(self, reason: str) -> None:
        """Note why a part could not be had; who asks for help tells it."""
        count = self.reasons.pop(reason, 0)
        self.reasons[reason] = count + 1

    def failed_at(self, part: PartDetection) -> None:
        """Note that this part could not be grasped."""
        self.in_vain = (*self.in_vain, part)[-IN_VAIN_N:]

    def tried_in_vain(self, part: PartDetection) -> int:
        """How often such a part could not be grasped where this one stands."""
        return sum(one.part == part.part and _near(one, part) for one in self.in_vain)

    def infer(self, state: AssemblyState) -> AssemblyPlan:
        """The chosen planner's answer if the guard lets it pass, else the rule-based planner's."""
        try:
            plan = self.semantic.plan(state)
            refusal = self.guard.refusal(plan, state)
        except ModelError as error:
            refusal = str(error)
        if refusal is not None:
            self.journal.note("verdict", subject="assembly plan", decision="refused", reason=refusal)
            plan = self.rule_semantic.plan(state)
        return plan.with_told({at: part for at, part in state.told_parts.items() if at not in state.placed})

    def solve(self, parts: PartsView, required: int) -> GraspPlan:
        """How to get at one detected part: the chosen planner's answer if the arm agrees, else the rule's.

        Where the arm agrees with neither, it decides by itself between taking the part and help.
        """
        if self._solved_view is not parts:
            self._solved_view, self._solved = parts, {}
        if required not in self._solved:
            self._solved[required] = self._solution(parts, required)
        return self._solved[required]

    def _solution(self, parts: PartsView, required: int) -> GraspPlan:
        for planner in (self.grasp, self.rule_grasp):
            try:
                plan = planner.plan(parts.seen, required)
                refusal = self._refusal(plan, parts, required)
            except ModelError as error:
                refusal = str(error)
            if refusal is None:
                return plan
            self.journal.note("verdict", subject="grasp plan", decision="refused", reason=refusal)
        if self.why_not_graspable(parts, required) is None:
            return GraspPlan(1.0, (), False, "grasp")
        return GraspPlan(0.0, (), True, "help")

    def _refusal(self, plan: GraspPlan, parts: PartsView, required: int) -> str | None:
        """Where a plan and the arm disagree about the part as it stands, if they do."""
        if plan.graspable >= GRASPABLE:
            return self.why_not_graspable(parts, required)
        if plan.needs_help and self.why_not_graspable(parts, required) is None:
            return "it asks for help, and the arm can take the part as it stands"
        return None

    def why_not_graspable(self, parts: PartsView, required: int) -> str | None:
        from skills.grasping.handling import why_not_graspable

        seen = parts.seen
        others = seen[:required] + seen[required + 1 :]
        return why_not_graspable(self.motion, seen[required], others, np.array(self.observation.arm.positions_rad))

    def tool_tilt_rad(self) -> float:
        """How far the fingers point away from straight down."""
        tool = self.motion.kinematics.forward(np.array(self.observation.arm.positions_rad))
        return math.acos(min(1.0, max(-1.0, -float(tool.rotation[2, 2]))))

    def tool_on_bench_m(self) -> tuple[float, float]:
        """Where the tool is above the bench, (x, y)."""
        x, y, _ = self.motion.kinematics.forward(np.array(self.observation.arm.positions_rad)).position_m
        return x, y

    def reachable(self, part: str, position: str) -> bool:
        """Whether the arm can put a part into a position of the empty bracket; worked out once for each."""
        from skills.place import can_place

        if (part, position) not in self._reachable:
            self._reachable[part, position] = can_place(self.motion, part, position)
        return self._reachable[part, position]


def _near(one: PartDetection, other: PartDetection) -> bool:
    ours, theirs = one.world_from_part.position_m, other.world_from_part.position_m
    return math.dist(ours[:2], theirs[:2]) < SAME_SPOT_M


class CellNode(Node):
    """Base of the nodes in this library."""

    abstract = True

    services: Services
