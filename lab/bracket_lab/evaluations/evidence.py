"""Whether the signals of a cell show a fault: what they tell, compared with one another and with what was ordered.

It knows neither the fault nor the truth, and nothing of the supervisor's checks: tolerances are what a sound simulated
cell never leaves. It answers what could be known, and since when; not what is to be done.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import get_args

import numpy as np

from bracket_cell.watching.observer import Observer, TickRecord
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import ArmMode, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.pose import Array
from bracket_lab.evaluations.answer_evidence import AnswerEvidence
from bracket_lab.evaluations.danger import alike, blocks

FUTURE_S, ARM_OLD_S, STATUS_OLD_S, BENCH_OLD_S, ECHO_S = 0.02, 0.05, 0.06, 0.30, 0.12
SPEED_OFF_RAD_S, SPEED_OFF, JUMP_RAD = 0.15, 0.15, 0.02
OFF_PATH_RAD, END_RAD, LAGS_S = 0.015, 0.02, (0.0, 0.008, 0.016, 0.024)
BRAKED_S, WINDOW, FASTER, SLACK_S = 0.65, 5, 1.1, 0.03  # of the way along the path
STANDS_S, MOVES_RAD_S, STUCK = 0.50, 0.10, 3
ORDERED_S, STILL_S, OPENING_M, OVER_M = 0.30, 0.40, 0.004, (-0.001, 0.002)
FRAME_OLD_S, WRIST_S = 0.25, 0.6
BRIGHTER, ALIKE = 1.4, 0.8  # a bench image against the first one


class Evidence(Observer):
    """Looks at each tick of a run.

    Attributes:
        words: what showed first since `begin`; empty for nothing.
        time_s: of the observation that showed it.
    """

    def __init__(self, stroke_m: float) -> None:
        self._stroke_m = stroke_m
        self.words, self.time_s = "", math.inf
        self._now_s = 0.0
        self._seen: Observation | None = None
        self._path: JointTrajectory | None = None
        self._path_s = self._goal_s = self._look_s = math.inf  # when the newest order was given
        self._shares: deque[tuple[float, float]] = deque(maxlen=64)
        self._held_s = math.inf
        self._grown: deque[tuple[float, float]] = deque(maxlen=WINDOW + 1)
        self._counts: dict[str, int] = {}
        self._echoed_s = self._moved_s = 0.0
        self._goal_m: float | None = None
        self._speed_m_s = 0.1
        self._rests_m = 0.0
        self._active = False
        self._frames: dict[str, Frame] = {}
        self._first: Array | None = None
        self._answers = AnswerEvidence()
        self._of_frames: dict[str, tuple[int, str]] = {}  # what is wrong with a frame that is not answered so far

    def begin(self) -> None:
        """What showed so far does not count."""
        self.words, self.time_s = "", math.inf
        self._of_frames.clear()

    def frame(self, frame: Frame) -> None:
        """A camera's new frame; the bench stands still before an overhead camera but for hand, arm and parts."""
        before, self._frames[frame.camera] = self._frames.get(frame.camera), frame
        if frame.camera == "wrist":
            self._look_s = math.inf
        if words := next(self._frame(frame, before), ""):
            self._of_frames.setdefault(frame.camera, (frame.sequence, words))

    def tick(self, record: TickRecord) -> None:
        seen = record.observation
        self._now_s = seen.time_s
        if record.status == "STOPPING":  # the arm gave its path up
            self._path = None
        found = next(self._contradictions(seen), "") or self._answered(seen)
        if found and not self.words:
            self.words, self.time_s = found, seen.time_s
        self._seen = seen
        self._order(record)

    def _answered(self, seen: Observation) -> str:
        """What is wrong with a frame that the newest views are of."""
        views = {"overhead": seen.bench, "wrist": seen.parts}
        for camera, (number, words) in self._of_frames.items():
            view = views[camera]
            if view is not None and view.sequence >= number:
                return words
        return ""

    def _order(self, record: TickRecord) -> None:
        now_s, command, sent = self._now_s, record.command, record.sent
        share = 1.0 if record.judgement is None else record.judgement.speed_scale
        if record.status in ("STOPPING", "STOPPED") or command.stop_arm:
            share, self._path = 0.0, None
        elif sent.trajectory is not None:
            self._path, self._path_s = sent.trajectory, now_s
            self._grown.clear()
        self._shares.append((now_s, share))
        stands = share == 0 or self._path is None
        self._held_s = min(self._held_s, now_s) if stands else math.inf
        if sent.gripper is not None:
            self._goal_m, self._speed_m_s = sent.gripper.opening_m, sent.gripper.speed_m_s
        if sent.gripper is not None or share == 0 or command.activate_gripper:
            self._goal_s = self._moved_s = self._echoed_s = now_s
        self._look_s = now_s if command.look else self._look_s

    def _contradictions(self, seen: Observation) -> Iterator[str]:
        yield from (trouble.reason for trouble in seen.troubles)
        wrong = self._malformed(seen)
        if wrong:
            yield wrong
            return
        yield from self._stamps(seen)
        yield from self._motion(seen)
        yield from self._way(seen)
        yield from self._gripper(seen)
        yield from self._bench(seen)

    @staticmethod
    def _malformed(seen: Observation) -> str:
        arm = seen.arm
        values = (*arm.positions_rad, *arm.velocities_rad_s, arm.path_s or 0.0, arm.time_s)
        if not len(arm.positions_rad) == len(arm.velocities_rad_s) > 0 or not all(map(math.isfinite, values)):
            return "the arm's values are not numbers, one a joint"
        return "" if arm.mode in get_args(ArmMode)[:1] else f"the arm's mode is {arm.mode}"

    def _stamps(self, seen: Observation) -> Iterator[str]:
        age_s = seen.time_s - seen.arm.time_s
        if not -FUTURE_S <= age_s <= ARM_OLD_S:
            yield f"the arm's stamp is {age_s:.2f} s old"
        if self._seen is not None and seen.arm.time_s <= self._seen.arm.time_s:
            yield "the arm's stamps do not increase"

    def _motion(self, seen: Observation) -> Iterator[str]:
        """Positions, speeds and what is said of them."""
        arm, before = seen.arm, None if self._seen is None else self._seen.arm
        if before is None or self._malformed(self._seen or seen):
            return
        took_s = max(arm.time_s - before.time_s, 1e-3)
        moved = np.subtract(arm.positions_rad, before.positions_rad)
        reported = (np.array(arm.velocities_rad_s) + before.velocities_rad_s) / 2
        off = np.abs(moved / took_s - reported) - SPEED_OFF * np.abs(reported)
        if self._again("speed", bool(off.max() > SPEED_OFF_RAD_S), 2) or np.abs(moved).max() > JUMP_RAD + 3 * took_s:
            yield f"positions and speeds of the arm differ by {off.max():.2f} rad/s"
        moves = bool(np.abs(arm.velocities_rad_s).max() > MOVES_RAD_S) or bool(np.abs(moved / took_s).max() > 0.15)
        if self._again("unsaid", moves and not arm.moving, 2):
            yield "the arm moves and says that it does not"
        if moves and self._now_s - self._held_s > STANDS_S:
            yield "the arm moves and was told to stand"
        same = arm.moving and self._free(STUCK) and arm.positions_rad == before.positions_rad
        if self._again("same", same, STUCK):
            yield "the arm moves and tells the same"

    def _way(self, seen: Observation) -> Iterator[str]:
        """Where the arm is on the path that it was sent."""
        arm, path = seen.arm, self._path
        if path is None or self._now_s <= self._path_s:
            return
        joints, since_s = np.array(arm.positions_rad), self._now_s - self._path_s
        if not arm.moving:
            missed = float(np.abs(joints - path.positions_rad[-1]).max())
            if since_s > 3 * 0.04 and missed > END_RAD:
                yield f"the arm stands {missed:.2f} rad before the end of its path"
            return
        if arm.path_s is None or arm.path_s < 0:
            yield "the arm moves and does not tell where on its path"
            return
        off = min(float(np.abs(joints - path.at(arm.path_s - lag_s)).max()) for lag_s in LAGS_S)
        if off > OFF_PATH_RAD:
            yield f"the arm is {off:.3f} rad off the path that it tells"
        self._grown.append((arm.time_s, arm.path_s))
        gone_s, grew_s = (self._grown[-1][number] - self._grown[0][number] for number in (0, 1))
        most = max(share for when_s, share in self._shares if when_s > self._now_s - BRAKED_S - gone_s)
        if grew_s > FASTER * most * gone_s + SLACK_S or grew_s < -SLACK_S:
            yield f"the arm goes on by {grew_s:.2f} s of its path in {gone_s:.2f} s"
        full = len(self._grown) > WINDOW and arm.path_s < path.duration_s - 0.01
        if full and self._free(2 * WINDOW) and abs(grew_s) < 1e-6:
            yield "the arm does not go on along its path"

    def _free(self, ticks: int) -> bool:
        """Whether the arm might go on for so many ticks."""
        last = list(self._shares)[-ticks:]
        return len(last) == ticks and min(share for _, share in last) > 0.1

    def _gripper(self, seen: Observation) -> Iterator[str]:
        now_s, fingers, before = self._now_s, seen.gripper, None if self._seen is None else self._seen.gripper
        self._active |= fingers.activated
        self._echoed_s = now_s if fingers.echoed else self._echoed_s
        if now_s - fingers.time_s > STATUS_OLD_S:
            yield "the gripper's status is old"
        if not OVER_M[0] <= fingers.opening_m <= self._stroke_m + OVER_M[1]:
            yield "the gripper's opening cannot be"
        if not self._active or before is None:
            return
        if fingers.fault or not fingers.activated or fingers.node_state in ("stopped", "boot_up", "unknown"):
            yield f"the gripper tells fault {fingers.fault}, node {fingers.node_state}, active {fingers.activated}"
        if fingers.other_master or fingers.bus_errors:
            yield fingers.bus_errors or "another master commands the gripper"
        if now_s - self._echoed_s > ECHO_S:
            yield "the gripper does not repeat its command"
        yield from self._fingers(fingers, before)

    def _fingers(self, fingers: GripperState, before: GripperState) -> Iterator[str]:
        """Their way, and whether they say what fits to it."""
        now_s, status = self._now_s, fingers.object_status
        moved_m = fingers.opening_m - before.opening_m
        changed = status is not before.object_status
        if abs(moved_m) > 0.0005 or changed:
            self._moved_s = now_s
        if changed or status is ObjectStatus.MOVING or now_s - self._goal_s <= ORDERED_S:
            self._rests_m = fingers.opening_m
        if abs(moved_m) > 0.012:
            yield "the fingers jump"
        if self._goal_m is None or now_s - self._goal_s <= ORDERED_S:
            return
        if changed and before.object_status is not ObjectStatus.MOVING:
            yield "the fingers were told nothing, and say something else"
        if abs(fingers.opening_m - self._rests_m) > OPENING_M:
            yield "the fingers were told nothing, and moved"
        beyond_m = fingers.opening_m - min(max(self._goal_m, 0.0), self._stroke_m)
        arrived = status is ObjectStatus.AT_POSITION and abs(beyond_m) > OPENING_M
        if arrived or (status is ObjectStatus.CONTACT_CLOSING and beyond_m < -OPENING_M):
            yield "the fingers are not where they say"
        longest_s = self._stroke_m / self._speed_m_s + 1.0
        if status is ObjectStatus.MOVING and (
            now_s - self._moved_s > STILL_S or now_s - self._goal_s > longest_s
        ):  # pressing takes its time, too
            yield "the fingers move and do not arrive"

    def _bench(self, seen: Observation) -> Iterator[str]:
        if seen.bench is not None:
            age_s = seen.time_s - seen.bench.time_s
            if not -FUTURE_S <= age_s <= BENCH_OLD_S:
                yield f"the view of the bench is {age_s:.2f} s old"
        yield from self._answers.found(seen)
        if self._now_s - self._look_s > WRIST_S:
            yield "the wrist camera sends no frame"

    def _frame(self, frame: Frame, before: Frame | None) -> Iterator[str]:
        age_s = self._now_s - frame.time_s  # one tick more
        if not -FUTURE_S - 0.04 <= age_s <= FRAME_OLD_S:
            yield f"a frame of camera {frame.camera} is {age_s:.2f} s old"
        if before is not None and frame.time_s <= before.time_s:
            yield "stamps of frames do not increase"
        if frame.camera != "overhead":
            return
        if before is not None and np.array_equal(frame.image, before.image):
            yield "an image comes again"
        seen = blocks(frame.image)
        self._first = seen if self._first is None else self._first
        gain, same = alike(seen, self._first)
        if not 1 / BRIGHTER < gain < BRIGHTER or same < ALIKE:
            yield f"the bench looks otherwise: {gain:.1f} as bright, alike {same:.2f}"

    def _again(self, what: str, found: bool, times: int) -> bool:
        """Whether something was found so many times in a row."""
        self._counts[what] = self._counts.get(what, 0) + 1 if found else 0
        return self._counts[what] >= times
