"""Makes the detectors that the configuration names, and the executors that run them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial
from typing import Any

from bracket_cell.configuration import Configuration
from bracket_cell.kinds import DETECTORS, WEIGHTS, kind_of, made
from bracket_cell.learned.bench_watcher import ClassicalDetectors, DetectorChain
from bracket_cell.learned.calibration.check import TrayCheck
from bracket_cell.learned.classical.box_model import check_image
from bracket_cell.learned.hands.mediapipe.hands import FETCH
from bracket_cell.learned.inference.onnx_model import ModelCard, OnnxModel
from bracket_cell.learned.parts.lying_parts import LyingPartResolver
from bracket_cell.remote.detecting import Detect, DetectByCamera, pixel_shape
from bracket_cell.remote.worker import await_ready
from bracket_cell.running.inference import DelayedExecutor, DetectorExecutor, Executor, LockStep
from bracket_cell.settings import Perception
from bracket_ground.errors import ModelError, SettingError
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import BenchView, HandSample, HoleView, PartDetector, PartsView
from bracket_ground.interfaces.product import Product

LATENCY_SCORE = "latency_ms_p95"  # of a model card: processor time of a frame's answer
BESIDE_S = 0.01  # health of image and track, calibration, and the way between processes
UNKNOWN_LATENCY_S = 0.1  # of detectors whose cards do not tell
ERROR_SCORES = ("palm_p95_mm", "pinch_p95_mm")  # of the hand tracker's card
UNKNOWN_ERROR_M = 0.06  # of a hand tracker whose card does not tell: what is farther off counts as not found


SILENT_S = {"overhead": 0.5, "wrist": 1.0}  # so long a detector may take at real pace; then the cell holds


def detectors_of(
    bench: Bench, product: Product, perception: Perception, cameras: Sequence[str] = ("overhead", "wrist")
) -> DetectByCamera:
    """What answers the frames of these cameras; made in the process in which it works."""
    makers: dict[str, Callable[..., Detect]] = {"overhead": bench_watcher, "wrist": part_finder}
    return {camera: makers[camera](bench, product, perception) for camera in cameras}


def bench_watcher(bench: Bench, product: Product, perception: Perception) -> Callable[[Frame], BenchView]:
    """What answers overhead frames."""
    detectors = Detectors(bench, product, perception)
    hands, holes, actions = (detectors.make(task) for task in ("hands", "holes", "actions"))
    return DetectorChain(bench, product, hands, holes, actions, detectors.places())


def part_finder(bench: Bench, product: Product, perception: Perception) -> Callable[[Frame], PartsView]:
    """What answers wrist frames."""
    return tray_view(bench, product, Detectors(bench, product, perception).make("parts"))


def tray_view(bench: Bench, product: Product, detector: PartDetector) -> Callable[[Frame], PartsView]:
    """What answers wrist frames with this detector: it also fits how those lie that do not stand."""
    check, lying = TrayCheck(bench), LyingPartResolver(bench, product)
    fitted = getattr(detector, "tells_standing", True)

    def find(frame: Frame) -> PartsView:
        check_image(bench.wrist.model, frame)
        placed = frame.seen_from(bench.wrist.corrected(frame.world_from_camera))
        standing, others = lying.sort(placed, detector.detect(placed), fitted=fitted)
        return PartsView(frame.sequence, frame.time_s, standing, others, check.judge(placed))

    return find


class Detectors:
    """Makes the chosen detector for each task, by the task's key in the configuration."""

    def __init__(self, bench: Bench, product: Product, perception: Perception) -> None:
        self._bench, self._product, self._perception = bench, product, perception
        self._classical = ClassicalDetectors(bench, product, perception.classical)

    def make(self, task: str) -> Any:
        """HandTracker, HoleReader, ActionDetector or PartDetector for hands, holes, actions or parts.

        Raises:
            SettingError: there is no such kind, or its weights are missing or do not fit the product.
        """
        perception, given = self._perception, {"bench": self._bench, "product": self._product}
        chosen, folder = perception.chosen(task), perception.folder or WEIGHTS
        try:
            detector = made(task, chosen, folder, classical=self._classical, **given)
        except ModelError as error:
            raise SettingError((("perception", task), str(error))) from error
        return self._with_crops(task, detector)

    def places(self) -> Callable[[Frame, HandSample | None], Mapping[str, HoleView]]:
        """Reads the places that the overhead camera sees."""
        return self._classical.places().read

    def _with_crops(self, task: str, detector: Any) -> Any:
        """The part detector with the features of crops that a grasp planner wants; others as they are."""
        if task != "parts" or self._perception.crops is None:
            return detector
        from bracket_cell.learned.grasp.crops import CropReader

        try:
            return CropReader.load(detector, self._bench, self._perception.crops)
        except ModelError as error:
            raise SettingError((("planners", "grasp"), str(error))) from error


