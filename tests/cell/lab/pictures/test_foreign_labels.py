"""Labels of other programs: every format gives the same boxes, and what is wrong is told with its place."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_lab.pictures.labels import LabelFolder, PictureLabels
from tests.cell.lab.pictures.drawn import BENCH, PRODUCT

SOURCE_PX = (1000, 500)  # of a photograph; the camera's pictures have another shape
BOX = (100.0, 200.0, 300.0, 260.0)
SCALE = BENCH.wrist.width_px / 1000
TOP = (BENCH.wrist.height_px - 500 * SCALE) / 2
PLACED = [100 * SCALE, 200 * SCALE + TOP, 300 * SCALE, 260 * SCALE + TOP]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("photos").mkdir()
    cv2.imwrite("photos/a.jpg", np.full((SOURCE_PX[1], SOURCE_PX[0], 3), 120, np.uint8))
    assert main(["record", "photos", "--camera", "wrist", "--out", "own"]) == 0
    return tmp_path / "own"


def coco(category: str = "o1", size: tuple[int, int] = SOURCE_PX, times: float = 1.0, file: str = "a.jpg") -> Path:
    left, top, right, bottom = (times * side for side in BOX)
    image = {"id": 0, "file_name": file, "width": size[0], "height": size[1]}
    box = {"id": 7, "image_id": 0, "category_id": 3, "bbox": [left, top, right - left, bottom - top]}
    content = {"images": [image], "categories": [{"id": 3, "name": category}], "annotations": [box]}
    Path("c.json").write_text(json.dumps(content))
    return Path("c.json")


def yolo(line: str = "1 0.2 0.46 0.2 0.12", names: str = "names: [o2, o1]") -> Path:
    Path("y/labels").mkdir(parents=True)
    Path("y/data.yaml").write_text(names)
    Path("y/labels/a.txt").write_text(f"{line}\n")
    return Path("y")


def yolo_pose() -> Path:
    """Keypoints after the box: they are no outline."""
    return yolo("1 0.2 0.46 0.2 0.12 0.15 0.45 2 0.9 0.9 1", "names: [o2, o1]\nkpt_shape: [2, 3]")


def coco_with(**fields: object) -> Path:
    content = json.loads(coco().read_text())
    content["annotations"][0] |= fields
    Path("c.json").write_text(json.dumps(content))
    return Path("c.json")


def twice(made: Path) -> Path:
    """YOLO's folders of learning and of scores, with two pictures of one name."""
    (made / "more").mkdir()
    (made / "more/a.txt").write_text("0 0.2 0.46 0.2 0.12\n")
    return made


def other_json(text: str) -> Path:
    Path("c.json").write_text(text)
    return Path("c.json")


def voc(box: tuple[object, ...] = BOX) -> Path:
    Path("v").mkdir()
    sides = "".join(f"<{n}>{v}</{n}>" for n, v in zip(("xmin", "ymin", "xmax", "ymax"), box, strict=True))
    size = "<size><width>1000</width><height>500</height><depth>3</depth></size>"
    text = f"<annotation>\n<filename>a.jpg</filename>{size}\n<object><name>o1</name><bndbox>{sides}</bndbox></object>"
    Path("v/a.xml").write_text(f"{text}</annotation>")
    return Path("v")


def cvat(inside: str = "", box: tuple[object, ...] = BOX) -> Path:
    sides = " ".join(f'{n}="{v}"' for n, v in zip(("xtl", "ytl", "xbr", "ybr"), box, strict=True))
    inside = inside or f'<box label="o1" {sides}/>'
    image = f'<image id="0" name="set/a.jpg" width="1000" height="500">\n{inside}</image>'
    Path("cvat.xml").write_text(f"<annotations><version>1.1</version>\n{image}</annotations>")
    return Path("cvat.xml")


def cvat_of(width: int) -> Path:
    made = cvat()
    made.write_text(made.read_text().replace('width="1000"', f'width="{width}"'))
    return made


def cvat_polygon() -> Path:
    return cvat('<polygon label="o1" points="100.0,200.0;300.0,200.0;300.0,260.0;100.0,260.0"/>')


def cvat_turned() -> Path:
    return cvat('<box label="o1" xtl="170" ytl="130" xbr="230" ybr="330" rotation="90.0"/>')


def yolo_polygon() -> Path:
    return yolo("1 0.1 0.4 0.3 0.4 0.3 0.52 0.1 0.52")


def half_as_large() -> Path:
    return coco(size=(500, 250), times=0.5)


def named_by_case() -> Path:
    return coco(category="O1")


def of_a_store() -> Path:
    return coco(file="../../upload/1/a.jpg")


