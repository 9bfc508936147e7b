"""The hand's track in a recording: as a perfect tracker would tell it, as one with gaps, and as a given one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from bracket_ground.interfaces.perception import HandSample, HandTracker
from bracket_ground.interfaces.pose import Array
from bracket_lab.drawing.hands import visible_shares
from bracket_lab.drawing.recording import CAMERA, Assembly, Moment, Source
from bracket_lab.drawing.sight import Projection, fingertip
from bracket_lab.drawing.working_arm import WorkingArm

HAND_BODIES = ("hand", "hand_thumb", "hand_index", "hand_fingers")
LEAST_SEEN = 0.1  # of a hand that anybody could see
PLACES = ("fingertips_m", "palm_m", "thumb_m", "index_m")
ARM_STREAM = 11

# What a tracker gets wrong, as the shipped one does in recordings of the look `hard`.
HALF_HIDDEN = 0.5  # a hand of which less shows is often lost, or taken to be elsewhere
HIDDEN_LOST, HIDDEN_ASTRAY = 0.12, 0.12  # probability that it begins in a frame
LOST_EVERY_S, ASTRAY_EVERY_S = 20.0, 30.0  # where the hand shows
COVERED = (0.3, 0.5)  # share of the hand below which it is covered: what becomes of it then stays so
COVERED_LOST, COVERED_ASTRAY = 0.88, 0.09  # probability, each time that it gets covered
LASTS_S = (0.07, 1.5)
ASTRAY_M = (0.06, 0.35)

Hand = dict[str, Any]


def as_seen_by(tracker: HandTracker, source: Source, seed: int) -> list[Hand | None]:
    """The hand as a tracker sees it in the frames of a recording, while the arm works: by moment, None where it does
    not."""
    assembly, bench = source.assembly, source.bench
    photographer = assembly.photographer(bench)
    arm = WorkingArm(assembly.world, bench.arm_look_rad, np.random.default_rng([seed, ARM_STREAM]))
    found: list[Hand | None] = []
    for moment in assembly.moments:
        frame = photographer.take(moment.exposure).beside(arm.points_m(moment.exposure.moments[-1], None))
        sample = tracker.track(frame)
        found.append(None if sample is None else _told(sample))
    photographer.close()
    return found


def _told(sample: HandSample) -> Hand:
    """A tracker's sample as `hands_of` tells one."""
    return {
        "time_s": round(sample.time_s, 4),
        "box_px": sample.box_px,
        "held_part": sample.held_part,
        "fingertips_height_m": sample.fingertips_height_m,
        **{name: None if (point := getattr(sample, name)) is None else _xy(np.array(point)) for name in PLACES},
    }


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
    of_type = [pair for pair in zip(away, assembly.world.bodies, strict=True) if pair[1].part == part]
    return min(of_type, key=lambda pair: float(pair[0]))[1].name
