"""The cell as a Gymnasium environment, so that a policy is trained where it will run: `gym.make("cell/AbovePart-v0")`.

The arm is to bring its tool above a part of the tray. One step is one motion, as the leaf `RunPolicy` makes it.

Observation: a dict of what a policy sees in the cell, by the same names: see `bracket_cell.learned.inference.policy`.
Action: six joints in [rad] where the arm goes next; a way that is not free, or beyond the limits, is not gone.
Reward: minus the distance of the tool from the place above the part in [m]; REFUSED less where the way was not gone.
The episode ends within REACHED_M; a part is drawn from the seed.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration, load_product
from bracket_cell.learned.inference.policy import ENVIRONMENT, OF_ENVIRONMENT, OF_STATE, STATE, observed
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_ground.interfaces.pose import Array, Pose
from bracket_sim.cell import SimCell
from bracket_sim.process.opening import open_simulation

NAME = "cell/AbovePart-v0"
ABOVE_M, REACHED_M, REFUSED = 0.16, 0.01, 1.0
MOST_STEPS, MOTION_S, TICK_S = 20, 10.0, 0.04
FARTHEST_M = 2.0
FINGERS_DOWN = (0.0, 1.0, 0.0, 0.0)


def register() -> None:
    """Make the name known; called by Gymnasium, which finds it by the package's entry point."""
    gymnasium.register(NAME, entry_point=f"{__name__}:AbovePart", max_episode_steps=MOST_STEPS)


class AbovePart(gymnasium.Env[dict[str, Array], Array]):
    """One tray of the simulated cell, without a person and without images.

    Args:
        configuration: of the cell; the shipped one unless given.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, configuration: str | None = None) -> None:
        path = DEFAULT_CONFIGURATION if configuration is None else configuration
        self._configuration = load_configuration(path)
        self._product = load_product(self._configuration, path)
        bench, settings = self._configuration.bench, self._configuration.motion
        self._motion = MotionPlanner(self._product, bench, settings)
        least, most = limits = self._motion.settings.robot.limits_rad
        opening = np.array([1.0])
        far = np.full(len(OF_ENVIRONMENT), FARTHEST_M)
        box, self._limits = gymnasium.spaces.Box, limits
        state = np.concatenate([least - 0.1, -opening]), np.concatenate([most + 0.1, opening])
        self.observation_space: Any = gymnasium.spaces.Dict(
            {STATE: box(*state, (len(OF_STATE),), np.float64), ENVIRONMENT: box(-far, far, dtype=np.float64)}
        )
        self.action_space: Any = box(least, most, dtype=np.float64)
        self._cell: SimCell | None = None
        self._part_m: tuple[float, ...] = ()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Another tray; `options` may name the `part` to go to by its type."""
        super().reset(seed=seed)
        self.close()
        drawn, kind = int(self.np_random.integers(2**31)), (options or {}).get("part")
        self._cell = open_simulation(self._configuration, self._product, drawn, rendered=False)
        rest: list[Any] = [one.fields for one in self._cell.devices.truth() if one.kind == "resting"]
        there = [one for one in rest if kind in (None, one["part"]) and not one["on"]]
        if not there:
            raise ValueError(
                f"no part {kind!r} stands in this tray; there: {sorted({str(one['part']) for one in rest})}"
            )
        chosen = there[int(self.np_random.integers(len(there)))]
        self._part_m = tuple(chosen["position_m"])
        return self._seen(), {"part": chosen["part"], "distance_m": self._distance_m()}

    def step(self, action: Array) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """One motion, to its end."""
        assert self._cell is not None, "reset comes first"
        arm, clock = self._cell.devices.arm, self._cell.devices.clock
        start = np.array(arm.state().positions_rad)
        goal = np.clip(np.asarray(action, np.float64), *self._limits)
        way = self._motion.free_move(start, goal, Load(0.085))
        if not isinstance(way, str) and way.duration_s > 0:
            arm.follow(way)
            until_s = clock.now_s() + way.duration_s + MOTION_S
            while clock.now_s() < until_s:
                arm.pace(1.0)
                clock.sleep_until(clock.now_s() + TICK_S)
                if arm.state().stands and not arm.state().moving:
                    break
        distance_m = self._distance_m()
        refused = isinstance(way, str)
        told = {"distance_m": distance_m, "refused": way if refused else ""}
        return self._seen(), -distance_m - REFUSED * refused, distance_m < REACHED_M, False, told

    def above(self, part_m: Array, near_rad: Array) -> Array:
        """Joints (6,) above a place, for a scripted demonstration; the fingers point down.

        Raises:
            ValueError: the arm does not reach there.
        """
        x, y, z = part_m
        joints = self._motion.kinematics.inverse(Pose((x, y, z + ABOVE_M), FINGERS_DOWN), near_rad)
        if joints is None:
            raise ValueError(f"the arm does not reach {part_m} m")
        return joints

    def close(self) -> None:
        """Let the simulation go."""
        if self._cell is not None:
            self._cell.close()
            self._cell = None

    def _seen(self) -> dict[str, Array]:
        assert self._cell is not None
        return observed(self._cell.devices.arm.state(), self._cell.devices.gripper.state(), self._part_m)

    def _distance_m(self) -> float:
        assert self._cell is not None
        tool_m = self._motion.kinematics.position_m(np.array(self._cell.devices.arm.state().positions_rad))
        return float(np.linalg.norm(tool_m - np.array(self._part_m) - (0.0, 0.0, ABOVE_M)))
