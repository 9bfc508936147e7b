"""Camera frames as JPEG, made and encoded beside the tick: OpenCV lets go of the interpreter meanwhile."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor

import cv2

from cell.interfaces.errors import DeviceFault
from cell.interfaces.perception import Frame

Encoding = tuple[Frame, Future[bytes | None]]

CALLS_LATER = 3  # ticks of 40 ms: a simulated frame may be rendered as late as its answer is due
MOST_WAITING = 45  # frames that wait for an encoder which does not keep up: three seconds of one camera


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

    def take(self) -> list[tuple[Frame, bytes]]:
        """Frames that are due, with their JPEG files."""
        taken = []
        while self._waiting and self._due(*self._waiting[0]):
            taken.append(self._waiting.popleft()[1])
        self._calls += 1
        return self._encoded(taken)

    def take_all(self) -> list[tuple[Frame, bytes]]:
        """All that is left, however long it takes."""
        left = [encoding for _, encoding in self._waiting]
        self._waiting.clear()
        return self._encoded(left)

    def _due(self, call: int, encoding: Encoding) -> bool:
        return self._calls >= call if self._in_step else encoding[1].done()

    def _encoded(self, taken: list[Encoding]) -> list[tuple[Frame, bytes]]:
        ready = [(frame, encoded.result()) for frame, encoded in taken]
        self.failed += sum(jpeg is None for _, jpeg in ready)
        return [(frame, jpeg) for frame, jpeg in ready if jpeg is not None]

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
