"""Camera frames as JPEG, made and encoded beside the tick: OpenCV lets go of the interpreter meanwhile."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor

import cv2

from cell.interfaces.errors import DeviceFault
from cell.interfaces.perception import Frame

Encoding = tuple[Frame, Future[bytes | None]]

CALLS_LATER = 3  # ticks of 40 ms: a simulated frame may be rendered as late as its answer is due


class ImageEncoder:
    """Encodes frames in a thread and gives them back in their order, some calls later than they came: nobody waits.

    Attributes:
        failed: frames whose image could not be made.
    """

    def __init__(self, quality: int) -> None:
        self.failed = 0
        self._options = (cv2.IMWRITE_JPEG_QUALITY, quality)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="log images")
        self._waiting: deque[list[Encoding]] = deque([[] for _ in range(CALLS_LATER + 1)])

    def submit(self, frame: Frame) -> None:
        """Begin to encode a frame, whose image nobody changes any more."""
        self._waiting[-1].append((frame, self._thread.submit(self._encode, frame)))

    def take(self) -> list[tuple[Frame, bytes]]:
        """Frames that had been submitted CALLS_LATER calls ago, with their JPEG files."""
        ready = [(frame, encoded.result()) for frame, encoded in self._waiting.popleft()]
        self._waiting.append([])
        self.failed += sum(jpeg is None for _, jpeg in ready)
        return [(frame, jpeg) for frame, jpeg in ready if jpeg is not None]

    def take_all(self) -> list[tuple[Frame, bytes]]:
        """All that is left."""
        return [taken for _ in range(CALLS_LATER + 1) for taken in self.take()]

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(cancel_futures=True)

    def _encode(self, frame: Frame) -> bytes | None:
        try:
            image = frame.image
        except DeviceFault:  # who drives the cell is told by the camera
            return None
        _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), self._options)
        return jpeg.tobytes()
