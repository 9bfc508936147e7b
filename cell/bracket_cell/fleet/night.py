"""The runs of a folder that failed, on one HTML page: a row each, with the five seconds before as a small film."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2

from bracket_cell.log.read.frames import IMAGE, LoggedFrame, decoded
from bracket_cell.log.read.indexed import IndexedLog
from bracket_cell.log.report.html_page import rendered, write_page
from bracket_ground.errors import LogError

TEMPLATE = Path(__file__).with_name("night.html.j2")
BEFORE_S, EACH_S, WIDTH_PX = 5.0, 0.5, 240
OVERHEAD = "/camera/overhead"


def write_night(rows: Iterable[Mapping[str, Any]], path: Path) -> int:
    """Write the page; returns its size in bytes.

    Raises:
        InputError: it cannot be written.
    """
    runs = [{**row, "name": Path(row["log"]).name, "clip": clip(Path(row["log"]), row["failed_s"])} for row in rows]
    return write_page(rendered(TEMPLATE, rows=runs, before_s=BEFORE_S), path)


def clip(log: Path, until_s: float | None) -> str:
    """What the overhead camera saw before a time, as a data URI; empty where the log has no images of it."""
    if until_s is None:
        return ""
    frames, next_s = [], 0.0
    try:
        for message in IndexedLog(log).messages(max(0.0, until_s - BEFORE_S), until_s, (OVERHEAD,)):
            if message.time_ns / 1e9 >= next_s:
                next_s = message.time_ns / 1e9 + EACH_S
                image = LoggedFrame(log, OVERHEAD, next_s, decoded(log, message, IMAGE).data).image()
                frames.append(cv2.resize(image, (WIDTH_PX, max(1, WIDTH_PX * image.shape[0] // image.shape[1]))))
    except LogError:
        return ""  # the row says what is known of it
    if not frames:
        return ""
    film = cv2.Animation()
    film.frames, film.durations = frames, [round(1000 * EACH_S)] * len(frames)
    _, content = cv2.imencodeanimation(".webp", film)
    return "data:image/webp;base64," + base64.b64encode(content.tobytes()).decode()
