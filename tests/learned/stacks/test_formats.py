"""VMRD: what fathers and parents mean, and that every fault is told with its place."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_ground.errors import InputError
from bracket_ground.interfaces.stacks import StackedScene
from bracket_lab.experiments.stacks.checks import above_of, children_first
from bracket_lab.experiments.stacks.vmrd import read_vmrd, write_scene, write_splits
from tests.learned.stacks.folders import picture, put, vmrd


@pytest.fixture
def scene(tmp_path: Path) -> StackedScene:
    """The scene for tests."""
    return read_vmrd(vmrd(tmp_path)).test[0]


def test_fathers_lie_below_and_children_on_top(scene: StackedScene) -> None:
    by_name = {item.name: item for item in scene.objects}
    assert by_name["cup"].children == ()
    assert set(by_name["cup"].fathers) == {1, 2}
    assert by_name["box"].fathers == ()
    assert set(by_name["box"].children) == {2, 7}
    assert by_name["pen"].fathers == by_name["pen"].children == ()


def test_children_are_taken_first(scene: StackedScene) -> None:
    assert children_first(scene, 1) == [7, 2]
    assert children_first(scene, 2) == [7]
    assert children_first(scene, 7) == children_first(scene, 4) == []


def test_boxes_count_from_zero(scene: StackedScene) -> None:
    assert {item.index: item.box_px for item in scene.objects}[7] == (30, 30, 50, 50)
    assert scene.size_px == (120, 90)


def test_what_lies_on_what_lies_on_it_is_above(tmp_path: Path) -> None:
    scene = read_vmrd(vmrd(tmp_path)).test[0]
    direct = tuple(
        replace(item, fathers=(2,)) if item.index == 7 else replace(item, children=(2,)) if item.index == 1 else item
        for item in scene.objects
    )
    assert above_of(replace(scene, objects=direct))[1] == {2, 7}


def test_vmrd_is_read_as_it_was_written(tmp_path: Path) -> None:
    first = read_vmrd(vmrd(tmp_path / "first"))
    trainval, test = (replace(first.trainval[0], drawn_from=5),), first.test
    for stacked_scene in (*trainval, *test):
        write_scene(tmp_path / "second", stacked_scene, picture())
    write_splits(tmp_path / "second", ["00001"], ["00002"])
    second = read_vmrd(tmp_path / "second")
    assert (second.trainval, second.test) == (trainval, test)
    assert [grasp.index for grasp in second.test[0].grasps] == [7, 4]


def _edit(file: Path, *changes: str) -> None:
    text = file.read_text("utf-8")
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert old in text, f"{old!r} is not in {file}"
        text = text.replace(old, new, 1)
    put(file, text)


XML, GRASPS, TRAINVAL, TEST_SET = (
    "Annotations/00002.xml",
    "Grasps/00002.txt",
    "ImageSets/Main/trainval.txt",
    "ImageSets/Main/test.txt",
)
CUP = "<index>7</index>\n    <father><num>1</num><num>2</num></father>\n    <children></children>"
# of VMRD: file, old, new, line at which it is told, words
VMRD_MUTANTS = [
    (XML, "<num>2</num><num>7</num>", "<num>2</num><num>7</num><num>9</num>", 8, "child 9, which is not there"),
    (XML, "<children><num>7</num></children>", "<children><num>8</num></children>", 16, "child 8, which is not there"),
    (XML, CUP, CUP.replace("<num>1</num>", "<num>5</num>"), 22, "father 5, which is not there"),
    (XML, "<father><num>1</num></father>", "<father></father>", 8, "2 does not have father 1"),
    (XML, "<children><num>7</num></children>", "<children></children>", 22, "2 does not have child 7"),
    (XML, "<num>1</num><num>2</num>", "<num>1</num>", 16, "7 does not have father 2"),
    (XML, "<num>1</num><num>2</num>", "<num>1</num><num>2</num><num>4</num>", 22, "4 does not have child 7"),
    (XML, "<father/>\n    <children/>", "<father><num>4</num></father><children/>", 29, "its own father"),
    (XML, "<father/>\n    <children/>", "<father/><children><num>4</num></children>", 29, "its own child"),
    (XML, "<num>1</num><num>2</num>", "<num>1</num><num>2</num><num>2</num>", 22, "names father 2 twice"),
    (XML, "<num>2</num><num>7</num>", "<num>2</num><num>7</num><num>7</num>", 8, "names child 7 twice"),
    (XML, "<father></father>\n    <children><num>2</num><num>7</num>",
     "<father><num>7</num></father>\n    <children><num>2</num><num>7</num>", 7, "7 does not have child 1"),
    (XML, "<xmax>101</xmax>", "<xmax>140</xmax>", 27, "outside the picture of 120 x 90"),
    (XML, "<ymax>81</ymax>", "<ymax>95</ymax>", 27, "outside the picture"),
    (XML, "<xmin>11</xmin>", "<xmin>-5</xmin>", 5, "outside the picture"),
    (XML, "<ymin>31</ymin>", "<ymin>-31</ymin>", 20, "outside the picture"),
    (XML, "<xmin>31</xmin>", "<xmin>51</xmin>", 20, "is empty"),
    (XML, "<ymax>51</ymax>", "<ymax>20</ymax>", 20, "is empty"),
    (XML, "<xmin>31</xmin>", "<xmin>left</xmin>", 20, "a number is wanted"),
    (XML, "<xmin>31</xmin>", "<xmin>nan</xmin>", 20, "a number is wanted"),
    (XML, "<xmin>31</xmin>", "", 20, "<bndbox> has no <xmin>"),
    (XML, "<xmin>31</xmin>", "<xmin>31</xmin><xmin>31</xmin>", 20, "2 times <xmin>"),
    (XML, "<name>cup</name>", "<name>teapot</name>", 19, "unknown class 'teapot'"),
    (XML, "<name>cup</name>", "<name></name>", 19, "unknown class ''"),
    (XML, "<name>cup</name>", "", 18, "<object> has no <name>"),
    (XML, "<name>pen</name>", "<name>pens</name>", 26, "unknown class 'pens'"),
    (XML, "<index>4</index>", "<index>7</index>", 28, "index 7 is taken"),
    (XML, "<index>4</index>", "<index>4.5</index>", 28, "a whole number is wanted"),
    (XML, "<index>4</index>", "<index>four</index>", 28, "a number is wanted"),
    (XML, "<index>4</index>", "", 25, "<object> has no <index>"),
    (XML, "<father/>", "", 25, "<object> has no <father>"),
    (XML, "<children/>", "", 25, "<object> has no <children>"),
    (XML, "<father/>", "<father>1</father>", 29, "only <num> is legal here"),
    (XML, "<father/>", "<father><index>1</index></father>", 29, "only <num> is legal here"),
    (XML, "<father/>", "<father><num>one</num></father>", 29, "a number is wanted"),
    (XML, "<width>120</width>", "", 2, "<size> has no <width>"),
    (XML, "<width>120</width>", "<width>0</width>", 2, "both are 1 or more"),
    (XML, "<annotation>", "<annotations>", 32, "mismatched tag"),
    (XML, "</annotation>", "", 33, "not well-formed"),
    (GRASPS, "92 30", "92", 2, "x and y of four corners"),
    (GRASPS, "92 30", "92 thirty", 2, "x and y of four corners"),
    (GRASPS, "92 40 4", "92 40 5", 2, "a grasp of object 5, which is not there"),
    (TEST_SET, "00002\n", "", 1, "the split is empty"),
    (TRAINVAL, "00001\n", "", 1, "the split is empty"),
    (TEST_SET, "00002\n", "00002\n00002\n", 2, "picture 00002 is at"),
    (TEST_SET, "00002\n", "00002\n00001\n", 2, "picture 00001 is at"),
]  # fmt: skip


@pytest.mark.parametrize(("file", "old", "new", "line", "words"), VMRD_MUTANTS)
def test_faults_of_vmrd_are_told_with_their_line(
    tmp_path: Path, file: str, old: str, new: str, line: int, words: str
) -> None:
    _edit(vmrd(tmp_path) / file, old, new)
    with pytest.raises(InputError) as told:
        read_vmrd(tmp_path)
    assert f"{file}:{line}" in str(told.value)
    assert words in str(told.value)


def test_a_ring_is_told(tmp_path: Path) -> None:
    folder = vmrd(tmp_path)
    _edit(folder / XML, "<father></father>\n    <children><num>2</num><num>7</num>",
          "<father><num>7</num></father>\n    <children><num>2</num><num>7</num>", "<children></children>",
          "<children><num>1</num></children>")  # fmt: skip
    with pytest.raises(InputError, match=r"00002.xml:7: objects lie on each other in a ring: 1 on 7 on 1"):
        read_vmrd(folder)


@pytest.mark.parametrize("missing", [XML, "JPEGImages/00002.jpg", TEST_SET, TRAINVAL])
def test_missing_files_of_vmrd_are_named(tmp_path: Path, missing: str) -> None:
    (vmrd(tmp_path) / missing).unlink()
    with pytest.raises(InputError, match=re.escape(missing)):
        read_vmrd(tmp_path)


def test_another_folder_is_refused_without_a_traceback(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "eval", "stacks", "--data", str(tmp_path)]) == 2
    assert "no folder of stacks" in capsys.readouterr().err


def by_another_program(folder: Path) -> Path:
    """A folder of VMRD by lxml, as tools for Pascal VOC write it: declaration, all their fields, names of two words."""
    from lxml import etree
    from lxml.builder import E

    def thing(name: str, index: int, box: tuple[int, ...], fathers: list[int], children: list[int]) -> etree._Element:
        sides = (E(side, str(value)) for side, value in zip(("xmin", "ymin", "xmax", "ymax"), box, strict=True))
        families = (
            E(tag, *(E.num(str(one)) for one in some)) for tag, some in (("father", fathers), ("children", children))
        )
        voc = (E.pose("Unspecified"), E.truncated("0"), E.difficult("0"))
        return E.object(E.name(name), *voc, E.bndbox(*sides), E.index(str(index)), *families)

    for name in ("00001", "00002"):
        size = E.size(E.width("120"), E.height("90"), E.depth("3"))
        head = (E.folder("VMRD"), E.filename(f"{name}.jpg"), E.source(E.database("VMRD")), size, E.segmented("0"))
        things = (thing("wrist developer", 1, (11, 11, 81, 71), [], [3]), thing("cup", 3, (21, 21, 51, 51), [1], []))
        text = etree.tostring(E.annotation(*head, *things), pretty_print=True, xml_declaration=True, encoding="utf-8")
        put(folder / "Annotations" / f"{name}.xml", text.replace(b"\n", b"\r\n"))
        put(folder / "JPEGImages" / f"{name}.jpg", picture())
    put(folder / "ImageSets/Main/trainval.txt", "00001\r\n")
    put(folder / "ImageSets/Main/test.txt", "00002\r\n")
    return folder


def test_a_folder_by_another_program_is_read(tmp_path: Path) -> None:
    found = read_vmrd(by_another_program(tmp_path))
    (scene,) = found.test
    assert [(item.name, item.fathers, item.children) for item in scene.objects] == [
        ("wrist developer", (), (3,)),
        ("cup", (1,), ()),
    ]
    assert list(scene.objects[0].box_px) == [10, 10, 80, 70]
    assert above_of(scene) == {1: {3}, 3: set()}
    assert found.images["00001"].is_file()
