"""Which hole a hand goes to, before it is there: where it will be if it goes on so, and where its part belongs.

A hand slows down on its way, and nobody knows when it will stop. So its end is a mixture over times that it may still
take; each of them puts it farther along its velocity, and less surely there. The settings were fitted to recordings of
simulated people, who are not those of the figures: `python -m tests.benchmarks.foresight`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bracket_ground.files.model import Model
from bracket_ground.interfaces.pose import Array

TAKES_S: Array = np.array([0.0, 0.15, 0.35, 0.6, 0.9])  # that a hand may still move
FAST_M_S = 0.3  # a hand that is slower heads less surely for anything
LEAST = 1e-6


class ForesightSettings(Model):
    """How hands go to holes.

    Attributes:
        goes_on: share of its way at this speed that a hand really goes, as it slows down.
        near_m: standard deviation of where a hand lets go, from the hole.
        strays: standard deviation that each metre ahead adds to it.
        heads: how much it says that a fast hand heads for a hole.
        sharpness: exponent of what the hand's way says; less than 1 makes it less sure.
        belongs: exponent of the belief that the part in the hand belongs there.
    """

    goes_on: float = 1.0
    near_m: float = 0.0235
    strays: float = 11.3
    heads: float = 3.3
    sharpness: float = 1.33
    belongs: float = 1.3


DEFAULT = ForesightSettings()


def foreseen(
    tips_m: tuple[float, float],
    velocity_m_s: tuple[float, float],
    holes_m: Mapping[str, tuple[float, float]],
    belongs: Mapping[str, float],
    settings: ForesightSettings = DEFAULT,
) -> dict[str, float]:
    """How probable it is of each hole that the hand goes there; sums to 1, empty without holes.

    Args:
        tips_m: (x, y) of the fingertips.
        velocity_m_s: (x, y) of the hand.
        holes_m: (x, y) of each open hole.
        belongs: how probable it is that the part in the hand belongs there.
    """
    if not holes_m:
        return {}
    ahead = settings.goes_on * TAKES_S[:, np.newaxis] * np.array(velocity_m_s)  # (times, 2)
    off = np.array(tips_m) + ahead - np.array(list(holes_m.values()))[:, np.newaxis]  # (holes, times, 2)
    spread = settings.near_m + settings.strays * np.linalg.norm(ahead, axis=1)
    logs = -0.5 * (off**2).sum(axis=2) / spread**2 - 2 * np.log(spread)
    to = np.array(list(holes_m.values())) - np.array(tips_m)
    distances_m, speed_m_s = np.linalg.norm(to, axis=1), float(np.hypot(*velocity_m_s))
    heading = to @ np.array(velocity_m_s) / (distances_m * speed_m_s + LEAST) * min(1.0, speed_m_s / FAST_M_S)
    way = np.logaddexp.reduce(logs, axis=1) + settings.heads * heading
    prior = np.array([math.log(max(belongs.get(name, 0.0), LEAST)) for name in holes_m])
    logits = settings.sharpness * way + settings.belongs * prior
    shares = np.exp(logits - logits.max())
    return dict(zip(holes_m, (shares / shares.sum()).tolist(), strict=True))
