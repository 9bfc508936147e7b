"""Colour model: which part type, or skin, a pixel shows, whatever the light; one table look-up a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import SettingError
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

Labels = NDArray[np.uint8]

BACKGROUND = 0
BITS = 6  # a channel; finer tables no longer fit the cache
DARKEST = 14.0 / 255  # mean of the channels; below it noise decides the hue
LARGEST_ANGLE_RAD = 0.40
PALEST = 0.35  # of the reference's saturation: gloss and haze add white
RICHEST = 1.45
LEAST_SATURATION = 0.28  # length of the chroma below which anything is background
OVEREXPOSED = 0.97  # of the largest channel; beyond it colours pale and their hue drifts
LEAST_OVEREXPOSED = 0.14
DRIFT_RAD = 0.25
LEAST_REFERENCE = 0.35
LEAST_DISTANCE = 0.30
NO_CHROMA = 100.0  # that no pixel has
_HELP = "choose a clearer colour, or train detectors that need none: cell train --all"


class ColourModel:
    """Labels pixels: 0 for the background, 1..n for the part types in the product's order, n + 1 for skin.

    Light scales a colour and gloss adds white. Both leave the direction of its chroma (channels over their mean,
    minus one) alone, and so pixels are compared by that direction, then by its length, the saturation. The uppermost
    part of a sub-assembly counts as that: from above they look alike.
    """

    def __init__(self, product: Product, skin_rgb: Sequence[float] | Array) -> None:
        names = [*product.parts, "skin"]
        colours = np.array([*(part.colour_rgb for part in product.parts.values()), skin_rgb])
        references = _chroma(colours)
        for number, name in enumerate(kind.made_of[-1] for kind in product.wholes.values()):
            references[names.index(name)] = NO_CHROMA + number
        _refuse_alike(names, references)
        self.skin = len(names)
        self._table = _table(tuple(map(tuple, references.tolist())))
        self._last: tuple[NDArray[np.uint8], Labels] | None = None

    def label(self, image: NDArray[np.uint8]) -> Labels:
        """Labels (height, width) of an RGB image (height, width, 3); several detectors may ask about one image."""
        if self._last is None or self._last[0] is not image:
            self._last = image, self._labels(image)
        return self._last[1]

    def _labels(self, image: NDArray[np.uint8]) -> Labels:
        reduced = (image >> (8 - BITS)).astype(np.uint32)
        index = (reduced[..., 0] << (2 * BITS)) | (reduced[..., 1] << BITS) | reduced[..., 2]
        labels: Labels = self._table[index]
        return labels


def _chroma(colours: Array) -> Array:
    """Channels over their mean, minus one: (n, 3) to (n, 3); grey gives zeros."""
    mean = np.maximum(colours.mean(axis=-1, keepdims=True), 1e-6)
    chroma: Array = colours / mean - 1.0
    return chroma


@lru_cache(maxsize=2)
def _table(references: tuple[tuple[float, ...], ...]) -> Labels:
    """Label of each reduced colour, (2 ** (3 * BITS),); all detectors of a cell share one."""
    levels = (np.arange(2**BITS) + 0.5) / 2**BITS
    colours = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    chroma = _chroma(colours)
    saturation = np.linalg.norm(chroma, axis=1)
    clipped = colours.max(axis=1) > OVEREXPOSED
    least = np.where(clipped, LEAST_OVEREXPOSED, LEAST_SATURATION)
    widest = LARGEST_ANGLE_RAD + DRIFT_RAD * clipped
    best = np.full(len(colours), np.inf)
    labels = np.zeros(len(colours), np.uint8)
    for label, reference in enumerate(np.array(references), start=1):
        strength = float(np.linalg.norm(reference))
        angle = np.arccos(np.clip(chroma @ reference / np.maximum(saturation * strength, 1e-9), -1.0, 1.0))
        ratio = saturation / strength
        distance = np.linalg.norm(chroma - reference, axis=1) / strength
        rich = (saturation > least) & (ratio > PALEST) & (ratio < RICHEST)
        fits = rich & (angle < widest) & (distance < best)
        labels[fits] = label
        best[fits] = distance[fits]
    labels[colours.mean(axis=1) < DARKEST] = BACKGROUND
    labels.setflags(write=False)
    return labels


def _refuse_alike(names: list[str], references: Array) -> None:
    """Raise SettingError where colour cannot tell two types, or a type and the bare bench, apart."""
    for i, name in enumerate(names):
        if (saturation := float(np.linalg.norm(references[i]))) < LEAST_REFERENCE:
            what = f"colour of {name} has saturation {saturation:.2f}; classical perception needs {LEAST_REFERENCE}"
            raise SettingError((_where(name), f"{what}; {_HELP}"))
        for j in range(i):
            if (distance := float(np.linalg.norm(references[i] - references[j]))) < LEAST_DISTANCE:
                what = f"colours of {names[j]} and {name} are {distance:.2f} apart; {LEAST_DISTANCE} or more is needed"
                raise SettingError((_where(name), f"{what}; {_HELP}"))


def _where(name: str) -> tuple[str, ...]:
    """The key that holds a colour."""
    return ("perception", "classical", "skin_rgb") if name == "skin" else ("product", "parts", name, "colour_rgb")
