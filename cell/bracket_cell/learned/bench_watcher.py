"""Turns the stream of overhead frames into bench views: hand, holes, action, whichever detectors find them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

from bracket_cell.learned.calibration.check import CalibrationCheck
from bracket_cell.learned.classical.action_detector import ClassicalActionDetector
from bracket_cell.learned.classical.box_model import check_image
from bracket_cell.learned.classical.colour import ColourModel
from bracket_cell.learned.classical.hand_tracker import ClassicalHandTracker
from bracket_cell.learned.classical.hole_reader import ClassicalHoleReader, PlaceReader
from bracket_cell.learned.classical.image_health import ImageHealth
from bracket_cell.learned.classical.part_detector import ClassicalPartDetector
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_cell.learned.classical.track_health import TrackHealth
from bracket_cell.learned.hands.depth import DepthUnderHands
from bracket_cell.learned.inference.prefetch import Image
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import (
    SEGMENT_FRAMES,
    ActionDetector,
    BenchView,
    HandSample,
    HandTracker,
    HoleReader,
    HoleView,
    Preparing,
    Segment,
)
from bracket_ground.interfaces.product import Product


class DetectorChain:
    """Runs a tracker, a hole reader and an action detector on each frame."""

    def __init__(
        self,
        bench: Bench,
        product: Product,
        tracker: HandTracker,
        reader: HoleReader,
        detector: ActionDetector,
        spots: Callable[[Frame, HandSample | None], Mapping[str, HoleView]] = lambda *_: {},
    ) -> None:
        self._overhead = bench.overhead
        self._tracker, self._reader, self._detector = tracker, reader, detector
        self._spots = spots
        self._health = ImageHealth(bench, product)
        self._track, self._depth = TrackHealth(bench), DepthUnderHands(bench)
        self._calibration = CalibrationCheck(bench, product)
        self._frames: deque[Frame] = deque(maxlen=SEGMENT_FRAMES)
        self._hands: deque[HandSample | None] = deque(maxlen=SEGMENT_FRAMES)
        self._before: HandSample | None = None
        self._preparing = [detector for detector in (tracker, self._health, reader) if isinstance(detector, Preparing)]

    def prepare(self, image: Image) -> None:
        """Do what follows from an image alone, before it is asked about; answers stay the same."""
        for health in self._preparing:
            health.prepare(image)

    def __call__(self, frame: Frame) -> BenchView:
        return self.watch(frame)

    def watch(self, frame: Frame) -> BenchView:
        """The answer to this frame; frames must come in order. The camera is where its calibration says."""
        check_image(self._overhead.model, frame)
        frame = frame.seen_from(self._overhead.corrected(frame.world_from_camera))
        hand = self._tracker.track(frame)
        hands = [other for other in (hand, *self._tracker.others) if other is not None]
        health = self._health.judge(frame, hands)
        unknown = self._track.unknown(frame.time_s, hand)
        velocity, acceleration = self._track.motion
        hand = hand and replace(hand, velocity_m_s=velocity, acceleration_m_s2=acceleration)
        holes = self._reader.read(frame, hand)
        self._keep(frame, hand)
        action = self._detector.detect(Segment(tuple(self._frames), tuple(self._hands), self._before), holes)
        return BenchView(
            frame.sequence,
            frame.time_s,
            hand,
            holes,
            action,
            health,
            unknown,
            other_hands=self._tracker.others,
            left_by=self._track.left_by,
            calibration=self._calibration.judge(frame, hand),
            unseen=self._health.unseen,
            unexplained=self._health.unexplained,
            depth_missing=self._depth.judge(frame, hands),
            spots=self._spots(frame, hand),
        )

    def _keep(self, frame: Frame, hand: HandSample | None) -> None:
        """One frame more; no hand was seen in those that were lost before it, so that a segment spans its time."""
        if self._frames:
            last = self._frames[-1]
            for _ in range(min(frame.sequence - last.sequence - 1, SEGMENT_FRAMES)):
                self._push(last, None)
        self._push(frame, hand)

    def _push(self, frame: Frame, hand: HandSample | None) -> None:
        if len(self._hands) == SEGMENT_FRAMES:
            self._before = self._hands[0] or self._before
        self._frames.append(frame)
        self._hands.append(hand)


class ClassicalDetectors:
    """Makes the classical detectors of a bench, each when it is asked for.

    Where trained ones are chosen for everything, the product's colours may be any.
    """

    def __init__(self, bench: Bench, product: Product, settings: PerceptionSettings) -> None:
        self._bench, self._product, self._settings = bench, product, settings

    @cached_property
    def _colours(self) -> ColourModel:
        """Raises SettingError where the product's colours are too pale or too much alike."""
        return ColourModel(self._product, self._settings.skin_rgb)

    def hands(self) -> ClassicalHandTracker:
        """Finds the hand by its colour."""
        return ClassicalHandTracker(self._bench, self._product, self._settings, self._colours)

    def holes(self) -> ClassicalHoleReader:
        """Reads the holes by the parts' colours."""
        return ClassicalHoleReader(self._bench, self._product, self._settings, self._colours)

    def places(self) -> PlaceReader:
        """Reads the places that the camera sees."""
        return PlaceReader(self._bench, self._product, self._settings)

    def actions(self) -> ClassicalActionDetector:
        """Names actions by what changed in the holes."""
        return ClassicalActionDetector(self._bench, self._product, self._settings)

    def parts(self) -> ClassicalPartDetector:
        """Finds parts by their colours and outlines."""
        return ClassicalPartDetector(self._bench, self._product, self._settings)


class NoHoleReader:
    """Reads no holes, as in the paper's cell (HoleReader): the guard waits for ever, unless `guard.holes` is graph."""

    def read(self, frame: Frame, hand: HandSample | None) -> Mapping[str, HoleView]:
        del frame, hand
        return {}
