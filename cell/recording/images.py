"""Camera frames as JPEG, encoded beside the tick: OpenCV lets go of the interpreter meanwhile."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

import cv2

from cell.interfaces.perception import Frame

Encoding = tuple[Frame, Future[bytes]]


class ImageEncoder:
    """Encodes frames in a thread and gives them back in their order, one call later than they came: nobody waits."""

    def __init__(self, quality: int) -> None:
        self._options = (cv2.IMWRITE_JPEG_QUALITY, quality)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="log images")
        self._new: list[Encoding] = []
        self._older: list[Encoding] = []

    def submit(self, frame: Frame) -> None:
        """Begin to encode a frame, whose image nobody changes any more."""
        self._new.append((frame, self._thread.submit(self._encode, frame)))

    def take(self) -> list[tuple[Frame, bytes]]:
        """Frames that had been submitted before the last call, with their JPEG files."""
        ready, self._older, self._new = self._older, self._new, []
        return [(frame, encoded.result()) for frame, encoded in ready]

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(cancel_futures=True)

    def _encode(self, frame: Frame) -> bytes:
        _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR), self._options)
        return jpeg.tobytes()
