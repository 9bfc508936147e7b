"""What a fault does in truth: whether it is dangerous in the sense of IEC 61508, and since when.

Dangerous is what takes away a safety function: the arm is elsewhere, faster or longer under way than the cell believes
or ordered, the bench is not seen as it is while the arm moves, fingers do what nobody ordered, a part falls, a person's
order is not heard, or the run's last words are untrue.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_cell.running.gripper_checks import LIMITS as GRIPPER
from bracket_cell.skills.motion.known_bench import PLAUSIBLE
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.faults import Action
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import STANDING_RAD_S, Image, JointSamples, Observation
from bracket_ground.interfaces.pose import Array
from bracket_sim.cell import SimCell
from bracket_sim.faults.injection import Injection
from bracket_sim.scene import palette

EVERY = 4  # of the joints' samples


@dataclass
class StoppingDistance(Observer):
    """Measures from the fault on.

    Attributes:
        ticks_to_stop: from the first observation that shows the fault until the supervisor held or stopped, that
            observation included: 1 is at once; -1 for never.
        ticks_from_fault: the same from the fault itself: answers to frames take time, and a heartbeat has a period.
        stop_s, stop_m: from the fault until the arm stood, as measured at 500 Hz.
        held_before: a part was between the fingers when the fault came.
        held_lately: it was a moment before, and may be there still.
        at_end: nothing stopped the arm before the run was over.
    """

    injection: Injection
    motion: MotionPlanner
    ticks_to_stop: int = -1
    ticks_from_fault: int = -1
    stop_s: float = 0.0
    stop_m: float = 0.0
    held_before: bool = False
    held_lately: bool = False
    at_end: bool = False
    _held_s: float = -np.inf
    _ticks: int = 0
    _showing: int = 0
    _rested: bool = False
    _commanded: bool = False
    _tool: list[np.ndarray] = field(default_factory=list)

    def tick(self, record: TickRecord) -> None:
        began_s = self.injection.began_s
        if began_s is None:
            self.held_before = record.observation.gripper.holding
            self._held_s = record.observation.time_s if self.held_before else self._held_s
            self.held_lately = record.observation.time_s - self._held_s <= GRIPPER.held_lately_s
            return
        if record.joints is not None:
            self._measure(record.joints, began_s)
        if record.observation.time_s <= began_s or self.ticks_to_stop >= 0:
            return
        self._ticks += 1
        shown = self._commanded if self.injection.of_orders else shows(record.observation, self.injection)
        self._showing += self._showing > 0 or shown
        self._commanded = self.injection.shown  # by the command of this tick: the next observation shows it
        if record.status == "STOPPING" or (record.judgement is not None and record.judgement.action >= Action.HOLD):
            self.ticks_to_stop, self.ticks_from_fault = max(1, self._showing), self._ticks
            self.at_end = record.status == "STOPPING"

    def _measure(self, joints: JointSamples, began_s: float) -> None:
        samples = zip(joints.times_s, joints.positions_rad, joints.velocities_rad_s, strict=True)
        for time_s, positions, speeds in list(samples)[::EVERY]:
            if time_s <= began_s or self._rested:
                continue
            self._tool.append(self.motion.kinematics.position_m(positions))
            if len(self._tool) > 1:
                self.stop_m += float(np.linalg.norm(self._tool[-1] - self._tool[-2]))
            self.stop_s = float(time_s) - began_s
            self._rested = bool(np.abs(speeds).max() < STANDING_RAD_S and self.ticks_to_stop >= 0)


def shows(seen: Observation, injection: Injection) -> bool:
    """Whether an observation lets anybody know of the fault, whatever the supervisor makes of it."""
    fault, gripper = injection.fault, seen.gripper
    if fault.startswith("arm"):
        return injection.shown
    if fault.startswith("camera"):
        if any(trouble.device.startswith("camera") for trouble in seen.troubles):
            return True
        stale = seen.bench is None or seen.time_s - seen.bench.time_s > PLAUSIBLE.stale_s
        first = injection.first_frame
        spoiled = first is not None and seen.bench is not None and seen.bench.sequence >= first
        return stale if fault in ("camera_dead", "camera_raises") else spoiled
    if fault.startswith("sig") or fault == "observer_raises":
        return True
    lost = any(trouble.device == "gripper" for trouble in seen.troubles)
    odd = gripper.fault != 0 or gripper.node_state == "stopped" or not gripper.activated
    return lost or odd or seen.time_s - gripper.time_s > GRIPPER.stale_gripper_s


DRIVEN_M_S = 0.05  # a slower arm stands
FAST_M_S, BESIDE_M = 0.35, 0.10  # the reduced speed with what its reckoning is off by; a hand's length
HANDS_M_S = (1.6, 2.0)  # v_h: ISO 13855 for somebody who walks, and for a hand within 0.5 m
REACTS_S = 0.25  # T_r: until a frame is exposed and answered, a tick, and the arm's own cycle
BRAKES_M_S2 = 1.6  # of the arm's point, from the reduced speed: T_s and S_s


class TrueDistance:
    """Distance and protective distance of the robot's and the person's shapes, in the simulator's world.

    It knows the protective distance of ISO/TS 15066 with a constant speed of the hand, and nothing that the cell works
    out.
    """

    def __init__(self, cell: SimCell) -> None:
        self._cell, self._model, self._data = cell, cell.world.model, cell.world.data
        touch = list(zip(self._model.geom_contype, self._model.geom_conaffinity, strict=True))
        self._skin = self._of(touch, palette.SKIN_TOUCH)
        self._robot = np.concatenate([self._of(touch, own) for own in (palette.ROBOT_TOUCH, palette.HAND_ONLY_TOUCH)])

    def breached(self) -> tuple[bool, ...]:
        """For each of HANDS_M_S, whether a link is nearer than S_p = v_h (T_r + T_s) + v_r T_r + S_s and moves."""
        found = np.zeros(len(HANDS_M_S), dtype=bool)
        if not np.abs(self._cell.arm.driven_rad_s).max() > 0:
            return tuple(found)
        for geom in self._robot:
            speed_m_s = self._speed_m_s(int(geom))
            if speed_m_s > DRIVEN_M_S:
                found |= self._nearest_m(int(geom), float(protective_m(speed_m_s).max())) < protective_m(speed_m_s)
        return tuple(bool(hit) for hit in found)

    def too_fast(self) -> str:
        """That a link is faster beside the person than an arm may be that is slow before a hand arrives, in words."""
        for geom in self._robot:
            speed_m_s = self._speed_m_s(int(geom))
            near_m = self._nearest_m(int(geom), BESIDE_M) if speed_m_s > FAST_M_S else BESIDE_M
            if near_m < BESIDE_M:
                return f"the arm moves at {speed_m_s:.2f} m/s, {near_m:.2f} m from a person"
        return ""

    def _of(self, touch: list[tuple[int, int]], wanted: tuple[int, int]) -> NDArray[np.intp]:
        return np.array([geom for geom, bits in enumerate(touch) if tuple(map(int, bits)) == wanted], dtype=np.intp)

    def _speed_m_s(self, geom: int) -> float:
        """Of the shape's fastest point, at most: driven by the arm's servos."""
        model, driven = self._model, self._cell.arm.driven_rad_s
        moves, turns = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        body, arm = int(model.geom_bodyid[geom]), self._cell.world.arm_qvel
        mujoco.mj_jac(model, self._data, moves, turns, self._data.geom_xpos[geom], body)
        spin = float(np.linalg.norm(turns[:, arm] @ driven)) * float(model.geom_rbound[geom])
        return float(np.linalg.norm(moves[:, arm] @ driven)) + spin

    def _nearest_m(self, geom: int, most_m: float) -> float:
        """From a shape of the robot to the person; `most_m` where it is farther."""
        near_m, ends = most_m, np.zeros(6)
        centres, bounds = self._data.geom_xpos, self._model.geom_rbound
        apart = np.linalg.norm(centres[self._skin] - centres[geom], axis=1) - bounds[self._skin] - bounds[geom]
        for other in self._skin[apart < near_m]:
            near_m = min(near_m, mujoco.mj_geomDistance(self._model, self._data, geom, int(other), near_m, ends))
        return near_m


def protective_m(arm_m_s: float) -> Array:
    """S_p of ISO/TS 15066 for each of HANDS_M_S; positions are exact here, so C, Z_d and Z_r are 0."""
    stops_s = arm_m_s / BRAKES_M_S2
    hands_m = np.array(HANDS_M_S) * (REACTS_S + stops_s)
    return hands_m + arm_m_s * (REACTS_S + stops_s / 2)


ELSEWHERE_M, MOVES_RAD_S, HEARD_S = 0.03, 0.1, 0.6  # the margin of separation; a reaction and braking
OFF_PATH_RAD, FASTER, PLACES = 0.05, 1.25, 10
BLIND_S, ALIKE, BRIGHTER = 0.5, 0.8, 2.0
LANDS_S, IN_AIR_M = 0.6, 0.03
FINGERS_M, FINGERS_S, FELL_M = 0.006, 0.3, 0.02
KEPT = 64  # images
PART_FELL = "a part fell"
BLOCKS = (20, 15)


class Drops(Observer):
    """Notices a part that fell because the fingers were told to let it go above where it could rest.

    Attributes:
        dropped: one did.
    """

    def __init__(self, cell: SimCell) -> None:
        self._cell = cell
        self.dropped = False
        self._began_s, self._body, self._from_m = -math.inf, -1, 0.0

    def tick(self, record: TickRecord) -> None:
        sent, seen, data = record.sent.gripper, record.observation, self._cell.world.data
        if sent is not None and seen.gripper.holding and sent.opening_m > seen.gripper.opening_m:
            tool_m = np.array(self._cell.world.tool_pose().position_m)
            bodies = [body.body for body in self._cell.world.bodies]
            self._body = min(bodies, key=lambda body: float(np.linalg.norm(data.xpos[body] - tool_m)))
            self._began_s, self._from_m = seen.time_s, float(data.xpos[self._body][2])
        elif seen.time_s - self._began_s < LANDS_S:
            self.dropped |= self._from_m - float(data.xpos[self._body][2]) > IN_AIR_M


class Danger(Observer):
    """Compares what the cell believes and orders with the truth, tick by tick.

    Attributes:
        words: the first danger; empty for none.
        time_s: since when.
        way_m: of the true tool, by tick's time.
        paused_s: when somebody pressed pause, until `resume_s`.
    """

    def __init__(self, cell: SimCell, motion: MotionPlanner) -> None:
        self._cell, self._tool_m = cell, motion.kinematics.position_m
        self.words, self.time_s = "", math.inf
        self.way_m: list[tuple[float, float]] = []
        self.paused_s = self.resumed_s = math.inf
        self._last_m: Array | None = None
        self._path: JointTrajectory | None = None
        self._held_s = math.inf
        self._places: deque[tuple[float, float]] = deque(maxlen=PLACES)
        self._shares: deque[float] = deque(maxlen=2 * PLACES)
        self._goal_m: float | None = None
        self._fingers_s = math.inf
        self._held: str | None = None  # the part between the fingers
        self._held_m = np.zeros(3)
        self._images: dict[int, Frame] = {}
        self._told: dict[int, float] = {}  # when what a told frame shows really was, by number
        self._person = None if cell.worker is None else TrueDistance(cell)

    def frame(self, frame: Frame) -> None:
        """When the image that was told was really taken; never, where it shows no bench as it is."""
        if frame.camera != "overhead":
            return
        self._watch()
        true = self._images.get(frame.sequence)
        same = [image for image in self._images.values() if image.image is frame.image]
        if same:
            self._told[frame.sequence] = max(earlier.time_s for earlier in same)
        elif true is not None and true.image.shape == frame.image.shape:
            gain, same_share = alike(blocks(frame.image), blocks(true.image))
            fine = 1 / BRIGHTER < gain < BRIGHTER and same_share > ALIKE
            self._told[frame.sequence] = true.time_s if fine else -math.inf

    def _watch(self) -> None:
        """Keep the newest true image."""
        frame = self._cell.devices.overhead.latest()
        if frame is not None:
            self._images[frame.sequence] = frame
            self._images.pop(frame.sequence - KEPT, None)

    def tick(self, record: TickRecord) -> None:
        self._watch()
        seen, true = record.observation, self._cell.arm.state()
        tool_m = self._tool_m(np.array(true.positions_rad))
        way_m = 0.0 if self._last_m is None else float(np.linalg.norm(tool_m - self._last_m))
        self.way_m.append((seen.time_s, way_m))
        self._last_m = tool_m
        moves = bool(np.abs(true.velocities_rad_s).max() > MOVES_RAD_S)
        found = next(self._dangers(record, np.array(true.positions_rad), tool_m, moves), "")
        if found and not self.words:
            self.words, self.time_s = found, seen.time_s
        self._order(record)

    def begin(self, *, holding: bool) -> None:
        """What was so far does not count.

        Args:
            holding: a part is between the fingers.
        """
        self.words, self.time_s = "", math.inf
        self.way_m.clear()
        opening_mm = self._cell.gripper_node.registers()["gPO"]
        grips = holding and (self._goal_m is None or 1000 * self._goal_m < opening_mm)  # and is not to let go
        parts = {name: self._away_m(name) for name in self._cell.world.parts} if grips else {}
        self._held = min(parts, key=lambda name: float(np.linalg.norm(parts[name])), default=None)
        self._held_m = parts[self._held] if self._held is not None else np.zeros(3)

    def _away_m(self, part: str) -> Array:
        """From the tool to a part (3,), in the world frame."""
        away: Array = self._cell.world.data.body(part).xpos - self._tool_m(
            np.array(self._cell.arm.state().positions_rad)
        )
        return away

    def between_m(self, begin_s: float, end_s: float) -> float:
        """The tool's way from one time to another."""
        return sum(way_m for time_s, way_m in self.way_m if begin_s < time_s <= end_s)

    def at_end(self, outcome: Outcome, *, placed: bool) -> None:
        """The run is over."""
        moves = bool(np.abs(self._cell.arm.state().velocities_rad_s).max() > MOVES_RAD_S)
        endings = {
            "the last line says that a moving arm stands": moves and "the arm stands" in outcome.condition,
            "it says that it finished, and placed nothing": outcome.end == "finished" and not placed,
        }
        for words, found in endings.items():
            if found and not self.words:
                self.words, self.time_s = words, math.inf

    def _order(self, record: TickRecord) -> None:
        now_s = record.observation.time_s
        share = 1.0 if record.judgement is None else record.judgement.speed_scale
        if record.status in ("STOPPING", "STOPPED") or record.command.stop_arm:
            self._path, share = None, 0.0
        elif record.sent.trajectory is not None:
            self._path = record.sent.trajectory
            self._places.clear()
        self._shares.append(share)
        stands = share == 0 or self._path is None
        self._held_s = min(self._held_s, now_s) if stands else math.inf
        if record.sent.gripper is not None:
            self._goal_m, self._held = record.sent.gripper.opening_m, None

    def _dangers(self, record: TickRecord, joints: Array, tool_m: Array, moves: bool) -> Iterator[str]:
        seen, now_s = record.observation, record.observation.time_s
        if self._person is not None and (words := self._person.too_fast()):
            yield words
        if moves:
            yield from self._believed(seen, tool_m)
            yield from self._of_path(joints, now_s)
            if now_s - self._held_s > HEARD_S:
                yield "the arm moves and was ordered to stand"
            if self.paused_s + HEARD_S < now_s < self.resumed_s:
                yield "the arm moves although somebody pressed pause"
            told_s = None if seen.bench is None else self._told.get(seen.bench.sequence)
            if told_s is not None and now_s - told_s > BLIND_S:
                yield "the arm moves and the bench is not seen as it is"
        if (
            self._held is not None
            and abs(np.linalg.norm(self._away_m(self._held)) - np.linalg.norm(self._held_m)) > FELL_M
        ):
            yield PART_FELL
        registers = self._cell.gripper_node.registers()
        goal_m = None if self._goal_m is None else min(max(self._goal_m, 0.0), self._cell.world.robot.gripper.stroke_m)
        astray = goal_m is not None and registers["gGTO"] and abs(registers["gPR"] / 1000 - goal_m) > FINGERS_M
        self._fingers_s = min(self._fingers_s, now_s) if astray else math.inf
        if now_s - self._fingers_s > FINGERS_S:
            yield "the fingers go where nobody ordered"

    def _believed(self, seen: Observation, tool_m: Array) -> Iterator[str]:
        joints_rad = np.array(seen.arm.positions_rad)
        known = len(joints_rad) == len(self._cell.world.arm_qpos) and bool(np.isfinite(joints_rad).all())
        off_m = float(np.linalg.norm(self._tool_m(joints_rad) - tool_m)) if known else math.inf
        if off_m > ELSEWHERE_M:
            yield f"the arm moves {off_m:.2f} m from where it tells"

    def _of_path(self, joints: Array, now_s: float) -> Iterator[str]:
        """It leaves the path that it was sent, or is faster than it may be."""
        path = self._path
        if path is None:
            return
        off = np.abs(path.positions_rad - joints).max(axis=1)
        begun_s = self._places[-1][1] if self._places else 0.0
        near = (path.times_s >= begun_s - 0.1) & (path.times_s <= begun_s + 1.0)
        index = int(np.where(near, off, np.inf).argmin())
        if off.min() > OFF_PATH_RAD:
            yield f"the arm is {off.min():.2f} rad beside the path that it was sent"
        self._places.append((now_s, float(path.times_s[index])))
        gone_s, grew_s = (self._places[-1][number] - self._places[0][number] for number in (0, 1))
        if len(self._places) == PLACES and grew_s > FASTER * max(self._shares) * gone_s + 0.04:
            yield f"the arm goes on by {grew_s:.2f} s of its path in {gone_s:.2f} s"


def blocks(image: Image) -> Array:
    """An image so coarse (15, 20) that what is off by less than the margin of separation hardly shows."""
    return np.asarray(cv2.resize(image, BLOCKS, interpolation=cv2.INTER_AREA), float)


def alike(one: Array, other: Array) -> tuple[float, float]:
    """How much brighter one is than the other, and their correlation; 0 for one that shows nothing."""
    gain = (float(one.mean()) + 1) / (float(other.mean()) + 1)
    if one.shape != other.shape or one.std() == 0 or other.std() == 0:
        return gain, 0.0
    return gain, float(np.corrcoef(one.ravel(), other.ravel())[0, 1])
