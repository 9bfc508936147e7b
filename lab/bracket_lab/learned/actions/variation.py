"""By how much training varies what a tracker and a camera tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bracket_cell.learned.actions.segments import CROP_PX, HEIGHT, OPENING, PALM, TIPS, Images, SegmentReader
from bracket_cell.learned.inference.exposure import levelled, spoiled
from bracket_ground.interfaces.pose import Array

DRIFT_KNOTS = 6  # of what drifts within a segment: it goes straight between them
WORSE_TIMES = 3.0  # in the look `hard`, a tenth of the segments are 20 mm off or more
KEPT_PX = 80  # side of what is kept of a window: what networks see, and room to shift it


@dataclass(frozen=True)
class Variation:
    """By how much training varies what a tracker and a camera tell.

    Attributes:
        bias_m, noise_m: standard deviation of the track, of a whole segment and of each frame.
        scale: of the track about the bracket's middle, as of a hand whose height is not known.
        drift_m: of the track, slowly within the segment.
        worse: share of segments in which bias_m and drift_m are WORSE_TIMES as much, as in poor images, or where the
            hand's height is read wrongly.
        height_bias_m, height_drift_m, height_noise_m: of the fingertips' height.
        opening_bias_m, opening_drift_m, opening_noise_m: of how far they are apart. No tracker tells it to the
            millimetre by which types of parts differ: what is held is to be seen in the crops.
        flat: share of segments for which the tracker tells neither.
        lost: share of frames in which the hand is not seen.
        shift_px: of the crops, in window pixels.
        gain: of brightness and of each colour channel.
        blank: share of segments whose crops are black.
        retaken: share of segments whose crops are taken again in other light by another camera.
        covered: share of segments whose crops something of one colour hides in part.
    """

    bias_m: float = 0.005
    noise_m: float = 0.0025
    scale: float = 0.015
    drift_m: float = 0.004
    worse: float = 0.2
    height_bias_m: float = 0.028
    height_drift_m: float = 0.018
    height_noise_m: float = 0.008
    opening_bias_m: float = 0.008
    opening_drift_m: float = 0.003
    opening_noise_m: float = 0.003
    flat: float = 0.1
    lost: float = 0.03
    shift_px: float = 2.5
    gain: float = 0.12
    blank: float = 0.03
    retaken: float = 0.5
    covered: float = 0.1


def varied_track(track: Array, reader: SegmentReader, rng: np.random.Generator, variation: Variation) -> Array:
    """As a tracker and a camera that hangs elsewhere could have told it."""
    middle_m = reader.holes_m.mean(axis=0)
    times = WORSE_TIMES if rng.random() < variation.worse else 1.0
    scale, bias = rng.normal(1.0, variation.scale), rng.normal(0.0, variation.bias_m * times, 2)
    each = [variation.noise_m] * 4 + [variation.height_noise_m, variation.opening_noise_m]
    varied = track + rng.normal(0.0, 1.0, track.shape) * each
    for columns in (TIPS, PALM):
        varied[:, columns] = (varied[:, columns] - middle_m) * scale + middle_m + bias
    slow = np.array([variation.drift_m * times] * 4 + [variation.height_drift_m, variation.opening_drift_m])
    knots = rng.normal(0.0, slow, (DRIFT_KNOTS, len(slow)))
    at = np.linspace(0, DRIFT_KNOTS - 1, len(track))
    varied += np.stack([np.interp(at, np.arange(DRIFT_KNOTS), column) for column in knots.T], axis=1)
    varied[:, HEIGHT] += rng.normal(0.0, variation.height_bias_m)
    varied[:, OPENING] += rng.normal(0.0, variation.opening_bias_m)
    varied[rng.random(len(track)) < variation.lost] = np.nan
    if rng.random() < variation.flat:
        varied[:, [HEIGHT, OPENING]] = np.nan
    return varied


def cut_out(window: Images, rng: np.random.Generator | None, variation: Variation) -> Images:
    """The middle of a window, or what is beside it."""
    edge = (KEPT_PX - CROP_PX) // 2
    down = right = edge
    if rng is not None:
        down, right = (int(value) for value in np.clip(rng.normal(edge, variation.shift_px, 2).round(), 0, 2 * edge))
    return window[down : down + CROP_PX, right : right + CROP_PX]


@dataclass(frozen=True, eq=False)
class OtherCamera:
    """Takes both crops of a segment again, alike.

    Attributes:
        gains: (3,) of the colour channels.
        seed: of other light and another camera; None for the ones that there are.
        cover: rows and columns that something hides, and its colour.
    """

    gains: Array
    seed: int | None
    cover: tuple[slice, slice, Array] | None

    @classmethod
    def drawn(cls, rng: np.random.Generator, variation: Variation) -> OtherCamera:
        gains = np.exp(rng.normal(0, variation.gain) + rng.normal(0, variation.gain / 2, 3))
        seed = int(rng.integers(2**31)) if rng.random() < variation.retaken else None
        cover = None
        if rng.random() < variation.covered:
            top, left = rng.integers(-CROP_PX // 3, CROP_PX, 2)
            high, wide = rng.integers(CROP_PX // 6, CROP_PX * 2 // 3, 2)
            rows, columns = (slice(max(0, at), max(0, at + size)) for at, size in ((top, high), (left, wide)))
            cover = rows, columns, rng.uniform(0, 255, 3)
        return cls(gains, seed, cover)

    def take(self, crop: Images) -> Images:
        """The crop as this camera sees it."""
        seen = np.clip(crop * self.gains, 0, 255).astype(np.uint8)
        if self.cover is not None:
            rows, columns, colour = self.cover
            seen[rows, columns] = colour.astype(np.uint8)
        return seen if self.seed is None else spoiled(levelled(seen), np.random.default_rng(self.seed))
