"""Services with scripted planners for tests of single nodes, without simulator or motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_cell.trees.guard import Guard, GuardSettings
from bracket_cell.trees.nodes.services import Services, Tick, Tools
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.notes import ListJournal
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.perception import Action, BenchView, HandSample, HoleView, PartDetection, PartsView
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState, GraspPlan
from bracket_ground.interfaces.pose import Pose

ROOT = Path(__file__).resolve().parents[3]
CONFIGURATION = load_configuration()
PRODUCT, BENCH = load_product(CONFIGURATION), CONFIGURATION.bench
STANDING = ArmState(0.0, (0.0,) * 6, (0.0,) * 6, moving=False)
EMPTY_GRIPPER = GripperState(0.0, True, ObjectStatus.AT_POSITION, 0.085, 0.0, 0)
HOLDING = replace(EMPTY_GRIPPER, object_status=ObjectStatus.CONTACT_CLOSING, opening_m=0.03)
IDLE = Action("idle", 1.0)
EMPTY_HOLES = {position: HoleView(None, 1.0, 0.0) for position in PRODUCT.positions}
SURE = AssemblyPlan(
    goal_belief={"g0": 1.0, "g1": 0.0, "g2": 0.0},
    next_belief={("o1", "p1"): 1.0, ("o1", "p2"): 1.0},
    next_part="o1",
    guidance={"o1": ("p1", "p2"), "o2": (), "o3": ()},
)


class ScriptedPlanner:
    """Answers one plan, or raises one error; counts the questions."""

    def __init__(self, answer: AssemblyPlan | ModelError) -> None:
        self.answer = answer
        self.asked: list[AssemblyState] = []

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        self.asked.append(state)
        if isinstance(self.answer, ModelError):
            raise self.answer
        return self.answer


class ScriptedGrasps:
    """Answers a grasp plan by the number of the required part."""

    def __init__(self, plans: dict[int, GraspPlan]) -> None:
        self.plans = plans

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:  # noqa: ARG002
        return self.plans[required]


def services(**changes: Any) -> Services:
    """Services whose motion planner knows the arm's joints alone and whose arm reaches everything."""
    tools = Tools(
        product=PRODUCT,
        bench=BENCH,
        motion=cast(
            MotionPlanner,
            SimpleNamespace(
                kinematics=SimpleNamespace(count=len(STANDING.positions_rad or ())), settings=MotionSettings()
            ),
        ),
        semantic=ScriptedPlanner(SURE),
        rule_semantic=ScriptedPlanner(SURE),
        grasp=ScriptedGrasps({}),
        rule_grasp=ScriptedGrasps({}),
        guard=Guard(PRODUCT, GuardSettings()),
        journal=ListJournal(),
    )
    known = {name: changes.pop(name) for name in list(changes) if name in vars(tools)}
    made = Services(Tick(Observation(0, 0.0, STANDING, EMPTY_GRIPPER)), replace(tools, **known))
    made.reachable = lambda part, position: True  # type: ignore[method-assign]  # noqa: ARG005
    made.why_not_graspable = lambda parts, required: None  # type: ignore[method-assign]  # noqa: ARG005
    made.tool_on_bench_m = lambda: (0.5, -0.4)  # type: ignore[method-assign]
    for name, value in changes.items():
        setattr(made.now if hasattr(made.now, name) else made.memory, name, value)
    return made


def see(to: Services, time_s: float, **changes: Any) -> None:
    """Give the services a new bench view and an empty command."""
    fields: dict[str, Any] = {"hand": None, "holes": EMPTY_HOLES, "action": IDLE, **changes}
    sequence = to.now.observation.bench.sequence + 1 if to.now.observation.bench else 0
    view = BenchView(sequence=sequence, time_s=time_s, **fields)
    to.now.observation = replace(to.now.observation, tick=to.now.observation.tick + 1, time_s=time_s, bench=view)
    to.now.command = Command()


def hand_at(x: float, y: float) -> HandSample:
    """A hand whose fingertips are at (x, y) on the bench."""
    return HandSample(0.0, (0, 0, 10, 10), (x, y), (x + 0.1, y))


def seen_parts(*types: str) -> PartsView:
    """Parts in a row, 0.1 m apart."""
    return PartsView(
        0,
        1.0,
        tuple(
            PartDetection(part, 1.0, Pose((0.4 + 0.1 * i, -0.4, 0.016)), PRODUCT.parts[part].size_m, (0, 0, 1, 1))
            for i, part in enumerate(types)
        ),
    )
