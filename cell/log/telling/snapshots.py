"""The pictures that a tree's TakeSnapshot marked, as files (`cell log snapshots`)."""

from __future__ import annotations

import re
from pathlib import Path

from cell.interfaces.errors import InputError
from cell.log.reading.frames import Frames
from cell.log.reading.reader import Log


def save_snapshots(log: Log, folder: Path) -> list[Path]:
    """Write each marked picture as NUMBER-CAMERA-LABEL.jpg, numbered as they were taken.

    Raises:
        InputError: a file cannot be written.
    """
    frames, paths = Frames(log), []
    marks = [fields for tick in log.ticks for kind, fields in tick.notes if kind == "snapshot"]
    for number, mark in enumerate(marks, 1):
        frame = frames.at(mark["camera"], mark["taken_s"]) if "taken_s" in mark else None
        if frame is None:
            continue  # the log is older, was kept without pictures, or lost them
        label = re.sub(r"\W+", "-", mark["label"]).strip("-")
        paths.append(folder / f"{'-'.join(filter(None, (f'{number:02d}', mark['camera'], label)))}.jpg")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            paths[-1].write_bytes(frame.jpeg)
        except OSError as error:
            raise InputError(f"{paths[-1]}: cannot be written: {error.strerror or error}") from None
    return paths
