"""A robot that hands parts over by a script, for data: no controller decides, and nothing is seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import mujoco
import numpy as np

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.pose import Array, Pose
from bracket_sim.scene.hand_motion import min_jerk
from bracket_sim.scene.world import World, WorldPart

Script = Iterator[None]

TOOL_DOWN = Pose((0.0, 0.0, 0.0), (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)).rotation  # fingers open along world y
BEFORE_BRACKET_M, HELD_M, ASIDE_M = 0.21, 0.20, (-0.10, 0.20)  # where parts are held out, y from the bracket's middle
ABOVE_M = 0.15
GRIP_SHARE = 0.5  # of the body's height, where it is gripped
SQUEEZE_M = 0.002  # 40 N
MEAN_RAD_S, FINGERS_S = 0.5, 0.5
PAUSE_S = (1.0, 8.0)
NEAR_M = 0.05
TAKEN_S = 0.1  # a hand that passes by is at a part for less
SOLVE_STEPS, SOLVED, SOFTENING = 200, 1e-5, 1e-4


class Giver:
    """Fetches parts out of the tray, one after the other, and holds each out until the person has it.

    Attributes:
        joints_rad, speeds_rad_s: of the arm now, (n,).
        opening_m: set point of the gripper.
        holding: what is between its fingers.
        done: nothing is left to hand over, and the arm is parked.

    Args:
        parts: in the order in which they are handed over.
        taken: whether the person has a part between the fingers.
    """

    def __init__(
        self, world: World, parts: Sequence[WorldPart], taken: Callable[[str], bool], rng: np.random.Generator
    ) -> None:
        self._world, self._parts, self._taken, self._rng = world, parts, taken, rng
        self._scratch = mujoco.MjData(world.model)
        self.joints_rad: Array = np.array(world.bench.arm_park_rad)
        self.speeds_rad_s: Array = np.zeros(len(self.joints_rad))
        self.opening_m = world.robot.gripper.stroke_m
        self.holding: WorldPart | None = None
        self.done = not parts
        self._dt_s = 0.0
        self._script = self._hand_over()

    def advance(self, dt_s: float) -> None:
        """Let one period pass."""
        self._dt_s = dt_s
        before = self.joints_rad
        next(self._script, None)
        self.speeds_rad_s = (self.joints_rad - before) / dt_s

    def _hand_over(self) -> Script:
        for part in self._parts:
            yield from self._wait(float(self._rng.uniform(*PAUSE_S)))
            if part in parts_in_tray(self._world) and not self._taken(part.name):
                yield from self._fetch(part)
            if self.holding is not None:
                yield from self._hold_out(part)
            yield from self._go(np.array(self._world.bench.arm_park_rad))
        self.done = True

    def _fetch(self, part: WorldPart) -> Script:
        stands = self._world.part_pose(part)
        kind = self._world.product.parts[part.part]
        at_m = np.array(stands.position_m) + np.array([0.0, 0.0, GRIP_SHARE * kind.size_m[2]])
        above = self._solve(at_m + np.array([0.0, 0.0, ABOVE_M]), stands.yaw_rad)
        yield from self._go(above)
        yield from self._go(self._solve(at_m, stands.yaw_rad))
        near = float(np.linalg.norm(np.array(self._world.part_pose(part).position_m) - at_m)) < NEAR_M
        if near and not self._taken(part.name):
            yield from self._grip(kind.size_m[1] - SQUEEZE_M)
            self.holding = part
        yield from self._go(above)

    def _hold_out(self, part: WorldPart) -> Script:
        x, y, _ = self._world.bench.bracket.position_m
        spot_m = np.array([x + BEFORE_BRACKET_M, y + self._rng.uniform(*ASIDE_M), HELD_M])
        yield from self._go(self._solve(spot_m, 0.0))
        taken_s = 0.0
        while taken_s < TAKEN_S:
            taken_s = taken_s + self._dt_s if self._taken(part.name) else 0.0
            yield
        self.holding = None
        yield from self._grip(self._world.robot.gripper.stroke_m)
        yield from self._go(self._solve(spot_m + np.array([0.0, 0.0, ABOVE_M]), 0.0))

    def _wait(self, duration_s: float) -> Script:
        elapsed_s = 0.0
        while elapsed_s < duration_s:
            elapsed_s += self._dt_s
            yield

    def _go(self, joints_rad: Array) -> Script:
        start, elapsed_s = self.joints_rad, 0.0
        duration_s = max(float(np.abs(joints_rad - start).max()) / MEAN_RAD_S, 0.3)
        while elapsed_s < duration_s:
            elapsed_s += self._dt_s
            self.joints_rad = start + min_jerk(min(elapsed_s / duration_s, 1.0)) * (joints_rad - start)
            yield

    def _grip(self, opening_m: float) -> Script:
        start_m, elapsed_s = self.opening_m, 0.0
        while elapsed_s < FINGERS_S:
            elapsed_s += self._dt_s
            self.opening_m = start_m + min(elapsed_s / FINGERS_S, 1.0) * (opening_m - start_m)
            yield

    def _solve(self, position_m: Array, yaw_rad: float) -> Array:
        """Joints that bring the tool there, fingers down, across a part turned by yaw; damped least squares."""
        world, data = self._world, self._scratch
        turned = Pose.from_yaw((0.0, 0.0, 0.0), yaw_rad).rotation @ TOOL_DOWN
        tool = world.model.body("tool").id
        joints: Array = np.array(world.bench.arm_park_rad)
        joints[0] += math.atan2(position_m[1], position_m[0]) - math.atan2(*_park_spot(world)[::-1])
        for _ in range(SOLVE_STEPS):
            data.qpos[world.arm_qpos] = joints
            mujoco.mj_kinematics(world.model, data)
            mujoco.mj_comPos(world.model, data)
            now = data.xmat[tool].reshape(3, 3)
            off = 0.5 * sum(np.cross(now[:, axis], turned[:, axis]) for axis in range(3))
            error = np.concatenate([position_m - data.xpos[tool], off])
            if np.abs(error).max() < SOLVED:
                return joints
            jacobian = np.zeros((6, world.model.nv))
            mujoco.mj_jacBody(world.model, data, jacobian[:3], jacobian[3:], tool)
            j = jacobian[:, world.arm_qvel]
            joints = joints + j.T @ np.linalg.solve(j @ j.T + SOFTENING * np.eye(6), error)
        raise DeviceFault("arm", f"no joints for the tool at {np.round(position_m, 3).tolist()}")


def parts_in_tray(world: World) -> tuple[WorldPart, ...]:
    """What stands in the robot's tray now."""
    tray = world.bench.tray
    middle, half = np.array(tray.centre_m)[:2], np.array(tray.size_m) / 2
    return tuple(part for part in world.bodies if np.all(np.abs(world.data.xpos[part.body][:2] - middle) < half))


def _park_spot(world: World) -> tuple[float, float]:
    """Where the tool is while the arm is parked, (x, y)."""
    data = mujoco.MjData(world.model)
    data.qpos[world.arm_qpos] = world.bench.arm_park_rad
    mujoco.mj_kinematics(world.model, data)
    x, y, _ = data.xpos[world.model.body("tool").id]
    return float(x), float(y)
