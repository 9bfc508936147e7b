"""Crops from a log's camera frames: hands and parts, as PNG files with what the detectors said of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.errors import LogError
from cell.interfaces.perception import BenchView, PartsView
from cell.log.reading.frames import Frames
from cell.log.reading.reader import Log
from cell.log.training.segments import carried_parts
from cell.recording.schemas import plain

HAND_STRIDE_FRAMES = 5  # three crops a second at 15 FPS
FOLDER = "crops"

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
        file = f"{FOLDER}/{self._name}-{camera}{sequence:06d}-{what}.png"
        (self._folder / FOLDER).mkdir(parents=True, exist_ok=True)
        (self._folder / file).write_bytes(cv2.imencode(".png", crop)[1].tobytes())
        return file
