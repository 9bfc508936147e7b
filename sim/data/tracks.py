"""The hand's track in a recording: as a perfect tracker would tell it, and as a real one does, with gaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cell.errors import InputError
from cell.interfaces.pose import Array
from sim.data.hands import visible_shares
from sim.data.recording import CAMERA, Assembly, Moment, Source
from sim.data.sight import Projection, fingertip

HAND_BODIES = ("hand", "hand_thumb", "hand_index", "hand_fingers")
LEAST_SEEN = 0.1  # of a hand that anybody could see
PLACES = ("fingertips_m", "palm_m", "thumb_m", "index_m")

# What a tracker gets wrong, as the shipped one does in recordings of the look `hard`.
HALF_HIDDEN = 0.5  # a hand of which less shows is often lost, or taken to be elsewhere
HIDDEN_LOST, HIDDEN_ASTRAY = 0.12, 0.12  # probability that it begins in a frame
LOST_EVERY_S, ASTRAY_EVERY_S = 20.0, 30.0  # where the hand shows
COVERED = (0.3, 0.5)  # share of the hand below which it is covered: what becomes of it then stays so
COVERED_LOST, COVERED_ASTRAY = 0.88, 0.09  # probability, each time that it gets covered
LASTS_S = (0.07, 1.5)
ASTRAY_M = (0.06, 0.35)

Hand = dict[str, Any]


@dataclass(frozen=True)
class PointErrors:
    """By how much a tracker puts the drawn hand's points elsewhere, in the frame of a right hand.

    Attributes:
        palm_m, tips_m: along the way from palm to fingertips, and across it to the left.
        slow_m, each_m: standard deviation of what drifts, of palm and of fingertips, and of each frame.
        drifts_s: time in which it has drifted elsewhere.
    """

    palm_m: tuple[float, float]
    tips_m: tuple[float, float]
    slow_m: tuple[float, float]
    each_m: float
    drifts_s: float


# MediaPipe knows people's hands: the drawn one has longer fingers, and a claw of them.
ERRORS = {"mediapipe": PointErrors((0.013, -0.014), (-0.030, 0.018), (0.008, 0.014), 0.003, 0.6)}


def as_told_by(tracker: str, hands: Sequence[Hand | None], rng: np.random.Generator) -> list[Hand | None]:
    """The hands of a recording with the errors of a tracker.

    Raises:
        InputError: it is none of ERRORS.
    """
    if tracker not in ERRORS:
        raise InputError(f"--tracker {tracker}: the errors of no such tracker are known; legal: {', '.join(ERRORS)}")
    errors = ERRORS[tracker]
    drift, before_s, found = rng.normal(0, 1, (2, 2)), 0.0, list[Hand | None]()
    for hand in hands:
        if hand is None:
            found.append(None)
            continue
        kept = math.exp(-(hand["time_s"] - before_s) / errors.drifts_s)
        drift, before_s = kept * drift + math.sqrt(1 - kept**2) * rng.normal(0, 1, (2, 2)), hand["time_s"]
        found.append(_shifted(hand, errors, drift, rng))
    return found


def _shifted(hand: Hand, errors: PointErrors, drift: Array, rng: np.random.Generator) -> Hand:
    """A hand whose points are where a tracker says."""
    palm, tips, thumb, index = (np.array(hand[name]) for name in ("palm_m", "fingertips_m", "thumb_m", "index_m"))
    along = (tips - palm) / max(1e-6, float(np.linalg.norm(tips - palm)))
    spread = index - thumb
    left = along[0] * spread[1] - along[1] * spread[0] > 0
    across = np.array([-along[1], along[0]]) * (-1 if left else 1)
    moved = {}
    for name, by_m, slow_m, drifted in (
        ("palm_m", errors.palm_m, errors.slow_m[0], drift[0]),
        *((name, errors.tips_m, errors.slow_m[1], drift[1]) for name in ("fingertips_m", "thumb_m", "index_m")),
    ):
        off = by_m[0] * along + by_m[1] * across + slow_m * drifted + rng.normal(0, errors.each_m, 2)
        moved[name] = _xy(np.array(hand[name]) + off)
    return {**hand, **moved}


def as_tracked(
    source: Source, hands: Sequence[Hand | None], visible: Sequence[float], rng: np.random.Generator
) -> list[Hand | None]:
    """The hands of a recording as a tracker reports them: lost for a while, or taken for something that lies elsewhere.

    One that is covered, by a head that leans over it or by the arm, is mostly lost for as long as that lasts.

    Args:
        hands: by moment, as `hands_of` tells them.
        visible: share of the hand that shows, by moment.
    """
    rate_hz = source.bench.overhead.rate_hz
    found: list[Hand | None] = []
    left, place_m = 0.0, None
    covered, least = False, rng.uniform(*COVERED)
    for hand, share in zip(hands, visible, strict=True):
        left -= 1
        was, covered = covered, share < least
        if was and not covered:
            left, least = 0, rng.uniform(*COVERED)
        if (left <= 0 and not covered and hand is not None) or (covered and not was):
            lost, astray = _odds(share, covered, rate_hz)
            draw, left = rng.random(), 0
            if draw < lost + astray:
                left = math.inf if covered else math.ceil(math.exp(rng.uniform(*np.log(LASTS_S))) * rate_hz)
                place_m = None if hand is None or draw < lost else _elsewhere(hand, rng)
        if left <= 0:
            found.append(hand)
        else:
            found.append(None if hand is None or place_m is None else _moved(hand, place_m))
    return found


def _odds(share: float, covered: bool, rate_hz: float) -> tuple[float, float]:
    """Probability that a hand of which this share shows is lost, and that it is taken to be elsewhere."""
    if covered:
        return COVERED_LOST, COVERED_ASTRAY
    if share < HALF_HIDDEN:
        return HIDDEN_LOST, HIDDEN_ASTRAY
    return 1 / (LOST_EVERY_S * rate_hz), 1 / (ASTRAY_EVERY_S * rate_hz)


def _elsewhere(hand: Hand, rng: np.random.Generator) -> Array:
    away, turn = rng.uniform(*ASTRAY_M), rng.uniform(-math.pi, math.pi)
    place: Array = np.array(hand["fingertips_m"]) + away * np.array([math.cos(turn), math.sin(turn)])
    return place


def _moved(hand: Hand, fingertips_m: Array) -> Hand:
    """The same hand elsewhere."""
    by_m = fingertips_m - np.array(hand["fingertips_m"])
    return {**hand, **{name: _xy(np.array(hand[name]) + by_m) for name in PLACES}}


def hands_of(source: Source, visible: Sequence[float] | None = None) -> list[Hand | None]:
    """The hand as a perfect tracker would tell it, by moment.

    None where the fingertips are out of the image, or where so little of it shows that nobody could see it.

    Args:
        visible: share of the hand that shows, by moment, where that is known already.
    """
    assembly, setup = source.assembly, source.bench.overhead
    model = assembly.world.model
    projection = Projection(assembly.world, CAMERA, setup, assembly.look)
    bodies = {body.name: body.body for body in assembly.world.bodies}
    of_hand = {body for body in range(model.nbody) if model.body(body).name in HAND_BODIES}
    sleeve = {index for index in range(model.nmat) if model.mat(index).name == "hand_sleeve"}
    geoms = np.array(
        [
            index
            for index in range(model.ngeom)
            if model.geom_bodyid[index] in of_hand
            and model.geom_matid[index] not in sleeve
            and model.geom_group[index] < 3
        ]
    )
    digits = {"thumb_m": model.body("hand_thumb").id, "index_m": model.body("hand_index").id}
    bones = {name: int(np.flatnonzero(model.geom_bodyid == body)[0]) for name, body in digits.items()}
    pieces = {name: np.flatnonzero(model.geom_bodyid == body) for name, body in bodies.items()}
    found: list[Hand | None] = []
    visible = visible or visible_shares(source, range(len(assembly.moments)))
    for moment, held, share in zip(assembly.moments, assembly.held, visible, strict=True):
        poses = moment.exposure.moments[-1]
        column, row = projection.pixels(poses, moment.fingertips_m[np.newaxis])[0]
        seen = geoms if held is None else np.concatenate([geoms, pieces[_nearest(assembly, moment, held)]])
        box = projection.box(poses, seen)
        if share < LEAST_SEEN or box is None or not (0 <= column < setup.width_px and 0 <= row < setup.height_px):
            found.append(None)
            continue
        found.append(
            {
                "time_s": round(moment.time_s, 4),
                "box_px": box,
                "fingertips_m": [round(float(value), 5) for value in moment.fingertips_m[:2]],
                "palm_m": [round(float(value), 5) for value in moment.palm_m[:2]],
                "held_part": held,
                "fingertips_height_m": round(float(moment.fingertips_m[2]), 5),
                **{name: _xy(fingertip(model, poses, bone, moment.palm_m)) for name, bone in bones.items()},
            }
        )
    return found


def _xy(point: Array) -> list[float]:
    return [round(float(value), 5) for value in point[:2]]


def _nearest(assembly: Assembly, moment: Moment, part: str) -> str:
    """Name of the body of this type that is nearest to the fingertips."""
    away = np.linalg.norm(moment.parts_m - moment.fingertips_m, axis=1)
    of_type = [one for one in zip(away, assembly.world.bodies, strict=True) if one[1].part == part]
    return min(of_type, key=lambda one: float(one[0]))[1].name
