"""What nodes are given: the observation and command of the tick, tools, and a memory that outlives the tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from bracket_cell.trees.guard import Guard
from bracket_cell.trees.nodes.files import Files, WorkingFolder
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.memory import NEVER_S, PREFIX, Memory
from bracket_ground.interfaces.notes import Journal
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.operator import Question, QuestionKind, WorkOrder
from bracket_ground.interfaces.perception import PartDetection, PartsView
from bracket_ground.interfaces.places import EMPTY, spot_name
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState, GraspPlan, GraspPlanner, SemanticPlanner
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from btxml.engine.blackboard import Scope
from btxml.engine.causes import compared
from btxml.engine.node import Node
from btxml.engine.outside import Asked, LoggedAnswers

# Skills load kinematics and collision checking; who only checks or shows a tree file does not wait for them.
if TYPE_CHECKING:
    from bracket_cell.skills.motion.planner import MotionPlanner

MOST_BESIDE = 3  # of what stands near a part that lies is thought away
GRASPABLE = 0.5  # probability from which a plan says that a part can be grasped


@dataclass
class Tick:
    """What is seen and asked for in the tick under way; the controller renews the first two before each.

    Attributes:
        observation: what the devices and the detectors said.
        command: what the nodes ask of the devices.
        display: what the person is shown, from some tick on.
    """

    observation: Observation
    command: Command = field(default_factory=Command)
    display: Display = field(default_factory=Display)

    def show(self, **changes: Any) -> None:
        """Change what the person is shown; fields as in Display."""
        changed = replace(self.display, **changes)
        if changed != self.display:
            self.display = changed
            self.command.display = changed

    def withdraw(self, question: Question) -> None:
        """Ask no longer."""
        self.show(questions=tuple(shown for shown in self.display.questions if shown.number != question.number))


class Policies(Protocol):
    """Who asks trained policies, see `bracket_cell.running.policy_device`."""

    def ask(self, file: str, seen: Mapping[str, Array]) -> Asked:
        """Begin to ask the policy of a file, with what it sees beside images."""
        ...


@dataclass(frozen=True)
class Tools:
    """What nodes work with; other tools take their place where a goal was learned.

    Attributes:
        semantic, grasp: the chosen planners, usually learned.
        rule_semantic, rule_grasp: rule-based planners that answer where the chosen ones cannot be used.
        journal: takes notes for the log.
        files: tables and saved values of the user.
        policies: who asks trained policies; None in a replay.
        answers: what leaves were answered from beyond the cell in the run that is replayed; None in a run.
        teach: notes a goal, its name and the part at every position, where goals are kept, and says under which name;
            None where they are kept nowhere.
        learn: the tools that know how a bracket was finished, and the name of its goal; None where it has none.
    """

    product: Product
    bench: Bench
    motion: MotionPlanner
    semantic: SemanticPlanner
    rule_semantic: SemanticPlanner
    grasp: GraspPlanner
    rule_grasp: GraspPlanner
    guard: Guard
    journal: Journal
    files: Files = field(default_factory=WorkingFolder)
    policies: Policies | None = None
    answers: LoggedAnswers | None = None
    teach: Callable[[str, tuple[str, ...]], str] | None = None
    learn: Callable[[Tools, tuple[str, ...]], tuple[Tools, str | None]] = lambda tools, _: (tools, None)

    def infer(self, state: AssemblyState, job: WorkOrder | None = None) -> AssemblyPlan:
        """The chosen planner's answer if the guard lets it pass, else the rule-based planner's.

        Args:
            job: the work order, if there is one: what is expected before anything is placed.
        """
        try:
            plan = self.guard.planned(self.semantic, state)
            refusal = self.guard.refusal(plan, state)
        except ModelError as error:
            refusal = str(error)
        if refusal is not None:
            self.journal.note("verdict", subject="assembly plan", decision="refused", reason=refusal)
            plan = self.guard.planned(self.rule_semantic, state)
        plan = plan.after_reactions(self.product, state)
        if job is not None:
            plan = plan.expecting(job.variant, self.product, state)
        return plan.with_told({at: part for at, part in state.told_parts.items() if at not in state.placed})


@dataclass
class Services:
    """Given to every node by `Tree.setup`.

    Attributes:
        memory: what outlives a tick; it stands on the blackboard of the main tree, as `@memory_held_part` and so on.
        learned: brackets that were learned from, in order.
        held_at: hole in which the gripper holds its part for somebody who fastens it; empty while it holds none so.
    """

    now: Tick
    tools: Tools
    memory: Memory = field(default_factory=Memory)
    learned: list[tuple[str, ...]] = field(default_factory=list)
    held_at: str = ""
    _noted_s: dict[tuple[str, int], float] = field(default_factory=dict)
    _reachable: dict[tuple[str, str], bool] = field(default_factory=dict)
    _solved: dict[int, GraspPlan] = field(default_factory=dict)
    _solved_view: PartsView | None = None

    @property
    def journal(self) -> Journal:
        """Takes notes for the log."""
        return self.tools.journal

    @property
    def waited_s(self) -> float:
        """Since a part was placed last."""
        return 0.0 if self.memory.placed_s < 0 else self.now.observation.time_s - self.memory.placed_s

    @property
    def answers(self) -> LoggedAnswers | None:
        """As those of the tools."""
        return self.tools.answers

    def stand_on(self, blackboard: Scope) -> None:
        """Write the memory to entries of a tree, and to the log, whole now and then as it changes."""
        for name in self.tools.bench.places:
            self.at_place(name)

        def remembered(changed: Mapping[str, object]) -> None:
            for name, value in changed.items():
                blackboard.entry(PREFIX + name).write(value)
            self.tools.journal.note("memory", **changed)

        self.memory.follow(remembered)

    def ask(self, kind: QuestionKind, reason: str, **details: Any) -> Question:
        """Ask a person; the question stands until it is withdrawn.

        Args:
            details: further fields of the question.
        """
        self.memory.questions += 1
        question = Question(self.memory.questions, kind, reason, **details)
        self.now.show(questions=(*self.now.display.questions, question))
        return question

    def note_pick(self, part: PartDetection, others: tuple[PartDetection, ...], *, lying: bool = False) -> None:
        """Note what the gripper is about to take; while it holds something, it takes nothing."""
        memory = self.memory
        memory.tray_seen_s = NEVER_S
        if not self.now.observation.gripper.holding:
            memory.held_part, memory.tray_parts, memory.held_lying = part.part, others, lying

    def standing_at(self, name: str, number: int, part: str) -> PartDetection:
        """A part of a type at a spot of a place, as if it were seen there."""
        kind = self.tools.product.parts[part]
        pose = self.tools.bench.places[name].stands(number, kind.peg_length_m)
        return PartDetection(part, 1.0, pose, kind.size_m, (0, 0, 0, 0))

    def at_place(self, name: str) -> tuple[PartDetection | None, ...]:
        """What stands at each spot of a place, as far as known; None for a free one."""
        place = self.tools.bench.places[name]
        if name not in self.memory.places:
            parts = [*place.filled, *[EMPTY] * (len(place.spots_m) - len(place.filled))]
            if place.known_by == "felt":
                parts = [place.holds[0]] * len(parts)
            there = [None if part == EMPTY else self.standing_at(name, n, part) for n, part in enumerate(parts)]
            self.memory.places = {**self.memory.places, name: tuple(there)}
        if place.known_by == "seen":
            self._look_at(name)
        return self.memory.places[name]

    def built(self, part: str) -> int:
        """How many of a type stand ready where they are built; 0 of what is no sub-assembly."""
        kind = self.tools.product.parts[part]
        there = self.at_place(kind.built_at) if kind.made_of else ()
        return sum(detection is not None and detection.part == part for detection in there)

    def _look_at(self, name: str) -> None:
        """Take over what the camera has seen at a place since it was noted what stands there."""
        view, there = self.now.observation.bench, list(self.memory.places[name])
        for number, detection in enumerate(there):
            seen = None if view is None else view.spots.get(spot_name(name, number))
            if seen is not None and seen.seen_s > self._noted_s.get((name, number), -math.inf):
                if seen.part is None:
                    there[number] = None
                elif detection is None or detection.part != seen.part:
                    there[number] = self.standing_at(name, number, seen.part)
        if tuple(there) != self.memory.places[name]:
            self.memory.places = {**self.memory.places, name: tuple(there)}

    def note_at(self, name: str, number: int, part: PartDetection | None) -> None:
        """Note what stands at a spot of a place from now on; None for nothing."""
        there = list(self.at_place(name))
        there[number] = part
        self._noted_s[name, number] = self.now.observation.time_s
        self.memory.places = {**self.memory.places, name: tuple(there)}

    def learn(self, parts: tuple[str, ...]) -> str | None:
        """From now on planners and guard know how a bracket was finished; the name of its goal, if it has one."""
        self.tools, name = self.tools.learn(self.tools, parts)
        self.learned.append(parts)
        if name is not None:
            self.memory.finished = tuple(dict.fromkeys((*self.memory.finished, parts)))
        return name

    def solve(self, parts: PartsView, required: int) -> GraspPlan:
        """How to get at one detected part: the chosen planner's answer if the arm agrees, else the rule's.

        Where the arm agrees with neither, it decides by itself between taking the part and help. What lies on a part
        is moved before it, the topmost first, whatever planners say.
        """
        if self._solved_view is not parts:
            self._solved_view, self._solved = parts, {}
        if required not in self._solved:
            self._solved[required] = self._arbitrate(parts, required)
        return self._solved[required]

    def _arbitrate(self, parts: PartsView, required: int) -> GraspPlan:
        from bracket_cell.learned.grasp.solution import Solution

        if on_top := parts.on_top(required):
            known = parts.seen[on_top[0]].lies is not None
            return (Solution(on_top) if known else Solution(needs_help=True)).plan(0.0)
        if not parts.seen[required].upright:
            if self.why_not_graspable(parts, required) is None:
                return Solution().plan(1.0)
            blocker = self._beside_lying(parts, required)
            return (Solution(needs_help=True) if blocker is None else Solution((blocker,))).plan(0.0)
        for planner in (self.tools.grasp, self.tools.rule_grasp):
            try:
                plan = planner.plan(parts.seen, required)
                refusal = self._refusal(plan, parts, required)
            except ModelError as error:
                refusal = str(error)
            if refusal is None:
                return plan
            self.tools.journal.note("verdict", subject="grasp plan", decision="refused", reason=refusal)
        if self.why_not_graspable(parts, required) is None:
            return GraspPlan(1.0, (), False, "grasp")
        return GraspPlan(0.0, (), True, "help")

    def _beside_lying(self, parts: PartsView, required: int) -> int | None:
        """What stands near a part that lies, so that it could be taken if that were away, and can be moved away."""
        place = parts.seen[required].world_from_part.position_m
        near = sorted(
            (math.dist(detection.world_from_part.position_m, place), number)
            for number, detection in enumerate(parts.detections)
        )
        for _, number in near[:MOST_BESIDE]:
            without = replace(parts, detections=parts.detections[:number] + parts.detections[number + 1 :])
            frees = self.why_not_graspable(without, required - 1) is None
            if frees and not parts.on_top(number) and self.why_not_graspable(parts, number) is None:
                return number
        return None

    def _refusal(self, plan: GraspPlan, parts: PartsView, required: int) -> str | None:
        """Where a plan and the arm disagree about the part as it stands, if they do."""
        of, source = parts.seen[required].part, f"{__name__}.GRASPABLE"
        if compared("planner grasp", "GRASPABLE", plan.graspable, ">=", GRASPABLE, source, of):
            return self.why_not_graspable(parts, required)
        if plan.needs_help and self.why_not_graspable(parts, required) is None:
            return "it asks for help, and the arm can take the part as it stands"
        return None

    def why_not_graspable(self, parts: PartsView, required: int) -> str | None:
        """Why the arm cannot take a part as it stands or lies, or None where it can."""
        from bracket_cell.skills.grasping.handling import why_not_graspable
        from bracket_cell.skills.lying import why_not_lifted

        seen = parts.seen
        others = seen[:required] + seen[required + 1 :]
        why_not = why_not_graspable if seen[required].upright else why_not_lifted
        return why_not(self.tools.motion, seen[required], others, np.array(self.now.observation.arm.positions_rad))

    def tool_tilt_rad(self) -> float:
        """How far the fingers point away from straight down."""
        tool = self.tools.motion.kinematics.forward(np.array(self.now.observation.arm.positions_rad))
        return math.acos(min(1.0, max(-1.0, -float(tool.rotation[2, 2]))))

    def tool_on_bench_m(self) -> tuple[float, float]:
        """Where the tool is above the bench, (x, y)."""
        x, y, _ = self.tools.motion.kinematics.forward(np.array(self.now.observation.arm.positions_rad)).position_m
        return x, y

    def reachable(self, part: str, position: str) -> bool:
        """Whether the arm can put a part into a position of the empty bracket; worked out once for each."""
        from bracket_cell.skills.pick_and_place import can_place

        if (part, position) not in self._reachable:
            self._reachable[part, position] = can_place(self.tools.motion, part, position)
        return self._reachable[part, position]


class CellNode(Node):
    """Base of the nodes in this library."""

    abstract = True

    services: Services

    @property
    def now(self) -> Tick:
        """What is seen and asked for in this tick."""
        return self.services.now

    @property
    def tools(self) -> Tools:
        """What this node works with."""
        return self.services.tools

    @property
    def memory(self) -> Memory:
        """What all nodes remember."""
        return self.services.memory
