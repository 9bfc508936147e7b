"""Hands over time: which reading belongs to which hand, which hand works, and smooth points in the world."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.classical.track_health import motion_of
from bracket_cell.learned.hands.depth import ERROR_M, heights_by_depth
from bracket_cell.learned.hands.deviation import deviation_m
from bracket_cell.learned.hands.height import PalmLength, heights_m, learn_length
from bracket_cell.learned.hands.reading import HandReader, Reading
from bracket_cell.learned.hands.regions import Regions
from bracket_cell.learned.hands.robot_mask import RobotMask
from bracket_cell.learned.inference.prefetch import Image
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample, Preparing
from bracket_ground.interfaces.pose import Array

NEW_CONFIDENCE, LEAST_CONFIDENCE = 0.5, 0.5  # of a hand that was not seen before, and of one that was
DOUBTFUL_N, DOUBTFUL_S = 3, 0.3  # readings of LEAST_CONFIDENCE at one place within this time begin a track
LOST_S = 0.25  # after which a hand that comes back is a new one
COMES_BACK_S = 2.0  # for so long it is expected where it was lost, also on the robot
NEAR_SHARE = 0.45  # of a region's side: a hand is found again within it
ACTING_KEEPS = 0.7  # share of the former opinion of which hand works, and of which side it is
SURE_KEEPS = 0.8  # share of the former confidence: shadows that look like hands are doubted now and then
TAKES_OVER = 0.1  # by which another hand must look more like the one that works
STILL_WORKS = 0.2  # a hand that worked does so until it looks less like it
HELD_FRAMES = 7  # among which most say what is held
SMOOTH_S, HALVED_AT_M_S = 0.01, 0.1  # time constant of a hand at rest (see `_Smooth`), and speed that halves it

OF_PALM = ("palm", "wrist", "radial", "ulnar")  # points that are as high as it
MOTION_FRAMES = 4  # over which the velocity of a palm is estimated

Point = tuple[float, float]


@dataclass(eq=False)
class _Smooth:
    """First-order smoothing that gives way to speed (the 1 Euro filter of Casiez 2012, with one constant each)."""

    value: Array
    speed: Array = field(default_factory=lambda: np.zeros(0))

    def update(self, value: Array, step_s: float) -> Array:
        """The smoothed value after one more measurement."""
        raw = (value - self.value) / step_s
        self.speed = raw if not len(self.speed) else 0.5 * self.speed + 0.5 * raw
        constant_s = SMOOTH_S / (1 + float(np.linalg.norm(self.speed)) / HALVED_AT_M_S)
        self.value = self.value + (value - self.value) / (1 + constant_s / step_s)
        return self.value


@dataclass(eq=False)
class _Track:
    """One hand."""

    reading: Reading
    seen_s: float
    acting: float
    left: float
    sure: float
    away: bool  # it was once seen where the robot was not: then it is a hand, wherever it goes
    begun_s: float
    smooth: dict[str, _Smooth] = field(default_factory=dict)
    smoothed_s: float = -math.inf
    speed_px_s: Array = field(default_factory=lambda: np.zeros(2))
    places: deque[tuple[float, Array]] = field(default_factory=lambda: deque(maxlen=MOTION_FRAMES))
    holds: deque[str | None] = field(default_factory=lambda: deque(maxlen=HELD_FRAMES))

    @classmethod
    def begun(cls, reading: Reading, time_s: float, away: bool) -> _Track:
        """By its first reading."""
        track = cls(reading, time_s, reading.acting, reading.left, reading.confidence, away, time_s)
        track.holds.append(reading.held_part)
        return track

    @property
    def works(self) -> float:
        """How much it looks like the hand that works: that it does, if it is one."""
        return self.acting * self.sure

    @property
    def held_part(self) -> str | None:
        """What most of the last readings say that it holds; of as many, what was said last."""
        counts = Counter(self.holds)
        return max(reversed(self.holds), key=lambda hold: counts[hold])

    def expected_px(self, time_s: float) -> Array:
        """Where its region should be now."""
        centre: Array = self.reading.centre_px + self.speed_px_s * (time_s - self.seen_s)
        return centre

    def take(self, reading: Reading, time_s: float) -> None:
        """It was seen again."""
        step_s = time_s - self.seen_s
        self.speed_px_s = (reading.centre_px - self.reading.centre_px) / step_s
        self.acting = ACTING_KEEPS * self.acting + (1 - ACTING_KEEPS) * reading.acting
        self.left = ACTING_KEEPS * self.left + (1 - ACTING_KEEPS) * reading.left
        self.sure = SURE_KEEPS * self.sure + (1 - SURE_KEEPS) * reading.confidence
        self.holds.append(reading.held_part)
        self.reading, self.seen_s = reading, time_s

    def motion(self, palm_and_tips_m: Array, time_s: float) -> tuple[Point | None, Point | None]:
        """Velocity and acceleration of the hand, from palm and fingertips (2, 2), this frame among those that count."""
        self.places.append((time_s, palm_and_tips_m))
        return motion_of(self.places)


class HandTracks:
    """Follows the hands that a reader sees (HandTracker).

    Args:
        palm_length: what is known of the person's hand.
        new_confidence: of a hand that was not seen before; less begins no track.
        repeated: what is doubtful begins one, too, where it is read DOUBTFUL_N times within DOUBTFUL_S.
    """

    def __init__(
        self,
        bench: Bench,
        reader: HandReader,
        palm_length: PalmLength | None = None,
        new_confidence: float = NEW_CONFIDENCE,
        repeated: bool = False,
    ) -> None:
        self._setup, self._reader = bench.overhead, reader
        self._new_confidence, self._repeated = new_confidence, repeated
        self._preparing = reader if isinstance(reader, Preparing) else None
        self._palm_length = palm_length or PalmLength(0.0, 1.0)
        self._near_px = NEAR_SHARE * Regions.of(bench.overhead).side_px
        self._tracks: list[_Track] = []
        self._lost: list[_Track] = []
        self._doubts: list[tuple[float, Array]] = []
        self._works: _Track | None = None
        self._others: tuple[HandSample, ...] = ()
        self._doubtful: tuple[Reading, ...] = ()

    @property
    def doubtful(self) -> tuple[Reading, ...]:
        """What was read in the last frame, and is not believed to be a hand."""
        return self._doubtful

    @property
    def others(self) -> tuple[HandSample, ...]:
        """The hands of the last frame that do not work."""
        return self._others

    def prepare(self, image: Image) -> None:
        """Let the reader do what follows from the image alone."""
        if self._preparing is not None:
            self._preparing.prepare(image)

    def track(self, frame: Frame) -> HandSample | None:
        """The hand that works, or None where none is in view.

        Raises:
            DeviceFault: the image has not the size of the camera.
        """
        view, now_s = View.of(self._setup.model, frame), frame.time_s
        self._lose(now_s)
        readings = self._reader.read(frame.image, [track.expected_px(now_s) for track in self._tracks])
        self._assign(readings, now_s, RobotMask(frame, view, self._reader, self._near_px))
        seen = [track for track in self._tracks if track.seen_s == now_s]
        self._doubtful = tuple(reading for reading in readings if all(reading is not track.reading for track in seen))
        self._choose(seen)
        if self._works is not None and self._works.seen_s == now_s:
            # By it alone: another hand may be another person's, or lie flat, with a straight wrist: 2 % longer.
            learn_length(self._works.reading, view, self._palm_length)
        samples = {}
        for hand in seen:
            by_colour = heights_m(hand.reading, view, self._palm_length)
            heights = heights_by_depth(frame, view, hand.reading, by_colour)
            samples[id(hand)] = _sample(hand, view, frame, heights, by_depth=heights != by_colour)
        self._others = tuple(samples[id(track)] for track in seen if track is not self._works)
        return samples.get(id(self._works))

    def _lose(self, now_s: float) -> None:
        """Forget hands that were not seen for long; where they were is remembered longer."""
        kept = [track for track in self._tracks if 0 < now_s - track.seen_s <= LOST_S]
        self._lost += [track for track in self._tracks if track not in kept and track.away]
        self._lost = [track for track in self._lost if 0 < now_s - track.seen_s <= COMES_BACK_S]
        self._tracks = kept

    def _assign(self, readings: list[Reading], now_s: float, robot: RobotMask) -> None:
        """Give readings to tracks, so that all of them together move least; those that are left may begin tracks.

        What has been seen on the robot alone, and is explained by it, is no hand.
        """
        expected, centres = (
            [track.expected_px(now_s) for track in self._tracks],
            [reading.centre_px for reading in readings],
        )
        pairs = matched(expected, centres, self._near_px)
        for t, r in pairs:
            track = self._tracks[t]
            if track.away or not robot.explains(readings[r]):
                track.take(readings[r], now_s)
                track.away = track.away or not robot.under(readings[r])
        taken = {r for _, r in pairs}
        for reading in self._believed([reading for r, reading in enumerate(readings) if r not in taken], now_s):
            back = (_apart_px(track.reading.centre_px, reading.centre_px) < self._near_px for track in self._lost)
            away = not robot.under(reading) or any(back)
            if away or not robot.explains(reading):
                self._tracks.append(_Track.begun(reading, now_s, away))

    def _believed(self, left: Sequence[Reading], now_s: float) -> list[Reading]:
        """Those that begin tracks: sure ones, and doubtful ones that were read often enough at their place."""
        self._doubts = [(seen_s, at) for seen_s, at in self._doubts if 0 < now_s - seen_s <= DOUBTFUL_S]
        before = [{s for s, at in self._doubts if _apart_px(at, reading.centre_px) < self._near_px} for reading in left]
        if self._repeated:
            self._doubts += [(now_s, reading.centre_px) for reading in left]
        return [
            reading
            for reading, times_s in zip(left, before, strict=True)
            if reading.confidence >= self._new_confidence or len(times_s) >= DOUBTFUL_N - 1
        ]

    def _choose(self, seen: list[_Track]) -> None:
        """Which hand works: the one that did, unless another looks more like it by far.

        While that one is lost for a moment, hands that were in view beside it are not it. Later it is, of those that
        look alike, the one that is nearest to where a hand worked last.
        """
        works = self._works
        best = max(seen, key=lambda track: track.works, default=None)
        if best is not None and best.acting < 0.5:
            best = None
        if works is not None and any(track is works for track in seen):
            if best is None or best.works < works.works + TAKES_OVER:
                best = works if works.acting > STILL_WORKS else best
        elif works is not None:
            lost = any(track is works for track in self._tracks)
            least = 0.0 if best is None else best.works - TAKES_OVER
            alike = [track for track in seen if track.works > least and track.acting >= 0.5]
            alike = [track for track in alike if not lost or track.begun_s > works.seen_s]
            best = min(
                alike, key=lambda track: _apart_px(track.reading.centre_px, works.reading.centre_px), default=works
            )
        self._works = best


def _sample(track: _Track, view: View, frame: Frame, heights: tuple[float, float], *, by_depth: bool) -> HandSample:
    """A hand in the world, by the heights of palm and fingertips."""
    reading = track.reading
    world: dict[str, Array] = {}
    for at_palm, height_m in zip((True, False), heights, strict=True):
        names = [name for name in reading.points_px if (name in OF_PALM) == at_palm]
        flat = view.on_plane(np.array([reading.points_px[name] for name in names]), height_m)
        world |= {name: np.array([*point, height_m]) for name, point in zip(names, flat, strict=True)}
    smooth = _smoothed(track, world, frame.time_s)
    back = smooth["wrist"][:2] - smooth["palm"][:2]
    velocity, acceleration = track.motion(np.array([smooth["palm"][:2], smooth["pinch"][:2]]), frame.time_s)
    height, width = frame.image.shape[:2]
    return HandSample(
        time_s=frame.time_s,
        box_px=_clipped(reading.box_px, width, height),
        fingertips_m=_xy(smooth["pinch"]),
        palm_m=_xy(smooth["palm"]),
        held_part=track.held_part,
        velocity_m_s=velocity,
        acceleration_m_s2=acceleration,
        height_m=float(smooth["palm"][2]),
        fingertips_height_m=float(smooth["pinch"][2]),
        side="left" if track.left > 0.5 else "right",
        thumb_m=_xy(smooth["thumb"]),
        index_m=_xy(smooth["index"]),
        held_m=_xy(smooth["held"]) if "held" in smooth else None,
        forearm_rad=math.atan2(back[1], back[0]),
        confidence=reading.confidence,
        deviation_m=deviation_m(reading, frame.image, view, ERROR_M if by_depth else None),
    )


def matched(expected_px: Sequence[Array], found_px: Sequence[Array], within_px: float) -> list[tuple[int, int]]:
    """Pairs of numbers of what belongs together (Kuhn 1955): of the least sum of distances, all below `within_px`."""
    if not len(expected_px) or not len(found_px):
        return []
    apart_px = np.linalg.norm(np.array(expected_px)[:, np.newaxis] - np.array(found_px), axis=2)
    pairs = zip(*linear_sum_assignment(np.minimum(apart_px, within_px)), strict=True)
    return [(int(t), int(r)) for t, r in pairs if apart_px[t, r] < within_px]


def _apart_px(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other))


def _smoothed(track: _Track, world: Mapping[str, Array], time_s: float) -> dict[str, Array]:
    """Points (3,) by name, smoothed over the frames in which they were seen."""
    step_s, track.smoothed_s = time_s - track.smoothed_s, time_s
    track.smooth = {name: track.smooth.get(name, _Smooth(point)) for name, point in world.items()}
    return {name: smooth.update(world[name], step_s) for name, smooth in track.smooth.items()}


def _clipped(box: tuple[float, float, float, float], width: int, height: int) -> tuple[int, int, int, int]:
    left, top = (min(max(math.floor(value), 0), most - 1) for value, most in zip(box[:2], (width, height), strict=True))
    right, bottom = (math.ceil(value) for value in box[2:])
    return left, top, min(max(right, left + 1), width), min(max(bottom, top + 1), height)


def _xy(point: Array) -> Point:
    return float(point[0]), float(point[1])
