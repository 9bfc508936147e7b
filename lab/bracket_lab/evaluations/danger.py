"""What a fault does in truth: whether it is dangerous in the sense of IEC 61508, and since when.

Dangerous is what takes away a safety function: the arm is elsewhere, faster or longer under way than the cell believes
or ordered, the bench is not seen as it is while the arm moves, fingers do what nobody ordered, a part falls, a person's
order is not heard, or the run's last words are untrue.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import cv2
import numpy as np

from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import Image, Observation
from bracket_ground.interfaces.pose import Array
from bracket_lab.evaluations.true_distance import TrueDistance
from bracket_sim.cell import SimCell

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
        same = [one for one in self._images.values() if one.image is frame.image]
        if same:
            self._told[frame.sequence] = max(one.time_s for one in same)
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
        share = 1.0 if record.judgement is None else record.judgement.share
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
        told = self._cell.gripper_node.registers()
        goal_m = None if self._goal_m is None else min(max(self._goal_m, 0.0), 0.085)
        astray = goal_m is not None and told["gGTO"] and abs(told["gPR"] / 1000 - goal_m) > FINGERS_M
        self._fingers_s = min(self._fingers_s, now_s) if astray else math.inf
        if now_s - self._fingers_s > FINGERS_S:
            yield "the fingers go where nobody ordered"

    def _believed(self, seen: Observation, tool_m: Array) -> Iterator[str]:
        told = np.array(seen.arm.positions_rad)
        known = len(told) == len(self._cell.world.arm_qpos) and bool(np.isfinite(told).all())
        off_m = float(np.linalg.norm(self._tool_m(told) - tool_m)) if known else math.inf
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
