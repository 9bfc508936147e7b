"""Camera frames as JPEG and PNG, made and encoded beside the tick: OpenCV lets go of the interpreter meanwhile."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import cv2

from bracket_ground.errors import DeviceFault, InputError, words_of
from bracket_ground.interfaces.frame import Frame

Files = tuple[bytes, bytes]  # a JPEG of the image and a PNG of the depth, empty where there is none
Encoding = tuple[Frame, Future[Files | None]]
CALLS_LATER = 3  # ticks of 40 ms: a simulated frame may be rendered as late as its answer is due
MOST_WAITING = 45  # frames that wait for an encoder which does not keep up: three seconds of one camera


class Video:
    """An MP4 file that is written frame by frame; all frames have the size of the first one.

    The encoder says nothing of a frame of another size, nor of a full disk: here both are reported.

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
        problem, folder = f"{self._name}: the video cannot be written", self._path.parent
        if self._path.suffix != ".mp4":  # the encoder takes others for patterns of images
            raise InputError(f"{problem}: its name must end in .mp4")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=folder):  # the encoder does not say why it makes no file
                return cv2.VideoWriter(str(self._path), cv2.VideoWriter.fourcc(*"mp4v"), self._rate_hz, size)
        except OSError as error:
            raise InputError(f"{problem}: no file can be made in {folder}: {words_of(error)}") from None

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
            raise InputError(f"{self._name}: the video cannot be written completely; is the disk full?")
        return self._frames

    def discard(self) -> None:
        """Leave no piece of it."""
        if self._writer is not None:
            self._writer.release()
            self._path.unlink(missing_ok=True)
            self._writer = None


class ImageEncoder:
    """Encodes frames in a thread and gives them back in their order, some calls later than they came.

    In step with a simulation, a frame comes back CALLS_LATER calls after it came, and who takes it waits: time stands
    meanwhile, and the same run makes the same file. Else nobody waits: a frame that is not ready comes later.

    Attributes:
        failed: frames whose image could not be made, or which the encoder had no time for.
    """

    def __init__(self, quality: int, in_step: bool = True) -> None:
        self.failed = 0
        self._in_step = in_step
        self._options = (cv2.IMWRITE_JPEG_QUALITY, quality)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="log images")
        self._waiting: deque[tuple[int, Encoding]] = deque()  # and the number of the call that takes it
        self._calls = 0

    def submit(self, frame: Frame) -> None:
        """Begin to encode a frame, whose image nobody changes any more."""
        if not self._in_step and len(self._waiting) >= MOST_WAITING:
            self.failed += 1
            return
        encoding = frame, self._thread.submit(self._encode, frame)
        self._waiting.append((self._calls + CALLS_LATER, encoding))

    def take(self) -> list[tuple[Frame, Files]]:
        """Frames that are due, with their files."""
        taken = []
        while self._waiting and self._due(*self._waiting[0]):
            taken.append(self._waiting.popleft()[1])
        self._calls += 1
        return self._encoded(taken)

    def take_all(self) -> list[tuple[Frame, Files]]:
        """All that is left, however long it takes."""
        left = [encoding for _, encoding in self._waiting]
        self._waiting.clear()
        return self._encoded(left)

    def _due(self, call: int, encoding: Encoding) -> bool:
        return self._calls >= call if self._in_step else encoding[1].done()

    def _encoded(self, taken: list[Encoding]) -> list[tuple[Frame, Files]]:
        ready = [(frame, encoded.result()) for frame, encoded in taken]
        self.failed += sum(files is None for _, files in ready)
        return [(frame, files) for frame, files in ready if files is not None]

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(cancel_futures=True)

    def _encode(self, frame: Frame) -> Files | None:
        try:
            image, depth_mm = frame.image, frame.depth_mm
        except DeviceFault:  # who drives the cell is told by the camera
            return None
        _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), self._options)
        if depth_mm is None:
            return jpeg.tobytes(), b""
        _, png = cv2.imencode(".png", depth_mm, (cv2.IMWRITE_PNG_COMPRESSION, 1))
        return jpeg.tobytes(), png.tobytes()