def detectors_for(perception: Perception, product: Product) -> tuple[Perception, str]:
    """The detectors that this product can have, and what people should know of it; empty where there is nothing.

    Detectors that are chosen all at once as `learned` know the part types and positions that their weights were trained
    for. For another product they are classical, until somebody trains them; hands are the same for every product, but
    what they hold has no type. One that is chosen by itself stays.

    Raises:
        SettingError: weights cannot be read, or there is no such kind.
    """
    if perception.kind != "learned":
        return perception, ""
    wanted = {"parts": tuple(product.parts), "positions": product.positions}
    for task in DETECTORS:
        if getattr(perception, task) is not None:
            continue
        try:
            card, path = card_of(perception, task), perception.weights(task)
        except ModelError as error:
            raise SettingError((("perception", "kind"), str(error))) from error
        known = {} if card is None or task == "hands" else card.vocabulary
        for use, words in wanted.items():
            if known.get(use, words) != words:
                text = f"{path.name} knows the {use} {', '.join(known[use])}, and this product has {', '.join(words)}"
                others = [other for other in DETECTORS if other != "hands" and getattr(perception, other) is None]
                what = f"classical (colours, outlines): {', '.join(others)}: {text}; `cell train --all` trains others"
                hands = perception.chosen("hands")
                return perception.model_copy(update={"kind": "classical", "hands": hands}), what
    return perception, ""


def for_camera(perception: Perception, real: bool) -> tuple[Perception, str]:
    """The hand tracker for a real overhead camera, where none is chosen, and what people should know of it.

    Hands of real people are looked for by two sources, if MediaPipe's networks were fetched; drawn ones by ours alone.
    """
    if not real or perception.kind != "learned" or perception.hands is not None:
        return perception, ""
    both = perception.with_detector("hands", "both")
    if missing := [path for path in both.files("hands").values() if not path.is_file()]:
        what = f"hands are looked for by {perception.chosen('hands').kind} alone, which misses many that MediaPipe sees"
        return perception, f"{what}: {missing[0].name} is not there; fetch it once with: {FETCH}"
    return both, ""


def with_detectors_for(configuration: Configuration, product: Product) -> tuple[Configuration, str]:
    """The configuration with the detectors that this product can have, and a separation that knows their errors.

    Raises:
        SettingError: see `detectors_for`.
    """
    real = "overhead" not in configuration.devices.simulated
    perception, of_hands = for_camera(configuration.perception, real)
    perception, notice = detectors_for(perception, product)
    separation = configuration.motion.separation
    error_m = max(separation.hand_error_m, hand_error_m(perception))
    separation = separation.model_copy(update={"hand_error_m": error_m})
    motion = configuration.motion.model_copy(update={"separation": separation})
    changed = configuration.model_copy(update={"perception": perception, "motion": motion})
    return changed, "\n".join(words for words in (of_hands, notice) if words)


