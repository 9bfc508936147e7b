"""Action detectors against the truth: whole recordings, every frame rendered, the configured tracker in the loop."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.learned.actions.events import PlacementEvents
from bracket_cell.learned.actions.model import TrainedActionDetector
from bracket_cell.learned.actions.segments import SegmentReader
from bracket_cell.learned.actions.settings import WHOLE_FRAMES, Classes
from bracket_cell.learned.bench_watcher import DetectorChain
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.settings import Perception
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.files.row_store import Row
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import Action, ActionDetector, HoleView, Segment
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.actions import segment_ends, write_segments
from bracket_lab.drawing.hands import visible_shares
from bracket_lab.drawing.placed import placed
from bracket_lab.drawing.recording import Source, record
from bracket_lab.drawing.working_arm import WorkingArm
from bracket_lab.evaluations.hands import LEAST_VISIBLE
from bracket_lab.evaluations.holes_and_parts import calibrated_bench
from bracket_lab.learned.actions.data import load_segments
from bracket_lab.learned.actions.evaluate import answers
from bracket_lab.learned.scores import share
from bracket_sim.scene.settings import settings_of

IN_TIME_S = (-0.3, 1.0)  # a placement may be told so long after the fingers opened
Told = tuple[float, str, str]  # (time, part, position)


def matched(placed: Iterable[Told], found_acts: Iterable[Told]) -> list[float]:
    """Delays of what was told in time with the right part and hole."""
    return [delay_s for delay_s in delays(placed, found_acts) if delay_s is not None]


def delays(placed: Iterable[Told], reported: Iterable[Told]) -> list[float | None]:
    """How late each placement was told, in time with the right part and hole, or None; what was told counts once."""
    left, found = list(reported), list[float | None]()
    for time_s, *what in placed:
        fits = (number for number, event in enumerate(left) if list(event[1:]) == what and _in_time(event[0] - time_s))
        number = next(fits, None)
        found.append(None if number is None else left.pop(number)[0] - time_s)
    return found


def _in_time(delay_s: float) -> bool:
    return IN_TIME_S[0] <= delay_s <= IN_TIME_S[1]


@dataclass
class Tally:
    """What one kind of detector answered, over all recordings.

    Attributes:
        rows: of each segment: class as it was, class as it was named, whether it lies in the guard band.
        hidden: of each segment whether less than half of the hand shows in its last frame; empty where nobody looked.
        placed, told, right: placements that were, that were told, and those told in time with the right part and hole.
        told_by_hand, right_by_hand: what the network alone would have told, without the witness of the holes.
        placed_hidden, right_hidden: those of them before which less than half of the hand showed.
        latency_s: processor time of each frame's answer, tracker and hole reader included.
    """

    rows: list[tuple[int, int, bool]] = field(default_factory=list)
    hidden: list[bool] = field(default_factory=list)
    placed: int = 0
    told: int = 0
    right: int = 0
    told_by_hand: int = 0
    right_by_hand: int = 0
    placed_hidden: int = 0
    right_hidden: int = 0
    delays_s: list[float] = field(default_factory=list)
    latency_s: list[float] = field(default_factory=list)

    def add(self, other: Mapping[str, Any]) -> None:
        """What was answered in more recordings, as `dataclasses.asdict` or a line of JSON has it."""
        for name, value in other.items():
            setattr(self, name, getattr(self, name) + value)

    def shares(self, classes: Classes) -> dict[str, Any]:
        """Shares of segments that were named right, with their intervals, and what was taken for what."""
        truth, named, guarded = (np.array(column) for column in zip(*self.rows, strict=True))
        right, clear = truth == named, ~guarded
        placing = (truth < classes.assemblies) & clear
        shares = {"all_segments": right, "outside_guard": right[clear], "assemblies": right[placing]}
        for index, kind in enumerate(("screw", "transit", "idle")):
            shares[kind] = right[(truth == classes.assemblies + index) & clear]
        if self.hidden:
            shares["outside_guard_seen"] = right[clear & ~np.array(self.hidden)]
        found: dict[str, Any] = {name: share(int(values.sum()), len(values)) for name, values in shares.items()}
        return found | {"confusions": _confusions(truth[clear], named[clear], classes)}

    def summary(self, classes: Classes) -> dict[str, Any]:
        """Shares with their intervals, as the JSON line has them."""
        found = self.shares(classes)
        confusions = found.pop("confusions")
        return found | {
            "placements": share(self.right, self.placed),
            "placements_seen": share(self.right - self.right_hidden, self.placed - self.placed_hidden),
            "false_per_100": round(100 * (self.told - self.right) / max(1, self.placed), 2),
            "placements_by_hand": share(self.right_by_hand, self.placed),
            "false_per_100_by_hand": round(100 * (self.told_by_hand - self.right_by_hand) / max(1, self.placed), 2),
            "delay_s": round(float(np.median(self.delays_s)), 3) if self.delays_s else None,
            "latency_ms": [round(1000 * float(np.quantile(self.latency_s, at)), 1) for at in (0.5, 0.95)],
            "confusions": confusions,
        }

    def reports(self, classes: Classes) -> list[tuple[tuple[str, str], tuple[str, str]]]:
        """Assemblies outside the guard band that were named as assemblies: (part, position) as it was, and as named."""

        def pair(number: int) -> tuple[str, str]:
            part, position = divmod(number, len(classes.positions))
            return classes.parts[part], classes.positions[position]

        last = classes.assemblies
        return [(pair(was), pair(said)) for was, said, near in self.rows if not near and was < last and said < last]


def summed(kinds: Sequence[str], rows: Sequence[Row]) -> dict[str, Tally]:
    """What each kind answered in all recordings: `rows` with `kinds`, each a tally as data."""
    tallies = {name: Tally() for name in kinds}
    for row in rows:
        of_kinds: Any = row["kinds"]
        for name, tally in tallies.items():
            tally.add(of_kinds[name])
    return tallies


def at_pace(configuration: Configuration, pace: float | None) -> Configuration:
    """The same cell with a person who moves this many times as fast; None leaves the person's own pace."""
    if pace is None:
        return configuration
    devices = configuration.devices
    person = settings_of(devices.simulation).person.model_copy(update={"pace": (pace, pace)})
    simulation = settings_of(devices.simulation).model_copy(update={"person": person})
    return configuration.model_copy(update={"devices": devices.model_copy(update={"simulation": simulation})})


