"""An appearance embedding for every detection, as a detector with image features would give it (ablation only).

The crop is drawn, not rendered: heights of all bodies around a part, seen from straight above and turned to the
detected heading. Its lowest cosine coefficients are a fixed descriptor of shape and surroundings; nothing is fitted.
What the crop shows is the truth, whatever the noise of the detected poses.
"""

from __future__ import annotations

import numpy as np

from cell.interfaces.pose import Array
from learned.grasp.boxes import Boxes

_CELLS, _SPACING_M, _ORDERS = 24, 0.005, 8
CROP_FEATURES = _ORDERS**2
_UNIT_M = 0.05
_steps = (np.arange(_CELLS) + 0.5) / _CELLS
_COSINES = np.cos(np.pi * np.arange(_ORDERS)[:, None] * _steps) * np.sqrt(2.0 / _CELLS)  # (orders, cells)
_PLACES_M = (_steps - 0.5) * _CELLS * _SPACING_M


def crop_embeddings(boxes: Boxes, centre_m: Array, yaw_rad: Array) -> Array:
    """Embeddings (n, CROP_FEATURES) of crops at detected centres (n, 2) and headings (n,)."""
    along, across = np.meshgrid(_PLACES_M, _PLACES_M, indexing="ij")
    cos, sin = np.cos(yaw_rad)[:, None, None], np.sin(yaw_rad)[:, None, None]
    x = centre_m[:, 0, None, None] + along * cos - across * sin
    y = centre_m[:, 1, None, None] + along * sin + across * cos
    heights = _heights_m(boxes, x, y) / _UNIT_M
    coefficients: Array = np.einsum("ui,nij,vj->nuv", _COSINES, heights, _COSINES)
    flat: Array = coefficients.reshape(len(boxes), -1) / _ORDERS
    return flat


def crop_signs() -> Array:
    """Signs (4, CROP_FEATURES) of crops that are mirrored along, across, or both (half a turn)."""
    along, across = np.repeat(np.arange(_ORDERS), _ORDERS) % 2, np.tile(np.arange(_ORDERS), _ORDERS) % 2
    signs: Array = np.stack([0 * along, along, across, along + across])
    return 1.0 - 2.0 * (signs % 2)


def _heights_m(boxes: Boxes, x: Array, y: Array) -> Array:
    """Height of whatever is uppermost at points of any shape; 0 on the tray."""
    highest = np.zeros_like(x)
    for (left, front), yaw, size, top in zip(boxes.centre_m, boxes.yaw_rad, boxes.size_m, boxes.top_m, strict=True):
        cos, sin = np.cos(yaw), np.sin(yaw)
        inside = np.abs((x - left) * cos + (y - front) * sin) <= size[0] / 2
        inside &= np.abs((y - front) * cos - (x - left) * sin) <= size[1] / 2
        np.maximum(highest, np.where(inside, top, 0.0), out=highest)
    return highest
