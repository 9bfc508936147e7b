"""Work on images that is done before anybody asks, where there is time for it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Answer = TypeVar("Answer")
Image = NDArray[np.uint8]
KEPT = 4  # frames between the one that is drawn and the one that is asked about


class Prefetch(Generic[Answer]):
    """What follows from an image alone: the same answer whether it was prepared or not.

    Args:
        work: the same image has the same answer.
    """

    def __init__(self, work: Callable[[Image], Answer]) -> None:
        self._work = work
        self._known: deque[tuple[Image, Answer]] = deque(maxlen=KEPT)

    def prepare(self, image: Image) -> None:
        """Do the work for an image that will likely be asked about."""
        self._known.append((image, self._work(image)))

    def __call__(self, image: Image) -> Answer:
        """The answer for an image; it is worked out where this very image was not prepared."""
        for known, answer in self._known:
            if known is image:
                return answer
        return self._work(image)
