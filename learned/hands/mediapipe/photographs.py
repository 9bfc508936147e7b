"""MediaPipe's networks on a folder of photographs, against landmarks that somebody else gives for them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cell.interfaces.pose import Array
from learned.hands.dataset import read_image
from learned.hands.mediapipe.hands import MediaPipeHands
from learned.hands.mediapipe.landmarks import MIDDLE_BASE, WRIST
from learned.hands.mediapipe.truth import Truth


def compare_photographs(hands: MediaPipeHands, folder: Path, truth: Truth) -> dict[str, Any]:
    """How far landmarks are from the given ones.

    Returns:
        `photos`; `same_number`, of photographs in which as many hands were found; `hands`, that were compared;
        `error_p50` and `error_p90` over these: the mean distance of the 21 landmarks as a share of the length from
        the wrist to the base of the middle finger, null where no hand was compared.
    """
    same, errors = 0, []
    for name, given in truth.items():
        found = [hand.points_px for hand in hands.picture(read_image(folder / name))]
        same += len(found) == len(given)
        errors += pair_errors(found, given)
    p50, p90 = (round(float(np.percentile(errors, one)), 5) if errors else None for one in (50, 90))
    answer = {"photos": len(truth), "same_number": same, "hands": len(errors)}
    return {**answer, "error_p50": p50, "error_p90": p90}


def pair_errors(found: Sequence[Array], given: Sequence[Array]) -> list[float]:
    """Errors of the hands that belong together, nearest first, as shares of each given hand's palm."""
    lengths = [max(1e-9, float(np.linalg.norm(hand[MIDDLE_BASE] - hand[WRIST]))) for hand in given]
    pairs = sorted(
        (float(np.linalg.norm(one - other, axis=1).mean()) / lengths[g], f, g)
        for f, one in enumerate(found)
        for g, other in enumerate(given)
    )
    errors, used_found, used_given = [], set(), set()
    for error, f, g in pairs:
        if f not in used_found and g not in used_given:
            errors.append(error)
            used_found.add(f)
            used_given.add(g)
    return errors
