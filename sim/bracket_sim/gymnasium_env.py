"""The cell for learners: `gymnasium.make("bracket_sim.gymnasium_env:cell/Reach-v0")`, and Grasp, Place and HandOver.

A step moves the tool a little, as far as the motion planner's checks and, beside a person, the separation let it, and
opens or closes the fingers. `RunPolicy` takes the same steps in the cell (`bracket_cell.skills.follow_policy.stepped`).

Observation, a dict:
    state      (n + 1,) the joints in [rad], then the opening of the fingers in [m]
    part       (3,) where the part stands that the robot is after, in the world in [m]
    target     (3,) where it goes: above the part, up from the tray, a hole, or the place where a person takes it
    overhead, wrist   (height, width, 3) images, where asked for
Action: five numbers from -1 to 1: the tool by that share of STEP_M along x, y and z, turned by that share of STEP_RAD
about the vertical, and the fingers: open above 0, else closed; for Reach they stay open.
Reward: how much nearer tool, part and target came in this step in [m], REFUSED less for a step that is not made, DONE
at the end of the task. A protective stop of the arm, as where it pushes something, ends the episode, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration, load_product
from bracket_cell.skills.follow_policy import STEPS, stepped
from bracket_cell.skills.motion.known_bench import PLAUSIBLE
from bracket_cell.skills.motion.near_hand import separation_of
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.command import GripperCommand, JointTrajectory
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import Action, BenchView
from bracket_ground.interfaces.pose import Array
from bracket_sim.cell import SimCell
from bracket_sim.process.opening import open_simulation

ABOVE_M, LIFTED_M, NEAR_M = 0.16, 0.06, 0.015
HANDED_M = (0.75, -0.20, 0.25)  # where a person takes a part: between tray and bracket, over the table
REFUSED, DONE = 0.05, 1.0
MOST_STEPS, TICK_S, PERIOD_S, MOST_S, AWAKE_S = 100, 0.04, 0.008, 2.0, 6.0
FARTHEST_M = 2.0
IMAGES = ("overhead", "wrist")


@dataclass(frozen=True, eq=False)
class Moment:
    """What a task is judged by: tool, part and target in the world [m], whether the fingers hold, how far they are."""

    tool_m: Array
    part_m: Array
    target_m: Array
    holding: bool

    def far_m(self, first: Array, second: Array) -> float:
        """Distance of two places."""
        return float(np.linalg.norm(first - second))


@dataclass(frozen=True, eq=False)
class Task:
    """One task.

    Attributes:
        target: from where the part stands, and the first hole, to where it goes.
        left_m: how far it is from its end.
        done: whether it is at its end.
        fingers: it needs them; else they stay open, whatever an action says.
    """

    target: Callable[[Array, Array], Array]
    left_m: Callable[[Moment], float]
    done: Callable[[Moment], bool]
    fingers: bool = True


def _carried_m(now: Moment) -> float:
    """To the part, then with it to the target."""
    way_m = now.far_m(now.part_m, now.target_m)
    return way_m if now.holding else way_m + now.far_m(now.tool_m, now.part_m) + ABOVE_M


def _there(now: Moment) -> bool:
    return now.far_m(now.part_m, now.target_m) < NEAR_M


UP = np.array([0.0, 0.0, 1.0])
TASKS = {
    "Reach": Task(
        lambda part, _: part + ABOVE_M * UP,
        lambda now: now.far_m(now.tool_m, now.target_m),
        lambda now: now.far_m(now.tool_m, now.target_m) < NEAR_M,
        fingers=False,
    ),
    "Grasp": Task(
        lambda part, _: part + LIFTED_M * UP,
        _carried_m,
        lambda now: now.holding and now.part_m[2] > now.target_m[2] - NEAR_M,
    ),
    "Place": Task(lambda _, hole: hole, _carried_m, lambda now: not now.holding and _there(now)),
    "HandOver": Task(lambda *_: np.array(HANDED_M), _carried_m, lambda now: now.holding and _there(now)),
}


class CellTask(gymnasium.Env[dict[str, Array], Array]):
    """One part of one tray of the simulated cell; which, the seed draws.

    Args:
        task: one of TASKS.
        configuration: of the cell; the shipped one unless given.
        images: cameras whose images are part of the observation: "overhead", "wrist".
        person: somebody works at the bench, and the arm keeps its distance.
        physics: of every motion; without, an arm that holds nothing is at once where it goes, if it touches nothing.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it

    def __init__(
        self,
        task: str = "Reach",
        configuration: str | None = None,
        images: tuple[str, ...] = (),
        person: bool = False,
        physics: bool = True,
    ) -> None:
        if task not in TASKS or set(images) - set(IMAGES):
            raise ValueError(f"task {task!r}, images {images}; legal: {', '.join(TASKS)}; {', '.join(IMAGES)}")
        if person and images:
            raise ValueError("beside a person, hands are seen without images: leave one of the two out")
        if not physics and (person or images):
            raise ValueError("without physics there is neither a person nor an image: leave these out")
        path = DEFAULT_CONFIGURATION if configuration is None else configuration
        self._task, self._images, self._person, self._physics = TASKS[task], tuple(images), person, physics
        self._configuration = load_configuration(path)
        self._product = load_product(self._configuration, path)
        self._motion = MotionPlanner(self._product, self._configuration.bench, self._configuration.motion)
        least, most = self._motion.settings.robot.limits_rad
        box, place = gymnasium.spaces.Box, np.full(3, FARTHEST_M, np.float32)
        state = np.append(least - 0.1, -1.0).astype(np.float32), np.append(most + 0.1, 1.0).astype(np.float32)
        spaces: dict[str, Any] = {
            "state": box(*state, (len(least) + 1,), np.float32),
            "part": box(-place, place, dtype=np.float32),
        }
        spaces["target"] = box(-place, place, dtype=np.float32)
        for name in self._images:
            setup = getattr(self._configuration.bench, name)
            spaces[name] = box(0, 255, (setup.height_px, setup.width_px, 3), dtype=np.uint8)
        self.observation_space: Any = gymnasium.spaces.Dict(spaces)
        self.action_space: Any = box(-1.0, 1.0, (len(STEPS) + 1,), np.float32)
        self._cell: SimCell | None = None
        self._frames: dict[str, Frame] = {}
        self._opening_m = self._motion.open_m
        self._way: JointTrajectory | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Another tray; `options` may name the `part` by its type.

        Raises:
            ValueError: no such part stands in the tray.
        """
        super().reset(seed=seed)
        self.close()
        drawn, kind = int(self.np_random.integers(2**31)), (options or {}).get("part")
        images, person = bool(self._images), self._person
        self._cell = cell = open_simulation(
            self._configuration, self._product, drawn, rendered=images, worker=person, watched=images or person
        )
        rest: list[Any] = [event.fields for event in cell.devices.truth() if event.kind == "resting"]
        there = [part for part in rest if kind in (None, part["part"]) and not part["on"]]
        if not there:
            raise ValueError(
                f"no part {kind!r} stands in this tray; there: {sorted({str(part['part']) for part in rest})}"
            )
        chosen = there[int(self.np_random.integers(len(there)))]
        self._body = next(body for body in cell.world.bodies if body.name == chosen["name"])
        hole = np.array([*next(iter(self._product.bracket.holes_m.values())), 0.0])
        self._target_m = self._task.target(self._part_m(), self._configuration.bench.bracket.pose.transform(hole))
        cell.devices.gripper.activate()
        self._run(AWAKE_S, lambda: cell.devices.gripper.state().activated and self._seen_all())
        self._left_m = self._task.left_m(self._moment())
        return self._seen(), {"part": chosen["part"], "left_m": self._left_m}

    def step(self, action: Array) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """One small motion to its end, or until it is held for MOST_S."""
        assert self._cell is not None, "reset comes first"
        devices, wanted = self._cell.devices, np.clip(np.asarray(action, np.float64), -1.0, 1.0)
        opening_m = self._motion.open_m if wanted[-1] > 0 or not self._task.fingers else 0.0
        same = opening_m == self._opening_m and not devices.gripper.state().holding
        if opening_m != self._opening_m:
            self._opening_m = opening_m
            devices.gripper.command(GripperCommand(opening_m))
        way = stepped(self._motion, np.array(devices.arm.state().positions_rad), wanted[:-1], opening_m)
        refused, stopped = way if isinstance(way, str) else "", False
        if not isinstance(way, str) and (self._physics or not same or not self._jumped(way)):
            try:
                self._way = devices.arm.follow(way)
            except DeviceFault as fault:  # a protective stop, which only a person clears
                refused, stopped = str(fault), True
        self._run(MOST_S, self._rests)
        if not self._rests():
            devices.arm.stop()
            self._run(MOST_S, self._rests)
        now = self._moment()
        left_m, done = self._task.left_m(now), self._task.done(now)
        reward = self._left_m - left_m - REFUSED * bool(refused) + DONE * done
        self._left_m = left_m
        return (
            self._seen(),
            float(reward),
            done or stopped,
            False,
            {"left_m": left_m, "refused": refused, "holding": now.holding, "is_success": done},
        )

    def close(self) -> None:
        """Let the simulation go."""
        if self._cell is not None:
            self._cell.close()
        self._cell, self._opening_m, self._way = None, self._motion.open_m, None
        self._frames.clear()

    def _run(self, most_s: float, over: Callable[[], bool]) -> None:
        """Until something is so, tick by tick, at the speed that the person leaves."""
        assert self._cell is not None
        devices = self._cell.devices
        end_s = devices.clock.now_s() + most_s
        while devices.clock.now_s() < end_s:
            devices.arm.pace(self._share())
            devices.clock.sleep_until(devices.clock.now_s() + (TICK_S if self._physics else PERIOD_S))
            for name, camera in (("overhead", devices.overhead), ("wrist", devices.wrist)):
                self._frames |= {name: frame} if (frame := camera.latest()) is not None else {}
            if over():
                return

    def _jumped(self, way: JointTrajectory) -> bool:
        """Whether the arm is at the end of a way at once, as it touches nothing there."""
        assert self._cell is not None
        arm, world = self._cell.arm, self._cell.world
        before = np.array(arm.state().positions_rad)
        arm.stand_at(way.positions_rad[-1])
        if touches := world.arm_touches():
            arm.stand_at(before)
            world.arm_touches()
        return not touches

    def _rests(self) -> bool:
        assert self._cell is not None
        arm = self._cell.devices.arm.state()
        return arm.stands and not arm.moving

    def _seen_all(self) -> bool:
        """Whether each camera that is asked for has made an image; one that waits for a trigger gets it."""
        assert self._cell is not None
        if "wrist" in self._images and "wrist" not in self._frames:
            self._cell.devices.wrist.trigger()
        return all(name in self._frames for name in self._images)

    def _share(self) -> float:
        """Of the arm's speed that the separation from a person allows; none where nobody knows where the person is."""
        assert self._cell is not None
        if not self._person:
            return 1.0
        cell, frame = self._cell, self._frames.get("overhead")
        now_s, arm = cell.devices.clock.now_s(), cell.devices.arm.state()
        if frame is None or now_s - frame.time_s > PLAUSIBLE.stale_s or cell.sight is None:
            return 0.0
        bench = BenchView(frame.sequence, frame.time_s, cell.sight.track(frame), {}, Action("idle", 1.0))
        ahead = None if self._way is None or not arm.moving or arm.path_s is None else (self._way, arm.path_s)
        found = separation_of(
            self._motion.separation, Observation(0, now_s, arm, cell.devices.gripper.state(), bench), ahead
        )
        return 0.0 if found is None or not found.distance_m >= found.least_m else found.speed_scale

    def _part_m(self) -> Array:
        assert self._cell is not None
        return np.array(self._cell.world.part_pose(self._body).position_m)

    def _moment(self) -> Moment:
        assert self._cell is not None
        devices = self._cell.devices
        tool_m = self._motion.kinematics.position_m(np.array(devices.arm.state().positions_rad))
        return Moment(np.asarray(tool_m), self._part_m(), self._target_m, devices.gripper.state().holding)

    def _seen(self) -> dict[str, Array]:
        assert self._cell is not None
        devices = self._cell.devices
        state = [*devices.arm.state().positions_rad, devices.gripper.state().opening_m]
        seen: dict[str, Any] = {name: np.array(self._frames[name].image) for name in self._images}
        places = {"state": state, "part": self._part_m(), "target": self._target_m}
        return {**{name: np.array(value, np.float32) for name, value in places.items()}, **seen}


for _name in TASKS:
    gymnasium.register(f"cell/{_name}-v0", f"{__name__}:CellTask", max_episode_steps=MOST_STEPS, kwargs={"task": _name})
