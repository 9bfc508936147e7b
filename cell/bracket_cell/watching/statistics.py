"""Counts what a run's summary tells, and how fluently person and robot work together.

Hoffman, "Evaluating Fluency in Human-Robot Collaboration", IEEE Transactions on Human-Machine Systems 49 (3), 2019:
H-IDLE, R-IDLE, C-ACT and F-DEL, each as a share of the time of the task. What the person does is what the detectors
say, so that the same figures come from a real cell.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.errors import InputError
from bracket_ground.interfaces.faults import Action
from bracket_ground.interfaces.observation import ObjectStatus, Observation
from bracket_ground.interfaces.perception import BenchView
from bracket_ground.interfaces.product import Product


class FinishedBrackets(Observer):
    """An observer that learns from how a run ended; what the cameras saw in the holes counts, not what was believed.

    Attributes:
        learned: the goal that the bracket ended in; None where it was not finished.
    """

    def __init__(self, path: Path, product: Product) -> None:
        self._path = path
        self._product = product
        self._view: BenchView | None = None
        self._shift = False  # brackets are noted one by one
        self.learned: str | None = None

    def tick(self, record: TickRecord) -> None:
        self._view = record.observation.bench or self._view
        for topic, fields in record.notes:
            if topic == "bracket":
                self._shift = True
                if fields.get("finished"):
                    self._learn()

    def close(self, outcome: Outcome) -> None:
        if outcome.end == "finished" and not self._shift:
            self._learn()

    def _learn(self) -> None:
        if self._view is None:
            return
        seen = {position: hole.part for position, hole in self._view.holes.items()}
        there = {at: part for at, part in seen.items() if part is not None}
        if len(there) < len(self._product.positions) and self._product.goal_of(there) is None:
            return
        parts = self._product.as_listed(there)
        try:
            goals = OpenGoals.load(self._path, self._product).with_bracket(parts)
        except InputError:
            return  # a hole was misread, or the file was damaged meanwhile: better nothing than a wrong goal
        goals.save(self._path)
        self.learned = goals.name_of(parts)


ToolOnBench = Callable[[Observation], tuple[float, float]]


class RunStatistics(Observer):
    """An observer that keeps the last belief and counts calls for help and refused plans.

    Attributes:
        goal_belief: as last shown to the person.
        plans_refused: answers of learned planners that could not be used, so that the rule-based one answered.
    """

    def __init__(self) -> None:
        self.goal_belief: dict[str, float] = {}
        self.help_requests = 0
        self.plans_refused = 0

    def tick(self, record: TickRecord) -> None:
        self.help_requests += sum(topic == "help" for topic, _ in record.notes)
        self.plans_refused += sum(fields.get("decision") == "refused" for _, fields in record.notes)
        display = record.command.display
        if display is not None:
            self.goal_belief = dict(display.goal_belief) or self.goal_belief

    def report(self) -> dict[str, object]:
        """What was counted, by keys of `cell run --json`."""
        return {
            "inferred_goal": self.inferred_goal,
            "help_requests": self.help_requests,
            "plans_refused": self.plans_refused,
        }

    @property
    def inferred_goal(self) -> str | None:
        """The most probable goal, None before the first belief."""
        return max(self.goal_belief, key=lambda goal: self.goal_belief[goal]) if self.goal_belief else None


class Fluency(Observer):
    """An observer that adds up who acts and who waits, from the first action of either on.

    An arm that is held waits, whatever path it follows. Of the time in which it is held, and of the share of its speed
    that it lacks while it is slowed, what passes while the person rests is told apart.

    Args:
        tool_m: where the tool is over the bench, (x, y), for an observation.
    """

    def __init__(self, tool_m: ToolOnBench) -> None:
        self._tool_m = tool_m
        self._before_s: float | None = None
        self._total_s = self._human_s = self._robot_s = self._both_s = self._delay_s = 0.0
        self._gap_s = 0.0
        self._last = ""  # who acted last: "human", "robot" or both
        self._held_s = self._slowed_s = self._lost_alone_s = 0.0
        self._interventions = self._moves = 0
        self._holding = False
        self._least_m = math.inf

    def tick(self, record: TickRecord) -> None:
        seen = record.observation
        period_s = 0.0 if self._before_s is None else seen.time_s - self._before_s
        self._before_s = seen.time_s
        self._moves += record.sent.trajectory is not None
        holds = record.judgement is not None and record.judgement.action >= Action.HOLD
        stopped = holds and (self._holding or seen.arm.moving or record.command.follow is not None)
        self._interventions += stopped and not self._holding
        self._holding = stopped
        human = seen.bench is not None and seen.bench.action.kind != "idle"
        moves = not seen.arm.stands
        share = 1.0 if stopped or record.judgement is None or not moves else record.judgement.speed_scale
        self._held_s += period_s if stopped else 0.0
        self._slowed_s += period_s * (1.0 - share)
        self._lost_alone_s += 0.0 if human else period_s * (1.0 if stopped else 1.0 - share)
        robot = moves or seen.gripper.object_status is ObjectStatus.MOVING
        self._add(period_s, human, robot)
        if moves and seen.bench is not None and seen.bench.hand is not None:
            tool_m, hand = self._tool_m(seen), seen.bench.hand
            self._least_m = min(self._least_m, math.dist(tool_m, hand.fingertips_m), math.dist(tool_m, hand.palm_m))

    def report(self) -> dict[str, object]:
        """What was counted, by keys of `cell run --json`; shares are None where nobody ever acted."""
        return {
            "human_idle": self._share(self._total_s - self._human_s),
            "robot_idle": self._share(self._total_s - self._robot_s),
            "concurrent": self._share(self._both_s),
            "functional_delay": self._share(self._delay_s),
            "human_waits_s": round(self._total_s - self._human_s, 3),
            "robot_waits_s": round(self._total_s - self._robot_s, 3),
            "held_s": round(self._held_s, 3),
            "slowed_s": round(self._slowed_s, 3),
            "lost_alone_s": round(self._lost_alone_s, 3),
            "interventions": self._interventions,
            "moves": self._moves,
            "least_distance_m": None if math.isinf(self._least_m) else round(self._least_m, 4),
        }

    def _add(self, period_s: float, human: bool, robot: bool) -> None:
        if not (self._last or human or robot):
            return
        self._total_s += period_s
        self._human_s += period_s if human else 0.0
        self._robot_s += period_s if robot else 0.0
        self._both_s += period_s if human and robot else 0.0
        if not (human or robot):
            self._gap_s += period_s
            return
        acts = "both" if human and robot else "human" if human else "robot"
        if acts != self._last:  # the one who goes on after a pause of both is another than the one before it
            self._delay_s += self._gap_s
        self._gap_s, self._last = 0.0, acts

    def _share(self, time_s: float) -> float | None:
        return round(time_s / self._total_s, 4) if self._total_s > 0 else None
