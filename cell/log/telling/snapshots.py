"""The pictures that a tree's TakeSnapshot marked, as files (`cell log snapshots`)."""

from __future__ import annotations

import re
from pathlib import Path

from cell.interfaces.files import write_new
from cell.log.reading.frames import Frames
from cell.log.reading.reader import Log


def save_snapshots(log: Log, folder: Path) -> list[Path]:
    """Write each marked picture as NUMBER-CAMERA-LABEL.jpg, numbered as they were taken.

    Raises:
        InputError: one of these files is there already, or cannot be written; none is left there then.
    """
    frames, pictures = Frames(log), {}
    marks = [fields for tick in log.ticks for kind, fields in tick.notes if kind == "snapshot"]
    for number, mark in enumerate(marks, 1):
        frame = frames.at(mark["camera"], mark["taken_s"]) if "taken_s" in mark else None
        if frame is None:
            continue  # the log is older, was kept without pictures, or lost them
        label = re.sub(r"\W+", "-", mark["label"]).strip("-")
        pictures[f"{'-'.join(filter(None, (f'{number:02d}', mark['camera'], label)))}.jpg"] = frame.jpeg
    write_new(folder, pictures)
    return [folder / name for name in pictures]
