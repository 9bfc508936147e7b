"""Whether an image carries the grain of an earlier one: a sensor's noise never comes twice, that of a copy does.

Grain is what is left of an image, where the scene stands, less its usual levels and less the mean of the pixels around.
Of two live images it is independent; of two copies of one image it correlates, whatever noise was added to them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

TILES = 6  # of an image, along both axes


@dataclass(frozen=True)
class GrainLimits:
    """Limits of `Grain`. Origin: simulated assemblies of all looks.

    Attributes:
        kept: [frames] whose grain is compared; an image that is older is not known again.
        follows: share by which usual levels follow an image in a frame: copies become usual with time.
        flat: [deviations of the noise] by which the mean of 5 x 5 samples may be off where the scene stands.
        outlier: [deviations of the noise] by which a sample may be off there.
        stands: [frames] for which it must have been so.
        faintest: [grey levels] deviation of the least noise that says anything: less is rounded away.
        learned: [frames] until the camera's usual correlation is known; where it smooths over time there is some.
        carried: correlation, as a share of what is left to 1 above the usual, from which a tile's grain came again.
        tiles: [tiles of TILES ** 2] that must carry the grain of the frame before, in two frames in a row.
        tiles_again: [tiles] that must carry the grain of one older frame.
        few: [frames] before, not most of which may be alike, too: that would be a change of the scene.
        lives: share of a tile's samples that change at once where something moves.
        moves: [grey levels] by which the mean of 5 x 5 samples changes there.
    """

    kept: int = 64
    follows: float = 1 / 32
    flat: float = 0.7
    outlier: float = 3.5
    stands: int = 8
    faintest: float = 1.4
    learned: int = 8
    carried: float = 0.2
    tiles: int = 5
    tiles_again: int = 8
    few: int = 16
    lives: float = 0.1
    moves: float = 6.0


class Grain:
    """Looks at sampled pixels of a camera's images in their order.

    Attributes:
        ago: how many frames ago, but for the frame before, an image had the same grain; 0 for never.
    """

    def __init__(self, limits: GrainLimits = GrainLimits()) -> None:
        self._limits = limits
        self._levels: NDArray[np.float32] = np.zeros((0, 0), np.float32)  # that are usual
        self._stood: NDArray[np.float32] = np.zeros((0, 0), np.float32)  # frames, by sample
        self._kept: NDArray[np.float32] = np.zeros((0, 0, 0), np.float32)  # (tiles, frames, samples)
        self._carried = self._stuck = np.zeros((TILES, TILES), np.uint8)  # tiles with the grain of the frame before
        self._seen = 0
        self._usual: list[float] = []
        self._sigmas: deque[float] = deque(maxlen=limits.kept)
        self.ago = 0

    @property
    def copies(self) -> bool:
        """Whether images are copies of one, at least in part: from then on until something moves there."""
        return bool(self._stuck.any())

    def see(self, samples: NDArray[np.uint8]) -> None:
        """One image more, of which the green channel is looked at."""
        level, limits = samples[..., 1].astype(np.float32) + 1, self._limits
        rows, columns = (size // TILES for size in level.shape)
        level = level[: rows * TILES, : columns * TILES]
        if not self._seen:
            self._levels, self._before, self._stood = level, level, np.zeros_like(level)
            self._kept = np.zeros((TILES**2, limits.kept, rows * columns), np.float32)
        grain = _normalised(_tiles(self._grain(level)))
        newest = self._seen % limits.kept
        alike = np.roll((self._kept @ grain[..., np.newaxis])[..., 0], -newest, axis=1)[:, ::-1]
        self._kept[:, newest] = grain
        self._seen += 1
        if len(self._usual) == limits.learned:
            self._judge(alike, level)
        elif self._seen > limits.stands + 1:
            self._usual.append(float(np.median(alike[:, 0])))
        self._before = level

    def _grain(self, level: NDArray[np.float32]) -> NDArray[np.float32]:
        """Of each sample; 0 where the scene does not stand."""
        limits, usual = self._limits, self._levels
        off = level * cv2.blur(usual, (9, 9)) / cv2.blur(level, (9, 9)) - usual
        sigma = max(0.5, 1.4826 * float(np.median(np.abs(off[::2, ::2]))))
        gain = float(np.median(level[::3, ::3] / usual[::3, ::3]))
        moved = np.abs(cv2.blur(level - gain * usual, (5, 5))) > limits.flat * sigma
        self._stood = np.where(moved | (np.abs(off) > limits.outlier * sigma), 0, self._stood + 1)
        self._levels = usual + np.maximum(limits.follows, 1 / (self._stood + 1)) * (level - usual)
        self._sigmas.append(sigma)
        tells = (self._stood >= limits.stands) & (float(np.median(self._sigmas)) >= limits.faintest)
        grain: NDArray[np.float32] = (off - cv2.blur(off, (3, 3))) * tells
        return grain

    def _judge(self, alike: NDArray[np.float32], level: NDArray[np.float32]) -> None:
        """Given how grain correlates with that of the frames before (tiles, frames), the newest first."""
        limits, usual = self._limits, float(np.median(self._usual))
        carried = alike > usual + limits.carried * (1 - usual)
        before, self._carried = self._carried, carried[:, 0].reshape(TILES, TILES).astype(np.uint8)
        again = carried[:, 1:].sum(axis=0)
        everywhere = (again[: limits.few] >= limits.tiles).mean() > 0.5  # the scene has changed
        self.ago = int(again.argmax()) + 2 if again.max() >= limits.tiles_again and not everywhere else 0
        changed = np.abs(cv2.blur(level / level.mean() - self._before / self._before.mean(), (5, 5))) * level.mean()
        moves = _tiles((changed > limits.moves).astype(np.float32)).mean(axis=1).reshape(TILES, TILES) > limits.lives
        within = cv2.erode(self._stuck, np.ones((3, 3), np.uint8)) if self._stuck.sum() > TILES else self._stuck
        if (moves & (within > 0)).any():
            self._stuck = np.zeros_like(self._stuck)
        elif min(before.sum(), self._carried.sum()) >= limits.tiles:
            self._stuck |= before | self._carried


def _tiles(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(tiles, samples)."""
    rows, columns = (size // TILES for size in values.shape)
    tiles: NDArray[np.float32] = values.reshape(TILES, rows, TILES, columns).swapaxes(1, 2).reshape(TILES**2, -1)
    return tiles


def _normalised(tiles: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of length 1; shorter where much less of a tile than of others stands."""
    length = np.linalg.norm(tiles, axis=1, keepdims=True)
    return np.asarray(tiles / np.maximum(length, max(1.0, 0.7 * float(np.median(length)))), np.float32)
