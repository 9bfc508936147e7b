"""MediaPipe's networks on a folder of photographs, against landmarks that somebody else gives for them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.learned.hands.mediapipe.hands import MIDDLE_BASE, WRIST, MediaPipeHands
from bracket_cell.learned.records import read_image
from bracket_ground.errors import InputError
from bracket_ground.interfaces.pose import Array

Truth = dict[str, list[Array]]

LANDMARKS = 21
FAR_PX = 1e6  # landmarks may lie outside their photograph, as a hand goes on beyond its edge, but not this far


class _Pairs(list[tuple[str, Any]]):
    """What a JSON object holds, as it stands: a name that stands twice is there twice."""


def load_truth(path: Path, folder: Path) -> Truth:
    """Read a file of landmarks: path of the photograph in the folder -> hands, each 21 x [x_px, y_px].

    Raises:
        InputError: with every problem of the file.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder of photographs")
    try:
        read = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_Pairs, parse_int=_whole)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except RecursionError:
        raise InputError(f"{path}: its lists are nested too deep") from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from None
    if not isinstance(read, _Pairs) or not read:
        what = "names no photograph; legal is" if isinstance(read, _Pairs) else "must be"
        raise InputError(f"{path}: {what} an object: path of a photograph -> list of hands")
    problems = [*_twice(read), *(what for name, hands in read if (what := _problem(folder, name, hands)))]
    if problems:
        raise InputError(*(f"{path}: {what}" for what in problems))
    return {name: [np.array(hand, dtype=np.float64) for hand in hands] for name, hands in read}


def _whole(digits: str) -> int | float:
    """Numbers of any length are numbers; what no float holds is infinite, and Python reads no more than 4300 digits."""
    return float(digits) if len(digits) > 15 else int(digits)


def _twice(read: _Pairs) -> list[str]:
    """Photographs that are named several times, by one name or by several."""
    names: dict[Path, list[str]] = {}  # `./a.png` is `a.png`
    for name, _ in read:
        names.setdefault(Path(name), []).append(name)
    often = ((" and ".join(map(repr, dict.fromkeys(same))), len(same)) for same in names.values() if len(same) > 1)
    return [
        f"{named}: the photograph stands {times} times; legal is once, with all its hands" for named, times in often
    ]


def _problem(folder: Path, name: str, hands: Any) -> str:
    if Path(name).is_absolute() or ".." in Path(name).parts:
        return f"{name!r}: names no photograph in {folder}; legal is a path from there, like sub/a.png"
    try:
        there = (folder / name).is_file()
    except (OSError, ValueError):  # a name that no file can have
        there = False
    if not there:
        return f"{name!r}: there is no such file in {folder}"
    if not isinstance(hands, list) or isinstance(hands, _Pairs):
        return f"{name!r}: must be a list of hands, each {LANDMARKS} x [x_px, y_px]"
    wrong = ((number, what) for number, hand in enumerate(hands, 1) if (what := _mistake(hand)))
    return next((f"{name!r}: hand {number} {what}; must be {LANDMARKS} x [x_px, y_px]" for number, what in wrong), "")


def _mistake(hand: Any) -> str:
    if not isinstance(hand, list) or isinstance(hand, _Pairs):
        return "is no list"
    if len(hand) != LANDMARKS:
        return f"has {len(hand)} landmarks"
    for number, point in enumerate(hand, 1):
        if not isinstance(point, list) or len(point) != 2 or not all(type(one) in (int, float) for one in point):
            return f"has a landmark {number} that is not two numbers"
        if not all(math.isfinite(one) and abs(one) <= FAR_PX for one in point):
            return f"has a landmark {number} that is not within {FAR_PX:.0f} pixels"
    return ""


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
