"""`cell check` of an arm: words and a drawing, and for no description a traceback."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_ground.interfaces.robot import FOLDER
from tests.arms import DRAWN, cell_file, robot_file

SEVEN = DRAWN["seven"].urdf()
BOX = '<collision><geometry><box size=".1 .1 {}"/></geometry></collision></link><joint name="ax3"'
BROKEN = {
    "no XML": ("<robot", "not a URDF"),
    "another root": ("<sdf/>", "its root is <sdf>"),
    "macros": ("<robot xmlns:xacro='http://www.ros.org/wiki/xacro'><xacro:arm/></robot>", "let `xacro` make a URDF"),
    "nothing in it": ("<robot name='a'/>", "must have one base"),
    "links without end": (f"<robot name='a'>{'<link/>' * 501}</robot>", "has 501 links, at most 500"),
    "words for numbers": (SEVEN.replace('lower="-2.09"', 'lower="left"', 1), "must be finite numbers"),
    "no finite number": (SEVEN.replace('xyz="0 0 0.2155"', 'xyz="0 0 nan"', 1), "must be finite numbers"),
    "a ring": (SEVEN.replace('<link name="foot"/>', "").replace('"foot"', '"l6"'), "ring"),
    "a joint to nowhere": (SEVEN.replace('<child link="l4"/>', '<child link="arm"/>'), "is no link"),
    "a name twice": (SEVEN.replace('name="ax4"', 'name="ax3"'), "two joints are named"),
    "too few joints": (re.sub('(ax[0-4]" type=)"revolute"', r'\1"fixed"', SEVEN), "must be 6 or more"),
    "no axis": (SEVEN.replace('axis xyz="0 -1 0"', 'axis xyz="0 0 0"'), "no axis"),
    "limits the wrong way": (SEVEN.replace('lower="-3.05"', 'lower="4"'), "no value is within its limits"),
    "no speed": (SEVEN.replace('velocity="2.2"', 'velocity="0"'), "no speed"),
    "a floating joint": (SEVEN.replace('name="ax2" type="revolute"', 'name="ax2" type="floating"'), "is floating"),
    "a box inside out": (SEVEN.replace('</link><joint name="ax3"', BOX.format(-1), 1), "must be above 0"),
    "a shape of no size": (SEVEN.replace('</link><joint name="ax3"', BOX.format(0), 1), "must be above 0"),
    "a mesh that is none": (
        SEVEN.replace('</link><joint name="ax3"', BOX.replace("box size", "mesh filename"), 1).format("a"), "mesh"
    ),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def said(capsys: pytest.CaptureFixture[str]) -> str:
    told = capsys.readouterr()
    return told.out + told.err


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_wrong_with_a_description_is_said(name: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, words = BROKEN[name]
    (folder / "a.urdf").write_text(text)
    (folder / ".1 .1 a").write_text("solid nonsense")
    assert main(["check", "a.urdf"]) == 2
    told = said(capsys)
    assert words in told
    assert told.count("a.urdf") == 1
    assert not (folder / "checked_a.png").exists()


def test_a_file_of_macros_is_no_tree(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "a.urdf.xacro").write_text(BROKEN["macros"][0])
    assert main(["check", "a.urdf.xacro"]) == 2
    assert BROKEN["macros"][1] in said(capsys)


def test_an_arm_is_drawn_with_words_on_what_it_reaches(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot_file(folder, "seven")
    assert main(["check", "seven.yaml", "--config", str(cell_file(folder, "seven.yaml"))]) == 0
    told = said(capsys)
    for words in ("ax6: -3.05 to 3.05", "at rest the tool is at", "reaches all holes", "home_rad", "checked_seven.png"):
        assert words in told
    assert (folder / "checked_seven.png").read_bytes().startswith(b"\x89PNG")


def test_a_bare_description_is_enough(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "bare.urdf").write_text(SEVEN)
    assert main(["check", "bare.urdf", "--config", str(DEFAULT_CONFIGURATION)]) == 1  # of the UR10's bench
    told = said(capsys)
    assert "the flange is taken to be 'plate'" in told
    assert "does not reach" in told


def test_shapes_that_touch_at_rest_are_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    thick = BOX.format(".1").replace('size=".1 .1 .1"', 'size=".5 .5 .5"')
    (folder / "a.urdf").write_text(SEVEN.replace('</link><joint name="ax3"', thick, 1))
    main(["check", "a.urdf", "--config", str(cell_file(folder, "ur10"))])
    assert re.search(r"l1 touches l3|l3 touches l5", said(capsys))


def test_trees_and_robots_are_not_checked_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(FOLDER / "ur10.yaml"), "tree.xml"]) == 2
    assert "tree.xml: no robot" in said(capsys)


def test_a_cell_is_sent_to_the_doctor(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(DEFAULT_CONFIGURATION)]) == 2
    told = said(capsys)
    assert "cell.yaml: no robot; `cell doctor --config FILE` checks a cell" in told
    assert "XML" not in told
