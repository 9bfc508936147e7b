"""The person's motion without physics, a hundred times as fast: a part between closed fingers follows the hand.

It is the same person as beside the robot: `Worker` decides and moves, only what the physics would do is done by rule.
Nothing slips, falls over or collides; a part that is let go stands in the hole, bin or tray below it, or on the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np

from bracket_ground.interfaces.bench import Bench, Tray
from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.solid import span_m
from bracket_sim.scene.clutter import add_to_clutter, full_set
from bracket_sim.scene.hand import CURL_JOINT, DIGITS, GANTRY, WRIST_JOINTS, add_hand
from bracket_sim.scene.look import NOMINAL, Look
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.person import Person
from bracket_sim.scene.settings import ClutterSettings
from bracket_sim.scene.storage import Bin, Layout, lay_out
from bracket_sim.scene.world import WorldPart, build_world
from bracket_sim.worker.event_log import ActionEvent
from bracket_sim.worker.hand_primitives import TIP_AHEAD_M
from bracket_sim.worker.handing import Giver, parts_in_tray
from bracket_sim.worker.worker import Worker

PERIOD_S = 1 / 60
LONGEST_S = 240.0
TAIL_S = 1.0  # after everything is done
FINGER_M = 0.012  # of the fingertips that lies against a part, ahead of and behind the pinch
NEAR_M = 0.004  # a pinch this far outside a part still takes it
CATCHES_M = 0.012  # a part let go this close to a hole's axis goes in
SPREAD_M = 0.0008  # how far off the axis it then stands
AWAY_M = (0.0, 0.0, -1.0)  # where nobody sees a part


@dataclass(frozen=True, eq=False)
class Recording:
    """The motion of one assembly, sampled at a camera's rate; n samples.

    Attributes:
        times_s: (n,).
        fingertips_m, palm_m: (n, 3) in the world frame.
        actions, acts: the truth, see `EventLog`.
    """

    times_s: Array
    fingertips_m: Array
    palm_m: Array
    actions: tuple[ActionEvent, ...]
    acts: tuple[TruthEvent, ...]


class KinematicBench:
    """A bench with a person and no robot at work, advanced by rule; compiled once for many recordings.

    Attributes:
        world: as it stands; cameras may look at it.
    """

    def __init__(self, product: Product, bench: Bench, person: Person, look: Look = NOMINAL) -> None:
        self._product, self._bench, self._person = product, bench, person
        layout = self._laid_out(np.random.default_rng(0), np.random.default_rng(0))
        self._bins: tuple[Bin, ...] = layout.bins
        hand = partial(add_hand, bench=bench, person=look.person, habits=person)
        self.world = build_world(product, bench, layout.parts, None, hand, look, layout.bins)
        model = self.world.model
        wrist = [name for name in WRIST_JOINTS if person.grip.tilts] + [CURL_JOINT] * person.grip.curls
        wrist += ["hand_tool"] * (person.screw.tool > 0)
        names = [*GANTRY, *wrist]
        self._motors = [int(model.actuator(name).id) for name in names]
        self._joints = [int(model.joint(name).qposadr[0]) for name in names]
        self._digits = [int(model.joint(name).qposadr[0]) for name in DIGITS]
        self._digit_motor = int(model.actuator(DIGITS[0]).id)
        self._hand = int(model.body("hand").id)
        self._start = self.world.data.qpos.copy()
        self._held: tuple[WorldPart, Array, Array, float] | None = None
        self._rng = np.random.default_rng(0)
        self._giver: Giver | None = None
        bracket = bench.bracket.pose
        self._holes_m = [bracket.transform(np.array([*xy, 0.0])) for xy in product.bracket.holes_m.values()]

    def record(
        self, goal: str, seed: int, rate_hz: float = 15.0, frame: Callable[[float], None] | None = None
    ) -> Recording:
        """One assembly from the beginning to its end.

        Args:
            frame: called at every sample with its time, while `world` is as it is then.
        """
        streams = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(4)]
        self._rng = streams[2]
        self._reset(self._laid_out(streams[0], np.random.default_rng([seed, 9])))
        wanted = self._product.goal_placements(goal)
        moves, habits = streams[1], streams[0]
        worker = Worker(self.world, self._product, self._bench, self._person, wanted, moves, habits, minds_arm=False)
        handed_over = tuple(part for part in parts_in_tray(self.world) if part.owner == "person")
        self._giver = Giver(self.world, handed_over, worker.has, streams[3])
        every = max(1, round(1 / (rate_hz * PERIOD_S)))
        times, tips, palms = [], [], []
        period, over = 0, math.inf
        while period * PERIOD_S < min(over, LONGEST_S):
            if period % every == 0:
                times.append(period * PERIOD_S)
                tips.append(worker.hand.position_m)
                palms.append(worker.hand.palm_m)
                if frame is not None:
                    frame(times[-1])
            self._giver.advance(PERIOD_S)
            worker.update(period * PERIOD_S, PERIOD_S)
            self.step()
            period += 1
            if worker.done and self._giver.done and math.isinf(over):
                over = period * PERIOD_S + TAIL_S
        return Recording(np.array(times), np.array(tips), np.array(palms), tuple(worker.events), tuple(worker.acts))

    def step(self) -> None:
        """The hand is where it was commanded, with what it holds."""
        data = self.world.data
        data.qpos[self._joints] = data.ctrl[self._motors]
        gap_m = 2 * float(data.ctrl[self._digit_motor])
        if self._held is not None and gap_m > self._held[3] + 1e-4:
            self._drop(self._held[0])
            self._held = None
        elif self._held is None and gap_m < 2 * float(data.qpos[self._digits[0]]):
            self._held = self._between(gap_m)
        data.qpos[self._digits] = (gap_m if self._held is None else max(gap_m, self._held[3])) / 2
        self._move_arm()
        if self._held is not None:
            self._carry(*self._held[:3])
        mujoco.mj_kinematics(self.world.model, data)

    def _move_arm(self) -> None:
        """The arm is where it was commanded, with what it holds."""
        world, giver = self.world, self._giver
        assert giver is not None
        offset = None
        if giver.holding is not None and (self._held is None or self._held[0] != giver.holding):
            offset = world.tool_pose().inverse() @ world.part_pose(giver.holding)
        world.data.qpos[world.arm_qpos], world.data.qvel[world.arm_qvel] = giver.joints_rad, giver.speeds_rad_s
        world.set_opening(giver.opening_m)
        if offset is not None and giver.holding is not None:
            mujoco.mj_kinematics(world.model, world.data)
            self._put(giver.holding, world.tool_pose() @ offset)

    def _laid_out(self, rng: np.random.Generator, rng_of_robot: np.random.Generator) -> Layout:
        """The person's parts, and as many of the robot's as there happen to be in the tray; the others are away."""
        product, bench = self._product, self._bench
        layout = lay_out(product, bench, self._person.storage, rng, handing=True)
        handed_over = [(part.part, part.world_from_part) for part in layout.parts if _in_tray(bench.tray, part)]
        types = rng_of_robot.permutation(full_set(product)).tolist()
        room = max(0, len(types) - len(handed_over))
        there = types[: int(rng_of_robot.integers(room + 1))]
        stands = add_to_clutter(product, bench.tray, handed_over, there, rng_of_robot, ClutterSettings())
        away = (ScenePart(name, Pose(AWAY_M)) for name in types[len(there) :])
        return replace(layout, parts=(*layout.parts, *stands, *away))

    def _reset(self, layout: Layout) -> None:
        data = self.world.data
        data.qpos[:], data.ctrl[:], self._held = self._start, 0.0, None
        left = list(layout.parts)
        for part in self.world.bodies:
            scene = next(
                scene_part for scene_part in left if (scene_part.part, scene_part.owner) == (part.part, part.owner)
            )
            left.remove(scene)
            self._put(part, scene.world_from_part)
        mujoco.mj_kinematics(self.world.model, data)

    def _put(self, part: WorldPart, pose: Pose) -> None:
        self.world.data.qpos[part.qpos : part.qpos + 7] = (*pose.position_m, *pose.quaternion_wxyz)

    def _between(self, gap_m: float) -> tuple[WorldPart, Array, Array, float] | None:
        """The part between the fingertips if they touch it: part, its pose seen from the hand, width where pinched."""
        data = self.world.data
        hand_m, turned = data.xpos[self._hand], data.xmat[self._hand].reshape(3, 3)
        for part in self.world.bodies:
            kind = self._product.parts[part.part]
            x, y, z = data.xmat[part.body].reshape(3, 3).T @ (hand_m - data.xpos[part.body])
            length_m, width_m, height_m = kind.size_m
            if abs(x) > length_m / 2 + TIP_AHEAD_M or abs(y) > width_m / 2 or not -NEAR_M < z < height_m + NEAR_M:
                continue
            low, high = span_m(kind.solids, 1, {0: (x - FINGER_M, x + FINGER_M), 2: (z, z)}) or (0.0, 0.0)
            if high - low < gap_m:
                continue
            back, seen = np.zeros(4), np.zeros(4)
            mujoco.mju_negQuat(back, data.xquat[self._hand])
            mujoco.mju_mulQuat(seen, back, data.xquat[part.body])
            return part, turned.T @ (data.xpos[part.body] - hand_m), seen, high - low
        return None

    def _carry(self, part: WorldPart, offset_m: Array, turned: Array) -> None:
        """Let a part follow the hand; the hand's own pose is computed first."""
        model, data = self.world.model, self.world.data
        mujoco.mj_kinematics(model, data)
        quaternion = np.zeros(4)
        mujoco.mju_mulQuat(quaternion, data.xquat[self._hand], turned)
        position = data.xpos[self._hand] + data.xmat[self._hand].reshape(3, 3) @ offset_m
        data.qpos[part.qpos : part.qpos + 7] = (*position, *quaternion)

    def _drop(self, part: WorldPart) -> None:
        """Let a part stand upright on what is below it."""
        pose = self.world.part_pose(part)
        x, y, _ = pose.position_m
        for hole in self._holes_m:
            if math.hypot(x - hole[0], y - hole[1]) < CATCHES_M and self._empty(hole):
                off_x, off_y = self._rng.normal(0.0, SPREAD_M, 2)
                self._put(part, Pose.from_yaw((hole[0] + off_x, hole[1] + off_y, float(hole[2])), pose.yaw_rad))
                return
        peg_m = self._product.parts[part.part].peg_length_m
        self._put(part, Pose.from_yaw((x, y, self._floor_m(x, y) + peg_m), pose.yaw_rad))

    def _empty(self, hole: Array) -> bool:
        held = None if self._held is None else self._held[0].body
        others = [part.body for part in self.world.bodies if part.body != held]
        return all(np.linalg.norm(self.world.data.xpos[body] - hole) > CATCHES_M for body in others)

    def _floor_m(self, x: float, y: float) -> float:
        """Height of what a part at (x, y) stands on."""
        tray = self._bench.tray
        boxes = [(bin_.centre_m, bin_.size_m) for bin_ in self._bins] + [(tray.centre_m, tray.size_m)]
        for centre, size in boxes:
            if abs(x - centre[0]) < size[0] / 2 and abs(y - centre[1]) < size[1] / 2:
                return centre[2]
        return 0.0


def _in_tray(tray: Tray, part: ScenePart) -> bool:
    away = np.abs(np.array(part.world_from_part.position_m) - np.array(tray.centre_m))
    return bool((away[:2] < np.array(tray.size_m) / 2).all())
