"""Networks of the part detector learn for a few steps, are exported, and answer like torch. No OpenGL here."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.parts.maps import INPUT_PX, Peak, surface_of
from bracket_cell.learned.parts.model import CentrePartDetector
from bracket_ground.errors import InputError, ModelError
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.resting_pose import rest_on
from bracket_lab.learned.parts.boxes import BoxPartDetector, head_file
from bracket_lab.learned.parts.data import AXIS_M, Label, Scene

pytestmark = [pytest.mark.torch, pytest.mark.filterwarnings("ignore::DeprecationWarning:torch.*")]

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
FLOOR_M = BENCH.tray.centre_m[2]
CAMERA = BENCH.wrist.model
ABOVE = Pose((BENCH.tray.centre_m[0], BENCH.tray.centre_m[1], 0.52), (0.0, 1.0, 0.0, 0.0))


def drawn(seed: int) -> Scene:
    """A tray with outlines of standing parts painted into it."""
    rng = np.random.default_rng(seed)
    image = np.full((CAMERA.height_px, CAMERA.width_px, 3), 60, np.uint8)
    labels = []
    for name, shift in zip(PRODUCT.parts, (-0.1, 0.0, 0.1), strict=True):
        kind = PRODUCT.parts[name]
        x, y = BENCH.tray.centre_m[0] + rng.uniform(-0.03, 0.03), BENCH.tray.centre_m[1] + shift
        pose = Pose.from_yaw((x, y, FLOOR_M + kind.peg_length_m), rng.uniform(-math.pi, math.pi))
        middle = kind.size_m[2] / 2
        ends = np.array([[0.0, 0.0, middle], [AXIS_M / 2, 0.0, middle], [-AXIS_M / 2, 0.0, middle]])
        centre, ahead, behind = CAMERA.project(ABOVE, pose.transform(ends))
        outline = CAMERA.project(ABOVE, pose.transform(surface_of(kind)))
        hull = cv2.convexHull(outline.astype(np.float32))
        cv2.fillConvexPoly(image, np.rint(hull).astype(np.int32), [int(255 * level) for level in kind.colour_rgb])
        labels.append(Label(name, pose, True, hull.reshape(-1, 2).astype(float), centre, ahead - behind, 0.6))
    return Scene(f"drawn{seed}", image, CAMERA, ABOVE, ABOVE, tuple(labels))


SCENES = [drawn(seed) for seed in range(6)]


@pytest.mark.long
def test_a_short_training_gives_a_detector_that_answers(tmp_path: Path) -> None:
    from bracket_lab.learned.parts.train import train_parts

    out = tmp_path / "parts_centre.onnx"
    facts = train_parts(SCENES, PRODUCT, FLOOR_M, out, 0, epochs=1)
    assert facts["images"] == len(SCENES)
    detector = CentrePartDetector.load(BENCH, PRODUCT, out)
    for detection in detector.detect(Frame("wrist", 0, 0.0, SCENES[0].image, ABOVE)):
        assert math.isfinite(detection.confidence)


class Nothing:
    """A centre net whose maps nobody reads."""

    def run(self, inputs: object) -> dict[str, list[None]]:  # noqa: ARG002
        return {"heat": [None], "further": [None]}


@pytest.mark.parametrize(("above_m", "on_top"), [(0.0, False), (0.045, True)])
def test_what_lies_high_lies_on_something_though_that_is_hidden(
    monkeypatch: pytest.MonkeyPatch, above_m: float, on_top: bool
) -> None:
    from bracket_lab.learned.parts import train_stacked

    kind, rest = PRODUCT.parts["o2"], rest_on(PRODUCT.parts["o2"], "+y")
    assert rest is not None
    pose = Pose((*BENCH.tray.centre_m[:2], FLOOR_M + above_m)) @ rest
    outline = CAMERA.project(ABOVE, pose.transform(surface_of(kind)))
    label = Label("o2", pose, False, outline, outline.mean(axis=0), np.zeros(2), 0.6)
    scene = Scene("high", SCENES[0].image, CAMERA, ABOVE, ABOVE, (label,))
    scale = np.array(INPUT_PX) / (CAMERA.width_px, CAMERA.height_px)
    box = label.box_px * np.tile(scale, 2)
    peak = Peak(1, 0.9, label.centre_px * scale, box, 0.0, 0.05, 0.1, (0, 0))
    monkeypatch.setattr(train_stacked, "peaks", lambda *_: [peak])
    (thing,) = train_stacked.things_seen([scene], PRODUCT, FLOOR_M, cast(Any, Nothing()))
    assert (thing.on_top, thing.carrying) == (on_top, False)


@pytest.mark.slow
def test_an_interrupted_training_goes_on_after_the_centre_net(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from bracket_lab.learned.parts import train

    lost: list[str] = []
    of_centre, of_pose = train.centre_loss, train._pose_loss

    def centre(*given: Any) -> Any:
        lost.append("centre")
        return of_centre(*given)

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(train, "centre_loss", centre)
    monkeypatch.setattr(train, "_pose_loss", stopped)
    out = tmp_path / "parts_centre.onnx"
    with pytest.raises(KeyboardInterrupt):
        train.train_parts(SCENES, PRODUCT, FLOOR_M, out, 0, epochs=1)
    first = out.read_bytes()
    assert lost
    lost.clear()
    monkeypatch.setattr(train, "_pose_loss", of_pose)
    train.train_parts(SCENES, PRODUCT, FLOOR_M, out, 0, epochs=1)
    assert lost == []  # nothing was learned again from the images
    assert out.read_bytes() == first
    assert not list(tmp_path.glob("*checkpoint*"))


def test_the_loss_falls_and_the_same_seed_gives_the_same_weights() -> None:
    import torch

    from bracket_lab.learned.parts.settings import CentreTraining
    from bracket_lab.learned.parts.train import centre_loss, centre_recipe
    from bracket_lab.learned.training.recipe import Task

    settings = CentreTraining(epochs=6, batch=3, widths=(8, 12, 16, 24), features=16)

    def trained(settings: CentreTraining) -> Any:
        recipe = centre_recipe(SCENES, PRODUCT, FLOOR_M, 1, settings)
        recipe.fit(Task(seed=1))
        return recipe.network

    networks = [trained(settings) for _ in range(2)]
    for one, other in zip(*(network.state_dict().values() for network in networks), strict=True):
        assert torch.equal(one, other)
    from bracket_lab.learned.parts.augment import sample

    drawn_one = sample(SCENES[0], tuple(PRODUCT.parts), FLOOR_M, None)
    parts = [torch.from_numpy(part[np.newaxis]) for part in (drawn_one.heat, drawn_one.further, drawn_one.weights)]
    fresh = trained(settings.model_copy(update={"peak_rate": 1e-9}))
    losses = [
        float(centre_loss(network(torch.from_numpy(drawn_one.image[np.newaxis])), *parts).detach())
        for network in (fresh, networks[0])
    ]
    assert losses[1] < losses[0]


@pytest.mark.slow
def test_faster_rcnn_takes_a_step_is_written_and_answers_without_torch(tmp_path: Path) -> None:
    from bracket_lab.learned.parts.rcnn import train_rcnn
    from bracket_lab.learned.parts.settings import RcnnTraining
    from bracket_lab.learned.training.recipe import Task

    out = tmp_path / "parts_rcnn.onnx"
    settings = RcnnTraining(backbone="resnet18", share=0.05, steps=2, batch=2)
    train_rcnn(SCENES, PRODUCT, out, settings, Task(out=out))
    assert not list(tmp_path.glob("*checkpoint*"))  # it is for what was interrupted
    detector = BoxPartDetector.load(BENCH, PRODUCT, out)
    for detection in detector.detect(Frame("wrist", 0, 0.0, SCENES[0].image, ABOVE)):
        assert detection.part in (*PRODUCT.parts, "unknown")
        assert 0 < detection.confidence <= 1
    head_file(out).write_bytes(b"no weights")
    with pytest.raises(ModelError, match="damaged"):
        BoxPartDetector.load(BENCH, PRODUCT, out)
    with pytest.raises(InputError, match="cannot be written"):
        train_rcnn(SCENES, PRODUCT, out / "below a file.onnx", settings, Task(out=out / "below a file.onnx"))


@pytest.mark.long
def test_a_training_whose_file_is_refused_goes_on_from_its_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bracket_lab.learned.parts import rcnn
    from bracket_lab.learned.parts.settings import RcnnTraining
    from bracket_lab.learned.training.recipe import Task

    out, settings = tmp_path / "parts_rcnn.onnx", RcnnTraining(backbone="resnet18", share=0.05, steps=2, batch=2)
    with monkeypatch.context() as patched:
        patched.setattr(rcnn, "differences", lambda *_: iter([("features", 2.4)]))
        with pytest.raises(ModelError, match="features differs from torch"):
            rcnn.train_rcnn(SCENES, PRODUCT, out, settings, Task(out=out))
    assert list(tmp_path.glob("*checkpoint*"))
    monkeypatch.setattr(rcnn, "_batch", lambda *_: pytest.fail("it learned again"))
    rcnn.train_rcnn(SCENES, PRODUCT, out, settings, Task(out=out))
    assert not list(tmp_path.glob("*checkpoint*"))
    assert head_file(out).exists()


def test_answers_of_a_stage_are_compared_in_what_is_used_of_them() -> None:
    from bracket_lab.learned.parts.rcnn import differences

    rng = np.random.default_rng(3)
    corner = rng.uniform(10, 150, (200, 2))
    boxes = np.hstack([corner, corner + rng.uniform(20, 80, (200, 2))]).astype(np.float32)
    scores = np.repeat(np.linspace(0.99, 0.01, 100), 2).astype(np.float32)  # two of each rank alike
    expected = {"scores": scores, "boxes": boxes, "features": np.ones((1, 2, 3, 3), np.float32)}
    far = boxes.copy()
    far[150, 2:] = 30_000.0  # of a region that nobody looks at
    order = np.arange(200).reshape(-1, 2)[:, ::-1].ravel()  # equal scores, ranked differently
    for found in ({"boxes": far}, {"boxes": boxes[order]}):
        assert max(gap for _, gap in differences({**expected, **found}, expected)) < 1e-5
    moved = boxes.copy()
    moved[3] += 15.0
    for wrong in ({"boxes": moved}, {"scores": scores * 0.9}, {"features": expected["features"] * 1.1}):
        assert max(gap for _, gap in differences({**expected, **wrong}, expected)) > 0.05


def test_targets_are_whole_boxes_in_the_input_of_the_network() -> None:
    from bracket_lab.learned.parts.rcnn import targets

    found = targets(SCENES[0], tuple(PRODUCT.parts))
    wanted = np.array([label.box_px for label in SCENES[0].labels]) * 320 / CAMERA.width_px
    assert np.allclose(found["boxes"].numpy(), wanted, atol=1e-3)
    assert found["labels"].tolist() == [1, 2, 3]


def test_a_backbone_that_there_is_not_is_told_before_data_are_made(capsys: pytest.CaptureFixture[str]) -> None:
    from bracket_cell.commands.main import main

    assert main(["lab", "train", "parts", "--kind", "rcnn", "--backbone", "vgg"]) == 2
    assert "legal: resnet101" in capsys.readouterr().err


def test_a_share_of_channels_goes_with_the_small_backbone_alone(capsys: pytest.CaptureFixture[str]) -> None:
    from bracket_cell.commands.main import main

    assert main(["lab", "train", "parts", "--kind", "rcnn", "--backbone", "resnet50", "--share", "0.25"]) == 2
    assert "--share 0.25: goes with --backbone resnet18" in capsys.readouterr().err
