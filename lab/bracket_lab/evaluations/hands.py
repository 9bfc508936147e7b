"""Hand trackers against the simulator's truth: whole recordings, as a tracker sees them in a run, over many looks.

Errors are told three times: on the bench as the controller believes the camera to hang, by its calibration or by the
bench file; by the image alone, as if it hung exactly there (`image`); and along the table alone, as if the hand's
height was known, too (`plane`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.hands.deviation import WITHIN_HEIGHT
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import HandSample, HandTracker
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.hands import HandTruth, every_frame, hand_frames
from bracket_lab.drawing.recording import Source, record
from bracket_lab.drawing.sight import true_calibration
from bracket_lab.evaluations.holes_and_parts import Cameras, calibrated_bench
from bracket_sim.scene.look_range import LookRange
from bracket_sim.scene.settings import settings_of

FOUND_M = 0.06  # between the palm that a tracker tells and the true one
LEAST_VISIBLE = 0.5  # of a hand that must be found
EDGE_PX = 8.0  # and its palm and fingertips are so far inside the image
GONE_VISIBLE = 0.1  # a hand that shows less must not be found
OVER_MM = 20.0  # of a person's median, from which the person counts as one that is seen badly
STRETCH_FRAMES = 24
RESAMPLES, RESAMPLING_SEED = 400, 11
GLOVES_HSV = tuple((hue / 12, 0.85, 0.8 if hue % 2 else 0.35) for hue in range(12))  # more vivid than any in training

Only = Callable[[int], Mapping[str, object]]
ONLY: Mapping[str, Only] = {
    "all": lambda _: {},
    "bare-right": lambda _: {"glove": False, "left_hand": False, "second_hand": False},
    "left": lambda _: {"glove": False, "left_hand": True, "second_hand": False},
    "second": lambda _: {"glove": False, "left_hand": False, "second_hand": True},
    "gloves": lambda seed: {
        "glove": True,
        "left_hand": False,
        "second_hand": False,
        "glove_hsv": GLOVES_HSV[seed % len(GLOVES_HSV)],
    },
}


@dataclass
class Tally:
    """What came out in one recording: lists of values by name; means of 0 and 1 are shares."""

    values: dict[str, list[float]] = field(default_factory=dict)

    def add(self, name: str, value: float) -> None:
        """One more value."""
        self.values.setdefault(name, []).append(float(value))


def evaluate_hands(
    configuration: Configuration,
    product: Product,
    trackers: Mapping[str, Callable[[Bench], HandTracker]],
    seeds: Sequence[int],
    *,
    stretches: int | None = None,
    physics: bool = True,
    only: str = "all",
    cameras: Cameras = "calibrated",
) -> dict[str, dict[str, Any]]:
    """Scores by tracker, all on the same frames.

    Args:
        trackers: makes a new tracker for each recording and its bench, by name; between stretches it sees nothing.
        stretches: number of stretches of STRETCH_FRAMES frames in each recording; None: all its frames.
        only: which persons: a key of ONLY.
        cameras: where the overhead camera is believed to hang: where a calibration in each look finds it, where the
            bench file says, or where it does.
    """
    tallies: dict[str, list[Tally]] = {name: [] for name in trackers}
    for seed in seeds:
        settings = settings_of(configuration.devices.simulation)
        settings = settings.model_copy(update={"look": _only(settings.look, ONLY[only](seed))})
        drawn = configuration.bench
        source = Source(record(product, drawn, settings, seed, physics=physics), product, drawn)
        bench = _believed(cameras, configuration, source)
        of_seed = {name: Tally() for name in trackers}
        running = {name: make(bench) for name, make in trackers.items()}
        for seen in hand_frames(source, _stretches(source, stretches, seed)):
            seen_frame = seen.frame.seen_from(bench.overhead.corrected(seen.frame.world_from_camera))
            view = View.of(bench.overhead.model, seen_frame)
            for name, tracker in running.items():
                began_s = time.process_time()
                sample = tracker.track(seen_frame)
                of_seed[name].add("latency_ms", 1e3 * (time.process_time() - began_s))
                judge(of_seed[name], view, seen.hands, sample, tracker.others, drawn)
        for name, tally in of_seed.items():
            tallies[name].append(tally)
    return {name: scores(each) for name, each in tallies.items()}


def _believed(cameras: Cameras, configuration: Configuration, source: Source) -> Bench:
    """The bench with the overhead camera that trackers believe in."""
    if cameras == "believed":
        return source.bench
    if cameras == "calibrated":
        return calibrated_bench(configuration, source.product, source.assembly.seed)
    overhead = source.bench.overhead
    true = true_calibration(source.assembly.world, "overhead", overhead)
    return source.bench.model_copy(update={"overhead": overhead.calibrated(true)})


def judge(
    tally: Tally,
    view: View,
    hands: Sequence[HandTruth],
    sample: HandSample | None,
    others: Sequence[HandSample],
    bench: Bench,
) -> None:
    """Compare what a tracker said of one frame with what was so."""
    size = np.array([bench.overhead.width_px, bench.overhead.height_px])
    acting = next((hand for hand in hands if hand.acting), None)
    second = next((hand for hand in hands if not hand.acting), None)
    if acting is None or acting.visible < GONE_VISIBLE:
        tally.add("imagined", sample is not None)
    elif _clear(acting, size):
        palm = _by_image(view, acting, "palm")
        found = sample is not None and math.dist(sample.palm_m, palm[:2]) < FOUND_M
        tally.add("found", found)
        if found and sample is not None:
            _measure(tally, view, acting, sample)
    if second is not None and _clear(second, size):
        palm = _by_image(view, second, "palm")[:2]
        tally.add("second_found", any(math.dist(other.palm_m, palm) < FOUND_M for other in others))
    tally.add("others_imagined", len(others) > (second is not None))


def _measure(tally: Tally, view: View, hand: HandTruth, sample: HandSample) -> None:
    """Errors of a hand that was found."""
    for name, truth_m in (("palm", sample.palm_m), ("tips", sample.fingertips_m)):
        point = "palm" if name == "palm" else "pinch"
        tally.add(f"{name}_mm", 1e3 * math.dist(truth_m, hand.points_m[point][:2]))
        by_image = _by_image(view, hand, point)
        tally.add(f"{name}_image_mm", 1e3 * math.dist(truth_m, by_image[:2]))
        height_m = sample.height_m if name == "palm" else sample.fingertips_height_m
        if height_m is not None:
            same_height = view.on_plane(view.pixels(np.array([[*truth_m, height_m]])), hand.points_m[point][2])[0]
            tally.add(f"{name}_plane_mm", 1e3 * math.dist(same_height, by_image[:2]))
    if sample.deviation_m is not None:
        tally.add("palm_covered", math.dist(sample.palm_m, hand.points_m["palm"][:2]) <= sample.off_m)
        tally.add("palm_off_mm", 1e3 * sample.off_m)
        if sample.height_m is not None:
            height_m = WITHIN_HEIGHT * sample.deviation_m[2]
            tally.add("height_covered", abs(sample.height_m - hand.points_m["palm"][2]) <= height_m)
    if sample.height_m is not None:
        tally.add("height_mm", 1e3 * abs(sample.height_m - hand.points_m["palm"][2]))
    if sample.side is not None:
        tally.add("side", sample.side == hand.side)
    if sample.forearm_rad is not None:
        back = _by_image(view, hand, "wrist") - _by_image(view, hand, "palm")
        turn = sample.forearm_rad - math.atan2(back[1], back[0])
        tally.add("forearm_deg", abs(math.degrees(math.remainder(turn, 2 * math.pi))))
    tally.add("held", sample.held_part == hand.held_part)


def scores(tallies: Sequence[Tally]) -> dict[str, Any]:
    """Means of shares, medians and 95 % of the rest; intervals from drawing recordings again (bootstrap)."""
    rng = np.random.default_rng(RESAMPLING_SEED)
    draws = rng.integers(len(tallies), size=(RESAMPLES, len(tallies)))
    found: dict[str, Any] = {"recordings": len(tallies)}
    for name in dict.fromkeys(key for tally in tallies for key in tally.values):
        groups = [np.array(tally.values.get(name, [])) for tally in tallies]
        found[f"{name}_n"] = sum(len(group) for group in groups)
        figures = {"_p50": 50, "_p95": 95} if name.endswith(("_mm", "_ms", "_deg")) else {"": None}
        if name == "palm_mm":
            persons = [float(np.median(group)) for group in groups if len(group)]
            found["persons_palm_mm"] = [round(value, 1) for value in persons]
            found["persons_over"] = sum(value > OVER_MM for value in persons)
        for suffix, percent in figures.items():
            found[name + suffix] = round(_figure(np.concatenate(groups), percent), 4)
            drawn = [np.concatenate([groups[index] for index in draw]) for draw in draws]
            ends = np.percentile([_figure(sample, percent) for sample in drawn if len(sample)], (2.5, 97.5))
            found[f"{name}{suffix}_low"], found[f"{name}{suffix}_high"] = (round(float(end), 4) for end in ends)
    return found


def _figure(values: Array, percent: int | None) -> float:
    return float(values.mean() if percent is None else np.percentile(values, percent))


def _stretches(source: Source, count: int | None, seed: int) -> list[range]:
    """All frames of a recording, or this many stretches of them, spread over it."""
    moments = len(source.assembly.moments)
    if count is None:
        return every_frame(moments)
    rng = np.random.default_rng([seed, 8])
    edges = np.linspace(0, moments - STRETCH_FRAMES, count + 1).astype(int)
    begins = [int(rng.integers(low, max(low + 1, high))) for low, high in pairwise(edges)]
    return [range(begin, begin + STRETCH_FRAMES) for begin in begins]


def _clear(hand: HandTruth, size: Array) -> bool:
    points = np.array([hand.points_px["palm"], hand.points_px["pinch"]])
    inside = ((points >= EDGE_PX) & (points < size - EDGE_PX)).all()
    return bool(inside and hand.visible >= LEAST_VISIBLE)


def _by_image(view: View, hand: HandTruth, point: str) -> Array:
    """(x, y) where the camera, hung as believed, would see a point at its true height."""
    x_y: Array = view.on_plane(np.array([hand.points_px[point]]), hand.points_m[point][2])[0]
    return x_y


def _only(looks: LookRange, person: Mapping[str, object]) -> LookRange:
    if not person:
        return looks
    ends = [
        end.model_copy(update={"person": end.person.model_copy(update=dict(person))}) for end in (looks.low, looks.high)
    ]
    return looks.model_copy(update={"low": ends[0], "high": ends[1]})
