"""The page of the worst pictures: what is wrong is said and drawn, the worst first, and the figure has its interval."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_lab.learned.parts.data import Label, Scene
from bracket_lab.pictures.worst import Judged, interval, judged, write_page
from tests.cell.lab.pictures.drawn import BENCH, PRODUCT

POSE, SIZE = Pose((0.0, 0.0, 0.0)), (BENCH.wrist.height_px, BENCH.wrist.width_px, 3)
BOXES = {"o1": (20, 20, 80, 90), "o2": (120, 20, 180, 90), "o3": (220, 20, 280, 90)}


def scene(*parts: str, name: str = "a") -> Scene:
    corners = {part: np.array(BOXES[part], float).reshape(2, 2) for part in parts}
    labels = tuple(
        Label(part, None, None, corner, corner.mean(axis=0), np.zeros(2), 1.0) for part, corner in corners.items()
    )
    return Scene(name, np.full(SIZE, 90, np.uint8), BENCH.wrist.model, POSE, POSE, labels)


def answer(part: str, at: str) -> PartDetection:
    box = BOXES[at]
    return PartDetection(part=part, world_from_part=POSE, size_m=(0.05, 0.03, 0.04), box_px=box, confidence=0.9)


def test_what_is_wrong_is_said_by_what_should_be_done_about_it() -> None:
    seen = judged(scene("o1", "o2", "o3"), [answer("o1", "o1"), answer("o3", "o2")])
    assert seen.wrong == ("o2 called o3", "o3 missed")
    assert judged(scene(), [answer("o1", "o1")]).wrong == ("o1 where none is",)
    assert judged(scene("o1"), [answer("o1", "o1")]).wrong == ()
    assert judged(scene("o1"), [answer("o1", "o1"), answer("o1", "o1")]).wrong == ("o1 where none is",)


def test_the_interval_is_wide_for_few_pictures_and_none_where_all_are_alike() -> None:
    right = scene("o1"), [answer("o1", "o1")]
    missed: tuple[Scene, list[PartDetection]] = (scene("o1"), [])
    for count, pairs in ((4, [right] * 4), (0, [missed] * 4)):
        scenes, answers = zip(*pairs, strict=True)
        assert interval(scenes, answers, PRODUCT) == {"map_50_low": count / 4, "map_50_high": count / 4}
    widths = []
    for times in (3, 30):
        scenes, answers = zip(*[right, missed] * times, strict=True)
        told = interval(scenes, answers, PRODUCT)
        assert told["map_50_low"] < 0.5 < told["map_50_high"]
        widths.append(told["map_50_high"] - told["map_50_low"])
    assert widths[1] < widths[0] / 2


def test_the_worst_come_first_and_names_are_no_markup(tmp_path: Path) -> None:
    image = scene().image
    own = [
        Judged("right", (), 2, image),
        Judged("half <b>", ("o1 missed",), 2, image),
        Judged("all", ("o1 missed", "o2 missed"), 2, image),
    ]
    assert write_page(tmp_path / "p.html", "parts", {"map_50": 0.5}, own, own) == 2
    page = (tmp_path / "p.html").read_text()
    assert re.findall(r"<h2>(.*?):", page) == ["all", "half &lt;b&gt;"]
    assert page.count("<img") == 4
    assert "2 of 3 pictures have something wrong" in page


def test_the_command_writes_the_page_of_own_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("photos").mkdir()
    cv2.imwrite("photos/a.png", np.full(SIZE, 120, np.uint8))
    Path("y").mkdir()
    Path("y/classes.txt").write_text("o1")
    Path("y/a.txt").write_text("0 0.5 0.5 0.2 0.2")
    assert main(["record", "photos", "--camera", "wrist", "--out", "own"]) == 0
    assert main(["label", "own", "--import", "y"]) == 0
    capsys.readouterr()
    words = ["lab", "eval", "parts", "--kind", "classical", "--page", "worst.html"]
    assert main([*words, "--data", "own"]) == 0
    told = capsys.readouterr()
    assert "something is wrong in 1 of 1: see worst.html" in " ".join((told.out + told.err).split())
    assert "a: o1 missed" in Path("worst.html").read_text()
    assert main(words) == 2
    assert "--page worst.html: goes with --data" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["centre", "rcnn"])
def test_types_that_no_picture_shows_are_named(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("photos", "y"):
        Path(folder).mkdir()
    Path("y/classes.txt").write_text("o1")
    for number in range(5):
        cv2.imwrite(f"photos/{number}.png", np.full(SIZE, 100 + 20 * number, np.uint8))
        Path(f"y/{number}.txt").write_text("0 0.5 0.5 0.2 0.2")
    assert main(["record", "photos", "--camera", "wrist", "--out", "own"]) == 0
    assert main(["label", "own", "--import", "y"]) == 0
    words = ["lab", "train", "parts", "--kind", kind, "--data", "own", "--out", "t.onnx", "--epochs", "1"]
    assert main(words) == 2
    assert "--data: only o1 labelled in 4 pictures; none shows o2, o3" in " ".join(capsys.readouterr().err.split())


@pytest.mark.long
def test_parts_of_other_names_are_trained_with_a_curve_and_hands_stay_learned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init", "own"]) == 0
    for file in Path("own/config").glob("*.yaml"):
        file.write_text(re.sub(r"\bo([123])\b", r"tool\1", file.read_text()))
    monkeypatch.chdir(tmp_path / "own")
    for folder in ("photos", "y"):
        Path(folder).mkdir()
    Path("y/classes.txt").write_text("Tool1\nTool2\nTool3")
    for number in range(10):
        image = np.full(SIZE, 120, np.uint8)
        for kind in range(3):
            left = 40 + 140 * kind + 4 * number
            image[100:200, left : left + 80] = np.eye(3)[kind] * 255
        cv2.imwrite(f"photos/{number}.png", image)
        boxes = [(kind, (80 + 140 * kind + 4 * number) / SIZE[1], 150 / SIZE[0]) for kind in range(3)]
        lines = [f"{kind} {x} {y} {80 / SIZE[1]} {100 / SIZE[0]}" for kind, x, y in boxes]
        Path(f"y/{number}.txt").write_text("\n".join(lines))
    own = ["--config", "config/cell.yaml"]
    assert main(["record", "photos", "--camera", "wrist", "--out", "data", *own]) == 0
    assert main(["label", "data", "--import", "y", *own]) == 0
    assert main(["train", "hands", "--data", "data", "--curve", *own]) == 2
    assert "--curve: goes with parts" in capsys.readouterr().err
    assert main(["train", "parts", "--data", "data", "--out", "t.onnx", "--epochs", "1", "--curve", *own]) == 0
    said = "".join(capsys.readouterr())
    assert [int(count) for count in re.findall(r"map_50 of (\d+) pictures", said)] == [2, 4, 8]
    assert OnnxModel.card_of(Path("t.onnx")).vocabulary["parts"] == ("tool1", "tool2", "tool3")
    assert main(["lab", "see", "photos/0.png", "--json", *own]) == 0
    assert "classical (colours, outlines): actions, holes, parts: " in "".join(capsys.readouterr())
