"""Crops from a log's camera frames as PNG files: hands and parts, and what action detectors see of the hand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import Bench
from cell.interfaces.errors import LogError
from cell.interfaces.hand_window import TIPS_HEIGHT_M, hand_window, last_at_hole, window_px
from cell.interfaces.perception import BenchView, PartsView
from cell.interfaces.pose import Array
from cell.log.reading.frames import Frames
from cell.log.reading.reader import Log
from cell.log.training.segments import LoggedSegment, carried_parts
from cell.recording.schemas import plain

HAND_STRIDE_FRAMES = 5  # three crops a second at 15 FPS
FOLDER, WINDOWS = "crops", "windows"

Image = NDArray[np.uint8]


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
        if frame is None:
            return None
        image = cv2.imdecode(np.frombuffer(frame.jpeg, np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise LogError(self._log.path, f"the image of camera {camera} at {time_s:.3f} s cannot be decoded")
        return np.asarray(image, np.uint8)

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
