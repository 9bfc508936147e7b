"""A few steps of training: every network learns what is drawn, is exported, and answers alike in onnxruntime."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bracket_cell.learned.actions.settings import Classes
from bracket_ground.errors import InputError, ModelError
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, HandSample, Segment
from tests.learned.actions.drawn import BENCH, HOLES_M, PRODUCT, write_folder

pytestmark = pytest.mark.torch
CLASSES = Classes.of(PRODUCT)


def placing(at: int) -> Segment:
    """A hand that goes to a hole, over grey images."""
    camera = BENCH.overhead
    image = np.full((camera.height_px, camera.width_px, 3), 70, np.uint8)
    tips = np.linspace(HOLES_M[at] + np.array([0.25, 0.05]), HOLES_M[at], SEGMENT_FRAMES)
    return Segment(
        tuple(Frame("overhead", i, i / 15, image, camera.mount.pose) for i in range(SEGMENT_FRAMES)),
        tuple(HandSample(i / 15, (0, 0, 9, 9), (x, y), (x + 0.1, y)) for i, (x, y) in enumerate(tips)),
    )


@pytest.mark.slow
def test_slim_learns_and_its_file_answers_in_a_detector(tmp_path: Path) -> None:
    from bracket_cell.learned.actions.model import load_actions
    from bracket_cell.learned.actions.settings import ActionTraining
    from bracket_lab.learned.actions.data import load_segments
    from bracket_lab.learned.actions.train import Task, train_actions

    learned = load_segments([write_folder(tmp_path / "train", 180, 1)], CLASSES)
    kept = load_segments([write_folder(tmp_path / "kept", 40, 2)], CLASSES)
    out = tmp_path / "actions_slim.onnx"
    scores = train_actions(Task(BENCH, PRODUCT), learned, kept, out, settings=ActionTraining(epochs=16, batch=20))
    assert scores["assembly_position"] > 0.9
    assert scores["assembly_part"] > 0.9
    assert out.stat().st_size < 2e6
    detector = load_actions(BENCH, PRODUCT, out)
    for at in (0, 3):
        detector.detect(placing(at), {})
        pairs = detector.last_posterior[: CLASSES.assemblies].reshape(len(CLASSES.parts), -1)
        assert pairs.sum(axis=0).argmax() == at


SLOW = [pytest.param(kind, marks=pytest.mark.slow) for kind in ("paper", "hand", "cnn_lstm", "lrcn")]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["slim", "track", *SLOW])
def test_every_network_is_trained_and_exported_within_its_budget(tmp_path: Path, kind: str) -> None:
    from bracket_cell.learned.actions.model import load_actions
    from bracket_cell.learned.actions.settings import ActionTraining
    from bracket_lab.learned.actions.data import load_segments
    from bracket_lab.learned.actions.train import Task, train_actions

    learned = load_segments([write_folder(tmp_path / "train", 16, 1, whole=True)], CLASSES)
    settings = ActionTraining(epochs=50, batch=8, share=0.1)
    out = tmp_path / "net.onnx"
    scores = train_actions(Task(BENCH, PRODUCT), learned, learned, out, kind, settings=settings, budget_s=0.01)
    assert 0.0 <= scores["accuracy"] <= 1.0
    detector = load_actions(BENCH, PRODUCT, out, kind)
    detector.detect(placing(1), {})
    assert detector.last_posterior.sum() == pytest.approx(1.0, abs=0.1 if kind == "slim" else 1e-6)
    other = "paper" if kind == "slim" else "slim"
    with pytest.raises(ModelError, match=rf"actions\.{other}"):
        load_actions(BENCH, PRODUCT, out, other)


def test_whole_frames_are_asked_for_where_they_are_missing(tmp_path: Path) -> None:
    from bracket_lab.learned.actions.data import load_segments
    from bracket_lab.learned.actions.train import Task, train_actions

    learned = load_segments([write_folder(tmp_path / "train", 8, 1)], CLASSES)
    with pytest.raises(InputError, match="--frames"):
        train_actions(Task(BENCH, PRODUCT), learned, learned, tmp_path / "net.onnx", "lrcn")


def test_unknown_kinds_are_refused(tmp_path: Path) -> None:
    from bracket_lab.learned.actions.data import load_segments
    from bracket_lab.learned.actions.train import Task, train_actions

    learned = load_segments([write_folder(tmp_path / "train", 8, 1)], CLASSES)
    with pytest.raises(InputError, match="legal: slim"):
        train_actions(Task(BENCH, PRODUCT), learned, learned, tmp_path / "net.onnx", "guess")


def test_the_trivial_answer_is_the_commonest_class_that_was_learned(tmp_path: Path) -> None:
    from bracket_lab.experiments.paper.actions import commonest
    from bracket_lab.learned.actions.data import load_segments

    segments = load_segments([write_folder(tmp_path / "data", 20, 1, whole=True)], CLASSES)
    learned, kept = segments.without(0, 2)
    told = commonest(learned, kept, CLASSES.assemblies)
    answer = np.bincount(learned.classes).argmax()
    assert told["all"] == [int((kept.classes == answer).sum()), len(kept)]
    right, count = told["assemblies"]
    assert 0 <= right <= count < len(kept)


@pytest.mark.long
def test_splits_keep_recordings_apart_and_a_measured_one_is_not_measured_again(tmp_path: Path) -> None:
    from bracket_cell.learned.actions.settings import ActionTraining
    from bracket_lab.experiments.paper.actions import KINDS, measure_folds, page, summary
    from bracket_lab.learned.actions.data import load_segments
    from bracket_lab.learned.actions.train import Task

    segments = load_segments([write_folder(tmp_path / "data", 20, 1, whole=True)], CLASSES)
    apart = [segments.without(fold, 2) for fold in range(2)]
    for learned, kept in apart:
        assert not set(learned.logs) & set(kept.logs)
        assert len(learned) + len(kept) == len(segments)
    assert not set(apart[0][1].logs) & set(apart[1][1].logs)
    settings = ActionTraining(epochs=1, batch=8, share=0.05)
    wanted = [(fold, kind) for fold in range(2) for kind in KINDS]
    rows = list(measure_folds(Task(BENCH, PRODUCT), segments, wanted, settings, folds=2))
    assert [(row["fold"], row["kind"]) for row in rows] == wanted
    told = {(one["kind"], one["control"]): one for one in summary(rows)}
    assert {kind for kind, _ in told} == set(KINDS)
    assert ("lrcn", "black crops") not in told
    assert all(0 <= one["all"][0] <= 1 and one["splits"] == 2 for one in told.values())
    assert len(page(rows).splitlines()) == 2 + len(told)
    again = list(measure_folds(Task(BENCH, PRODUCT), segments, wanted[:1], settings, folds=2))
    assert again[0]["told"] == rows[0]["told"]


@pytest.mark.slow
def test_paper_has_all_channels_of_vgg16() -> None:
    from torch import nn

    from bracket_lab.learned.actions.network import Vgg16

    layers = (layer for layer in Vgg16().layers if isinstance(layer, nn.Conv2d))
    assert sum(weight.numel() for layer in layers for weight in layer.parameters()) == 14_714_688