def evaluate_actions(
    configuration: Configuration,
    product: Product,
    kinds: Iterable[str],
    seeds: Iterable[int],
    *,
    physics: bool = False,
    weights: Mapping[str, Any] | None = None,
    calibrated: bool = True,
) -> dict[str, Tally]:
    """Let detectors watch recordings.

    Args:
        kinds: of action detectors; all of them see the same frames. "classical" has classical hands and holes, too.
        weights: files by kind, instead of the shipped ones.
        calibrated: the cameras were calibrated in each look, as by `cell setup calibrate`; else they hang elsewhere
            than the bench file says, as the look has it.
    """
    classes = Classes.of(product)
    tallies = {kind: Tally() for kind in kinds}
    for seed in seeds:
        assembly = record(
            product, configuration.bench, settings_of(configuration.devices.simulation), seed, physics=physics
        )
        source = Source(assembly, product, configuration.bench)
        bench = calibrated_bench(configuration, product, seed) if calibrated else configuration.bench
        believed = configuration.model_copy(update={"bench": bench})
        watchers = {kind: _Watcher(believed, source, kind, (weights or {}).get(kind)) for kind in tallies}
        photographer = assembly.photographer(configuration.bench)
        arm = WorkingArm(assembly.world, bench.arm_look_rad, np.random.default_rng(seed))
        for moment in assembly.moments:
            frame = photographer.take(moment.exposure).beside(arm.points_m(moment.exposure.moments[-1], None))
            for watcher in watchers.values():
                watcher.watch(frame)
        photographer.close()
        for kind, watcher in watchers.items():
            _count(tallies[kind], source, watcher, classes)
    return tallies


def evaluate_segments(
    configuration: Configuration, product: Product, kind: str, seeds: Iterable[int], weights: Path | None = None
) -> dict[str, Any]:
    """Class scores from the segments' last frames alone, of which few are rendered; track with a tracker's noise.

    Beside them the controls: black crops, and tracks whose frames are in another order.
    """
    classes, reader = Classes.of(product), SegmentReader(configuration.bench, product)
    file = configuration.perception.with_detector("actions", kind, weights).weights("actions")
    network = OnnxModel.load(file, f"actions.{kind}")
    network.require_vocabulary("parts", classes.parts)
    with tempfile.TemporaryDirectory() as made:
        folder = DataFolder(Path(made) / "segments", "cell lab eval actions")
        for seed in seeds:
            assembly = record(product, configuration.bench, settings_of(configuration.devices.simulation), seed)
            write_segments(Source(assembly, product, configuration.bench), folder, frames=kind in WHOLE_FRAMES)
        segments = load_segments([Path(made) / "segments"], classes)
    found: dict[str, Any] = {}
    controls = {"": {}, "blank_crop": {"blank": True}, "shuffled_track": {"shuffle_seed": 0}}
    for name, control in controls.items():
        posterior, _ = answers(network, segments, reader, noise_seed=0, **control)  # type: ignore[arg-type]
        named = posterior.argmax(axis=1)
        rows = list(zip(segments.classes.tolist(), named.tolist(), segments.guarded.tolist(), strict=True))
        scores = Tally(rows=rows).shares(classes)
        found |= scores if not name else {name: {key: scores[key] for key in ("outside_guard", "assemblies")}}
    return found