@pytest.mark.parametrize(
    "made",
    [
        coco,
        yolo,
        voc,
        cvat,
        cvat_polygon,
        cvat_turned,
        yolo_polygon,
        yolo_pose,
        half_as_large,
        named_by_case,
        of_a_store,
    ],
    ids=lambda one: one.__name__,
)
def test_every_format_gives_the_same_box_in_the_picture_with_borders(folder: Path, made: Callable[[], Path]) -> None:
    assert main(["label", str(folder), "--import", str(made())]) == 0
    read = LabelFolder(folder, PRODUCT)
    ((part,),) = [labels.parts for labels in read.labels.values()]
    assert part.part == "o1"
    assert part.whole_box_px == pytest.approx(PLACED)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: coco(size=(1000, 500), times=4.0), "c.json: annotation 7: a box of 400, 800, 1200, 1040"),
        (lambda: coco(size=(640, 640)), "annotation 7: is told in a picture of 640 x 640, and the picture here has"),
        (lambda: coco(category="Hammer"), "--rename 'Hammer'=NAME"),
        (lambda: coco(file="b.jpg"), "no picture b.jpg"),
        (lambda: yolo("5 0.2 0.46 0.2 0.12"), "y/labels/a.txt:1: class 5: legal are 0, 1"),
        (lambda: yolo("1 0.2 0.46 0.2"), "y/labels/a.txt:1: must be: class, then middle x"),
        (lambda: yolo("1 0.2 0.46 0.9 0.12"), "y/labels/a.txt:1: a box of"),
        (lambda: voc((100, 200, 1300, 260)), "v/a.xml:3: a box of 100, 200, 1300, 260"),
        (lambda: voc((100, 200, "", 260)), "v/a.xml:3: <xmax> of '': must be a number"),
        (lambda: voc((100, 200, "1e999", 260)), "v/a.xml:3: <xmax> of '1e999': must be a number"),
        (lambda: cvat(box=(100, 200, 1300, 260)), "cvat.xml:3: a box of 100, 200, 1300, 260"),
        (lambda: cvat(box=("x", 200, 300, 260)), "cvat.xml:3: xtl of 'x': must be a number"),
        (lambda: cvat('<polygon label="o1" points="1,2;3"/>'), "cvat.xml:3: points of '1,2;3': must be x,y;x,y"),
        (lambda: cvat('<ellipse label="o1" cx="1"/>'), "cvat.xml:3: <ellipse>: legal are box, polygon"),
        (lambda: yolo(names="nc: 2"), "data.yaml: names no classes"),
        (lambda: coco_with(keypoints=[1, 2, 3, 4, 5]), "c.json: annotation 7: keypoints must be x, y, visible of each"),
        (lambda: twice(yolo()), "y: has labels of a.txt twice; legal: once a picture"),
        (lambda: other_json('[{"data": {"image": "a.jpg"}}]'), "input should be keys with values; legal: a COCO file"),
        (lambda: cvat_of(0), "cvat.xml:2: <image> of 0 x 500: must be 1 x 1 or more"),
        (lambda: Path("photos"), "holds no labels; legal: a COCO file"),
        (lambda: Path("own/frames.jsonl"), "is of no known format; legal: a COCO file"),
    ],
)
def test_what_is_wrong_is_told_with_its_place_and_nothing_is_written(
    folder: Path, made: Callable[[], Path], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = made()
    capsys.readouterr()
    assert main(["label", str(folder), "--import", str(path)]) == 2
    assert said in capsys.readouterr().err
    assert not (folder / "objects.jsonl").exists()


@pytest.mark.usefixtures("folder")
def test_points_of_a_hand_lie_where_its_box_does() -> None:
    """They stayed in the pixels of the photograph, and a network would have learned them there."""
    assert main(["record", "photos", "--out", "bench"]) == 0
    coco_with(keypoints=[100, 200, 2, 300, 260, 1, 0, 0, 0])
    assert main(["label", "bench", "--import", "c.json", "--rename", "o1=hand"]) == 0
    ((hand,),) = [labels.hands for labels in LabelFolder(Path("bench"), PRODUCT).labels.values()]
    assert [xy for point in hand.points_px.values() for xy in point] == pytest.approx(list(hand.box_px))


def test_names_may_be_given_by_hand_and_others_left_out(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["label", str(folder), "--import", str(coco(category="Hammer"))]
    assert main([*words, "--rename", "Hammer=o3"]) == 0
    assert [part.part for labels in LabelFolder(folder, PRODUCT).labels.values() for part in labels.parts] == ["o3"]
    assert main([*words, "--rename", "Hammer="]) == 0
    assert [labels.parts for labels in LabelFolder(folder, PRODUCT).labels.values()] == [()]
    capsys.readouterr()
    assert main([*words, "--rename", "Hammer=o9"]) == 2
    assert "--rename: no category o9" in capsys.readouterr().err


@pytest.mark.parametrize("named", ["out.json", "out", "voc:out", "out.xml"])
def test_boxes_come_back_from_every_format(named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("photos").mkdir()
    size = BENCH.wrist.width_px, BENCH.wrist.height_px
    for name in ("a", "b & c"):
        cv2.imwrite(f"photos/{name}.png", np.full((size[1], size[0], 3), 120, np.uint8))
    for name in ("own", "other"):
        assert main(["record", "photos", "--camera", "wrist", "--out", name]) == 0
    assert main(["label", "own", "--import", str(coco(size=size, times=0.5))]) == 0
    opened = LabelFolder(Path("own"), PRODUCT)
    opened.save(opened.pictures[1].file, PictureLabels())
    assert main(["label", "own", "--export", named]) == 0
    written = named.removeprefix("voc:")
    assert main(["label", "other", "--import", written]) == 0
    first, second = LabelFolder(Path("other"), PRODUCT).labels.values()
    assert [part.part for part in first.parts] == ["o1"]
    assert first.parts[0].whole_box_px == pytest.approx([0.5 * side for side in BOX], abs=0.01)
    assert second == PictureLabels()
    assert main(["label", "own", "--export", named]) == (2 if Path(written).is_dir() else 0)
