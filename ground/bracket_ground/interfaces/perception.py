"""What detectors answer, and the protocols that classical and trained detectors implement alike."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose

WITHIN = math.sqrt(-2 * math.log(0.05))  # standard deviations within which 95 % of the places in a plane are
WRIST_BENDS_RAD = math.radians(30)  # to the side of the little finger; 20 to that of the thumb (AAOS, 1965)
SEGMENT_FRAMES = 45  # 3 s at 15 FPS, section 3.2 of the paper
ActionKind = Literal["assembly", "screw", "transit", "idle"]
Side = Literal["left", "right"]
Edge = Literal["left", "top", "right", "bottom"]


@dataclass(frozen=True)
class HandSample:
    """A hand in one frame. What a tracker cannot tell is None.

    Attributes:
        box_px: (left, top, right, bottom) of hand and held part in the image.
        fingertips_m: (x, y) of the point between the tips of thumb and index finger, in the world frame.
        palm_m: (x, y) of the palm.
        held_part: type of the part seen between the fingers, or None.
        velocity_m_s: (x, y) of the palm, a mean over its last frames; None where the track is too short to tell.
        acceleration_m_s2: (x, y) that palm and fingertips share, over their last three frames.
        height_m, fingertips_height_m: of palm and fingertips over the table.
        side: whether it is a left or a right hand.
        thumb_m, index_m: (x, y) of the tips of thumb and index finger.
        held_m: (x, y) of the middle of the held part; None where nothing is held, too.
        forearm_rad: direction from palm to elbow, from the x axis towards the y axis.
        confidence: from 0 to 1, that there is a hand.
        deviation_m: standard deviations of palm_m along x and y, and of height_m.
    """

    time_s: float
    box_px: tuple[int, int, int, int]
    fingertips_m: tuple[float, float]
    palm_m: tuple[float, float]
    held_part: str | None = None
    velocity_m_s: tuple[float, float] | None = None
    acceleration_m_s2: tuple[float, float] | None = None
    height_m: float | None = None
    fingertips_height_m: float | None = None
    side: Side | None = None
    thumb_m: tuple[float, float] | None = None
    index_m: tuple[float, float] | None = None
    held_m: tuple[float, float] | None = None
    forearm_rad: float | None = None
    confidence: float = 1.0
    deviation_m: tuple[float, float, float] | None = None

    @property
    def speed_m_s(self) -> float | None:
        """How fast the palm moves along the bench."""
        return None if self.velocity_m_s is None else math.hypot(*self.velocity_m_s)

    @property
    def off_m(self) -> float:
        """Along the bench, by how much the palm is off at most, in 95 of 100 frames; 0 where nobody says."""
        return 0.0 if self.deviation_m is None else WITHIN * max(self.deviation_m[:2])

    @property
    def forearm_guessed(self) -> bool:
        """Whether no wrist bends as far as the forearm is told to: then it is hidden, and its direction a guess."""
        if self.forearm_rad is None:
            return False
        x, y = self.palm_m[0] - self.fingertips_m[0], self.palm_m[1] - self.fingertips_m[1]
        return abs(math.remainder(self.forearm_rad - math.atan2(y, x), 2 * math.pi)) > WRIST_BENDS_RAD


@dataclass(frozen=True)
class Segment:
    """Segment s of Algorithm 1: the last SEGMENT_FRAMES frames and the hand in each (None: not seen).

    Attributes:
        before: the hand as it was last seen before these frames.
    """

    frames: tuple[Frame, ...]
    hands: tuple[HandSample | None, ...]
    before: HandSample | None = None

    @property
    def hand_crop(self) -> NDArray[np.uint8] | None:
        """Image I of Algorithm 1: the newest crop of the hand, (height, width, 3), or None where no hand was seen."""
        for frame, hand in zip(reversed(self.frames), reversed(self.hands), strict=True):
            if hand is not None:
                left, top, right, bottom = hand.box_px
                return frame.image[top:bottom, left:right]
        return None


@dataclass(frozen=True)
class Action:
    """What the hand did in a segment (18 classes with the default product).

    Attributes:
        part, position: set for an assembly action only, e.g. "o1" at "p3".
        finished: the hand motion that this action consists of is over.
        posterior: probability by the name of each class that is not out of the question, as in "o1 at p3" or "screw";
            empty where the detector has none.
        shown: it is told that it is finished because its hole is newly filled, not by the hand's movement alone.
    """

    kind: ActionKind
    confidence: float
    part: str | None = None
    position: str | None = None
    finished: bool = False
    posterior: Mapping[str, float] = field(default_factory=dict, hash=False)
    shown: bool = False

    def __str__(self) -> str:
        return f"{self.part} at {self.position}" if self.kind == "assembly" else self.kind


@dataclass(frozen=True)
class HoleView:
    """One hole as last seen.

    Attributes:
        part: type of the part in the hole; None where it is empty.
        seen_s: time of the frame in which it was last seen unobstructed.
        upright: the part stands straight in the hole.
    """

    part: str | None
    confidence: float
    seen_s: float
    upright: bool = True


@dataclass(frozen=True)
class BenchView:
    """Answer to one overhead frame: hand, holes and action.

    Attributes:
        sequence, time_s: of the frame that this answers.
        hand: None where no hand is seen; that means that there is none only where `hand_unknown` is empty.
        holes: by position name; a position that was never seen unobstructed is absent.
        health: what is wrong with the image, in words: "dark", "frozen" and the like; empty for a sound one.
            The next two are part of it.
        unseen: why the image does not show this bench, in words; empty where it does.
        unexplained: what differs from the empty bench where no hand is seen, in words; empty for nothing.
        depth_missing: that the depth image knows nothing under a hand, in words; empty where it does, or where there is
            neither hand nor depth image.
        spots: by name, as "pallet 3", what stands at places of the bench that the camera sees, as of holes.
        hand_unknown: why it is not known where the hand is; empty where it is known, or known to be absent.
        other_hands: hands in view that do not work.
        left_by: edges of the image by which the last hand left the view, or may have; empty while one is seen. Before
            the first one, the person's.
        calibration: what is wrong with the camera's calibration, in words; empty where nothing is known to be.
    """

    sequence: int
    time_s: float
    hand: HandSample | None
    holes: Mapping[str, HoleView]
    action: Action
    health: str = ""
    hand_unknown: str = ""
    other_hands: tuple[HandSample, ...] = ()
    left_by: tuple[Edge, ...] = ()
    calibration: str = ""
    unseen: str = ""
    unexplained: str = ""
    depth_missing: str = ""
    spots: Mapping[str, HoleView] = field(default_factory=dict)

    @property
    def hands(self) -> tuple[HandSample, ...]:
        """All hands in view."""
        return (() if self.hand is None else (self.hand,)) + self.other_hands


@dataclass(frozen=True)
class PartDetection:
    """One part seen by the wrist camera.

    Attributes:
        part: its type.
        world_from_part: pose of the body's bottom centre (where body and peg meet); x along its longer side.
        size_m: (length, width, height) of the body.
        box_px: (left, top, right, bottom) in the image.
        embedding: features of the crop for the grasp planner; empty where the detector has none.
        upright: it stands on its peg; of what does not, and of unknown things, the pose is a rough one.
        lies: exact world_from_part of a part that does not stand, where it could be made out how it lies.
        lies_on: boxes in the image of those that carry it, where the detector tells; by way of others, too.
    """

    part: str
    confidence: float
    world_from_part: Pose
    size_m: tuple[float, float, float]
    box_px: tuple[int, int, int, int]
    embedding: tuple[float, ...] = ()
    upright: bool = True
    lies: Pose | None = None
    lies_on: tuple[tuple[int, int, int, int], ...] = ()

    def stacked_with(self, other: PartDetection) -> bool:
        """Whether one of the two lies on the other."""
        return other.box_px in self.lies_on or self.box_px in other.lies_on


@dataclass(frozen=True)
class PartsView:
    """Answer to one wrist frame.

    Attributes:
        detections: parts that stand.
        others: lying parts and things of no type ("unknown"), as far as the detector reports them, each as an upright
            box on the floor that holds what is seen of it.
        calibration: what is wrong with the camera's calibration, in words; empty where nothing is known to be.
    """

    sequence: int
    time_s: float
    detections: tuple[PartDetection, ...]
    others: tuple[PartDetection, ...] = ()
    calibration: str = ""

    @cached_property
    def seen(self) -> tuple[PartDetection, ...]:
        """All that stands or lies in the tray; what stands comes first, by the same numbers as in `detections`."""
        return self.detections + self.others

    def on_top(self, index: int) -> tuple[int, ...]:
        """Numbers among `seen` of all that lie on one of them, by way of others, too; topmost first."""
        left, order = [index], list[int]()
        for below in left:
            lying = [
                number for number, detection in enumerate(self.seen) if self.seen[below].box_px in detection.lies_on
            ]
            order = [number for number in order if number not in lying] + [n for n in lying if n != index]
            left += [number for number in lying if number not in left]
        return tuple(reversed(order))


@runtime_checkable
class Preparing(Protocol):
    """A detector that can do part of its work before it is asked."""

    def prepare(self, image: NDArray[np.uint8]) -> None:
        """Do what follows from the image alone."""
        ...


class HandTracker(Protocol):
    """Finds hands in overhead frames, which come in order."""

    def track(self, frame: Frame) -> HandSample | None:
        """The hand that works and what it holds, or None where none is in view."""
        ...

    @property
    def others(self) -> tuple[HandSample, ...]:
        """The hands of the last frame that do not work."""
        ...


class HoleReader(Protocol):
    """Reads the occupancy of the holes from overhead frames; keeps what it saw last while a hole is covered."""

    def read(self, frame: Frame, hand: HandSample | None) -> Mapping[str, HoleView]:
        """Holes by position name, as far as ever seen."""
        ...


class ActionDetector(Protocol):
    """Names the action of a segment: detector(I, s) of Algorithm 1 (`segment.hand_crop` is I)."""

    def detect(self, segment: Segment, holes: Mapping[str, HoleView]) -> Action:
        """The action that the segment shows; `holes` is the occupancy at its end."""
        ...


class PartDetector(Protocol):
    """Finds parts in a wrist frame."""

    def detect(self, frame: Frame) -> tuple[PartDetection, ...]:
        """Parts in view, in no promised order; those that do not stand say so."""
        ...
