"""The arm behind the twin's controller: joints that follow set points, speeds, moves and stops cycle by cycle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import MotionLimits
from bracket_sim.devices.arm import TRACKING_LIMIT_RAD, TRACKING_PERIODS, servo_lag_s, tool_force_n
from bracket_sim.scene.world import World

ELBOW = 2  # joint about which the elbow bends
LOOKAHEAD_S, GAIN = (0.03, 0.2), (100.0, 2000.0)  # least and most that a controller takes
HAND_RAD_S, HAND_RAD_S2 = 0.6, 3.0  # of an arm that somebody moves by hand
SPEED_TOLERANCE = 1.08  # beyond a joint's speed by the data sheet the controller stops by itself; 3.4 of 3.14 rad/s

# Set points whose speed changes faster than this over the lookahead fail the controller's check of its path (C204); the
# maker gives no number. The driver's own stay below 8 rad/s2.
SANE_RAD_S2 = 50.0

Mode = Literal["hold", "servo", "speed", "move", "stop"]


WIDEST = MotionLimits(tool_m_s=5.0, elbow_m_s=5.0, momentum_kg_m_s=100.0)  # that a controller takes (user manual)


@dataclass(frozen=True, eq=False)
class Measured:
    """One measurement of the joints, (n,) each; and what pushes the tool, (3,) in the world.

    Attributes:
        tool_m_s: (6,) how the TCP moves and turns, in the world.
        elbow_m, elbow_m_s: (3,) each, in the world.
        momentum_kg_m_s: of all that moves.
    """

    time_s: float
    positions_rad: Array
    velocities_rad_s: Array
    moments_nm: Array
    targets_rad: Array
    target_speeds_rad_s: Array
    force_n: Array
    tool_m_s: Array
    elbow_m: Array
    elbow_m_s: Array
    momentum_kg_m_s: float


class TwinArm:
    """Interpolates what the controller's program commands, at the controller's cycle.

    Attributes:
        driven_rad_s: how fast the set points move, (n,).
        measured: the newest measurement.
        scale: of all speeds, 0 to 1: slider and safety of the controller.
        held_back: why the joints could not follow; empty where they could.
        mode: what is being done.
        limits: of the safety configuration in use.
        gain_rad_s2: how fast the speed of set points changes in this cycle, (n,).
    """

    def __init__(self, world: World) -> None:
        self._world, self._lag_s = world, servo_lag_s(world)
        self._reference = world.data.qpos[world.arm_qpos].copy()
        self._goal, self._acceleration = self._reference.copy(), 1.0
        self._lookahead_s, self._gain = LOOKAHEAD_S[0], GAIN[1]
        self._asked_rad_s: Array = np.zeros_like(self._reference)  # by set points, at a slider of 100 %
        self._moves: list[tuple[Array, float, float]] = []
        self._late_periods = self._fast_periods = self._over_periods = 0
        model = world.model
        self._tool = int(model.body("tool").id)
        self._elbow = int(model.jnt_bodyid[model.dof_jntid[world.arm_qvel][ELBOW]])
        self._root = int(model.body_rootid[self._elbow])
        self._chased: Array | None = None
        self.limits, self.gain_rad_s2 = world.robot.safety.normal, np.zeros_like(self._reference)
        self.mode: Mode = "hold"
        self.driven_rad_s: Array = np.zeros_like(self._reference)
        self.scale, self.held_back = 1.0, ""
        self.measured = self._measurement(0.0)

    def servo(self, goal_rad: Array, lookahead_s: float = LOOKAHEAD_S[0], gain: float = GAIN[1]) -> None:
        """Follow a set point that is renewed every cycle; the joints trail it by the lookahead.

        A low gain with a short lookahead overshoots. Speed and acceleration count for nothing, as with the maker.

        Args:
            gain: in [1/s2], of what is missing from where the joints are a lookahead later.
        """
        if self.mode != "servo":
            self._asked_rad_s, self._chased = self.driven_rad_s.copy(), None
        self.mode, self._goal = "servo", goal_rad
        self._lookahead_s, self._gain = float(np.clip(lookahead_s, *LOOKAHEAD_S)), float(np.clip(gain, *GAIN))

    def speed(self, goal_rad_s: Array, acceleration_rad_s2: float) -> None:
        """Take on these speeds, all joints slower where one of them is not as fast, and keep them."""
        self.mode, self._goal, self._acceleration = "speed", self._able(goal_rad_s), acceleration_rad_s2

    def move(self, moves: list[tuple[Array, float, float]]) -> None:
        """Go to (joints, speed, acceleration), one after the other, with a rest at each."""
        self.mode, self._moves = "move", list(moves)

    def stop(self, acceleration_rad_s2: float = 20.0) -> None:
        """Slow down, all joints alike, and hold."""
        if self.mode != "hold":
            self.mode, self._acceleration = "stop", max(acceleration_rad_s2, 0.1)

    def push(self, by_rad: Array) -> None:
        """Somebody moves the arm by hand, (n,)."""
        self.move([(self._reference + by_rad, HAND_RAD_S, HAND_RAD_S2)])

    @property
    def moving(self) -> bool:
        """Whether the set points move or are about to."""
        return self.mode in ("speed", "move", "stop") or bool(np.abs(self.driven_rad_s).max() > 1e-4)

    def update(self, _: float, dt_s: float) -> None:
        """Move the set points by one cycle."""
        here, velocity = self._reference, self._velocity(dt_s)
        self._reference = here + velocity * dt_s
        self.gain_rad_s2 = (velocity - self.driven_rad_s) / dt_s
        self.driven_rad_s = velocity
        self._world.data.ctrl[self._world.arm_ctrl] = here + velocity * (dt_s / 2 + self._lag_s)
        self._watch()

    def observe(self, time_s: float, /) -> None:
        """Measure the joints."""
        self.measured = self._measurement(time_s)

    def _velocity(self, dt_s: float) -> Array:
        """How fast the set points move in this cycle, (n,)."""
        now = self.driven_rad_s
        if self.mode == "servo":
            return self._served(dt_s)
        if self.mode == "speed":
            return _towards(now, self._goal * self.scale, self._acceleration * dt_s)
        if self.mode == "move" and self._moves:
            return self._on_the_move(dt_s)
        slowed = _towards(now, np.zeros_like(now), self._acceleration * dt_s)
        if not slowed.any():
            self.mode = "hold"
        return slowed

    def _served(self, dt_s: float) -> Array:
        """qdd = gain (goal - q - lookahead qd), stepped implicitly (URScript manual, `servoj`)."""
        missing: Array = self._goal - self._reference
        self._check_path(missing / (self._lookahead_s + dt_s))
        damping = 1 + dt_s * self._gain * (self._lookahead_s + dt_s * self.scale)
        self._asked_rad_s = (self._asked_rad_s + dt_s * self._gain * missing) / damping
        return self._asked_rad_s * self.scale

    def _check_path(self, chased: Array) -> None:
        """Stop where set points jump: as fast as these would speed a joint up, nobody plans."""
        before = self.driven_rad_s if self._chased is None else self._chased
        gain = float(np.abs(chased - before).max()) / self._lookahead_s
        self._chased = chased
        if gain > SANE_RAD_S2:
            self.held_back = f"set points jump: a joint would speed up by {gain:.0f} rad/s2, limit {SANE_RAD_S2:g}"

    def _on_the_move(self, dt_s: float) -> Array:
        """A trapezoid of the leading joint; the others keep their share of it."""
        goal, speed, acceleration = self._moves[0]
        way = goal - self._reference
        far = float(np.abs(way).max())
        if far < 1e-5:
            self._moves.pop(0)
            if not self._moves:
                self.mode, self._acceleration = "stop", acceleration
            return np.zeros_like(way)
        now = float(np.abs(self.driven_rad_s).max())
        fastest = min(speed * self.scale, now + acceleration * dt_s, float(np.sqrt(2 * acceleration * far)), far / dt_s)
        return self._able(way / far * fastest)

    def _able(self, speeds_rad_s: Array) -> Array:
        """These speeds, or a share of them that all joints can have by the data sheet."""
        excess = float((np.abs(speeds_rad_s) / np.array(self._world.robot.speed_rad_s)).max())
        return speeds_rad_s / max(1.0, excess)

    def _watch(self) -> None:
        """Tell when the joints are held back from their set points, or run faster than they may."""
        apart = float(np.abs(self.measured.positions_rad - self._reference).max())
        self._late_periods = self._late_periods + 1 if apart > TRACKING_LIMIT_RAD else 0
        speeds = np.abs(self.measured.velocities_rad_s)
        robot, set_rad_s = self._world.robot, self.limits.joint_rad_s
        allowed = np.minimum(SPEED_TOLERANCE * np.array(robot.speed_rad_s), set_rad_s or np.inf)
        joint = int(np.argmax(speeds / allowed))
        fast, most = float(speeds[joint]), float(allowed[joint])
        self._fast_periods = self._fast_periods + 1 if fast > most else 0
        over = self._over()
        self._over_periods = self._over_periods + 1 if over else 0
        if self._over_periods >= TRACKING_PERIODS:
            self.held_back = over
        elif self._late_periods >= TRACKING_PERIODS:
            self.held_back = f"a joint is {apart:.3f} rad from its set point"
        elif self._fast_periods >= TRACKING_PERIODS:
            self.held_back = f"{robot.joint_names[joint]} moves at {fast:.2f} {robot.units[joint]}/s, limit {most:.2f}"

    def _over(self) -> str:
        """Which general limit is broken, in words; empty for none."""
        seen = self.measured
        for name, words, unit, value in (
            ("tool_m_s", "the tool moves at", "m/s", float(np.linalg.norm(seen.tool_m_s[:3]))),
            ("elbow_m_s", "the elbow moves at", "m/s", float(np.linalg.norm(seen.elbow_m_s))),
            ("momentum_kg_m_s", "the arm's momentum is", "kg m/s", seen.momentum_kg_m_s),
        ):
            if value > (most := getattr(self.limits, name) or getattr(WIDEST, name)):
                return f"{words} {value:.2f} {unit}, limit {most:g}"
        return ""

    def freeze(self) -> None:
        """Hold where the joints are."""
        self._reference, self.driven_rad_s = self.measured.positions_rad.copy(), np.zeros_like(self._reference)
        self.mode, self.held_back, self._late_periods, self._over_periods = "hold", "", 0, 0

    def _measurement(self, time_s: float) -> Measured:
        data, world = self._world.data, self._world
        joints, speeds = data.qpos[world.arm_qpos].copy(), data.qvel[world.arm_qvel].copy()
        moments = data.qfrc_actuator[world.arm_qvel].copy()
        targets, force_n = (self._reference.copy(), self.driven_rad_s.copy()), tool_force_n(world)
        mujoco.mj_subtreeVel(world.model, data)
        momentum = float(world.model.body_subtreemass[self._root] * np.linalg.norm(data.subtree_linvel[self._root]))
        tool, elbow = (self._moving(body) for body in (self._tool, self._elbow))
        bent = data.xpos[self._elbow].copy(), elbow[:3]
        return Measured(time_s, joints, speeds, moments, *targets, force_n, tool, *bent, momentum)

    def _moving(self, body: int) -> Array:
        """How a body's origin moves and turns, (6,) in the world."""
        found = np.zeros(6)
        mujoco.mj_objectVelocity(self._world.model, self._world.data, mujoco.mjtObj.mjOBJ_XBODY, body, found, 0)
        return np.concatenate([found[3:], found[:3]])


def _towards(now: Array, goal: Array, step: float) -> Array:
    """Closer to the goal, all joints in the same share of their ways."""
    way = goal - now
    far = float(np.abs(way).max())
    nearer: Array = goal.copy() if far <= step else now + way * (step / far)
    return nearer