def hand_error_m(perception: Perception) -> float:
    """95 % of the hand tracker's errors along the bench, as measured for its card; large where nothing is known."""
    scores: Mapping[str, float] = {}
    with suppress(ModelError):  # who makes the detector says what is wrong with its weights
        scores = _scores(perception, "hands")
    return max(scores.get(name, UNKNOWN_ERROR_M * 1e3) for name in ERROR_SCORES) / 1e3


def check_detectors(bench: Bench, product: Product, perception: Perception) -> None:
    """Make each detector once, before any device is opened.

    Raises:
        SettingError: with every problem.
    """
    detectors, problems = Detectors(bench, product, perception), []
    for task in DETECTORS:
        try:
            detectors.make(task)
        except SettingError as error:
            problems += [place for place in error.places if place not in problems]
    if problems:
        raise SettingError(*problems)


def lock_step(
    bench: Bench, product: Product, perception: Perception, devices: Devices
) -> tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]]:
    """Executors for simulation: answers come as much later in clock time as the detectors take.

    The detectors run beside the physics where the devices have them there; the answers are the same.
    """
    clock, arguments = devices.clock, (bench, product, perception)
    watched_s, found_s = latency_s(perception, "hands", "holes", "actions"), latency_s(perception, "parts")
    if devices.host is None:
        watch, find = bench_watcher(*arguments), part_finder(*arguments)
        return LockStep(watch, clock, watched_s), LockStep(find, clock, found_s)
    devices.host.await_ready()
    begin: Any = devices.host.begin  # the answer is that of the camera
    return DelayedExecutor(begin, clock, watched_s), DelayedExecutor(begin, clock, found_s)


def latency_s(perception: Perception, *tasks: str) -> float:
    """Time from a frame to the answer of these detectors together: what the configuration says, else their cards.

    Raises:
        ModelError: weights cannot be read.
    """
    if perception.latency_s is not None:
        return perception.latency_s
    found_ms = [_noted_ms(perception, task) for task in tasks]
    known_ms = [value for value in found_ms if value is not None]
    return sum(known_ms) / 1e3 + BESIDE_S if len(known_ms) == len(tasks) else UNKNOWN_LATENCY_S


def _noted_ms(perception: Perception, task: str) -> float | None:
    """The p95 of a trained detector's card, from `cell lab eval latency --note`; None where there is none."""
    return _scores(perception, task).get(LATENCY_SCORE)


def _scores(perception: Perception, task: str) -> Mapping[str, float]:
    """What is known of a detector: by its model card, or by its class."""
    card = card_of(perception, task)
    return kind_of(task, perception.chosen(task)).scores if card is None else card.scores


def card_of(perception: Perception, task: str) -> ModelCard | None:
    """The model card of a detector; None where its kind has none.

    Raises:
        SettingError: there is no such kind.
        ModelError: its weights cannot be read.
    """
    chosen = perception.chosen(task)
    if not kind_of(task, chosen).card:
        return None
    return OnnxModel.load(perception.weights(task), f"{task}.{chosen.kind}").card


@contextmanager
def worker_processes(
    bench: Bench,
    product: Product,
    perception: Perception,
    glance: Callable[[], object] = lambda: None,
    slower: float = 1.0,
) -> Iterator[tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]]]:
    """Executors for real time: each detector in a process of its own, ready to answer.

    Args:
        glance: see `await_ready`.
        slower: so many times slower than the wall's goes the run's clock, and so do limits.

    Raises:
        CellError: a detector cannot be made, or does not get ready.
    """

    def executor(name: str, camera: str, setup: CameraSetup) -> DetectorExecutor[Any]:
        detect = partial(detectors_of, bench, product, perception, (camera,))
        return DetectorExecutor(name, camera, pixel_shape(setup), detect, SILENT_S[camera] * slower)

    with (
        closing(executor("bench watcher", "overhead", bench.overhead)) as watcher,
        closing(executor("part detector", "wrist", bench.wrist)) as finder,
    ):
        await_ready(watcher.process, finder.process, glance=glance)
        yield watcher, finder
