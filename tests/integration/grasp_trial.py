"""One grasp in the simulator, margins and checks against neighbours switched off: what physics says about it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bracket_cell.skills.grasping.handling import joints_of
from bracket_cell.skills.grasping.phases import Activate, Move, Phase, PhasedSkill, SetGripper
from bracket_cell.skills.motion.grasp_pose import grasps
from bracket_cell.skills.motion.motions import FreeWay, Line, Rise
from bracket_cell.skills.motion.planner import Load, MotionPlanner, at_height
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.grip import Hold
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.skill import Progress, SkillStatus
from bracket_sim.scene.world import World
from tests.integration.robot_alone import RobotAlone

ABOVE_M = 0.16  # TCP height that passes over everything in the tray
LIFT_M = 0.10
MOVED_M = 0.0005
SETTLING_S = 0.4

Standing = tuple[str, tuple[float, float], float]  # type, (x, y) in the world, yaw


@dataclass(frozen=True)
class Descent:
    """How the fingers come down.

    Attributes:
        clearance_m: gap between each finger and the body.
        depth_m: fingertips end this far below the body's top.
        speed_m_s: on the way down; the skills' own by default.
    """

    clearance_m: float
    depth_m: float
    speed_m_s: float | None = None


@dataclass(frozen=True)
class Verdict:
    """What happened.

    Attributes:
        touched: the gripper had contact with a part that it was not to take.
        moved_m: farthest that such a part was moved.
        lifted: the wanted part hung in the gripper at the end.
        reason: the skill's last words.
    """

    touched: bool
    moved_m: float
    lifted: bool
    reason: str

    @property
    def good(self) -> bool:
        """The part was taken and nothing else was disturbed."""
        return self.lifted and not self.touched and self.moved_m <= MOVED_M


class GripperContacts:
    """Notes which parts the gripper has touched; looks after every control period."""

    def __init__(self, world: World) -> None:
        self._world = world
        names = [world.model.body(index).name for index in range(world.model.nbody)]
        self._gripper = np.array([name == "gripper" or name.startswith("finger_") for name in names])
        self.touched: set[int] = set()

    def observe(self, _time_s: float, /) -> None:
        """Collect the bodies in contact with the gripper."""
        pairs = self._world.model.geom_bodyid[self._world.data.contact.geom]
        for own, other in ((pairs[:, 0], pairs[:, 1]), (pairs[:, 1], pairs[:, 0])):
            self.touched.update(int(body) for body in other[self._gripper[own]])


class BlindGrasp(PhasedSkill):
    """Straight down on a part, close, and lift, whatever stands beside it."""

    def __init__(self, planner: MotionPlanner, part: PartDetection, hold: Hold, descent: Descent) -> None:
        super().__init__()
        self._planner, self._part, self._hold, self._descent = planner, part, hold, descent

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Choose the half turn with the shorter way."""
        planner, part = self._planner, self._part
        settings = planner.settings.model_copy(update={"grasp_depth_m": self._descent.depth_m})
        kind = planner.product.parts[part.part]
        options = grasps(part, kind, settings, self._hold)
        opening_m = settings.gripper.opening_for(kind, self._hold.grip, self._descent.clearance_m)
        load = Load(opening_m, close=True)
        found = planner.reach([option.world_from_tool for option in options], joints_of(observation), load)
        if isinstance(found, str):
            return found
        grasp = next(option for option in options if option.world_from_tool == found[0])
        above = planner.kinematics.inverse(at_height(grasp.world_from_tool, ABOVE_M), found[1])
        return "out of reach above the part" if above is None else self._phases_for(grasp.world_from_tool, above, load)

    def _phases_for(self, target: Pose, above_rad: Array, load: Load) -> list[Phase]:
        planner, settings = self._planner, self._planner.settings
        speed, force = settings.gripper_speed_m_s, settings.grip_force_n
        down_m_s, lifted_m = self._descent.speed_m_s, target.position_m[2] + LIFT_M
        return [
            Activate(),
            SetGripper("opening", GripperCommand(load.opening_m, speed, force), settings),
            Move("moving above", FreeWay(planner, above_rad, load)),
            Move("going down", Line(planner, target, load, down_m_s)),
            SetGripper("grasping", GripperCommand(0.0, speed, force), settings, must_hold=True),
            Move("lifting", Rise(planner, lifted_m, load.opening_m), holding="it"),
        ]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return "lifted"


def try_grasp(parts: Sequence[Standing], target: int, hold: Hold, descent: Descent, channel: str) -> Verdict:
    """Stand the parts up, grasp one of them, and judge by contacts and by where the others are afterwards.

    Args:
        channel: name of a virtual CAN bus.
    """
    watches: list[GripperContacts] = []

    def watch(world: World) -> GripperContacts:
        watches.append(GripperContacts(world))
        return watches[0]

    with RobotAlone([name for name, _, _ in parts], channel, watch) as robot:
        for body, (_, xy_m, yaw_rad) in zip(robot.parts, parts, strict=True):
            robot.stand(body, xy_m, yaw_rad)
        robot.wait(SETTLING_S)
        wanted = robot.parts[target]
        others = [body for body in robot.parts if body is not wanted]
        before = [robot.world.part_pose(body).position_m for body in others]
        height_m = robot.world.part_pose(wanted).position_m[2]
        seen = robot.detection(wanted, np.random.default_rng(0), 0.0, 0.0)
        try:
            progress = robot.run(BlindGrasp(robot.planner, seen, hold, descent))
        except DeviceFault as stop:  # the tool met something hard
            progress = Progress(SkillStatus.FAILURE, stop.reason)
        after = [robot.world.part_pose(body).position_m for body in others]
        moved_m = max((math.dist(a, b) for a, b in zip(before, after, strict=True)), default=0.0)
        held = progress.status is SkillStatus.SUCCESS
        risen_m = robot.world.part_pose(wanted).position_m[2] - height_m
        touched = any(body.body in watches[0].touched for body in others)
    return Verdict(touched, moved_m, held and risen_m > LIFT_M / 2, progress.reason)