class _Watcher:
    """A chain of detectors, and what it named and told."""

    def __init__(self, configuration: Configuration, source: Source, kind: str, weights: Any) -> None:
        configured = configuration.perception
        perception = configured.with_detector("actions", kind, weights)
        if kind == "classical":
            perception = Perception(classical=configured.classical)
        made = Detectors(configuration.bench, source.product, perception)
        self.listener = _Listener(made.make("actions"), Classes.of(source.product))
        hands, holes = made.make("hands"), made.make("holes")
        self._chain = DetectorChain(configuration.bench, source.product, hands, holes, self.listener)
        self.latency_s: list[float] = []
        self.told: list[Told] = []
        self.told_by_hand: list[Told] = []
        self._before: Action | None = None

    def watch(self, frame: Frame) -> None:
        """One more frame."""
        began_s = time.process_time()
        action = self._chain.watch(frame).action
        self.latency_s.append(time.process_time() - began_s)
        before, self._before = self._before, action if action.finished else None
        new = before is None or (before.part, before.position) != (action.part, action.position)
        if action.finished and new and action.part and action.position:
            self.told.append((frame.time_s, action.part, action.position))
        if (event := self.listener.by_hand(frame.time_s)) is not None:
            self.told_by_hand.append(event)


class _Listener:
    """An action detector that keeps the class that each segment alone was named, and what the hand alone tells."""

    def __init__(self, detector: ActionDetector, classes: Classes) -> None:
        self._detector, self._classes = detector, classes
        self.named: list[int] = []
        self._events = None
        if isinstance(detector, TrainedActionDetector):
            self._events = PlacementEvents(classes, detector.settings)

    def by_hand(self, time_s: float) -> Told | None:
        """The placement that the last frame finishes, had nobody looked at the holes; asked once for every frame."""
        detector = self._detector
        if self._events is None or not isinstance(detector, TrainedActionDetector):
            return None
        placed = self._events.update(time_s, detector.last_posterior, detector.last_released)
        names = self._classes
        return None if placed is None else (time_s, names.parts[placed.part], names.positions[placed.position])

    def detect(self, segment: Segment, holes: Mapping[str, HoleView]) -> Action:
        action = self._detector.detect(segment, holes)
        if isinstance(self._detector, TrainedActionDetector):
            self.named.append(int(self._detector.last_posterior.argmax()))
        else:
            self.named.append(self._classes.number(action.kind, action.part, action.position))
        return action


def _count(tally: Tally, source: Source, watcher: _Watcher, classes: Classes) -> None:
    assembly = source.assembly
    ends = list(segment_ends(assembly))
    for end in ends:
        label = assembly.labels[end]
        number = classes.number(label.kind, label.part, label.position)
        tally.rows.append((number, watcher.listener.named[end], assembly.guarded[end]))
    tally.hidden += [share < LEAST_VISIBLE for share in visible_shares(source, ends)]
    made = placed(source)
    events = [(assembly.moments[number].time_s, part, position) for number, part, position in made]
    hidden = [_hidden(source, number) for number, _, _ in made]
    delays_s = delays(events, watcher.told)
    tally.placed += len(events)
    tally.placed_hidden += sum(hidden)
    tally.right += sum(delay_s is not None for delay_s in delays_s)
    tally.right_hidden += sum(delay_s is not None for delay_s, hid in zip(delays_s, hidden, strict=True) if hid)
    tally.delays_s += [delay_s for delay_s in delays_s if delay_s is not None]
    tally.told += len(watcher.told)
    tally.told_by_hand += len(watcher.told_by_hand)
    tally.right_by_hand += len(matched(events, watcher.told_by_hand))
    tally.latency_s += watcher.latency_s


def _hidden(source: Source, number: int) -> bool:
    """Whether less than half of the hand showed for most of the second before a moment."""
    last = range(max(0, number - round(source.bench.overhead.rate_hz)), number + 1)
    return float(np.median(visible_shares(source, last))) < LEAST_VISIBLE


def _confusions(truth: Any, named: Any, classes: Classes) -> dict[str, int]:
    """How often which class was taken for which other one, the most frequent first."""
    names = classes.names
    wrong = [f"{names[was]} > {names[said]}" for was, said in zip(truth, named, strict=True) if was != said]
    counts = {pair: wrong.count(pair) for pair in set(wrong)}
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))
