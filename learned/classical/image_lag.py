"""Whether overhead images are as new as their stamps say: the robot must be seen moving where it was at the stamp.

Where the robot's outline has come since an earlier frame the image changes, and where it has gone from it is still. A
camera that tells old images with new stamps, as one that is read through a buffer, shows it the other way round.
"""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.frame import Frame

LAGS_S = (0.2, 0.3, 0.5, 0.8)  # between the frames whose outlines are compared
KEPT_S = 1.0
LEVELS = 10  # a pixel that differs by more from the frame before has changed
LEAST_PX = 120  # of the small image, that the outline must have come to, and gone from
MOVING = 0.15  # share of changed pixels where the robot is seen to move
STILL = 0.06  # mean share where it is not
FRAMES = 8  # in a row that must say so
Mask = NDArray[np.uint8]


class ImageLag:
    """Looks at small overhead images in their order.

    Attributes:
        late: how late images were found to be, in words; once they were, nobody knows from then on.
    """

    def __init__(self) -> None:
        self._before: NDArray[np.uint8] | None = None
        self._outlines: deque[tuple[float, NDArray[np.bool_]]] = deque()
        self._shares: dict[float, deque[tuple[float, float]]] = {lag: deque(maxlen=FRAMES) for lag in LAGS_S}
        self.late = ""

    def see(self, frame: Frame, small: NDArray[np.uint8], robot: Mask) -> None:
        """One more frame.

        Args:
            robot: 1 where the robot's outline is at the frame's stamp, of the small image's shape.
        """
        before, self._before = self._before, small
        outline = robot.astype(bool)
        while self._outlines and frame.time_s - self._outlines[0][0] > KEPT_S:
            self._outlines.popleft()
        if before is not None and not self.late and frame.robot_m is not None:
            changed = cv2.absdiff(small, before).max(axis=2) > LEVELS
            for lag_s, shares in self._shares.items():
                self._compare(changed, outline, frame.time_s - lag_s, shares)
            self.late = self._told()
        self._outlines.append((frame.time_s, outline))

    def _compare(
        self, changed: NDArray[np.bool_], outline: NDArray[np.bool_], then_s: float, shares: deque[tuple[float, float]]
    ) -> None:
        """Share of changed pixels where the robot has come to since a time, and where it has gone from."""
        earlier = next((one for time_s, one in reversed(self._outlines) if time_s <= then_s + 1e-6), None)
        if earlier is None:
            return
        come, gone = outline & ~earlier, earlier & ~outline
        if min(np.count_nonzero(come), np.count_nonzero(gone)) < LEAST_PX:
            return
        now, then = float(changed[come].mean()), float(changed[gone].mean())
        if max(now, then) >= MOVING:
            shares.append((now, then))

    def _told(self) -> str:
        for lag_s, shares in self._shares.items():
            here = [now for now, _ in shares]
            if len(shares) == FRAMES and np.mean(here) < STILL and min(then for _, then in shares) >= MOVING:
                return f"the image is late: the arm is seen where it was about {lag_s:g} s before"
        return ""
