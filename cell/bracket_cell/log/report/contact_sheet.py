"""Contact sheet of a run: one picture of its key frames with captions, made from the log."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from bracket_cell.log.read.frames import CAMERA, IMAGE, LoggedFrame, decoded
from bracket_cell.log.read.indexed import IndexedLog
from bracket_cell.log.read.mcap_file import Message
from bracket_cell.viewing.moments import MOST_FRAMES, Boxes, Moments, spread
from bracket_ground.files.files import whole_or_none
from bracket_ground.interfaces.observation import Image

COLUMNS = 5
THUMBNAIL_PX = (320, 240)
CAPTION_PX = 34
CAPTION_LETTERS = 50
BOX_RGB = (255, 220, 0)


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture of the sheet."""

    image: Image
    time_s: float
    caption: str


def write_sheet(log: Path, moments: Moments, reason: str, path: Path) -> bool:
    """Make the sheet of a run from its log; false where the log has no images.

    Args:
        reason: why the run ended.

    Raises:
        LogError: the log cannot be read.
        OSError: the sheet cannot be written.
    """
    found = shots(IndexedLog(log), moments, reason)
    if not found:
        return False
    sheet = cv2.cvtColor(compose(found), cv2.COLOR_RGB2BGR)
    with whole_or_none(path) as partial:
        partial.write_bytes(cv2.imencode(".png", sheet)[1].tobytes())
    return True


def shots(log: IndexedLog, moments: Moments, reason: str) -> list[Shot]:
    """Pictures of begin, moments and end."""
    overhead = f"{CAMERA}overhead"
    first = next(log.messages(topics=(overhead,)), None)
    last = next(log.messages(topics=(overhead,), reverse=True), None)
    if first is None or last is None:
        return []
    chosen = [
        (log.newest(CAMERA + moment.camera, moment.time_s), moment.caption, moment.boxes_px)
        for moment in moments.chosen()
    ]
    chosen = [(first, "begin", ()), *chosen, (last, f"end: {reason}", ())]
    return [_shot(log.paths[0], message, caption, boxes) for message, caption, boxes in chosen if message is not None]


def _shot(path: Path, message: Message, caption: str, boxes: Boxes) -> Shot:
    camera, time_s = message.topic.removeprefix(CAMERA), message.time_ns / 1e9
    image = cv2.cvtColor(
        LoggedFrame(path, camera, time_s, decoded(path, message, IMAGE).data).image(), cv2.COLOR_BGR2RGB
    )
    for left, top, right, bottom in boxes:
        cv2.rectangle(image, (left, top), (right, bottom), BOX_RGB, 2)
    small = cv2.resize(image, THUMBNAIL_PX, interpolation=cv2.INTER_AREA)
    return Shot(np.asarray(small, dtype=np.uint8), time_s, caption)


def compose(shots: list[Shot]) -> Image:
    """The sheet; if there are too many shots, only every Nth is shown, and always the first and the last."""
    shots = spread(shots, MOST_FRAMES)
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
