"""Whether overhead images are as new as their stamps: where the robot moved, by its joints, the image must change.

Since an earlier frame the robot's outline has come to some places and gone from others. A live image has changed there,
or inside the outline, which is wider than the robot; a frozen one has not, whatever noise is added to it; one that is
late changes where no outline is any more.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.frame import Frame

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class DueChangeLimits:
    """Limits of `DueChange`. Origin: simulated assemblies of all looks; live images change in .10 of what is due.

    Attributes:
        step_s: [s] between the images that are compared.
        slack_s: [s] by which images are late in a sound cell at most: .04 s behind the twins' wires, and a frame more.
        lags_s: [s] by which images may be late otherwise.
        levels: [grey levels] by which the mean of 3 x 3 small pixels changes that show something else.
        least_px: [small pixels] in which change is due, from which it is looked for.
        least_apart_px: [small pixels] likewise, to which the robot has come, or from which it went the lag before.
        unseen: share of these, and of all that is inside the outlines, that changes at most, where the image does not
            show what is due.
        seen: share of these that change at least, where it does.
        here_share: what changes at most where the robot is, of the share that changes where it was, in a late image. At
            a half, images one frame late counted as late in 5 of 6 starts of one assembly, at a third in none.
        frames: [frames] in a row with change due that do not show it.
    """

    step_s: float = 0.2
    slack_s: float = 0.14
    lags_s: tuple[float, ...] = (0.2, 0.3, 0.5, 0.8)
    levels: float = 6.0
    least_px: int = 100
    least_apart_px: int = 40
    unseen: float = 0.06
    seen: float = 0.15
    here_share: float = 1 / 3
    frames: int = 4


@dataclass(frozen=True, eq=False)
class _Shown:
    """A frame's small image, smoothed, and where the robot's outline is."""

    time_s: float
    smooth: NDArray[np.float32]
    outline: Mask


class DueChange:
    """Looks at small overhead images in their order.

    Args:
        visible: small pixels that no obstacle hides.

    Attributes:
        late: how late images were found to be, in words; once they were, nobody knows from then on.
        stuck: that an image does not change where it should, in words; until it does.
    """

    def __init__(self, visible: Mask, limits: DueChangeLimits = DueChangeLimits()) -> None:
        self._limits = limits
        rows, columns = (size // 2 for size in visible.shape)
        halves = [(slice(0, rows), slice(rows, None)), (slice(0, columns), slice(columns, None))]
        self._regions = [visible, *(_within(visible, *part) for part in ((a, b) for a in halves[0] for b in halves[1]))]
        self._shown: deque[_Shown] = deque()
        self._unseen = [0] * len(self._regions)  # frames in a row
        self._owed = [np.zeros_like(visible) for _ in self._regions]  # where they should have changed
        self._behind = dict.fromkeys(limits.lags_s, 0)  # frames in a row
        self.late = self.stuck = ""

    def see(self, frame: Frame, small: NDArray[np.uint8], robot: NDArray[np.uint8]) -> None:
        """One more frame.

        Args:
            robot: 1 where the robot's outline is at the frame's stamp, of the small image's shape.
        """
        if frame.robot_m is None:
            self._shown.clear()
            return
        now = _Shown(frame.time_s, cv2.blur(small, (3, 3)).astype(np.float32), robot.astype(bool))
        self._shown.append(now)
        while now.time_s - self._shown[0].time_s > self._limits.step_s + 1.5 * max(self._limits.lags_s):
            self._shown.popleft()
        before = self._at(now.time_s - self._limits.step_s)
        if before is None:
            return
        changed, came, went = self._changed(before, now), now.outline & ~before.outline, before.outline & ~now.outline
        since = self._changed(self._shown[-2], now)
        for number, region in enumerate(self._regions):
            both = min(np.count_nonzero(came & region), np.count_nonzero(went & region)) >= self._limits.least_apart_px
            due = (came | went) & region & (both or number == 0)  # a half may hold no more than an empty edge of a box
            self._count(number, due, changed, since, (now.outline | before.outline) & region)
        for lag_s in self._behind:
            self._compare(lag_s, before, changed)
        self.stuck = "not changing where the robot moves" if max(self._unseen) >= self._limits.frames else ""

    def _at(self, time_s: float) -> _Shown | None:
        return next((shown for shown in reversed(self._shown) if shown.time_s <= time_s + 1e-3), None)

    def _changed(self, before: _Shown, now: _Shown) -> Mask:
        gain = float(np.median((now.smooth[::5, ::5, 1] + 1) / (before.smooth[::5, ::5, 1] + 1)))
        return np.asarray(cv2.absdiff(now.smooth, gain * before.smooth).max(axis=2) > self._limits.levels)

    def _count(self, number: int, due: Mask, changed: Mask, since: Mask, inside: Mask) -> None:
        """Whether a region shows what is due; what was owed may come later, when the camera goes on."""
        limits, owed = self._limits, self._owed[number]
        if np.count_nonzero(due) >= limits.least_px:
            unseen = max(changed[due].mean(), changed[inside].mean()) < limits.unseen
            self._unseen[number] = self._unseen[number] + 1 if unseen else 0
            self._owed[number] = owed | due if unseen else np.zeros_like(owed)
        elif self._unseen[number] and since[owed].mean() >= limits.seen:
            self._unseen[number] = 0

    def _compare(self, lag_s: float, last: _Shown, changed: Mask) -> None:
        """Whether the image shows since the last one what the robot did a time before, in places that it left by then.

        Where the outline is wider than the robot, what is ahead changes late in a live image, what is behind too early.
        """
        limits, now_s = self._limits, self._shown[-1].time_s
        then, before = self._at(now_s - lag_s), self._at(now_s - lag_s - limits.step_s)
        if then is None or before is None or self.late:
            return
        outlines = [shown.outline for shown in (self._shown[-1], last, then, before)]
        since = [shown.outline for shown in self._shown if shown.time_s > now_s - limits.step_s - limits.slack_s]
        here, there = _alone(outlines[0], outlines[1:]), _alone(outlines[3], [then.outline, *since])
        here, there = here & self._regions[0], there & self._regions[0]
        if min(np.count_nonzero(here), np.count_nonzero(there)) < limits.least_apart_px:
            return
        share = float(changed[there].mean())
        late = share >= limits.seen and changed[here].mean() < limits.here_share * share
        self._behind[lag_s] = self._behind[lag_s] + 1 if late else 0
        if self._behind[lag_s] >= limits.frames:
            self.late = f"the image is late: the arm is seen where it was about {lag_s:g} s before"


def _alone(outline: Mask, others: list[Mask]) -> Mask:
    """Where the robot is in this outline and in no other."""
    alone: Mask = outline & ~np.logical_or.reduce(others)
    return alone


def _within(visible: Mask, rows: slice, columns: slice) -> Mask:
    mask = np.zeros_like(visible)
    mask[rows, columns] = visible[rows, columns]
    return mask
