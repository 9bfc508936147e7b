"""Which detectors a configuration gets: one kind for all, or each chosen by itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration, load_product
from bracket_cell.kinds import DETECTORS, TRAINED_DEFAULTS, Kind
from bracket_cell.learned.classical.action_detector import ClassicalActionDetector
from bracket_cell.learned.classical.hand_tracker import ClassicalHandTracker
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.learned.parts.model import CENTRE_KIND, CentrePartDetector
from bracket_cell.settings import Perception
from bracket_cell.wiring import detectors
from bracket_cell.wiring.detectors import (
    BESIDE_S,
    UNKNOWN_LATENCY_S,
    Detectors,
    bench_watcher,
    check_detectors,
    detectors_for,
    latency_s,
    part_finder,
    tray_view,
)
from bracket_ground.errors import InputError, ModelError, SettingError
from bracket_ground.interfaces.bench import CameraCalibration
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample, PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_lab.drawing.trays import TrayCamera
from bracket_sim.scene.clutter import sample_clutter
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.posture import whole
from bracket_sim.scene.settings import ClutterSettings

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
HAND = HandSample(0.0, (10, 10, 60, 60), (0.7, 0.1), (0.8, 0.1))


@dataclass
class Found:
    """A tracker that sees a hand everywhere."""

    weights: Path
    others: tuple[HandSample, ...] = ()

    def track(self, frame: Frame) -> HandSample | None:
        del frame
        return HAND


def test_the_short_form_chooses_every_detector_and_each_may_be_another_kind() -> None:
    own = Perception.model_validate({"kind": "learned", "hands": {"kind": "classical"}})
    assert [own.chosen(task).kind for task in TRAINED_DEFAULTS] == ["classical", *list(TRAINED_DEFAULTS.values())[1:]]
    assert {Perception(kind="classical").chosen(task).kind for task in TRAINED_DEFAULTS} == {"classical"}
    assert own.words == "learned, hands classical"


def test_a_trained_tracker_works_beside_classical_detectors(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Path] = []

    def maker(weights: Path) -> Found:
        made.append(weights)
        return Found(weights)

    monkeypatch.setitem(DETECTORS["hands"], "ideal", maker)
    perception = Perception.model_validate(
        {"kind": "classical", "hands": {"kind": "ideal", "weights": "/some/file.onnx"}}
    )
    assert isinstance(Detectors(BENCH, PRODUCT, perception).make("actions"), ClassicalActionDetector)
    assert isinstance(Detectors(BENCH, PRODUCT, Perception(kind="classical")).make("hands"), ClassicalHandTracker)
    image = np.full((BENCH.overhead.height_px, BENCH.overhead.width_px, 3), 90, np.uint8)
    view = bench_watcher(BENCH, PRODUCT, perception)(Frame("overhead", 3, 0.2, image, Pose((0.0, 0.0, 1.0))))
    assert view.hand is not None
    assert view.hand.box_px == HAND.box_px
    assert made == [Path("/some/file.onnx")]


def test_hands_are_looked_for_by_the_camera_as_it_was_calibrated(monkeypatch: pytest.MonkeyPatch) -> None:
    """The driver tells the mount of the bench file; what a calibration found counts for every detector."""
    seen: list[Frame] = []

    @dataclass
    class Watching(Found):
        def track(self, frame: Frame) -> HandSample | None:
            seen.append(frame)
            return HAND

    monkeypatch.setitem(DETECTORS["hands"], "ideal", Watching)
    perception = Perception.model_validate(
        {"kind": "classical", "hands": {"kind": "ideal", "weights": "/some/file.onnx"}}
    )
    drawn = BENCH.overhead.mount
    moved = drawn.model_copy(update={"position_m": (drawn.position_m[0] + 0.02, *drawn.position_m[1:])})
    found = CameraCalibration(mount=moved, focal_px=BENCH.overhead.focal_px, distortion_k1=0.0)
    bench = BENCH.model_copy(update={"overhead": BENCH.overhead.calibrated(found)})
    image = np.full((BENCH.overhead.height_px, BENCH.overhead.width_px, 3), 90, np.uint8)
    bench_watcher(bench, PRODUCT, perception)(Frame("overhead", 0, 0.0, image, drawn.pose))
    bench_watcher(BENCH, PRODUCT, perception)(Frame("overhead", 0, 0.0, image, drawn.pose))
    assert seen[0].world_from_camera.position_m == pytest.approx(moved.position_m)
    assert seen[1].world_from_camera == drawn.pose


def test_unknown_kinds_and_weights_that_do_not_fit_are_told_together(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(weights: Path) -> object:
        raise ModelError(f"{weights}: damaged")

    monkeypatch.setitem(DETECTORS["parts"], "centre", Kind(broken, card=True))
    perception = Perception.model_validate({"parts": {"kind": "centre"}, "actions": {"kind": "guess"}})
    with pytest.raises(SettingError) as told:
        check_detectors(BENCH, PRODUCT, perception)
    assert [place for place, _ in told.value.places] == [("perception", "actions", "kind"), ("perception", "parts")]
    assert "no kind 'guess' of actions; legal: slim, classical, paper, or MODULE:CLASS" in str(told.value)
    assert "parts_centre.onnx: damaged" in str(told.value)


def test_weights_stand_beside_the_configuration(tmp_path: Path) -> None:
    text = DEFAULT_CONFIGURATION.read_text().replace("simulation: sim.yaml", "")
    text = text.replace("  kind: learned", "  kind: learned\n  parts: {kind: centre, weights: mine.onnx}\n #")
    (tmp_path / "cell.yaml").write_text(text)
    assert load_configuration(tmp_path / "cell.yaml").perception.weights("parts") == tmp_path / "mine.onnx"
    (tmp_path / "wrong.yaml").write_text(text.replace("kind: learned", "kind: guesses"))
    with pytest.raises(InputError, match="perception"):
        load_configuration(tmp_path / "wrong.yaml")


def test_a_product_that_no_weights_know_is_seen_by_colour_and_that_is_said() -> None:
    learned = Perception(kind="learned")
    assert detectors_for(learned, PRODUCT) == (learned, "")
    first, *others = PRODUCT.parts.items()
    other = PRODUCT.model_copy(update={"parts": {"valve": first[1], **dict(others)}})
    found, told = detectors_for(learned, other)
    assert found.kind == "classical"
    assert found.chosen("hands").kind == "slim"  # a hand has no part names
    assert "knows the parts o1, o2, o3, and this product has valve, o2, o3" in told
    assert "cell train --all" in told
    own = {task: {"kind": kind} for task, kind in TRAINED_DEFAULTS.items()}
    chosen = Perception.model_validate({"kind": "learned", **own})
    assert detectors_for(chosen, other) == (chosen, "")  # what was chosen by itself is checked, not replaced


@pytest.mark.parametrize("look", ["none", "nominal"])
def test_a_run_in_which_no_detector_sees_says_nothing_of_detectors(
    look: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tree := tmp_path / "a.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree></root>'
    )
    config = str(DEFAULT_CONFIGURATION.parent / "examples" / "layers" / "cell.yaml")
    assert main(["run", str(tree), "--config", config, "--look", look, "--log", str(tmp_path / "a.mcap")]) == 0
    assert ("classical (colours, outlines)" in "".join(capsys.readouterr())) == (look == "nominal")


def test_answers_come_as_late_as_the_cards_of_the_detectors_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    noted = {"hands": 3.0, "holes": 1.0, "actions": 2.0}
    monkeypatch.setattr(detectors, "_noted_ms", lambda _, task: noted.get(task))
    learned = Perception(kind="learned")
    assert latency_s(learned, "hands", "holes", "actions") == pytest.approx(0.006 + BESIDE_S)
    assert latency_s(learned, "parts") == UNKNOWN_LATENCY_S
    assert latency_s(Perception(kind="learned", latency_s=0.2), "parts") == 0.2


def test_every_shipped_card_tells_how_late_its_answers_are() -> None:
    """Training anew forgets it, and simulated answers would be as late as those of detectors that nobody measured."""
    perception = load_configuration().perception
    for task, kind in TRAINED_DEFAULTS.items():
        assert OnnxModel.load(perception.weights(task), f"{task}.{kind}").card.scores.get(detectors.LATENCY_SCORE), task


@pytest.mark.parametrize(
    ("kind", "floor_m", "wanted_m"), [("learned", 0.0, 0.0235), ("learned", 0.1, 0.1), ("classical", 0.0, 0.06)]
)
def test_separation_counts_with_the_errors_of_the_chosen_hand_tracker(
    kind: str, floor_m: float, wanted_m: float
) -> None:
    configuration = load_configuration()
    separation = configuration.motion.separation.model_copy(update={"hand_error_m": floor_m})
    motion = configuration.motion.model_copy(update={"separation": separation})
    perception = configuration.perception.model_copy(update={"kind": kind})
    cell = configuration.model_copy(update={"motion": motion, "perception": perception})
    found, _ = detectors.with_detectors_for(cell, load_product(configuration))
    assert found.motion.separation.hand_error_m == pytest.approx(wanted_m, abs=1e-3)


@pytest.mark.parametrize("task", list(DETECTORS))
def test_every_network_that_a_detector_opens_is_one_that_the_log_names(
    task: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Path] = []
    load = OnnxModel.load

    def noting(path: Path, kind: str) -> OnnxModel:
        opened.append(path)
        return load(path, kind)

    monkeypatch.setattr(OnnxModel, "load", staticmethod(noting))
    perception = CONFIGURATION.perception.model_copy(update={"kind": "learned"})
    Detectors(BENCH, PRODUCT, perception).make(task)
    assert opened
    assert set(opened) == set(perception.files(task).values())
    assert Perception(kind="classical").files(task) == {}


def looked_at(scene: tuple[ScenePart, ...]) -> PartsView:
    """What the default detector finds in an image of a tray."""
    image, pose = TrayCamera(PRODUCT, BENCH).take([(part.part, part.world_from_part) for part in scene])
    return part_finder(BENCH, PRODUCT, CONFIGURATION.perception)(Frame("wrist", 0, 0.0, image, pose))


@pytest.mark.parametrize("poses", [True, False])
def test_a_detector_of_boxes_alone_takes_nothing_for_lying_that_may_stand(poses: bool) -> None:
    """The arm would set a part upright that stands already, again and again."""
    scene = sample_clutter(
        PRODUCT, BENCH.tray, ["o1", "o2", "o3"], np.random.default_rng(900), ClutterSettings(lying_share=0.5)
    )
    image, pose = TrayCamera(PRODUCT, BENCH).take([(part.part, part.world_from_part) for part in scene])
    detector = Detectors(BENCH, PRODUCT, CONFIGURATION.perception).make("parts")
    if not poses:
        boxes = OnnxModel.load(CONFIGURATION.perception.files("parts")["parts"], CENTRE_KIND)
        detector = CentrePartDetector(BENCH, PRODUCT, boxes, None)
    view = tray_view(BENCH, PRODUCT, detector)(Frame("wrist", 0, 0.0, image, pose))
    assert len(view.seen) >= len(scene)
    assert any(part.lies is not None for part in view.others) == poses
    assert bool(view.detections) == poses


@pytest.mark.parametrize("seed", [900, 901, 902])
def test_what_lies_in_the_tray_is_told_as_a_box_that_holds_it(seed: int) -> None:
    types, settings = ["o1", "o2", "o3", "o2"], ClutterSettings(lying_share=0.5)
    scene = sample_clutter(PRODUCT, BENCH.tray, types, np.random.default_rng(seed), settings)
    view = looked_at(scene)
    lying = [part for part in scene if part.world_from_part.rotation[2, 2] < 0.9]
    assert len(view.others) == len(lying) > 0
    assert view.seen[: len(view.detections)] == view.detections
    for part in lying:
        points = [solid.points() for solid in whole(PRODUCT.parts[part.part])]
        outline = part.world_from_part.transform(np.concatenate(points))
        middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
        box = min(view.others, key=lambda other: float(np.hypot(*(other.world_from_part.position_m - middle)[:2])))
        inside, half = box.world_from_part.inverse().transform(outline), np.array(box.size_m)[:2] / 2
        assert (np.abs(inside[:, :2]) < half + 0.005).all(), "the box lacks more than 5 mm"
        assert (half < np.ptp(inside[:, :2], axis=0) / 2 + 0.02).all(), "the box is far too large"
        assert box.world_from_part.position_m[2] + box.size_m[2] > outline[:, 2].max() - 0.004


def test_a_tray_in_which_all_stands_has_nothing_that_lies() -> None:
    for seed in (910, 911):
        scene = sample_clutter(PRODUCT, BENCH.tray, ["o1", "o2", "o3", "o1"], np.random.default_rng(seed))
        assert looked_at(scene).others == ()
