"""Turns the stream of overhead frames into bench views: colours, hand, holes, action."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from cell.interfaces.bench import Bench
from cell.interfaces.perception import SEGMENT_FRAMES, BenchView, Frame, HandSample, Segment
from cell.interfaces.product import Product
from learned.classical.action_detector import ClassicalActionDetector
from learned.classical.colour import ColourModel
from learned.classical.hand_tracker import ClassicalHandTracker
from learned.classical.hole_reader import ClassicalHoleReader
from learned.classical.image_health import ImageHealth, TrackHealth
from learned.classical.settings import PerceptionSettings

NOWHERE = (0, 0, 0, 0)


class ClassicalBenchWatcher:
    """Labels the colours of each frame once and runs the three detectors on them (BenchWatcher)."""

    def __init__(self, bench: Bench, product: Product, settings: PerceptionSettings | None = None) -> None:
        settings = settings or PerceptionSettings()
        self._colours = ColourModel(product, settings.skin_rgb)
        self._tracker = ClassicalHandTracker(bench, product, settings, self._colours)
        self._reader = ClassicalHoleReader(bench, product, settings, self._colours)
        self._detector = ClassicalActionDetector(bench, product, settings)
        self._health = ImageHealth(bench, product)
        self._track = TrackHealth(bench.overhead.width_px, bench.overhead.height_px)
        self._frames: deque[Frame] = deque(maxlen=SEGMENT_FRAMES)
        self._hands: deque[HandSample | None] = deque(maxlen=SEGMENT_FRAMES)

    def watch(self, frame: Frame) -> BenchView:
        """The answer to this frame; frames must come in order."""
        labels = self._colours.label(frame.image)
        hand = self._tracker.track_labels(frame, labels)
        health = self._health.judge(frame)
        unknown = self._track.unknown(frame.time_s, hand.palm_m if hand else None, hand.box_px if hand else NOWHERE)
        hand = hand and replace(hand, velocity_m_s=self._track.velocity_m_s)
        holes = self._reader.read_labels(frame, labels, hand)
        self._frames.append(frame)
        self._hands.append(hand)
        action = self._detector.detect(Segment(tuple(self._frames), tuple(self._hands)), holes)
        return BenchView(frame.sequence, frame.time_s, hand, holes, action, health, unknown)
