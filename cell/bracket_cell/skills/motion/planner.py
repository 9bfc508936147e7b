"""Motion planner: inverse kinematics, collision checks and limits behind three questions that skills ask."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import islice, pairwise

import numpy as np

from bracket_cell.skills.motion.beside_person import BesidePerson
from bracket_cell.skills.motion.collision import Box, CollisionChecker, Scene
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.lying_grasp import LyingHold
from bracket_cell.skills.motion.outline import Shape
from bracket_cell.skills.motion.separation import SeparationMonitor
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_cell.skills.motion.trajectory import STRAIGHT, joint_move, line_move, rounded
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.grip import Hold
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product


@dataclass(frozen=True)
class Load:
    """What a motion is checked with.

    Attributes:
        opening_m: widest opening of the fingers on the way.
        obstacles: parts and other boxes to keep clear of, beside the bench.
        held: boxes carried along, in the tool frame.
        close: keep no margin, for the last way down to a part among others or into a hole.
    """

    opening_m: float
    obstacles: tuple[Box, ...] = ()
    held: tuple[Box, ...] = ()
    close: bool = False


Plan = JointTrajectory | str  # a trajectory, or why there is none, in words for an operator
Looking = Iterator[Plan | None]  # None after each piece of the work; the plan is its last answer
Onto = Callable[[float], None]

BESIDE_M = 0.08  # of a part's middle: a tool that is farther away has left it
LIFTED_M = 0.01  # a tool that is so little lower than it was to be lifted is there
SPARE_M = 0.006  # more room that a search keeps, as it checks its ways in coarse steps
SCENES = 8  # that are kept: the same one is often asked about many postures
CHECKS_A_TICK = 500  # of postures: some 8 ms
LIFTS_M = ((0.03, 0.0), (0.12, 0.12))  # at the start and the end, that are tried before a search


def settled(found: Plan | Looking) -> Plan:
    """What is found in the end."""
    if isinstance(found, JointTrajectory | str):
        return found
    return next(plan for plan in found if plan is not None)


def followed(found: Plan | Looking, then: Callable[[JointTrajectory], JointTrajectory]) -> Plan | Looking:
    """What is found, each trajectory of it with what is to follow it, or to come before."""

    def whole(plan: Plan | None) -> Plan | None:
        return then(plan) if isinstance(plan, JointTrajectory) else plan

    if isinstance(found, str):
        return found
    return then(found) if isinstance(found, JointTrajectory) else map(whole, found)


class MotionPlanner:
    """Plans motions that keep the joint limits and touch nothing.

    Attributes:
        product, bench, settings: what it plans for.
        kinematics: of the arm with its tool.
        separation: of the arm from the person.
        hold: how the part is held that was taken last; None where this planner has not seen to one.
        lying: how it is held if it was taken as it lay; None for a part that stood.
        around: the part that the open fingers still stand around; every motion keeps clear of it, until the tool left.
        lifts_to: the tool pose up to which what was taken goes straight, before it goes anywhere, until it was there.
    """

    def __init__(self, product: Product, bench: Bench, settings: MotionSettings | None = None) -> None:
        self.product, self.bench = product, bench
        self.settings = settings or MotionSettings()
        self.hold: Hold | None = None
        self.lying: LyingHold | None = None
        self.around: Box | None = None
        self.lifts_to: Pose | None = None
        self.kinematics = Kinematics(self.settings)
        self._checker = CollisionChecker(self.kinematics, product, bench, self.settings)
        self.separation = SeparationMonitor(self._checker, bench, self.settings)
        self._scenes: list[tuple[tuple[Load, float, Box | None], Scene]] = []  # those that were asked for last
        self.beside = BesidePerson(self.separation, self.kinematics, self.settings.speed_limits_rad_s)

    @property
    def open_m(self) -> float:
        """Opening of a gripper that holds nothing."""
        return self.settings.gripper.stroke_m

    @property
    def robot_shapes(self) -> tuple[Shape, ...]:
        """Arm and gripper with closed fingers, as collisions are checked."""
        return self._checker.shapes

    def reach(self, poses: Sequence[Pose], near_rad: Array, load: Load, up_m: float = 0.0) -> tuple[Pose, Array] | str:
        """The tool pose with the shortest way there and its joints; or why none of them can be reached.

        The arm leans another way than it usually does only where something is in the way of that.

        Args:
            up_m: from there the tool must be able to go straight up by so much.
        """
        reason, scene = "", self.scene(load)
        left = [(pose, self.kinematics.answers(pose, near_rad)) for pose in poses]
        while left:
            free: list[tuple[float, Pose, Array]] = []
            for pose, answers in tuple(left):
                joints = next(answers, None)
                contact = None if joints is None else scene.contact(joints)
                if joints is not None and up_m > 0 and self._above(joints, up_m) is None:
                    reason = reason or "out of the arm's reach above it"
                elif joints is not None and contact is None:
                    free.append((self.travel_s(joints - near_rad), pose, joints))
                elif contact is not None:
                    reason = reason or contact.words
                if joints is None or (contact is not None and contact.by_tool):
                    left.remove((pose, answers))
            if free:
                _, pose, joints = min(free, key=lambda entry: entry[0])
                return pose, joints
        return reason or "out of the arm's reach"

    def free_move(self, start_rad: Array, goal_rad: Array, load: Load) -> Plan:
        """To joints by a free way, as soon as it is found; see `free_way`."""
        return settled(self.free_way(start_rad, goal_rad, load))

    def free_way(self, start_rad: Array, goal_rad: Array, load: Load) -> Plan | Looking:
        """To joints: the soonest of a few ways, or else what looks for another one, a tick's worth of work at a time.

        These are the direct way and, where the arm is slow for hands that may come, ways that lead back from there.
        From low over a hole the tool goes up at first: what it stands around may be hidden from the camera. So it does
        with what was taken and not yet lifted.
        """
        self.forget_left(start_rad)
        if self.lifts_to is None:
            return self._way(start_rad, goal_rad, load)
        lift = self.rise(start_rad, self.lifts_to.position_m[2], load.opening_m)
        if isinstance(lift, str):
            return lift
        found, is_free = self._way(lift.positions_rad[-1], goal_rad, load), self._room(self.scene(load))
        return followed(found, lambda way: rounded(lift, way, self.settings, is_free, STRAIGHT)[0])

    def _way(self, start_rad: Array, goal_rad: Array, load: Load) -> Plan | Looking:
        scene = self.scene(load)
        for way in () if self._low_over_hole(start_rad, load) else self.beside.soonest(start_rad, goal_rad):
            if scene.is_free(way):
                return self._through(scene, way)
        return self._around(scene, start_rad, goal_rad, load)

    def way_and_line(
        self, start_rad: Array, above_rad: Array, load: Load, line: Plan, onto: Onto, most: float
    ) -> Plan | Looking:
        """By a free way to joints, and on a line from there, as one motion without a stop between them.

        Args:
            line: from there on.
            onto: is told how long the way takes before only the line is followed.
            most: share of the shorter of them in which they are one motion at most.
        """
        if isinstance(line, str):
            return line

        def with_line(way: JointTrajectory) -> JointTrajectory:
            whole, on_line_s = rounded(way, line, self.settings, self._room(self.scene(load)), most)
            onto(on_line_s)
            return whole

        return followed(self.free_way(start_rad, above_rad, load), with_line)

    def near_move(self, start_rad: Array, goal_rad: Array, load: Load) -> Plan:
        """To joints by the direct way or after a lift, without a search: for where there is no time."""
        looking = self.free_way(start_rad, goal_rad, load)
        if isinstance(looking, JointTrajectory | str):
            return looking
        found = [plan for plan in islice(looking, len(LIFTS_M)) if plan is not None]
        return found[0] if found else self._no_way(self.scene(load), start_rad, goal_rad)

    def _around(self, scene: Scene, start_rad: Array, goal_rad: Array, load: Load) -> Looking:
        """A lift is often enough; then whatever a search finds."""
        clear_m = self._below_parts_m(start_rad, load)
        for lift_m, drop_m in LIFTS_M:
            yield self._lifted(scene, load.opening_m, (start_rad, goal_rad), max(lift_m, clear_m), drop_m)
        if not (scene.touches(start_rad) or scene.touches(goal_rad)):
            from bracket_cell.skills.motion.search import ways_around  # most runs never search

            limits_rad = self.kinematics.limits_rad
            ends = np.array([start_rad, goal_rad])
            wide = self.scene(load, SPARE_M)
            searched = scene if any(wide.touches(end) for end in ends) else wide
            for way in ways_around(scene, searched, ends, limits_rad, CHECKS_A_TICK):
                yield None
                if way is not None:
                    yield self._through(scene, way)
        yield self._no_way(scene, start_rad, goal_rad)

    def _no_way(self, scene: Scene, start_rad: Array, goal_rad: Array) -> str:
        """Which two things are in the way, at an end of it or on the direct one."""
        where = {"where the arm stands": start_rad, "at the end of the way": goal_rad}
        touched = [
            f"{found.words} {at}" for at, joints in where.items() if (found := scene.contact(joints)) is not None
        ]
        contact = (*touched, scene.first_contact(np.array([start_rad, goal_rad])))[0]
        return Message("no free way: {contact}", contact=contact)

    def _lifted(
        self, scene: Scene, opening_m: float, ends_rad: tuple[Array, Array], lift_m: float, drop_m: float
    ) -> JointTrajectory | None:
        """Up at first and down at the end, nearly straight, the soonest way between; None where that is not free."""
        start_rad, goal_rad = ends_rad
        up_rad, over_rad = self._above(start_rad, lift_m), self._above(goal_rad, drop_m)
        if up_rad is None or over_rad is None:
            return None
        if not self._leaves(np.array([start_rad, up_rad]), opening_m):
            return None
        for over in self.beside.soonest(up_rad, over_rad):
            rest = np.concatenate([over, [goal_rad]]) if drop_m else over
            if scene.is_free(rest):
                return self._through(scene, np.concatenate([[start_rad], rest]), STRAIGHT)
        return None

    def _leaves(self, way_up_rad: Array, opening_m: float) -> bool:
        """Whether a way up is free, on which the tool goes away from what stands beside it.

        What it let go does not count where somebody pushed it against that.
        """
        if self.scene(Load(opening_m, close=True)).is_free(way_up_rad):
            return True
        return self.around is not None and self._checker.scene(opening_m).is_free(way_up_rad)

    def _above(self, joints_rad: Array, lift_m: float) -> Array | None:
        """The joints that have the tool so much higher."""
        if lift_m == 0:
            return joints_rad
        pose = self.kinematics.forward(joints_rad)
        above = self.kinematics.follow(at_height(pose, pose.position_m[2] + lift_m), joints_rad)
        return above if above is not None and self.kinematics.within_limits(above) else None

    def _through(self, scene: Scene, way_rad: Array, most: float = 1.0) -> JointTrajectory:
        """Along straight ways between joints (k, joints), without stops where limits and room allow; see `rounded`."""
        legs = [joint_move(first, second, self.settings) for first, second in pairwise(way_rad)]
        return reduce(lambda whole, leg: rounded(whole, leg, self.settings, self._room(scene), most)[0], legs)

    def _room(self, scene: Scene) -> Callable[[Array], bool]:
        """Whether a path (k, joints) is free, and within the joints' range."""
        return lambda path_rad: self.kinematics.within_limits(path_rad) and scene.is_free(path_rad)

    def rise(self, start_rad: Array, height_m: float, opening_m: float) -> Plan:
        """The tool straight up to a height, which takes it away from all that stands beside or below it; never down."""
        tool = self.kinematics.forward(start_rad)
        pose = at_height(tool, max(height_m, tool.position_m[2]))
        return self.straight_move(start_rad, pose, Load(opening_m, close=True))

    def straight_move(
        self, start_rad: Array, world_from_tool: Pose, load: Load, speed_m_s: float | None = None
    ) -> Plan:
        """The tool on a straight line to a pose, at the settings' speed by default."""
        settings = self.settings
        if speed_m_s is not None:
            settings = settings.model_copy(update={"line_speed_m_s": speed_m_s})
        line = line_move(self.kinematics, start_rad, world_from_tool, settings)
        if line is None:
            return "the arm cannot follow a straight line there"
        contact = self.scene(load).first_contact(line.positions_rad)
        return line if contact is None else Message("no free way: {contact}", contact=contact)

    def blind_move(self, start_rad: Array, world_from_tool: Pose, speed_m_s: float) -> Plan:
        """The tool on a straight line without a look at what is in the way, as that is to be felt."""
        settings = self.settings.model_copy(update={"line_speed_m_s": speed_m_s})
        return line_move(self.kinematics, start_rad, world_from_tool, settings) or "the arm cannot follow that line"

    @property
    def blocked(self) -> list[tuple[str, str]]:
        """The arm's resting poses, by their names on the bench, in which it touches what stands there, and what."""
        scene = self.scene(Load(self.open_m))
        found = (
            (name, scene.contact(np.array(getattr(self.bench, name)))) for name in ("arm_park_rad", "arm_look_rad")
        )
        return [(name, contact.words) for name, contact in found if contact is not None]

    def scene(self, load: Load, spare_m: float = 0.0) -> Scene:
        """What is kept clear of on a motion, by so much more than needed."""
        asked = load, spare_m, self.around
        if (known := next((scene for of, scene in self._scenes if of == asked), None)) is not None:
            return known
        margin_m = spare_m if load.close else spare_m + self.settings.collision_margin_m
        obstacles = load.obstacles if self.around is None else (*load.obstacles, self.around)
        scene = self._checker.scene(load.opening_m, obstacles, load.held, margin_m)
        self._scenes = [(asked, scene), *self._scenes[: SCENES - 1]]
        return scene

    def _low_over_hole(self, joints_rad: Array, load: Load) -> bool:
        """Whether the fingers may stand around a part in a hole, or the part between them in one."""
        return self.around is not None or self._below_parts_m(joints_rad, load) > 0

    def _below_parts_m(self, joints_rad: Array, load: Load) -> float:
        """How far what is over a hole must rise to pass over every part that may stand in the next one; else 0."""
        tool_m = self.kinematics.position_m(joints_rad)
        tallest_m = max(part.size_m[2] for part in self.product.parts.values())
        x, y, z = self.bench.bracket.pose.inverse().transform(np.array(tool_m))
        near = any(np.hypot(x - a, y - b) < BESIDE_M / 2 for a, b in self.product.bracket.holes_m.values())
        z -= max((box.pose.position_m[2] + box.size_m[2] / 2 for box in load.held), default=0.0)  # a tool looks down
        return tallest_m + self.settings.carry_gap_m - z if near and z < tallest_m else 0.0

    def forget_left(self, joints_rad: Array) -> None:
        """Forget what the fingers stood around, if the tool is no longer beside it, and what was lifted."""
        if self.around is not None and np.abs(self._off_m(joints_rad, self.around.pose)).max() > BESIDE_M:
            self.around = None
        if self.lifts_to is not None:
            x, y, z = self._off_m(joints_rad, self.lifts_to)
            if z > -LIFTED_M or np.hypot(x, y) > BESIDE_M:
                self.lifts_to = None

    def _off_m(self, joints_rad: Array, pose: Pose) -> Array:
        """From a pose to where the tool is (3,)."""
        return np.subtract(self.kinematics.forward(joints_rad).position_m, pose.position_m)

    def travel_s(self, difference_rad: Array) -> float:
        """Time that the slowest joint needs at full speed."""
        return float(np.max(np.abs(difference_rad) / np.array(self.settings.speed_limits_rad_s)))


def at_height(pose: Pose, height_m: float) -> Pose:
    """The same pose straight above or below."""
    return Pose((pose.position_m[0], pose.position_m[1], height_m), pose.quaternion_wxyz)
