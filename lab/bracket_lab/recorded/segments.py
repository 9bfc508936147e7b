"""Crops from a log's camera frames as PNG files: hands and parts, and what action detectors see of the hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import Log
from bracket_cell.recording.schemas import plain
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.hand_window import TIPS_HEIGHT_M, hand_window, last_at_hole, window_px
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, Action, BenchView, HandSample, PartsView
from bracket_ground.interfaces.pose import Array

CARRY_S = 3.0  # a hand that has placed a part held it at most this long before: a segment's length
FLICKER_FRAMES = 3  # in a row in which the hand of a carry looks empty
STRIDE_FRAMES = 15  # one second at 15 FPS; a change of the action always ends a segment, too
HAND_STRIDE_FRAMES = 5  # three crops a second at 15 FPS
FOLDER, WINDOWS = "crops", "windows"
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class LoggedSegment:
    """Segment s of Algorithm 1 as it was seen.

    Attributes:
        views: (SEGMENT_FRAMES,) answers to frames that follow one another without a gap.
        before: the hand as it was last seen before them.
        confirmed: the placement that the holes showed later, as plain data; None where the log does not tell.
    """

    views: tuple[BenchView, ...]
    before: HandSample | None
    confirmed: dict[str, Any] | None

    def row(self, log: str, windows: Mapping[str, str | None]) -> dict[str, Any]:
        """As a line of segments.jsonl; `windows` are the files of `hand_crop` and `hole_crop`."""
        last = self.views[-1]
        return {
            "log": log,
            "frame": last.sequence,
            "begin_s": self.views[0].time_s,
            "end_s": last.time_s,
            "detected": plain(last.action),
            "confirmed": self.confirmed,
            **windows,
            "holes": {position: hole.part for position, hole in last.holes.items()},
            "hands": [plain(view.hand) for view in self.views],
            "hand_before": plain(self.before),
        }


def bench_views(log: Log) -> list[BenchView]:
    """Every answer of the bench watcher, once."""
    found: list[BenchView] = []
    for tick in log.ticks:
        view = tick.observation.bench
        if view is not None and (not found or view.sequence != found[-1].sequence):
            found.append(view)
    return found


def segments(views: Sequence[BenchView]) -> Iterator[LoggedSegment]:
    """One segment a second, and one at every change of the action; none across frames that were lost."""
    before: HandSample | None = None
    for end in range(SEGMENT_FRAMES, len(views) + 1):
        if end > SEGMENT_FRAMES:
            before = views[end - SEGMENT_FRAMES - 1].hand or before
        window = tuple(views[end - SEGMENT_FRAMES : end])
        if window[-1].sequence - window[0].sequence != SEGMENT_FRAMES - 1:
            continue
        changed = _named(window[-1].action) != _named(window[-2].action)
        if changed or (end - SEGMENT_FRAMES) % STRIDE_FRAMES == 0:
            yield LoggedSegment(window, before, confirmed(views, end - 1))


def confirmed(views: Sequence[BenchView], at: int) -> dict[str, Any] | None:
    """What the hole of a detected assembly held when it was next seen free of the hand.

    None where no assembly was detected, or where the hole was not seen again.
    """
    action, time_s = views[at].action, views[at].time_s
    if action.kind != "assembly" or action.position is None:
        return None
    for view in views[at:]:
        hole = view.holes.get(action.position)
        if hole is not None and hole.seen_s > time_s:
            agrees = hole.part == action.part
            return {"part": hole.part, "position": action.position, "seen_s": hole.seen_s, "agrees": agrees}
    return None


def carried_parts(views: Sequence[BenchView]) -> dict[int, str]:
    """By number of the frame, the part in the hand as its hole confirmed it afterwards.

    A carry goes back as far as something was seen in the hand, but for some frames.
    """
    found: dict[int, str] = {}
    for at, view in enumerate(views):
        if view.action.kind != "assembly" or (at and _named(views[at - 1].action) == _named(view.action)):
            continue
        truth = confirmed(views, at)
        if truth is None or truth["part"] is None:
            continue
        before = [earlier for earlier in views[:at] if earlier.time_s >= view.time_s - CARRY_S]
        holding = [earlier.hand is not None and earlier.hand.held_part is not None for earlier in before]
        last = len(holding) - 1 - holding[::-1].index(True) if True in holding else -1
        while last >= 0 and any(holding[max(0, last - FLICKER_FRAMES) : last + 1]):
            found[before[last].sequence] = truth["part"]
            last -= 1
    return found


def _named(action: Action) -> tuple[object, ...]:
    return action.kind, action.part, action.position, action.finished


class Cropper:
    """Cuts crops out of the frames of one log and writes them into a folder."""

    def __init__(self, log: Log, folder: Path, name: str) -> None:
        self._log, self._folder, self._name = log, folder, name
        self._frames = Frames(log)

    def hands(self, views: Sequence[BenchView], wanted: set[int]) -> Iterator[dict[str, Any]]:
        """A row for each crop of a hand: every fifth frame, and the frames with wanted numbers."""
        carried = carried_parts(views)
        for view in views:
            if view.hand is None or not (view.sequence in wanted or view.sequence % HAND_STRIDE_FRAMES == 0):
                continue
            file = self._save("overhead", view.sequence, view.time_s, view.hand.box_px, "hand")
            if file is not None:
                yield {
                    "file": file,
                    "kind": "hand",
                    "part": view.hand.held_part,
                    "confirmed": carried.get(view.sequence),
                    "log": self._name,
                    "camera": "overhead",
                    "frame": view.sequence,
                    **plain(view.hand),
                }

    def parts(self, view: PartsView, scene: int) -> Iterator[dict[str, Any]]:
        """A row for each part in the wrist camera's view; `scene` is the line's number in scenes.jsonl, from 1."""
        for number, part in enumerate(view.detections):
            file = self._save("wrist", view.sequence, view.time_s, part.box_px, f"part{number}")
            if file is not None:
                yield {
                    "file": file,
                    "kind": "part",
                    "scene": scene,
                    "number": number,
                    "log": self._name,
                    "camera": "wrist",
                    "frame": view.sequence,
                    "time_s": view.time_s,
                    **plain(part),
                }

    def windows(self, segment: LoggedSegment, bench: Bench, holes_m: Array) -> dict[str, str | None]:
        """Squares around the fingertips: of the last frame, and of when they were last at a hole; None where not seen.

        Args:
            holes_m: (positions, 2) on the bench.
        """
        tips = [(np.nan, np.nan) if view.hand is None else view.hand.fingertips_m for view in segment.views]
        at_hole = last_at_hole(np.array(tips), holes_m)
        at = {"hand_crop": segment.views[-1], "hole_crop": None if at_hole is None else segment.views[at_hole]}
        return {name: None if view is None else self._window(view, bench) for name, view in at.items()}

    def _window(self, view: BenchView, bench: Bench) -> str | None:
        hand, camera = view.hand, bench.overhead
        image = None if hand is None else self.image("overhead", view.time_s)
        if hand is None or image is None:
            return None
        height_m = TIPS_HEIGHT_M if hand.fingertips_height_m is None else hand.fingertips_height_m
        tips_px = camera.model.project(camera.mount.pose, np.array([[*hand.fingertips_m, height_m]]))[0]
        window = hand_window(image, (float(tips_px[0]), float(tips_px[1])), window_px(camera))
        return self._write(f"{WINDOWS}/{self._name}-{view.sequence:06d}.png", window)

    def image(self, camera: str, time_s: float) -> Image | None:
        """The frame that was taken at this very time; None where the log has none."""
        frame = self._frames.at(camera, time_s)
        return None if frame is None else frame.image()

    def _save(
        self, camera: str, sequence: int, time_s: float, box_px: tuple[int, int, int, int], what: str
    ) -> str | None:
        """Write a crop; returns its name in the folder, None where there is no image or the box is outside of it."""
        image = self.image(camera, time_s)
        if image is None:
            return None
        left, top, right, bottom = (max(0, side) for side in box_px)
        crop = image[top:bottom, left:right]
        if not crop.size:
            return None
        return self._write(f"{FOLDER}/{self._name}-{camera}{sequence:06d}-{what}.png", crop)

    def _write(self, file: str, image: Image) -> str:
        (self._folder / file).parent.mkdir(parents=True, exist_ok=True)
        (self._folder / file).write_bytes(cv2.imencode(".png", image)[1].tobytes())
        return file
