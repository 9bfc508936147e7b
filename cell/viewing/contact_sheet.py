"""Contact sheet of a run: one picture of its key frames with captions."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from cell.interfaces.errors import DeviceFault
from cell.interfaces.observation import Image
from cell.interfaces.perception import BenchView, Frame
from cell.observer import Level, Outcome, TickRecord

COLUMNS = 5
MOST_FRAMES = 30
THUMBNAIL_PX = (320, 240)
CAPTION_PX = 34
CAPTION_LETTERS = 50
RECENT_FRAMES = 30  # two seconds: no answer is older
BOX_RGB = (255, 220, 0)


@dataclass(frozen=True)
class Shot:
    """One picture of the sheet."""

    image: Image
    time_s: float
    caption: str


class ContactSheet:
    """A observer that keeps the frames of placements, screws, looks into the tray, calls for help and the end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._shots: list[Shot] = []
        self._first: Frame | None = None
        self._frames: dict[str, Frame] = {}
        self._recent: deque[Frame] = deque(maxlen=RECENT_FRAMES)
        self._action = ""
        self._parts = -1

    def frame(self, frame: Frame) -> None:
        self._first = self._first or frame
        self._frames[frame.camera] = frame
        self._recent.append(frame)

    def tick(self, record: TickRecord) -> None:
        view, parts = record.observation.bench, record.observation.parts
        wrist = self._frames.get("wrist")
        overhead = self._answered(view) or self._frames.get("overhead")
        if wrist is not None and parts is not None and parts.sequence != self._parts:
            self._parts = parts.sequence
            seen = " ".join(sorted(part.part for part in parts.detections)) or "nothing"
            self._take(wrist, f"tray: {seen}", [part.box_px for part in parts.detections])
        if overhead is None:
            return
        boxes = [view.hand.box_px] if view is not None and view.hand is not None else []
        action = view.action.kind if view is not None else ""
        if action == "screw" != self._action:
            self._take(overhead, "person: screw", boxes)
        self._action = action
        for topic, fields in record.notes:
            if caption := _caption(topic, fields):
                self._take(overhead, caption, boxes)

    def message(self, time_s: float, level: Level, text: str) -> None:
        """Messages are not shown."""

    def close(self, outcome: Outcome) -> None:
        last = self._frames.get("overhead")
        if last is not None:
            self._take(last, f"end: {outcome.reason}")
        if self._first is not None:  # only now: the first image takes a while
            self._take(self._first, "begin")
            self._shots.sort(key=lambda shot: shot.time_s)
        if self._shots:
            sheet = compose(self._shots)
            self.path.write_bytes(cv2.imencode(".png", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))[1].tobytes())

    def _answered(self, view: BenchView | None) -> Frame | None:
        """The frame that a view answers, so that hand and box are of the same moment."""
        if view is None:
            return None
        wanted = ("overhead", view.sequence)
        return next((frame for frame in self._recent if (frame.camera, frame.sequence) == wanted), None)

    def _take(self, frame: Frame, caption: str, boxes: list[tuple[int, int, int, int]] | None = None) -> None:
        if self._shots and self._shots[-1].caption == caption:
            return
        try:
            image = frame.image.copy()
        except DeviceFault:  # it could not be made: the sheet goes without
            return
        for left, top, right, bottom in boxes or []:
            cv2.rectangle(image, (left, top), (right, bottom), BOX_RGB, 2)
        small = cv2.resize(image, THUMBNAIL_PX, interpolation=cv2.INTER_AREA)
        self._shots.append(Shot(np.asarray(small, dtype=np.uint8), frame.time_s, caption))


def compose(shots: list[Shot]) -> Image:
    """The sheet; of too many shots every so manieth is shown, first and last always."""
    if len(shots) > MOST_FRAMES:
        shots = [shots[round(i)] for i in np.linspace(0, len(shots) - 1, MOST_FRAMES)]
    width_px, height_px = THUMBNAIL_PX
    columns = min(COLUMNS, len(shots))
    rows = math.ceil(len(shots) / columns)
    cell_px = height_px + CAPTION_PX
    sheet: Image = np.full((rows * cell_px, columns * width_px, 3), 255, np.uint8)
    for i, shot in enumerate(shots):
        top, left = i // columns * cell_px, i % columns * width_px
        sheet[top : top + height_px, left : left + width_px] = shot.image
        text = f"{shot.time_s:.1f} s  {shot.caption}"[:CAPTION_LETTERS]
        origin = (left + 6, top + height_px + 22)
        cv2.putText(sheet, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.42, (20, 20, 20), 1, cv2.LINE_AA)
    return sheet


def _caption(topic: str, fields: Mapping[str, object]) -> str:
    """What a note means in a picture, or nothing."""
    if topic == "belief" and "edge" in fields:
        edge = fields["edge"]
        return f"graph: {' at '.join(map(str, edge)) if isinstance(edge, list | tuple) else edge}"
    if topic == "skill" and fields.get("status") in ("success", "failure"):
        return f"{fields.get('node')}: {fields.get('reason')}"
    if topic == "help":
        return f"help: {fields.get('text')}"
    return ""
