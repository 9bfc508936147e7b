"""MP4 files of drawn frames."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import cv2

from cell.interfaces.errors import InputError


class Video:
    """An MP4 file that is written frame by frame; all frames have the size of the first one.

    The encoder says nothing of a frame of another size, nor of a disk that is full: here both are told.

    Args:
        path: the file; its folder is made.
        rate_hz: of its frames.
        name: what it will be called, for messages.
    """

    def __init__(self, path: Path, rate_hz: float, name: Path | None = None) -> None:
        self._path, self._rate_hz, self._name = path, rate_hz, name or path
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self._frames = 0

    def add(self, bgr: Any) -> None:
        """One more frame.

        Raises:
            InputError: the file cannot be written, or the frame has another size.
        """
        size = (bgr.shape[1], bgr.shape[0])
        if self._writer is None:
            self._size, self._writer = size, self._opened(size)
        if size != self._size:
            raise InputError(f"{self._name}: frames of several sizes do not go into one video; name a folder")
        self._writer.write(bgr)
        self._frames += 1

    def _opened(self, size: tuple[int, int]) -> cv2.VideoWriter:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        writer = cv2.VideoWriter(str(self._path), cv2.VideoWriter.fourcc(*"mp4v"), self._rate_hz, size)
        if not writer.isOpened():
            raise InputError(f"{self._name}: the video cannot be written: {self._obstacle()}")
        return writer

    def _obstacle(self) -> str:
        """Why there is no file, which the encoder does not say."""
        folder = self._path.parent
        try:
            with TemporaryFile(dir=folder):
                return "its name must end in .mp4"
        except OSError as error:
            return f"no file can be made in {folder}: {error.strerror or error}"

    def close(self) -> int:
        """How many frames there are; 0 where there is no file.

        Raises:
            InputError: the file does not hold them; it is gone.
        """
        if self._writer is None:
            return 0
        self._writer.release()
        there = cv2.VideoCapture(str(self._path))
        held = int(there.get(cv2.CAP_PROP_FRAME_COUNT)) if there.isOpened() else 0
        there.release()
        if held < self._frames:
            self.discard()
            raise InputError(f"{self._name}: the video cannot be written whole; is the disk full?")
        return self._frames

    def discard(self) -> None:
        """Leave no piece of it."""
        if self._writer is not None:
            self._writer.release()
            self._path.unlink(missing_ok=True)
            self._writer = None
